"""``canroll hil --check``: measure, judge, report."""

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from canroll.errors import CanrollError
from canroll.runs.result import Settings
from canroll.runs.traffic import record_traffic
from canroll.setup.controller import PreparedController
from hil import timing
from hil.bus_link import Frame
from hil.check import judgement, loops, machine, round_trip
from hil.check.judgement import Measurements
from hil.check.loops import Placement, TickInputs
from hil.process import ECU_PRIORITY, PLANT_PRIORITY, cores
from hil.session import choose_cores

DURATION = 10.0
SHARE_OF_LOOPS = 0.75
"""Of the duration; the rest is for the round trips."""
MOST_CORES = 8
"""Loops that run at the same time: each is a Python process."""
DRIVEN_S = 2.0
"""Part of the manoeuvre on which the firmware is timed."""


def measure(
    settings: Settings,
    controller: PreparedController,
    bus: argparse.Namespace | None,
    *,
    duration: float = DURATION,
    announce: Callable[[str], None] = lambda text: None,
) -> Measurements:
    """Measure for ``duration`` seconds under the conditions of a run of ``settings``.

    Args:
        settings: backend and period of the ECU.
        controller: its calibration.
        bus: python-can's options; None for the plant's own bus.
        duration: s, shared by the loops and the round trips.
        announce: called with the name of the current activity.

    Raises:
        CanrollError: an invalid duration, or the bus cannot be opened.
    """
    if not 0.5 <= duration <= 3600:
        raise CanrollError(f"--duration must be 0.5 to 3600 s, got {duration:g}")
    places = _places()
    by_role = {place.role: place for place in places}
    ticks = _driven(settings, controller)
    announce("CAN round trips")
    trips = round_trip.measure(
        bus, duration * (1 - SHARE_OF_LOOPS), by_role[loops.ECU], by_role[loops.PLANT]
    )
    announce("wake-ups and ticks")
    measured = loops.measure(places, duration * SHARE_OF_LOOPS, ticks)
    return Measurements(
        machine=machine.read(cores()),
        loops=measured,
        bus=trips,
        seconds=duration * SHARE_OF_LOOPS,
        counted=next(loop.counted for loop in measured if loop.counted is not None),
        resolution_ns=round(time.get_clock_info("monotonic").resolution * 1e9),
    )


def _places() -> list[Placement]:
    """Return the placement of loops: the run's cores as in a run, and all others."""
    chosen = choose_cores()
    if chosen is None:
        return [
            Placement(None, loops.PLANT, PLANT_PRIORITY),
            Placement(None, loops.ECU, ECU_PRIORITY),
        ]
    plant, ecu = chosen
    spare = [core for core in cores() if core not in chosen][-(MOST_CORES - 2) :]
    return [
        *(Placement(core, loops.SPARE, PLANT_PRIORITY) for core in spare),
        Placement(plant, loops.PLANT, PLANT_PRIORITY),
        Placement(ecu, loops.ECU, ECU_PRIORITY),
    ]


def _driven(settings: Settings, controller: PreparedController) -> TickInputs:
    """Return the frames received by the ECU in the manoeuvre, tick by tick."""
    firmware = settings.firmware
    traffic = record_traffic(settings, controller, DRIVEN_S)
    received: list[list[Frame]] = [[] for _ in range(traffic.ticks)]
    for event in traffic.frames:
        box = firmware.bus.received[event["message"]]
        # a frame that several mailboxes take is recorded once for each
        first = firmware.slots[box.ident][0] == event["message"]
        if first and event["tick"] < len(received):
            payload = bytes(event["payload"][: event["length"]])
            received[event["tick"]].append((box.ident, payload))
    return TickInputs(
        settings.backend,
        controller.record,
        received,
        settings.profile,
        firmware.stage,
        settings.secret,
    )


def report(seen: Measurements, tick_ms: float) -> dict[str, Any]:
    """Return the report of ``canroll hil --check --json``."""
    needs, plant_needs = judgement.needed_us(seen)
    return {
        "tick_ms": tick_ms,
        "held": judgement.holds(seen, tick_ms),
        "rule": judgement.RULE,
        "needed_us": {"ecu": needs, "plant": plant_needs},
        "ticks": {f"{t:g}": judgement.holds(seen, t) for t in judgement.TICKS_MS},
        "shortest_ms": judgement.shortest_ms(seen),
        "loops": [
            {
                "core": loop.place.core,
                "role": loop.place.role,
                "late_us": timing.quantiles(loop.late_ns),
                "histogram": timing.histogram(loop.late_ns),
                "slack_us": None if loop.slack_ns is None else loop.slack_ns / 1e3,
            }
            for loop in seen.loops
        ],
        "tick_us": timing.quantiles(_of_all(seen, "ticks_ns")),
        "timer": {
            "resolution_us": seen.resolution_ns / 1e3,
            "overshoot_us": timing.quantiles(_of_all(seen, "overshoot_ns")),
        },
        "bus": {
            "interface": seen.bus.interface,
            "round_trip_us": timing.quantiles(seen.bus.trips_ns),
            "poll_us": timing.quantiles(seen.bus.poll_ns),
            "lost": seen.bus.lost,
            "missing": seen.bus.missing,
        },
        "machine": {
            "kernel": seen.machine.kernel,
            "realtime_kernel": seen.machine.realtime_kernel,
            "hypervisor": seen.machine.hypervisor,
            "clocksource": seen.machine.clocksource,
            "rt_runtime": seen.machine.rt_runtime,
            "quota": seen.machine.quota,
            "cores": [
                {
                    "core": core.number,
                    "isolated": core.isolated,
                    "governor": core.governor,
                    "idle_state": core.idle_state,
                    "idle_exit_us": core.idle_exit_us,
                    "steal_ms": 1e3 * seen.counted.steal.get(core.number, 0.0),
                    "busy_ms": 1e3 * seen.counted.busy.get(core.number, 0.0),
                }
                for core in seen.machine.cores
            ],
        },
        "findings": [
            {"what": finding.what, "remedy": finding.remedy} for finding in judgement.findings(seen)
        ],
    }


def _of_all(seen: Measurements, name: str) -> timing.Times:
    return np.concatenate([getattr(loop, name) for loop in seen.loops])
