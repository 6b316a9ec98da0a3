"""Delay-aware roll-rate feedback: on the car, or by the corrected theorem of Redondo 2021."""

from math import exp, log, pi, sqrt

import numpy as np
from scipy.optimize import minimize

from canroll.errors import VerdictError
from gain_gen.analysis.certificates import delay_blocks, largest_eigenvalue
from gain_gen.laws.declared import law
from gain_gen.laws.lmi import Clock, delay_point
from gain_gen.laws.rate_gain_law import design_rate_gain
from gain_gen.laws.roll_rate_feedback import (
    LEVEL_MARGIN,
    USELESS,
    exact_optimum,
    normalised_plant,
    open_loop_gamma,
    static_solution,
)
from gain_gen.models.roll import normalise
from gain_gen.models.task import Solution, Task, below

PRINTED_DELAY_GAIN = -84.06 * 180.0 / pi
"""Redondo 2021, (60), read as N·m per deg/s: −4816 N·m·s/rad, the only plausible unit."""


@law(gains=("computed", "theorem", "as_printed"), feedforward="none", level=True)
def design_hinf_delay(task: Task) -> Solution:
    """Delay-aware roll-rate feedback in the structure of Redondo 2021.

    Computed gains are the min–max over the family of linear cars, certified for a varying delay;
    ``theorem`` ones come from the paper's theorem on its 1-DOF model.
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
    return design_by_theorem(task)


def design_by_theorem(task: Task) -> Solution:
    """Return the gain of the corrected theorem of Redondo 2021, at the longest delay.

    The structure W = K C1 X is exact; ρ and ε are scanned. The exact optimum of the gain, which
    needs no inequality, is reported as well.

    Raises:
        VerdictError: the theorem certifies no useful gain.
    """
    model, delay = task.vehicle.design, task.delay.most
    plant, clock = normalise(model), Clock()
    certified_plant = normalised_plant(plant)
    open_loop = open_loop_gamma(model)

    def level(point: np.ndarray, seconds: float) -> float:
        rho, epsilon = (exp(float(value)) for value in point)
        solution = delay_point(certified_plant, rho, epsilon, plant.delay(seconds), clock)
        return solution.gamma_squared if solution is not None else 10.0 * open_loop**2

    def scan(seconds: float) -> tuple[np.ndarray, float]:
        """Least certified γ² over ρ and ε."""
        start = min(
            (
                np.array([log(rho), log(epsilon)])
                for rho in (0.4, 0.9)
                for epsilon in (0.4, 0.8, 1.3)
            ),
            key=lambda point: level(point, seconds),
        )
        minimum = minimize(
            level,
            start,
            args=(seconds,),
            method="Nelder-Mead",
            options={"xatol": 5e-3, "fatol": 1e-4, "maxfev": 60},
        )
        return minimum.x, float(minimum.fun)

    target = task.gamma_target if task.gamma_target else USELESS * open_loop
    seconds = max(delay, 1e-3)
    best, bound_squared = scan(seconds)
    if sqrt(bound_squared) > target:
        raise VerdictError(_infeasible(task, target, sqrt(bound_squared), open_loop, scan))
    rho, epsilon = exp(float(best[0])), exp(float(best[1]))
    certified = delay_point(certified_plant, rho, epsilon, plant.delay(seconds), clock)
    assert certified is not None
    level_squared = certified.gamma_squared * (1.0 + LEVEL_MARGIN)
    first, second = delay_blocks(
        certified_plant,
        w=certified.gain * certified_plant.c1 @ certified.x,
        x=certified.x,
        y=certified.y,
        q=certified.q,
        gamma_squared=level_squared,
        delay=plant.delay(seconds),
        epsilon=epsilon,
    )
    gain = plant.rate_gain(certified.gain)
    optimum = exact_optimum(model, seconds, guess=gain)
    return static_solution(
        task,
        gain,
        delay=seconds,
        gamma_bound=sqrt(level_squared),
        checks={
            "lmi_theorem": below(largest_eigenvalue(first), 0.0),
            "lmi_structure": below(largest_eigenvalue(second), 0.0),
            "lmi_x": below(-float(np.linalg.eigvalsh(certified.x)[0]), 0.0),
        },
        delay_aware=True,
        solve_seconds=clock.seconds,
        extra={
            "rho": rho,
            "epsilon": epsilon,
            "exact_best_gain": optimum.gain,
            "exact_best_gamma": optimum.gamma,
            "open_loop_gamma": open_loop,
            "theorem_delay_s": seconds,
            "solves": float(clock.solves),
        },
    )


def _infeasible(task: Task, target: float, reached: float, open_loop: float, scan: object) -> str:
    """Return the error that names the delay and the largest feasible one."""
    assert callable(scan)
    lower, upper = 0.0, max(task.delay.most, 1e-3)
    for _ in range(7):
        middle = 0.5 * (lower + upper)
        if sqrt(scan(middle)[1]) <= target:
            lower = middle
        else:
            upper = middle
    if task.gamma_target:
        wish = f"γ ≤ {target:.4g}"
    else:
        wish = f"a γ below {target:.4g} (the open loop's is {open_loop:.4g})"
    near = (
        f"feasible up to a delay of {1e3 * lower:.0f} ms"
        if lower > 0.0
        else "infeasible at every delay"
    )
    return (
        f"hinf_delay for {task.vehicle.name}: {wish} is infeasible at a delay of "
        f"{1e3 * task.delay.most:.0f} ms, where the least certified is {reached:.4g}; it is {near}"
    )
