"""Authenticated frames in a bundle: the key's file, the example's calls, and a test by itself."""

from collections.abc import Iterator, Sequence
from importlib.resources import files

from codegen.run.bus_firmware import BusFirmware
from codegen.run.secured import LISTENING_US
from dbc.keys import DEVELOPMENT_KEY
from firmware.calibration import Calibration
from firmware.security.secoc_state import PAYLOAD, SECURED

NOTE = """
## Authenticated frames

The frames have 16 bytes on the bus, as AUTOSAR SecOC prescribes: the eight of the loop, a freshness
value and a MAC. `board/node.c` is how a board calls it, from the task of the loop and not from
an interrupt. Own one more record, `static canroll_secoc secoc;`, and memory that lasts for the
number of starts and for `secoc.rx_reset`. After `canroll_init` call `canroll_secoc_start` with the
key, the number of this start and the ticks to listen for, and `canroll_secoc_resume` with the last
known start of each sender; once a tick `canroll_secoc_elapse`; `canroll_secoc_verify` for each
frame, and `canroll_receive` where it returns 1; `canroll_secoc_protect` for each frame before it is
sent.

**`src/canroll_key.c` holds the public development key: replace the file.** No other file has a key.
"""
FILES = (
    "| `src/canroll_key.c` | the key of the bus; as it is a public one: replace it |\n"
    "| `test/test_secoc.c` | authentication as a board calls it, tested by a session |\n"
)
KEY_HEADER = """\
/* The key of the bus, AES of 128 bits. */
#ifndef CANROLL_KEY_H
#define CANROLL_KEY_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

extern const uint8_t canroll_key[16];

#ifdef __cplusplus
}
#endif

#endif
"""
KEY_SOURCE = """\
/* REPLACE THIS FILE: this is the public development key. Yours may come from protected memory. */
#include "canroll_key.h"

const uint8_t canroll_key[16] = {{ {key} }};
"""
RECORD = """
static canroll_secoc secoc;

/* The number of this start, which memory that lasts has counted. */
__attribute__((weak)) int32_t starts(void)
{
    return 1;
}"""
PLACES = {
    "include": '\n#include "canroll_key.h"',
    "prototype": "\nint32_t starts(void);\n",
    "record": RECORD,
    "verified": "\n                && canroll_secoc_verify(&secoc, message, payload, length) == 1",
    "protected": "\n            canroll_secoc_protect(&secoc, slot, ecu.tx_payload[slot]);",
    "start": "\n    canroll_secoc_start(&secoc, canroll_key, starts(), {listening});",
    "elapsed": "\n    canroll_secoc_elapse(&secoc, elapsed);",
}
"""What node.c has of authentication, by the placeholder ``{secoc_…}`` in its template."""
TEST_KEY = bytes(range(0x30, 0x40))
LISTENING = 3
HEARD: tuple[tuple[int, int, int | None], ...] = (
    *((1, 0, None), (1, 1, None), (1, 2, None), (1, 3, None), (1, 3, None), (1, 9, None)),
    *((1, 8, None), (1, 10, 5), (1, 10, 66), (1, 10, 90), (1, 10, 127), (1, 10, None)),
    *((2, 0, None), (1, 11, None), (2, 1, None), (130, 0, None), (129, 0, None), (129, 1, None)),
)
"""Start, number and flipped bit of the frames that the session's node hears: some repeated, old,
damaged, or of a start too far ahead."""


def example(text: str, firmware: BusFirmware, record: Calibration) -> str:
    """Fill the placeholders in the example's template, with nothing on a plain bus."""
    listening = str(-(-LISTENING_US // record.tick_us))
    for place, code in PLACES.items():
        its = code.replace("{listening}", listening) if firmware.bus.secured else ""
        text = text.replace(f"{{secoc_{place}}}", its)
    return text


def sources(firmware: BusFirmware) -> dict[str, str]:
    """Return the files of the key and of the test by their places in the bundle."""
    template = files("codegen.export").joinpath("templates", "test_secoc.c")
    key = ", ".join(f"0x{byte:02X}" for byte in DEVELOPMENT_KEY)
    return {
        "include/canroll_key.h": KEY_HEADER,
        "src/canroll_key.c": KEY_SOURCE.format(key=key),
        "test/test_secoc.c": template.read_text(encoding="utf-8"),
        "test/secoc_session.h": "\n".join(_session(firmware)),
    }


def _session(firmware: BusFirmware) -> Iterator[str]:
    """A session by the reference: frames protected, and frames of another node judged."""
    secoc, state = firmware.module("security.secoc"), firmware.module("security.secoc_state")
    its, other = state.Secoc(), state.Secoc()
    for one in (its, other):
        secoc.start(one, list(TEST_KEY), 7, LISTENING)
    sent = []
    for step in range(24):
        plain = [(11 * step + k) & 255 for k in range(PAYLOAD)]
        frame = [*plain, *[0] * (SECURED - PAYLOAD)]
        secoc.protect(its, step % len(firmware.sent), frame)
        sent.append((step % len(firmware.sent), plain, frame))
    judged = []
    for reset, count, flipped in HEARD:
        frame = [*range(count & 15, PAYLOAD + (count & 15)), reset & 255, *count.to_bytes(3, "big")]
        mac = secoc.authenticate(other, secoc.RX_DATA_IDS[0], frame, reset, count)
        frame += [mac >> shift & 255 for shift in (24, 16, 8, 0)]
        if flipped is not None:
            frame[flipped // 8] ^= 1 << flipped % 8
        secoc.elapse(its, 1)
        judged.append((secoc.verify(its, 0, frame, SECURED), frame))
    yield "/* A session of authenticated frames, judged by the reference. */"
    yield "#include <stdint.h>"
    yield ""
    yield f"#define SECOC_SENT {len(sent)}"
    yield f"#define SECOC_RECEIVED {len(judged)}"
    yield f"#define SECOC_LISTENING {LISTENING}"
    yield f"#define SECOC_REFUSED {its.refused}"
    yield ""
    yield "typedef struct { int32_t slot; uint8_t plain[8], secured[16]; } secoc_sent_frame;"
    yield "typedef struct { int32_t taken; uint8_t frame[16]; } secoc_received_frame;"
    yield ""
    yield f"static const uint8_t secoc_key[16] = {{ {_listed(TEST_KEY)} }};"
    yield f"static const secoc_sent_frame secoc_sent[{len(sent)}] = {{"
    for slot, plain, secured in sent:
        yield f"    {{ {slot}, {{ {_listed(plain)} }}, {{ {_listed(secured)} }} }},"
    yield "};"
    yield f"static const secoc_received_frame secoc_received[{len(judged)}] = {{"
    for taken, frame in judged:
        yield f"    {{ {taken}, {{ {_listed(frame)} }} }},"
    yield "};"
    yield ""


def _listed(values: Sequence[int] | bytes) -> str:
    return ", ".join(str(value) for value in values)
