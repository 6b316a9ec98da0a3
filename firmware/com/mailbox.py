"""Mailboxes: hand-over of received frames to the tick.

``receive`` may run in an interrupt. It only ever writes the side of a slot that ``rx_side`` names;
the tick turns ``rx_side`` over by one byte store and then owns the other side. The last frame wins.
"""

from typing import Annotated

from canroll.firmware.calibration import N_RX, Calibration
from canroll.firmware.com import e2e, protection, signals
from canroll.firmware.com.frames import N_FRAMES, RX_BYTES
from canroll.firmware.state import AGE_MAX, N_TX, NO_SAMPLE, Ecu
from canroll.firmware.subset import byte, clamp, i32, u8


def receive(ecu: Ecu, frame: i32, payload: Annotated[list[u8], RX_BYTES], length: i32) -> None:
    """Store a received frame by its number; the only writer of the slots.

    Frame RX_… is the first one of that message, further ones follow. ``payload`` has ``length``
    bytes; a frame that is too short or of another page is ignored. From N_FRAMES on, ``frame`` is
    that of transmit slot ``frame`` - N_FRAMES, which somebody else has sent.
    """
    if frame < 0 or frame >= N_FRAMES + N_TX:
        return
    if frame >= N_FRAMES:
        ecu.rx_own = byte(frame - N_FRAMES + 1)
        return
    size: i32 = signals.RX_LENGTHS[frame]
    if length < size:
        return
    if signals.wanted(frame, payload) == 0:
        return
    slot: i32 = 2 * frame + ecu.rx_side[frame]
    for k in range(size):
        ecu.rx_payload[slot][k] = payload[k]
    ecu.rx_fresh[slot] = 1


def take(ecu: Ecu, cal: Calibration, frame: i32) -> i32:
    """Read the newest of a frame; return, as bits of ecu.fresh, what it brought new samples of."""
    side: u8 = ecu.rx_side[frame]
    ecu.rx_side[frame] = 1 - side
    slot: i32 = 2 * frame + side
    e2e.due(ecu, frame)
    if ecu.rx_fresh[slot] == 0:
        e2e.missed(ecu, frame)
        return 0
    ecu.rx_fresh[slot] = 0
    if cal.e2e == 1:
        if protection.check(ecu, cal, frame, slot) == 0:
            return 0
    ecu.age[frame] = 0
    signals.unpack(ecu, frame, slot)
    sample: u8 = signals.sample_counter(ecu, frame)
    if sample == ecu.last_sample[frame]:
        return 0
    ecu.last_sample[frame] = sample
    ecu.unchanged[frame] = 0
    return signals.RX_SIGNALS[frame]


def read_inputs(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Read every frame of the messages that the calibration needs, and count its age."""
    for message in range(N_RX):
        ecu.fresh[message] = 0
    for frame in range(N_FRAMES):
        carried: i32 = signals.RX_MESSAGES[frame]
        if cal.timeout_ticks[carried] > 0:
            ecu.age[frame] = clamp(ecu.age[frame] + elapsed, 0, AGE_MAX)
            ecu.unchanged[frame] = clamp(ecu.unchanged[frame] + elapsed, 0, AGE_MAX)
            news: i32 = take(ecu, cal, frame)
            ecu.fresh[carried] = byte(ecu.fresh[carried] | news)


def init_mailboxes(ecu: Ecu, cal: Calibration) -> None:
    """Start the E2E receivers."""
    for frame in range(N_FRAMES):
        ecu.e2e_last[frame] = e2e.NO_COUNTER
        ecu.e2e_delta[frame] = cal.e2e_max_delta[signals.RX_MESSAGES[frame]]
        ecu.last_sample[frame] = NO_SAMPLE
