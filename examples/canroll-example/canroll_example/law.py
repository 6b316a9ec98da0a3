"""A control law: from a task to a controller."""

import numpy as np

from canroll.gain_gen.laws.state_feedback import actuator_rate, feedforward_row, observer_of
from canroll.gain_gen.models.controller import LinearController
from canroll.gain_gen.models.task import Solution, Task

DAMPING_RATIO = 0.7


def skyhook(task: Task) -> Solution:
    """Roll damping up to a damping ratio of 0.7, a third of the lateral force met at once."""
    roll = task.vehicle.design
    wanted = 2 * DAMPING_RATIO * np.sqrt(roll.effective_stiffness * roll.roll_inertia)
    return Solution(
        LinearController(
            tick=task.tick,
            observer=observer_of(task),
            feedback=np.array([0.0, max(wanted - roll.roll_damping, 0.0), 0.0, 0.0, 0.0]),
            feedforward=feedforward_row(task, roll.roll_arm / 3),
            actuator_rate=actuator_rate(task),
        )
    )
