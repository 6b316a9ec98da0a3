"""Authenticated frames of a map: what AUTOSAR SecOC puts behind them, as the firmware has it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cantools.database import Message

from canroll import documents
from canroll.codegen.frame.frame_protection import Protection
from canroll.codegen.frame.raw_signal import bits_of
from canroll.errors import CanrollError, UnknownNameError
from canroll.firmware.security.secoc_state import FRESHNESS_AT, MAC_AT, PAYLOAD, SECURED

FRESHNESS, AUTHENTICATOR = "Freshness", "Authenticator"
"""Names of the signals behind an authenticated frame, unless the map has others."""
OF_SECOC = {"freshness": (FRESHNESS, FRESHNESS_AT), "authenticator": (AUTHENTICATOR, MAC_AT)}
"""Keys of [secoc]: the signal's usual name, and the byte where its six begin, high byte first."""


def names_of(table: Mapping[str, Any], map_file: Path) -> dict[int, str]:
    """Return the names of the two signals behind an authenticated frame, by their first byte."""
    documents.refuse_unknown(table, OF_SECOC, f"key in {map_file} [secoc]")
    found = {at: table.get(key, name) for key, (name, at) in OF_SECOC.items()}
    for name in found.values():
        if not isinstance(name, str):
            raise CanrollError(f"{map_file} [secoc]: {name!r} must be the name of a signal")
    return found


def refuse_unsecured(message: Message, secoc: Mapping[int, str], where: str) -> None:
    """Refuse a frame that cannot be authenticated as the firmware does it."""
    if not message.is_fd or message.length != SECURED:
        raise CanrollError(
            f"{where}: {message.name} must be a CAN FD frame of {SECURED} bytes to be "
            "authenticated: change it in the DBC, or remove [secoc]"
        )
    known = {signal.name: signal for signal in message.signals}
    for first, name in secoc.items():
        if name not in known:
            raise UnknownNameError(f"signal of {message.name} in {where} [secoc]", name, known)
        if bits_of(known[name]) != [8 * (first + 5 - k // 8) + k % 8 for k in range(48)]:
            raise CanrollError(
                f"{where}: {name} must be bytes {first} to {first + 5}, the highest first"
            )


def refuse_unnamed(its: Protection | None, name: str, where: str) -> None:
    """Refuse an authenticated frame that nothing distinguishes from others of the same bytes."""
    if its is None or its.profile != "1" or its.length != PAYLOAD:
        raise CanrollError(
            f"{where}: {name} needs a data id of E2E profile 1 over {8 * PAYLOAD} bits to be "
            "authenticated: set E2EDataId and E2EDataLength in the DBC"
        )
