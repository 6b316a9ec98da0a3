"""Authenticated frames, after AUTOSAR SecOC.

``start`` and ``resume`` at power-up, ``elapse`` once a tick, ``verify`` and ``protect`` for frames.

A secured frame has 20 bytes: the 8 of the frame, its freshness value of 48 bits, and the first 48
bits of an AES-128-CMAC over data id, frame and freshness value. This value is the number of starts
of the sender, which it keeps in memory that lasts, and the number of the frame since; behind the
last number the sender takes the next start. A receiver takes a frame only where its freshness value
is greater than that of the last. So the next frame resynchronises after a reset of either side,
however many starts were missed.
"""

from typing import Annotated

from canroll.firmware.com.frames import N_FRAMES
from canroll.firmware.com.protection import RX_DATA_IDS, TX_DATA_IDS
from canroll.firmware.security.aes import expand, packed
from canroll.firmware.security.cmac import cmac, start_cmac
from canroll.firmware.security.secoc_state import (
    AUTHENTICATED,
    COUNTER_MAX,
    FRESHNESS_AT,
    LISTENING_MAX,
    MAC_AT,
    NONE,
    RESET_MAX,
    SECURED,
    Secoc,
)
from canroll.firmware.state import N_TX
from canroll.firmware.subset import I32_MAX, byte, clamp, clear, i32, u8


def start(secoc: Secoc, key: Annotated[list[u8], 16], reset: i32, listening: i32) -> None:
    """Start with a key; ``reset`` is the number of this start, one more than that of the last.

    For ``listening`` ticks, at least two cycle times of the slowest frame, none is taken.
    """
    clear(secoc)
    expand(secoc, key)
    start_cmac(secoc)
    secoc.tx_reset = clamp(reset, 0, RESET_MAX)
    secoc.listening = clamp(listening, 0, LISTENING_MAX)
    for message in range(N_FRAMES):
        secoc.rx_freshness[message] = NONE


def resume(secoc: Secoc, message: i32, reset: i32) -> None:
    """Continue with a sender: ``reset`` is its last known start, ``rx_reset`` before this one."""
    if message >= 0 and message < N_FRAMES:
        secoc.rx_reset[message] = clamp(reset, 0, RESET_MAX)


def elapse(secoc: Secoc, elapsed_ticks: i32) -> None:
    """Count the ticks that passed; called once a tick."""
    elapsed: i32 = clamp(elapsed_ticks, 0, LISTENING_MAX)
    secoc.listening = clamp(secoc.listening - elapsed, 0, LISTENING_MAX)


def authenticate(secoc: Secoc, identity: i32, frame: Annotated[list[u8], SECURED]) -> None:
    """Leave the CMAC of a frame with its freshness value in ``block``."""
    secoc.message[0] = byte(identity >> 8)
    secoc.message[1] = byte(identity)
    for k in range(MAC_AT):
        secoc.message[k + 2] = frame[k]
    cmac(secoc, AUTHENTICATED)


def protect(secoc: Secoc, slot: i32, frame: Annotated[list[u8], SECURED]) -> None:
    """Finish a frame to be sent: write freshness value and CMAC behind its 8 bytes.

    In place of the last number of a start the next one begins, of all frames: ``tx_reset`` has to
    be in memory that lasts before the frame is sent. The last start has none behind it.
    """
    if slot < 0 or slot >= N_TX:
        return
    if secoc.tx_freshness[slot] == COUNTER_MAX and secoc.tx_reset < RESET_MAX:
        secoc.tx_reset += 1
        for sent in range(N_TX):
            secoc.tx_freshness[sent] = 0
    count: i32 = secoc.tx_freshness[slot]
    frame[FRESHNESS_AT] = byte(secoc.tx_reset >> 16)
    frame[FRESHNESS_AT + 1] = byte(secoc.tx_reset >> 8)
    frame[FRESHNESS_AT + 2] = byte(secoc.tx_reset)
    frame[FRESHNESS_AT + 3] = byte(count >> 16)
    frame[FRESHNESS_AT + 4] = byte(count >> 8)
    frame[FRESHNESS_AT + 5] = byte(count)
    authenticate(secoc, TX_DATA_IDS[slot], frame)
    if count == COUNTER_MAX:
        secoc.block[0] = 0
        secoc.block[1] = 0
    secoc.tx_freshness[slot] = clamp(count + 1, 0, COUNTER_MAX)
    frame[MAC_AT] = byte(secoc.block[0] >> 24)
    frame[MAC_AT + 1] = byte(secoc.block[0] >> 16)
    frame[MAC_AT + 2] = byte(secoc.block[0] >> 8)
    frame[MAC_AT + 3] = byte(secoc.block[0])
    frame[MAC_AT + 4] = byte(secoc.block[1] >> 24)
    frame[MAC_AT + 5] = byte(secoc.block[1] >> 16)


def verify(secoc: Secoc, message: i32, frame: Annotated[list[u8], SECURED], length: i32) -> i32:
    """Return 1 where a received frame is authentic and newer than the last, and is to be taken.

    A frame that is heard while listening only tells which ones are old, and is not ``refused``.
    """
    if message < 0 or message >= N_FRAMES:
        return 0
    if length == SECURED:
        reset: i32 = frame[FRESHNESS_AT + 2] | (frame[FRESHNESS_AT + 1] << 8)
        reset = reset | (frame[FRESHNESS_AT] << 16)
        count: i32 = frame[FRESHNESS_AT + 5] | (frame[FRESHNESS_AT + 4] << 8)
        count = count | (frame[FRESHNESS_AT + 3] << 16)
        newer: i32 = 0
        if reset == secoc.rx_reset[message] and count > secoc.rx_freshness[message]:
            newer = 1
        if reset > secoc.rx_reset[message]:
            newer = 1
        if newer == 1 and count < COUNTER_MAX:
            authenticate(secoc, RX_DATA_IDS[message], frame)
            high: i32 = packed(
                frame[MAC_AT], frame[MAC_AT + 1], frame[MAC_AT + 2], frame[MAC_AT + 3]
            )
            low: i32 = packed(frame[MAC_AT + 4], frame[MAC_AT + 5], 0, 0)
            difference: i32 = (secoc.block[0] ^ high) | ((secoc.block[1] ^ low) >> 16)
            if difference == 0:
                secoc.rx_reset[message] = reset
                secoc.rx_freshness[message] = count
                if secoc.listening > 0:
                    return 0
                return 1
    if secoc.refused < I32_MAX:
        secoc.refused += 1
    return 0
