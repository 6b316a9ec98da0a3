"""Discrete H∞ state feedback of the 2020 paper, by its LMI, checked by frequency response."""

from math import pi

import numpy as np

from canroll.errors import VerdictError
from canroll.gain_gen.laws.lmi import Clock, discrete_h_infinity
from canroll.gain_gen.laws.state_feedback import PRINTED, printed_note, state_feedback
from canroll.gain_gen.laws.state_gains import discrete_plant, yim_weights
from canroll.gain_gen.models.state_space import StateSpace, peak
from canroll.gain_gen.models.task import Solution, Task, below


def discrete_level(system: StateSpace) -> float:
    """Return the largest singular value of the response on a refined frequency grid."""
    return peak(system.gains, np.r_[0.0, np.geomspace(1e-3, pi / system.tick, 2000)])


def design_state_hinf(task: Task) -> Solution:
    """Discrete H∞ state feedback (Yim 2020, (12)–(13)), u = −K x with the stabilising sign.

    Scaled by 1 deg, 10 deg/s and the moment's weight: unscaled the solver fails or returns gains
    of the wrong sign.
    """
    if task.gains == "as_printed":
        return Solution(
            state_feedback(task, np.array(PRINTED["hinf"])), notes=(printed_note("hinf"),)
        )
    model, clock = task.vehicle.design, Clock()
    phi, gamma, lateral = discrete_plant(model, task.tick)
    weights = yim_weights(model)
    scale = np.array([weights.roll, weights.roll_rate])
    scaled_phi = phi * scale[None, :] / scale[:, None]
    scaled_gamma = gamma * weights.moment / scale[:, None]
    scaled_lateral = lateral / scale[:, None]
    c = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    d = np.array([[0.0], [0.0], [1.0]])
    solution = discrete_h_infinity(scaled_phi, scaled_gamma, scaled_lateral, c=c, d=d, clock=clock)
    if solution is None:
        raise VerdictError(
            f"hinf for {task.vehicle.name}: the solver found no gain; check the weights"
        )
    scaled_gain = -solution.y @ np.linalg.inv(solution.p)
    closed, shown = scaled_phi - scaled_gamma @ scaled_gain, c - d @ scaled_gain
    level = discrete_level(StateSpace(closed, scaled_lateral, shown, np.zeros((3, 1)), task.tick))
    gain = scaled_gain * weights.moment / scale
    return Solution(
        state_feedback(task, gain),
        gamma=level,
        gamma_bound=solution.chi * (1.0 + 1e-4),
        gamma_channel="a_y in m/s² to [roll, roll rate, moment] over their weights, roll model",
        checks={
            "hinf_level": below(level, solution.chi * (1.0 + 1e-4)),
            "lmi_p": below(-float(np.linalg.eigvalsh(solution.p)[0]), 0.0),
        },
        solve_seconds=clock.seconds,
        extra={"moment_weight": weights.moment, "solves": float(clock.solves)},
    )
