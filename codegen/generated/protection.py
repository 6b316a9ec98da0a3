"""firmware/com/protection.py from a DBC and its map: checksums and counters as subset code.

    python -m codegen.generated.protection [--check]

writes (or compares) the checked-in module for ``dbc/roll_control.dbc``. Frames with the
same protection share functions, and only the tables that a bus needs are written.
"""

import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from codegen.generated.bus_map import BusMap, Mailbox, load
from codegen.generated.frame_protection import CCITT, Checksum, Protection, crc_table
from codegen.generated.signals import DBC, MAP, ROOT, write_or_check

PROTECTION = ROOT / "firmware" / "com" / "protection.py"

HEADER = '''\
"""Checksums and counters of the frames; made by codegen.generated.protection, not to be edited.

Frames of {names}.
``check`` judges a received frame, ``protect`` finishes one to be sent.
"""

from typing import Annotated

from firmware.calibration import Calibration
from firmware.com import e2e
from firmware.state import Ecu
from firmware.subset import {types}
'''
CHECKED = "ecu: Ecu, cal: Calibration, message: i32, slot: i32"
WRITTEN_OUT = 8
"""Bytes of a frame up to which a loop would cost more than its body."""


@dataclass(frozen=True, slots=True)
class Scheme:
    """Frames whose protection is the same but for a plain data id."""

    number: int
    its: Protection

    @property
    def identified(self) -> bool:
        """Whether its functions have a parameter for the identity of the frame."""
        return self.its.nibble is not None or self.summed

    @property
    def payload(self) -> str:
        """The parameter that passes the bytes of a frame to its functions."""
        return f"payload: Annotated[list[u8], {max(self.its.length, WRITTEN_OUT)}]"

    @property
    def summed(self) -> bool:
        """Whether its checksum covers the identity of the frame."""
        checksum = self.its.checksum
        used = (*checksum.first, *checksum.last) if checksum else ()
        return isinstance(self.its.identity, int) and any(which != "zero" for which in used)


def generate(dbc: Path = DBC, map_file: Path = MAP) -> str:
    """Return the subset source of the protection module for ``dbc`` and ``map_file``."""
    bus = load(dbc, map_file)
    found = (*bus.received, *bus.transmitted)
    alike = dict.fromkeys(_alike(box.protection) for box in found if box.protection)
    schemes = [Scheme(number, its) for number, its in enumerate(alike)]
    unsigned = ", u16, u32" if any(_of_16_bits(scheme) for scheme in schemes) else ""
    header = HEADER.format(names=dbc.name, types=f"byte, i32, u8{unsigned}")
    lines = [header, *_tables(bus, schemes)]
    for scheme in schemes:
        lines += ["", "", *_checksum(scheme)] if scheme.its.checksum else []
        if any(_has(box, scheme) for box in bus.received):
            lines += ["", "", *_check(scheme)]
        if any(_has(box, scheme) for box in bus.transmitted):
            lines += ["", "", *_protect(scheme)]
    lines += ["", "", *_dispatch_check(bus, schemes), "", "", *_dispatch_protect(bus, schemes)]
    return "\n".join(lines) + "\n"


def _alike(its: Protection) -> Protection:
    return replace(its, identity=0) if isinstance(its.identity, int) else its


def _of_16_bits(scheme: Scheme) -> bool:
    return scheme.its.checksum is not None and scheme.its.checksum.method == "crc16"


def _has(box: Mailbox, scheme: Scheme) -> bool:
    return box.protection is not None and _alike(box.protection) == scheme.its


def _tables(bus: BusMap, schemes: Sequence[Scheme]) -> Iterator[str]:
    yield "# data ids; of each frame sent the highest value of its counter, 0: none"
    for prefix, boxes in (("RX", bus.received), ("TX", bus.transmitted)):
        common = _common(boxes, schemes)
        if common is not None and common.identified:
            ids = ", ".join(str(_plain(box)) for box in boxes)
            yield f"{prefix}_DATA_IDS: tuple[i32, ...] = ({ids})"
    last = ", ".join(str(max(_values(box) - 1, 0)) for box in bus.transmitted)
    yield f"TX_LAST_COUNTERS: tuple[u8, ...] = ({last})"
    polynomials = {
        its.polynomial for s in schemes if (its := s.its.checksum) and its.method == "crc8"
    }
    yield "# fmt: off"
    for polynomial in sorted(polynomials):
        yield from _table(f"CRC8_{polynomial:02X}", "u8", crc_table(polynomial, 8))
    of_16_bits = [scheme for scheme in schemes if _of_16_bits(scheme)]
    if of_16_bits:
        # by half a byte in short frames: what sixteen values leave of the first four bits
        entries = 256 if any(s.its.length > WRITTEN_OUT for s in of_16_bits) else 16
        yield from _table("CRC16", "u16", crc_table(CCITT, 16)[:entries])
    for scheme in schemes:
        if isinstance(scheme.its.identity, tuple):
            yield from _table(f"IDENTITIES_{scheme.number}", "u8", scheme.its.identity)
    yield "# fmt: on"


def _plain(box: Mailbox) -> int:
    identity = box.protection.identity if box.protection else 0
    return identity if isinstance(identity, int) else 0


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
    yield f"def checksum_{scheme.number}({scheme.payload}{identity}) -> i32:"
    yield f'    """Return the checksum of a frame: {_described(its)}."""'
    covered = [range(checksum.byte), range(checksum.byte + checksum.size, its.length)]
    first = list(_identity_bytes(scheme, checksum.first))
    last = list(_identity_bytes(scheme, checksum.last))
    if "alternating" in (*checksum.first, *checksum.last):
        yield "    half: i32 = byte(identity)"
        yield f"    if ({_counter(its, 'payload')} & 1) == 1:"
        yield "        half = byte(identity >> 8)"
    if its.length > WRITTEN_OUT:
        yield from _looped(checksum, first, covered, last)
    else:
        yield from _run(checksum, [*first, *(f"payload[{k}]" for r in covered for k in r), *last])


def _identity_bytes(scheme: Scheme, which: Iterable[str]) -> Iterator[str]:
    texts = {
        "low": "byte(identity)",
        "high": "byte(identity >> 8)",
        "zero": "0",
        "alternating": "half",
    }
    for name in which:
        if name == "listed":
            yield f"IDENTITIES_{scheme.number}[{_counter(scheme.its, 'payload')}]"
        else:
            yield texts[name]


def _counter(its: Protection, payload: str) -> str:
    assert its.counter is not None
    where = f"{payload}[{its.counter.byte}]"
    if its.counter.width == 8:
        return where
    where = f"({where} >> {its.counter.bit})" if its.counter.bit else where
    return f"({where} & {(1 << its.counter.width) - 1})"


def _run(checksum: Checksum, steps: Sequence[str]) -> Iterator[str]:
    """The statements that process the bytes one by one."""
    if checksum.method == "sum":
        yield f"    total: i32 = {checksum.start} + {steps[0]}"
        yield from (f"    total += {step}" for step in steps[1:])
        end = f" ^ {checksum.end}" if checksum.end else ""
        yield f"    return (total & 255){end}" if end else "    return total & 255"
        return
    if checksum.method == "xor":
        yield f"    value: i32 = {checksum.start ^ checksum.end} ^ {steps[0]}"
        yield from (f"    value = value ^ {step}" for step in steps[1:])
        yield "    return value"
        return
    if checksum.method == "crc16":
        yield f"    crc: u32 = {checksum.start}"
        for step in steps:
            for part in (f"({step} >> 4)", f"({step} & 15)"):
                yield f"    crc = CRC16[(crc >> 12) ^ {part}] ^ ((crc & 4095) << 4)"
        yield f"    return crc ^ {checksum.end}" if checksum.end else "    return crc"
        return
    name = f"CRC8_{checksum.polynomial:02X}"
    start = f"{checksum.start} ^ " if checksum.start else ""
    yield f"    crc: i32 = {name}[{start}{steps[0]}]"
    if len(steps) > 2:
        yield "    # written out: a loop would cost more than its body"
    yield from (f"    crc = {name}[crc ^ {step}]" for step in steps[1:-1])
    end = f" ^ {checksum.end}" if checksum.end else ""
    yield f"    return {name}[crc ^ {steps[-1]}]{end}"


def _looped(
    checksum: Checksum, first: Sequence[str], covered: Sequence[range], last: Sequence[str]
) -> Iterator[str]:
    """The statements that process the identity's bytes and, in loops, those of the frame."""
    name = f"CRC8_{checksum.polynomial:02X}"
    steps = {
        "sum": ["value = (value + {}) & 255"],
        "xor": ["value = value ^ {}"],
        "crc8": [f"value = {name}[value ^ {{}}]"],
        "crc16": ["value = CRC16[(value >> 8) ^ {}] ^ ((value & 255) << 8)"],
    }[checksum.method]
    kind = "u32" if checksum.method == "crc16" else "i32"
    yield f"    value: {kind} = {checksum.start}"
    yield from (f"    {step.format(byte)}" for byte in first for step in steps)
    for bytes_of in covered:
        if bytes_of:
            yield f"    for k in range({bytes_of.start}, {bytes_of.stop}):"
            yield from (f"        {step.format('payload[k]')}" for step in steps)
    yield from (f"    {step.format(byte)}" for byte in last for step in steps)
    yield f"    return value ^ {checksum.end}" if checksum.end else "    return value"


def _described(its: Protection) -> str:
    return f"E2E profile {its.profile}" if its.profile != "own" else "the manufacturer's own"


def _identity(scheme: Scheme) -> str:
    return ", identity: i32" if scheme.identified else ""


def _check(scheme: Scheme) -> Iterator[str]:
    its = scheme.its
    yield f"def check_{scheme.number}({CHECKED}{_identity(scheme)}) -> i32:"
    yield '    """Return 1 where the data of a received frame may be used."""'
    payload = "ecu.rx_payload[slot]"
    if its.counter is not None:
        yield f"    counter: i32 = {_counter(its, payload).removeprefix('(').removesuffix(')')}"
        if its.counter.values < 1 << its.counter.width:
            yield f"    if counter >= {its.counter.values}:"
            yield "        return 0"
    if its.nibble is not None:
        where = f"({payload}[{its.nibble // 8}] >> {its.nibble % 8}) & 15"
        yield f"    if ({where}) != ((identity >> 8) & 15):"
        yield "        return 0"
    if its.checksum is not None:
        given = ", identity" if scheme.summed else ""
        yield f"    expected: i32 = checksum_{scheme.number}({payload}{given})"
        found = f"{payload}[{its.checksum.byte}]"
        if its.checksum.size == 2:
            found = f"({found} | ({payload}[{its.checksum.byte + 1}] << 8))"
        yield f"    if expected != {found}:"
        yield "        return 0"
    if its.counter is None:
        yield "    return 1"
        return
    receiver = "resynchronised" if its.resynchronises else "in_sequence"
    values = its.counter.values
    yield f"    return e2e.{receiver}(ecu, cal, message, counter, {values})"


def _protect(scheme: Scheme) -> Iterator[str]:
    its = scheme.its
    yield f"def protect_{scheme.number}({scheme.payload}, counter: i32{_identity(scheme)}) -> None:"
    yield '    """Write counter and checksum into a frame."""'
    if its.counter is not None:
        mask = 255 ^ (((1 << its.counter.width) - 1) << its.counter.bit)
        value = f"(counter & {(1 << its.counter.width) - 1})"
        value = f"({value} << {its.counter.bit})" if its.counter.bit else value
        kept = f"(payload[{its.counter.byte}] & {mask}) | " if mask else ""
        yield f"    payload[{its.counter.byte}] = byte({kept}{value})"
    if its.nibble is not None:
        k, bit = divmod(its.nibble, 8)
        value = f"(((identity >> 8) & 15) << {bit})" if bit else "((identity >> 8) & 15)"
        yield f"    payload[{k}] = byte((payload[{k}] & {255 ^ (15 << bit)}) | {value})"
    if its.checksum is not None:
        given = ", identity" if scheme.summed else ""
        yield f"    value: i32 = checksum_{scheme.number}(payload{given})"
        yield f"    payload[{its.checksum.byte}] = byte(value)"
        if its.checksum.size == 2:
            yield f"    payload[{its.checksum.byte + 1}] = byte(value >> 8)"


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
        identity = f", {table}[{number}]" if common.identified else ""
        yield f"    {call.format(number=common.number, identity=identity)}"
        return
    keyword = "if"
    for k, box in enumerate(boxes):
        for scheme in schemes:
            if _has(box, scheme):
                identity = f", {_plain(box)}" if scheme.identified else ""
                yield f"    {keyword} {number} == {k}:"
                yield f"        {call.format(number=scheme.number, identity=identity)}"
                keyword = "if" if call.startswith("return") else "elif"


if __name__ == "__main__":
    sys.exit(write_or_check(PROTECTION, generate(), __doc__))
