"""The lateral coefficients of the Magic Formula that a table may tell, with priors and bounds.

Means and spreads are those of the public property files of Chrono (data/vehicle of
github.com/projectchrono/chrono: Sedan, VW microbus, Nissan Patrol, HMMWV, FED Alpha), of the
205/60 R15 tyre of TNO and of racing tyres, rounded up; terms of camber are 0 ± their size there.
Bounds are those of the equations: C ≤ 2, beyond which the force would reverse, E ≤ 1 (4.E24), a
stiffness that rises from no load on (PKY4 ≤ 2), and ranges that fitting tools have.
"""

from dataclasses import dataclass
from math import inf

from canroll.extensions.car.identification.unknowns import Unknown
from canroll.vehicles.tyres.magic_formula import Coefficients


@dataclass(frozen=True, slots=True)
class Lateral:
    """A coefficient: what it is, mean and deviation of its prior, and bounds."""

    label: str
    mean: float
    deviation: float
    least: float = -inf
    most: float = inf


COMMON = {
    "PCY1": Lateral("shape", 1.4, 0.2, 0.5, 2.0),
    "PDY1": Lateral("grip", 1.0, 0.5, 0.1, 5.0),
    "PDY2": Lateral("grip, over load", -0.13, 0.15, -1.0, 1.0),
    "PDY3": Lateral("grip, over camber²", 0.0, 5.0),
    "PEY1": Lateral("curvature", -0.3, 0.8, -20.0, 1.0),
    "PEY2": Lateral("curvature, over load", 0.0, 0.6),
    "PEY3": Lateral("curvature, by side", 0.0, 1.0),
    "PEY4": Lateral("curvature, by side over camber", 0.0, 15.0),
    "PKY1": Lateral("largest cornering stiffness", -20.0, 10.0, -100.0, -1.0),
    "PKY2": Lateral("load of largest cornering stiffness", 2.0, 0.7, 0.2, 10.0),
    "PKY3": Lateral("cornering stiffness, over camber", 0.0, 0.5),
    "PHY1": Lateral("shift of slip", 0.0, 0.005),
    "PHY2": Lateral("shift of slip, over load", 0.0, 0.004),
    "PVY1": Lateral("shift of force", 0.0, 0.04),
    "PVY2": Lateral("shift of force, over load", 0.0, 0.03),
    "PVY3": Lateral("shift of force, over camber", 0.0, 0.3),
    "PVY4": Lateral("shift of force, over camber and load", 0.0, 0.5),
}
"""Those of all versions."""
OLD = {"PHY3": Lateral("shift of slip, over camber", 0.0, 0.04)}
"""Those of version 5.2 alone."""
NEW = {
    "PEY5": Lateral("curvature, over camber²", 0.0, 15.0),
    "PKY4": Lateral("bend of cornering stiffness over load", 2.0, 0.1, 1.05, 2.0),
    "PKY5": Lateral("load of largest stiffness, over camber²", 0.0, 1.0),
    "PKY6": Lateral("camber stiffness", 0.0, 1.0),
    "PKY7": Lateral("camber stiffness, over load", 0.0, 0.3),
}
"""Those of versions 6.1 and 6.2."""
GUESSED = {
    **{"PCX1": 1.64, "PEX1": 0.47, "PKX1": 20.0},
    **{"RBX1": 11.0, "RBX2": 10.0, "RCX1": 1.05},
    **{"RBY1": 8.0, "RBY2": 5.0, "RCY1": 1.05},
}
"""Longitudinal and combined slip of a tyre of which only the lateral force is known."""
UNSCALED = ("LFZO", "LCY", "LMUY", "LEY", "LKY", "LHY", "LVY", "LKYC")
"""Scaling factors of the lateral force without longitudinal slip."""


def unknowns(start: Coefficients, *, given: bool) -> tuple[Unknown, ...]:
    """Return the coefficients to fit, with priors about a file's if one is ``given``."""
    sought = {**COMMON, **(OLD if start.is_old else NEW)}
    result = []
    for key, one in sought.items():
        mean = start[key] if given else one.mean
        low, high = one.least, one.most
        # a file may have D < 0 and B > 0
        if key == "PDY1" and mean < 0.0:
            low, high = -high, -low
        prior = "of the start's file" if given else "of public tyre files"
        low, high = min(low, mean), max(high, mean)
        result.append(Unknown(key, one.label, "", mean, one.deviation, low, high, prior))
    return tuple(result)
