"""firmware/com/signals.py from a DBC and its map: bits, scaling and limits as subset code.

    python -m codegen.generated.signals [--check]

writes (or compares) the checked-in module for ``dbc/roll_control.dbc``.
"""

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

from codegen.generated.bus_map import (
    IN_TURN,
    RECEIVED,
    SAMPLE_COUNTERS,
    TRANSMITTED,
    VALID_BITS,
    BusMap,
    Mailbox,
    load,
)
from codegen.generated.mapped_signal import MappedSignal, RawSignal
from codegen.generated.signal_code import (
    available,
    chosen,
    disagreement,
    disagrees,
    gathered,
    packed,
    placed,
    raw_name,
    unpacked,
    words,
    wrapped,
)
from firmware.state import DISAGREES

ROOT = Path(__file__).resolve().parents[2]
DBC = ROOT / "dbc" / "roll_control.dbc"
MAP = ROOT / "dbc" / "roll_control.toml"
SIGNALS = ROOT / "firmware" / "com" / "signals.py"

LINE = 100
WORD = 8
"""Bytes of a frame that are one number."""

HEADER = '''\
"""Every signal's bits, scaling and limits; made by codegen.generated.signals, not to be edited.

Frames of {names}.
``unpack`` turns the bytes of a mailbox into fields; a signal that carries one of its reserved
codes (error, not available) keeps its field and clears its bit of ``ecu.valid``, as does one that
its second signal contradicts, which sets bit 7. ``pack`` writes the bytes of a frame, rounded to
nearest and limited as the DBC says; ``protection`` comes after it.
"""

from typing import Annotated

from firmware.state import {imports}
from firmware.subset import byte, clamp, i32, i64, rsh, u8
'''

FRAMES = '''\
def received(ecu: Ecu, slot: i32) -> i64:
    """Return the bytes of mailbox ``slot`` as one number, byte 0 lowest."""
    low: i32 = ecu.rx_payload[slot][0] | (ecu.rx_payload[slot][1] << 8)
    low |= ecu.rx_payload[slot][2] << 16
    high: i32 = ecu.rx_payload[slot][4] | (ecu.rx_payload[slot][5] << 8)
    high |= ecu.rx_payload[slot][6] << 16
    high |= ((ecu.rx_payload[slot][7] ^ 128) - 128) << 24
    return (high << 32) | (ecu.rx_payload[slot][3] << 24) | low


def store(ecu: Ecu, message: i32, frame: i64) -> None:
    """Make the bytes of ``frame`` the payload of ``message``."""
    left: i64 = frame
    for k in range(8):
        ecu.tx_payload[message][k] = byte(left)
        left = left >> 8'''

RECEIVED_WORD = '''\
def received_word(ecu: Ecu, slot: i32, first: i32) -> i64:
    """Return eight bytes of mailbox ``slot`` from byte ``first`` on as one number."""
    low: i32 = ecu.rx_payload[slot][first] | (ecu.rx_payload[slot][first + 1] << 8)
    low |= ecu.rx_payload[slot][first + 2] << 16
    high: i32 = ecu.rx_payload[slot][first + 4] | (ecu.rx_payload[slot][first + 5] << 8)
    high |= ecu.rx_payload[slot][first + 6] << 16
    high |= ((ecu.rx_payload[slot][first + 7] ^ 128) - 128) << 24
    return (high << 32) | (ecu.rx_payload[slot][first + 3] << 24) | low'''
STORE_WORD = '''\
def store_word(ecu: Ecu, message: i32, first: i32, word: i64) -> None:
    """Make ``word`` eight bytes of the payload of ``message``, from byte ``first`` on."""
    left: i64 = word
    for k in range(8):
        ecu.tx_payload[message][first + k] = byte(left)
        left = left >> 8'''


def generate(dbc: Path = DBC, map_file: Path = MAP) -> str:
    """Return the subset source of the signals module for ``dbc`` and ``map_file``."""
    bus = load(dbc, map_file)
    slots = sorted([f"RX_{s.upper()}" for s in RECEIVED] + [f"TX_{s.upper()}" for s in TRANSMITTED])
    imports = "".join(f"    {name},\n" for name in [*slots, "Ecu"])
    lines = HEADER.format(names=dbc.name, imports=f"(\n{imports})").splitlines()
    lines += [
        "",
        *_tables(bus),
        "",
        "",
        *_wanted(bus),
        "",
        "",
        *_contradicted(bus),
        "",
        "",
        *FRAMES.splitlines(),
    ]
    for boxes, text in ((bus.received, RECEIVED_WORD), (bus.transmitted, STORE_WORD)):
        if any(_long(box) for box in boxes):
            lines += ["", "", *text.splitlines()]
    for box in bus.received:
        lines += ["", "", *_unpack(box)]
    for box in bus.transmitted:
        lines += ["", "", *_pack(box)]
    lines += ["", "", *_dispatch_unpack(bus), "", "", *_dispatch_pack(bus)]
    return "\n".join(lines) + "\n"


def room(boxes: Iterable[Mailbox]) -> int:
    """Return the bytes of each mailbox: whole words, one at least."""
    longest = max((box.sent_length for box in boxes), default=0)
    return max(WORD, -(-longest // WORD) * WORD)


def _long(box: Mailbox) -> bool:
    """Whether a frame needs more than one word."""
    return box.length > WORD


def _tables(bus: BusMap) -> Iterable[str]:
    yield "# identifiers (bit 30: a 29-bit one; 0: the mailbox stays empty), lengths"
    for prefix, boxes in (("RX", bus.received), ("TX", bus.transmitted)):
        ids = ", ".join(f"0x{box.ident:X}" if box.name else "0" for box in boxes)
        yield f"{prefix}_IDS: tuple[i32, ...] = ({ids})"
        lengths = ", ".join(str(b.length if prefix == "RX" else b.sent_length) for b in boxes)
        yield f"{prefix}_LENGTHS: tuple[u8, ...] = ({lengths})"
    if any(box.fd for box in bus.transmitted):
        yield "# of each frame sent: 0 a classic frame, 1 CAN FD, 3 CAN FD with bit-rate switch"
        kinds = ", ".join(str(b.fd + 2 * b.bit_rate_switch) for b in bus.transmitted)
        yield f"TX_FD: tuple[u8, ...] = ({kinds})"
    yield "# of each frame sent: 1 where the actuators echo its counter"
    echoed = ", ".join(str(int(each)) for each in bus.echoed)
    yield f"TX_ECHOED: tuple[u8, ...] = ({echoed})"
    yield "# pages of the diagnostics, which are sent in turn"
    yield f"PAGES = {max(len(_in_turn(bus).pages), 1)}"


def _in_turn(bus: BusMap) -> Mailbox:
    return next(box for box in bus.transmitted if box.slot == IN_TURN)


def _wanted(bus: BusMap) -> Iterable[str]:
    yield f"def wanted(message: i32, payload: Annotated[list[u8], {room(bus.received)}]) -> i32:"
    yield '    """Return 1 where the mailbox ``message`` takes a frame, by the page that it is."""'
    for box in bus.received:
        if box.selector is not None:
            yield f"    if message == RX_{box.slot.upper()}:"
            yield f"        {raw_name(box.selector)}: i32 = {chosen(box.selector, 'payload')}"
            yield f"        if {raw_name(box.selector)} != {box.pages[0]}:"
            yield "            return 0"
        elif not box.name:
            yield f"    if message == RX_{box.slot.upper()}:"
            yield "        return 0"
    yield "    return 1"


def _contradicted(bus: BusMap) -> Iterable[str]:
    yield "def contradicted(ecu: Ecu) -> i32:"
    yield '    """Return 1 where a signal and its redundant or inverted one disagree."""'
    watched = [
        f"ecu.valid[RX_{box.slot.upper()}]"
        for box in bus.received
        if any(signal.twin for signal in box.signals)
    ]
    if not watched:
        yield "    return 0"
        return
    yield f"    if (({' | '.join(watched)}) & {DISAGREES}) != 0:"
    yield "        return 1"
    yield "    return 0"


def _unpack(box: Mailbox) -> Iterable[str]:
    source = "slot: i32" if _long(box) else "frame: i64"
    yield f"def unpack_{box.slot}(ecu: Ecu, {source}) -> None:"
    receiver = f"RX_{box.slot.upper()}"
    if not box.name:
        yield '    """Nothing on this bus fills the mailbox: its signals stay not available."""'
        yield f"    ecu.valid[{receiver}] = 0"
        return
    yield f'    """Take the signals of {_identified(box)}."""'
    bits = VALID_BITS[box.slot]
    frame = _frame(box)
    if _long(box):
        for word in words(_raw_signals(box.signals)):
            yield f"    {frame[word]}: i64 = received_word(ecu, slot, {WORD * word})"
    yield "    valid: u8 = 0"
    first = "valid ="
    for signal in sorted(box.signals, key=lambda s: _valid_order(bits, s)):
        for line in _unpack_signal(signal, bits, frame):
            yield line.replace("valid |=", first)
            if "valid |=" in line:
                first = "valid |="
    yield f"    ecu.valid[{receiver}] = valid"
    counter = SAMPLE_COUNTERS[box.slot]
    if counter not in {signal.place.text for signal in box.signals}:
        yield "    # no sample counter on this bus: every frame is a new sample"
        yield f"    ecu.{counter} = (ecu.{counter} + 1) & 15"


def _valid_order(bits: tuple[str, ...], signal: MappedSignal) -> int:
    return bits.index(signal.place.text) if signal.place.text in bits else len(bits)


def _frame(box: Mailbox) -> tuple[str, ...]:
    """The locals that hold the words of a frame."""
    if not _long(box):
        return ("frame",)
    return tuple(f"frame_{word}" for word in range(-(-box.length // WORD)))


def _raw_signals(signals: Iterable[MappedSignal]) -> Iterable[RawSignal]:
    """All raw signals a frame carries for ``signals``, including second signals and sign bits."""
    for signal in signals:
        yield from signal.parts


def _unpack_signal(
    signal: MappedSignal, bits: tuple[str, ...], frame: tuple[str, ...]
) -> Iterable[str]:
    place, name, indent = signal.place, raw_name(signal), "    "
    value = unpacked(signal)
    if value == name and not signal.unavailable and len(signal.parts) == 1:
        value = gathered(signal, frame)
    else:
        yield from wrapped(f"    {name}: i32 = {gathered(signal, frame)}", LINE)
    keyword = "if"
    if signal.twin is not None:
        yield from disagreement(signal, frame)
        yield f"    if {disagrees(signal)}:"
        yield f"        valid |= {DISAGREES}"
        keyword = "elif"
    if signal.unavailable:
        yield f"    {keyword} {available(signal)}:"
    elif signal.twin is not None:
        yield "    else:"
    if signal.unavailable or signal.twin is not None:
        indent = "        "
    if signal.minus is not None:
        yield f"{indent}if ({gathered(signal.minus, frame)}) == 1:"
        yield f"{indent}    {name} = -{name}"
    yield from wrapped(f"{indent}ecu.{place.text} = {value}", LINE)
    if place.text in bits:
        yield f"{indent}valid |= {1 << bits.index(place.text)}"


def _pack(box: Mailbox) -> Iterable[str]:
    yield f"def pack_{box.slot}(ecu: Ecu) -> {'None' if _long(box) else 'i64'}:"
    if not box.name:
        yield '    """Nothing on this bus takes the frame: it stays empty."""'
        yield "    return 0"
        return
    frame = _frame(box)
    yield f'    """{"Store" if _long(box) else "Return"} the frame {_identified(box)}."""'
    yield from (f"    {word}: i64 = 0" for word in frame)
    yield from _fill([signal for signal in box.signals if signal.page is None], frame, "    ")
    if box.selector is not None and box.slot == IN_TURN:
        yield from _pages_in_turn(box, box.selector)
    elif box.selector is not None:
        yield from _page(box, box.selector, box.pages[0], "    ")
    if not _long(box):
        yield "    return frame"
        return
    for number, word in enumerate(frame):
        yield f"    store_word(ecu, TX_{box.slot.upper()}, {WORD * number}, {word})"


def _pages_in_turn(box: Mailbox, selector: RawSignal) -> Iterable[str]:
    """A branch for each page, selected by the number of the page that is due."""
    if len(box.pages) == 1:
        yield from _page(box, selector, box.pages[0], "    ")
        return
    in_order = box.pages == tuple(range(len(box.pages)))
    if in_order:
        yield f"    {raw_name(selector)}: i32 = ecu.diagnostics_page"
        yield from (f"    {line}" for line in placed(selector, _frame(box)))
    keyword = "if"
    for number, page in enumerate(box.pages):
        yield f"    {keyword} ecu.diagnostics_page == {number}:"
        keyword = "elif"
        if in_order:
            there = [its for its in box.signals if its.page == page]
            yield from _fill(there, _frame(box), "        ")
        else:
            yield from _page(box, selector, page, "        ")


def _page(box: Mailbox, selector: RawSignal, page: int, indent: str) -> Iterable[str]:
    """The selector and the signals of one page."""
    yield f"{indent}{raw_name(selector)}: i32 = {page}"
    yield from (f"{indent}{line}" for line in placed(selector, _frame(box)))
    yield from _fill([signal for signal in box.signals if signal.page == page], _frame(box), indent)


def _fill(signals: list[MappedSignal], frame: tuple[str, ...], indent: str) -> Iterable[str]:
    """Put the raw codes of ``signals`` into the frame."""
    for signal in signals:
        name = raw_name(signal)
        yield from wrapped(f"{indent}{name}: i32 = {packed(signal)}", LINE)
        if signal.minus is not None:
            yield f"{indent}{raw_name(signal.minus)}: i32 = 0"
            yield f"{indent}if {name} < 0:"
            yield f"{indent}    {raw_name(signal.minus)} = 1"
            yield f"{indent}    {name} = -{name}"
        if signal.twin is not None:
            other = signal.twin.signal
            value = name
            if signal.twin.inverted:
                value = f"{-1 if other.signed else (1 << other.length) - 1} - {name}"
            yield f"{indent}{raw_name(other)}: i32 = {value}"
        for part in signal.parts:
            yield from (f"{indent}{line}" for line in placed(part, frame))


def _dispatch_unpack(bus: BusMap) -> Iterable[str]:
    yield "def unpack(ecu: Ecu, message: i32, slot: i32) -> None:"
    yield '    """Unpack the frame that is number ``message`` from mailbox ``slot``."""'
    if not any(map(_long, bus.received)):
        yield "    frame: i64 = received(ecu, slot)"
        yield from _choice("RX", RECEIVED, ["unpack_{}(ecu, frame)"] * len(RECEIVED))
        return
    calls = [
        "unpack_{}(ecu, slot)" if _long(box) else "unpack_{}(ecu, received(ecu, slot))"
        for box in bus.received
    ]
    yield from _choice("RX", RECEIVED, calls)


def _dispatch_pack(bus: BusMap) -> Iterable[str]:
    yield "def pack(ecu: Ecu, message: i32) -> None:"
    yield '    """Pack the frame that is number ``message``."""'
    if not any(map(_long, bus.transmitted)):
        yield "    frame: i64 = 0"
        yield from _choice("TX", TRANSMITTED, ["frame = pack_{}(ecu)"] * len(TRANSMITTED))
        yield "    store(ecu, message, frame)"
        return
    calls = [
        "pack_{}(ecu)" if _long(box) else "store(ecu, message, pack_{}(ecu))"
        for box in bus.transmitted
    ]
    yield from _choice("TX", TRANSMITTED, calls)


def _choice(prefix: str, slots: tuple[str, ...], calls: list[str]) -> Iterable[str]:
    keyword = "if"
    for slot, call in zip(slots, calls, strict=True):
        yield f"    {keyword} message == {prefix}_{slot.upper()}:"
        yield f"        {call.format(slot)}"
        keyword = "elif"


def _identified(box: Mailbox) -> str:
    return f"{box.name} (0x{box.ident:X})"


def write_or_check(path: Path, text: str, what: str | None) -> int:
    """Write a generated file, or with ``--check`` return 1 if it is out of date.

    Args:
        path: path of the file.
        text: its generated content.
        what: docstring of the generator; its first line is the description of the command.
    """
    parser = argparse.ArgumentParser(description=what.splitlines()[0] if what else None)
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    if parser.parse_args().check:
        return 0 if path.read_text(encoding="utf-8") == text else 1
    path.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(write_or_check(SIGNALS, generate(), __doc__))
