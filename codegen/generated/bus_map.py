"""Mapping of DBC signals to fields of the ECU's record, with conversion.

A map file (TOML, see ``dbc/roll_control.toml``) names the frame for each mailbox of the firmware
and the field for each signal. Units are converted here: a DBC may use deg/s or km/h, the fields
are SI. :func:`load` resolves a DBC and its map into :class:`Mailbox` tables, or reports
which key of which file is wrong.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from canroll import documents
from canroll.codegen.generated.authenticated_frames import names_of
from canroll.codegen.generated.mailbox import (
    COMMANDS,
    EXTENDED,
    RECEIVED,
    TRANSMITTED,
    Frames,
    Mailbox,
    received,
    transmitted,
)
from canroll.dbc.reader import Files, network
from canroll.errors import CanrollError, UnknownNameError, reason

TABLES = ("receive", "transmit", "xcp", "uds", "secoc")


def frame_ident(ident: int) -> int:
    """Return an identifier of an A2L, with bit 31 for one of 29 bits, as frames have it here."""
    return ident & ~(1 << 31) | (EXTENDED if ident >> 31 else 0)


MOST_LISTED = 32
"""Frames of measurements that the XCP slave sends after a tick at most."""


@dataclass(frozen=True, slots=True)
class XcpFrames:
    """XCP on CAN: identifiers (bit 31: a 29-bit one) to and from the ECU, bit rate."""

    master: int
    slave: int
    bitrate: int


@dataclass(frozen=True, slots=True)
class UdsFrames:
    """UDS on CAN: identifiers (bit 31: a 29-bit one) of the tester's frames and the ECU's."""

    request: int
    response: int


@dataclass(frozen=True, slots=True)
class BusMap:
    """All mailboxes, in the order of the firmware's slot numbers; XCP and UDS if the map has them.

    ``received`` begins with the first frame of each message; the further ones follow. ``warnings``
    list defects of the database. ``secured``: its frames are authenticated.
    """

    received: tuple[Mailbox, ...]
    transmitted: tuple[Mailbox, ...]
    xcp: XcpFrames | None = None
    warnings: tuple[str, ...] = ()
    uds: UdsFrames | None = None
    secured: bool = False

    @property
    def protected(self) -> bool:
        """Whether any frame has a checksum or a counter."""
        return any(box.protection for box in (*self.received, *self.transmitted))

    @property
    def frames(self) -> tuple[Mailbox, ...]:
        """The mailboxes that have a frame."""
        return tuple(box for box in (*self.received, *self.transmitted) if box.name)

    def frames_of(self, slot: str) -> tuple[Mailbox, ...]:
        """The frames of a received message, the first one first; empty where it has none."""
        return tuple(box for box in self.received if box.slot == slot and box.name)

    @property
    def echoed(self) -> tuple[bool, ...]:
        """For each sent frame, whether the actuators echo its counter and report holding it."""
        taken = {s.place.text for box in self.frames_of("actuator_state") for s in box.signals}
        echo = {"accepted_counter", "command_held"} <= taken
        return tuple(echo and _counts(box) > 0 for box in self.transmitted)


def _counts(box: Mailbox) -> int:
    """Number of values of a frame's counter, 0 if it has none."""
    counter = box.protection.counter if box.protection else None
    return counter.values if counter else 0


def load(files: Files, map_file: Path) -> BusMap:
    """Return the mailboxes that the description in ``files`` and ``map_file`` describe.

    Raises CanrollError, naming file and key, for any inconsistency.
    """
    description = network(files)
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
    secoc = names_of(document["secoc"], map_file) if "secoc" in document else None
    frames = Frames(description, map_file, secoc)
    try:
        heard = _tables(document, "receive", RECEIVED, map_file)
        of_messages = [received(frames, slot, heard.get(slot)) for slot in RECEIVED]
        sent = _tables(document, "transmit", TRANSMITTED, map_file)
        out = tuple(transmitted(frames, slot, sent.get(slot)) for slot in TRANSMITTED)
    except UnknownNameError as error:
        unread = description.unread(error.name)
        if not unread:
            raise
        raise CanrollError(unread) from error
    first = tuple(boxes[0] for boxes in of_messages)
    further = tuple(box for boxes in of_messages for box in boxes[1:])
    messages = description.database.messages
    taken = {m.frame_id | m.is_extended_frame << 31: m.name for m in messages}
    for box in (*first, *further, *out):
        if box.name:
            wide = bool(box.ident & EXTENDED)
            taken[box.ident & (EXTENDED - 1) | wide << 31] = box.name
    xcp = uds = None
    if "xcp" in document:
        keys = ("master", "slave", "bitrate")
        xcp = XcpFrames(**_numbers("xcp", keys, document["xcp"], taken, map_file))
    if "uds" in document:
        pair = ("request", "response")
        uds = UdsFrames(**_numbers("uds", pair, document["uds"], taken, map_file))
    boxes = (*first, *further)
    limits = tuple(signal.warning for box in boxes for signal in box.signals if signal.warning)
    warnings = description.warnings + limits
    bus = BusMap(boxes, out, xcp, warnings, uds, secoc is not None)
    _refuse_same_identifier(bus, map_file)
    _refuse_short_echo(bus, map_file)
    if bus.secured:
        _refuse_shared(bus, map_file)
    return bus


def _tables(
    document: Mapping[str, Any], direction: str, slots: Sequence[str], map_file: Path
) -> Mapping[str, Any]:
    """The mailboxes of a direction in a map, by name."""
    tables: Mapping[str, Any] = document.get(direction, {})
    documents.refuse_unknown(tables, slots, f"mailbox [{direction}.…] in {map_file}")
    return tables


def _refuse_same_identifier(bus: BusMap, map_file: Path) -> None:
    """Refuse two messages with one identifier: which of them a frame is cannot be told."""
    names: dict[int, str] = {}
    for box in bus.frames:
        other = names.setdefault(box.ident, box.name)
        if box in bus.transmitted and [its.ident for its in bus.frames].count(box.ident) > 1:
            raise CanrollError(
                f"{map_file}: {box.name}, which the ECU sends, is in several mailboxes"
            )
        if other != box.name:
            raise CanrollError(
                f"{map_file}: {other} and {box.name} have the identifier "
                f"0x{box.ident & (EXTENDED - 1):X}"
            )


def _refuse_short_echo(bus: BusMap, map_file: Path) -> None:
    """The echo of a counter must be wide enough for all its values."""
    for signal in (s for box in bus.frames_of("actuator_state") for s in box.signals):
        if signal.place.text == "accepted_counter":
            for box, echoed in zip(bus.transmitted, bus.echoed, strict=True):
                if echoed and box.slot in COMMANDS and _counts(box) > 1 << signal.length:
                    raise CanrollError(
                        f"{map_file} [receive.actuator_state]: {signal.name} has {signal.length} "
                        f"bits and cannot echo the {_counts(box)} counter values of {box.name}"
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


def _numbers(
    section: str,
    names: Sequence[str],
    table: Mapping[str, Any],
    taken: Mapping[int, str],
    map_file: Path,
) -> dict[str, int]:
    """Return the whole numbers of a table, the first two of them not identifiers in ``taken``."""
    documents.refuse_unknown(table, names, f"key in {map_file} [{section}]")
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
