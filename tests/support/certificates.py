"""Certificates of tests: how they are read, changed and refused, and a small condition."""

from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll import vehicles
from canroll.extensions.certify import checker
from canroll.extensions.certify.claim import texts
from canroll.extensions.certify.subject import INTEGERS, READINGS
from canroll.gain_gen.analysis.actuated_car import actuated, roll_car
from canroll.gain_gen.calibration.calibration_file import LoadedCalibration

TICK, DELAY = Fraction(1, 100), (Fraction(4, 1000), Fraction(8, 1000))
RESOLUTION = ["6000", "21000", "9000", "16000", "16000"]


def integers_of(calibration: LoadedCalibration) -> dict[str, Any]:
    """Return the integers of a calibration that the checker reads."""
    return {name: getattr(calibration.record, name) for name in INTEGERS}


def signed(content: dict[str, Any]) -> dict[str, Any]:
    """Return the contents with the digest that belongs to them."""
    content["sha256"] = checker.digest(content)
    return content


def refusal(content: dict[str, Any], integers: dict[str, Any]) -> str:
    """Return why the checker refuses, or "" where it accepts."""
    try:
        list(checker.check(content, integers))
    except Exception as error:
        return str(error) or repr(error)
    return ""


def at(content: Any, path: Iterable[Any]) -> Any:
    """Return the entry at a path."""
    for key in path:
        content = content[key]
    return content


def floats(rows: Iterable[Iterable[str]]) -> NDArray[np.float64]:
    """Return numbers that are texts of fractions."""
    return np.array([[float(Fraction(text)) for text in row] for row in rows])


def roll_model(kmh: float = 80, damping: float = 1.0) -> dict[str, Any]:
    """The roll model with actuator and sensors as a condition, with a factor on its damping."""
    vehicle = vehicles.load("van_real")
    model = replace(vehicle.design, roll_damping=damping * vehicle.design.roll_damping)
    car = actuated(roll_car(model), lag=0.02, sensors=vehicle.sensors)
    inputs = [car.command / (1 << 14), car.disturbance, *[0 * car.command] * 2]
    return {
        "name": f"{checker.MODEL}, {kmh:.0f} km/h",
        "speed": round(kmh / 3.6 * (1 << 20)),
        "flow": texts(np.hstack([car.a, *inputs])),
        "readings": texts(car.measured[[0, 1, 3]] * READINGS[:, None]),
        "roll": texts(car.measured[2]),
        "claims": [],
    }
