"""Slips of units are refused with the key of the vehicle file and the likely slip."""

import pytest

from canroll import vehicles
from canroll.errors import CanrollError


@pytest.mark.parametrize(
    ("key", "number", "message"),
    [
        ("suspension.spring_rate_front", 24.4, "ride frequency .* N/mm for N/m.*write 24400"),
        ("tyre.cornering_stiffness_front", 2239.0, "cornering coefficient.*per degree.*128285"),
        ("tyre.friction", 102.0, r"\(0.1 to 2.5\).*per cent.*write 1.02"),
        ("tyre.radius", 31.6, r"\(0.2 to 0.7 m\).*cm.*write 0.316"),
        ("steering.ratio", 0.06, "inverted.*write 16.6667"),
        ("geometry.half_track_front", 1.73, "the full track.*write 0.865"),
        ("plant.roll_damping", 57.0, "roll damping ratio.*per degree.*write 3265"),
        ("tyre.vertical_stiffness", 158.0, "deflection over radius.*write 158000"),
        ("plant.sprung_mass", 0.9657, "write 965.7"),
        ("tyre.wheel_inertia", 1.7e3, "write 1.7"),
    ],
)
def test_a_slip_of_units_is_named(key, number, message):
    section, name = key.split(".")
    with pytest.raises(CanrollError, match=message) as refusal:
        vehicles.load({"base": "sedan_320i", section: {name: number}})
    assert str(refusal.value).startswith(f"vehicle: {key} = ")
    assert "\n" not in str(refusal.value)


def test_a_roll_stiffness_is_compared_with_springs_and_tyres():
    table = {"base": "sedan_320i", "plant": {"roll_stiffness": 160e3}}
    message = "springs and bars over that of the springs alone of .*without the tyres in series"
    with pytest.raises(CanrollError, match=message):
        vehicles.load(table)
    with pytest.raises(
        CanrollError, match=r"springs and bars over that of the springs alone of 0\.6"
    ):
        vehicles.load({"base": "sedan_320i", "plant": {"roll_stiffness": 24e3}})


def test_a_file_takes_the_unusual_numbers_of_its_base(tmp_path):
    base = tmp_path / "racer.toml"
    base.write_text(
        'base = "sedan_320i"\nunusual = ["tyre.friction"]\n[tyre]\nfriction = 3.0\n',
        encoding="utf-8",
    )
    table = {"base": str(base), "steering": {"ratio": 12.0}}
    assert vehicles.load(table).tyre.friction == 3.0
    assert vehicles.load({"base": "sedan_320i", "tyre": str(base)}).tyre.friction == 3.0
    with pytest.raises(CanrollError, match=r"tyre\.friction = 4"):
        vehicles.load(table | {"tyre": {"friction": 4.0}})


def test_an_unusual_number_can_be_meant():
    table = {"base": "sedan_320i", "tyre": {"friction": 3.0}}
    with pytest.raises(CanrollError, match=r"unusual = \['tyre.friction'\]"):
        vehicles.load(table)
    assert vehicles.load(table | {"unusual": ["tyre.friction"]}).tyre.friction == 3.0
