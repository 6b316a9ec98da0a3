"""A law at a given effort: its moment is scaled until its RMS over the runs meets a budget."""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from math import degrees

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.gain_gen.calibration.record import identify
from canroll.runs.experiment import drive, limit_cycle_of
from canroll.runs.metrics import judge, rms
from canroll.runs.result import Run
from canroll.setup.choices import PASSIVE
from canroll.setup.controller import Controller
from canroll.studies.bound import EffortBound, bound_of

FIGURES = (
    "roll_rms_deg",
    "roll_max_deg",
    "moment_rms_nm",
    "moment_max_nm",
    "path_error_max_m",
    "nlt_front_max",
    "nlt_rear_max",
    "steer_rms_deg",
)
"""Figures of :class:`canroll.runs.metrics.Metrics`, and the RMS steering angle at the road wheels:
what a car that understeers more takes more of on the same path."""
MOMENT_RMS = FIGURES.index("moment_rms_nm")
BUDGET_TOLERANCE = 0.005
"""Relative accuracy to which a law is scaled to the budget."""
LARGEST_FACTOR = 3.99
STEPS_MAX = 40
NARROWEST = 1e-4
"""Width of a bracket, relative to its upper end, below which the effort counts as jumping."""
MARGIN = 0.1
"""Least distance of the next trial from the ends of a bracket, relative to its width."""
CHANCE = 10
"""One in this many runs may oscillate by chance, as noise occasionally does without feedback."""
BACKED_OFF = tuple(step / 10 for step in range(10, 0, -1))


@dataclass(frozen=True, slots=True)
class Passive:
    """One run without control.

    Attributes:
        time: s.
        roll: angle, rad.
        bound: lower bound of roll for a moment of given effort.
    """

    time: NDArray[np.float64]
    roll: NDArray[np.float64]
    bound: EffortBound


@dataclass(frozen=True, slots=True)
class EffortRun:
    """Results of a law over several runs: figures (runs, 8), and number of limit cycles.

    ``factor``: factor on the law's moment.
    """

    factor: float
    figures: NDArray[np.float64]
    cycles: int

    @property
    def effort(self) -> float:
        """Mean RMS moment, N·m."""
        return float(np.mean(self.figures[:, MOMENT_RMS]))

    @property
    def oscillates(self) -> bool:
        """Whether there were more limit cycles than expected by chance."""
        return self.cycles > max(1, len(self.figures) // CHANCE)


class BudgetError(CanrollError):
    """A law cannot be scaled to the budget; ``nearest`` has its results at the closest factor."""

    def __init__(self, message: str, nearest: EffortRun) -> None:
        super().__init__(message)
        self.nearest = nearest


def scaled(controller: Controller, factor: float) -> Controller:
    """Return the controller with its moment multiplied, at every speed of the schedule."""
    record = copy(controller.record)
    record.schedule_gain = [round(factor * gain) for gain in record.schedule_gain]
    return replace(controller, record=identify(record))


def without_control(population: Sequence[Run], controller: Controller) -> list[Passive]:
    """Return each run of ``population`` without control."""
    passive = []
    for settings in population:
        signals = drive(settings, controller, enabled=False).signals
        time, roll = signals["time"], signals["roll"]
        passive.append(Passive(time, roll, bound_of(settings, controller, time, roll)))
    return passive


def driven(
    population: Sequence[Run],
    controller: Controller,
    passive: Sequence[Passive],
    *,
    factor: float = 1.0,
) -> EffortRun:
    """Drive the runs of ``population`` with the law's moment times ``factor``.

    ``passive``: the same runs without control.
    """
    if factor != 1.0:
        controller = scaled(controller, factor)
    figures, cycles = [], 0
    for settings, without in zip(population, passive, strict=True):
        trace = drive(settings, controller, enabled=settings.law != PASSIVE)
        metrics = judge(trace)
        steer = degrees(rms(trace.signals["steer"]))
        figures.append([*(getattr(metrics, name) for name in FIGURES[:-1]), steer])
        if settings.law != PASSIVE:
            roll = {"time": without.time, "roll": without.roll}
            cycles += limit_cycle_of(settings, controller, trace, roll) is not None
    return EffortRun(factor, np.array(figures), cycles)


def at_budget(drive_at: Callable[[float], EffortRun], budget: float) -> EffortRun:
    """Return the results of a law at the factor for which its effort equals ``budget``, N·m.

    Found by false position between a factor below and one above, away from both ends.

    Raises:
        BudgetError: no factor meets it.
    """
    low, high = EffortRun(0.0, np.zeros((1, len(FIGURES))), 0), None
    factor = 1.0
    for _ in range(STEPS_MAX):
        driven = drive_at(factor)
        if abs(driven.effort / budget - 1.0) <= BUDGET_TOLERANCE:
            return driven
        if driven.effort > budget:
            high = driven
        elif factor == LARGEST_FACTOR:
            raise BudgetError(
                f"does not reach the RMS moment: {driven.effort:.0f} N·m at {factor:g} times its "
                "gain",
                driven,
            )
        else:
            low = driven
        if high is None:
            factor = min(LARGEST_FACTOR, factor * max(1.1, 1.02 * budget / max(driven.effort, 1.0)))
            continue
        width = high.factor - low.factor
        if width < NARROWEST * high.factor:
            break
        share = (budget - low.effort) / (high.effort - low.effort)
        factor = low.factor + width * min(max(share, MARGIN), 1.0 - MARGIN)
    assert high is not None
    raise BudgetError(
        f"misses the RMS moment: it jumps from {low.effort:.0f} to {high.effort:.0f} N·m at "
        f"{high.factor:.2f} times its gain",
        low,
    )


def at_rest(drive_at: Callable[[float], EffortRun]) -> EffortRun:
    """Return the results of a law at the largest gain factor without limit cycle, in tenths.

    Raises:
        CanrollError: a limit cycle remains at one tenth.
    """
    for factor in BACKED_OFF:
        driven = drive_at(factor)
        if not driven.oscillates:
            return driven
    raise CanrollError(f"in a limit cycle even at {BACKED_OFF[-1]:g} times its gain")
