/* Monitors: sensors against one another, delivered against commanded moments. */
#include <stdbool.h>
#include "hand.h"

enum { LATERAL_AND_YAW = 6, BOTH_MOMENTS = 3, CORNER_STUCK = 2 };
enum { FRONT, REAR, AXLES };

static inline int32_t larger(int32_t a, int32_t b)
{
    return (a > b) ? a : b;
}

static inline int32_t smaller(int32_t a, int32_t b)
{
    return (a < b) ? a : b;
}

static inline int32_t size_of(int32_t v)
{
    return (v < 0) ? -v : v;
}

/* At least so much and a share, of 2^10, rounded to nearest and limited to 31 bits. */
static inline int32_t with_share(int32_t least, int32_t v, int32_t share)
{
    const int64_t wide = (int64_t)least + (((int64_t)v * share + 512) >> 10);
    return (wide > STATE_MAX) ? STATE_MAX : (int32_t)wide;
}

/* Count a bad sample, up to as many in a row as make a finding; whether they do. */
static inline bool in_a_row(int32_t *count, bool bad, int32_t samples)
{
    *count = bad ? smaller(*count + 1, samples) : 0;
    return *count == samples;
}

/* Lateral acceleration by yaw rate and speed, and by steering angle and speed. */
static void compare_lateral(canroll_ecu *ecu, const canroll_calibration *cal)
{
    const int32_t told = ecu->lateral_acceleration, steered = ecu->steering_acceleration;
    const int32_t turning = state_of((int64_t)ecu->speed * ecu->yaw_rate, 23);
    const int32_t motion = smaller(larger(size_of(turning), size_of(steered)), STATE_MAX);
    const int32_t least = cal->opposite_min;
    const int32_t *fading = cal->redundancy_pass;
    const int32_t peak = larger(motion, ecu->motion_peak - product(ecu->motion_peak, fading[0], 30));
    const int32_t now = larger(motion, ecu->motion_now - product(ecu->motion_now, fading[1], 30));
    bool apart;
    ecu->motion_peak = peak;
    ecu->motion_now = now;
    /* the same to the last bit, at another yaw rate times speed */
    apart = told == ecu->frozen_lateral && size_of(turning - ecu->frozen_turning) > least;
    if (told != ecu->frozen_lateral) {
        ecu->frozen_lateral = told;
        ecu->frozen_turning = turning;
    }
    if (peak < cal->redundancy_limit) {
        /* in the tyres' linear range, where no sum comes near 32 bits */
        const int32_t far = with_share(cal->redundancy_min, now, cal->redundancy_share);
        apart |= told > larger(turning, steered) + far || told < smaller(turning, steered) - far;
    }
    if (in_a_row(&ecu->evidence[ROW_APART], apart, cal->apart_samples)) {
        ecu->contradicted |= 2;
    }
    /* a car that comes back from a slide: the sideslip that it would have had, times speed */
    if ((told > least && turning < -least) || (told < -least && turning > least)) {
        ecu->slide = bits_31(ecu->slide + ((smaller(size_of(turning - told), STATE_MAX) + 32) >> 6));
        if (ecu->slide > state_of((int64_t)ecu->speed * cal->slide_max, 20)) {
            ecu->contradicted |= 2;
        }
    } else {
        ecu->slide = 0;
    }
}

/* Whether lateral acceleration and yaw rate last turned away from where the car was steered. */
static bool turned_away(canroll_ecu *ecu, int32_t told, int32_t turning, int32_t least)
{
    const bool left = told > least && turning > least, right = told < -least && turning < -least;
    const int32_t side = left - right;
    if (side != 0 && side != ecu->unit_side) {
        ecu->unit_away = left ? ecu->passed[ROW_STEERED] < 0 : ecu->passed[ROW_STEERED] > 0;
        ecu->unit_side = side;
    } else if (size_of(told) <= least && size_of(turning) <= least) {
        ecu->unit_side = 0;
    }
    return ecu->unit_away;
}

/* Whether unit and steering agree, or are mirror images. */
static void compare_mirror(canroll_ecu *ecu, const canroll_calibration *cal)
{
    const int32_t told = ecu->lateral_acceleration;
    const int32_t turning = state_of((int64_t)ecu->speed * ecu->yaw_rate, 23);
    const int32_t slow = bits_31(ecu->passed[ROW_STEERED]
        + product(ecu->steering_acceleration - ecu->passed[ROW_STEERED], cal->redundancy_pass[2], 30));
    int32_t near, far;
    int64_t nearer;
    ecu->passed[ROW_STEERED] = slow;
    if (!turned_away(ecu, told, turning, cal->mirror_min)) {
        ecu->passed[ROW_MIRRORED] = 0;
        return;
    }
    near = smaller(
        smaller(size_of(turning - slow), STATE_MAX), smaller(size_of(told - slow), STATE_MAX));
    far = smaller(larger(size_of(turning + slow), size_of(told + slow)), STATE_MAX);
    nearer = (int64_t)near - far - ((far + 1) >> 1);
    nearer = ((nearer < STATE_MIN) ? STATE_MIN : nearer) - ecu->passed[ROW_MIRRORED];
    ecu->passed[ROW_MIRRORED] += product((int32_t)nearer, cal->redundancy_pass[3], 30);
    if (ecu->passed[ROW_MIRRORED] > cal->mirror_min && ecu->motion_peak < cal->mirror_limit) {
        ecu->contradicted |= 4;
    }
}

void hand_watch_sensors(canroll_ecu *ecu, const canroll_calibration *cal)
{
    if (ecu->fresh[CANROLL_RX_IMU] == 0 || ecu->gain_factor == 0) {
        return;
    }
    if (in_a_row(&ecu->evidence[ROW_BIAS], size_of(ecu->x[CANROLL_GYRO_BIAS]) >= cal->bias_max,
            cal->bound_samples)) {
        ecu->contradicted |= 1;
    }
    if (ecu->motion_lost == 0
        && (ecu->valid[CANROLL_RX_IMU] & LATERAL_AND_YAW) == LATERAL_AND_YAW) {
        compare_lateral(ecu, cal);
        compare_mirror(ecu, cal);
    }
}

/* Remember the axles' moments of the command that goes out. */
void hand_note_command(canroll_ecu *ecu, const canroll_calibration *cal)
{
    ecu->commanded[FRONT] = product(ecu->force[0] - ecu->force[1], cal->track_front, 29);
    ecu->commanded[REAR] = product(ecu->force[2] - ecu->force[3], cal->track_rear, 29);
}

/* A new sample of an axle: its band is that of the commands of this window and the last. */
static void compare_moment(canroll_ecu *ecu, const canroll_calibration *cal, uint32_t axle,
    bool follows, bool next)
{
    const uint32_t status = ecu->status[2 * axle] | ecu->status[2 * axle + 1];
    const int32_t command = ecu->commanded[axle], moment = ecu->delivered[axle];
    int32_t high = ecu->band_high[axle], low = ecu->band_low[axle], edge;
    if (next) {
        ecu->band_high[axle + AXLES] = high;
        ecu->band_low[axle + AXLES] = low;
        high = low = command;
    }
    if (ecu->commands_sent == 0) {
        /* what is delivered yet was commanded before a restart */
        ecu->band_high[axle] = larger(high, moment);
        ecu->band_low[axle] = smaller(low, moment);
        return;
    }
    follows = follows && status < CORNER_STUCK;
    if (follows) {
        high = larger(high, command);
        low = smaller(low, command);
    }
    if (!follows || status != 0) {
        /* it may stand at zero, or anywhere short of the command */
        high = larger(high, 0);
        low = smaller(low, 0);
    }
    ecu->band_high[axle] = high;
    ecu->band_low[axle] = low;
    high = larger(high, ecu->band_high[axle + AXLES]);
    low = smaller(low, ecu->band_low[axle + AXLES]);
    edge = with_share(cal->delivery_min, larger(high, -low), cal->delivery_share);
    if (in_a_row(&ecu->evidence[ROW_DELIVERY + axle], follows && (moment > high + edge || moment < low - edge),
            cal->delivery_samples)) {
        ecu->contradicted |= (uint8_t)(8 << axle);
    }
}

void hand_watch_moments(canroll_ecu *ecu, const canroll_calibration *cal)
{
    const bool follows = (ecu->enabled & ecu->command_held) != 0;
    bool next;
    if (ecu->fresh[CANROLL_RX_ACTUATOR_STATE] == 0
        || (ecu->valid[CANROLL_RX_ACTUATOR_STATE] & BOTH_MOMENTS) != BOTH_MOMENTS) {
        return;
    }
    next = ++ecu->window_samples == cal->delivery_window;
    compare_moment(ecu, cal, FRONT, follows, next);
    compare_moment(ecu, cal, REAR, follows, next);
    if (next) {
        ecu->window_samples = 0;
    }
}
