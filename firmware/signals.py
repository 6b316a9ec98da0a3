"""Every signal's bits, scaling and limits; made by codegen.emit_signals, not to be edited.

Frames of roll_control.dbc.
``unpack`` turns the bytes of a mailbox into fields; a signal that carries one of its reserved
codes (error, not available) keeps its field and clears its bit of ``ecu.valid``. ``pack`` writes
the bytes of a frame, rounded to nearest and limited as the DBC says; E2E adds its header.
"""

from firmware.state import (
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
from firmware.subset import byte, clamp, i32, rsh, u8

# identifiers (bit 30: a 29-bit one; 0: the mailbox stays empty), lengths, E2E data ids
RX_IDS: tuple[i32, ...] = (0xA0, 0xB0, 0xC0, 0xD0, 0xD8)
RX_LENGTHS: tuple[u8, ...] = (8, 8, 8, 8, 8)
RX_DATA_IDS: tuple[i32, ...] = (3232, 3248, 3264, 3280, 3288)
TX_IDS: tuple[i32, ...] = (0x80, 0x81, 0x82, 0x83, 0x300, 0x301)
TX_LENGTHS: tuple[u8, ...] = (8, 8, 8, 8, 8, 8)
TX_DATA_IDS: tuple[i32, ...] = (3200, 3201, 3202, 3203, 3840, 3841)


def unpack_imu(ecu: Ecu, slot: i32) -> None:
    """Take the signals of Imu (0xA0) from mailbox ``slot``."""
    b1: u8 = ecu.rx_payload[slot][1]
    b2: u8 = ecu.rx_payload[slot][2]
    b3: u8 = ecu.rx_payload[slot][3]
    b4: u8 = ecu.rx_payload[slot][4]
    b5: u8 = ecu.rx_payload[slot][5]
    b6: u8 = ecu.rx_payload[slot][6]
    b7: u8 = ecu.rx_payload[slot][7]
    valid: u8 = 0
    raw_roll_rate: i32 = (((b1 >> 4) | (b2 << 4) | ((b3 & 15) << 12)) ^ 32768) - 32768
    if raw_roll_rate < 32766:
        ecu.roll_rate = clamp(rsh(raw_roll_rate * 767603923, 16), -1073741824, 1073741824)
        valid = 1
    raw_lateral_acceleration: i32 = (((b3 >> 4) | (b4 << 4) | ((b5 & 15) << 12)) ^ 32768) - 32768
    if raw_lateral_acceleration < 32766:
        ecu.lateral_acceleration = clamp(
            rsh(raw_lateral_acceleration * 687194767, 15), -1073741824, 1073741824
        )
        valid |= 2
    raw_yaw_rate: i32 = (((b5 >> 4) | (b6 << 4) | ((b7 & 15) << 12)) ^ 32768) - 32768
    if raw_yaw_rate < 32766:
        ecu.yaw_rate = clamp(rsh(raw_yaw_rate * 767603923, 16), -1073741824, 1073741824)
        valid |= 4
    ecu.imu_sample = b7 >> 4
    ecu.valid[RX_IMU] = valid


def unpack_vehicle_motion(ecu: Ecu, slot: i32) -> None:
    """Take the signals of VehicleMotion (0xB0) from mailbox ``slot``."""
    b1: u8 = ecu.rx_payload[slot][1]
    b2: u8 = ecu.rx_payload[slot][2]
    b3: u8 = ecu.rx_payload[slot][3]
    b4: u8 = ecu.rx_payload[slot][4]
    b5: u8 = ecu.rx_payload[slot][5]
    b7: u8 = ecu.rx_payload[slot][7]
    valid: u8 = 0
    raw_vehicle_speed: i32 = (b1 >> 4) | (b2 << 4) | ((b3 & 15) << 12)
    if raw_vehicle_speed < 65534:
        ecu.speed = clamp(rsh(raw_vehicle_speed * 763549742, 18), 0, 209715200)
        valid = 1
    raw_steering_wheel_angle: i32 = (((b3 >> 4) | (b4 << 4) | ((b5 & 15) << 12)) ^ 32768) - 32768
    if raw_steering_wheel_angle < 32766:
        ecu.steering = clamp(rsh(raw_steering_wheel_angle * 959504903, 15), -1073741824, 1073741824)
        valid |= 2
    ecu.motion_sample = b7 >> 4
    ecu.valid[RX_VEHICLE_MOTION] = valid


def unpack_suspension_rate(ecu: Ecu, slot: i32) -> None:
    """Take the signals of SuspensionRate (0xC0) from mailbox ``slot``."""
    b1: u8 = ecu.rx_payload[slot][1]
    b2: u8 = ecu.rx_payload[slot][2]
    b3: u8 = ecu.rx_payload[slot][3]
    b4: u8 = ecu.rx_payload[slot][4]
    b5: u8 = ecu.rx_payload[slot][5]
    b6: u8 = ecu.rx_payload[slot][6]
    b7: u8 = ecu.rx_payload[slot][7]
    valid: u8 = 0
    raw_rate_front_left: i32 = (((b1 >> 4) | (b2 << 4)) ^ 2048) - 2048
    if raw_rate_front_left < 2046:
        ecu.stroke_rate[0] = clamp(rsh(raw_rate_front_left * 549755814, 12), -536870912, 536870912)
        valid = 1
    raw_rate_front_right: i32 = ((b3 | ((b4 & 15) << 8)) ^ 2048) - 2048
    if raw_rate_front_right < 2046:
        ecu.stroke_rate[1] = clamp(rsh(raw_rate_front_right * 549755814, 12), -536870912, 536870912)
        valid |= 2
    raw_rate_rear_left: i32 = (((b4 >> 4) | (b5 << 4)) ^ 2048) - 2048
    if raw_rate_rear_left < 2046:
        ecu.stroke_rate[2] = clamp(rsh(raw_rate_rear_left * 549755814, 12), -536870912, 536870912)
        valid |= 4
    raw_rate_rear_right: i32 = ((b6 | ((b7 & 15) << 8)) ^ 2048) - 2048
    if raw_rate_rear_right < 2046:
        ecu.stroke_rate[3] = clamp(rsh(raw_rate_rear_right * 549755814, 12), -536870912, 536870912)
        valid |= 8
    ecu.rate_sample = b7 >> 4
    ecu.valid[RX_SUSPENSION_RATE] = valid


def unpack_actuator_state(ecu: Ecu, slot: i32) -> None:
    """Take the signals of ActuatorState (0xD0) from mailbox ``slot``."""
    b1: u8 = ecu.rx_payload[slot][1]
    b2: u8 = ecu.rx_payload[slot][2]
    b3: u8 = ecu.rx_payload[slot][3]
    b4: u8 = ecu.rx_payload[slot][4]
    b5: u8 = ecu.rx_payload[slot][5]
    b6: u8 = ecu.rx_payload[slot][6]
    b7: u8 = ecu.rx_payload[slot][7]
    valid: u8 = 0
    raw_delivered_moment_front: i32 = (((b1 >> 4) | (b2 << 4) | ((b3 & 15) << 12)) ^ 32768) - 32768
    if raw_delivered_moment_front < 32766:
        ecu.delivered[0] = clamp(raw_delivered_moment_front * 8192, -536870912, 536870912)
        valid = 1
    raw_delivered_moment_rear: i32 = (((b3 >> 4) | (b4 << 4) | ((b5 & 15) << 12)) ^ 32768) - 32768
    if raw_delivered_moment_rear < 32766:
        ecu.delivered[1] = clamp(raw_delivered_moment_rear * 8192, -536870912, 536870912)
        valid |= 2
    ecu.status[0] = (b5 >> 4) & 3
    ecu.status[1] = b5 >> 6
    ecu.status[2] = b6 & 3
    ecu.status[3] = (b6 >> 2) & 3
    ecu.enabled = (b6 >> 4) & 1
    ecu.command_held = (b6 >> 5) & 1
    ecu.accepted_counter = (b6 >> 6) | ((b7 & 3) << 2)
    ecu.actuator_sample = (b7 >> 2) & 15
    ecu.valid[RX_ACTUATOR_STATE] = valid


def unpack_roll_reference(ecu: Ecu, slot: i32) -> None:
    """Take the signals of RollReference (0xD8) from mailbox ``slot``."""
    b1: u8 = ecu.rx_payload[slot][1]
    b2: u8 = ecu.rx_payload[slot][2]
    b3: u8 = ecu.rx_payload[slot][3]
    b4: u8 = ecu.rx_payload[slot][4]
    b5: u8 = ecu.rx_payload[slot][5]
    b6: u8 = ecu.rx_payload[slot][6]
    b7: u8 = ecu.rx_payload[slot][7]
    valid: u8 = 0
    raw_roll_angle: i32 = (((b1 >> 4) | (b2 << 4) | ((b3 & 15) << 12)) ^ 32768) - 32768
    if raw_roll_angle < 32766:
        ecu.reference_roll = clamp(rsh(raw_roll_angle * 614083138, 14), -1073741824, 1073741824)
        valid = 1
    raw_roll_rate: i32 = (((b3 >> 4) | (b4 << 4) | ((b5 & 15) << 12)) ^ 32768) - 32768
    if raw_roll_rate < 32766:
        ecu.reference_rate = clamp(rsh(raw_roll_rate * 767603923, 16), -1073741824, 1073741824)
        valid |= 2
    raw_lateral_acceleration: i32 = (((b5 >> 4) | (b6 << 4) | ((b7 & 15) << 12)) ^ 32768) - 32768
    if raw_lateral_acceleration < 32766:
        ecu.reference_acceleration = clamp(
            rsh(raw_lateral_acceleration * 687194767, 15), -1073741824, 1073741824
        )
        valid |= 4
    ecu.reference_sample = b7 >> 4
    ecu.valid[RX_ROLL_REFERENCE] = valid


def pack_suspension_force(ecu: Ecu) -> None:
    """Fill the payload of SuspensionForceCommand (0x80)."""
    raw_force_front_left: i32 = clamp(rsh(ecu.force[0], 15), -2045, 2045)
    raw_force_front_right: i32 = clamp(rsh(ecu.force[1], 15), -2045, 2045)
    raw_force_rear_left: i32 = clamp(rsh(ecu.force[2], 15), -2045, 2045)
    raw_force_rear_right: i32 = clamp(rsh(ecu.force[3], 15), -2045, 2045)
    ecu.tx_payload[TX_SUSPENSION_FORCE][0] = 0
    ecu.tx_payload[TX_SUSPENSION_FORCE][1] = byte((raw_force_front_left & 15) << 4)
    ecu.tx_payload[TX_SUSPENSION_FORCE][2] = byte(raw_force_front_left >> 4)
    ecu.tx_payload[TX_SUSPENSION_FORCE][3] = byte(raw_force_front_right)
    ecu.tx_payload[TX_SUSPENSION_FORCE][4] = byte(
        ((raw_force_front_right >> 8) & 15) | ((raw_force_rear_left & 15) << 4)
    )
    ecu.tx_payload[TX_SUSPENSION_FORCE][5] = byte(raw_force_rear_left >> 4)
    ecu.tx_payload[TX_SUSPENSION_FORCE][6] = byte(raw_force_rear_right)
    ecu.tx_payload[TX_SUSPENSION_FORCE][7] = byte(
        ((raw_force_rear_right >> 8) & 15) | ((ecu.mode & 15) << 4)
    )


def pack_anti_roll_bar(ecu: Ecu) -> None:
    """Fill the payload of AntiRollBarCommand (0x81)."""
    raw_torque_front: i32 = clamp(rsh(ecu.bar[0], 12), -32765, 32765)
    raw_torque_rear: i32 = clamp(rsh(ecu.bar[1], 12), -32765, 32765)
    ecu.tx_payload[TX_ANTI_ROLL_BAR][0] = 0
    ecu.tx_payload[TX_ANTI_ROLL_BAR][1] = byte((raw_torque_front & 15) << 4)
    ecu.tx_payload[TX_ANTI_ROLL_BAR][2] = byte(raw_torque_front >> 4)
    ecu.tx_payload[TX_ANTI_ROLL_BAR][3] = byte(
        ((raw_torque_front >> 12) & 15) | ((raw_torque_rear & 15) << 4)
    )
    ecu.tx_payload[TX_ANTI_ROLL_BAR][4] = byte(raw_torque_rear >> 4)
    ecu.tx_payload[TX_ANTI_ROLL_BAR][5] = byte(
        ((raw_torque_rear >> 12) & 15) | ((ecu.mode & 15) << 4)
    )
    ecu.tx_payload[TX_ANTI_ROLL_BAR][6] = 0
    ecu.tx_payload[TX_ANTI_ROLL_BAR][7] = 0


def pack_damper(ecu: Ecu) -> None:
    """Fill the payload of DamperCommand (0x82)."""
    raw_current_front_left: i32 = clamp(rsh(ecu.current[0], 13), 0, 4093)
    raw_current_front_right: i32 = clamp(rsh(ecu.current[1], 13), 0, 4093)
    raw_current_rear_left: i32 = clamp(rsh(ecu.current[2], 13), 0, 4093)
    raw_current_rear_right: i32 = clamp(rsh(ecu.current[3], 13), 0, 4093)
    ecu.tx_payload[TX_DAMPER][0] = 0
    ecu.tx_payload[TX_DAMPER][1] = byte((raw_current_front_left & 15) << 4)
    ecu.tx_payload[TX_DAMPER][2] = byte(raw_current_front_left >> 4)
    ecu.tx_payload[TX_DAMPER][3] = byte(raw_current_front_right)
    ecu.tx_payload[TX_DAMPER][4] = byte(
        ((raw_current_front_right >> 8) & 15) | ((raw_current_rear_left & 15) << 4)
    )
    ecu.tx_payload[TX_DAMPER][5] = byte(raw_current_rear_left >> 4)
    ecu.tx_payload[TX_DAMPER][6] = byte(raw_current_rear_right)
    ecu.tx_payload[TX_DAMPER][7] = byte(
        ((raw_current_rear_right >> 8) & 15) | ((ecu.mode & 15) << 4)
    )


def pack_valve(ecu: Ecu) -> None:
    """Fill the payload of ValveCommand (0x83)."""
    raw_current_front: i32 = clamp(rsh(ecu.current[0], 13), -32765, 32765)
    raw_current_rear: i32 = clamp(rsh(ecu.current[1], 13), -32765, 32765)
    ecu.tx_payload[TX_VALVE][0] = 0
    ecu.tx_payload[TX_VALVE][1] = byte((raw_current_front & 15) << 4)
    ecu.tx_payload[TX_VALVE][2] = byte(raw_current_front >> 4)
    ecu.tx_payload[TX_VALVE][3] = byte(
        ((raw_current_front >> 12) & 15) | ((raw_current_rear & 15) << 4)
    )
    ecu.tx_payload[TX_VALVE][4] = byte(raw_current_rear >> 4)
    ecu.tx_payload[TX_VALVE][5] = byte(((raw_current_rear >> 12) & 15) | ((ecu.mode & 15) << 4))
    ecu.tx_payload[TX_VALVE][6] = 0
    ecu.tx_payload[TX_VALVE][7] = 0


def pack_status(ecu: Ecu) -> None:
    """Fill the payload of RollControlStatus (0x300)."""
    raw_roll_angle_estimate: i32 = clamp(rsh(ecu.x[0] * 938734052, 45), -32765, 32765)
    raw_moment_command: i32 = clamp(rsh(ecu.moment, 13), -32765, 32765)
    ecu.tx_payload[TX_STATUS][0] = 0
    ecu.tx_payload[TX_STATUS][1] = byte((raw_roll_angle_estimate & 15) << 4)
    ecu.tx_payload[TX_STATUS][2] = byte(raw_roll_angle_estimate >> 4)
    ecu.tx_payload[TX_STATUS][3] = byte(
        ((raw_roll_angle_estimate >> 12) & 15) | ((raw_moment_command & 15) << 4)
    )
    ecu.tx_payload[TX_STATUS][4] = byte(raw_moment_command >> 4)
    ecu.tx_payload[TX_STATUS][5] = byte(((raw_moment_command >> 12) & 15) | ((ecu.mode & 15) << 4))
    ecu.tx_payload[TX_STATUS][6] = byte((ecu.law & 15) | ((ecu.trouble_number & 15) << 4))
    ecu.tx_payload[TX_STATUS][7] = byte(ecu.commands_sent & 255)


def pack_diagnostics(ecu: Ecu) -> None:
    """Fill the payload of RollControlDiagnostics (0x301)."""
    ecu.tx_payload[TX_DIAGNOSTICS][0] = 0
    ecu.tx_payload[TX_DIAGNOSTICS][1] = byte((ecu.diagnostics_page & 15) << 4)
    if ecu.diagnostics_page == 0:
        raw_active_troubles: i32 = ecu.trouble_active
        raw_latched_troubles: i32 = ecu.trouble_latched
        ecu.tx_payload[TX_DIAGNOSTICS][2] = byte(raw_active_troubles)
        ecu.tx_payload[TX_DIAGNOSTICS][3] = byte(raw_active_troubles >> 8)
        ecu.tx_payload[TX_DIAGNOSTICS][4] = byte(raw_active_troubles >> 16)
        ecu.tx_payload[TX_DIAGNOSTICS][5] = byte(raw_latched_troubles)
        ecu.tx_payload[TX_DIAGNOSTICS][6] = byte(raw_latched_troubles >> 8)
        ecu.tx_payload[TX_DIAGNOSTICS][7] = byte(raw_latched_troubles >> 16)
    elif ecu.diagnostics_page == 1:
        ecu.tx_payload[TX_DIAGNOSTICS][2] = byte(ecu.trouble_count[0])
        ecu.tx_payload[TX_DIAGNOSTICS][3] = byte(ecu.trouble_count[1])
        ecu.tx_payload[TX_DIAGNOSTICS][4] = byte(ecu.trouble_count[2])
        ecu.tx_payload[TX_DIAGNOSTICS][5] = byte(ecu.trouble_count[3])
        ecu.tx_payload[TX_DIAGNOSTICS][6] = byte(ecu.trouble_count[4])
        ecu.tx_payload[TX_DIAGNOSTICS][7] = byte(ecu.trouble_count[5])
    elif ecu.diagnostics_page == 2:
        ecu.tx_payload[TX_DIAGNOSTICS][2] = byte(ecu.trouble_count[6])
        ecu.tx_payload[TX_DIAGNOSTICS][3] = byte(ecu.trouble_count[7])
        ecu.tx_payload[TX_DIAGNOSTICS][4] = byte(ecu.trouble_count[8])
        ecu.tx_payload[TX_DIAGNOSTICS][5] = byte(ecu.trouble_count[9])
        ecu.tx_payload[TX_DIAGNOSTICS][6] = byte(ecu.trouble_count[10])
        ecu.tx_payload[TX_DIAGNOSTICS][7] = byte(ecu.trouble_count[11])
    elif ecu.diagnostics_page == 3:
        ecu.tx_payload[TX_DIAGNOSTICS][2] = byte(ecu.trouble_count[12])
        ecu.tx_payload[TX_DIAGNOSTICS][3] = byte(ecu.trouble_count[13])
        ecu.tx_payload[TX_DIAGNOSTICS][4] = byte(ecu.trouble_count[14])
        ecu.tx_payload[TX_DIAGNOSTICS][5] = byte(ecu.trouble_count[15])
        ecu.tx_payload[TX_DIAGNOSTICS][6] = byte(ecu.trouble_count[16])
        ecu.tx_payload[TX_DIAGNOSTICS][7] = byte(ecu.trouble_count[17])
    elif ecu.diagnostics_page == 4:
        ecu.tx_payload[TX_DIAGNOSTICS][2] = byte(ecu.trouble_count[18])
        ecu.tx_payload[TX_DIAGNOSTICS][3] = byte(ecu.trouble_count[19])
        ecu.tx_payload[TX_DIAGNOSTICS][4] = byte(ecu.trouble_count[20])
        ecu.tx_payload[TX_DIAGNOSTICS][5] = byte(ecu.trouble_count[21])
        ecu.tx_payload[TX_DIAGNOSTICS][6] = byte(ecu.trouble_count[22])
        ecu.tx_payload[TX_DIAGNOSTICS][7] = byte(ecu.trouble_count[23])


def unpack(ecu: Ecu, message: i32, slot: i32) -> None:
    """Unpack the frame that is number ``message`` from mailbox ``slot``."""
    if message == RX_IMU:
        unpack_imu(ecu, slot)
    elif message == RX_VEHICLE_MOTION:
        unpack_vehicle_motion(ecu, slot)
    elif message == RX_SUSPENSION_RATE:
        unpack_suspension_rate(ecu, slot)
    elif message == RX_ACTUATOR_STATE:
        unpack_actuator_state(ecu, slot)
    elif message == RX_ROLL_REFERENCE:
        unpack_roll_reference(ecu, slot)


def pack(ecu: Ecu, message: i32) -> None:
    """Pack the frame that is number ``message``."""
    if message == TX_SUSPENSION_FORCE:
        pack_suspension_force(ecu)
    elif message == TX_ANTI_ROLL_BAR:
        pack_anti_roll_bar(ecu)
    elif message == TX_DAMPER:
        pack_damper(ecu)
    elif message == TX_VALVE:
        pack_valve(ecu)
    elif message == TX_STATUS:
        pack_status(ecu)
    elif message == TX_DIAGNOSTICS:
        pack_diagnostics(ecu)
