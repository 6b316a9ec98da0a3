"""One mailbox of the firmware: the frame in it, its signals, fields, pages and protection."""

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cantools.database import Message

from canroll import dbc, documents
from canroll.codegen.frame.frame_protection import Protection, protection
from canroll.codegen.frame.raw_signal import RawSignal, bits_of
from canroll.codegen.generated.authenticated_frames import refuse_unnamed, refuse_unsecured
from canroll.codegen.generated.mailbox_frame import OVERRIDES, frame_of, period_ms
from canroll.codegen.generated.mapped_signal import (
    MappedSignal,
    map_signal,
    refuse_received_only,
    refuse_sent_only,
)
from canroll.codegen.generated.multiplexing import (
    all_pages,
    pages,
    refuse_several,
    refuse_unset,
    selector,
)
from canroll.codegen.generated.second_signals import valid_codes
from canroll.codegen.generated.signal_code import local_name
from canroll.dbc.reader import NetworkDescription
from canroll.errors import CanrollError
from canroll.firmware.security.secoc_state import PAYLOAD, SECURED
from canroll.firmware.state import REST

RECEIVED = (
    "imu",
    "vehicle_motion",
    "suspension_rate",
    "actuator_state",
    "roll_reference",
)
TRANSMITTED = ("suspension_force", "anti_roll_bar", "damper", "valve", "status", "diagnostics")
SAMPLE_COUNTERS = {
    "imu": "imu_sample",
    "vehicle_motion": "motion_sample",
    "suspension_rate": "rate_sample",
    "actuator_state": "actuator_sample",
    "roll_reference": "reference_sample",
}
# The order is that of the bits of ecu.valid: the firmware asks for them by number.
VALID_BITS = {
    "imu": ("roll_rate", "lateral_acceleration", "yaw_rate"),
    "vehicle_motion": ("speed", "steering"),
    "suspension_rate": tuple(f"stroke_rate[{corner}]" for corner in range(4)),
    "actuator_state": ("delivered[0]", "delivered[1]"),
    "roll_reference": ("reference_roll", "reference_rate", "reference_acceleration"),
}
COMMANDS = ("suspension_force", "anti_roll_bar", "damper", "valve")
OF_A_MAILBOX = ("message", "signals", "protection", "cycle_ms", *OVERRIDES)
IN_TURN = "diagnostics"
"""The one mailbox that sends the pages of its frame in turn."""
WORD = 8
"""Bytes of a frame that are one number."""
EXTENDED = 1 << 30


@dataclass(frozen=True, slots=True)
class Mailbox:
    """One mailbox of the firmware and its frame; an empty ``name`` means an unused mailbox.

    ``pages`` are the values of the multiplexer ``selector`` that the mailbox receives or sends;
    both are empty where no signal in use is multiplexed. ``cycle`` is the number of pages that the
    message has. ``fd``: a CAN FD frame, with ``bit_rate_switch`` its data phase is the faster one.
    ``cycle_ms`` is the time between two frames, 0 where neither DBC nor map states it. ``secured``:
    freshness value and MAC follow the ``length`` bytes on the wire. ``further``: 0 for the first
    frame of a received message, from 1 on for its others.
    """

    slot: str
    name: str = ""
    comment: str = ""
    ident: int = 0
    length: int = 0
    protection: Protection | None = None
    signals: tuple[MappedSignal, ...] = ()
    selector: RawSignal | None = None
    pages: tuple[int, ...] = ()
    cycle: int = 1
    fd: bool = False
    bit_rate_switch: bool = False
    cycle_ms: float = 0
    secured: bool = False
    further: int = 0

    @property
    def bits(self) -> int:
        """The signals of a received frame, as bits of ecu.valid."""
        fields = {signal.place.text for signal in self.signals}
        own = sum(1 << k for k, name in enumerate(VALID_BITS[self.slot]) if name in fields)
        return own or (REST if self.further else 0)

    @property
    def is_long(self) -> bool:
        """Whether the frame needs more than one word."""
        return self.length > WORD

    @property
    def frame_words(self) -> tuple[str, ...]:
        """The locals that hold the words of the frame."""
        if not self.is_long:
            return ("frame",)
        return tuple(f"frame_{word}" for word in range(-(-self.length // WORD)))

    @property
    def identified(self) -> str:
        """Name and identifier of the frame."""
        name = re.sub(r"\W", "_", self.name)  # in a text of code: formats allow any character
        return f"{name} (0x{self.ident:X})"

    def count(self, payload: Sequence[int]) -> int:
        """The counter in a frame; 0 where it has none."""
        counter = self.protection.counter if self.protection else None
        return counter.read(payload) if counter else 0

    @property
    def sent_length(self) -> int:
        """Bytes of its frame on the wire; a CAN FD frame is padded to the next length code."""
        if self.secured:
            return SECURED
        return dbc.padded(self.length) if self.fd else self.length


@dataclass(frozen=True, slots=True)
class Frames:
    """The frames that a map may put into mailboxes.

    Attributes:
        network: their description.
        map_file: the map.
        secoc: names of the signals of authenticated frames, None where they are not.
    """

    network: NetworkDescription
    map_file: Path
    secoc: Mapping[int, str] | None


def room(boxes: Iterable[Mailbox]) -> int:
    """Return the bytes of each mailbox: whole words, one at least."""
    longest = max((box.sent_length for box in boxes), default=0)
    return max(WORD, -(-longest // WORD) * WORD)


def received(
    frames: Frames, slot: str, entry: Mapping[str, Any] | list[Any] | None
) -> tuple[Mailbox, ...]:
    """Return the frames of a received message: the first, empty without an entry, then others.

    The first one is that of the message's first signal: its samples are the message's.

    Args:
        frames: those that it may have.
        slot: name of the message.
        entry: its table in the map, or a list of them, one for each frame.

    Raises:
        CanrollError: a key is invalid, or frames contradict each other.
    """
    where = f"{frames.map_file} [receive.{slot}]"
    if entry is None:
        return (Mailbox(slot),)
    if not isinstance(entry, list):
        boxes = [_mailbox(frames, where, slot, entry, sent=False)]
    else:
        if not entry:
            raise CanrollError(f"{where}: has no frame")
        boxes = [
            _mailbox(frames, f"{where} {number}", slot, table, sent=False)
            for number, table in enumerate(entry, start=1)
        ]
    if not any(box.bits for box in boxes):
        raise CanrollError(f"{where}: maps none of {', '.join(VALID_BITS[slot])}")
    boxes.sort(key=lambda box: box.bits & -box.bits or math.inf)
    _refuse_contradictions(boxes, where)
    return tuple(replace(box, further=number) for number, box in enumerate(boxes))


def _refuse_contradictions(boxes: Sequence[Mailbox], where: str) -> None:
    """Refuse frames of one message that the firmware could not tell apart or put together."""
    names: dict[str, str] = {}
    for box in boxes:
        if [other.name for other in boxes].count(box.name) > 1:
            raise CanrollError(
                f"{where}: {box.name} is there twice: put its signals, those of one page, in one "
                "table"
            )
        if not box.signals:
            raise CanrollError(f"{where}: maps no signal of {box.name}")
        for text in {signal.place.text for signal in box.signals}:
            other = names.setdefault(text, box.name)
            if other != box.name:
                raise CanrollError(f"{where}: {text} is mapped in {other} and in {box.name}")
    counter = names.get(SAMPLE_COUNTERS[boxes[0].slot], boxes[0].name)
    if counter != boxes[0].name:
        raise CanrollError(
            f"{where}: {SAMPLE_COUNTERS[boxes[0].slot]} must be in {boxes[0].name}, whose samples "
            f"it counts, not in {counter}"
        )
    twins = [box.name for box in boxes if any(signal.twin for signal in box.signals)]
    if len(twins) > 1:
        raise CanrollError(
            f"{where}: signals with a redundant or inverted one must be in one frame, not in "
            f"{' and '.join(twins)}"
        )


def transmitted(frames: Frames, slot: str, table: Mapping[str, Any] | None) -> Mailbox:
    """Return the mailbox of a frame that is sent, empty without a table in the map.

    Args and errors as of :func:`received`.
    """
    if table is None:
        return Mailbox(slot)
    return _mailbox(frames, f"{frames.map_file} [transmit.{slot}]", slot, table, sent=True)


def _mailbox(frames: Frames, where: str, slot: str, table: object, *, sent: bool) -> Mailbox:
    secoc = frames.secoc
    table = documents.table(table, where)
    documents.refuse_unknown(table, OF_A_MAILBOX, f"key in {where}")
    message = frame_of(frames.network, table, where)
    name = message.name
    if secoc is not None:
        refuse_unsecured(message, secoc, where)
    known = {signal.name: signal for signal in message.signals}
    mapped = []
    signals = documents.table(table.get("signals", {}), f"{where} signals")
    for signal_name, entry in signals.items():
        mapped.append(map_signal(signal_name, entry, known, f"{where} {signal_name}", sent=sent))
    used = {part.name for signal in mapped for part in signal.parts}
    _refuse_namesakes(message, used, where)
    choice = selector(message, used, where, sent=sent)
    chosen = pages(mapped)
    if slot != IN_TURN:
        refuse_several(message, chosen, where)
    if sent:
        refuse_unset(message, mapped, where)
        refuse_sent_only(mapped, where)
    else:
        refuse_received_only(mapped, where)
        for shared, codes in valid_codes(mapped).items():
            if not codes:
                raise CanrollError(f"{where}: no code of {shared} says of all its signals: valid")
    if choice:
        used.add(choice.name)
    _refuse_like_names(used, where)
    _refuse_stray_bits(message, used, where, sent=sent)
    guard = protection(message, table.get("protection"), used, where, frames.map_file.parent)
    if secoc is not None:
        refuse_unnamed(guard, name, where)
    ident = message.frame_id | (EXTENDED if message.is_extended_frame else 0)
    return Mailbox(
        slot=slot,
        name=name,
        comment=message.comment or "",
        ident=ident,
        length=message.length if secoc is None else PAYLOAD,
        protection=guard,
        signals=tuple(sorted(mapped, key=lambda signal: signal.page or 0)),
        selector=choice if chosen else None,
        pages=chosen,
        cycle=len(all_pages(message)) if chosen else 1,
        fd=bool(message.is_fd),
        bit_rate_switch=dbc.switches_bit_rate(message),
        cycle_ms=period_ms(message, table, where),
        secured=secoc is not None,
    )


def _refuse_namesakes(message: Message, used: Collection[str], where: str) -> None:
    """Refuse a signal in use that has a namesake in its frame."""
    names = [signal.name for signal in message.signals]
    for name in sorted(used):
        if names.count(name) > 1:
            raise CanrollError(
                f"{where}: {names.count(name)} signals of {message.name} are named {name}: rename "
                "all but one in the DBC"
            )


def _refuse_like_names(used: Collection[str], where: str) -> None:
    """Refuse signals that have one name in the code, where names are in lower case."""
    names: dict[str, str] = {}
    for name in sorted(used):
        other = names.setdefault(local_name(name), name)
        if other != name:
            raise CanrollError(
                f"{where}: {other} and {name} are one name in the code, {local_name(name)}: map "
                "one of them"
            )


def _refuse_stray_bits(message: Message, used: Collection[str], where: str, *, sent: bool) -> None:
    """Refuse a signal outside the frame, or one that shares bits in a frame that is sent."""
    taken: dict[tuple[int, int | None], str] = {}
    for signal in message.signals:
        if signal.name not in used:
            continue
        for bit in bits_of(signal):
            if not 0 <= bit < 8 * message.length:
                raise CanrollError(
                    f"{where}: {signal.name} has bits outside the {message.length} bytes of "
                    f"{message.name}"
                )
            page = signal.multiplexer_ids[0] if signal.multiplexer_ids else None
            other = taken.setdefault((bit, page), signal.name)
            if sent and other != signal.name:
                raise CanrollError(f"{where}: {signal.name} and {other} share bit {bit}")
