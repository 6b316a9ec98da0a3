"""The record of the diagnostic server: transport, session, snapshots of fault codes.

UDS (ISO 14229-1) over ISO-TP (ISO 15765-2) with normal addressing and frames of 8 bytes.
"""

from typing import Annotated

from canroll.firmware.state import N_FAULT_CODES
from canroll.firmware.subset import I32_MAX, I32_MIN, F, i32, record, u8

# transport
FRAME = 8
REQUEST_BYTES = 64
RESPONSE_BYTES = 4 * N_FAULT_CODES + 8
RESTING = 0
AWAITING = 1
FLOWING = 2
TIMER_MAX = 60_000_000

# sessions
DEFAULT = 1
EXTENDED = 3

# values in a snapshot: time, speed, roll rate, lateral acceleration
N_KEPT = 4


@record
class Uds:
    """The diagnostic server; the caller owns it, ``init`` fills it."""

    # transport: times in microseconds
    received_at: Annotated[i32, F(0, TIMER_MAX, 0, "us", "since the last frame of a request")]
    sent_at: Annotated[i32, F(0, TIMER_MAX, 0, "us", "since the last frame of a response")]
    separation: Annotated[i32, F(0, TIMER_MAX, 0, "us", "least time between two of its frames")]
    tester_at: Annotated[i32, F(0, TIMER_MAX, 0, "us", "since the last request")]
    request_size: Annotated[i32, F(0, REQUEST_BYTES, 0, "", "bytes of the request")]
    request_at: Annotated[i32, F(0, REQUEST_BYTES, 0, "", "bytes of it received")]
    response_size: Annotated[i32, F(0, RESPONSE_BYTES, 0, "", "bytes of the response")]
    response_at: Annotated[i32, F(0, RESPONSE_BYTES, 0, "", "bytes of it sent")]

    # snapshots, each of the tick in which its fault code was latched
    known: Annotated[i32, F(0, I32_MAX, 0, "", "bit i: code i has a snapshot")]
    earlier: Annotated[i32, F(0, I32_MAX, 0, "", "bit i: code i occurred before power came only")]
    kept: Annotated[
        list[list[i32]],
        N_FAULT_CODES,
        N_KEPT,
        F(I32_MIN, I32_MAX, 0, "", "time, speed, roll rate, lateral acceleration"),
    ]

    # mailboxes: receive() writes the first two, tick() reads them
    rx_payload: Annotated[list[u8], FRAME, F(0, 255, 0, "", "frame of the tester", True)]
    rx_fresh: Annotated[u8, F(0, FRAME, 0, "", "bytes of it, 0: read", True)]
    tx_payload: Annotated[list[u8], FRAME, F(0, 255, 0, "", "frame to send")]
    tx_pending: Annotated[u8, F(0, 1, 0, "", "1: to be sent; the sender clears it")]

    # transport
    frame: Annotated[list[u8], FRAME, F(0, 255, 0, "", "the frame being read")]
    request: Annotated[list[u8], REQUEST_BYTES, F(0, 255, 0, "", "the request")]
    response: Annotated[list[u8], RESPONSE_BYTES, F(0, 255, 0, "", "the response")]
    request_state: Annotated[u8, F(0, AWAITING, 0, "", "1: more frames of it come")]
    request_number: Annotated[u8, F(0, 15, 0, "", "of its next frame")]
    response_state: Annotated[u8, F(0, FLOWING, 0, "", "1: waits for the tester, 2: is sent")]
    response_number: Annotated[u8, F(0, 15, 0, "", "of its next frame")]
    block: Annotated[u8, F(0, 255, 0, "", "frames until the tester is waited for, 0: no end")]

    # session and snapshots
    session: Annotated[u8, F(0, EXTENDED, 0, "", "1 default 3 extended")]
    kept_mode: Annotated[list[u8], N_FAULT_CODES, F(0, 3, 0, "", "mode of the loop")]
