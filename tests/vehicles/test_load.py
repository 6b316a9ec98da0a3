import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from canroll import vehicles
from canroll.errors import CanrollError, UnknownNameError

FOLDER = Path(vehicles.__file__).parent


def table(name="van_real"):
    return tomllib.loads((FOLDER / f"{name}.toml").read_text())


@pytest.mark.parametrize("name", vehicles.names())
def test_every_preset_loads_and_every_number_has_a_source(name):
    vehicle = vehicles.load(name)
    assert vehicle.name == name
    assert vehicle.source("plant.roll_stiffness")
    assert vehicle.source("actuators.bars.lag") == vehicle.source("actuators.bars")


def test_printed_design_models():
    van, suv = vehicles.load("van_2021").design, vehicles.load("suv_2020").design
    assert van.effective_stiffness == pytest.approx(12601, abs=1)
    assert van.natural_frequency == pytest.approx(5.020, abs=1e-3)
    assert van.damping_ratio == pytest.approx(0.705, abs=1e-3)
    assert suv.effective_stiffness == pytest.approx(60456, abs=1)
    assert suv.roll_arm == pytest.approx(442.8)


def test_real_van_is_plausible():
    van = vehicles.load("van_real")
    assert 5.0 <= van.design.roll_gradient_deg_per_g <= 6.0
    assert 1.0 < van.static_stability_factor < 1.2
    assert van.design == van.plant


def test_unknown_vehicle_suggests_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'van_2021'"):
        vehicles.load("vna_2021")


def test_a_file_named_without_its_ending_is_suggested(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("golf.toml").touch()
    with pytest.raises(CanrollError, match=r"unknown vehicle 'golf': did you mean 'golf\.toml'"):
        vehicles.load("golf")


@pytest.mark.parametrize(
    ("mass", "message"),
    [
        (float("nan"), r"^x: plant\.sprung_mass = nan"),
        (3075.0, r"^x: plant\..* 3075 kg \(lb\?\) and"),
    ],
)
def test_a_file_without_a_design_is_told_of_its_own_keys(mass, message):
    own = vehicles.load("sedan_320i").document
    del own["design"]
    own["plant"]["sprung_mass"] = mass
    own["plant"]["roll_stiffness"] = 2e5
    with pytest.raises(CanrollError, match=message):
        vehicles.from_table(own, name="x", where="x")


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(CanrollError, match="cannot read vehicle file"):
        vehicles.load(tmp_path / "none.toml")
    broken = tmp_path / "broken.toml"
    broken.write_text("schema = \n")
    with pytest.raises(CanrollError, match="not a TOML file"):
        vehicles.load(broken)


def test_own_file_by_path(tmp_path):
    own = tmp_path / "mine.toml"
    own.write_text((FOLDER / "van_real.toml").read_text())
    assert vehicles.load(str(own)).name == "mine"


@pytest.mark.parametrize(
    ("section", "key", "value", "message"),
    [
        ("design", "roll_stiffness", 1000.0, "does not hold the body up"),
        ("plant", "roll_inertia", 900.0, "must exceed m h²"),
        ("mass", "pitch_inertia", 1000.0, "impossible inertia"),
        ("mass", "yaw_inertia", 100.0, "wheels alone"),
        ("geometry", "half_track_front", -0.8, "must not be negative"),
        ("tyre", "radius", 0.0, "must be positive"),
        ("tyre", "shape", 2.5, "magic formula"),
        ("tyre", "friction_load_slope", 0.7, "grip would fall"),
        ("suspension", "roll_stiffness_front_share", 1.5, "between 0 and 1"),
        ("steering", "ratio", "wide", "must be a number"),
        ("steering", "ratio", float("nan"), "not a finite number"),
        ("sensors", "imu_position", [0.0, 0.0], "must have 3 numbers"),
    ],
)
def test_impossible_values_are_refused_with_the_reason(section, key, value, message):
    changed = table()
    changed[section][key] = value
    with pytest.raises(CanrollError, match=message) as refusal:
        vehicles.from_table(changed, name="x", where="x.toml")
    assert str(refusal.value).startswith("x.toml: ") and "\n" not in str(refusal.value)


def test_missing_unknown_and_unsourced_keys():
    changed = table()
    del changed["tyre"]["radius"]
    with pytest.raises(CanrollError, match=r"\[tyre\] missing key 'radius'"):
        vehicles.from_table(changed, name="x")
    changed["tyre"]["radus"] = 0.3
    with pytest.raises(CanrollError, match="unknown key 'radus', did you mean 'radius'"):
        vehicles.from_table(changed, name="x")
    changed = table()
    del changed["sources"]["tyre"]
    with pytest.raises(CanrollError, match="has no source"):
        vehicles.from_table(changed, name="x")
    changed = table() | {"schema": 2}
    with pytest.raises(CanrollError, match="schema 2, but this version reads 1"):
        vehicles.from_table(changed, name="x")


def test_printed_full_car_inertia_is_refused():
    """Vu 2020, Table 2: 960, 720 and 4520 kg·m² belong to no rigid body."""
    changed = table()
    changed["plant"] |= {"roll_inertia": 960.0, "sprung_mass": 943.0}
    changed["plant"]["cg_height_above_roll_axis"] = 0.2
    changed["mass"] |= {"pitch_inertia": 720.0, "yaw_inertia": 4520.0}
    with pytest.raises(CanrollError, match="no rigid body has a yaw moment"):
        vehicles.from_table(changed, name="x")


def test_lateral_gain_is_that_of_the_steady_turn():
    """Against the ratio a_y / δ of the bicycle's steady equations solved as a linear system."""
    vehicle = vehicles.load("van_real")
    geometry, tyre, speed = vehicle.geometry, vehicle.tyre, 20.0
    front, rear = tyre.cornering_stiffness_front, tyre.cornering_stiffness_rear
    lf, lr, mass = geometry.cg_to_front_axle, geometry.cg_to_rear_axle, vehicle.total_mass
    # unknowns: sideslip, yaw rate; steady lateral and yaw balance at δ = 1
    matrix = np.array(
        [
            [-(front + rear), -(front * lf - rear * lr) / speed - mass * speed],
            [-(front * lf - rear * lr), -(front * lf**2 + rear * lr**2) / speed],
        ]
    )
    _, yaw_rate = np.linalg.solve(matrix, -np.array([front, front * lf]))
    expected = speed * yaw_rate
    assert vehicle.lateral_gain(speed) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("name", vehicles.names())
def test_a_document_gives_the_same_vehicle_again(name):
    vehicle = vehicles.load(name)
    for text, parse in (
        (tomli_w.dumps(vehicle.document), tomllib.loads),
        (json.dumps(vehicle.document), json.loads),
    ):
        again = vehicles.embedded(
            parse(text), reference=name, fingerprint=vehicle.fingerprint, where="file"
        )
        assert again == vehicle


def test_a_vehicle_without_an_empty_body_has_a_document():
    vehicle = replace(vehicles.load("van_real"), empty=None)
    assert "empty" not in vehicle.document
    assert vehicles.load(vehicle) == vehicle


def test_any_speed_has_a_document_of_the_same_fingerprint():
    preset = vehicles.load("van_real")
    for speed in np.random.default_rng(0).uniform(5.0, 60.0, 200):
        vehicle = replace(preset, speeds={"moose": float(speed)})
        assert vehicles.load(vehicle).fingerprint == vehicle.fingerprint


def test_the_fingerprint_has_numbers_and_no_texts():
    vehicle = vehicles.load("van_real")
    assert replace(vehicle, title="Van", name="van", file="van.toml").fingerprint == (
        vehicle.fingerprint
    )
    assert replace(vehicle, lane_offset=3.0).fingerprint != vehicle.fingerprint


@pytest.mark.parametrize(
    ("content", "kind"),
    [("[calibration]\n", "a calibration, for --calibration"), ("[receive.imu]\n", "a map of sig")],
)
def test_a_file_of_another_kind_is_named(tmp_path, content, kind):
    path = tmp_path / "other.toml"
    path.write_text(content)
    with pytest.raises(CanrollError, match=rf"other\.toml: this is {kind}"):
        vehicles.load(path)
