"""AES-128 encryption of one block, FIPS 197, by tables of whole columns.

No branch depends on key or data. The tables' addresses do: on cores without a data cache, as
Cortex-M0 to M4, that takes no time that depends on them; on others the tables belong into memory
that is not cached.
"""

from typing import Annotated

from canroll.firmware.security.aes_tables import COLUMN_0, COLUMN_1, COLUMN_2, COLUMN_3, ROUND, SBOX
from canroll.firmware.security.secoc_state import Secoc
from canroll.firmware.subset import i32, to_i32, to_u32, u8, u32


def packed(a: i32, b: i32, c: i32, d: i32) -> i32:
    """Return four bytes as one word, ``a`` the most significant."""
    high: u32 = (to_u32(a & 255) << 24) | (to_u32(b & 255) << 16)
    return to_i32(high | (to_u32(c & 255) << 8) | to_u32(d & 255))


def expand(secoc: Secoc, key: Annotated[list[u8], 16]) -> None:
    """Expand a key into the keys of the rounds."""
    for k in range(4):
        at: i32 = 4 * k
        secoc.round_key[k] = packed(key[at], key[at + 1], key[at + 2], key[at + 3])
    for turn in range(10):
        at4: i32 = 4 * turn
        last: u32 = to_u32(secoc.round_key[at4 + 3])
        mixed: i32 = packed(
            SBOX[(last >> 16) & 255] ^ ROUND[turn],
            SBOX[(last >> 8) & 255],
            SBOX[last & 255],
            SBOX[last >> 24],
        )
        for k in range(4):
            mixed = mixed ^ secoc.round_key[at4 + k]
            secoc.round_key[at4 + 4 + k] = mixed


def column(a: u32, b: u32, c: u32, d: u32, key: u32) -> u32:
    """Return a column after one round, from the columns that its bytes come from."""
    return (
        COLUMN_0[a >> 24]
        ^ COLUMN_1[(b >> 16) & 255]
        ^ COLUMN_2[(c >> 8) & 255]
        ^ COLUMN_3[d & 255]
        ^ key
    )


def last_column(a: u32, b: u32, c: u32, d: u32, key: i32) -> i32:
    """Return a column after the last round, which mixes no columns."""
    joined: i32 = packed(SBOX[a >> 24], SBOX[(b >> 16) & 255], SBOX[(c >> 8) & 255], SBOX[d & 255])
    return joined ^ key


def encrypt(secoc: Secoc) -> None:
    """Encrypt ``block`` in place."""
    a: u32 = to_u32(secoc.block[0]) ^ to_u32(secoc.round_key[0])
    b: u32 = to_u32(secoc.block[1]) ^ to_u32(secoc.round_key[1])
    c: u32 = to_u32(secoc.block[2]) ^ to_u32(secoc.round_key[2])
    d: u32 = to_u32(secoc.block[3]) ^ to_u32(secoc.round_key[3])
    for turn in range(1, 10):
        at: i32 = 4 * turn
        e: u32 = column(a, b, c, d, to_u32(secoc.round_key[at]))
        f: u32 = column(b, c, d, a, to_u32(secoc.round_key[at + 1]))
        g: u32 = column(c, d, a, b, to_u32(secoc.round_key[at + 2]))
        d = column(d, a, b, c, to_u32(secoc.round_key[at + 3]))
        a = e
        b = f
        c = g
    secoc.block[0] = last_column(a, b, c, d, secoc.round_key[40])
    secoc.block[1] = last_column(b, c, d, a, secoc.round_key[41])
    secoc.block[2] = last_column(c, d, a, b, secoc.round_key[42])
    secoc.block[3] = last_column(d, a, b, c, secoc.round_key[43])
