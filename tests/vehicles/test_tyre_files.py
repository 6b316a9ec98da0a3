"""Vehicles on tyres of .tir files: what follows from these, what the vehicle file still says."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.vehicles.axles import axles
from canroll.vehicles.tyre_files import check_change, outside, scaled
from canroll.vehicles.unladen import unladen

TYRES = Path(__file__).parent / "tyres"


@pytest.fixture
def load(tmp_path):
    for file in TYRES.glob("*.tir"):
        shutil.copy(file, tmp_path)

    def of(tyre='file = "passenger_61.tir"', base='base = "sedan_320i"', name="car"):
        path = tmp_path / f"{name}.toml"
        path.write_text(f"{base}\n[tyre]\n{tyre}\n")
        return vehicles.load(path)

    return of


def test_numbers_of_the_tyres_follow_from_their_file(load):
    car, base = load(), vehicles.load("sedan_320i")
    front, rear = axles(car)
    assert (front.tyre_model, rear.tyre_model) == ("magic_formula", "magic_formula")
    assert car.tyre.cornering_stiffness_front == pytest.approx(front.cornering, rel=0.01)
    assert car.tyre.vertical_stiffness == 210000.0 and car.tyre.vertical_damping == 150.0
    assert car.tyre.rolling_resistance == base.tyre.rolling_resistance
    assert front.relaxation_length != rear.relaxation_length
    mean = sum(car.tyre.radius + load / 210000.0 for load in car.wheel_loads) / 2
    assert mean == pytest.approx(0.3175, abs=1e-12)
    assert car.source("magic_formula.front") == "passenger_61.tir"
    assert car.source("tyre.vertical_stiffness") == "passenger_61.tir, VERTICAL_STIFFNESS"


def test_the_document_stands_alone(load):
    car = load()
    again = vehicles.from_table(car.document, name="again")
    assert again.tyre == car.tyre and again.fingerprint == car.fingerprint
    assert "friction" not in car.document["tyre"]
    assert vehicles.load(car).magic_formula == car.magic_formula


def test_each_axle_may_have_its_file(load):
    car = load('file_front = "passenger_61.tir"\nfile_rear = "passenger_52.tir"')
    front, rear = axles(car)
    assert front.tyre.coefficients["FITTYP"] == 61.0 and rear.tyre.coefficients["FITTYP"] == 6.0


def test_load_and_factors_change_what_follows(load):
    car = load()
    heavier = car.replace({"plant.sprung_mass": 1.1 * car.plant.sprung_mass})
    assert heavier.tyre.cornering_stiffness_front > 1.02 * car.tyre.cornering_stiffness_front
    assert unladen(car).tyre.cornering_stiffness_rear < car.tyre.cornering_stiffness_rear
    slippery = car.replace({f"magic_formula.{axle}.LMUY": 0.5 for axle in ("front", "rear")})
    assert slippery.tyre.friction == pytest.approx(0.5 * car.tyre.friction)
    assert scaled(car, 0.8, 0.5).tyre.friction == slippery.tyre.friction
    assert axles(scaled(car, 0.8, 1.0))[0].cornering == pytest.approx(
        0.8 * axles(car)[0].cornering, rel=0.01
    )
    with pytest.raises(CanrollError, match=r"tyre.friction follows .* magic_formula.front.LMUY"):
        car.replace({"tyre.friction": 0.8})
    with pytest.raises(CanrollError, match=r"tyre\.radius follows"):
        check_change(car, "tyre.radius")
    check_change(vehicles.load("sedan_320i"), "tyre.radius")


def test_a_car_based_on_one_has_its_tyres_or_others(load, tmp_path):
    car = load()
    same = load("rolling_resistance = 0.02", 'base = "car.toml"', "same")
    assert same.magic_formula == car.magic_formula and same.tyre.rolling_resistance == 0.02
    other = load('file = "passenger_62.tir"', 'base = "car.toml"', "other")
    assert other.magic_formula.front["FITTYP"] == 62.0
    (tmp_path / "taken.toml").write_text('base = "sedan_320i"\ntyre = "car.toml"\n')
    taken = vehicles.load(tmp_path / "taken.toml")
    assert taken.magic_formula == car.magic_formula and taken.tyre == car.tyre
    (tmp_path / "back.toml").write_text('base = "car.toml"\ntyre = "sedan_320i"\n')
    back = vehicles.load(tmp_path / "back.toml")
    assert back.magic_formula is None and back.tyre == vehicles.load("sedan_320i").tyre


@pytest.mark.parametrize(
    ("tyre", "message"),
    [
        ('file = "no.tir"', "cannot read tyre file .*no.tir"),
        ("file = 3", "tyre.file_front must be the path|must be the path"),
        ('file_front = "passenger_61.tir"', "tyre.file_rear is missing: both axles"),
        ('file = "passenger_61.tir"\nfile_rear = "passenger_61.tir"', "tyre.file is for both"),
        ('file = "passenger_61.tir"\nfriction = 1.0', "tyre.friction follows from passenger_61"),
        ('file = "passenger_61.tir"\nradius = 0.3', "tyre.radius follows"),
        ('file = "passenger_61.tir"\nrelaxation_length = 0.3', "tyre.relaxation_length follows"),
        ('file = "passenger_61.tir"\nvertical_stiffness = 2e5', "and VERTICAL_STIFFNESS of"),
    ],
)
def test_keys_that_contradict_the_file_are_refused_in_one_line(load, tyre, message):
    with pytest.raises(CanrollError, match=message) as caught:
        load(tyre)
    assert "\n" not in str(caught.value)


def test_limits_that_the_car_at_rest_does_not_keep_are_named(load):
    car = load()
    assert outside(car) == [] and outside(vehicles.load("sedan_320i")) == []
    files = replace(car.magic_formula, rear={**car.magic_formula.rear, "FZMAX": 2000.0})
    (line,) = outside(replace(car, magic_formula=files))
    assert line.startswith("tyre file, rear: wheel load at rest") and "> FZMAX 2000" in line


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("LMUY", 0.0, "LMUY = 0: must be positive"),
        ("FITTYP", 70.0, "FITTYP = 70: no version"),
        ("PKY1", 20.0, "cornering_stiffness_front = .* must not be negative"),
        ("PCX1", float("nan"), "PCX1 = nan: must be positive"),
    ],
)
def test_impossible_coefficients_are_refused(load, key, value, message):
    with pytest.raises(CanrollError, match=message):
        load().replace({f"magic_formula.front.{key}": value})
