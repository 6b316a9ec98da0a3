"""A checksum that the keys of a map do not describe, for ``function = "gm.py:gas_regen"``."""

from typing import Annotated

from canroll.firmware.subset import i32, u8


def gas_regen(payload: Annotated[list[u8], 8], identifier: i32) -> i32:
    """Return the checksum of ASCMGasRegenCmd of General Motors, three bytes inverted each."""
    counter: i32 = payload[0] >> 6
    off: i32 = (payload[0] & 1) ^ 1
    last: i32 = (256 - payload[3] - counter) & 255
    return (off << 24) | ((255 - payload[1]) << 16) | ((255 - payload[2]) << 8) | last
