"""An attack over a real interface: attacker, vehicle and ECU are three nodes on it, in lock step.

In each tick the vehicle sends what its sensors say; the attacker, on a connection of its own, hears
that and the ECU's answer to the last tick, and sends its frames of any format; then the tick is
granted. So a run depends on no clock. What the attacker sends reaches the ECU by the interface
alone; the vehicle takes it from there to the nodes of its modelled bus, which judge it.
"""

import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import can
import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError, VerdictError
from codegen.run.backends import Backend
from gain_gen.calibration import calibration_file
from hil.attacks.attacker import AttackedWorld, Ear, Forge, Forged, Heard
from hil.attacks.kinds import MS, NONE, START_NS, Attack
from hil.attacks.suite import Driven, Gate
from hil.realtime import children as programs
from hil.realtime import plant_loop, tick_trace
from hil.realtime.bus_link import CanLink, Frame, data_frame
from hil.realtime.children import Program
from hil.realtime.lockstep import ACKNOWLEDGEMENT, GRANT, LOST, GrantedEcu, InBand
from hil.realtime.process import Stop
from hil.realtime.tick_trace import TickTrace
from hil.runs.experiment import tick_offset_ns, world_options
from hil.runs.result import Settings
from hil.runs.trace import Trace
from hil.setup import words
from hil.setup.controller import Controller
from plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD
from plant_sim.nodes import codec
from plant_sim.nodes.codec import MAX_PAYLOAD
from plant_sim.world.world_kernel import EXTENDED_KEY, row_of

PEER_TIMEOUT = 60.0
"""Time without an answer after which the ECU is lost, s."""


class EcuProgram(Protocol):
    """An ECU on the interface in lock step."""

    def stop(self) -> TickTrace:
        """End it and return the trace of its ticks."""


StartEcu = Callable[[], EcuProgram]
"""Starts the ECU; again, it continues with what it remembers of its starts."""


class EcuProcess:
    """The ECU as ``canroll ecu`` in a process of its own, with its memory in ``folder``.

    ``options`` are python-can's options of the interface.
    """

    def __init__(
        self, options: Sequence[str], folder: Path, settings: Settings, controller: Controller
    ) -> None:
        gains, self._trace = folder / "calibration.toml", folder / "ticks.npz"
        calibration_file.save(gains, controller.record, controller.tables)
        self._children: list[Program] = []
        frames = {name: getattr(settings, name) for name in ("bus", "dbc", "map", "key")}
        self._arguments = [
            *("ecu", "--calibration", str(gains), "--backend", settings.backend),
            *("--pace", "lockstep", "--trace", str(self._trace), *options),
            *words.arguments(frames),
        ]
        if settings.firmware.bus.secured:
            memory = folder / "memory.json"
            memory.unlink(missing_ok=True)
            self._arguments += ["--memory", str(memory)]

    def start(self) -> "EcuProcess":
        """Start it."""
        self._trace.unlink(missing_ok=True)
        child = programs.start(self._children, "ECU", self._arguments)
        programs.wait_for(child, "ECU runs")
        return self

    def stop(self) -> TickTrace:
        """End it and return the trace of its ticks."""
        self._children[-1].ask_to_stop()
        programs.check_ended(self._children[-1])
        return tick_trace.load(self._trace)

    def end(self) -> None:
        """End what still runs, after an error too."""
        programs.stop(self._children)


class Attacker:
    """A node on the interface: it hears what the others send and sends what ``forge`` makes of it.

    ``sent`` counts its frames.
    """

    def __init__(self, bus: can.BusABC, ear: Ear, forge: Forge, tick_ns: int) -> None:
        self._bus, self._ear, self._forge, self._tick_ns = bus, ear, forge, tick_ns
        self._later: deque[tuple[int, Forged]] = deque()
        self._idle: list[Heard] = []
        self._own: Counter[tuple[int, bytes]] = Counter()
        self.sent = 0

    def turn(self, now_ns: int, others: int) -> list[can.Message]:
        """Hear the ``others`` frames that were sent for this tick; return the frames sent now.

        Raises:
            VerdictError: a frame did not arrive.
        """
        ear = self._ear
        heard = self._hear(now_ns, others)
        ear.all += heard
        found: list[can.Message] = []
        for step in range(self._tick_ns // MS):
            ear.now_ns = now_ns - self._tick_ns + (step + 1) * MS
            ear.new = heard if step == 0 else self._idle
            if ear.now_ns < START_NS:
                continue
            self._later.extend((ear.now_ns + frame.delay_ns, frame) for frame in self._forge(ear))
        due = [frame for at, frame in self._later if at <= now_ns]
        self._later = deque((at, frame) for at, frame in self._later if at > now_ns)
        for frame in due:
            message = self._message(frame)
            self._bus.send(message)
            self._own[message.arbitration_id, bytes(message.data)] += 1
            found.append(message)
        self.sent += len(found)
        return found

    def forget(self) -> None:
        """Skip what was sent by now, such as the last words of an ECU."""
        while self._bus.recv(0.0) is not None:
            pass

    def _hear(self, now_ns: int, count: int) -> list[Heard]:
        found: list[Heard] = []
        until = time.monotonic() + LOST
        while len(found) < count:
            message = self._bus.recv(max(0.0, until - time.monotonic()))
            if message is None:
                raise VerdictError(f"the attacker has missed {count - len(found)} frames")
            own = message.arbitration_id, bytes(message.data)
            if self._own[own] > 0:
                # some interfaces give back what was sent
                self._own[own] -= 1
            elif (heard := self._heard(now_ns, message)) is not None:
                found.append(heard)
        self._own.clear()
        return found

    def _heard(self, now_ns: int, message: can.Message) -> Heard | None:
        tables = self._ear.tables
        key = message.arbitration_id | (EXTENDED_KEY if message.is_extended_id else 0)
        row = row_of(tables, key)
        if row < 0 or data_frame(message) is None:
            return None
        payload = np.zeros(MAX_PAYLOAD, np.uint8)
        payload[: len(message.data)] = list(message.data)
        flags = int(tables.message[row, codec.FLAGS])
        return Heard(now_ns, row, len(message.data), flags, payload)

    def _message(self, frame: Forged) -> can.Message:
        return can.Message(
            arbitration_id=int(self._ear.tables.message[frame.row, codec.IDENT]),
            data=frame.payload[: frame.length].tobytes(),
            is_extended_id=bool(frame.flags & EXTENDED),
            is_fd=bool(frame.flags & FD),
            bitrate_switch=bool(frame.flags & BIT_RATE_SWITCH),
        )


class _Vehicle(AttackedWorld):
    """The vehicle: the ECU has the attacker's frames from the interface, not from the model."""

    def advance(self, until_ns: int) -> NDArray[np.void]:
        """Advance, and return the genuine frames for the ECU."""
        found = super().advance(until_ns)
        genuine: NDArray[np.void] = found[found["forged"] == 0]
        return genuine


class _AttackedEcu(GrantedEcu):
    """The ECU behind the interface, to which the attacker sends before each grant.

    ``forged``: by tick, the frames of the attacker that the ECU has got.
    """

    def __init__(
        self, link: CanLink, world: _Vehicle, attacker: Attacker, ecu: StartEcu, settings: Settings
    ) -> None:
        firmware = settings.firmware
        self._to_ecu, self._commands = plant_loop.sent_to(firmware), plant_loop.sent_by(firmware)
        channel = InBand(
            link, sends=GRANT, hears=ACKNOWLEDGEMENT, idents=self._to_ecu | self._commands
        )
        super().__init__(
            link, channel, idents=self._commands, stop=Stop(), peer_timeout=PEER_TIMEOUT
        )
        self._world, self._attacker, self._firmware = world, attacker, firmware
        self._start, self._answered = ecu, 0
        self._running: EcuProgram | None = None
        self.traces: list[TickTrace] = []
        self.forged: dict[int, Counter[Frame]] = {}
        self.restart()

    def restart(self) -> None:
        """Stop the ECU and start it again; it remembers how often it was started."""
        self.finish()
        self._attacker.forget()
        self._answered = 0
        self._running = self._start()
        if not self.greet(PEER_TIMEOUT):
            raise VerdictError("no answer from the ECU")

    def finish(self) -> None:
        """Stop the ECU, and keep its trace."""
        if self._running is not None:
            self.traces.append(self._running.stop())
            self._running = None

    def tick(self, elapsed_ticks: int = 1) -> list[Frame]:
        """Grant a tick after the attacker's turn; return the ECU's frames."""
        messages = self._attacker.turn(self._world.now_ns, self._sent + self._answered)
        frames = [frame for frame in map(self._received, messages) if frame is not None]
        to_ecu = [frame for frame in frames if frame[0] in self._to_ecu]
        commands = len(frames) - len(to_ecu)
        # the actuators hear the sensors as well, but an interface may not give those back
        for frame in (*self._heard.all(commands, "of the attacker", self._stop), *to_ecu):
            self._world.inject(self._injected(*frame))
        self._sent += len(to_ecu)
        answer = super().tick(elapsed_ticks)
        self.forged[self._number] = Counter(frames)
        self._answered = len(answer)
        return answer

    def _received(self, message: can.Message) -> Frame | None:
        """Return a frame of the attacker as a node of its format receives it; None: it does not."""
        frame = data_frame(message)
        if frame is None or frame[0] not in self._to_ecu | self._commands:
            return None
        return frame if message.is_fd == (frame[0] in self._firmware.fd) else None

    def _injected(self, ident: int, payload: bytes) -> Forged:
        tables = self._world.ear.tables
        row = row_of(tables, ident)
        data = np.zeros(MAX_PAYLOAD, np.uint8)
        data[: len(payload)] = list(payload)
        return Forged(row, len(payload), int(tables.message[row, codec.FLAGS]), data)


def drive(
    settings: Settings,
    controller: Controller,
    attack: Attack,
    *,
    link: CanLink,
    attacker: can.BusABC,
    ecu: StartEcu,
) -> Driven:
    """Drive one attack on an interface.

    Args:
        settings: of the run, with the faults that the attack waits for.
        controller: of the run.
        attack: what the attacker does.
        link: the vehicle's connection.
        attacker: the attacker's connection, which receives what the others send.
        ecu: starts the ECU on the interface.

    Raises:
        VerdictError: frames were lost, or the ECU does not answer.
        CanrollError: the ECU does not replay.
    """
    tick_ns = round(settings.tick * 1e9)
    world = _Vehicle(**world_options(settings, enabled=True))
    # it hears and sends on the interface, not on the modelled bus
    world.attack(NONE.forge, 0, seed=settings.seed)
    ear = Ear(world.ear.tables, world.ear.secured, np.random.default_rng([settings.seed, 77]))
    node = Attacker(attacker, ear, attack.forge, tick_ns)
    behind = _AttackedEcu(link, world, node, ecu, settings)
    try:
        plant_loop.run_granting(
            world,
            behind,
            stop=Stop(),
            duration_ns=world.duration_ns,
            offset_ns=tick_offset_ns(settings),
        )
    finally:
        behind.finish()
    accepted, refused, rows = _judged(behind, settings, world)
    secured = settings.firmware.bus.secured
    trace = Trace(
        signals=world.signals,
        frames=world.frames,
        ages=np.asarray(world.ages, dtype=np.int64),
        ticks=rows,
        duration=world.now_ns * 1e-9,
        refused=(refused, world.refused) if secured else None,
    )
    return Driven(trace, node.sent, accepted + world.forged)


def _judged(
    behind: _AttackedEcu, settings: Settings, world: _Vehicle
) -> tuple[int, int, NDArray[np.void]]:
    """Return the attacker's frames that the ECU has accepted, all it has refused, and its ticks."""
    accepted = refused = 0
    rows = []
    for trace in behind.traces:
        marks = deque(_marks(trace, behind.forged))
        gates: list[Gate] = []

        def through(ecu: Backend, marks: deque[bool] = marks, gates: list[Gate] = gates) -> Gate:
            gates.append(Gate(ecu, world.ear.tables, marks.popleft, settings.firmware))
            return gates[-1]

        again = tick_trace.replay(
            trace,
            settings.backend,
            start_ns=-tick_offset_ns(settings),
            firmware=settings.firmware,
            key=settings.secret,
            through=through,
        )
        if again.difference is not None:
            raise CanrollError(f"the tick trace does not replay: {again.difference}")
        accepted += gates[0].accepted
        refused += gates[0].refused
        rows.append(again.rows)
    return accepted, refused, np.concatenate(rows)


def _marks(trace: TickTrace, forged: Mapping[int, Counter[Frame]]) -> Iterator[bool]:
    """Yield for each frame that the ECU consumed whether it is the attacker's.

    Of frames with the same bytes in one tick the attacker's are the last: it sends after the
    vehicle.
    """
    ticks, frames = np.asarray(trace.ticks), np.asarray(trace.frames)
    first = 0
    for tick in ticks:
        its = frames[first : first + int(tick["frames"])]
        first += len(its)
        left = Counter(forged.get(int(tick["number"]), ()))
        marks = []
        for frame in its[its["sent"] == 0][::-1]:
            same = int(frame["ident"]), bytes(frame["payload"][: int(frame["length"])])
            marks.append(left[same] > 0)
            left[same] -= 1
        yield from reversed(marks)
