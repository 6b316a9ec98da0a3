"""Compensators for the ECU: states scaled for 24-bit fractions, order checked."""

from dataclasses import replace

import numpy as np

from canroll.errors import CanrollError
from canroll.firmware.calibration import N_ORDER
from canroll.gain_gen.models.controller import Compensator
from canroll.gain_gen.models.roll import Matrix, stationary_covariance

TYPICAL_INPUTS = np.array([0.05, 0.3, 3.0, 3.0])
"""Standard deviations of roll, roll rate, a_y and a_y by steering: rad, rad/s, m/s²."""
TYPICAL_TIME = 0.5
"""Time constant of the low-pass that makes typical inputs of white noise, s."""
GROWTH_TIME = 5.0
"""Time over which the states of a marginal or unstable compensator grow, s."""
COMPENSATOR_SIGMA = 4.0
"""Standard deviation that every state is scaled to; the ECU's states saturate at 64."""


def checked(compensator: Compensator) -> Compensator:
    """Return ``compensator`` if its matrices are consistent and fit the ECU.

    Raises:
        CanrollError: a matrix does not fit; the message names it and its shape.
    """
    n, outputs = len(compensator.a), len(compensator.c)
    shapes = {"A": (n, n), "B": (n, 4), "E": (n, outputs), "C": (outputs, n), "D": (outputs, 4)}
    for name, shape in shapes.items():
        matrix = getattr(compensator, name.lower())
        if matrix.shape != shape:
            raise CanrollError(f"{name} is {matrix.shape}, it must be {shape}")
        if not np.all(np.isfinite(matrix)):
            raise CanrollError(f"{name} has an entry that is not a number")
    if not 1 <= n <= N_ORDER:
        raise CanrollError(f"the compensator has order {n}: the ECU supports 1 to {N_ORDER}")
    if not 1 <= outputs <= 2:
        raise CanrollError(
            f"the compensator has {outputs} outputs: it must be 1 (moment) or 2 (front, rear)"
        )
    return compensator


def scaled_states(compensator: Compensator, tick: float) -> Compensator:
    """Return the same compensator with states of equal size under typical inputs.

    Inputs are taken as noise low-pass filtered with :data:`TYPICAL_TIME`, so that slow states count
    too; a state that no input reaches keeps its scale. States of marginal or unstable compensators
    are sized by their response after :data:`GROWTH_TIME`.

    Args:
        compensator: at the tick.
        tick: s, a small part of both times.
    """
    n = len(compensator.a)
    closed = compensator.a + compensator.e @ compensator.c
    drive = compensator.b + compensator.e @ compensator.d
    decay = 1.0 - tick / TYPICAL_TIME
    joint = np.zeros((n + 4, n + 4))
    joint[:n, :n] = closed
    joint[:n, n:] = drive
    joint[n:, n:] = decay * np.eye(4)
    noise = np.zeros_like(joint)
    noise[n:, n:] = np.diag(TYPICAL_INPUTS**2 * (1.0 - decay**2))
    covariance: Matrix = noise
    if np.abs(np.linalg.eigvals(closed)).max() < 1.0:
        covariance = stationary_covariance(joint, noise)
    else:
        for _ in range(round(GROWTH_TIME / tick)):
            covariance = joint @ covariance @ joint.T + noise
    size = np.sqrt(np.diag(covariance)[:n])
    scale = np.where(size > 0.0, size / COMPENSATOR_SIGMA, 1.0)
    return replace(
        compensator,
        a=compensator.a * scale[None, :] / scale[:, None],
        b=compensator.b / scale[:, None],
        e=compensator.e / scale[:, None],
        c=compensator.c * scale[None, :],
    )
