"""Authenticated frames in a bundle: the key's file, the example's calls, and a test by itself."""

from canroll.codegen.export.sessions.session import Session
from canroll.codegen.run import native
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.secured import LISTENING_US, SecocModule
from canroll.dbc.keys import DEVELOPMENT_KEY
from canroll.firmware.calibration import Calibration
from canroll.firmware.security.secoc_state import MAC_AT, PAYLOAD, SECURED

NOTE = """
## Authenticated frames

The frames have 20 bytes on the bus, as AUTOSAR SecOC prescribes: the eight of the loop, a freshness
value and a MAC. `board/node.c` is how a board calls it, from the task of the loop and not from
an interrupt. Own one more record, `static canroll_secoc secoc;`, and memory that lasts for the
number of starts and for `secoc.rx_reset`. After `canroll_init` call `canroll_secoc_start` with the
key, the number of this start and the ticks to listen for, and `canroll_secoc_resume` with the last
known start of each sender; once a tick `canroll_secoc_elapse`; `canroll_secoc_verify` for each
frame, and `canroll_receive` where it returns 1; `canroll_secoc_protect` for each frame before it is
sent. After 2^24 - 1 frames it goes on as the next start: keep `secoc.tx_reset` before the frame is
sent, as `keep_starts` of the example has to.

**`src/canroll_key.c` holds the public development key: replace the file.** No other file has a key.
As it is it compiles only where `CANROLL_PUBLIC_KEY` is defined, as `make example.elf
DEFINES=-DCANROLL_PUBLIC_KEY` does for a board; the tests do without it.
"""
FILES = (
    "| `src/canroll_key.c` | the key of the bus; as it is a public one: replace it |\n"
    "| `test/session_secoc.c` | frames protected and verified, compared byte for byte |\n"
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

#ifndef CANROLL_PUBLIC_KEY
#error "src/canroll_key.c has the public development key: replace it, or define CANROLL_PUBLIC_KEY"
#endif

const uint8_t canroll_key[16] = {{ {key} }};
"""
RECORD = """
static canroll_secoc secoc;

/* The number of this start, which memory that lasts has counted. */
__attribute__((weak)) int32_t starts(void)
{
    return 1;
}

/* To memory that lasts, before a frame of this start is sent. */
__attribute__((weak)) void keep_starts(int32_t number)
{
    (void)number;
}"""
PLACES = {
    "include": '\n#include "canroll_key.h"',
    "prototype": "\nint32_t starts(void);\nvoid keep_starts(int32_t number);\n",
    "record": RECORD,
    "verified": "\n                && canroll_secoc_verify(&secoc, message, payload, length) == 1",
    "protected": """
            const int32_t start = secoc.tx_reset;
            canroll_secoc_protect(&secoc, slot, ecu.tx_payload[slot]);
            if (secoc.tx_reset != start) {
                keep_starts(secoc.tx_reset);
            }""",
    "start": "\n    canroll_secoc_start(&secoc, canroll_key, starts(), {listening});",
    "elapsed": "\n    canroll_secoc_elapse(&secoc, elapsed);",
}
"""What node.c has of authentication, by the placeholder ``{secoc_…}`` in its template."""
TEST_KEY = bytes(range(0x30, 0x40))
LISTENING = 3
SENT = 24
HEARD: tuple[tuple[int, int, int | None], ...] = (
    *((1, 0, None), (1, 1, None), (1, 2, None), (1, 3, None), (1, 3, None), (1, 9, None)),
    *((1, 8, None), (1, 10, 5), (1, 10, 66), (1, 10, 111), (1, 10, 159), (1, 10, None)),
    *((2, 0, None), (1, 11, None), (2, 1, None), (70000, 0, None), (69999, 7, None)),
    *((70000, 1, None),),
)
"""Start, number and flipped bit of the frames that the session's node hears: some repeated, old,
damaged, or of a start far ahead."""


def example(text: str, firmware: BusFirmware, record: Calibration) -> str:
    """Fill the placeholders in the example's template, with nothing on a plain bus."""
    listening = str(-(-LISTENING_US // record.tick_us))
    for place, code in PLACES.items():
        its = code.replace("{listening}", listening) if firmware.bus.secured else ""
        text = text.replace(f"{{secoc_{place}}}", its)
    return text


def sources(firmware: BusFirmware) -> dict[str, str]:
    """Return the files of the key and of the test by their places in the bundle."""
    key = ", ".join(f"0x{byte:02X}" for byte in DEVELOPMENT_KEY)
    return {
        "include/canroll_key.h": KEY_HEADER,
        "src/canroll_key.c": KEY_SOURCE.format(key=key),
        "test/session_secoc.c": _source(firmware),
    }


def _source(firmware: BusFirmware) -> str:
    return session(firmware).source(
        "Authenticated frames, sent and received.",
        f"SecOC, {SENT} frames sent and {len(HEARD)} judged, byte for byte",
    )


def session(firmware: BusFirmware) -> Session:
    """A session by the reference: frames protected, and frames of another node judged."""
    session = Session(native.NativeMachine(firmware), firmware)
    session.begin("SecOC")
    node = SecocModule(session, firmware)
    node.start(TEST_KEY, 7, LISTENING)
    for step in range(SENT):
        plain = bytes((11 * step + k) & 255 for k in range(PAYLOAD))
        node.protect(step % len(firmware.sent), plain.ljust(SECURED, b"\0"))
    secoc, state = firmware.module("security.secoc"), firmware.module("security.secoc_state")
    other = state.Secoc()
    secoc.start(other, list(TEST_KEY), 7, LISTENING)
    for reset, count, flipped in HEARD:
        frame = [*range(count & 15, PAYLOAD + (count & 15))]
        frame += [*reset.to_bytes(3, "big"), *count.to_bytes(3, "big")]
        secoc.authenticate(other, secoc.RX_DATA_IDS[0], frame)
        mac = b"".join((word & 0xFFFFFFFF).to_bytes(4, "big") for word in other.block)
        frame += mac[: SECURED - MAC_AT]
        if flipped is not None:
            frame[flipped // 8] ^= 1 << flipped % 8
        node.elapse(1)
        node.verify(0, bytes(frame), SECURED)
    session.digest(session.records["secoc"])
    return session
