"""Comparison of a bundle's codec with cantools: a C program and the mapping of signals.

The program runs the loop's own unpacking and packing on raw frames; ``test_codec.py`` of the bundle
decodes and encodes the same frames with cantools.
"""

import json
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from canroll.codegen.frame.raw_signal import RawSignal, real_of
from canroll.codegen.frame.units import conversion
from canroll.codegen.generated.bus_map import BusMap
from canroll.codegen.generated.mailbox import IN_TURN, VALID_BITS, Mailbox
from canroll.codegen.generated.mapped_signal import MappedSignal
from canroll.dbc import read
from canroll.dbc.reader import Files, each
from canroll.firmware.state import Ecu
from canroll.firmware.subset import fields

PROGRAM = """\
/* Frames in, fields out, and back, as the loop does it: test_codec.py compares it with cantools. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "canroll.h"

int main(int argc, char **argv);

static canroll_ecu ecu;
static int32_t values[{most}];

static size_t get(int32_t message)
{{
    switch (message) {{
{get}    default:
        return 0;
    }}
}}

static size_t set(int32_t message, int32_t page)
{{
    switch ({slots} * page + message) {{
{set}    default:
        return 0;
    }}
}}

int main(int argc, char **argv)
{{
    if (argc < 4) {{
        return 2;
    }}
    const int32_t message = (int32_t)strtol(argv[2], NULL, 10);
    const int32_t page = (int32_t)strtol(argv[3], NULL, 10);
    if (strcmp(argv[1], "receive") == 0) {{
        const size_t length = canroll_signals_rx_lengths[message];
        uint8_t payload[sizeof ecu.rx_payload[0]] = {{ 0 }};
        while (fread(payload, 1, length, stdin) == length) {{
            memset(&ecu, 0, sizeof ecu);
            memcpy((void *)ecu.rx_payload[0], payload, sizeof payload);
            const int32_t wanted = canroll_signals_wanted(message, payload);
            canroll_signals_unpack(&ecu, message, 0);
            const size_t count = get(message);
            const int32_t head[2] = {{ wanted, ecu.valid[canroll_signals_rx_messages[message]] }};
            fwrite(head, sizeof head[0], 2, stdout);
            fwrite(values, sizeof values[0], count, stdout);
        }}
        return 0;
    }}
    const size_t count = set(message, page < 0 ? 0 : page);
    while (fread(values, sizeof values[0], count, stdin) == count) {{
        set(message, page < 0 ? 0 : page);
        canroll_signals_pack(&ecu, message);
        fwrite(ecu.tx_payload[message], 1, canroll_signals_tx_lengths[message], stdout);
    }}
    return 0;
}}
"""


def files(description: Files, map_file: Path, bus: BusMap) -> dict[str, str]:
    """Return ``codec_main.c`` and ``codec.json`` for a bus, by name."""
    document = tomllib.loads(map_file.read_text(encoding="utf-8"))
    rows = list(_rows(bus))
    database, _ = read(description)
    units = {
        (message.name, signal.name): signal.unit or ""
        for message in database.messages
        for signal in message.signals
    }
    told = []
    for direction, number, box, page, signals in rows:
        entries = _entries(document[direction][box.slot], box.name)
        told.append(
            {
                "direction": direction,
                "number": number,
                "message": box.name,
                "page": -1 if page is None else page,
                "length": box.length if direction == "receive" else box.sent_length,
                "selector": _selector(box) if direction == "receive" else ["", ""],
                "in_use": sorted({part.name for signal in signals for part in signal.parts}),
                "signals": [
                    _signal(box, signal, entries[signal.name], units[box.name, signal.name])
                    for signal in signals
                ],
            }
        )
    slots = len(bus.transmitted)
    source = PROGRAM.format(
        most=max([len(row[-1]) for row in rows], default=1),
        slots=slots,
        get="".join(_case(n, signals, "get") for d, n, _, _, signals in rows if d == "receive"),
        set="".join(
            _case(slots * (page or 0) + n, signals, "set", page)
            for d, n, _, page, signals in rows
            if d == "transmit"
        ),
    )
    about = {"databases": [path.name for path in each(description)], "rows": told}
    return {"codec_main.c": source, "codec.json": json.dumps(about, indent=1) + "\n"}


def _entries(table: Any, message: str) -> Mapping[str, Any]:  # noqa: ANN401
    """The signals that the map places in a message: of a mailbox's only frame or of one of them."""
    tables = table if isinstance(table, list) else [table]
    return next(each["signals"] for each in tables if each["message"] == message)


def _rows(
    bus: BusMap,
) -> Iterator[tuple[str, int, Mailbox, int | None, tuple[MappedSignal, ...]]]:
    """Rows of direction, number, mailbox, number of the page that is sent, signals."""
    for number, box in enumerate(bus.received):
        if box.name:
            yield "receive", number, box, None, box.signals
    for number, box in enumerate(bus.transmitted):
        if box.slot == IN_TURN and box.pages:
            for place, page in enumerate(box.pages):
                there = tuple(its for its in box.signals if its.page in (None, page))
                yield "transmit", number, box, place, there
        elif box.name:
            yield "transmit", number, box, None, box.signals


def _signal(box: Mailbox, signal: MappedSignal, entry: Any, unit: str) -> dict[str, Any]:  # noqa: ANN401
    table = {"field": entry} if isinstance(entry, str) else entry
    place, twin = signal.place, signal.twin
    bits = VALID_BITS.get(box.slot, ())
    own_unit, radius = str(table.get("unit", unit)), table.get("radius")
    limits = (signal.raw_lo, signal.raw_hi)
    low, high = map(real_of, limits) if signal.real else limits
    factor = conversion(own_unit, "rad/s" if radius else place.unit, place.text, box.name)
    return {
        "signal": signal.name,
        "field": place.text,
        "q": place.q,
        "lo": place.lo,
        "hi": place.hi,
        "unit": float(factor) * (1.0 if radius is None else float(radius)),
        "factor": table.get("factor"),
        "offset": table.get("offset"),
        "sign": -1 if table.get("sign") == -1 else 1,
        "minus": signal.minus.name if signal.minus else None,
        "twin": twin.signal.name if twin else None,
        "inverted": bool(twin and twin.inverted),
        "tolerance": twin.tolerance if twin else 0,
        "unavailable": list(signal.unavailable),
        "added": signal.added,
        "validity": signal.validity.signal.name if signal.validity else None,
        "codes": list(signal.validity.codes) if signal.validity else [],
        "bit": bits.index(place.text) if place.text in bits else None,
        "real": signal.real,
        "raw_lo": low,
        "raw_hi": high,
    }


def _selector(box: Mailbox) -> list[str]:
    """The bits of the selector in a frame, and what they are on the mailbox's page."""
    mask, value = bytearray(box.length), bytearray(box.length)
    if box.selector is not None:
        _put(box.selector, (1 << box.selector.length) - 1, mask)
        _put(box.selector, box.pages[0], value)
    return [mask.hex(), value.hex()]


def _put(signal: RawSignal, raw: int, frame: bytearray) -> None:
    for piece in signal.pieces:
        part = raw >> piece.signal_bit & (1 << piece.width) - 1
        frame[piece.byte] |= part << piece.bit


def _case(
    number: int, signals: tuple[MappedSignal, ...], which: str, page: int | None = None
) -> str:
    kinds = {field.name: field.kind for field in fields(Ecu)}
    lines = [f"    case {number}:"]
    for i, signal in enumerate(signals):
        text = signal.place.text
        if which == "get":
            lines.append(f"        values[{i}] = ecu.{text};")
        else:
            cast = "(uint8_t)" if kinds[text.partition("[")[0]] == "u8" else ""
            lines.append(f"        ecu.{text} = {cast}values[{i}];")
    if page is not None:
        lines.append(f"        ecu.diagnostics_page = {page};")
    lines.append(f"        return {len(signals)};")
    return "\n".join(lines) + "\n"
