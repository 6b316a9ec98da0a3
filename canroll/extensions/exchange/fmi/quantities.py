"""Quantities that a map joins with the variables of an FMU, and units."""

import math

from canroll.plant_sim.bodies import ports
from canroll.plant_sim.bodies.ports import WHEELS, Port

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


def _exchanged(table: tuple[Port, ...]) -> dict[str, tuple[int, str]]:
    return {
        name: (slot, spelt(port.unit))
        for port in table
        if port.exchanged
        for name, slot in port.slots.items()
    }


INPUTS = _exchanged(ports.INPUTS)
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
"""Further inputs, derived from those: unit, and the inputs that they stand for."""

OUTPUTS = _exchanged(ports.OUTPUTS)
"""What the vehicle does: place in the vector of outputs, and unit."""
REQUIRED = ("x", "y", "yaw", "vx", "ay", "yaw_rate", "roll")
"""Outputs that driver and sensors require."""
RATES = {
    **{name: name.replace("_rate", "") for name in OUTPUTS if "_rate" in name},
    **{name: name.replace("_acc", "_rate") for name in OUTPUTS if name.endswith("_acc")},
}
del RATES["yaw_rate"]  # required
"""Outputs that are differences of others over a step where the map does not have them."""
SAME = {"sprung_ax": "ax", "sprung_ay": "ay", "sprung_az": "heave_acc"}
"""Outputs that are taken as another where the map does not have them."""
AT_REST = ("pitch", "heave")
"""Outputs that are 0 where the map does not have them, with their rates."""
