"""Delay-aware roll-rate feedback in the structure of Redondo 2021."""

from dataclasses import replace
from math import pi, sqrt

from canroll.gain_gen.laws.declared import law
from canroll.gain_gen.laws.rate_gain_law import design_rate_gain
from canroll.gain_gen.laws.rate_inequality import design_by_inequality
from canroll.gain_gen.laws.roll_rate_feedback import exact_optimum, open_loop_gamma, static_solution
from canroll.gain_gen.models.task import Solution, Task

PRINTED_DELAY_GAIN = -84.06 * 180.0 / pi
"""Redondo 2021, (60), read as N·m per deg/s: −4816 N·m·s/rad, the only plausible unit."""


@law(gains=("computed", "theorem", "as_printed"), feedforward="none", level=True)
def design_hinf_delay(task: Task) -> Solution:
    """Delay-aware roll-rate feedback in the structure of Redondo 2021.

    Computed gains are the min–max over the family of linear cars, certified for a varying delay;
    ``theorem`` ones come from an inequality that the paper's theorem implies, on its 1-DOF model,
    with the exact optimum of the gain, which needs no inequality, in ``extra``.
    """
    if task.gains == "computed":
        return design_rate_gain("hinf_delay", task)
    delay = task.delay.most
    if task.gains == "as_printed":
        return static_solution(
            task,
            PRINTED_DELAY_GAIN,
            delay=delay,
            gamma_bound=sqrt(0.09932),
            checks={},
            delay_aware=True,
            notes=(
                "hinf_delay: printed −84.06, read per deg/s; the printed γ² = 0.09932 is below "
                "what any roll-rate gain can reach, as the DC gain does not depend on it",
            ),
        )
    solution, model = design_by_inequality("hinf_delay", task), task.vehicle.design
    assert solution.controller.output_gain is not None
    guess = float(solution.controller.output_gain[0])
    optimum = exact_optimum(model, solution.extra["theorem_delay_s"], guess=guess)
    exact = {
        "exact_best_gain": optimum.gain,
        "exact_best_gamma": optimum.gamma,
        "open_loop_gamma": open_loop_gamma(model),
    }
    return replace(solution, extra=exact | dict(solution.extra))
