"""CRCs that have a name: those of AUTOSAR's CRC library, by their parameters."""

from typing import NamedTuple


class Crc(NamedTuple):
    """Parameters of a CRC, named as in :class:`canroll.codegen.frame.checksum.Checksum`."""

    width: int
    polynomial: int
    start: int
    end: int
    reflected: bool


CRCS = {
    "crc8_j1850": Crc(8, 0x1D, 0xFF, 0xFF, False),
    "crc8_h2f": Crc(8, 0x2F, 0xFF, 0xFF, False),
    "crc16_ccitt": Crc(16, 0x1021, 0xFFFF, 0, False),
    "crc16_arc": Crc(16, 0x8005, 0, 0, True),
    "crc32": Crc(32, 0x04C11DB7, 0xFFFFFFFF, 0xFFFFFFFF, True),
    "crc32_p4": Crc(32, 0xF4ACFB13, 0xFFFFFFFF, 0xFFFFFFFF, True),
    "crc64": Crc(64, 0x42F0E1EBA9EA3693, (1 << 64) - 1, (1 << 64) - 1, True),
}
"""*Specification of CRC Routines*, AUTOSAR; crc64 is CRC-64/XZ."""
