"""The static roll-rate gain by the inequality of a delay that varies, on the 1-DOF model.

Viadero 2022 leaves it unprinted. Without a trigger, ε = 0, it certifies 5 to 6 % less than the
corrected theorem of Redondo 2021, (44)–(45), which implies it, and has no ρ and ε to scan.
"""

from math import exp, log, sqrt
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from canroll.errors import VerdictError
from canroll.gain_gen.analysis.certificates import (
    event_block,
    event_small_gain,
    largest_eigenvalue,
    si_plant,
)
from canroll.gain_gen.laws.lmi import Clock, event_point
from canroll.gain_gen.laws.roll_rate_feedback import (
    LEVEL_MARGIN,
    USELESS,
    normalised_plant,
    open_loop_gamma,
    static_solution,
)
from canroll.gain_gen.models.roll import ROLL_RATE, normalise
from canroll.gain_gen.models.task import Check, Solution, Task, below

SHORTEST = 1e-3
"""Least delay of the inequality, s."""
GAINS = np.linspace(log(0.01), log(8.0), 15)
"""Logarithms of the normalised gains that are tried first."""
WITHHELD = 3
"""Row of the inequality's block of what a trigger withholds."""
HALVINGS = 7
"""Steps to the largest feasible delay."""


def design_by_inequality(law: str, task: Task, *, epsilon_squared: float = 0.0) -> Solution:
    """Return the gain of the least level that the inequality certifies at the longest delay.

    Args:
        law: its name, for errors.
        task: task of the design.
        epsilon_squared: squared relative threshold of an event trigger.

    Raises:
        VerdictError: no useful gain is certified.
    """
    model, delay = task.vehicle.design, max(task.delay.most, SHORTEST)
    plant, clock = normalise(model), Clock()
    certified_plant, open_loop = normalised_plant(plant), open_loop_gamma(model)

    def scan(seconds: float) -> tuple[float, float]:
        """Return the normalised gain of the least certified γ, and that."""

        def level(log_gain: float) -> float:
            gain, normalised_delay = -exp(log_gain), plant.delay(seconds)
            point = event_point(certified_plant, gain, normalised_delay, epsilon_squared, clock)
            return point.gamma_squared if point is not None else 10.0 * open_loop**2

        near = int(np.argmin([level(float(point)) for point in GAINS]))
        bounds = GAINS[max(near - 1, 0)], GAINS[min(near + 1, len(GAINS) - 1)]
        best = minimize_scalar(level, bounds=bounds, method="bounded", options={"xatol": 2e-3})
        return -exp(float(best.x)), sqrt(best.fun)

    target = task.gamma_target or USELESS * open_loop
    gain, reached = scan(delay)
    if reached > target:
        lower, upper = 0.0, delay
        for _ in range(HALVINGS):
            middle = 0.5 * (lower + upper)
            lower, upper = (middle, upper) if scan(middle)[1] <= target else (lower, middle)
        raise VerdictError(_infeasible(law, task, target, reached, open_loop, lower))
    loop: dict[str, Any] = {"gain": gain, "delay": plant.delay(delay)}
    loop["epsilon_squared"] = epsilon_squared
    point = event_point(certified_plant, **loop, clock=clock)
    assert point is not None
    certified = point._replace(gamma_squared=point.gamma_squared * (1.0 + LEVEL_MARGIN))
    block = event_block(certified_plant, **certified._asdict(), **loop)
    if not epsilon_squared:  # nothing is withheld, at whatever large weight
        block = np.delete(np.delete(block, WITHHELD, 0), WITHHELD, 1)
    checks: dict[str, Check] = {
        "lmi_theorem": below(largest_eigenvalue(block), 0.0),
        "lmi_p": below(-float(np.linalg.eigvalsh(point.p)[0]), 0.0),
    }
    extra = {"theorem_delay_s": delay, "solves": float(clock.solves)}
    physical = plant.rate_gain(gain)
    if epsilon_squared:
        peak = event_small_gain(si_plant(model, ROLL_RATE), gain=physical, delay=delay)
        checks["event_small_gain"] = below(sqrt(epsilon_squared) * peak, 1.0)
        extra["epsilon_squared"] = epsilon_squared
    return static_solution(
        task,
        physical,
        delay=delay,
        gamma_bound=sqrt(certified.gamma_squared),
        checks=checks,
        delay_aware=True,
        solve_seconds=clock.seconds,
        extra=extra,
    )


def _infeasible(  # noqa: PLR0917
    law: str, task: Task, target: float, reached: float, open_loop: float, feasible: float
) -> str:
    """Return the error that names the delay and the largest feasible one, s; zero: none."""
    if task.gamma_target:
        wish = f"γ ≤ {target:.4g}"
    else:
        wish = f"a γ below {target:.4g} (the open loop's is {open_loop:.4g})"
    near = (
        f"feasible up to a delay of {1e3 * feasible:.0f} ms"
        if feasible > 0.0
        else "infeasible at every delay"
    )
    return (
        f"{law} for {task.vehicle.name}: {wish} is infeasible at a delay of "
        f"{1e3 * task.delay.most:.0f} ms, where the least certified is {reached:.4g}; it is {near}"
    )
