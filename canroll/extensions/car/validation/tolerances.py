"""How far a simulated figure may be from a measured one, by manoeuvre.

No value here is printed from a standard. ISO 19364, 19365 and 22140 have tables of their own: who
works by them gives their values by ``--tolerance``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite, radians

import numpy as np

from canroll.errors import CanrollError, UnknownNameError
from canroll.typing import Vector


@dataclass(frozen=True, slots=True)
class Tolerance:
    """``offset`` in ``unit`` plus ``gain`` times the size of the value; what it is of."""

    offset: float
    gain: float
    unit: str
    meaning: str

    def of(self, value: float) -> float:
        """Return the half-width at a value in SI units, in SI units."""
        return FACTORS[self.unit] * self.offset + self.gain * abs(value)

    def along(self, values: Vector) -> Vector:
        """Return :meth:`of` several values."""
        return np.asarray(FACTORS[self.unit] * self.offset + self.gain * np.abs(values))


FACTORS = {"°": radians(1.0), "m/s²": 1.0, "s": 1.0, "m": 1.0, "": 1.0}
"""SI units of one of these; a phase in ° is one in rad."""

TOLERANCES: Mapping[str, Tolerance] = {
    "circle.lateral_acceleration": Tolerance(0.1, 0.03, "m/s²", "lateral acceleration of a point"),
    "circle.steering": Tolerance(3.0, 0.05, "°", "steering-wheel angle on a circle"),
    "circle.sideslip": Tolerance(0.3, 0.05, "°", "sideslip on a circle"),
    "circle.roll": Tolerance(0.2, 0.05, "°", "roll on a circle"),
    "peak": Tolerance(0.0, 0.10, "", "peaks of yaw rate and lateral acceleration"),
    "time": Tolerance(0.05, 0.0, "s", "instants of peaks and responses"),
    "decay": Tolerance(0.05, 0.0, "", "share of the peak yaw rate that is left"),
    "displacement": Tolerance(0.05, 0.05, "m", "lateral displacement"),
    "gain": Tolerance(0.0, 0.10, "", "steady and frequency-dependent gains"),
    "overshoot": Tolerance(0.05, 0.0, "", "overshoot, share of the steady value"),
    "phase": Tolerance(10.0, 0.0, "°", "phases of the frequency response"),
}
"""The tolerances and their defaults, by the name that ``--tolerance`` has for them."""


def with_choices(choices: Mapping[str, str]) -> dict[str, Tolerance]:
    """Return the tolerances with those chosen as "OFFSET:GAIN", in the unit of each.

    Raises:
        UnknownNameError: there is no such tolerance.
        CanrollError: not two numbers, or a negative one.
    """
    result = dict(TOLERANCES)
    for name, text in choices.items():
        if name not in TOLERANCES:
            raise UnknownNameError("tolerance", name, TOLERANCES)
        offset, _, gain = text.partition(":")
        try:
            values = float(offset), float(gain or 0.0)
        except ValueError as error:
            raise CanrollError(
                f"--tolerance {name}={text}: expected OFFSET:GAIN, such as {name}=0.2:0.05"
            ) from error
        if not all(isfinite(value) and value >= 0.0 for value in values) or not any(values):
            raise CanrollError(f"--tolerance {name}={text}: at least one must be above 0")
        result[name] = replace(TOLERANCES[name], offset=values[0], gain=values[1])
    return result
