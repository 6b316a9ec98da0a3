"""Discrete dynamic controllers from roll rate, accelerometer and steering to the moment."""

from dataclasses import dataclass

import numpy as np

from firmware.calibration import N_ORDER
from gain_gen.laws.compensator import scaled_states
from gain_gen.models.controller import S_LATERAL, S_RATE, S_STEERING, Compensator
from gain_gen.models.full_car import balanced
from gain_gen.models.roll import Matrix
from gain_gen.output_feedback.driven_car import MOMENT_UNIT

READINGS = np.array([0.3, 3.0, 3.0])
"""Typical sizes of the readings, by which the reduction is weighted: rad/s, m/s², m/s²."""
INPUTS = [S_RATE, S_LATERAL, S_STEERING]


@dataclass(frozen=True, slots=True)
class Dynamic:
    """ξ⁺ = A ξ + B y, u = C ξ + D y with y = [roll rate, a_y, a_y by steering], u in kN·m.

    Attributes:
        a: (n, n).
        b: (n, 3).
        c: (1, n).
        d: (1, 3).
    """

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix

    @property
    def stable(self) -> bool:
        """Whether the controller alone is stable: the ECU may lose the loop at any time."""
        return bool(np.abs(np.linalg.eigvals(self.a)).max() < 1.0)


def residualised(full: Dynamic, order: int) -> Dynamic:
    """Return a stable controller of at most ``order`` states.

    Balanced; the states left out take their steady value, so that its steady gains stay.
    """
    a, b, c, _ = balanced(full.a, full.b * READINGS, full.c)
    b = b / READINGS
    slow, fast = slice(order), slice(order, None)
    settled = np.linalg.solve(
        np.eye(len(a[fast])) - a[fast, fast], np.hstack([a[fast, slow], b[fast]])
    )
    kept = len(a[slow])
    states, inputs = settled[:, :kept], settled[:, kept:]
    return Dynamic(
        a[slow, slow] + a[slow, fast] @ states,
        b[slow] + a[slow, fast] @ inputs,
        c[:, slow] + c[:, fast] @ states,
        full.d + c[:, fast] @ inputs,
    )


def compensator(full: Dynamic, tick: float) -> Compensator:
    """Return a stable controller in the ECU's form and of its order."""
    found = residualised(full, N_ORDER)
    n = len(found.a)
    b, d = np.zeros((n, 4)), np.zeros((1, 4))
    b[:, INPUTS], d[:, INPUTS] = found.b, MOMENT_UNIT * found.d
    return scaled_states(
        Compensator(a=found.a, b=b, e=np.zeros((n, 1)), c=MOMENT_UNIT * found.c, d=d),
        tick,
    )
