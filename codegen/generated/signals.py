"""firmware/com/signals.py from a DBC and its map: bits, scaling and limits as subset code.

    python -m codegen.generated.signals [--check]

writes (or compares) the checked-in module for ``dbc/roll_control.dbc``.
"""

import argparse
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from codegen.frame.raw_signal import RawSignal
from codegen.generated.bus_map import BusMap, load
from codegen.generated.mailbox import (
    IN_TURN,
    RECEIVED,
    SAMPLE_COUNTERS,
    TRANSMITTED,
    VALID_BITS,
    WORD,
    Mailbox,
    room,
)
from codegen.generated.mapped_signal import MappedSignal
from codegen.generated.packing import STORE, STORE_WORD, dispatch_pack, pack
from codegen.generated.signal_code import (
    LINE,
    available,
    chosen,
    disagreement,
    disagrees,
    gathered,
    raw_name,
    share,
    unpacked,
    words,
    wrapped,
)
from dbc.reader import Files, file_names
from firmware.state import DISAGREES, FIRST_FRAME, REST

ROOT = Path(__file__).resolve().parents[2]
DBC = ROOT / "dbc" / "roll_control.dbc"
MAP = ROOT / "dbc" / "roll_control.toml"
SIGNALS = ROOT / "firmware" / "com" / "signals.py"

COUNTER_BITS = 4
"""Bits of a sample counter that the firmware follows."""

HEADER = '''\
"""Every signal's bits, scaling and limits; made by codegen.generated.signals, not to be edited.

Frames of {names}.
``unpack`` turns the bytes of a mailbox into fields; a signal that carries one of its reserved
codes (error, not available) keeps its field and clears its bit of ``ecu.valid``, as does one that
another signal says has no value, or its second signal contradicts, which sets bit 7. ``pack``
writes the bytes of a frame, rounded to nearest and limited as the DBC says; ``protection`` comes
after it.
"""

from typing import Annotated

{float32}from firmware.state import {imports}
from firmware.subset import byte, clamp, i32, i64, rsh, {unsigned}u8
'''

RECEIVED_TEXT = '''\
def received(ecu: Ecu, slot: i32) -> i64:
    """Return the bytes of mailbox ``slot`` as one number, byte 0 lowest."""
    low: i32 = ecu.rx_payload[slot][0] | (ecu.rx_payload[slot][1] << 8)
    low |= ecu.rx_payload[slot][2] << 16
    high: i32 = ecu.rx_payload[slot][4] | (ecu.rx_payload[slot][5] << 8)
    high |= ecu.rx_payload[slot][6] << 16
    high |= ((ecu.rx_payload[slot][7] ^ 128) - 128) << 24
    return (high << 32) | (ecu.rx_payload[slot][3] << 24) | low'''

RECEIVED_WORD = '''\
def received_word(ecu: Ecu, slot: i32, first: i32) -> i64:
    """Return eight bytes of mailbox ``slot`` from byte ``first`` on as one number."""
    low: i32 = ecu.rx_payload[slot][first] | (ecu.rx_payload[slot][first + 1] << 8)
    low |= ecu.rx_payload[slot][first + 2] << 16
    high: i32 = ecu.rx_payload[slot][first + 4] | (ecu.rx_payload[slot][first + 5] << 8)
    high |= ecu.rx_payload[slot][first + 6] << 16
    high |= ((ecu.rx_payload[slot][first + 7] ^ 128) - 128) << 24
    return (high << 32) | (ecu.rx_payload[slot][first + 3] << 24) | low'''


def generate(files: Files = DBC, map_file: Path = MAP) -> str:
    """Return the subset source of the signals module for ``files`` and ``map_file``."""
    bus = load(files, map_file)
    slots = sorted([f"RX_{s.upper()}" for s in RECEIVED] + [f"TX_{s.upper()}" for s in TRANSMITTED])
    imports = "".join(f"    {name},\n" for name in ["NO_SAMPLE", *slots, "Ecu"])
    lines = HEADER.format(
        names=re.sub(r'["\\\n]', "_", file_names(files)),
        imports=f"(\n{imports})",
        float32=_float32(bus),
        unsigned="to_u32, " if "code_of" in _float32(bus) else "",
    ).splitlines()
    lines += ["", *_tables(bus)]
    parts: list[Iterable[str]] = [
        *(part(bus) for part in (_wanted, _contradicted, _outdated, _sample_counter)),
        *(RECEIVED_TEXT.splitlines(), STORE.splitlines()),
    ]
    for boxes, text in ((bus.received, RECEIVED_WORD), (bus.transmitted, STORE_WORD)):
        if any(box.is_long for box in boxes):
            parts.append(text.splitlines())
    parts += [_unpack(box, bus.frames_of(box.slot)) for box in bus.received]
    parts += [pack(box) for box in bus.transmitted]
    for part in (*parts, _dispatch_unpack(bus), dispatch_pack(bus)):
        lines += ["", "", *part]
    return "\n".join(lines) + "\n"


def _float32(bus: BusMap) -> str:
    """The import of what floating-point signals need."""
    sides = {"code_of": bus.transmitted, "fixed_of": bus.received}
    used = [n for n, boxes in sides.items() if any(s.real for box in boxes for s in box.signals)]
    return f"from firmware.com.float32 import {', '.join(used)}\n" if used else ""


def _tables(bus: BusMap) -> Iterable[str]:
    yield "# identifiers (bit 30: a 29-bit one; 0: the mailbox stays empty), lengths"
    for prefix, boxes in (("RX", bus.received), ("TX", bus.transmitted)):
        ids = ", ".join(f"0x{box.ident:X}" if box.name else "0" for box in boxes)
        yield f"{prefix}_IDS: tuple[i32, ...] = ({ids})"
        lengths = ", ".join(str(b.length if prefix == "RX" else b.sent_length) for b in boxes)
        yield f"{prefix}_LENGTHS: tuple[u8, ...] = ({lengths})"
    yield "# of each frame received: its message, and what of ecu.fresh a new sample of it is"
    messages = ", ".join(str(RECEIVED.index(box.slot)) for box in bus.received)
    yield f"RX_MESSAGES: tuple[u8, ...] = ({messages})"
    news = ", ".join(str(box.bits | (0 if box.further else FIRST_FRAME)) for box in bus.received)
    yield f"RX_SIGNALS: tuple[u8, ...] = ({news})"
    yield "# of each message received: the signals that its frames carry, as bits of ecu.valid"
    carried = ", ".join(str(_carried(bus, slot)) for slot in RECEIVED)
    yield f"RX_CARRIED: tuple[u8, ...] = ({carried})"
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


def _carried(bus: BusMap, slot: str) -> int:
    """The signals of a message that are on the bus, as bits of ecu.valid."""
    return sum(box.bits for box in bus.frames_of(slot))


def _numbered(bus: BusMap) -> Iterable[tuple[str, Mailbox]]:
    """The received frames, and what their numbers are in the code."""
    for number, box in enumerate(bus.received):
        yield str(number) if box.further else f"RX_{box.slot.upper()}", box


def _wanted(bus: BusMap) -> Iterable[str]:
    yield f"def wanted(frame: i32, payload: Annotated[list[u8], {room(bus.received)}]) -> i32:"
    yield '    """Return 1 where the mailbox of a frame takes it, by the page that it is."""'
    for number, box in _numbered(bus):
        if box.selector is not None:
            yield f"    if frame == {number}:"
            yield f"        {raw_name(box.selector)}: i32 = {chosen(box.selector, 'payload')}"
            yield f"        if {raw_name(box.selector)} != {box.pages[0]}:"
            yield "            return 0"
        elif not box.name:
            yield f"    if frame == {number}:"
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


def _outdated(bus: BusMap) -> Iterable[str]:
    yield "def overdue(ecu: Ecu, frame: i32, patience: i32, grace: i32) -> i32:"
    yield '    """Return 1 where a frame is older than ``patience``, plus ``grace`` at first."""'
    yield "    limit: i32 = patience"
    yield "    if ecu.last_sample[frame] == NO_SAMPLE:"
    yield "        limit += grace"
    yield "    if ecu.age[frame] > limit:"
    yield "        return 1"
    yield "    return 0"
    yield ""
    yield ""
    yield "def outdated(ecu: Ecu, message: i32, patience: i32, grace: i32) -> i32:"
    yield '    """Return the signals of overdue frames of a message, as bits of ecu.valid."""'
    yield from _signals_where(bus, "late", "overdue(ecu, {}, patience, grace) == 1")
    yield ""
    yield ""
    yield "def awaited(ecu: Ecu, message: i32) -> i32:"
    yield '    """Return the signals of a message not yet received, as bits of ecu.valid."""'
    yield from _signals_where(bus, "unheard", "ecu.last_sample[{}] == NO_SAMPLE")


def _signals_where(bus: BusMap, name: str, condition: str) -> Iterable[str]:
    """The body that returns as ``name`` the signals of a message's frames that fulfil a condition.

    The number of the frame stands in the place ``{}`` of ``condition``.
    """
    yield f"    {name}: i32 = 0"
    yield f"    if {condition.format('message')}:"
    yield f"        {name} = RX_SIGNALS[message] & {FIRST_FRAME - 1}"
    for number, box in _numbered(bus):
        if box.further:
            yield f"    if message == RX_{box.slot.upper()}:"
            yield f"        if {condition.format(number)}:"
            yield f"            {name} = {name} | {box.bits}"
    yield f"    return {name}"


def _sample_counter(bus: BusMap) -> Iterable[str]:
    yield "def sample_counter(ecu: Ecu, frame: i32) -> u8:"
    yield '    """Return the sample counter of a frame; without one it counts the frames."""'
    for number, box in _numbered(bus):
        if box.further:
            yield f"    if frame == {number}:"
            yield f"        return (ecu.last_sample[{number}] + 1) & 15"
    for slot in RECEIVED[:-1]:
        yield f"    if frame == RX_{slot.upper()}:"
        yield f"        return ecu.{SAMPLE_COUNTERS[slot]}"
    yield f"    return ecu.{SAMPLE_COUNTERS[RECEIVED[-1]]}"


def _unpacker(box: Mailbox) -> str:
    """The name of the function that unpacks a frame."""
    return f"unpack_{box.slot}_{box.further}" if box.further else f"unpack_{box.slot}"


def _unpack(box: Mailbox, frames: Sequence[Mailbox]) -> Iterable[str]:
    """The function that takes the signals of ``box``, one of the ``frames`` of its message."""
    source = "slot: i32" if box.is_long else "frame: i64"
    yield f"def {_unpacker(box)}(ecu: Ecu, {source}) -> None:"
    receiver = f"RX_{box.slot.upper()}"
    if not box.name:
        yield '    """Nothing on this bus fills the mailbox: its signals stay not available."""'
        yield f"    ecu.valid[{receiver}] = 0"
        return
    yield f'    """Take the signals of {box.identified}."""'
    bits = VALID_BITS[box.slot]
    frame = box.frame_words
    if box.is_long:
        for word in words(_raw_signals(box.signals)):
            yield f"    {frame[word]}: i64 = received_word(ecu, slot, {WORD * word})"
    yield f"    valid: u8 = {box.bits & REST}"
    first = "valid |=" if box.bits & REST else "valid ="
    by_field: dict[str, list[MappedSignal]] = {}
    for signal in sorted(box.signals, key=lambda s: _valid_order(bits, s)):
        by_field.setdefault(signal.place.text, []).append(signal)
    for alike in by_field.values():
        lines = _unpack_mean(alike, bits, frame)
        for line in lines if len(alike) > 1 else _unpack_signal(alike[0], bits, frame):
            yield line.replace("valid |=", first)
            if "valid |=" in line:
                first = "valid |="
    kept = _others(box, frames)
    if kept:
        yield f"    ecu.valid[{receiver}] = byte((ecu.valid[{receiver}] & {kept}) | valid)"
    else:
        yield f"    ecu.valid[{receiver}] = valid"
    counter = SAMPLE_COUNTERS[box.slot]
    if not box.further and counter not in {signal.place.text for signal in box.signals}:
        yield "    # no sample counter on this bus: every frame is a new sample"
        yield f"    ecu.{counter} = (ecu.{counter} + 1) & 15"


def _others(box: Mailbox, frames: Sequence[Mailbox]) -> int:
    """The bits of ecu.valid that the other frames of its message set."""
    others = [other for other in frames if other is not box]
    twins = any(signal.twin for other in others for signal in other.signals)
    return sum(other.bits for other in others) | (DISAGREES if twins else 0)


def _valid_order(bits: tuple[str, ...], signal: MappedSignal) -> int:
    return bits.index(signal.place.text) if signal.place.text in bits else len(bits)


def _raw_signals(signals: Iterable[MappedSignal]) -> Iterable[RawSignal]:
    """All raw signals a frame carries for ``signals``, including second signals and sign bits."""
    for signal in signals:
        yield from signal.parts


def _unpack_signal(
    signal: MappedSignal, bits: tuple[str, ...], frame: tuple[str, ...]
) -> Iterable[str]:
    place, name, indent = signal.place, raw_name(signal), "    "
    value = unpacked(signal)
    if place.text in SAMPLE_COUNTERS.values() and signal.length > COUNTER_BITS:
        value = f"{name} & {(1 << COUNTER_BITS) - 1}"
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
    condition = available(signal, frame)
    if condition:
        yield from wrapped(f"    {keyword} {condition}:", LINE)
    elif signal.twin is not None:
        yield "    else:"
    if condition or signal.twin is not None:
        indent = "        "
    if signal.minus is not None:
        yield f"{indent}if ({gathered(signal.minus, frame)}) == 1:"
        yield f"{indent}    {name} = -{name}"
    yield from wrapped(f"{indent}ecu.{place.text} = {value}", LINE)
    if place.text in bits:
        yield f"{indent}valid |= {1 << bits.index(place.text)}"


def _unpack_mean(
    alike: Sequence[MappedSignal], bits: tuple[str, ...], frame: tuple[str, ...]
) -> Iterable[str]:
    """The statements that take the mean or sum of signals, where all of them have a value."""
    place, indent = alike[0].place, "    "
    for signal in alike:
        yield from wrapped(f"    {raw_name(signal)}: i32 = {gathered(signal, frame)}", LINE)
    conditions = dict.fromkeys(filter(None, (available(signal, frame) for signal in alike)))
    for condition in conditions:
        yield from wrapped(f"{indent}if {condition}:", LINE)
        indent += "    "
    count = 1 if any(signal.added for signal in alike) else len(alike)
    yield f"{indent}total: i64 = {share(alike[0], count)}"
    yield from (f"{indent}total += {share(signal, count)}" for signal in alike[1:])
    yield f"{indent}ecu.{place.text} = clamp(total, {place.lo}, {place.hi})"
    if place.text in bits:
        yield f"{indent}valid |= {1 << bits.index(place.text)}"


def _dispatch_unpack(bus: BusMap) -> Iterable[str]:
    yield "def unpack(ecu: Ecu, number: i32, slot: i32) -> None:"
    yield '    """Unpack frame ``number`` from mailbox ``slot``."""'
    several = any(box.is_long for box in bus.received)
    if not several:
        yield "    frame: i64 = received(ecu, slot)"
    keyword = "if"
    for number, box in _numbered(bus):
        source = "slot" if box.is_long else "received(ecu, slot)" if several else "frame"
        yield f"    {keyword} number == {number}:"
        yield f"        {_unpacker(box)}(ecu, {source})"
        keyword = "elif"


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
