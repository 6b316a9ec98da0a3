"""The closed loop in virtual time: one ECU, one bus, one vehicle, and only the plant's clock."""

from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from codegen.run.backends import Backend
from hil.runs.frozen import RUN_TIME
from hil.runs.trace import Trace, tick_rows
from plant_sim.world.world import World

RUN_TIME_NS = round(RUN_TIME * 1e9)

Progress = Callable[[float], None]


class Interrupted(KeyboardInterrupt):
    """A run was interrupted; ``trace`` is the record up to then."""

    def __init__(self, trace: Trace) -> None:
        super().__init__()
        self.trace = trace


class Ticking(Protocol):
    """Interface of an ECU to the loop: in this process, or in lock step over a bus."""

    def restart(self) -> None:
        """Start anew, as after a loss of power."""

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
    order, and the frames the tick sends are queued ``run_time_ns`` later. In an outage of the
    ``world`` there are no ticks, and after it the ECU starts anew.
    """
    world.advance(0)
    t, powered = offset_ns, True
    while t + tick_ns <= end_ns and not world.finished:
        t += tick_ns
        if any(start <= t < end for start, end in world.outages):
            world.advance(t)
            powered = False
            continue
        if not powered:
            ecu.restart()
            powered = True
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
    times: list[float] = []
    images: list[bytes] = []
    try:
        loop = ticks(
            world, ecu, tick_ns=tick_ns, end_ns=end, offset_ns=offset_ns, run_time_ns=run_time_ns
        )
        for t in loop:
            times.append(t * 1e-9)
            images.append(ecu.image())
            if progress is not None and len(times) % 50 == 0:
                progress(t / end)
    except KeyboardInterrupt:
        raise Interrupted(_trace(world, type(ecu.state), times, images, complete=False)) from None
    return _trace(world, type(ecu.state), times, images, complete=True)


def _trace(
    world: World, record: type, times: list[float], images: list[bytes], *, complete: bool
) -> Trace:
    # a tick of which only the time was noted when it was interrupted does not count
    return Trace(
        signals=world.signals,
        frames=world.frames,
        ages=np.asarray(world.ages, dtype=np.int64),
        ticks=tick_rows(times[: len(images)], images, record),
        duration=world.now_ns * 1e-9,
        complete=complete,
    )
