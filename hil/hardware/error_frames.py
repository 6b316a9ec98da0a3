"""Error frames in words, by the classes of Linux's SocketCAN (linux/can/error.h)."""

from collections import Counter
from collections.abc import Iterable

UNCLASSIFIED = "unclassified"
CLASSES = {
    0x001: "transmit timeout",
    0x002: "lost arbitration",
    0x010: "transceiver",
    0x020: "no acknowledgement",
    0x040: "bus off",
    0x080: "bus error",
    0x100: "controller restarted",
}
"""By bit of the identifier; 0x004, 0x008 and 0x200 say more in their data."""
CONTROLLER, PROTOCOL, COUNTERS = 0x004, 0x008, 0x200
CONTROLLER_STATES = {
    0x01: "receive overflow",
    0x02: "transmit overflow",
    0x04: "error warning",
    0x08: "error warning",
    0x10: "error passive",
    0x20: "error passive",
    0x40: "error active again",
}
"""By bit of the second byte."""
VIOLATIONS = {
    0x01: "bit error",
    0x02: "form error",
    0x04: "stuff error",
    0x08: "bit error",
    0x10: "bit error",
    0x20: "overload",
}
"""By bit of the third byte; the others say where it was and which side sent."""


def names(ident: int, data: bytes) -> set[str]:
    """Return the errors that a frame reports; one frame may report several."""
    padded = data.ljust(8, b"\0")
    violated = {name for bit, name in CLASSES.items() if ident & bit}
    if ident & CONTROLLER:
        states = {name for bit, name in CONTROLLER_STATES.items() if padded[1] & bit}
        violated |= states or {"controller"}
    if ident & PROTOCOL:
        violations = {name for bit, name in VIOLATIONS.items() if padded[2] & bit}
        violated |= violations or {"protocol violation"}
    if ident & COUNTERS and not violated:
        violated = {"error counters"}
    return violated or {UNCLASSIFIED}


def count(frames: Iterable[tuple[int, bytes]], *, classified: bool) -> dict[str, int]:
    """Return the number of reports of each error, by name.

    Args:
        frames: identifier and data of each error frame.
        classified: they carry error classes; else each counts as unclassified.
    """
    counted: Counter[str] = Counter()
    for ident, data in frames:
        counted.update(names(ident, data) if classified else {UNCLASSIFIED})
    return dict(sorted(counted.items()))
