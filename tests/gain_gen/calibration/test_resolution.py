"""The steps of a bus's signals: of the contract, of a bus of one's own, and in a calibration."""

import math
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from canroll.codegen.generated.bus_map import load
from canroll.errors import CanrollError
from canroll.gain_gen.calibration.resolution import of_bus, of_calibration, of_contract

OWN = Path(__file__).parents[3] / "examples" / "own_bus"


def test_the_contract_and_a_bus_of_ones_own():
    degree = math.pi / 180.0
    assert asdict(of_contract()) == pytest.approx(
        {
            "roll_rate": 0.005 * degree,
            "lateral_acceleration": 0.00125,
            "steering": 0.1 * degree,
            "delivered": 0.5,
            "bar": 0.25,
            "force": 2.0,
        }
    )
    own = of_bus(load(OWN / "own.dbc", OWN / "own.toml"))
    expected = replace(of_contract(), lateral_acceleration=0.0001 * 9.80665)
    assert asdict(own) == pytest.approx(asdict(expected))


def calibration_with(resolution):
    tables = {"design": {} if resolution is None else {"resolution": resolution}}
    return SimpleNamespace(tables=tables, path=Path("calibration.toml"))


def test_a_calibration_without_steps_has_none_and_one_with_others_is_refused():
    good = asdict(of_contract())
    assert of_calibration(calibration_with(good)) == of_contract()
    assert of_calibration(calibration_with(None)) is None
    for wrong in (3, {}, good | {"bar": "1"}, good | {"bar": -1.0}, good | {"yaw_rate": 1.0}):
        with pytest.raises(CanrollError, match=r"\[design\] resolution must have numbers of bar, "):
            of_calibration(calibration_with(wrong))
