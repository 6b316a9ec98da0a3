"""Event-triggered H∞ roll-rate feedback in the structure of Viadero 2022."""

from math import sqrt

from canroll.gain_gen.analysis.certificates import event_small_gain, si_plant
from canroll.gain_gen.laws.declared import law
from canroll.gain_gen.laws.rate_gain_law import design_rate_gain
from canroll.gain_gen.laws.rate_inequality import SHORTEST, design_by_inequality
from canroll.gain_gen.laws.roll_rate_feedback import static_solution
from canroll.gain_gen.models.roll import ROLL_RATE
from canroll.gain_gen.models.task import EPSILON_SQUARED, Solution, Task, below

PRINTED_EVENT_GAIN = -13552.53
"""Viadero 2022, section III."""


@law(gains=("computed", "theorem", "as_printed"), feedforward="none")
def design_hinf_event(task: Task) -> Solution:
    """Event-triggered roll-rate feedback in the structure of Viadero 2022.

    Computed gains are the min–max over the family of linear cars; the error of the trigger is
    bounded in their certificate. ``theorem`` ones scan the gain in the paper's inequality on
    its 1-DOF model with S = 0, which holds for a varying delay. The relative threshold is the
    paper's; the floor comes from the sensor noise when the calibration is written.
    """
    if task.gains == "computed":
        return design_rate_gain("hinf_event", task, epsilon=sqrt(EPSILON_SQUARED))
    if task.gains == "theorem":
        return design_by_inequality("hinf_event", task, epsilon_squared=EPSILON_SQUARED)
    delay = max(task.delay.most, SHORTEST)
    physical = si_plant(task.vehicle.design, ROLL_RATE)
    peak = event_small_gain(physical, gain=PRINTED_EVENT_GAIN, delay=delay)
    return static_solution(
        task,
        PRINTED_EVENT_GAIN,
        delay=delay,
        gamma_bound=sqrt(16.96),
        checks={"event_small_gain": below(sqrt(EPSILON_SQUARED) * peak, 1.0)},
        delay_aware=True,
    )
