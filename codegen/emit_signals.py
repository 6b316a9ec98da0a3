"""firmware/signals.py from a DBC and its map: bits, scaling and limits as subset code.

    python -m codegen.emit_signals [--check]

writes (or compares) the checked-in module for ``dbc/roll_control.dbc``. One integer multiply and
one rounding shift turn a raw code into a field's format and back; the factor is exact to 2**-29.
"""

import argparse
import sys
from collections.abc import Iterable
from fractions import Fraction
from math import floor
from pathlib import Path

from codegen.bus_map import (
    RECEIVED,
    SAMPLE_COUNTERS,
    TRANSMITTED,
    VALID_BITS,
    BusMap,
    Mailbox,
    load,
)
from codegen.mapped_signal import MappedSignal, Piece

ROOT = Path(__file__).resolve().parent.parent
DBC = ROOT / "dbc" / "roll_control.dbc"
MAP = ROOT / "dbc" / "roll_control.toml"
SIGNALS = ROOT / "firmware" / "signals.py"

FACTOR_BITS = 30
LINE = 100

HEADER = '''\
"""Every signal's bits, scaling and limits; made by codegen.emit_signals, not to be edited.

Frames of {names}.
``unpack`` turns the bytes of a mailbox into fields; a signal that carries one of its reserved
codes (error, not available) keeps its field and clears its bit of ``ecu.valid``. ``pack`` writes
the bytes of a frame, rounded to nearest and limited as the DBC says; E2E adds its header.
"""

from firmware.state import {imports}
from firmware.subset import byte, clamp, i32, rsh, u8
'''


def generate(dbc: Path = DBC, map_file: Path = MAP) -> str:
    """Return the subset source of the signals module for ``dbc`` and ``map_file``."""
    bus = load(dbc, map_file)
    slots = sorted([f"RX_{s.upper()}" for s in RECEIVED] + [f"TX_{s.upper()}" for s in TRANSMITTED])
    imports = "".join(f"    {name},\n" for name in [*slots, "Ecu"])
    lines = HEADER.format(names=dbc.name, imports=f"(\n{imports})").splitlines()
    lines += ["", *_tables(bus)]
    for box in bus.received:
        lines += ["", "", *_unpack(box)]
    for box in bus.transmitted:
        lines += ["", "", *_pack(box)]
    lines += ["", "", *_dispatch("unpack", RECEIVED, "ecu: Ecu, message: i32, slot: i32")]
    lines += ["", "", *_dispatch("pack", TRANSMITTED, "ecu: Ecu, message: i32")]
    return "\n".join(lines) + "\n"


def _tables(bus: BusMap) -> Iterable[str]:
    yield "# identifiers (bit 30: a 29-bit one; 0: the mailbox stays empty), lengths, E2E data ids"
    for prefix, boxes in (("RX", bus.received), ("TX", bus.transmitted)):
        ids = ", ".join(f"0x{box.ident:X}" if box.name else "0" for box in boxes)
        yield f"{prefix}_IDS: tuple[i32, ...] = ({ids})"
        yield f"{prefix}_LENGTHS: tuple[u8, ...] = ({', '.join(str(b.length) for b in boxes)})"
        yield f"{prefix}_DATA_IDS: tuple[i32, ...] = ({', '.join(str(b.data_id) for b in boxes)})"


def _unpack(box: Mailbox) -> Iterable[str]:
    yield f"def unpack_{box.slot}(ecu: Ecu, slot: i32) -> None:"
    receiver = f"RX_{box.slot.upper()}"
    if not box.name:
        yield '    """Nothing on this bus fills the mailbox: its signals stay not available."""'
        yield f"    ecu.valid[{receiver}] = 0"
        return
    yield f'    """Take the signals of {_identified(box)} from mailbox ``slot``."""'
    for used in sorted({piece.byte for signal in box.signals for piece in signal.pieces}):
        yield f"    b{used}: u8 = ecu.rx_payload[slot][{used}]"
    bits = VALID_BITS[box.slot]
    yield "    valid: u8 = 0"
    first = "valid ="
    for signal in sorted(box.signals, key=lambda s: _valid_order(bits, s)):
        for line in _unpack_signal(signal, bits):
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


def _unpack_signal(signal: MappedSignal, bits: tuple[str, ...]) -> Iterable[str]:
    place, name, indent = signal.place, _raw(signal), "    "
    value = _scaled(name, signal.scale, signal.offset)
    fits = value == name and not signal.signed and place.lo <= 0
    fits = fits and (1 << signal.length) - 1 <= place.hi
    if fits and not signal.unavailable:
        value = _gather(signal)
    else:
        yield from _wrapped(f"    {name}: i32 = {_gather(signal)}")
        if not fits:
            value = f"clamp({value}, {place.lo}, {place.hi})"
            value = f"byte({value})" if place.lo >= 0 and place.hi <= 255 else value
        if signal.unavailable:
            yield f"    if {_available(signal, name)}:"
            indent = "        "
    yield from _wrapped(f"{indent}ecu.{place.text} = {value}")
    if place.text in bits:
        yield f"{indent}valid |= {1 << bits.index(place.text)}"


def _wrapped(line: str) -> Iterable[str]:
    """Break a line that is too long after its outermost opening parenthesis."""
    if len(line) <= LINE:
        yield line
        return
    opening = line.index("(")
    depth, closing = 1, opening
    while depth:
        closing += 1
        depth += {"(": 1, ")": -1}.get(line[closing], 0)
    indent = " " * (len(line) - len(line.lstrip()))
    yield line[: opening + 1]
    yield f"{indent}    {line[opening + 1 : closing]}"
    yield f"{indent}{line[closing:]}"


def _available(signal: MappedSignal, name: str) -> str:
    top = (1 << signal.length) // (2 if signal.signed else 1)
    codes = signal.unavailable
    if codes == tuple(range(top - len(codes), top)):
        return f"{name} < {codes[0]}"
    return " and ".join(f"{name} != {code}" for code in codes)


def _gather(signal: MappedSignal) -> str:
    """The raw code from the payload's bytes; the sign comes by offset, without a branch."""
    terms = []
    for piece in signal.pieces:
        term = f"b{piece.byte}"
        shifted = piece.bit > 0
        if shifted:
            term = f"{term} >> {piece.bit}"
        if piece.bit + piece.width < 8:
            term = f"({term})" if shifted else term
            term = f"{term} & {(1 << piece.width) - 1}"
            shifted = True
        if piece.signal_bit:
            term = f"({term})" if shifted else term
            term = f"{term} << {piece.signal_bit}"
            shifted = True
        terms.append(f"({term})" if shifted and len(signal.pieces) > 1 else term)
    gathered = " | ".join(terms)
    if not signal.signed:
        return gathered
    half = 1 << (signal.length - 1)
    inner = f"({gathered})" if len(terms) > 1 or "&" in gathered or ">>" in gathered else gathered
    return f"({inner} ^ {half}) - {half}"


def _scaled(variable: str, scale: Fraction, offset: Fraction) -> str:
    """``scale`` * variable + ``offset``, as one multiply and, where needed, one rounding shift."""
    shift = _shift(scale)
    factor = round(scale * 2**shift)
    text = variable if factor == 1 else f"{variable} * {factor}"
    added = round(offset * 2**shift)
    if added:
        text = f"{text} {'+' if added > 0 else '-'} {abs(added)}"
    return f"rsh({text}, {shift})" if shift else text


def _shift(scale: Fraction) -> int:
    """The least shift at which ``scale`` is an integer, or one that leaves 30 bits of it."""
    denominator = scale.denominator
    exact = denominator.bit_length() - 1
    if denominator == 1 << exact and abs(scale) * denominator < 1 << FACTOR_BITS:
        return exact
    magnitude = floor(abs(scale)).bit_length() if abs(scale) >= 1 else 0
    while abs(scale) * 2 ** (FACTOR_BITS - magnitude) < 1 << (FACTOR_BITS - 1):
        magnitude -= 1
    return min(FACTOR_BITS - magnitude, 62)


def _pack(box: Mailbox) -> Iterable[str]:
    yield f"def pack_{box.slot}(ecu: Ecu) -> None:"
    sender = f"TX_{box.slot.upper()}"
    if not box.name:
        yield '    """Nothing on this bus takes the frame: it stays empty."""'
        yield f"    ecu.tx_payload[{sender}][0] = 0"
        return
    yield f'    """Fill the payload of {_identified(box)}."""'
    common = [signal for signal in box.signals if signal.page is None]
    pages = sorted({signal.page for signal in box.signals if signal.page is not None})
    paged = {
        piece.byte for signal in box.signals if signal.page is not None for piece in signal.pieces
    }
    yield from _fill(sender, common, set(range(box.length)) - paged, "    ")
    keyword = "if"
    for page in pages:
        yield f"    {keyword} ecu.diagnostics_page == {page}:"
        keyword = "elif"
        shown = [signal for signal in box.signals if signal.page == page]
        yield from _fill(sender, shown, paged, "        ")


def _fill(sender: str, signals: list[MappedSignal], where: set[int], indent: str) -> Iterable[str]:
    """Write the bytes ``where`` of a payload from the raw codes of ``signals``."""
    for signal in signals:
        if not _inline(signal):
            yield from _wrapped(f"{indent}{_raw(signal)}: i32 = {_code(signal)}")
    for k in sorted(where):
        terms = sorted(
            (piece.bit, _bits(signal, piece))
            for signal in signals
            for piece in signal.pieces
            if piece.byte == k
        )
        value = " | ".join(term for _, term in terms)
        if len(terms) == 1 and value.startswith("("):
            value = value[1:-1]
        value = f"byte({value})" if terms else "0"
        yield from _wrapped(f"{indent}ecu.tx_payload[{sender}][{k}] = {value}")


def _code(signal: MappedSignal) -> str:
    """The raw code of a field, rounded and limited as the DBC says."""
    place = signal.place
    source = f"ecu.{place.text}"
    if place.mask is not None:
        source = f"({source} & {place.mask})"
    value = _scaled(source, 1 / signal.scale, -signal.offset / signal.scale)
    if value == source and signal.raw_lo <= place.lo and place.hi <= signal.raw_hi:
        return value
    return f"clamp({value}, {signal.raw_lo}, {signal.raw_hi})"


def _raw(signal: MappedSignal) -> str:
    return f"raw_{_snake(signal.name)}"


def _inline(signal: MappedSignal) -> bool:
    return len(signal.pieces) == 1 and "clamp" not in _code(signal)


def _bits(signal: MappedSignal, piece: Piece) -> str:
    term = _code(signal) if _inline(signal) else _raw(signal)
    if piece.signal_bit:
        term = f"({term} >> {piece.signal_bit})"
    if piece.bit or piece.width < 8:
        term = f"({term} & {(1 << piece.width) - 1})"
    return f"({term} << {piece.bit})" if piece.bit else term


def _dispatch(what: str, slots: tuple[str, ...], parameters: str) -> Iterable[str]:
    yield f"def {what}({parameters}) -> None:"
    prefix, rest = ("RX", "ecu, slot") if what == "unpack" else ("TX", "ecu")
    where = " from mailbox ``slot``" if what == "unpack" else ""
    yield f'    """{what.capitalize()} the frame that is number ``message``{where}."""'
    keyword = "if"
    for slot in slots:
        yield f"    {keyword} message == {prefix}_{slot.upper()}:"
        yield f"        {what}_{slot}({rest})"
        keyword = "elif"


def _identified(box: Mailbox) -> str:
    return f"{box.name} (0x{box.ident:X})"


def _snake(name: str) -> str:
    parts: list[str] = []
    for i, letter in enumerate(name):
        after_lower = i > 0 and (name[i - 1].islower() or name[i - 1].isdigit())
        if letter.isupper() and after_lower:
            parts.append("_")
        parts.append(letter.lower())
    return "".join(parts)


def main() -> int:
    """Write firmware/signals.py, or with ``--check`` say whether it is up to date."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    arguments = parser.parse_args()
    text = generate()
    if arguments.check:
        return 0 if SIGNALS.read_text(encoding="utf-8") == text else 1
    SIGNALS.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
