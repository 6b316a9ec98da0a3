"""ISO-TP (ISO 15765-2): requests and responses of more than one frame.

A tick reads one frame and sends one. While a response is under way no other request is taken, as
UDS has one at a time. A request longer than ``REQUEST_BYTES`` is refused by the flow control.
"""

from canroll.extensions.services.modules.uds_state import (
    AWAITING,
    FLOWING,
    FRAME,
    REQUEST_BYTES,
    RESPONSE_BYTES,
    RESTING,
    TIMER_MAX,
    Uds,
)
from canroll.firmware.subset import byte, clamp, i32, i64, tdiv

SINGLE = 0
FIRST = 1
CONSECUTIVE = 2
FLOW = 3
CLEAR = 0
WAIT = 1
OVERFLOW = 2
PADDING = 0xCC
# N_Bs and N_Cr
TIMEOUT = 1_000_000
# two ticks, so that none of the tester's frames meets another in the mailbox
SEPARATION_TICKS = 2
MS = 1000
STEP = 100


def send(uds: Uds, count: i32) -> None:
    """Mark the frame for sending, padded behind its first ``count`` bytes."""
    for k in range(FRAME):
        if k >= count:
            uds.tx_payload[k] = PADDING
    uds.tx_pending = 1


def pass_time(uds: Uds, passed: i32) -> None:
    """Count the time that frames are waited for; end what takes too long."""
    uds.received_at = clamp(uds.received_at + passed, 0, TIMER_MAX)
    uds.sent_at = clamp(uds.sent_at + passed, 0, TIMER_MAX)
    if uds.request_state == AWAITING and uds.received_at > TIMEOUT:
        uds.request_state = RESTING
    if uds.response_state == AWAITING and uds.sent_at > TIMEOUT:
        uds.response_state = RESTING


def flow(uds: Uds, status: i32, tick_us: i32) -> None:
    """Send a flow control: no end of frames, one in two ticks."""
    uds.tx_payload[0] = byte(FLOW << 4 | status)
    uds.tx_payload[1] = 0
    gap: i64 = SEPARATION_TICKS * tick_us
    uds.tx_payload[2] = byte(clamp(tdiv(gap, MS) + 1, 1, 127))
    send(uds, 3)


def begin(uds: Uds, count: i32, tick_us: i32) -> None:
    """Read the first frame of a longer request."""
    size: i32 = (uds.frame[0] & 15) << 8 | uds.frame[1]
    if count < FRAME or size < FRAME:
        return
    if size > REQUEST_BYTES:
        flow(uds, OVERFLOW, tick_us)
        return
    for k in range(6):
        uds.request[k] = uds.frame[k + 2]
    uds.request_size = clamp(size, 0, REQUEST_BYTES)
    uds.request_at = 6
    uds.request_number = 1
    uds.request_state = AWAITING
    uds.received_at = 0
    flow(uds, CLEAR, tick_us)


def continue_request(uds: Uds, count: i32) -> i32:
    """Read a further frame of a request; return 1 where it is complete."""
    if uds.request_state != AWAITING:
        return 0
    if uds.frame[0] & 15 != uds.request_number:
        uds.request_state = RESTING
        return 0
    for k in range(1, FRAME):
        if k < count and uds.request_at < uds.request_size:
            uds.request[clamp(uds.request_at, 0, REQUEST_BYTES - 1)] = uds.frame[k]
            uds.request_at = clamp(uds.request_at + 1, 0, REQUEST_BYTES)
    uds.request_number = byte((uds.request_number + 1) & 15)
    uds.received_at = 0
    if uds.request_at < uds.request_size:
        return 0
    uds.request_state = RESTING
    return 1


def steer(uds: Uds, count: i32) -> None:
    """Read a flow control of the tester."""
    if uds.response_state != AWAITING or count < 3:
        return
    status: i32 = uds.frame[0] & 15
    if status == WAIT:
        uds.sent_at = 0
    elif status == CLEAR:
        uds.block = uds.frame[1]
        gap: i32 = uds.frame[2]
        uds.separation = 127 * MS
        if gap <= 127:
            uds.separation = gap * MS
        elif gap > 0xF0 and gap < 0xFA:
            uds.separation = (gap - 0xF0) * STEP
        uds.response_state = FLOWING
        uds.sent_at = TIMER_MAX
    else:
        uds.response_state = RESTING


def read(uds: Uds, tick_us: i32) -> i32:
    """Read a received frame; return 1 where a request is complete."""
    count: i32 = uds.rx_fresh
    for k in range(FRAME):
        uds.frame[k] = uds.rx_payload[k]
    uds.rx_fresh = 0
    kind: i32 = uds.frame[0] >> 4
    if kind == FLOW:
        steer(uds, count)
        return 0
    if uds.response_state != RESTING:
        return 0
    if kind == CONSECUTIVE:
        return continue_request(uds, count)
    uds.request_state = RESTING
    if kind == FIRST:
        begin(uds, count, tick_us)
        return 0
    size: i32 = uds.frame[0]
    if kind != SINGLE or size < 1 or size >= count:
        return 0
    for k in range(FRAME - 1):
        uds.request[k] = uds.frame[k + 1]
    uds.request_size = clamp(size, 0, REQUEST_BYTES)
    return 1


def put(uds: Uds, value: i32) -> None:
    """Append a byte to the response."""
    uds.response[clamp(uds.response_size, 0, RESPONSE_BYTES - 1)] = byte(value)
    uds.response_size = clamp(uds.response_size + 1, 0, RESPONSE_BYTES)


def respond(uds: Uds) -> None:
    """Send the response: whole in a frame, or its first one."""
    size: i32 = uds.response_size
    uds.response_at = 0
    if size < FRAME:
        uds.tx_payload[0] = byte(size)
        for k in range(FRAME - 1):
            uds.tx_payload[k + 1] = uds.response[k]
        send(uds, size + 1)
        return
    uds.tx_payload[0] = byte(FIRST << 4 | size >> 8)
    uds.tx_payload[1] = byte(size)
    for k in range(FRAME - 2):
        uds.tx_payload[k + 2] = uds.response[k]
    uds.response_at = FRAME - 2
    uds.response_number = 1
    uds.response_state = AWAITING
    uds.sent_at = 0
    send(uds, FRAME)


def continue_response(uds: Uds) -> None:
    """Send a further frame of the response, where it is due."""
    if uds.response_state != FLOWING or uds.tx_pending == 1 or uds.sent_at < uds.separation:
        return
    uds.tx_payload[0] = byte(CONSECUTIVE << 4 | uds.response_number)
    count: i32 = 1
    for k in range(1, FRAME):
        if uds.response_at < uds.response_size:
            uds.tx_payload[k] = uds.response[clamp(uds.response_at, 0, RESPONSE_BYTES - 1)]
            uds.response_at = clamp(uds.response_at + 1, 0, RESPONSE_BYTES)
            count = k + 1
    send(uds, count)
    uds.response_number = byte((uds.response_number + 1) & 15)
    uds.sent_at = 0
    if uds.response_at >= uds.response_size:
        uds.response_state = RESTING
    elif uds.block > 0:
        uds.block = byte(uds.block - 1)
        if uds.block == 0:
            uds.response_state = AWAITING
