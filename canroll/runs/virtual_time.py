"""The closed loop in virtual time: one ECU, one bus, one vehicle, and only the plant's clock."""

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from canroll.codegen.run.backends import Backend, NativeEcu
from canroll.codegen.run.secured import SecuredEcu
from canroll.plant_sim.kernels.records import to_record
from canroll.plant_sim.nodes.codec import MAX_PAYLOAD
from canroll.plant_sim.world.ecu_kernel import MAILBOXES, Connection, Firmware
from canroll.plant_sim.world.spool import Rows
from canroll.plant_sim.world.world import CHUNK_NS, World
from canroll.runs.trace import TICK, Trace, tick_rows
from canroll.setup.delay import RUN_TIME

RUN_TIME_NS = round(RUN_TIME * 1e9)
"""From a tick to its frames."""

BLOCK = 50
"""Ticks run in one call of the compiled loop."""
KEPT = 20 * BLOCK
"""Ticks whose state records are kept until they become rows."""

Progress = Callable[[float], None]


class Interrupted(KeyboardInterrupt):
    """A run was interrupted; ``trace`` is the record up to then."""

    def __init__(self, trace: Trace) -> None:
        super().__init__(f"interrupted at {trace.duration:.3g} s")
        self.trace = trace


class Ticking(Protocol):
    """Interface of an ECU to the loop: in this process, or in lock step over a bus."""

    def restart(self) -> None:
        """Restart, as after a loss of power."""

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
) -> Iterator[int]:
    """Run ``ecu`` against ``world`` up to ``end_ns``; yield the instant of each tick after it.

    Tick k starts at ``offset_ns + k tick_ns``: all frames received by then have been passed on in
    order, and the frames the tick sends are queued ``RUN_TIME_NS`` later. In an outage of the
    ``world`` there are no ticks, and after it the ECU restarts.
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
            world.submit(t + RUN_TIME_NS, ident, payload)
        yield t
    if not world.finished and t < end_ns:
        world.advance(end_ns)


def observed_ticks(
    world: World,
    ecu: Backend,
    *,
    tick_ns: int,
    end_ns: int,
    offset_ns: int = 0,
) -> Iterator[tuple[int, bytes]]:
    """Run :func:`ticks`; yield the instant of each and the ECU's state record after it."""
    for t in ticks(world, ecu, tick_ns=tick_ns, end_ns=end_ns, offset_ns=offset_ns):
        yield t, ecu.image()


def compiled_ticks(
    world: World,
    ecu: NativeEcu,
    *,
    tick_ns: int,
    end_ns: int,
    offset_ns: int = 0,
) -> Iterator[tuple[int, bytes]]:
    """Run :func:`observed_ticks` in compiled code: the same world, ECU and results."""
    connection = connected(world, ecu)
    images = np.empty((BLOCK, len(connection.image)), np.uint8)
    world.advance(0)
    t, powered = offset_ns, True
    while (left := (end_ns - t) // tick_ns) > 0 and not world.finished:
        left = _before_outage(world, t, tick_ns, left)
        if left == 0:
            t += tick_ns
            world.advance(t)
            powered = False
            continue
        if not powered:
            ecu.restart()
            powered = True
        interrupted = None
        try:
            world.run_ticks(
                connection, images[:left], before_ns=t, period_ns=tick_ns, run_time_ns=RUN_TIME_NS
            )
        except KeyboardInterrupt as error:
            interrupted = error
        for image in images[: (world.now_ns - t) // tick_ns]:
            t += tick_ns
            yield t, image.tobytes()
        if interrupted:
            raise interrupted
    if not world.finished and t < end_ns:
        world.advance(end_ns)


def _before_outage(world: World, t: int, tick_ns: int, left: int) -> int:
    """Return how many of the ``left`` ticks after ``t`` come before the next in an outage."""
    for start, end in world.outages:
        first = max(-((t - start) // tick_ns), 1)
        if t + first * tick_ns < end:
            left = min(left, first - 1)
    return left


def connected(world: World, ecu: NativeEcu) -> Connection:
    """Return the connection of a native ECU to the compiled loop of ``world``."""
    sent, messages = ecu.firmware.sent, ecu.firmware.messages
    for ident, length in sent:
        if length:
            world.check_frame(ident, length)
    received = [(ident, number) for ident, numbers in messages.items() for number in numbers]
    places = ecu.record.array.dtype.fields
    assert places is not None
    payloads, payloads_at = places["tx_payload"][:2]
    buffer = np.zeros(MAX_PAYLOAD, np.uint8)
    pointers = ecu.pointers
    firmware = Firmware(
        receive=pointers["receive"],
        tick=pointers["tick"],
        ecu=pointers["ecu"],
        calibration=pointers["calibration"],
        payload=buffer.ctypes.data,
        received=len(received),
        received_key=_in_room([ident for ident, _ in received]),
        received_mailbox=_in_room([number for _, number in received]),
        sent=len(sent),
        sent_key=_in_room([ident for ident, _ in sent]),
        sent_length=_in_room([length for _, length in sent]),
        pending_at=places["tx_pending"][1],
        payloads_at=payloads_at,
        payload_size=payloads.shape[-1],
    )
    return Connection(to_record(firmware), ecu.record.array.view(np.uint8), buffer)


def _in_room(values: Sequence[int]) -> NDArray[np.int64]:
    row = np.zeros(MAILBOXES, np.int64)
    row[: len(values)] = values
    return row


def closed_loop(
    world: World,
    ecu: Backend,
    *,
    tick_ns: int,
    duration_ns: int | None = None,
    offset_ns: int = 0,
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
        progress: called with the fraction done from time to time.

    Raises:
        Interrupted: Ctrl-C; it carries the recorded trace.
    """
    end = world.duration_ns if duration_ns is None else min(duration_ns, world.duration_ns)
    # of a native ECU without a copy of its state
    ticked = TickRows(ecu.firmware.record if isinstance(ecu, NativeEcu) else type(ecu.state))
    loop = _loop(world, ecu, tick_ns=tick_ns, end_ns=end, offset_ns=offset_ns)
    try:
        for number, (t, image) in enumerate(loop, 1):
            ticked.add(t * 1e-9, image)
            if progress is not None and number % 50 == 0:
                progress(t / end)
    except KeyboardInterrupt:
        raise Interrupted(_trace(world, ecu, ticked, complete=False)) from None
    return _trace(world, ecu, ticked, complete=True)


def _loop(world: World, ecu: Backend, **times: int) -> Iterator[tuple[int, bytes]]:
    if isinstance(ecu, NativeEcu) and times["tick_ns"] <= CHUNK_NS:
        return compiled_ticks(world, ecu, **times)
    return observed_ticks(world, ecu, **times)


class TickRows:
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
        if len(self._images) == KEPT:
            self.rows()

    def rows(self) -> Rows:
        """Return the rows of all ticks so far (:data:`canroll.runs.trace.TICK`)."""
        # a tick of which only the time was noted when it was interrupted does not count
        times = self._times[: len(self._images)]
        self._rows.append(tick_rows(times, self._images, self._record))
        self._times, self._images = [], []
        return self._rows


def _trace(world: World, ecu: Backend, ticked: TickRows, *, complete: bool) -> Trace:
    return Trace(
        signals=world.signals,
        frames=world.frames,
        ages=np.asarray(world.ages, dtype=np.int64),
        ticks=ticked.rows(),
        duration=world.now_ns * 1e-9,
        complete=complete,
        refused=(ecu.refused, world.refused) if isinstance(ecu, SecuredEcu) else None,
    )
