"""Mailboxes: hand-over of received frames to the tick.

``receive`` may run in an interrupt. It only ever writes the side of a slot that ``rx_side`` names;
the tick turns ``rx_side`` over by one byte store and then owns the other side. The last frame wins.
"""

from typing import Annotated

from firmware.calibration import N_RX, Calibration
from firmware.com import e2e, protection, signals
from firmware.com.frames import RX_BYTES
from firmware.state import (
    AGE_MAX,
    N_TX,
    RX_ACTUATOR_STATE,
    RX_IMU,
    RX_SUSPENSION_RATE,
    RX_VEHICLE_MOTION,
    Ecu,
)
from firmware.subset import byte, clamp, i32, u8

NO_SAMPLE = 16


def receive(ecu: Ecu, message: i32, payload: Annotated[list[u8], RX_BYTES], length: i32) -> None:
    """Store a frame of ``message`` (RX_…); the only writer of the slots.

    ``payload`` has ``length`` bytes; a frame that is too short or of another page is ignored. From
    N_RX on, ``message`` is a frame of transmit slot ``message`` - N_RX that somebody else has sent.
    """
    if message < 0 or message >= N_RX + N_TX:
        return
    if message >= N_RX:
        ecu.rx_own = byte(message - N_RX + 1)
        return
    size: i32 = signals.RX_LENGTHS[message]
    if length < size:
        return
    if signals.wanted(message, payload) == 0:
        return
    slot: i32 = 2 * message + ecu.rx_side[message]
    for k in range(size):
        ecu.rx_payload[slot][k] = payload[k]
    ecu.rx_fresh[slot] = 1


def sample_counter(ecu: Ecu, message: i32) -> u8:
    """Return the sample counter of the last frame of ``message``."""
    if message == RX_IMU:
        return ecu.imu_sample
    if message == RX_VEHICLE_MOTION:
        return ecu.motion_sample
    if message == RX_SUSPENSION_RATE:
        return ecu.rate_sample
    if message == RX_ACTUATOR_STATE:
        return ecu.actuator_sample
    return ecu.reference_sample


def take(ecu: Ecu, cal: Calibration, message: i32) -> i32:
    """Read the newest frame of ``message``; return 1 where it brought a new valid sample."""
    side: u8 = ecu.rx_side[message]
    ecu.rx_side[message] = 1 - side
    slot: i32 = 2 * message + side
    e2e.due(ecu, message)
    if ecu.rx_fresh[slot] == 0:
        e2e.missed(ecu, message)
        return 0
    ecu.rx_fresh[slot] = 0
    if cal.e2e == 1:
        if protection.check(ecu, cal, message, slot) == 0:
            return 0
    ecu.age[message] = 0
    signals.unpack(ecu, message, slot)
    sample: u8 = sample_counter(ecu, message)
    if sample == ecu.last_sample[message]:
        return 0
    ecu.last_sample[message] = sample
    ecu.unchanged[message] = 0
    return 1


def read_inputs(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Read every mailbox that the calibration needs, and count the age of each input."""
    for message in range(N_RX):
        if cal.timeout_ticks[message] > 0:
            ecu.age[message] = clamp(ecu.age[message] + elapsed, 0, AGE_MAX)
            ecu.unchanged[message] = clamp(ecu.unchanged[message] + elapsed, 0, AGE_MAX)
            ecu.fresh[message] = byte(take(ecu, cal, message))


def init_mailboxes(ecu: Ecu, cal: Calibration) -> None:
    """Start the E2E receivers."""
    for message in range(N_RX):
        ecu.e2e_last[message] = e2e.NO_COUNTER
        ecu.e2e_delta[message] = cal.e2e_max_delta[message]
        ecu.last_sample[message] = NO_SAMPLE
