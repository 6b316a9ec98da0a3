"""AES-CMAC, RFC 4493, of what ``secoc.message`` holds."""

from canroll.firmware.security.aes import encrypt, packed
from canroll.firmware.security.secoc_state import MESSAGE_MAX, Secoc
from canroll.firmware.subset import clamp, i32, to_i32, to_u32, u32

BLOCK = 16
# what doubling in GF(2^128) adds for the bit that leaves
RB = 0x87


def doubled(secoc: Secoc, which: i32) -> None:
    """Make subkey ``which`` twice ``block`` in GF(2^128), and it the new ``block``."""
    carry: i32 = -((to_i32(to_u32(secoc.block[0]) >> 31)) & 1) & RB
    for k in range(3, -1, -1):
        element: u32 = to_u32(secoc.block[k])
        low: i32 = carry & 255
        carry = to_i32(element >> 31)
        secoc.block[k] = to_i32(((element & 0x7FFFFFFF) << 1) ^ low)
        secoc.subkey[which][k] = secoc.block[k]


def start_cmac(secoc: Secoc) -> None:
    """Derive the two subkeys from the expanded key."""
    for k in range(4):
        secoc.block[k] = 0
    encrypt(secoc)
    doubled(secoc, 0)
    doubled(secoc, 1)


def absorb(secoc: Secoc, at: i32) -> None:
    """Add the 16 bytes at ``at`` of the message to ``block``."""
    for k in range(4):
        first: i32 = clamp(at + 4 * k, 0, MESSAGE_MAX - 4)
        joined: i32 = packed(
            secoc.message[first],
            secoc.message[first + 1],
            secoc.message[first + 2],
            secoc.message[first + 3],
        )
        secoc.block[k] = secoc.block[k] ^ joined


def cmac(secoc: Secoc, length: i32) -> None:
    """Make ``block`` the CMAC of the first ``length`` bytes of the message, which it pads."""
    size: i32 = clamp(length, 0, MESSAGE_MAX)
    blocks: i32 = (size + BLOCK - 1) >> 4
    padded: i32 = 0
    if blocks == 0:
        blocks = 1
        padded = 1
    if (size & (BLOCK - 1)) != 0:
        padded = 1
    if padded == 1:
        secoc.message[clamp(size, 0, MESSAGE_MAX - 1)] = 128
        for k in range(size + 1, BLOCK * blocks):
            secoc.message[clamp(k, 0, MESSAGE_MAX - 1)] = 0
    for k in range(4):
        secoc.block[k] = 0
    for number in range(blocks):
        absorb(secoc, BLOCK * number)
        if number == blocks - 1:
            for k4 in range(4):
                secoc.block[k4] = secoc.block[k4] ^ secoc.subkey[padded][k4]
        encrypt(secoc)
