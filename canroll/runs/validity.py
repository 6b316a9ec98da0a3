"""Validity of a run in real time; an invalid run has no verdict."""

from collections.abc import Sequence
from dataclasses import dataclass

MISSED = 0.01
"""Share of the ticks that may be missed."""
PLANT_LATE = 0.01
"""Share of the plant's steps that may start later than a tick of the ECU."""
HELD_UP = 0.050
"""Longest time that the plant may stand still, s: a third of the actuators' command timeout."""
FRAMES_LOST = 0.001
"""Share of the frames that may be lost."""
LATENCIES = 0.9
"""Share of the applied commands of which the latency must be known."""
TICKS_LATER = 1.0
"""By so many ticks the 99th percentile of the latency may exceed the bound of the modelled bus."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunTiming:
    """Timing of a run on which its validity depends; times in s.

    Attributes:
        due: number of ticks of the manoeuvre.
        ticks: number of ticks run.
        tick: period of the ECU.
        plant_late: lateness of every step of the plant; empty in lock step.
        frames: frames sent.
        lost: frames not received by the other side.
        planned: length of the manoeuvre, or of the requested part.
        driven: length driven.
        rolled_over: whether the vehicle rolled over, which ends a manoeuvre early.
        commands: commands applied by the actuators.
        latencies: number of commands with a known latency.
        latency_p99: its 99th percentile, None without any.
        latency_bound: longest latency possible on the modelled bus.
        compilations: functions compiled after the start.
    """

    due: int
    ticks: int
    tick: float
    plant_late: Sequence[float]
    frames: int
    lost: int
    planned: float
    driven: float
    rolled_over: bool
    commands: int
    latencies: int
    latency_p99: float | None
    latency_bound: float
    compilations: int


def reasons(run: RunTiming) -> list[str]:
    """Return the reasons why a run is not valid, each with figure and bound; empty if valid."""
    texts = []
    if run.driven < run.planned - run.tick and not run.rolled_over:
        texts.append(f"the run ended after {run.driven:.2f} s of {run.planned:.2f} s")
    if run.ticks < (1 - MISSED) * run.due:
        texts.append(f"{run.ticks} of {run.due} ticks were run (at least {100 * (1 - MISSED):g} %)")
    late = sum(lateness > run.tick for lateness in run.plant_late)
    if late > PLANT_LATE * len(run.plant_late):
        texts.append(
            f"{late} of {len(run.plant_late)} plant steps were over a tick late "
            f"(at most {100 * PLANT_LATE:g} %)"
        )
    worst = max(run.plant_late, default=0.0)
    if worst > HELD_UP:
        texts.append(
            f"the plant stood still for {1e3 * worst:.0f} ms (at most {1e3 * HELD_UP:g} ms)"
        )
    if run.lost > FRAMES_LOST * run.frames:
        texts.append(
            f"{run.lost} of {run.frames} frames were lost (at most {100 * FRAMES_LOST:g} %)"
        )
    if run.latencies < max(1, LATENCIES * run.commands):
        texts.append(
            f"the latency of {run.latencies} of {run.commands} commands is known "
            f"(at least {100 * LATENCIES:g} %)"
        )
    allowed = run.latency_bound + TICKS_LATER * run.tick
    if run.latency_p99 is not None and run.latency_p99 > allowed:
        texts.append(
            f"latency of {1e3 * run.latency_p99:.1f} ms (99th percentile; at most "
            f"{1e3 * allowed:.1f} ms: the modelled bus and a tick)"
        )
    if run.compilations:
        texts.append(f"{run.compilations} functions were compiled during the run")
    return texts
