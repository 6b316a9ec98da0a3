"""Quantities that a map joins with the variables of an FMU, and units."""

import math

from plant_sim.bodies import ports
from plant_sim.bodies.ports import WHEELS

AXLES = ("front", "rear")


def _four(name: str, first: int, unit: str) -> dict[str, tuple[int, str]]:
    return {f"{name}_{wheel}": (first + k, unit) for k, wheel in enumerate(WHEELS)}


def _two(name: str, first: int, unit: str) -> dict[str, tuple[int, str]]:
    return {f"{name}_{axle}": (first + k, unit) for k, axle in enumerate(AXLES)}


INPUTS: dict[str, tuple[int, str]] = {
    "steer": (ports.STEER, "rad"),
    "drive_force": (ports.DRIVE_FORCE, "N"),
    **_four("brake_force", ports.BRAKE_FORCE, "N"),
    **_four("corner_force", ports.CORNER_FORCE, "N"),
    **_two("bar_moment", ports.BAR_MOMENT_FRONT, "N.m"),
    **_two("valve_current", ports.VALVE_CURRENT_FRONT, "A"),
    **_four("road_height", ports.ROAD_HEIGHT, "m"),
    "bank": (ports.BANK, "rad"),
    "grade": (ports.GRADE, "rad"),
    "friction": (ports.FRICTION, ""),
}
"""What drives the vehicle: place in the vector of inputs, and unit."""
NEUTRAL = {"friction": 1.0}
"""Values of inputs that do nothing, where they are not 0."""

_FRONT = (*(f"corner_force_{wheel}" for wheel in WHEELS[:2]), "bar_moment_front")
_REAR = (*(f"corner_force_{wheel}" for wheel in WHEELS[2:]), "bar_moment_rear")
DERIVED: dict[str, tuple[str, tuple[str, ...]]] = {
    "steering_wheel_angle": ("rad", ("steer",)),
    "speed": ("m/s", ("drive_force",)),
    "roll_moment_front": ("N.m", _FRONT),
    "roll_moment_rear": ("N.m", _REAR),
    "roll_moment": ("N.m", (*_FRONT, *_REAR)),
}
"""Further inputs, made of those: unit, and the inputs that they stand for."""

OUTPUTS: dict[str, tuple[int, str]] = {
    "x": (ports.X, "m"),
    "y": (ports.Y, "m"),
    "yaw": (ports.YAW, "rad"),
    "vx": (ports.VX, "m/s"),
    "vy": (ports.VY, "m/s"),
    "ax": (ports.AX, "m/s2"),
    "ay": (ports.AY, "m/s2"),
    "yaw_rate": (ports.YAW_RATE, "rad/s"),
    "yaw_acc": (ports.YAW_ACC, "rad/s2"),
    "roll": (ports.ROLL, "rad"),
    "roll_rate": (ports.ROLL_RATE, "rad/s"),
    "roll_acc": (ports.ROLL_ACC, "rad/s2"),
    "pitch": (ports.PITCH, "rad"),
    "pitch_rate": (ports.PITCH_RATE, "rad/s"),
    "pitch_acc": (ports.PITCH_ACC, "rad/s2"),
    "heave": (ports.HEAVE, "m"),
    "heave_rate": (ports.HEAVE_RATE, "m/s"),
    "heave_acc": (ports.HEAVE_ACC, "m/s2"),
    "sprung_ax": (ports.BODY_ACC, "m/s2"),
    "sprung_ay": (ports.BODY_ACC + 1, "m/s2"),
    "sprung_az": (ports.BODY_ACC + 2, "m/s2"),
    **_four("wheel_load", ports.WHEEL_LOAD, "N"),
    **_four("travel", ports.TRAVEL, "m"),
    **_four("travel_rate", ports.TRAVEL_RATE, "m/s"),
    **_four("wheel_speed", ports.WHEEL_SPEED, "rad/s"),
    **_four("wheel_height", ports.WHEEL_HEIGHT, "m"),
    **_four("lateral_force", ports.LATERAL_FORCE, "N"),
    "rollover": (ports.ROLLOVER, ""),
    "two_wheel_lift": (ports.TWO_WHEEL_LIFT, ""),
}
"""What the vehicle does: place in the vector of outputs, and unit."""
REQUIRED = ("x", "y", "yaw", "vx", "ay", "yaw_rate", "roll")
"""Outputs without which driver or sensors cannot be."""
RATES = {
    "roll_rate": "roll",
    "roll_acc": "roll_rate",
    "yaw_acc": "yaw_rate",
    "pitch_rate": "pitch",
    "pitch_acc": "pitch_rate",
    "heave_rate": "heave",
    "heave_acc": "heave_rate",
    **{f"travel_rate_{wheel}": f"travel_{wheel}" for wheel in WHEELS},
}
"""Outputs that are differences of others over a step where the map does not have them."""
SAME = {"sprung_ax": "ax", "sprung_ay": "ay", "sprung_az": "heave_acc"}
"""Outputs that are taken as another where the map does not have them."""
AT_REST = ("pitch", "heave")
"""Outputs that are 0 where the map does not have them, with their rates."""

UNITS = {
    "": ("", 1.0),
    "1": ("", 1.0),
    "%": ("", 0.01),
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180),
    "rad/s": ("rad/s", 1.0),
    "deg/s": ("rad/s", math.pi / 180),
    "rpm": ("rad/s", math.pi / 30),
    "rad/s2": ("rad/s2", 1.0),
    "deg/s2": ("rad/s2", math.pi / 180),
    "m": ("m", 1.0),
    "cm": ("m", 1e-2),
    "mm": ("m", 1e-3),
    "m/s": ("m/s", 1.0),
    "mm/s": ("m/s", 1e-3),
    "km/h": ("m/s", 1 / 3.6),
    "m/s2": ("m/s2", 1.0),
    "N": ("N", 1.0),
    "kN": ("N", 1e3),
    "N.m": ("N.m", 1.0),
    "kN.m": ("N.m", 1e3),
    "A": ("A", 1.0),
    "mA": ("A", 1e-3),
}
"""SI unit and factor of units by name."""
_SPELT = {
    **{"Nm": "N.m", "kNm": "kN.m", "N·m": "N.m", "kN·m": "kN.m", "N*m": "N.m", "kph": "km/h"},
    **{"°": "deg", "°/s": "deg/s", "m/s²": "m/s2", "m/s^2": "m/s2", "rad/s²": "rad/s2"},
    **{"rad/s^2": "rad/s2", "deg/s²": "deg/s2", "deg/s^2": "deg/s2", "-": ""},
}


def spelt(unit: str) -> str:
    """Return a unit as :data:`UNITS` spells it, if it is one of those."""
    return _SPELT.get(unit, unit)
