"""Roll-rate feedback on the linear car: the min–max gain with its certificates."""

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING

from canroll.errors import VerdictError
from canroll.gain_gen.analysis.family import Family, Member, family_of
from canroll.gain_gen.analysis.level_certificate import (
    LEVEL_UNIT,
    SwitchedLoop,
    bound_over_delays,
    delay_grid,
    switched_loop,
)
from canroll.gain_gen.laws.rate_gain import RateGain, best_rate_gain, free_peak
from canroll.gain_gen.laws.roll_rate_feedback import static_controller
from canroll.gain_gen.models.task import Check, Solution, Task, below

if TYPE_CHECKING:
    from canroll.gain_gen.laws.lmi import Clock, LevelPoint

USELESS = 0.98
"""Worst-case peak, relative to the open loop's, above which a gain counts as useless."""
STEPS = (4e-3, 2e-3)
"""Steps of the delays given to the solver, s: finer ones if the coarser do not suffice."""
FINEST = 5e-6
"""Least step of the delays at which a certificate is evaluated, s."""
LEAST_SHARE = 0.2
"""Least ratio of one such step to the one before: a coarse step overrates the curvature."""
LEVEL_MARGIN = 1e-4
"""Share by which a certified level is raised, so that the certificate holds strictly."""


@dataclass(frozen=True, slots=True)
class Certified:
    """A certified level and the check of its certificate.

    Attributes:
        ratio: certified mean-square gain from roll moment to roll angle for any varying delay,
            relative to the largest without control.
        check: bound of the inequality's largest eigenvalue over all delays.
    """

    ratio: float
    check: Check


def design_rate_gain(law: str, task: Task, *, epsilon: float = 0.0) -> Solution:
    """Return the roll-rate gain of least worst-case roll over the family and the delays.

    Args:
        law: its name, for errors.
        task: task of the design.
        epsilon: relative threshold of an event trigger, whose error is in the certificate.

    Raises:
        VerdictError: no gain reduces roll.
    """
    family = family_of(task)
    best = best_rate_gain(family)
    if best.peak_ratio > USELESS:
        raise VerdictError(_no_gain(law, task, best))
    extra = {
        "peak_ratio": best.peak_ratio,
        "least_peak_ratio": best.least,
        "largest_gain_with_margins": best.largest,
    }
    checks = {"peak_ratio": below(best.peak_ratio, 1.0, best.where)}
    notes: tuple[str, ...] = ()
    level, clock = _certified(family, family.members[0], best.gain, epsilon)
    if level is None:
        notes = (f"{law}: no level is certified for a delay that changes, only stability",)
    else:
        extra["certified_peak_ratio"] = level.ratio
        checks["lmi_level"] = level.check
    if epsilon:
        extra["epsilon_squared"] = epsilon**2
        peak = family.margins(static_controller(task, best.gain)).worst_sensitivity
        checks["event_small_gain"] = below(epsilon * peak.margins.sensitivity, 1.0, str(peak))
    return Solution(
        static_controller(task, best.gain),
        checks=checks,
        delay_aware=True,
        solve_seconds=clock.seconds,
        notes=notes,
        extra=extra | {"solves": float(clock.solves)},
    )


def _certified(
    family: Family, member: Member, gain: float, epsilon: float
) -> tuple[Certified | None, "Clock"]:
    """Return the level that one Lyapunov matrix certifies for any sequence of delays, or None.

    Also return the time in solvers.
    """
    from canroll.gain_gen.laws.lmi import Clock, certify_level  # noqa: PLC0415 - cvxpy only where used

    def loop_at(step: float) -> SwitchedLoop:
        grid = delay_grid(member, family.delays, family.tick, step)
        return switched_loop(member, gain, grid, family.tick)

    clock = Clock()
    for step in STEPS:
        point = certify_level(loop_at(step), epsilon, clock)
        if point is None:
            return None, clock
        level_squared = point.level_squared * (1.0 + LEVEL_MARGIN)
        bound = _bound(loop_at, step, point, level_squared, epsilon)
        if bound < 0.0:
            free = free_peak(member) / LEVEL_UNIT
            check = below(bound, 0.0, str(member.condition))
            return Certified(sqrt(level_squared) / free, check), clock
    return None, clock


def _bound(
    loop_at: Callable[[float], SwitchedLoop],
    step: float,
    point: "LevelPoint",
    level_squared: float,
    epsilon: float,
) -> float:
    """Return a bound of the inequality over all delays, on a grid fine enough for its sign.

    What the bound adds to the largest value at the delays goes with the square of their step.
    """
    while True:
        value, bound = bound_over_delays(
            loop_at(step),
            p=point.p,
            level_squared=level_squared,
            weight=point.weight,
            epsilon=epsilon,
        )
        if bound < 0.0 or value >= 0.0 or step <= FINEST:
            return bound
        share = 0.9 * sqrt(value / (value - bound))
        step = max(min(max(share, LEAST_SHARE), 0.5) * step, FINEST)


def _no_gain(law: str, task: Task, best: RateGain) -> str:
    """Return the error that no gain reduces roll, and why."""
    delay = task.delay
    why = (
        "the delay makes the feedback destabilising"
        if best.resonant
        else "the peak there is the steady-state roll, which rate feedback cannot reduce"
    )
    return (
        f"{law} for {task.vehicle.name}: no roll-rate gain helps at delays of "
        f"{1e3 * delay.least:.0f} to {1e3 * delay.most:.0f} ms: the best leaves "
        f"{100.0 * best.peak_ratio:.1f} % of the peak roll in the worst case ({best.where}), "
        f"because {why}; choose a law with the lateral acceleration, or --gains theorem "
        "--unverified"
    )
