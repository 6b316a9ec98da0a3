/* Plausibility of the inputs, fault codes, modes and the ramps of the authority. */
#include <stdbool.h>
#include "hand.h"

enum { ROLL_RATE_BIT = 1 << 6, LATERAL_BIT = 1 << 7, STUCK_BIT = 1 << 8, SPEED_BIT = 1 << 10,
       MOMENT_BIT = 1 << 12, CORNER_STUCK_BIT = 1 << 13, CORNER_FLOATING_BIT = 1 << 14,
       COMMAND_BIT = 1 << 15, TICK_MISSED_BIT = 1 << 16,
       CALIBRATION_CRC_BIT = 1 << 18, ROLL_RATE_CONTRADICTED_BIT = 1 << 19,
       LATERAL_CONTRADICTED_BIT = 1 << 20, MOTION_CONTRADICTED_BIT = 1 << 21,
       ACTUATOR_CONTRADICTED_BIT = 1 << 22,
       ENVELOPE_CODE = 23, OWN_IDENTIFIER_HEARD_BIT = 1 << 24,
       COMMAND_LATE_BIT = 1 << 25, SAMPLE_RATE_OFF_CODE = 26, SENSOR_ERRATIC_CODE = 27 };
enum { BAD_ROLL_RATE = 0, BAD_LATERAL = 1, BAD_SPEED = 2, BAD_MOMENT = 4 };
enum { GOOD, DEGRADING, UNSAFE };
enum { CORNER_STUCK = 2, CORNER_FLOATING = 3, OVERDUE = 8, LATE_ECHOES = 3 };

/* Faults came or went: latch and count the new ones. */
static void note_faults(canroll_ecu *ecu, uint32_t found)
{
    const uint32_t appeared = found & ~(uint32_t)ecu->fault_active;
    uint32_t number = 0;
    ecu->fault_active = (int32_t)found;
    ecu->fault_latched |= (int32_t)appeared;
    for (uint32_t code = 0; (found >> code) != 0; code++) {
        number += (found >> code) & 1;
        if (((appeared >> code) & 1) != 0 && ecu->fault_count[code] < 255) {
            ecu->fault_count[code]++;
        }
    }
    ecu->fault_number = (uint8_t)((number < 15) ? number : 15);
}

/* Whether message m is late or repeats one sample; a fresh one is neither. */
static bool silent(canroll_ecu *ecu, const canroll_calibration *cal, uint32_t m, uint32_t *found)
{
    const int32_t timeout = cal->timeout_ticks[m];
    if (ecu->fresh[m] != 0) {
        return false;
    }
    if (ecu->last_sample[m] == NO_SAMPLE) {
        /* the first one may come as late as INIT lasts */
        if (ecu->age[m] > timeout + cal->init_ticks) {
            *found |= 1u << m;
        }
        return true;
    }
    if (ecu->age[m] > timeout) {
        *found |= 1u << m;
        return true;
    }
    if (ecu->unchanged[m] > cal->stuck_ticks && ecu->unchanged[m] > timeout) {
        *found |= STUCK_BIT;
        return true;
    }
    return false;
}

/* Whether message m carries an error code in one of the signals needed. */
static inline bool lacking(const canroll_ecu *ecu, uint32_t m, uint32_t needed)
{
    return (ecu->valid[m] & needed) != needed && ecu->last_sample[m] != NO_SAMPLE;
}

static inline bool beyond(int32_t v, int32_t limit)
{
    return v > limit || v < -limit;
}

/* Whether an input has been bad for longer than its timeout. */
static inline bool lasting(int32_t *bad_ticks, bool bad, int32_t timeout, int32_t elapsed)
{
    *bad_ticks = bad ? aged(*bad_ticks, elapsed) : 0;
    return *bad_ticks > timeout;
}

/* Whether the accelerometer is beyond its range or what a car does since its last good sample. */
static bool implausible_lateral(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed)
{
    const int32_t a = ecu->lateral_acceleration;
    if (ecu->mode == CANROLL_INIT) {
        ecu->acceleration_ticks = AGE_MAX;
    } else if (!ecu->lateral_lost) {
        ecu->acceleration_ticks = aged(ecu->acceleration_ticks, elapsed);
    }
    const int64_t moved = (int64_t)ecu->acceleration_ticks * cal->acceleration_change;
    const int64_t most = cal->acceleration_noise + moved;
    if (lacking(ecu, CANROLL_RX_IMU, 2) || beyond(a, cal->acceleration_max)
        || beyond(bits_31(a - ecu->acceleration_good),
            (most > STATE_MAX) ? STATE_MAX : (int32_t)most)) {
        return true;
    }
    if (ecu->fresh[CANROLL_RX_IMU] & 2) {
        ecu->acceleration_good = a;
        ecu->acceleration_ticks = 0;
    }
    return false;
}

static uint32_t judge_imu(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed,
    uint32_t *found)
{
    const int32_t timeout = cal->timeout_ticks[CANROLL_RX_IMU];
    bool unsafe = silent(ecu, cal, CANROLL_RX_IMU, found), bad;
    bad = lacking(ecu, CANROLL_RX_IMU, 1) || beyond(ecu->roll_rate, cal->roll_rate_max);
    if (lasting(&ecu->bad_ticks[BAD_ROLL_RATE], bad, timeout, elapsed)) {
        *found |= ROLL_RATE_BIT;
        unsafe = true;
    }
    if ((ecu->contradicted & 1)) {
        *found |= ROLL_RATE_CONTRADICTED_BIT;
        unsafe = true;
    }
    if ((ecu->contradicted & 4)) {
        *found |= MOTION_CONTRADICTED_BIT;
        unsafe = true;
    }
    bad = (ecu->contradicted & 2) || implausible_lateral(ecu, cal, elapsed);
    ecu->lateral_good = aged(ecu->lateral_good, elapsed);
    bad = lasting(&ecu->bad_ticks[BAD_LATERAL], bad, timeout, elapsed);
    if (ecu->contradicted & 2) {
        *found |= LATERAL_CONTRADICTED_BIT;
        bad = true;
    }
    if (bad) {
        *found |= LATERAL_BIT;
    }
    if (ecu->bad_ticks[BAD_LATERAL] > 0) {
        ecu->lateral_good = 0;
        bad |= ecu->lateral_lost;
    }
    if (bad) {
        ecu->lateral_lost = 1;
    } else if (ecu->lateral_good >= cal->recovery_ticks) {
        ecu->lateral_lost = 0;
    }
    return unsafe ? UNSAFE : (bad ? DEGRADING : GOOD);
}

static uint32_t judge_motion(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed,
    uint32_t *found)
{
    const bool late = silent(ecu, cal, CANROLL_RX_VEHICLE_MOTION, found);
    const bool bad = lasting(&ecu->bad_ticks[BAD_SPEED],
        lacking(ecu, CANROLL_RX_VEHICLE_MOTION, 3),
        cal->timeout_ticks[CANROLL_RX_VEHICLE_MOTION], elapsed);
    if (bad) {
        *found |= SPEED_BIT;
    }
    ecu->motion_lost = late || bad || ecu->speed_fell;
    return ecu->motion_lost ? DEGRADING : GOOD;
}

static uint32_t judge_corners(canroll_ecu *ecu, uint32_t *found)
{
    const uint32_t contradicted = ecu->contradicted >> 3;
    uint32_t failed = 0;
    if (((ecu->status[0] | ecu->status[1] | ecu->status[2] | ecu->status[3]) & 2) == 0
        && contradicted == 0) {
        ecu->failed[0] = ecu->failed[1] = ecu->failed[2] = ecu->failed[3] = 0;
        return GOOD;
    }
    for (uint32_t corner = 0; corner < 4; corner++) {
        const uint32_t status = ecu->status[corner];
        ecu->failed[corner] = (uint8_t)(status >> 1 | (contradicted >> (corner >> 1) & 1));
        failed += ecu->failed[corner];
        *found |= (status == CORNER_STUCK) ? CORNER_STUCK_BIT : 0;
        *found |= (status == CORNER_FLOATING) ? CORNER_FLOATING_BIT : 0;
    }
    *found |= contradicted ? ACTUATOR_CONTRADICTED_BIT : 0;
    return (failed > 1) ? UNSAFE : DEGRADING;
}

static uint32_t judge_actuators(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed,
    uint32_t *found)
{
    const bool late = silent(ecu, cal, CANROLL_RX_ACTUATOR_STATE, found);
    const bool bad = lasting(&ecu->bad_ticks[BAD_MOMENT],
        lacking(ecu, CANROLL_RX_ACTUATOR_STATE, 3),
        cal->timeout_ticks[CANROLL_RX_ACTUATOR_STATE], elapsed);
    uint32_t severity = judge_corners(ecu, found);
    if (bad) {
        *found |= MOMENT_BIT;
    }
    ecu->moment_unknown = late || bad;
    if (ecu->moment_unknown && severity == GOOD) {
        severity = DEGRADING;
    }
    if (ecu->waiting && ecu->unacknowledged > OVERDUE * cal->acknowledge_ticks) {
        *found |= COMMAND_BIT;
    }
    return severity;
}

/* Let a moment fade from here. */
static void hold(canroll_ecu *ecu, int32_t moment)
{
    ecu->held[0] = moment;
    ecu->released = ONE;
    ecu->authority = 0;
}

static void change_mode(canroll_ecu *ecu, const canroll_calibration *cal, uint32_t severity)
{
    const bool running = ecu->mode == CANROLL_ACTIVE || ecu->mode == CANROLL_DEGRADED;
    if (severity == UNSAFE) {
        ecu->good_ticks = 0;
        if (running) {
            hold(ecu, ecu->moment);
            ecu->mode = CANROLL_SAFE;
        }
        return;
    }
    if (ecu->mode == CANROLL_ACTIVE) {
        if (severity == DEGRADING) {
            ecu->mode = CANROLL_DEGRADED;
            ecu->good_ticks = 0;
        }
    } else if (ecu->mode == CANROLL_DEGRADED) {
        if (severity == DEGRADING) {
            ecu->good_ticks = 0;
        } else if (ecu->good_ticks >= cal->recovery_ticks) {
            ecu->mode = CANROLL_ACTIVE;
        }
    } else if (ecu->good_ticks
        >= ((ecu->mode == CANROLL_SAFE) ? cal->recovery_ticks : cal->init_ticks)) {
        if (ecu->mode == CANROLL_INIT && !ecu->moment_unknown) {
            hold(ecu, ecu->delivered[0] + ecu->delivered[1]);
            ecu->outputs[0] = limit(ecu->held[0], -cal->moment_max, cal->moment_max);
            ecu->guarded[0] = ecu->outputs[0];
        }
        ecu->mode = (severity == DEGRADING) ? CANROLL_DEGRADED : CANROLL_ACTIVE;
        ecu->good_ticks = 0;
    }
}

/* Scheduled gains, share and fade change with the speed only, that is when a frame brought one. */
static void schedule(canroll_ecu *ecu, const canroll_calibration *cal)
{
    const int32_t speed = ecu->speed;
    uint32_t k = 0;
    int32_t gain, front, steering;
    while (k + 1u < cal->schedule_points && speed >= cal->schedule_speed[k + 1]) {
        k++;
    }
    gain = cal->schedule_gain[k];
    front = cal->schedule_front_share[k];
    steering = cal->schedule_steering[k];
    if (k + 1u < cal->schedule_points && speed > cal->schedule_speed[k]) {
        const int32_t gone = speed - cal->schedule_speed[k];
        const int32_t width = cal->schedule_speed[k + 1] - cal->schedule_speed[k];
        const int32_t share = (int32_t)(((int64_t)gone << 28) / width);
        gain += product(cal->schedule_gain[k + 1] - gain, share, 28);
        front += product(cal->schedule_front_share[k + 1] - front, share, 28);
        steering += product(cal->schedule_steering[k + 1] - steering, share, 28);
    }
    if (speed < cal->fade_high) {
        const int32_t above = (speed > cal->fade_low) ? speed - cal->fade_low : 0;
        gain = product(gain, (int32_t)(((int64_t)above << 28) / (cal->fade_high - cal->fade_low)),
            28);
    }
    ecu->gain_factor = gain;
    ecu->front_share = front;
    ecu->steering_acceleration = state_of((int64_t)steering * ecu->steering, 20);
}

/* Frames of ours that somebody else has sent. */
static uint32_t watch_own_identifiers(canroll_ecu *ecu, const canroll_calibration *cal,
    int32_t elapsed)
{
    ecu->foreign_ticks = (ecu->foreign_ticks > elapsed) ? ecu->foreign_ticks - elapsed : 0;
    if (ecu->rx_own != 0) {
        const uint32_t slot = ecu->rx_own - 1u;
        ecu->rx_own = 0;
        if (slot >= CANROLL_TX_STATUS || slot == CANROLL_TX_SUSPENSION_FORCE) {
            ecu->foreign_ticks = cal->recovery_ticks;
        }
    }
    return (ecu->foreign_ticks > 0) ? OWN_IDENTIFIER_HEARD_BIT : 0;
}

/* Count the newest sample of the inertial unit against the ticks since the one before. */
static void count_sample(canroll_ecu *ecu, const canroll_calibration *cal)
{
    const int32_t gap = ecu->sample_gap[0];
    const int32_t step = (ecu->imu_sample - ecu->sample_count[0]) & 15;
    int32_t ahead;
    if (gap <= cal->timeout_ticks[CANROLL_RX_IMU]) {
        ahead = step * cal->clock_period - gap * cal->tick_us;
        if (ahead <= cal->clock_limit && ahead >= -cal->clock_limit) {
            ahead += ecu->clock_error;
            ecu->clock_ticks += gap;
            if (ahead > cal->clock_limit || ahead < -cal->clock_limit) {
                ecu->clock_off = 1;
            } else if (ecu->clock_ticks < cal->clock_window) {
                ecu->clock_error = ahead;
                return;
            } else {
                ecu->clock_off = 0;
            }
        }
    }
    ecu->clock_error = 0;
    ecu->clock_ticks = 0;
}

static uint32_t watch_clock(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed)
{
    ecu->sample_gap[0] = aged(ecu->sample_gap[0], elapsed);
    ecu->sample_gap[1] = aged(ecu->sample_gap[1], elapsed);
    if (ecu->fresh[CANROLL_RX_IMU] != 0) {
        count_sample(ecu, cal);
    }
    return (uint32_t)ecu->clock_off << SAMPLE_RATE_OFF_CODE;
}

/* Add the second difference of one signal's newest sample; return whether the signal is erratic. */
static uint32_t judge_bend(canroll_ecu *ecu, const canroll_calibration *cal, int k, int32_t value,
                           uint32_t valid, bool joined)
{
    int32_t step, bend, known;
    step = bits_31(value - ecu->erratic_last[k]);
    bend = bits_31(step - ecu->erratic_step[k]);
    ecu->erratic_last[k] = value;
    ecu->erratic_step[k] = step;
    known = (valid == 0) ? 0 : (joined ? ecu->erratic_known[k] + 1 : 1);
    known = (known > 3) ? 3 : known;
    ecu->erratic_known[k] = (uint8_t)known;
    ecu->erratic_sum[k] = product(ecu->erratic_sum[k], cal->erratic_kept[k], 30);
    if (known == 3) {
        bend = limit(product(bend, cal->erratic_scale[k], 30), -(1 << 14), 1 << 14);
        ecu->erratic_sum[k] += (bend * bend + (1 << 11)) >> 12;
    }
    return ecu->erratic_sum[k] > 1 << 12;
}

/* Whether the newest sample of a message follows the one before. */
static bool joins(canroll_ecu *ecu, const canroll_calibration *cal, int group, int32_t sample)
{
    const bool next = ecu->sample_gap[group] <= cal->erratic_gap[group]
                      && ((sample - ecu->sample_count[group]) & 15) == cal->erratic_samples[group];
    ecu->sample_gap[group] = 0;
    ecu->sample_count[group] = (uint8_t)sample;
    return next;
}

static uint32_t watch_bends(canroll_ecu *ecu, const canroll_calibration *cal)
{
    uint32_t erratic = 0, valid;
    bool joined;
    if (ecu->fresh[CANROLL_RX_IMU] != 0) {
        valid = ecu->valid[CANROLL_RX_IMU];
        joined = joins(ecu, cal, 0, ecu->imu_sample);
        erratic |= judge_bend(ecu, cal, 0, ecu->roll_rate, valid & 1, joined);
        erratic |= judge_bend(ecu, cal, 1, ecu->lateral_acceleration, valid & 2, joined);
        erratic |= judge_bend(ecu, cal, 2, ecu->yaw_rate, valid & 4, joined);
    }
    if (ecu->fresh[CANROLL_RX_VEHICLE_MOTION] != 0) {
        valid = ecu->valid[CANROLL_RX_VEHICLE_MOTION];
        joined = joins(ecu, cal, 1, ecu->motion_sample);
        erratic |= judge_bend(ecu, cal, 3, ecu->speed, valid & 1, joined);
        erratic |= judge_bend(ecu, cal, 4, ecu->steering, valid & 2, joined);
    }
    return erratic << SENSOR_ERRATIC_CODE;
}

/* Keep the last speed where it falls faster than brakes can. */
static uint32_t watch_speed(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed)
{
    ecu->speed_ticks = aged(ecu->speed_ticks, elapsed);
    if ((ecu->fresh[CANROLL_RX_VEHICLE_MOTION] & ecu->valid[CANROLL_RX_VEHICLE_MOTION] & 1) != 0) {
        const int32_t kept = ecu->speed_kept;
        const int64_t lost = cal->speed_noise + (int64_t)ecu->speed_ticks * cal->speed_fall;
        const int64_t least = kept - ((lost > STATE_MAX) ? STATE_MAX : lost);
        const int32_t pace = ecu->speed_fell ? cal->fade_high : 0;
        const int32_t floor = (kept < pace) ? kept : pace;
        ecu->speed_fell = ecu->speed < ((least > floor) ? least : floor);
        if (!ecu->speed_fell) {
            ecu->speed_kept = ecu->speed;
            ecu->speed_ticks = 0;
        }
    }
    if (ecu->speed_fell) {
        ecu->speed = ecu->speed_kept;
        return SPEED_BIT;
    }
    return 0;
}

/* A ramp's way in elapsed ticks. */
static int32_t step_of(int32_t elapsed, int32_t ticks)
{
    const int64_t way = (int64_t)elapsed * (ONE / ticks);
    return (way > STATE_MAX) ? STATE_MAX : (int32_t)way;
}

/* Move authority and feedforward along the ramp, what is let go over a period of the roll. */
static void fade(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed)
{
    const int32_t up = step_of(elapsed, cal->ramp_ticks);
    const int32_t down = step_of(elapsed, cal->release_ticks);
    if (ecu->mode == CANROLL_ACTIVE || ecu->mode == CANROLL_DEGRADED) {
        ecu->authority = limit(ecu->authority + up, 0, ONE);
    }
    ecu->released = limit(ecu->released - down, 0, ONE);
    for (uint32_t k = 0; k < 4; k++) {
        ecu->trust[k] = limit(ecu->trust[k] + (ecu->failed[k] ? -down : up), 0, ONE);
    }
    ecu->feedforward = limit(ecu->feedforward + (ecu->lateral_lost ? -up : up), 0, ONE);
}

void hand_supervise(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed)
{
    uint32_t found = ((elapsed > 1) ? TICK_MISSED_BIT : 0)
        | ((uint32_t)ecu->envelope_acted << ENVELOPE_CODE)
        | ((ecu->evidence[ROW_ECHO] == LATE_ECHOES) ? COMMAND_LATE_BIT : 0);
    uint32_t severity, motion, actuators;
    found |= watch_own_identifiers(ecu, cal, elapsed);
    found |= watch_clock(ecu, cal, elapsed);
    found |= watch_bends(ecu, cal);
    found |= watch_speed(ecu, cal, elapsed);
    hand_watch_sensors(ecu, cal);
    severity = judge_imu(ecu, cal, elapsed, &found);
    motion = judge_motion(ecu, cal, elapsed, &found);
    hand_watch_moments(ecu, cal);
    actuators = judge_actuators(ecu, cal, elapsed, &found);
    severity = (motion > severity) ? motion : severity;
    severity = (actuators > severity) ? actuators : severity;
    if (ecu->calibration_word == CANROLL_CORRUPT) {
        found |= CALIBRATION_CRC_BIT;
        severity = UNSAFE;
    }
    if (found != (uint32_t)ecu->fault_active) {
        note_faults(ecu, found);
    }
    ecu->good_ticks = aged(ecu->good_ticks, elapsed);
    if (severity != GOOD || ecu->mode != CANROLL_ACTIVE) {
        change_mode(ecu, cal, severity);
    }
    if (ecu->mode != CANROLL_ACTIVE || ecu->released != 0
        || (ecu->authority & ecu->feedforward & ecu->trust[0] & ecu->trust[1] & ecu->trust[2]
            & ecu->trust[3]) != ONE || ecu->lateral_lost) {
        fade(ecu, cal, elapsed);
    }
    if (ecu->age[CANROLL_RX_VEHICLE_MOTION] == 0) {
        schedule(ecu, cal);
    }
}
