"""Authentication of the plant's frames: what AUTOSAR SecOC prescribes, written from the standards.

AES-128 by bytes (FIPS 197) and its CMAC (RFC 4493) over one block: data id, the frame's eight bytes
and the freshness value of 48 bits, which is the sender's number of starts and of the frame since. A
frame carries the freshness value and the first 48 bits of the MAC.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.kernels.instants import NEVER
from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.kernels.records import fields
from canroll.plant_sim.nodes.codec import Codec

SECURED = 20
STARTS_AT, COUNT_AT, MAC_AT = 8, 11, 14
COUNTS = 1 << 24
LISTENING_NS = 160_000_000
"""Time after a start for which no frame is taken: the longest between two commands."""
STARTS_MAX = 16

FLAG = np.dtype(fields("i8", "enabled refused started_ns"))
FRESHNESS = np.dtype(fields("i8", "starts count"))
"""Starts of a sender, and number of its next or last frame."""


class NodeAuthentication(NamedTuple):
    """Keys and freshness values of the plant's nodes.

    ``sent`` and ``heard`` (messages): :data:`FRESHNESS`. ``start_ns``: when the actuator node, the
    receiver here, restarts.
    """

    flag: Any
    sbox: NDArray[np.int64]
    round_key: NDArray[np.int64]
    subkey: NDArray[np.int64]
    sent: NDArray[Any]
    heard: NDArray[Any]
    start_ns: NDArray[np.int64]
    block: NDArray[np.int64]
    mixed: NDArray[np.int64]


def _doubled(value: int) -> int:
    """Product with x in GF(2^8)."""
    return (value << 1) ^ (0x11B if value & 0x80 else 0)


@cache
def _sbox() -> tuple[int, ...]:
    """The S-box by powers of the generator 3: the inverse of 3^k is 3^(255 - k)."""
    powers = [1]
    for _ in range(254):
        powers.append(powers[-1] ^ _doubled(powers[-1]))
    inverse = {power: powers[-k % 255] for k, power in enumerate(powers)}
    box = []
    for x in range(256):
        turned = inverse.get(x, 0)
        value = 0x63
        for _ in range(5):
            value ^= turned
            turned = (turned << 1 | turned >> 7) & 255
        box.append(value)
    return tuple(box)


def _round_keys(key: bytes, sbox: Sequence[int]) -> list[int]:
    """The bytes of all round keys."""
    words, constant = list(key), 1
    for word in range(4, 44):
        last = words[-4:]
        if word % 4 == 0:
            last = [sbox[byte] for byte in (*last[1:], last[0])]
            last[0] ^= constant
            constant = _doubled(constant)
        words += [old ^ new for old, new in zip(words[-16:-12], last, strict=True)]
    return words


def build(
    rows: int,
    *,
    key: bytes | None,
    start_ns: Sequence[int] = (),
    starts: int = 1,
    heard_starts: Sequence[int] = (),
) -> NodeAuthentication:
    """Return the nodes of a bus with ``rows`` messages at time 0, as their start ``starts``.

    Args:
        rows: messages of the codec's tables.
        key: 16 bytes; None: the frames are not authenticated.
        start_ns: when the actuator node restarts.
        starts: number of this start of the senders.
        heard_starts: last known start of each message's sender, by default none.
    """
    sbox = _sbox()
    flag = np.zeros(1, FLAG)[0]
    flag["enabled"] = key is not None
    later = np.full(STARTS_MAX, NEVER, np.int64)
    later[: len(start_ns)] = sorted(start_ns)[:STARTS_MAX]
    heard, sent = np.zeros(rows, FRESHNESS), np.zeros(rows, FRESHNESS)
    heard["count"] = -1
    heard["starts"][: len(heard_starts)] = heard_starts
    sent["starts"] = starts - 1
    node = NodeAuthentication(
        flag=flag,
        sbox=np.array(sbox, np.int64),
        round_key=np.array(_round_keys(key or bytes(16), sbox), np.int64),
        subkey=np.zeros(16, np.int64),
        sent=sent,
        heard=heard,
        start_ns=later,
        block=np.zeros(16, np.int64),
        mixed=np.zeros(16, np.int64),
    )
    encrypt(node)
    node.subkey[:] = node.block
    carry = 0x87 if node.subkey[0] & 0x80 else 0
    node.subkey[:-1] = node.subkey[:-1] << 1 & 255 | node.subkey[1:] >> 7
    node.subkey[-1] = node.subkey[-1] << 1 & 255 ^ carry
    return node


@njit
def encrypt(auth: NodeAuthentication) -> None:
    """Encrypt the block in place."""
    block, mixed = auth.block, auth.mixed
    for k in range(16):
        block[k] = block[k] ^ auth.round_key[k]
    for turn in range(1, 11):
        for k in range(16):
            # byte r of column c comes from column c + r
            mixed[k] = auth.sbox[block[(k + 4 * (k % 4)) % 16]]
        for k in range(16):
            value = mixed[k]
            if turn < 10:
                column = 4 * (k // 4)
                after = mixed[column + (k + 1) % 4]
                total = mixed[column] ^ mixed[column + 1] ^ mixed[column + 2] ^ mixed[column + 3]
                twice = (value ^ after) << 1
                if twice > 255:
                    twice = twice ^ 0x11B
                value = value ^ total ^ twice
            block[k] = value ^ auth.round_key[16 * turn + k]


@njit
def _authenticate(auth: NodeAuthentication, identity: int, payload: NDArray[np.uint8]) -> None:
    """Leave the MAC of a frame with its freshness value in the block."""
    block = auth.block
    block[0] = (identity >> 8) & 255
    block[1] = identity & 255
    for k in range(MAC_AT):
        block[2 + k] = int(payload[k])
    for k in range(16):
        block[k] = block[k] ^ auth.subkey[k]
    encrypt(auth)


@njit
def protect(
    auth: NodeAuthentication, tables: Codec, row: int, payload: NDArray[np.uint8], first: bool
) -> None:
    """Finish a frame of message ``row``; ``first``: the first one since its node has started."""
    if auth.flag.enabled == 0:
        return
    state = auth.sent[row]
    if first or state.count == COUNTS - 1:
        state.starts += 1
        state.count = 0
    starts, count = state.starts, state.count
    state.count += 1
    for k in range(3):
        payload[STARTS_AT + k] = (starts >> (16 - 8 * k)) & 255
        payload[COUNT_AT + k] = (count >> (16 - 8 * k)) & 255
    _authenticate(auth, tables.protection[row].data_id, payload)
    for k in range(SECURED - MAC_AT):
        payload[MAC_AT + k] = auth.block[k]


@njit
def pretend(auth: NodeAuthentication, payload: NDArray[np.uint8]) -> None:
    """Increment the freshness counter, as an attacker without the key would: the MAC stays."""
    if auth.flag.enabled == 0:
        return
    for k in (2, 1, 0):
        value = (int(payload[COUNT_AT + k]) + 1) & 255
        payload[COUNT_AT + k] = value
        if value != 0:
            return


@njit
def _start_anew(auth: NodeAuthentication, t_ns: int) -> None:
    """Forget what was heard before the newest start of the node; the senders' starts last."""
    for number in range(STARTS_MAX):
        start = auth.start_ns[number]
        if auth.flag.started_ns < start <= t_ns:
            auth.flag.started_ns = start
            for row in range(len(auth.heard)):
                auth.heard[row].count = -1


@njit
def verify(
    auth: NodeAuthentication, tables: Codec, row: int, payload: NDArray[np.uint8], t_ns: int
) -> bool:
    """Whether a frame received at ``t_ns`` is authentic, new, and to be taken."""
    if auth.flag.enabled == 0:
        return True
    _start_anew(auth, t_ns)
    state = auth.heard[row]
    starts, count = 0, 0
    for k in range(3):
        starts = starts * 256 + int(payload[STARTS_AT + k])
        count = count * 256 + int(payload[COUNT_AT + k])
    good = starts > state.starts or (starts == state.starts and count > state.count)
    if count >= COUNTS - 1:
        good = False
    if good:
        _authenticate(auth, tables.protection[row].data_id, payload)
        for k in range(SECURED - MAC_AT):
            if auth.block[k] != int(payload[MAC_AT + k]):
                good = False
    if not good:
        auth.flag.refused += 1
        return False
    state.starts = starts
    state.count = count
    return bool(t_ns - auth.flag.started_ns >= LISTENING_NS)
