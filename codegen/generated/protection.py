"""firmware/com/protection.py from a DBC and its map: checksums and counters as subset code.

    python -m codegen.generated.protection [--check]

writes (or compares) the checked-in module for ``dbc/roll_control.dbc``. Frames with the
same protection share functions, and only the tables that a bus needs are written.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from codegen.frame.checksum import Bits, OwnChecksum
from codegen.frame.checksum_code import (
    WRITTEN_OUT,
    Writer,
    crc_tables,
    list_name,
    number_text,
    result_kind,
)
from codegen.frame.frame_protection import Protection
from codegen.frame.own_checksum import modules
from codegen.frame.place import Place
from codegen.generated.bus_map import BusMap, load
from codegen.generated.mailbox import Mailbox
from codegen.generated.signals import DBC, MAP, ROOT, write_or_check
from dbc.reader import Files, file_names

PROTECTION = ROOT / "firmware" / "com" / "protection.py"

HEADER = '''\
"""Checksums and counters of the frames; made by codegen.generated.protection, not to be edited.

Frames of {names}.
``check`` judges a received frame, ``protect`` finishes one to be sent.
"""

from typing import Annotated

from firmware.calibration import Calibration
from firmware.com import e2e
'''
CHECKED = "ecu: Ecu, cal: Calibration, message: i32, slot: i32"


@dataclass(frozen=True, slots=True)
class Scheme:
    """Frames whose protection is the same but for their identity."""

    number: int
    its: Protection

    @property
    def payload(self) -> str:
        """The parameter that passes the bytes of a frame to its functions."""
        own = self.its.checksum.function if self.its.checksum else None
        bytes_ = max(self.its.length, WRITTEN_OUT, own.size if own else 0)
        return f"payload: Annotated[list[u8], {bytes_}]"

    @property
    def summed(self) -> bool:
        """Whether its checksum covers the identity of the frame."""
        return self.its.checksum is not None and self.its.checksum.identified

    def checksum(self, payload: str) -> str:
        """The call that gives the checksum of a frame."""
        assert self.its.checksum is not None
        own = self.its.checksum.function
        name = own.name if own else f"checksum_{self.number}"
        return f"{name}({payload}{', identity' if self.summed else ''})"

    def counter(self, payload: str) -> str:
        """The counter of a frame, ready to be an operand."""
        assert self.its.counter is not None
        return number_text(_read(self.its.counter.held), payload)


def _read(place: Place) -> list[Bits]:
    """The bits of a number as a frame has them."""
    return [Bits("byte", p.byte, (1 << p.width) - 1, p.bit, p.signal_bit) for p in place.pieces]


def own_functions(bus: BusMap) -> dict[str, OwnChecksum]:
    """Functions of the user's own for checksums of a bus, by the module of the firmware.

    Raises:
        CanrollError: two files would be one module.
    """
    sums = [box.protection.checksum for box in bus.frames if box.protection]
    return modules(its.function for its in sums if its is not None and its.function is not None)


def generate(files: Files = DBC, map_file: Path = MAP) -> str:
    """Return the subset source of the protection module for ``files`` and ``map_file``."""
    bus = load(files, map_file)
    found = (*bus.received, *bus.transmitted)
    alike = dict.fromkeys(_alike(box.protection) for box in found if box.protection)
    schemes = [Scheme(number, its) for number, its in enumerate(alike)]
    body = list(_tables(bus, schemes))
    for scheme in schemes:
        if scheme.its.checksum and not scheme.its.checksum.function:
            body += ["", "", *_checksum(scheme)]
        if any(_has(box, scheme) for box in bus.received):
            body += ["", "", *_check(scheme)]
        if any(_has(box, scheme) for box in bus.transmitted):
            body += ["", "", *_protect(scheme)]
    body += ["", "", *_dispatch_check(bus, schemes), "", "", *_dispatch_protect(bus, schemes)]
    header = HEADER.format(names=file_names(files)) + _imports(schemes, body)
    return "\n".join([header, *body]) + "\n"


def _imports(schemes: Sequence[Scheme], body: Sequence[str]) -> str:
    """The imports beside those that every bus needs."""
    own = {
        (s.its.checksum.function.module, s.its.checksum.function.name)
        for s in schemes
        if s.its.checksum and s.its.checksum.function
    }
    lines = [f"from firmware.{module} import {name}" for module, name in sorted(own)]
    text = "\n".join(body)
    words = [word for word in ("i64", "to_i32", "u16", "u32") if word in text]
    lines += ["from firmware.state import Ecu"]
    lines += [f"from firmware.subset import {', '.join(sorted(('byte', 'i32', 'u8', *words)))}", ""]
    return "\n".join(lines)


def _alike(its: Protection) -> Protection:
    return replace(its, identity=0)


def _has(box: Mailbox, scheme: Scheme) -> bool:
    return box.protection is not None and _alike(box.protection) == scheme.its


def _tables(bus: BusMap, schemes: Sequence[Scheme]) -> Iterator[str]:
    yield "# data ids; of each frame sent the highest value of its counter, 0: none"
    for prefix, boxes in (("RX", bus.received), ("TX", bus.transmitted)):
        common = _common(boxes, schemes)
        if bus.secured or (common is not None and common.its.identified):
            ids = ", ".join(str(_plain(box)) for box in boxes)
            yield f"{prefix}_DATA_IDS: tuple[i32, ...] = ({ids})"
    last = [max(_values(box) - 1, 0) for box in bus.transmitted]
    kind = "u8" if max(last) < 256 else "i32"
    yield f"TX_LAST_COUNTERS: tuple[{kind}, ...] = ({', '.join(map(str, last))})"
    yield "# fmt: off"
    tables: dict[str, tuple[str, tuple[int, ...]]] = {}
    for scheme in schemes:
        its = scheme.its.checksum
        if its is not None and its.fold == "crc":
            for name, kind, entries in crc_tables(its, scheme.its.length):
                tables[name] = kind, entries
    for name in sorted(tables):
        yield from _table(name, *tables[name])
    for scheme in schemes:
        for which, values in enumerate(scheme.its.checksum.lists if scheme.its.checksum else ()):
            wide = max(values) > 255
            yield from _table(list_name(scheme.number, which), "i64" if wide else "u8", values)
    yield "# fmt: on"


def _plain(box: Mailbox) -> int:
    """The identity of a frame, of 32 bits as the number that they are in an i32."""
    identity = box.protection.identity if box.protection else 0
    return identity - (1 << 32) if identity >> 31 else identity


def _values(box: Mailbox) -> int:
    counter = box.protection.counter if box.protection else None
    return counter.values if counter else 0


def _table(name: str, kind: str, entries: Sequence[int]) -> Iterator[str]:
    yield f"{name}: tuple[{kind}, ...] = ("
    for start in range(0, len(entries), 16):
        yield f"    {', '.join(str(entry) for entry in entries[start : start + 16])},"
    yield ")"


def _checksum(scheme: Scheme) -> Iterator[str]:
    its, checksum = scheme.its, scheme.its.checksum
    assert checksum is not None
    identity = ", identity: i32" if scheme.summed else ""
    kind = result_kind(checksum)
    yield f"def checksum_{scheme.number}({scheme.payload}{identity}) -> {kind}:"
    yield f'    """Return the checksum of a frame: {_described(its)}."""'
    counter = scheme.counter("payload") if its.counter else ""
    yield from Writer(checksum, its.length, counter, scheme.number).lines()


def _described(its: Protection) -> str:
    return f"E2E profile {its.profile}" if its.profile != "own" else "the manufacturer's own"


def _identity(scheme: Scheme) -> str:
    return ", identity: i32" if scheme.its.identified else ""


def _check(scheme: Scheme) -> Iterator[str]:
    its = scheme.its
    yield f"def check_{scheme.number}({CHECKED}{_identity(scheme)}) -> i32:"
    yield '    """Return 1 where the data of a received frame may be used."""'
    payload = "ecu.rx_payload[slot]"
    if its.counter is not None:
        yield f"    counter: i32 = {_bare(scheme.counter(payload))}"
        if its.counter.values < 1 << its.counter.held.width:
            yield f"    if counter >= {its.counter.values}:"
            yield "        return 0"
    for field in its.carried:
        value = "identity" if field.value is None else str(field.value)
        yield from _differs(field.place, payload, value, field.shift)
    if its.checksum is not None:
        kind = result_kind(its.checksum)
        yield f"    expected: {kind} = {scheme.checksum(payload)}"
        exact = its.checksum.function is None
        yield from _differs(its.checksum.place, payload, "expected", exact=exact)
    if its.counter is None:
        yield "    return 1"
        return
    receiver = "resynchronised" if its.resynchronises else "in_sequence"
    values = its.counter.values
    yield f"    return e2e.{receiver}(ecu, cal, message, counter, {values})"


def _bare(text: str) -> str:
    """An expression without brackets around it."""
    return text[1:-1] if text.startswith("(") and "(" not in text[1:] else text


def _part(value: str, shift: int, width: int) -> str:
    """``width`` bits of a value from ``shift`` up."""
    low = (1 << width) - 1
    if value.isdigit():
        return str(int(value) >> shift & low)
    return f"({value} >> {shift}) & {low}" if shift else f"{value} & {low}"


def _differs(
    place: Place, payload: str, value: str, shift: int = 0, *, exact: bool = False
) -> Iterator[str]:
    """Return 0 where a number in the frame is another; an ``exact`` one has no further bits."""
    for bits in _read(place):
        width = bits.mask.bit_length()
        found = number_text([replace(bits, left=0)], payload)
        text = _part(value, shift + bits.left, width)
        if exact and place.width == width:
            text = value
        yield f"    if {text if text.isidentifier() or text.isdigit() else f'({text})'} != {found}:"
        yield "        return 0"


def _write(place: Place, value: str, shift: int = 0, kind: str = "i32") -> Iterator[str]:
    """Put a number of a kind into a frame."""
    for bits in _read(place):
        width, low = bits.mask.bit_length(), shift + bits.left
        text = _part(value, low, width)
        kept = 255 ^ bits.mask << bits.shift
        if not kept and kind == "i32" and not value.isdigit():
            text = f"{value} >> {low}" if low else value
        elif kept:
            text = f"(({text}) << {bits.shift})" if bits.shift else f"({text})"
            text = f"(payload[{bits.at}] & {kept}) | {text}"
        yield f"    payload[{bits.at}] = byte({text})"


def _protect(scheme: Scheme) -> Iterator[str]:
    its = scheme.its
    yield f"def protect_{scheme.number}({scheme.payload}, counter: i32{_identity(scheme)}) -> None:"
    yield '    """Write counter and checksum into a frame."""'
    if its.counter is not None:
        yield from _write(its.counter.place, "counter")
    for field in its.carried:
        value = "identity" if field.value is None else str(field.value)
        yield from _write(field.place, value, field.shift)
    if its.checksum is not None:
        kind = result_kind(its.checksum)
        yield f"    value: {kind} = {scheme.checksum('payload')}"
        yield from _write(its.checksum.place, "value", kind=kind)


def _dispatch_check(bus: BusMap, schemes: Sequence[Scheme]) -> Iterator[str]:
    yield f"def check({CHECKED}) -> i32:"
    yield '    """Return 1 where the data of the frame in ``slot`` may be used."""'
    call = "return check_{number}(ecu, cal, message, slot{identity})"
    yield from _dispatch(bus.received, schemes, "message", "RX_DATA_IDS", call)
    if _common(bus.received, schemes) is None:
        yield "    return 1"


def _dispatch_protect(bus: BusMap, schemes: Sequence[Scheme]) -> Iterator[str]:
    yield "def protect(ecu: Ecu, slot: i32) -> None:"
    yield '    """Write counter and checksum into the frame to be sent in ``slot``."""'
    call = "protect_{number}(ecu.tx_payload[slot], ecu.tx_counter[slot]{identity})"
    yield from _dispatch(bus.transmitted, schemes, "slot", "TX_DATA_IDS", call)
    if not any(box.protection for box in bus.transmitted):
        yield "    ecu.tx_counter[slot] = 0"


def _common(boxes: Sequence[Mailbox], schemes: Sequence[Scheme]) -> Scheme | None:
    """The scheme that all frames share, or None."""
    filled = [box for box in boxes if box.name]
    return next((s for s in schemes if filled and all(_has(box, s) for box in filled)), None)


def _dispatch(
    boxes: Sequence[Mailbox], schemes: Sequence[Scheme], number: str, table: str, call: str
) -> Iterator[str]:
    common = _common(boxes, schemes)
    if common is not None:
        identity = f", {table}[{number}]" if common.its.identified else ""
        yield f"    {call.format(number=common.number, identity=identity)}"
        return
    keyword = "if"
    for k, box in enumerate(boxes):
        for scheme in schemes:
            if _has(box, scheme):
                identity = f", {_plain(box)}" if scheme.its.identified else ""
                yield f"    {keyword} {number} == {k}:"
                yield f"        {call.format(number=scheme.number, identity=identity)}"
                keyword = "if" if call.startswith("return") else "elif"


if __name__ == "__main__":
    sys.exit(write_or_check(PROTECTION, generate(), __doc__))
