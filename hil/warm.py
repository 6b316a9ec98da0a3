"""Warm-up before a loop: compiling, loading, touching memory.

Both programs first run their complete loops on synthetic frames, and only then report that they
are ready. Later compilations are counted.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from numba.core import event

from canroll.codegen.run.backends import Backend
from canroll.codegen.run.bus_firmware import BusFirmware, built_in
from canroll.firmware.calibration import BARS, DAMPERS, SUSPENSION, VALVES, Calibration
from canroll.hil import ecu_loop, plant_loop
from canroll.hil.bus_link import Frame
from canroll.hil.phase_lock import ACQUIRE, PhaseLock
from canroll.hil.process import Stop
from canroll.hil.tick_trace import TickRecorder
from canroll.plant_sim.world.world import World

TICKS = ACQUIRE + 4
"""Ticks of a rehearsal: enough to find the phase and go on."""
PLANT_NS = 50_000_000
"""Length of the plant's rehearsal."""
EVERY = 20
"""A loop receives frames once in this many reads: every 10 ms in the plant."""


class _Rehearsal:
    """A dummy link that receives the same frames repeatedly and discards what is sent."""

    failed = 0
    record = None

    def __init__(self, frames: list[Frame]) -> None:
        self._frames, self._place = frames, 0
        self.sent = self.received = 0

    def receive(self) -> list[Frame]:
        self._place += 1
        return [] if self._place % EVERY else self._frames

    def next(self, timeout: float) -> Frame:
        time.sleep(timeout / 2)
        self._place += 1
        return self._frames[self._place % len(self._frames)]

    def send(self, ident: int, payload: bytes) -> None:
        self.sent += 1

    def close(self) -> None:
        pass


def rehearse_ecu(
    ecu: Backend, calibration: Calibration, firmware: BusFirmware | None = None
) -> None:
    """Run the ECU's loop for a few ticks on a temporary ECU.

    ``firmware`` is the firmware for the bus, by default the built-in one.
    """
    firmware = firmware or built_in()
    link = _Rehearsal([(ident, bytes(firmware.room)) for ident in firmware.slots])
    period = 1000 * calibration.tick_us
    recorder = TickRecorder(room=firmware.room)
    ecu_loop.run(
        ecu,
        link,
        recorder,
        calibration,
        stop=Stop(),
        duration_ns=TICKS * period,
        peer_timeout_ns=TICKS * period,
        lock=PhaseLock(phase_ns=0, cycle_ns=period),
        firmware=firmware,
    )


def rehearse_plant(make_world: Callable[[], World], firmware: BusFirmware | None = None) -> None:
    """Run the plant's loop briefly, and read everything that is read of a run.

    Args:
        make_world: makes a world like the run's.
        firmware: firmware for the bus, by default the built-in one.
    """
    firmware = firmware or built_in()
    world = make_world()
    calibration, commands = Calibration(), []
    for calibration.actuator in (SUSPENSION, BARS, DAMPERS, VALVES):
        commands.append(ecu_loop.zero_command(calibration, bytes(64), firmware))
    link = _Rehearsal([*commands, *((ident, bytes(size)) for ident, size in firmware.sent)])
    plant_loop.run(
        world,
        link,
        stop=Stop(),
        duration_ns=PLANT_NS,
        peer_timeout_ns=PLANT_NS,
        firmware=firmware,
    )
    # a run may grow the world's memory and empties its log on the way
    world.advance(world.duration_ns + PLANT_NS)
    _ = world.signals, world.frames, world.commands, world.ages


@dataclass(slots=True)
class Compilations:
    """Functions compiled, or loaded from the cache, so far."""

    count: int = 0


class _Listener(event.Listener):  # type: ignore[misc]
    def __init__(self, compilations: Compilations) -> None:
        self._compilations = compilations

    def on_start(self, _event: Any) -> None:  # noqa: ANN401
        self._compilations.count += 1

    def on_end(self, _event: Any) -> None:  # noqa: ANN401
        pass


@contextmanager
def counted_compilations() -> Iterator[Compilations]:
    """Count what Numba compiles or loads inside."""
    compilations = Compilations()
    with event.install_listener("numba:compiler_lock", _Listener(compilations)):
        yield compilations
