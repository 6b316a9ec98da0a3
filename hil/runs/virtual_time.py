"""The closed loop in virtual time: one ECU, one bus, one vehicle, and only the plant's clock."""

from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from codegen.run.backends import Backend
from hil.runs.frozen import RUN_TIME
from hil.runs.trace import TICK, Trace, tick_rows
from plant_sim.world.spool import Rows
from plant_sim.world.world import World

RUN_TIME_NS = round(RUN_TIME * 1e9)

TICKS_IN_BLOCK = 1000

Progress = Callable[[float], None]


class Interrupted(KeyboardInterrupt):
    """A run was interrupted; ``trace`` is the record up to then."""

    def __init__(self, trace: Trace) -> None:
        super().__init__()
        self.trace = trace


class Ticking(Protocol):
    """Interface of an ECU to the loop: in this process, or in lock step over a bus."""

    def receive(self, ident: int, payload: NDArray[np.uint8], length: int) -> None:
        """Take a frame."""

    def tick(self, elapsed_ticks: int = 1) -> list[tuple[int, bytes]]:
        """Run one tick and return the frames to send, in order."""


def ticks(
    world: World,
    ecu: Ticking,
    *,
    tick_ns: int,
    end_ns: int,
    offset_ns: int = 0,
    run_time_ns: int = RUN_TIME_NS,
) -> Iterator[int]:
    """Run ``ecu`` against ``world`` up to ``end_ns``; yield the instant of each tick after it.

    Tick k starts at ``offset_ns + k tick_ns``: all frames received by then have been passed on in
    order, and the frames the tick sends are queued ``run_time_ns`` later.
    """
    world.advance(0)
    t = offset_ns
    while t + tick_ns <= end_ns and not world.finished:
        t += tick_ns
        for frame in world.advance(t):
            length = int(frame["length"])
            ecu.receive(int(frame["ident"]), frame["payload"][:length], length)
        for ident, payload in ecu.tick(1):
            world.submit(t + run_time_ns, ident, payload)
        yield t
    if not world.finished and t < end_ns:
        world.advance(end_ns)


def closed_loop(
    world: World,
    ecu: Backend,
    *,
    tick_ns: int,
    duration_ns: int | None = None,
    offset_ns: int = 0,
    run_time_ns: int = RUN_TIME_NS,
    progress: Progress | None = None,
) -> Trace:
    """Run ``ecu`` against ``world`` until the manoeuvre is over.

    The result does not depend on the computer's speed: the same world and ECU give the same bytes.

    Args:
        world: vehicle, sensors, actuators and bus at time 0.
        ecu: initialised.
        tick_ns: period of the loop.
        duration_ns: duration, if shorter than the manoeuvre.
        offset_ns: phase of the ticks relative to the plant's start.
        run_time_ns: time from a tick to its frames.
        progress: called with the fraction done from time to time.

    Raises:
        Interrupted: Ctrl-C; it carries the recorded trace.
    """
    end = world.duration_ns if duration_ns is None else min(duration_ns, world.duration_ns)
    ticked = _Ticks(type(ecu.state))
    try:
        loop = ticks(
            world, ecu, tick_ns=tick_ns, end_ns=end, offset_ns=offset_ns, run_time_ns=run_time_ns
        )
        for t in loop:
            ticked.add(t * 1e-9, ecu.image())
            if progress is not None and round(t / tick_ns) % 50 == 0:
                progress(t / end)
    except KeyboardInterrupt:
        raise Interrupted(_trace(world, ticked, complete=False)) from None
    return _trace(world, ticked, complete=True)


class _Ticks:
    """The rows of all ticks, made from the ECU's memory a block at a time."""

    def __init__(self, record: type) -> None:
        self._record = record
        self._rows = Rows(TICK)
        self._times: list[float] = []
        self._images: list[bytes] = []

    def add(self, t: float, image: bytes) -> None:
        """Add the ECU's memory after a tick at ``t`` seconds."""
        self._times.append(t)
        self._images.append(image)
        if len(self._images) == TICKS_IN_BLOCK:
            self.rows()

    def rows(self) -> Rows:
        """Return the rows of all ticks so far (:data:`hil.runs.trace.TICK`)."""
        # a tick of which only the time was noted when it was interrupted does not count
        times = self._times[: len(self._images)]
        self._rows.append(tick_rows(times, self._images, self._record))
        self._times, self._images = [], []
        return self._rows


def _trace(world: World, ticked: _Ticks, *, complete: bool) -> Trace:
    return Trace(
        signals=world.signals,
        frames=world.frames,
        ages=np.asarray(world.ages, dtype=np.int64),
        ticks=ticked.rows(),
        duration=world.now_ns * 1e-9,
        complete=complete,
    )
