"""The papers' own loop: the 1-DOF roll model under sampled, delayed feedback, and nothing else."""

import numpy as np

from gain_gen.models.roll import Matrix, lateral_input, moment_input, state_matrix, zero_order_hold
from hil.runs.metrics import Vector
from vehicles import RollModel

STEP = 0.001


def motion(
    model: RollModel,
    feedback: Matrix | None,
    lateral: Vector,
    *,
    sampling: float = STEP,
    delay: float = 0.0,
) -> Vector:
    """Return [φ, φ'] each millisecond, (n, 2), under u = K [φ, φ'].

    Args:
        model: design model.
        feedback: K, (1, 2); None: without control.
        lateral: lateral acceleration each millisecond, m/s².
        sampling: period of the measurement, s.
        delay: from the sample to the moment, s.
    """
    inputs = np.hstack([lateral_input(model), moment_input(model)])
    a, b = zero_order_hold(state_matrix(model), inputs, STEP)
    every, late = round(sampling / STEP), round(delay / STEP)
    states = np.zeros((len(lateral), 2))
    state, arrived, queue = np.zeros(2), 0.0, [0.0] * late
    asked = 0.0
    for k, acceleration in enumerate(lateral):
        states[k] = state
        if feedback is not None:
            if k % every == 0:
                asked = float((feedback @ state)[0])
            queue.append(asked)
            arrived = queue.pop(0)
        state = a @ state + b @ np.array([acceleration, arrived])
        # an unstable reading is shown as one, not as an overflow
        state = np.clip(state, -1e3, 1e3)
    return states
