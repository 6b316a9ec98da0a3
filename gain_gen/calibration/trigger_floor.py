"""How much of the command is sensor noise: what the event trigger has to stay above."""

import numpy as np

from gain_gen.models.controller import matrices
from gain_gen.models.roll import stationary_covariance
from gain_gen.models.task import Design


def command_noise(design: Design) -> float:
    """Return the standard deviation of the command that sensor noise alone causes, N·m.

    White noise of the sensors' standard deviations through the controller with the loop open:
    feedback reduces it, so this is from above wherever the closed loop does not amplify.
    """
    noise = design.task.noise
    a, b, c, d = matrices(design.controller)
    inputs = np.diag([noise.roll_rate**2, noise.lateral**2, 0.0, 0.0])
    direct = d @ inputs @ d.T
    if not len(a):
        return float(np.sqrt(direct[0, 0]))
    if np.abs(np.linalg.eigvals(a)).max() >= 1.0:
        # a marginal mode of a one-sensor filter carries no noise to the command in a few seconds
        covariance = np.zeros_like(a)
        for _ in range(500):
            covariance = a @ covariance @ a.T + b @ inputs @ b.T
    else:
        covariance = stationary_covariance(a, b @ inputs @ b.T)
    return float(np.sqrt(max((c @ covariance @ c.T + direct)[0, 0], 0.0)))
