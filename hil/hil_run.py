"""A manoeuvre driven by two programs and evaluated like a run in virtual time."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from canroll.errors import CanrollError
from canroll.hil import own_bus, session
from canroll.plant_sim.world.spool import Rows, blocks
from canroll.runs import experiment, metrics, steering_replay
from canroll.runs.experiment import with_files
from canroll.runs.result import Result
from canroll.runs.trace import Trace
from canroll.setup.choices import PASSIVE

__all__ = ["run", "with_files"]


def run(
    scenario: str,
    *,
    bus_options: Sequence[str] = (),
    folder: Path,
    passive_by_programs: bool = False,
    duration: float | None = None,
    pace: str = "realtime",
    announce: Callable[[str], None] = lambda text: None,
    serve: str | None = None,
    **keywords: Any,  # noqa: ANN401
) -> tuple[Result, dict[str, Any]]:
    """Drive a manoeuvre by two programs and return the result and its ``timing`` object.

    Args:
        scenario: name of the manoeuvre.
        bus_options: python-can's options, as on the command line; empty for the plant's own bus.
        folder: folder for the calibration and the traces of both programs.
        passive_by_programs: drive the run without control with the two programs too.
        duration: s; beyond the manoeuvre only timing is evaluated.
        pace: "realtime", or "lockstep": the plant grants the ECU's ticks.
        announce: called with the name of the current activity.
        serve: ``HOST:PORT`` of the plant's own bus; None: a free port on loopback.
        keywords: of :func:`canroll.runs.experiment.plan`.

    Raises:
        CanrollError: an invalid name, number or bus; the message names the remedy.
        Interrupted: Ctrl-C; both programs have ended.
    """
    settings, controller = experiment.plan(scenario, duration=duration, **keywords)
    if settings.firmware.fd and serve is not None:
        raise CanrollError(f"--serve: {own_bus.NOT_SERVED}: omit it")
    planned = experiment.build_world(settings, enabled=False).duration_ns
    judged = planned * 1e-9 if duration is None else min(duration, planned * 1e-9)
    setup = session.Setup(
        bus_options=bus_options,
        folder=folder,
        cores=session.choose_cores() if pace == "realtime" else None,
        duration=duration,
        announce=announce,
        pace=pace,
        serve=serve,
    )
    timing: dict[str, Any] = {}
    controlled = None
    if settings.law != PASSIVE:
        announce("starting plant and ECU")
        trace, timing = session.drive(settings, controller, setup, enabled=True)
        controlled = cut(trace, judged)
    if passive_by_programs or controlled is None:
        trace, passive_timing = session.drive(settings, controller, setup, enabled=False)
        passive = cut(trace, judged)
        invalid = [*timing.get("not_valid", ()), *passive_timing["not_valid"]]
        timing = (timing or passive_timing) | {"not_valid": invalid, "valid": not invalid}
    else:
        announce("without control in virtual time")
        passive = experiment.drive(settings, controller, enabled=False, duration=duration)
    cycle = None
    if controlled is not None:
        cycle = experiment.limit_cycle_of(settings, controller, controlled, passive.signals)
    result = experiment.assess(settings, controller, passive, controlled, cycle=cycle)
    return replace(result, timing=timing), timing


def prepare(scenario: str, **keywords: Any) -> None:  # noqa: ANN401
    """Compile into the caches what :func:`run` needs for the same manoeuvre and ``keywords``.

    Raises:
        CanrollError: an invalid name or number; the message names the remedy.
    """
    settings, controller = experiment.plan(scenario, **keywords)
    short = experiment.drive(settings, controller, enabled=True, duration=2.0 * settings.tick)
    steering_replay.with_path_error(short, experiment.maneuver_of(settings).drive)
    metrics.judge(short)


def cut(trace: Trace, duration: float) -> Trace:
    """Return the first ``duration`` seconds of a trace."""
    if trace.duration <= duration:
        return trace
    kept = trace.signals["time"] <= duration + 1e-9
    return replace(
        trace,
        signals={name: np.asarray(values[kept]) for name, values in trace.signals.items()},
        frames=Rows(
            trace.frames.dtype,
            [block[block["t_end"] <= duration * 1e9] for block in blocks(trace.frames)],
        ),
        ticks=trace.ticks[trace.ticks["t"] <= duration],
        duration=duration,
    )
