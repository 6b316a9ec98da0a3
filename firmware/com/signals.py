"""Every signal's bits, scaling and limits; made by codegen.generated.signals, not to be edited.

Frames of roll_control.dbc.
``unpack`` turns the bytes of a mailbox into fields; a signal that carries one of its reserved
codes (error, not available) keeps its field and clears its bit of ``ecu.valid``, as does one that
another signal says has no value, or its second signal contradicts, which sets bit 7. ``pack``
writes the bytes of a frame, rounded to nearest and limited as the DBC says; ``protection`` comes
after it.
"""

from typing import Annotated

from firmware.state import (
    NO_SAMPLE,
    RX_ACTUATOR_STATE,
    RX_IMU,
    RX_ROLL_REFERENCE,
    RX_SUSPENSION_RATE,
    RX_VEHICLE_MOTION,
    TX_ANTI_ROLL_BAR,
    TX_DAMPER,
    TX_DIAGNOSTICS,
    TX_STATUS,
    TX_SUSPENSION_FORCE,
    TX_VALVE,
    Ecu,
)
from firmware.subset import byte, clamp, i32, i64, rsh, u8

# identifiers (bit 30: a 29-bit one; 0: the mailbox stays empty), lengths
RX_IDS: tuple[i32, ...] = (0xA0, 0xB0, 0xC0, 0xD0, 0xD8)
RX_LENGTHS: tuple[u8, ...] = (8, 8, 8, 8, 8)
TX_IDS: tuple[i32, ...] = (0x80, 0x81, 0x82, 0x83, 0x300, 0x301)
TX_LENGTHS: tuple[u8, ...] = (8, 8, 8, 8, 8, 8)
# of each frame received: its message, and what of ecu.fresh a new sample of it is
RX_MESSAGES: tuple[u8, ...] = (0, 1, 2, 3, 4)
RX_SIGNALS: tuple[u8, ...] = (71, 67, 79, 67, 71)
# of each message received: the signals that its frames carry, as bits of ecu.valid
RX_CARRIED: tuple[u8, ...] = (7, 3, 15, 3, 7)
# of each frame sent: 1 where the actuators echo its counter
TX_ECHOED: tuple[u8, ...] = (1, 1, 1, 1, 1, 1)
# pages of the diagnostics, which are sent in turn
PAGES = 7


def wanted(frame: i32, payload: Annotated[list[u8], 8]) -> i32:
    """Return 1 where the mailbox of a frame takes it, by the page that it is."""
    return 1


def contradicted(ecu: Ecu) -> i32:
    """Return 1 where a signal and its redundant or inverted one disagree."""
    return 0


def overdue(ecu: Ecu, frame: i32, patience: i32, grace: i32) -> i32:
    """Return 1 where a frame is older than ``patience``, plus ``grace`` at first."""
    limit: i32 = patience
    if ecu.last_sample[frame] == NO_SAMPLE:
        limit += grace
    if ecu.age[frame] > limit:
        return 1
    return 0


def outdated(ecu: Ecu, message: i32, patience: i32, grace: i32) -> i32:
    """Return the signals of overdue frames of a message, as bits of ecu.valid."""
    late: i32 = 0
    if overdue(ecu, message, patience, grace) == 1:
        late = RX_SIGNALS[message] & 63
    return late


def awaited(ecu: Ecu, message: i32) -> i32:
    """Return the signals of a message not yet received, as bits of ecu.valid."""
    unheard: i32 = 0
    if ecu.last_sample[message] == NO_SAMPLE:
        unheard = RX_SIGNALS[message] & 63
    return unheard


def sample_counter(ecu: Ecu, frame: i32) -> u8:
    """Return the sample counter of a frame; without one it counts the frames."""
    if frame == RX_IMU:
        return ecu.imu_sample
    if frame == RX_VEHICLE_MOTION:
        return ecu.motion_sample
    if frame == RX_SUSPENSION_RATE:
        return ecu.rate_sample
    if frame == RX_ACTUATOR_STATE:
        return ecu.actuator_sample
    return ecu.reference_sample


def received(ecu: Ecu, slot: i32) -> i64:
    """Return the bytes of mailbox ``slot`` as one number, byte 0 lowest."""
    low: i32 = ecu.rx_payload[slot][0] | (ecu.rx_payload[slot][1] << 8)
    low |= ecu.rx_payload[slot][2] << 16
    high: i32 = ecu.rx_payload[slot][4] | (ecu.rx_payload[slot][5] << 8)
    high |= ecu.rx_payload[slot][6] << 16
    high |= ((ecu.rx_payload[slot][7] ^ 128) - 128) << 24
    return (high << 32) | (ecu.rx_payload[slot][3] << 24) | low


def store(ecu: Ecu, message: i32, frame: i64) -> None:
    """Make the bytes of ``frame`` the payload of ``message``."""
    left: i64 = frame
    for k in range(8):
        ecu.tx_payload[message][k] = byte(left)
        left = left >> 8


def unpack_imu(ecu: Ecu, frame: i64) -> None:
    """Take the signals of Imu (0xA0)."""
    valid: u8 = 0
    raw_roll_rate: i32 = (((frame >> 12) & 65535) ^ 32768) - 32768
    if raw_roll_rate < 32766:
        ecu.roll_rate = clamp(rsh(raw_roll_rate * 767603923, 16), -1073741824, 1073741823)
        valid = 1
    raw_lateral_acceleration: i32 = (((frame >> 28) & 65535) ^ 32768) - 32768
    if raw_lateral_acceleration < 32766:
        ecu.lateral_acceleration = clamp(
            rsh(raw_lateral_acceleration * 687194767, 15), -1073741824, 1073741823
        )
        valid |= 2
    raw_yaw_rate: i32 = (((frame >> 44) & 65535) ^ 32768) - 32768
    if raw_yaw_rate < 32766:
        ecu.yaw_rate = clamp(rsh(raw_yaw_rate * 767603923, 16), -1073741824, 1073741823)
        valid |= 4
    ecu.imu_sample = (frame >> 60) & 15
    ecu.valid[RX_IMU] = valid


def unpack_vehicle_motion(ecu: Ecu, frame: i64) -> None:
    """Take the signals of VehicleMotion (0xB0)."""
    valid: u8 = 0
    raw_vehicle_speed: i32 = (frame >> 12) & 65535
    if raw_vehicle_speed < 65534:
        ecu.speed = clamp(rsh(raw_vehicle_speed * 763549742, 18), 0, 209715200)
        valid = 1
    raw_steering_wheel_angle: i32 = (((frame >> 28) & 65535) ^ 32768) - 32768
    if raw_steering_wheel_angle < 32766:
        ecu.steering = clamp(rsh(raw_steering_wheel_angle * 959504903, 15), -1073741824, 1073741823)
        valid |= 2
    ecu.motion_sample = (frame >> 60) & 15
    ecu.valid[RX_VEHICLE_MOTION] = valid


def unpack_suspension_rate(ecu: Ecu, frame: i64) -> None:
    """Take the signals of SuspensionRate (0xC0)."""
    valid: u8 = 0
    raw_rate_front_left: i32 = (((frame >> 12) & 4095) ^ 2048) - 2048
    if raw_rate_front_left < 2046:
        ecu.stroke_rate[0] = clamp(rsh(raw_rate_front_left * 549755814, 12), -536870912, 536870912)
        valid = 1
    raw_rate_front_right: i32 = (((frame >> 24) & 4095) ^ 2048) - 2048
    if raw_rate_front_right < 2046:
        ecu.stroke_rate[1] = clamp(rsh(raw_rate_front_right * 549755814, 12), -536870912, 536870912)
        valid |= 2
    raw_rate_rear_left: i32 = (((frame >> 36) & 4095) ^ 2048) - 2048
    if raw_rate_rear_left < 2046:
        ecu.stroke_rate[2] = clamp(rsh(raw_rate_rear_left * 549755814, 12), -536870912, 536870912)
        valid |= 4
    raw_rate_rear_right: i32 = (((frame >> 48) & 4095) ^ 2048) - 2048
    if raw_rate_rear_right < 2046:
        ecu.stroke_rate[3] = clamp(rsh(raw_rate_rear_right * 549755814, 12), -536870912, 536870912)
        valid |= 8
    ecu.rate_sample = (frame >> 60) & 15
    ecu.valid[RX_SUSPENSION_RATE] = valid


def unpack_actuator_state(ecu: Ecu, frame: i64) -> None:
    """Take the signals of ActuatorState (0xD0)."""
    valid: u8 = 0
    raw_delivered_moment_front: i32 = (((frame >> 12) & 65535) ^ 32768) - 32768
    if raw_delivered_moment_front < 32766:
        ecu.delivered[0] = clamp(raw_delivered_moment_front * 8192, -536870912, 536870911)
        valid = 1
    raw_delivered_moment_rear: i32 = (((frame >> 28) & 65535) ^ 32768) - 32768
    if raw_delivered_moment_rear < 32766:
        ecu.delivered[1] = clamp(raw_delivered_moment_rear * 8192, -536870912, 536870911)
        valid |= 2
    ecu.status[0] = (frame >> 44) & 3
    ecu.status[1] = (frame >> 46) & 3
    ecu.status[2] = (frame >> 48) & 3
    ecu.status[3] = (frame >> 50) & 3
    ecu.enabled = (frame >> 52) & 1
    ecu.command_held = (frame >> 53) & 1
    ecu.accepted_counter = (frame >> 54) & 15
    ecu.actuator_sample = (frame >> 58) & 15
    ecu.valid[RX_ACTUATOR_STATE] = valid


def unpack_roll_reference(ecu: Ecu, frame: i64) -> None:
    """Take the signals of RollReference (0xD8)."""
    valid: u8 = 0
    raw_roll_angle: i32 = (((frame >> 12) & 65535) ^ 32768) - 32768
    if raw_roll_angle < 32766:
        ecu.reference_roll = clamp(rsh(raw_roll_angle * 614083138, 14), -1073741824, 1073741823)
        valid = 1
    raw_roll_rate: i32 = (((frame >> 28) & 65535) ^ 32768) - 32768
    if raw_roll_rate < 32766:
        ecu.reference_rate = clamp(rsh(raw_roll_rate * 767603923, 16), -1073741824, 1073741823)
        valid |= 2
    raw_lateral_acceleration: i32 = (((frame >> 44) & 65535) ^ 32768) - 32768
    if raw_lateral_acceleration < 32766:
        ecu.reference_acceleration = clamp(
            rsh(raw_lateral_acceleration * 687194767, 15), -1073741824, 1073741823
        )
        valid |= 4
    ecu.reference_sample = (frame >> 60) & 15
    ecu.valid[RX_ROLL_REFERENCE] = valid


def pack_suspension_force(ecu: Ecu) -> i64:
    """Return the frame SuspensionForceCommand (0x80)."""
    frame: i64 = 0
    raw_force_front_left: i32 = clamp(rsh(ecu.force[0], 15), -2045, 2045)
    frame |= (raw_force_front_left & 4095) << 12
    raw_force_front_right: i32 = clamp(rsh(ecu.force[1], 15), -2045, 2045)
    frame |= (raw_force_front_right & 4095) << 24
    raw_force_rear_left: i32 = clamp(rsh(ecu.force[2], 15), -2045, 2045)
    frame |= (raw_force_rear_left & 4095) << 36
    raw_force_rear_right: i32 = clamp(rsh(ecu.force[3], 15), -2045, 2045)
    frame |= (raw_force_rear_right & 4095) << 48
    raw_mode: i32 = ecu.mode
    frame |= (((raw_mode & 15) ^ 8) - 8) << 60
    return frame


def pack_anti_roll_bar(ecu: Ecu) -> i64:
    """Return the frame AntiRollBarCommand (0x81)."""
    frame: i64 = 0
    raw_torque_front: i32 = clamp(rsh(ecu.bar[0], 12), -32765, 32765)
    frame |= (raw_torque_front & 65535) << 12
    raw_torque_rear: i32 = clamp(rsh(ecu.bar[1], 12), -32765, 32765)
    frame |= (raw_torque_rear & 65535) << 28
    raw_mode: i32 = ecu.mode
    frame |= (raw_mode & 15) << 44
    return frame


def pack_damper(ecu: Ecu) -> i64:
    """Return the frame DamperCommand (0x82)."""
    frame: i64 = 0
    raw_current_front_left: i32 = clamp(rsh(ecu.current[0], 13), 0, 4093)
    frame |= (raw_current_front_left & 4095) << 12
    raw_current_front_right: i32 = clamp(rsh(ecu.current[1], 13), 0, 4093)
    frame |= (raw_current_front_right & 4095) << 24
    raw_current_rear_left: i32 = clamp(rsh(ecu.current[2], 13), 0, 4093)
    frame |= (raw_current_rear_left & 4095) << 36
    raw_current_rear_right: i32 = clamp(rsh(ecu.current[3], 13), 0, 4093)
    frame |= (raw_current_rear_right & 4095) << 48
    raw_mode: i32 = ecu.mode
    frame |= (((raw_mode & 15) ^ 8) - 8) << 60
    return frame


def pack_valve(ecu: Ecu) -> i64:
    """Return the frame ValveCommand (0x83)."""
    frame: i64 = 0
    raw_current_front: i32 = clamp(rsh(ecu.current[0], 13), -32765, 32765)
    frame |= (raw_current_front & 65535) << 12
    raw_current_rear: i32 = clamp(rsh(ecu.current[1], 13), -32765, 32765)
    frame |= (raw_current_rear & 65535) << 28
    raw_mode: i32 = ecu.mode
    frame |= (raw_mode & 15) << 44
    return frame


def pack_status(ecu: Ecu) -> i64:
    """Return the frame RollControlStatus (0x300)."""
    frame: i64 = 0
    raw_roll_angle_estimate: i32 = clamp(rsh(ecu.x[0] * 938734052, 45), -32765, 32765)
    frame |= (raw_roll_angle_estimate & 65535) << 12
    raw_moment_command: i32 = clamp(rsh(ecu.moment, 13), -32765, 32765)
    frame |= (raw_moment_command & 65535) << 28
    raw_mode: i32 = ecu.mode
    frame |= (raw_mode & 15) << 44
    raw_law: i32 = ecu.law
    frame |= (raw_law & 15) << 48
    raw_fault_code_count: i32 = ecu.fault_number
    frame |= (raw_fault_code_count & 15) << 52
    raw_commands_sent: i32 = ecu.commands_sent & 255
    frame |= (((raw_commands_sent & 255) ^ 128) - 128) << 56
    return frame


def pack_diagnostics(ecu: Ecu) -> i64:
    """Return the frame RollControlDiagnostics (0x301)."""
    frame: i64 = 0
    raw_page: i32 = ecu.diagnostics_page
    frame |= (raw_page & 15) << 12
    if ecu.diagnostics_page == 0:
        raw_active_fault_codes: i32 = ecu.fault_active
        frame |= (raw_active_fault_codes & 268435455) << 16
    elif ecu.diagnostics_page == 1:
        raw_latched_fault_codes: i32 = ecu.fault_latched
        frame |= (raw_latched_fault_codes & 268435455) << 16
    elif ecu.diagnostics_page == 2:
        raw_occurrences00: i32 = ecu.fault_count[0]
        frame |= (raw_occurrences00 & 255) << 16
        raw_occurrences01: i32 = ecu.fault_count[1]
        frame |= (raw_occurrences01 & 255) << 24
        raw_occurrences02: i32 = ecu.fault_count[2]
        frame |= (raw_occurrences02 & 255) << 32
        raw_occurrences03: i32 = ecu.fault_count[3]
        frame |= (raw_occurrences03 & 255) << 40
        raw_occurrences04: i32 = ecu.fault_count[4]
        frame |= (raw_occurrences04 & 255) << 48
        raw_occurrences05: i32 = ecu.fault_count[5]
        frame |= (((raw_occurrences05 & 255) ^ 128) - 128) << 56
    elif ecu.diagnostics_page == 3:
        raw_occurrences06: i32 = ecu.fault_count[6]
        frame |= (raw_occurrences06 & 255) << 16
        raw_occurrences07: i32 = ecu.fault_count[7]
        frame |= (raw_occurrences07 & 255) << 24
        raw_occurrences08: i32 = ecu.fault_count[8]
        frame |= (raw_occurrences08 & 255) << 32
        raw_occurrences09: i32 = ecu.fault_count[9]
        frame |= (raw_occurrences09 & 255) << 40
        raw_occurrences10: i32 = ecu.fault_count[10]
        frame |= (raw_occurrences10 & 255) << 48
        raw_occurrences11: i32 = ecu.fault_count[11]
        frame |= (((raw_occurrences11 & 255) ^ 128) - 128) << 56
    elif ecu.diagnostics_page == 4:
        raw_occurrences12: i32 = ecu.fault_count[12]
        frame |= (raw_occurrences12 & 255) << 16
        raw_occurrences13: i32 = ecu.fault_count[13]
        frame |= (raw_occurrences13 & 255) << 24
        raw_occurrences14: i32 = ecu.fault_count[14]
        frame |= (raw_occurrences14 & 255) << 32
        raw_occurrences15: i32 = ecu.fault_count[15]
        frame |= (raw_occurrences15 & 255) << 40
        raw_occurrences16: i32 = ecu.fault_count[16]
        frame |= (raw_occurrences16 & 255) << 48
        raw_occurrences17: i32 = ecu.fault_count[17]
        frame |= (((raw_occurrences17 & 255) ^ 128) - 128) << 56
    elif ecu.diagnostics_page == 5:
        raw_occurrences18: i32 = ecu.fault_count[18]
        frame |= (raw_occurrences18 & 255) << 16
        raw_occurrences19: i32 = ecu.fault_count[19]
        frame |= (raw_occurrences19 & 255) << 24
        raw_occurrences20: i32 = ecu.fault_count[20]
        frame |= (raw_occurrences20 & 255) << 32
        raw_occurrences21: i32 = ecu.fault_count[21]
        frame |= (raw_occurrences21 & 255) << 40
        raw_occurrences22: i32 = ecu.fault_count[22]
        frame |= (raw_occurrences22 & 255) << 48
        raw_occurrences23: i32 = ecu.fault_count[23]
        frame |= (((raw_occurrences23 & 255) ^ 128) - 128) << 56
    elif ecu.diagnostics_page == 6:
        raw_occurrences24: i32 = ecu.fault_count[24]
        frame |= (raw_occurrences24 & 255) << 16
        raw_occurrences25: i32 = ecu.fault_count[25]
        frame |= (raw_occurrences25 & 255) << 24
        raw_occurrences26: i32 = ecu.fault_count[26]
        frame |= (raw_occurrences26 & 255) << 32
        raw_occurrences27: i32 = ecu.fault_count[27]
        frame |= (raw_occurrences27 & 255) << 40
    return frame


def unpack(ecu: Ecu, number: i32, slot: i32) -> None:
    """Unpack frame ``number`` from mailbox ``slot``."""
    frame: i64 = received(ecu, slot)
    if number == RX_IMU:
        unpack_imu(ecu, frame)
    elif number == RX_VEHICLE_MOTION:
        unpack_vehicle_motion(ecu, frame)
    elif number == RX_SUSPENSION_RATE:
        unpack_suspension_rate(ecu, frame)
    elif number == RX_ACTUATOR_STATE:
        unpack_actuator_state(ecu, frame)
    elif number == RX_ROLL_REFERENCE:
        unpack_roll_reference(ecu, frame)


def pack(ecu: Ecu, message: i32) -> None:
    """Pack the frame that is number ``message``."""
    frame: i64 = 0
    if message == TX_SUSPENSION_FORCE:
        frame = pack_suspension_force(ecu)
    elif message == TX_ANTI_ROLL_BAR:
        frame = pack_anti_roll_bar(ecu)
    elif message == TX_DAMPER:
        frame = pack_damper(ecu)
    elif message == TX_VALVE:
        frame = pack_valve(ecu)
    elif message == TX_STATUS:
        frame = pack_status(ecu)
    elif message == TX_DIAGNOSTICS:
        frame = pack_diagnostics(ecu)
    store(ecu, message, frame)
