"""Discrete dynamic controllers from roll rate, accelerometer and steering to the moment."""

import numpy as np

from canroll.firmware.calibration import N_ORDER
from canroll.gain_gen.laws.compensator import scaled_states
from canroll.gain_gen.models.controller import S_LATERAL, S_RATE, S_STEERING, Compensator
from canroll.gain_gen.models.state_space import StateSpace
from canroll.gain_gen.output_feedback.driven_car import MOMENT_UNIT

READINGS = np.array([0.3, 3.0, 3.0])
"""Typical sizes of the readings, by which the reduction is weighted: rad/s, m/s², m/s²."""
INPUTS = [S_RATE, S_LATERAL, S_STEERING]


def residualised(full: StateSpace, order: int) -> StateSpace:
    """Return a stable controller of at most ``order`` states; its steady gains stay.

    A controller is ξ⁺ = A ξ + B y, u = C ξ + D y with y = [roll rate, a_y, a_y by steering] and u
    in kN·m.
    """
    return full.balanced(READINGS)[0].residualised(order)


def compensator(full: StateSpace) -> Compensator:
    """Return a stable controller in the ECU's form and of its order."""
    reduced = residualised(full, N_ORDER)
    n = len(reduced.a)
    b, d = np.zeros((n, 4)), np.zeros((1, 4))
    b[:, INPUTS], d[:, INPUTS] = reduced.b, MOMENT_UNIT * reduced.d
    return scaled_states(
        Compensator(a=reduced.a, b=b, e=np.zeros((n, 1)), c=MOMENT_UNIT * reduced.c, d=d),
        full.tick,
    )
