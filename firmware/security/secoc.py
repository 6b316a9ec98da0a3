"""Authenticated frames, after AUTOSAR SecOC.

``start`` and ``resume`` at power-up, ``elapse`` once a tick, ``verify`` and ``protect`` for frames.

A secured frame has 16 bytes: the 8 of the frame, the low 32 bits of its freshness value, the first
32 bits of an AES-128-CMAC over data id, frame and the whole freshness value of 48 bits. This value
is the number of starts of the sender, which it keeps in memory that lasts, and the number of the
frame since; behind the last number the sender takes the next start. A receiver takes a frame only
where it is newer than the last: within a start by the number, else by a start that is at most 127
ahead. So after a reset of the sender the first frame resynchronises, and after one of the receiver
as well.
"""

from typing import Annotated

from firmware.com.frames import N_FRAMES
from firmware.com.protection import RX_DATA_IDS, TX_DATA_IDS
from firmware.security.aes import expand, packed
from firmware.security.cmac import cmac, start_cmac
from firmware.security.secoc_state import (
    AUTHENTICATED,
    COUNTER_MAX,
    FRESHNESS_AT,
    LISTENING_MAX,
    MAC_AT,
    NONE,
    PAYLOAD,
    RESET_MAX,
    SECURED,
    Secoc,
)
from firmware.state import N_TX
from firmware.subset import I32_MAX, byte, clamp, clear, i32, u8

RESET_STEP_MAX = 127


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


def authenticate(
    secoc: Secoc, identity: i32, frame: Annotated[list[u8], SECURED], reset: i32, count: i32
) -> i32:
    """Return the first 32 bits of the CMAC of a frame with its whole freshness value."""
    secoc.message[0] = byte(identity >> 8)
    secoc.message[1] = byte(identity)
    for k in range(PAYLOAD):
        secoc.message[k + 2] = frame[k]
    secoc.message[10] = byte(reset >> 16)
    secoc.message[11] = byte(reset >> 8)
    secoc.message[12] = byte(reset)
    secoc.message[13] = byte(count >> 16)
    secoc.message[14] = byte(count >> 8)
    secoc.message[15] = byte(count)
    cmac(secoc, AUTHENTICATED)
    return secoc.block[0]


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
    mac: i32 = authenticate(secoc, TX_DATA_IDS[slot], frame, secoc.tx_reset, count)
    if count == COUNTER_MAX:
        mac = 0
    secoc.tx_freshness[slot] = clamp(count + 1, 0, COUNTER_MAX)
    frame[FRESHNESS_AT] = byte(secoc.tx_reset)
    frame[FRESHNESS_AT + 1] = byte(count >> 16)
    frame[FRESHNESS_AT + 2] = byte(count >> 8)
    frame[FRESHNESS_AT + 3] = byte(count)
    frame[MAC_AT] = byte(mac >> 24)
    frame[MAC_AT + 1] = byte(mac >> 16)
    frame[MAC_AT + 2] = byte(mac >> 8)
    frame[MAC_AT + 3] = byte(mac)


def verify(secoc: Secoc, message: i32, frame: Annotated[list[u8], SECURED], length: i32) -> i32:
    """Return 1 where a received frame is authentic and newer than the last, and is to be taken.

    A frame that is heard while listening only tells which ones are old, and is not ``refused``.
    """
    if message < 0 or message >= N_FRAMES:
        return 0
    if length == SECURED:
        last: i32 = secoc.rx_reset[message]
        ahead: i32 = byte(frame[FRESHNESS_AT] - last)
        count: i32 = frame[FRESHNESS_AT + 3] | (frame[FRESHNESS_AT + 2] << 8)
        count = count | (frame[FRESHNESS_AT + 1] << 16)
        newer: i32 = 0
        if ahead == 0 and count > secoc.rx_freshness[message]:
            newer = 1
        if ahead >= 1 and ahead <= RESET_STEP_MAX:
            newer = 1
        reset: i32 = clamp(last + ahead, 0, RESET_MAX)
        mac: i32 = packed(frame[MAC_AT], frame[MAC_AT + 1], frame[MAC_AT + 2], frame[MAC_AT + 3])
        if newer == 1 and count < COUNTER_MAX:
            if authenticate(secoc, RX_DATA_IDS[message], frame, reset, count) == mac:
                secoc.rx_reset[message] = reset
                secoc.rx_freshness[message] = count
                if secoc.listening > 0:
                    return 0
                return 1
    if secoc.refused < I32_MAX:
        secoc.refused += 1
    return 0
