"""Loops at absolute deadlines on all cores, as in a run, and their wake-up lateness.

The loop on the ECU's core also runs the firmware, once a tick, on the frames of a driven manoeuvre.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from multiprocessing.synchronize import Barrier

import numpy as np
from numpy.typing import NDArray

from canroll.setup.bus_frames import firmware_of
from codegen.generated.own_stage import OwnStage
from codegen.run.backends import open_backend
from codegen.run.secured import SecuredEcu
from firmware.calibration import Calibration
from hil.bus_link import Frame
from hil.check.machine import Counters, counters
from hil.check.workers import CONTEXT, Child, Send, ended
from hil.process import TIMER_SLACK, collector_off, prepare
from plant_sim.buses.profile import BusProfile

ECU, PLANT, SPARE = "ECU", "plant", "spare"
"""Parts that a core has in a run."""
PERIOD_NS = 1_000_000
NAP_NS, NAPS = 50_000, 200
START = 120.0
"""Time the processes may take to be ready, s."""

Times = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class TickInputs:
    """Input of the firmware: one list of received frames per tick, and what makes that firmware.

    ``key`` is that of authenticated frames, on a bus that has them.
    """

    backend: str
    calibration: Calibration
    received: Sequence[Sequence[Frame]]
    profile: BusProfile
    stage: OwnStage | None
    key: bytes


@dataclass(frozen=True, slots=True)
class Placement:
    """Placement of a loop: core (None: not pinned), its role in a run, SCHED_FIFO priority."""

    core: int | None
    role: str
    priority: int


@dataclass(frozen=True, slots=True)
class LoopTimes:
    """Measurements of one loop.

    Attributes:
        late_ns: lateness of every period, from the deadline to the first instruction after it.
        ticks_ns: duration of each tick of the firmware; ECU's loop only.
        overshoot_ns: excess duration of sleeps of :data:`NAP_NS`.
        slack_ns: timer slack of the process; None: unknown.
        own_s: processor time used by the loop, s.
        counted: change of the machine's counters meanwhile; ECU's loop only.
        notes: settings refused by the system.
    """

    place: Placement
    late_ns: Times
    ticks_ns: Times = field(default_factory=lambda: np.zeros(0, np.int64))
    overshoot_ns: Times = field(default_factory=lambda: np.zeros(0, np.int64))
    slack_ns: int | None = None
    own_s: float = 0.0
    counted: Counters | None = None
    notes: tuple[str, ...] = ()


def measure(places: Sequence[Placement], seconds: float, ticks: TickInputs) -> list[LoopTimes]:
    """Run a loop at each of ``places``, all at the same time, for ``seconds``.

    Raises:
        CanrollError: one of the processes failed.
    """
    together = CONTEXT.Barrier(len(places))
    children: list[Child] = []
    with ended(children):
        for place in places:
            given = ticks if place.role == ECU else None
            children.append(Child(_loop, together, place, seconds, given))
        return [child.receive(START + seconds) for child in children]


def _loop(
    send: Send, together: Barrier, place: Placement, seconds: float, ticks: TickInputs | None
) -> None:
    notes = prepare(cpu=place.core, priority=place.priority)
    ecu = None
    if ticks is not None:
        firmware = firmware_of(ticks.profile, ticks.stage)
        ecu = open_backend(ticks.backend, ticks.calibration, firmware, key=ticks.key)
    late = np.zeros(round(seconds * 1e9) // PERIOD_NS + 1, np.int64)
    received = [] if ticks is None else ticks.received
    took = np.zeros(len(late), np.int64)
    count = done = 0
    periods = 1 if ticks is None else ticks.calibration.tick_us * 1000 // PERIOD_NS
    clock, sleep = time.monotonic_ns, time.sleep
    with collector_off():
        # a collection on one core would hold up another loop that shares it
        together.wait(START)
        used, before = time.process_time(), counters()
        deadline = clock() + PERIOD_NS
        until = deadline + round(seconds * 1e9)
        while deadline < until:
            while (wait := deadline - clock()) > 0:
                sleep(wait * 1e-9)
            start = clock()
            late[count] = start - deadline
            if ecu is not None and count % periods == 0:
                for ident, payload in received[done % len(received)]:
                    ecu.receive(ident, payload, len(payload))
                ecu.tick(1)
                took[done] = clock() - start
                done += 1
                if done % len(received) == 0 and isinstance(ecu, SecuredEcu):
                    # the frames of the drive are old to it until it starts again
                    ecu.restart()
            count += 1
            # a loop that was held up goes on at the next deadline, as those of a run do
            deadline += PERIOD_NS * max(1, -(-(clock() - deadline) // PERIOD_NS))
    used = time.process_time() - used
    counted = None if ecu is None else counters().since(before)
    slack = int(TIMER_SLACK.read_text(encoding="ascii")) if TIMER_SLACK.exists() else None
    naps = _naps()
    send(LoopTimes(place, late[:count], took[:done], naps, slack, used, counted, tuple(notes)))


def _naps() -> Times:
    late = np.zeros(NAPS, np.int64)
    for k in range(NAPS):
        start = time.monotonic_ns()
        time.sleep(NAP_NS * 1e-9)
        late[k] = time.monotonic_ns() - start - NAP_NS
    return late
