"""Range check of the calibration, generated from its field table by codegen.emit_limits."""

from firmware.calibration import Calibration
from firmware.subset import i32


def outside(value: i32, low: i32, high: i32) -> i32:
    """Return 1 where ``value`` is not within [low, high]."""
    if value < low or value > high:
        return 1
    return 0


def check_ranges(cal: Calibration) -> i32:
    """Return 0, or the number of the first field that is out of its range, from 1."""
    if outside(cal.id, 0, 2147483647) == 1:
        return 1
    if outside(cal.tick_us, 1000, 20000) == 1:
        return 2
    if outside(cal.law, 0, 2) == 1:
        return 3
    if outside(cal.actuator, 0, 3) == 1:
        return 4
    if outside(cal.observer, 0, 2) == 1:
        return 5
    if outside(cal.measurements, 1, 3) == 1:
        return 6
    if outside(cal.identification, 0, 1) == 1:
        return 7
    if outside(cal.offset_learning, 0, 1) == 1:
        return 8
    if outside(cal.event_trigger, 0, 1) == 1:
        return 9
    if outside(cal.e2e, 0, 1) == 1:
        return 10
    for i in range(5):
        if outside(cal.timeout_ticks[i], 0, 100000) == 1:
            return 11
    for i in range(5):
        if outside(cal.e2e_max_delta[i], 1, 14) == 1:
            return 12
    for i in range(5):
        if outside(cal.e2e_max_repeated[i], 0, 14) == 1:
            return 13
    for i in range(5):
        if outside(cal.e2e_sync[i], 0, 14) == 1:
            return 14
    if outside(cal.init_ticks, 1, 100000) == 1:
        return 15
    if outside(cal.recovery_ticks, 1, 100000) == 1:
        return 16
    if outside(cal.ramp_ticks, 1, 100000) == 1:
        return 17
    if outside(cal.stuck_ticks, 1, 100000) == 1:
        return 18
    if outside(cal.roll_rate_max, 0, 1073741824) == 1:
        return 19
    if outside(cal.acceleration_max, 0, 1073741824) == 1:
        return 20
    for i in range(5):
        for j in range(5):
            if outside(cal.phi[i][j], -536870912, 536870912) == 1:
                return 21
    for i in range(5):
        if outside(cal.gamma[i], -536870912, 536870912) == 1:
            return 22
    for i in range(5):
        if outside(cal.gamma_steering[i], -536870912, 536870912) == 1:
            return 23
    for i in range(5):
        if outside(cal.phi_shift[i], 1, 62) == 1:
            return 24
    for i in range(3):
        for j in range(5):
            if outside(cal.output[i][j], -536870912, 536870912) == 1:
                return 25
    for i in range(3):
        if outside(cal.output_moment[i], -536870912, 536870912) == 1:
            return 26
    for i in range(3):
        if outside(cal.output_shift[i], 1, 62) == 1:
            return 27
    for i in range(3):
        for j in range(5):
            if outside(cal.correction[i][j], -536870912, 536870912) == 1:
                return 28
    for i in range(3):
        for j in range(5):
            if outside(cal.correction_shift[i][j], 1, 62) == 1:
                return 29
    for i in range(5):
        if outside(cal.correction_single[i], -536870912, 536870912) == 1:
            return 30
    for i in range(5):
        if outside(cal.correction_single_shift[i], 1, 62) == 1:
            return 31
    if outside(cal.bias_max, 0, 1073741824) == 1:
        return 32
    for i in range(5):
        for j in range(5):
            if outside(cal.covariance_phi[i][j], -536870912, 536870912) == 1:
                return 33
    for i in range(2):
        for j in range(5):
            if outside(cal.covariance_output[i][j], -536870912, 536870912) == 1:
                return 34
    for i in range(2):
        for j in range(5):
            if outside(cal.covariance_gain_shift[i][j], 1, 62) == 1:
                return 35
    for i in range(5):
        if outside(cal.process_noise[i], 0, 1073741824) == 1:
            return 36
    for i in range(2):
        if outside(cal.measurement_noise[i], 1, 1073741824) == 1:
            return 37
    for i in range(5):
        if outside(cal.covariance_start[i], 1, 1073741824) == 1:
            return 38
    for i in range(5):
        if outside(cal.covariance_max[i], 1, 1073741824) == 1:
            return 39
    if outside(cal.predict_steps, 0, 32) == 1:
        return 40
    if outside(cal.actuator_rate, 0, 1073741824) == 1:
        return 41
    if outside(cal.rls_forgetting, 536870912, 1073741824) == 1:
        return 42
    if outside(cal.rls_washout, 536870912, 1073741824) == 1:
        return 43
    if outside(cal.rls_gate, 0, 1073741824) == 1:
        return 44
    if outside(cal.rls_trace_max, 1, 33554432) == 1:
        return 45
    if outside(cal.rls_start, 1, 16777216) == 1:
        return 46
    for i in range(2):
        if outside(cal.rls_lo[i], 1, 1073741824) == 1:
            return 47
    for i in range(2):
        if outside(cal.rls_hi[i], 1, 1073741824) == 1:
            return 48
    if outside(cal.rls_decimation, 1, 20) == 1:
        return 49
    if outside(cal.rls_moment, 0, 536870912) == 1:
        return 50
    if outside(cal.rls_lateral, 0, 536870912) == 1:
        return 51
    if outside(cal.rls_inertia, 0, 536870912) == 1:
        return 52
    if outside(cal.rls_stiffness, 0, 536870912) == 1:
        return 53
    if outside(cal.rls_damping, 0, 536870912) == 1:
        return 54
    if outside(cal.model_stiffness, 0, 536870912) == 1:
        return 55
    if outside(cal.model_damping, 0, 536870912) == 1:
        return 56
    for i in range(2):
        for j in range(4):
            if outside(cal.model_scale[i][j], -536870912, 536870912) == 1:
                return 57
    for i in range(5):
        if outside(cal.feedback[i], -536870912, 536870912) == 1:
            return 58
    if outside(cal.feedback_shift, 1, 62) == 1:
        return 59
    for i in range(5):
        if outside(cal.feedforward[i], -536870912, 536870912) == 1:
            return 60
    if outside(cal.feedforward_shift, 1, 62) == 1:
        return 61
    for i in range(3):
        if outside(cal.output_gain[i], -536870912, 536870912) == 1:
            return 62
    if outside(cal.output_gain_shift, 1, 62) == 1:
        return 63
    if outside(cal.compensator_order, 0, 8) == 1:
        return 64
    if outside(cal.compensator_outputs, 1, 2) == 1:
        return 65
    for i in range(8):
        for j in range(8):
            if outside(cal.compensator_a[i][j], -536870912, 536870912) == 1:
                return 66
    for i in range(8):
        for j in range(4):
            if outside(cal.compensator_b[i][j], -536870912, 536870912) == 1:
                return 67
    for i in range(8):
        for j in range(2):
            if outside(cal.compensator_e[i][j], -536870912, 536870912) == 1:
                return 68
    for i in range(8):
        if outside(cal.compensator_shift[i], 1, 60) == 1:
            return 69
    for i in range(2):
        for j in range(8):
            if outside(cal.compensator_c[i][j], -536870912, 536870912) == 1:
                return 70
    for i in range(2):
        for j in range(4):
            if outside(cal.compensator_d[i][j], -536870912, 536870912) == 1:
                return 71
    for i in range(2):
        if outside(cal.compensator_output_shift[i], 1, 60) == 1:
            return 72
    if outside(cal.moment_max, 0, 1073741824) == 1:
        return 73
    if outside(cal.slew_max, 1, 1073741824) == 1:
        return 74
    if outside(cal.schedule_points, 1, 8) == 1:
        return 75
    for i in range(8):
        if outside(cal.schedule_speed[i], 0, 209715200) == 1:
            return 76
    for i in range(8):
        if outside(cal.schedule_gain[i], 0, 1073741824) == 1:
            return 77
    for i in range(8):
        if outside(cal.schedule_front_share[i], 0, 1073741824) == 1:
            return 78
    for i in range(8):
        if outside(cal.schedule_steering[i], -1073741824, 1073741824) == 1:
            return 79
    if outside(cal.fade_low, 0, 209715200) == 1:
        return 80
    if outside(cal.fade_high, 1, 209715200) == 1:
        return 81
    if outside(cal.straight_steering, 0, 1073741824) == 1:
        return 82
    if outside(cal.straight_yaw_rate, 0, 1073741824) == 1:
        return 83
    if outside(cal.offset_shift, 1, 20) == 1:
        return 84
    if outside(cal.offset_rate_max, 0, 1073741824) == 1:
        return 85
    if outside(cal.offset_acceleration_max, 0, 1073741824) == 1:
        return 86
    if outside(cal.trigger_epsilon_squared, 0, 1048576) == 1:
        return 87
    if outside(cal.trigger_floor, 0, 1073741824) == 1:
        return 88
    if outside(cal.heartbeat_ticks, 1, 1000) == 1:
        return 89
    if outside(cal.acknowledge_ticks, 1, 1000) == 1:
        return 90
    if outside(cal.status_ticks, 1, 10000) == 1:
        return 91
    if outside(cal.arm_front, 0, 1073741824) == 1:
        return 92
    if outside(cal.arm_rear, 0, 1073741824) == 1:
        return 93
    if outside(cal.track_front, 1, 1073741824) == 1:
        return 94
    if outside(cal.track_rear, 1, 1073741824) == 1:
        return 95
    for i in range(4):
        if outside(cal.force_max[i], 0, 67010560) == 1:
            return 96
    if outside(cal.share_slack, 0, 1073741824) == 1:
        return 97
    for i in range(2):
        if outside(cal.bar_max[i], 0, 134201344) == 1:
            return 98
    for i in range(2):
        if outside(cal.damper_speed[i], 1, 1073741824) == 1:
            return 99
    for i in range(2):
        if outside(cal.damper_force[i], 0, 1073741824) == 1:
            return 100
    for i in range(2):
        if outside(cal.damper_slope[i], 0, 1073741824) == 1:
            return 101
    if outside(cal.current_max, 0, 268402688) == 1:
        return 102
    if outside(cal.budget_instructions, 0, 2147483647) == 1:
        return 103
    if outside(cal.budget_tick_us, 0, 2147483647) == 1:
        return 104
    return 0
