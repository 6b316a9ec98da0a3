"""Units as databases spell them."""

import math

import pytest

from canroll.codegen.frame.units import UNITS, conversion, normal
from canroll.errors import CanrollError

SPELLINGS = {
    "deg/s": "°/s Deg/s deg/sec deg/sek degrees/second Grad/s Unit_DegreOfArcPerSecon "
    "Unit_DegreePerSecond Â°/s DEG/S",
    "deg": "° degs Degrees Grad °Grad Â°Grad Unit_DegreOfArc",
    "rad/s": "rad/sec radians/second RAD/S",
    "km/h": "kph Kph KPH km/hr KM/H kmh Unit_KiloMeterPerHour Unit_KilometerPerHour",
    "mph": "MPH Mph mi/h",
    "m/s": "m/sec meters/sec Unit_MeterPerSecond",
    "m/s2": "m/s² m/s^2 m/s/s M/S^2 m/sÂ² meters/sec/sec Unit_MeterPerSeconSquar "
    "Unit_MeterPerSquareSecond meter/sec²",
    "g": "G Unit_ForceOfGravi",
    "Nm": "NM N·m N.m N-m Unit_NewtoMeter",
    "kNm": "kN·m KNM",
    "mm": "MM millimeter Unit_MilliMeter",
    "A": "a Amps ampere Unit_Amper",
    "": "- unitless None",
}


@pytest.mark.parametrize(
    ("unit", "spelling"), [(u, s) for u, text in SPELLINGS.items() for s in text.split()]
)
def test_a_unit_is_read_however_it_is_spelled(unit, spelling):
    assert normal(spelling) == unit


@pytest.mark.parametrize("unit", UNITS)
def test_a_units_own_name_is_its_spelling(unit):
    assert normal(unit) == unit == normal(f" {unit.upper()} ")


@pytest.mark.parametrize(
    "unit",
    ["deg/s2", "deg/s^2", "°C", "degC", "km/h/s", "1/m", "s", "rpm/s", "kph/mph", "Unit_Turn"],
)
def test_another_unit_is_none_of_them(unit):
    assert normal(unit) is None


def test_factors_are_exact_but_for_pi():
    assert float(conversion("Grad/sek", "rad/s", "yaw_rate", "")) == math.pi / 180
    assert conversion("KPH", "m/s", "speed", "") * 36 == 10


@pytest.mark.parametrize("unit", ["deh/s", "mph", "", "furlong", "A"])
@pytest.mark.parametrize("field_unit", [name for name in UNITS if name])
def test_only_units_of_the_fields_quantity_are_suggested(unit, field_unit):
    quantity = UNITS[field_unit].quantity
    if normal(unit) is not None and UNITS[normal(unit)].quantity == quantity:
        return
    with pytest.raises(CanrollError) as refused:
        conversion(unit, field_unit, "yaw_rate", "car.toml [receive.imu] Rate")
    text = str(refused.value).partition(f"'{unit}'")[2].partition(f"('{field_unit}')")
    suggested = (text[2] or text[0]).replace("did you mean", "").replace("choose from", "")
    words = suggested.rpartition(":")[2].replace("'", "").replace("?", "").split(", ")
    assert words and all(UNITS[word.strip()].quantity == quantity for word in words)


def test_a_plain_number_has_its_remedy():
    with pytest.raises(CanrollError, match='give unit = "" in the map'):
        conversion("Unit_Turn", "", "mode", "car.toml")
