"""Event-triggered H∞ roll-rate feedback, by the inequality that Viadero 2022 leaves unprinted."""

from math import exp, log, sqrt

import numpy as np
from scipy.optimize import minimize_scalar

from canroll.errors import VerdictError
from gain_gen.analysis.certificates import (
    event_block,
    event_small_gain,
    largest_eigenvalue,
    si_plant,
)
from gain_gen.laws.declared import law
from gain_gen.laws.lmi import Clock, EventPoint, event_point
from gain_gen.laws.rate_gain_law import design_rate_gain
from gain_gen.laws.roll_rate_feedback import (
    LEVEL_MARGIN,
    USELESS,
    normalised_plant,
    open_loop_gamma,
    static_solution,
)
from gain_gen.models.roll import ROLL_RATE, normalise
from gain_gen.models.task import EPSILON_SQUARED, Solution, Task, below

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
    model = task.vehicle.design
    delay = max(task.delay.most, 1e-3)
    physical = si_plant(model, ROLL_RATE)
    if task.gains == "as_printed":
        return static_solution(
            task,
            PRINTED_EVENT_GAIN,
            delay=delay,
            gamma_bound=sqrt(16.96),
            checks={
                "event_small_gain": below(
                    sqrt(EPSILON_SQUARED)
                    * event_small_gain(physical, gain=PRINTED_EVENT_GAIN, delay=delay),
                    1.0,
                )
            },
            delay_aware=True,
        )
    plant, clock = normalise(model), Clock()
    certified_plant = normalised_plant(plant)

    def best_at(gain: float) -> EventPoint | None:
        return event_point(certified_plant, gain, plant.delay(delay), EPSILON_SQUARED, clock)

    def level(log_gain: float) -> float:
        solution = best_at(-exp(log_gain))
        return solution.gamma_squared if solution is not None else 1e6

    coarse = np.linspace(log(0.01), log(8.0), 15)
    values = [level(float(point)) for point in coarse]
    near = int(np.argmin(values))
    scanned = minimize_scalar(
        level,
        bounds=(coarse[max(near - 1, 0)], coarse[min(near + 1, len(coarse) - 1)]),
        method="bounded",
        options={"xatol": 2e-3},
    )
    normalised_gain = -exp(float(scanned.x))
    best = best_at(normalised_gain)
    open_loop = open_loop_gamma(model)
    if best is None or sqrt(best.gamma_squared) > USELESS * open_loop:
        raise VerdictError(
            f"hinf_event for {task.vehicle.name}: no event-triggered roll-rate gain is certified "
            f"better than the open loop at {1e3 * delay:.0f} ms; reduce the delay"
        )
    level_squared = best.gamma_squared * (1.0 + LEVEL_MARGIN)
    block = event_block(
        certified_plant,
        gain=normalised_gain,
        p=best.p,
        r=best.r,
        s=best.s,
        omega=best.omega,
        gamma_squared=level_squared,
        delay=plant.delay(delay),
        epsilon_squared=EPSILON_SQUARED,
    )
    gain = plant.rate_gain(normalised_gain)
    return static_solution(
        task,
        gain,
        delay=delay,
        gamma_bound=sqrt(level_squared),
        checks={
            "lmi_event": below(largest_eigenvalue(block), 0.0),
            "lmi_p": below(-float(np.linalg.eigvalsh(best.p)[0]), 0.0),
            "event_small_gain": below(
                sqrt(EPSILON_SQUARED) * event_small_gain(physical, gain=gain, delay=delay), 1.0
            ),
        },
        delay_aware=True,
        solve_seconds=clock.seconds,
        extra={
            "epsilon_squared": EPSILON_SQUARED,
            "theorem_delay_s": delay,
            "solves": float(clock.solves),
        },
    )
