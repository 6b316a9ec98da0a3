"""An attacker on the bus: it hears every frame, knows every format and rule, and has no key.

Every millisecond it may send frames of any kind on the segments of the ECU and of the actuators.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from canroll import dbc
from canroll.plant_sim import can_bus
from canroll.plant_sim.can_bus.wire.frame import EXTENDED
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.nodes import authentication, codec, codec_tables, e2e
from canroll.plant_sim.nodes.codec import MAX_PAYLOAD, Codec
from canroll.plant_sim.nodes.sensors import PER_UNIT
from canroll.plant_sim.world import fault_parts
from canroll.plant_sim.world.world import FRAME, World
from canroll.plant_sim.world.world_kernel import EXTENDED_KEY, SENDER_STATE, row_of

NAMES = tuple(message.name for message in dbc.load().messages)
"""Messages of the contract, in the order of the codec's tables."""
SAMPLES = 16
"""Values of a sample counter."""


@dataclass(frozen=True, slots=True)
class Heard:
    """A genuine frame of ours on the bus: when, which row of the codec's tables, and its bytes."""

    t_ns: int
    row: int
    length: int
    flags: int
    payload: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Forged:
    """A frame of the attacker, after ``delay_ns``; it is meant for the receiver of ``row``."""

    row: int
    length: int
    flags: int
    payload: NDArray[np.uint8]
    delay_ns: int = 0


@dataclass(slots=True)
class Ear:
    """What the attacker knows: the tables of all frames, and what it has heard.

    ``new`` are the frames of the last millisecond, ``all`` those since it listens. ``secured``: the
    frames have a freshness value, which it can read and write as everybody can.
    """

    tables: Codec
    secured: bool
    random: np.random.Generator
    now_ns: int = 0
    new: list[Heard] = field(default_factory=list)
    all: list[Heard] = field(default_factory=list)

    def leader(self, message: str) -> int:
        """Row of the frame that carries a message; -1: none does."""
        row = codec_tables.message_index(message)
        on_bus = self.tables.message[row]["length"] > 0
        return int(self.tables.message[row]["leader"]) if on_bus else -1

    def heard(self, message: str) -> list[Heard]:
        """The new frames of a message."""
        row = self.leader(message)
        return [heard for heard in self.new if heard.row == row]

    def insert(
        self, payload: NDArray[np.uint8], message: str, signal: str, value: float
    ) -> NDArray[np.uint8]:
        """Put a value (SI units) of a signal in a payload, if the bus has it."""
        row = codec_tables.signal_index(message, signal)
        if self.tables.field[row]["pieces"]:
            scaled = value * PER_UNIT.get(codec_tables.unit(message, signal), 1.0)
            codec.insert(self.tables, row, payload, codec.raw_value(self.tables, row, scaled))
        return payload

    def following(self, heard: Heard) -> NDArray[np.uint8]:
        """A payload like the one heard, with the next sample counter and freshness value."""
        payload = heard.payload.copy()
        for row, name in enumerate(NAMES):
            names = codec_tables.signal_names(name)
            if self.tables.message[row]["leader"] != heard.row or "SampleCounter" not in names:
                continue
            at = codec_tables.signal_index(name, "SampleCounter")
            if self.tables.field[at]["pieces"]:
                count = codec.extract(self.tables, at, payload) + 1
                codec.insert(self.tables, at, payload, count % SAMPLES)
        if self.secured:
            self.jump(payload, 1)
        return payload

    @staticmethod
    def jump(payload: NDArray[np.uint8], ahead: int) -> None:
        """Advance the freshness value in a payload; its MAC stays what it is."""
        at = slice(authentication.STARTS_AT, authentication.MAC_AT)
        freshness = int.from_bytes(payload[at].tobytes(), "big") + ahead
        payload[at] = list((freshness % authentication.COUNTS**2).to_bytes(6, "big"))

    def finished(self, row: int, payload: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Give a payload the next counter and the right checksum of the end-to-end protection."""
        tables = self.tables
        count = e2e.counter_of(tables.protection[row], payload) + 1
        e2e.protect(tables.protection[row], count, payload)
        return payload

    def forged(self, row: int, payload: NDArray[np.uint8], delay_ns: int = 0) -> Forged:
        """A frame of the right length and format."""
        message = self.tables.message[row]
        length, flags = int(message["length"]), int(message["flags"])
        return Forged(row, length, flags, payload, delay_ns)


Forge = Callable[[Ear], Iterator[Forged]]
"""What an attacker sends in a millisecond, from what it knows."""


class AttackedWorld(World):
    """A world with an attacker on its bus once :meth:`attack` was called.

    ``sent`` counts the attacker's frames; ``arrivals`` says of each frame that the last
    :meth:`advance` has returned whether it is the attacker's.
    """

    def attack(self, forge: Forge, start_ns: int, *, seed: int) -> None:
        """Start ``forge`` at ``start_ns``; it listens from now on."""
        memory = self.parts.memory[0]
        frames = memory["frames"]
        fault_parts.add_attackers(frames, self.network)
        at_ecu, at_actuator = int(frames["attacker_at_ecu"]), int(frames["attacker_at_actuator"])
        self._nodes = at_ecu, at_actuator
        segments = self.network.nodes["segment"]
        one_for_all = segments[at_ecu] == segments[at_actuator]
        self._senders = (at_ecu,) if one_for_all else self._nodes
        self._forge, self._start_ns = forge, start_ns
        self._cursor = 0
        self.sent = 0
        self.arrivals: list[bool] = []
        secured = bool(memory["authentication"]["flag"]["enabled"])
        tables = Codec(*(memory["tables"][name] for name in Codec._fields))
        self.ear = Ear(tables, secured, np.random.default_rng([seed, 77]))

    def advance(self, until_ns: int) -> NDArray[np.void]:
        """Advance by milliseconds, with the attacker's turn after each."""
        received = [np.zeros(0, FRAME)]
        while self.now_ns < until_ns:
            received.append(super().advance(min(self.now_ns + STEP_NS, until_ns)))
            self._turn()
        frames = np.concatenate(received)
        self.arrivals = [bool(forged) for forged in frames["forged"]]
        return frames

    def _turn(self) -> None:
        ear = self.ear
        entries, self._cursor, _ = can_bus.drain(self.network, self._cursor)
        ear.now_ns = self.now_ns
        ear.new = [heard for heard in map(self._heard, entries) if heard is not None]
        ear.all += ear.new
        if self.now_ns < self._start_ns:
            return
        for frame in self._forge(ear):
            self.inject(frame)

    def _heard(self, entry: np.void) -> Heard | None:
        """The genuine frame of ours that an entry of the bus's log is, if it is one."""
        flags = int(entry["flags"]) & ~SENDER_STATE
        key = int(entry["ident"]) | (EXTENDED_KEY if flags & EXTENDED else 0)
        row = row_of(self.ear.tables, key)
        if (
            row < 0
            or flags != self.ear.tables.message[row]["flags"]
            or entry["outcome"] != can_bus.DELIVERED
            or int(entry["sender"]) in self._nodes
        ):
            return None
        payload = np.zeros(MAX_PAYLOAD, np.uint8)
        length = int(entry["length"])
        payload[:length] = entry["payload"][:length]
        return Heard(int(entry["t_received"]), row, length, flags, payload)

    def inject(self, frame: Forged) -> None:
        """Queue a frame at the attacker's nodes."""
        ident = int(self.ear.tables.message[frame.row]["ident"])
        for node in self._senders:
            can_bus.enqueue(
                self.network,
                node,
                self.now_ns + frame.delay_ns,
                ident,
                frame.length,
                frame.payload,
                frame.flags,
            )
        self.sent += 1
