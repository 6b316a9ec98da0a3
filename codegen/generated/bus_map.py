"""Mapping of DBC signals to fields of the ECU's record, with conversion.

A map file (TOML, see ``dbc/roll_control.toml``) names the frame for each mailbox of the firmware
and the field for each signal. Units are converted here: a DBC may use deg/s or km/h, the fields
are SI. :func:`load` resolves a DBC and its map into :class:`Mailbox` tables, or reports
which key of which file is wrong.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cantools.database import Database, Message

import dbc
from canroll import documents
from canroll.errors import CanrollError, UnknownNameError, reason
from codegen.generated.frame_protection import Protection, protection
from codegen.generated.mailbox_frame import OVERRIDES, frame_of, period_ms
from codegen.generated.mapped_signal import MappedSignal, RawSignal, bits_of, map_signal
from codegen.generated.multiplexing import (
    all_pages,
    pages,
    refuse_several,
    refuse_unset,
    selector,
)
from codegen.generated.signal_code import local_name
from dbc.reader import network
from firmware.security.secoc_state import MAC_AT, PAYLOAD, SECURED

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
TABLES = ("receive", "transmit", "xcp", "uds", "secoc")
IN_TURN = "diagnostics"
"""The one mailbox that sends the pages of its frame in turn."""
FRESHNESS, AUTHENTICATOR = "Freshness", "Authenticator"
"""Names of the signals behind an authenticated frame, unless the map has others."""
OF_SECOC = {"freshness": (FRESHNESS, PAYLOAD), "authenticator": (AUTHENTICATOR, MAC_AT)}
"""Keys of [secoc]: the signal's usual name, and the byte where its four begin, high byte first."""
EXTENDED = 1 << 30


@dataclass(frozen=True, slots=True)
class Mailbox:
    """One mailbox of the firmware and its frame; an empty ``name`` means an unused mailbox.

    ``pages`` are the values of the multiplexer ``selector`` that the mailbox receives or sends;
    both are empty where no signal in use is multiplexed. ``cycle`` is the number of pages that the
    message has. ``fd``: a CAN FD frame, with ``bit_rate_switch`` its data phase is the faster one.
    ``cycle_ms`` is the time between two frames, 0 where neither DBC nor map states it. ``secured``:
    freshness value and MAC follow the ``length`` bytes on the wire.
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
    cycle_ms: int = 0
    secured: bool = False

    def count(self, payload: Sequence[int]) -> int:
        """The counter in a frame; 0 where it has none."""
        counter = self.protection.counter if self.protection else None
        if counter is None:
            return 0
        return int(payload[counter.byte]) >> counter.bit & (1 << counter.width) - 1

    @property
    def sent_length(self) -> int:
        """Bytes of its frame on the wire; a CAN FD frame is padded to the next length code."""
        if self.secured:
            return SECURED
        return dbc.padded(self.length) if self.fd else self.length


def frame_ident(ident: int) -> int:
    """Return an identifier of an A2L, with bit 31 for one of 29 bits, as frames have it here."""
    return ident & ~(1 << 31) | (EXTENDED if ident >> 31 else 0)


@dataclass(frozen=True, slots=True)
class Xcp:
    """XCP on CAN: identifiers (bit 31: a 29-bit one) to and from the ECU, bit rate."""

    master: int
    slave: int
    bitrate: int


@dataclass(frozen=True, slots=True)
class Uds:
    """UDS on CAN: identifiers (bit 31: a 29-bit one) of the tester's frames and the ECU's."""

    request: int
    response: int


@dataclass(frozen=True, slots=True)
class BusMap:
    """All mailboxes, in the order of the firmware's slot numbers; XCP and UDS if the map has them.

    ``warnings`` list defects of the database. ``secured``: its frames are authenticated.
    """

    received: tuple[Mailbox, ...]
    transmitted: tuple[Mailbox, ...]
    xcp: Xcp | None = None
    warnings: tuple[str, ...] = ()
    uds: Uds | None = None
    secured: bool = False

    @property
    def protected(self) -> bool:
        """Whether any frame has a checksum or a counter."""
        return any(box.protection for box in (*self.received, *self.transmitted))

    @property
    def frames(self) -> tuple[Mailbox, ...]:
        """The mailboxes that have a frame."""
        return tuple(box for box in (*self.received, *self.transmitted) if box.name)

    @property
    def echoed(self) -> tuple[bool, ...]:
        """For each sent frame, whether the actuators echo its counter and report holding it."""
        state = self.received[RECEIVED.index("actuator_state")]
        taken = {signal.place.text for signal in state.signals}
        echo = {"accepted_counter", "command_held"} <= taken
        return tuple(echo and _counts(box) > 0 for box in self.transmitted)


def _counts(box: Mailbox) -> int:
    """Number of values of a frame's counter, 0 if it has none."""
    counter = box.protection.counter if box.protection else None
    return counter.values if counter else 0


def load(dbc_file: Path, map_file: Path) -> BusMap:
    """Return the mailboxes that ``dbc_file`` and ``map_file`` describe.

    Raises CanrollError, naming file and key, for any inconsistency.
    """
    description = network(dbc_file)
    database = description.database
    try:
        document = documents.toml(map_file)
    except (OSError, ValueError) as error:
        raise CanrollError(f"{map_file}: {reason(error)}") from error
    if document.get("schema") != 1:
        raise CanrollError(f"{map_file}: schema must be 1, not {document.get('schema')!r}")
    for key, value in document.items():
        if key not in ("schema", *TABLES):
            raise UnknownNameError(f"table in {map_file}", key, TABLES)
        if key in TABLES:
            documents.table(value, f"{map_file}: {key}")
    secoc = _secoc(document["secoc"], map_file) if "secoc" in document else None
    boxes = {}
    for direction, slots in (("receive", RECEIVED), ("transmit", TRANSMITTED)):
        tables = document.get(direction, {})
        for slot in tables:
            if slot not in slots:
                raise UnknownNameError(f"mailbox [{direction}.…] in {map_file}", slot, slots)
        try:
            boxes[direction] = tuple(
                _mailbox(database, map_file, direction, slot, tables.get(slot), secoc)
                for slot in slots
            )
        except UnknownNameError as error:
            unread = description.unread(error.name)
            if not unread:
                raise
            raise CanrollError(f"{dbc_file}: {error.name} cannot be read: {unread}") from error
    taken = {m.frame_id | m.is_extended_frame << 31: m.name for m in database.messages}
    for box in (*boxes["receive"], *boxes["transmit"]):
        if box.name:
            wide = bool(box.ident & EXTENDED)
            taken[box.ident & (EXTENDED - 1) | wide << 31] = box.name
    xcp = uds = None
    if "xcp" in document:
        keys = ("master", "slave", "bitrate")
        xcp = Xcp(**_numbers("xcp", keys, document["xcp"], taken, map_file))
    if "uds" in document:
        pair = ("request", "response")
        uds = Uds(**_numbers("uds", pair, document["uds"], taken, map_file))
    bus = BusMap(
        boxes["receive"], boxes["transmit"], xcp, description.warnings, uds, secoc is not None
    )
    _refuse_same_identifier(bus, map_file)
    _refuse_short_echo(bus, map_file)
    if bus.secured:
        _refuse_shared(bus, map_file)
    return bus


def _refuse_same_identifier(bus: BusMap, map_file: Path) -> None:
    """Refuse two messages with one identifier: which of them a frame is cannot be told."""
    names: dict[int, str] = {}
    for box in bus.frames:
        other = names.setdefault(box.ident, box.name)
        if other != box.name:
            raise CanrollError(
                f"{map_file}: {other} and {box.name} have the identifier "
                f"0x{box.ident & (EXTENDED - 1):X}"
            )


def _numbers(
    section: str,
    names: Sequence[str],
    table: Mapping[str, Any],
    taken: Mapping[int, str],
    map_file: Path,
) -> dict[str, int]:
    """Return the whole numbers of a table, the first two of them not identifiers in ``taken``."""
    for key in table:
        if key not in names:
            raise UnknownNameError(f"key in {map_file} [{section}]", key, names)
    for key in names:
        value = table.get(key)
        if not isinstance(value, int) or not 0 < value < 1 << 32:
            raise CanrollError(
                f"{map_file} [{section}]: {key} must be a whole number, not {value!r}"
            )
    for key in names[:2]:
        if table[key] in taken:
            raise CanrollError(
                f"{map_file} [{section}]: {key} 0x{table[key]:X} is the identifier of "
                f"{taken[table[key]]}"
            )
    return dict(table)


def _refuse_short_echo(bus: BusMap, map_file: Path) -> None:
    """The echo of a counter must be wide enough for all its values."""
    for signal in bus.received[RECEIVED.index("actuator_state")].signals:
        if signal.place.text == "accepted_counter":
            for box, echoed in zip(bus.transmitted, bus.echoed, strict=True):
                if echoed and box.slot in COMMANDS and _counts(box) > 1 << signal.length:
                    raise CanrollError(
                        f"{map_file} [receive.actuator_state]: {signal.name} has {signal.length} "
                        f"bits and cannot echo the {_counts(box)} counter values of {box.name}"
                    )


def _secoc(table: Mapping[str, Any], map_file: Path) -> dict[int, str]:
    """Return the names of the two signals behind an authenticated frame, by their first byte."""
    for key in table:
        if key not in OF_SECOC:
            raise UnknownNameError(f"key in {map_file} [secoc]", key, OF_SECOC)
    found = {at: table.get(key, name) for key, (name, at) in OF_SECOC.items()}
    for name in found.values():
        if not isinstance(name, str):
            raise CanrollError(f"{map_file} [secoc]: {name!r} must be the name of a signal")
    return found


def _refuse_unsecured(message: Message, secoc: Mapping[int, str], where: str) -> None:
    """Refuse a frame that cannot be authenticated as the firmware does it."""
    if not message.is_fd or message.length != SECURED:
        raise CanrollError(
            f"{where}: {message.name} must be a CAN FD frame of {SECURED} bytes to be "
            "authenticated: change it in the DBC, or remove [secoc]"
        )
    known = {signal.name: signal for signal in message.signals}
    for first, name in secoc.items():
        if name not in known:
            raise UnknownNameError(f"signal of {message.name} in {where} [secoc]", name, known)
        if bits_of(known[name]) != [8 * (first + 3 - k // 8) + k % 8 for k in range(32)]:
            raise CanrollError(
                f"{where}: {name} must be bytes {first} to {first + 3}, the highest first"
            )


def _refuse_unnamed(its: Protection | None, name: str, where: str) -> None:
    """Refuse an authenticated frame that nothing distinguishes from others of the same bytes."""
    if its is None or its.profile != "1" or its.length != PAYLOAD:
        raise CanrollError(
            f"{where}: {name} needs a data id of E2E profile 1 over {8 * PAYLOAD} bits to be "
            "authenticated: set E2EDataId and E2EDataLength in the DBC"
        )


def _refuse_shared(bus: BusMap, map_file: Path) -> None:
    """Refuse an authenticated frame for several mailboxes: it is verified once."""
    found: dict[int, str] = {}
    for box in bus.frames:
        other = found.setdefault(box.ident, box.slot)
        if other != box.slot:
            raise CanrollError(
                f"{map_file} [secoc]: {box.name} is in the mailboxes {other} and {box.slot}: an "
                "authenticated frame can be in one only"
            )


def _mailbox(  # noqa: PLR0917
    database: Database,
    map_file: Path,
    direction: str,
    slot: str,
    table: Mapping[str, Any] | None,
    secoc: Mapping[int, str] | None,
) -> Mailbox:
    where = f"{map_file} [{direction}.{slot}]"
    if table is None:
        return Mailbox(slot)
    for key in documents.table(table, where):
        if key not in OF_A_MAILBOX:
            raise UnknownNameError(f"key in {where}", key, OF_A_MAILBOX)
    message = frame_of(database, table, where)
    name = message.name
    if secoc is not None:
        _refuse_unsecured(message, secoc, where)
    known = {signal.name: signal for signal in message.signals}
    mapped = []
    signals = documents.table(table.get("signals", {}), f"{where} signals")
    for signal_name, entry in signals.items():
        mapped.append(map_signal(signal_name, entry, known, f"{where} {signal_name}"))
    used = {part.name for signal in mapped for part in signal.parts}
    _refuse_namesakes(message, used, where)
    choice = selector(message, used, where, sent=direction == "transmit")
    chosen = pages(mapped)
    if slot != IN_TURN:
        refuse_several(message, chosen, where)
    if direction == "transmit":
        refuse_unset(message, mapped, where)
    if direction == "receive":
        taken = {signal.place.text for signal in mapped}
        if slot != "roll_reference" and not taken & set(VALID_BITS[slot]):
            raise CanrollError(f"{where}: maps none of {', '.join(VALID_BITS[slot])}")
        if any(signal.place.mask is not None for signal in mapped):
            raise CanrollError(f"{where}: a mask applies to transmitted frames only")
    if choice:
        used.add(choice.name)
    _refuse_like_names(used, where)
    _refuse_stray_bits(message, used, direction, where)
    its = protection(message, table.get("protection"), used, where)
    if secoc is not None:
        _refuse_unnamed(its, name, where)
    ident = message.frame_id | (EXTENDED if message.is_extended_frame else 0)
    return Mailbox(
        slot=slot,
        name=name,
        comment=message.comment or "",
        ident=ident,
        length=message.length if secoc is None else PAYLOAD,
        protection=its,
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


def _refuse_stray_bits(message: Message, used: Collection[str], direction: str, where: str) -> None:
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
            if direction == "transmit" and other != signal.name:
                raise CanrollError(f"{where}: {signal.name} and {other} share bit {bit}")
