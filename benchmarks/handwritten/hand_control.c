/* Observer, prediction over the delay, state feedback, four forces. */
#include <stdbool.h>
#include "hand.h"

enum { ROLL, RATE, LATERAL, JERK, BIAS };
enum { RATE_ROW, LATERAL_ROW };
enum { BAD_ROLL_RATE, BAD_LATERAL };

/* The moment that acts: the delivered one, else the commanded. */
static int32_t acting_moment(const canroll_ecu *ecu)
{
    return ecu->moment_unknown ? ecu->ring[ecu->ring_head] : ecu->delivered[0] + ecu->delivered[1];
}

static void advance(const canroll_calibration *cal, int32_t z[5], int32_t moment)
{
    const int32_t roll = z[ROLL], rate = z[RATE], lateral = z[LATERAL], jerk = z[JERK];
    for (uint32_t i = ROLL; i <= RATE; i++) {
        const int32_t *f = cal->phi[i];
        z[i] = state_of((int64_t)f[ROLL] * roll + (int64_t)f[RATE] * rate
            + (int64_t)f[LATERAL] * lateral + (int64_t)f[JERK] * jerk
            + (int64_t)cal->gamma[i] * moment, cal->phi_shift[i]);
    }
    for (uint32_t i = LATERAL; i <= JERK; i++) {
        const int32_t *f = cal->phi[i];
        z[i] = state_of((int64_t)f[LATERAL] * lateral + (int64_t)f[JERK] * jerk,
            cal->phi_shift[i]);
    }
}

static void correct(int32_t x[5], const int32_t gain[5], const uint8_t shift[5],
    int32_t innovation)
{
    for (uint32_t i = ROLL; i <= BIAS; i++) {
        x[i] = bits_31(x[i] + state_of((int64_t)gain[i] * innovation, shift[i]));
    }
}

void hand_observe(canroll_ecu *ecu, const canroll_calibration *cal, int32_t steps)
{
    int32_t *x = ecu->x;
    const int32_t moment = acting_moment(ecu);
    const int32_t before[4] = { x[ROLL], x[RATE], x[LATERAL], x[JERK] };
    advance(cal, x, moment);
    if (steps > 1) {
        for (uint32_t i = ROLL; i <= JERK; i++) {
            const int64_t there = x[i] + (int64_t)(steps - 1) * (x[i] - before[i]);
            x[i] = (there > STATE_MAX) ? STATE_MAX
                : ((there < STATE_MIN) ? STATE_MIN : (int32_t)there);
        }
    }
    if (ecu->fresh[CANROLL_RX_IMU] != 0) {
        const bool lateral_good = ecu->bad_ticks[BAD_LATERAL] == 0;
        if (ecu->bad_ticks[BAD_ROLL_RATE] == 0) {
            const int32_t innovation = ecu->roll_rate - bits_31(x[RATE] + x[BIAS]);
            if (lateral_good || !ecu->lateral_lost) {
                correct(x, cal->correction[RATE_ROW], cal->correction_shift[RATE_ROW], innovation);
            } else {
                correct(x, cal->correction_single, cal->correction_single_shift, innovation);
            }
        }
        if (lateral_good) {
            /* the accelerometer leans with the body */
            const int64_t leaning = (int64_t)cal->output[LATERAL_ROW][ROLL] * x[ROLL];
            const int32_t told =
                bits_31(x[LATERAL] + state_of(leaning, cal->output_shift[LATERAL_ROW]));
            correct(x, cal->correction[LATERAL_ROW], cal->correction_shift[LATERAL_ROW],
                ecu->lateral_acceleration - told);
        }
    }
    x[BIAS] = limit(x[BIAS], -cal->bias_max, cal->bias_max);
}

/* Carry the estimate through the commands that are under way. */
static void look_ahead(canroll_ecu *ecu, const canroll_calibration *cal)
{
    int32_t *z = ecu->ahead;
    int32_t moment = acting_moment(ecu);
    uint32_t at = ecu->ring_head + 1u - cal->predict_steps;
    for (uint32_t i = ROLL; i <= BIAS; i++) {
        z[i] = ecu->x[i];
    }
    for (uint32_t k = cal->predict_steps; k > 0; k--) {
        const int32_t way = ecu->ring[at++ & 31] - moment;
        const int32_t reached = moment + product(way, cal->actuator_rate, 30);
        advance(cal, z, (moment + reached + 1) >> 1);
        moment = reached;
    }
}

/* v within 31 bits. */
static inline int32_t wide_31(int64_t v)
{
    return (v > STATE_MAX) ? STATE_MAX : ((v < STATE_MIN) ? STATE_MIN : (int32_t)v);
}

/* The lateral acceleration that two of three agree on. */
static int32_t curve(const canroll_ecu *ecu)
{
    const bool good = ecu->lateral_lost == 0 && ecu->bad_ticks[BAD_LATERAL] == 0;
    const int32_t measured = good ? ecu->lateral_acceleration : 0;
    const int32_t steered = ecu->motion_lost ? 0 : ecu->steering_acceleration;
    const int32_t turning = ((ecu->valid[CANROLL_RX_IMU] & 4) == 0)
        ? 0 : state_of((int64_t)ecu->speed * ecu->yaw_rate, 23);
    return (turning < steered) ? limit(measured, turning, steered)
        : limit(measured, steered, turning);
}

/* What is left of the held moment, unless it pushes outward. */
static int32_t fading(const canroll_ecu *ecu)
{
    const int32_t left = product(ecu->held[0], ecu->released, 30);
    int32_t lateral;
    if (left == 0) {
        return 0;
    }
    lateral = curve(ecu);
    return ((left > 0) ? lateral > 0 : lateral < 0) ? 0 : left;
}

void hand_control(canroll_ecu *ecu, const canroll_calibration *cal, int32_t steps)
{
    const int32_t *z = ecu->ahead, *back = cal->feedback, *forward = cal->feedforward;
    int64_t u;
    int32_t moment, last = ecu->outputs[0], step;
    look_ahead(ecu, cal);
    if (ecu->mode != CANROLL_ACTIVE && ecu->mode != CANROLL_DEGRADED) {
        ecu->moment = ecu->outputs[0] = fading(ecu);
        return;
    }
    moment = state_of((int64_t)forward[LATERAL] * z[LATERAL] + (int64_t)forward[JERK] * z[JERK],
        cal->feedforward_shift);
    if (ecu->feedforward != ONE) {
        moment = product(moment, ecu->feedforward, 30);
    }
    u = (int64_t)back[ROLL] * z[ROLL] + (int64_t)back[RATE] * z[RATE];
    moment = wide_31(-(((u >> (cal->feedback_shift - 1)) + 1) >> 1) - moment);
    if (ecu->gain_factor != 1 << 28) {
        moment = wide_31(((int64_t)moment * ecu->gain_factor + (1 << 27)) >> 28);
    }
    if (ecu->authority != ONE) {
        moment = bits_31(product(moment, ecu->authority, 30)
            + product(fading(ecu), ONE - ecu->authority, 30));
    }
    moment = limit(moment, -cal->moment_max, cal->moment_max);
    step = cal->slew_max;
    if (steps > 1) {
        step = (step > STATE_MAX / steps) ? STATE_MAX : step * steps;
    }
    ecu->moment = ecu->outputs[0] = limit(moment, last - step, last + step);
}

/* The limit of an actuator, or of one that has failed a share of what is wanted. */
static inline int32_t entrusted(int32_t most, int32_t wanted, int32_t trust)
{
    return (trust == ONE) ? most : product((wanted < most) ? wanted : most, trust, 30);
}

/* Split a moment over an axle's corners, each within its limit; return what they can't give. */
static int32_t split(canroll_ecu *ecu, const canroll_calibration *cal, uint32_t left,
    int32_t arm, int32_t track, int32_t moment)
{
    const int32_t want = product(moment, arm, 28);
    const int32_t size = (want < 0) ? -want : want;
    int32_t limit_left = cal->force_max[left], limit_right = cal->force_max[left + 1];
    int32_t up, down, lack;
    if (size <= limit_left && size <= limit_right
        && (ecu->trust[left] & ecu->trust[left + 1]) == ONE) {
        ecu->force[left] = want;
        ecu->force[left + 1] = -want;
        return 0;
    }
    limit_left = entrusted(limit_left, size, ecu->trust[left]);
    limit_right = entrusted(limit_right, size, ecu->trust[left + 1]);
    up = limit(want, -limit_left, limit_left);
    down = limit(2 * want - up, -limit_right, limit_right);
    up = limit(2 * want - down, -limit_left, limit_left);
    lack = 2 * want - up - down;
    ecu->force[left] = up;
    ecu->force[left + 1] = -down;
    return product(lack, track, 29);
}

/* How much of a moment may move to the other axle, which the steering balance bounds. */
static int32_t slack(const canroll_calibration *cal, int32_t moment)
{
    return product((moment < 0) ? -moment : moment, cal->share_slack, 30);
}

/* Each axle takes what the other lacks. */
void hand_allocate(canroll_ecu *ecu, const canroll_calibration *cal)
{
    const int32_t moment = ecu->moment;
    int32_t front = product(moment, ecu->front_share, 30), rear = moment - front;
    int32_t lack = split(ecu, cal, 0, cal->arm_front, cal->track_front, front), lack_rear;
    int32_t room, taken = 0;
    if (lack != 0) {
        room = slack(cal, moment);
        taken = limit(lack, -room, room);
        rear += taken;
    }
    lack_rear = split(ecu, cal, 2, cal->arm_rear, cal->track_rear, rear);
    if (lack_rear != 0) {
        room = slack(cal, moment);
        front += limit(lack_rear - taken, -room, room);
        lack = split(ecu, cal, 0, cal->arm_front, cal->track_front, front);
        rear -= lack_rear;
    }
    ecu->given = front - lack + rear;
}

/* Whether the moment pushes outward while the acceleration does not fall. */
static bool pushes(const canroll_calibration *cal, int32_t moment, int32_t a, int32_t slow)
{
    const int32_t margin = (cal->envelope_lateral + 4) >> 3;
    if (moment > cal->envelope_outward) {
        return a > cal->envelope_lateral && a > bits_31(slow - margin);
    }
    return moment < -cal->envelope_outward && a < -cal->envelope_lateral
        && a < bits_31(slow + margin);
}

/* The safety envelope before the allocation: one output, judged by the Imu. */
void hand_guard(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed)
{
    const int32_t a = ecu->acceleration_good, last = ecu->guarded[0];
    const int64_t way = (int64_t)elapsed * cal->envelope_slew;
    const int32_t step = (way > STATE_MAX) ? STATE_MAX : (int32_t)way;
    int32_t low = -cal->envelope_moment, high = cal->envelope_moment, given;
    if (ecu->lateral_lost == 0) {
        const bool out = pushes(cal, ecu->outputs[0], a, ecu->lateral_slow);
        ecu->outward_ticks = limit(
            ecu->outward_ticks + (out ? elapsed : -elapsed), 0, cal->envelope_ticks);
        if (ecu->outward_ticks == cal->envelope_ticks) {
            ecu->outward_cut = 1;
        } else if (ecu->outward_ticks == 0) {
            ecu->outward_cut = 0;
        }
        ecu->lateral_slow = bits_31(
            ecu->lateral_slow + bits_31(product(a - ecu->lateral_slow, cal->envelope_pass, 30)));
    }
    if (ecu->age[CANROLL_RX_IMU] > cal->envelope_age) {
        low = high = 0;
    }
    if (ecu->outward_cut) {
        if (a > 0) {
            high = 0;
        } else {
            low = 0;
        }
    }
    given = limit(ecu->outputs[0], low, high);
    given = limit(bits_31(last + limit(given - last, -step, step)), -cal->envelope_moment,
        cal->envelope_moment);
    ecu->envelope_acted = given != ecu->outputs[0];
    ecu->guarded[0] = ecu->moment = ecu->outputs[0] = given;
}

/* And behind it: no corner beyond its limit. */
void hand_bound(canroll_ecu *ecu, const canroll_calibration *cal)
{
    for (uint32_t corner = 0; corner < 4; corner++) {
        const int32_t most = cal->force_max[corner];
        if (ecu->force[corner] > most || ecu->force[corner] < -most) {
            ecu->envelope_acted = 1;
            ecu->force[corner] = limit(ecu->force[corner], -most, most);
        }
    }
}
