"""Figures of many pairs of runs, without their traces.

Without control nothing on the bus moves the vehicle: the plant alone gives the same bytes. Only
hydraulics, which resist by themselves, and a plant in another process need the whole world.
"""

from collections.abc import Iterable
from dataclasses import astuple, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.firmware.state import SAFE
from canroll.plant_sim import bodies, can_bus
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.world import open_loop
from canroll.plant_sim.world.recording import Kept
from canroll.plant_sim.world.spool import Rows
from canroll.runs import metrics
from canroll.runs.experiment import drive, limit_cycle_of, maneuver_of, tick_offset_ns
from canroll.runs.result import Run
from canroll.runs.trace import TICK, Trace
from canroll.setup.controller import Controller

SIDE = np.dtype([(each.key, "?" if each.fact else "f8") for each in metrics.METRICS])
"""The metrics of a run."""

FIGURES = np.dtype(
    [
        ("passive", SIDE),
        ("controlled", SIDE),
        ("safe", "f8"),
        ("cycle_hz", "f8"),
        ("cycle_nm", "f8"),
    ]
)
"""Figures of a pair of runs: metrics without and with control, fraction of the ticks in SAFE,
frequency and amplitude of a limit cycle of the command (0 and 0: none)."""


MOVING = ("valves",)
"""Actuators that move the vehicle without control."""

NEEDED = Kept(
    tuple(
        dict.fromkeys(
            # steering and speed for the judgement of limit cycles
            ["time", *(n for each in metrics.METRICS for n in each.signals), "steer", "vx"]
        )
    ),
    frames=False,
)
"""What the figures are made from."""


def figures(controller: Controller, settings: Iterable[Run]) -> NDArray[np.void]:
    """Drive each of ``settings`` without and with control; return one row of FIGURES for each.

    The figures are those of :func:`canroll.runs.experiment.simulate`. A row depends on its settings
    and the controller alone, not on the other rows.

    Raises:
        CanrollError: the settings are invalid.
    """
    return np.array([_pair(controller, each) for each in settings], FIGURES)


def _pair(controller: Controller, settings: Run) -> tuple[object, ...]:
    passive = without_control(settings, controller)
    controlled = drive(settings, controller, enabled=True, kept=NEEDED)
    # several metrics read the same signals
    controlled = replace(controlled, signals=dict(controlled.signals))
    cycle = limit_cycle_of(settings, controller, controlled, passive.signals)
    return (
        astuple(metrics.judge(passive)),
        astuple(metrics.judge(controlled)),
        float(np.mean(controlled.ticks["mode"] == SAFE)),
        *((0.0, 0.0) if cycle is None else (cycle.frequency, cycle.amplitude)),
    )


def without_control(settings: Run, controller: Controller) -> Trace:
    """Return the signals that figures need of the run without control, as far as it is driven.

    As in a run, the effect of faults is measured against a fault-free vehicle.
    """
    body = bodies.body(settings.plant)
    if settings.actuator in MOVING or body.outside is not None:
        healthy = replace(settings, faults=())
        return drive(healthy, controller, enabled=False, kept=NEEDED)
    maneuver = maneuver_of(settings)
    outputs, steer = open_loop.run_passive(settings.vehicle, body, maneuver)
    end_ns = _end_ns(settings, len(outputs) * STEP_NS, maneuver.duration_ns)
    count = -(-end_ns // STEP_NS)
    driven = open_loop.signals(outputs, steer) | {"time": 1e-9 * STEP_NS * np.arange(1, count + 1)}
    # a vehicle that has rolled over rests until the run ends
    signals = {
        name: _lasting(driven[name], count) if name in driven else np.zeros(count)
        for name in NEEDED.signals
    }
    return Trace(
        signals=signals,
        frames=Rows(can_bus.log_dtype()),
        ages=np.zeros(0, np.int64),
        ticks=Rows(TICK),
        duration=end_ns * 1e-9,
    )


def _lasting(values: NDArray[np.floating[Any]], count: int) -> NDArray[np.float64]:
    """Return ``count`` values, the last of them repeated."""
    lasting = np.full(count, values[-1])
    lasting[: len(values)] = values
    return lasting


def _end_ns(settings: Run, driven_ns: int, duration_ns: int) -> int:
    """Return when the run ends whose vehicle is driven for a time: with a tick, or in full."""
    if driven_ns >= duration_ns:
        return duration_ns
    tick_ns, offset_ns = round(settings.tick * 1e9), tick_offset_ns(settings)
    # the plant ends on the full millisecond after a tick
    ticks = max(1, -(-(driven_ns - STEP_NS + 1 - offset_ns) // tick_ns))
    end_ns = offset_ns + ticks * tick_ns
    return end_ns if end_ns <= duration_ns else duration_ns
