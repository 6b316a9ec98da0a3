/*
 * The roll-control tick for one configuration, written by hand on the generated records.
 *
 * Suspension forces by state feedback with constant observer gains, roll rate and lateral
 * acceleration measured, event trigger, E2E on; nothing identified or learnt. The zeros of the
 * observer's model are those of its physics: the moment and the lateral acceleration move the roll
 * pair, the lateral acceleration is a pair of its own, the gyro bias stays as it is and adds to the
 * measured roll rate. Moments stay below 2^28 (16 kN.m): their sums and differences have 32 bits.
 */
#ifndef HAND_H
#define HAND_H

#include "canroll.h"

/* Rows of residuals in the state. */
enum { ROW_APART = 6, ROW_BIAS = 9, ROW_DELIVERY = 11, ROW_ECHO = 14 };
enum { ROW_STEERED = 13, ROW_MIRRORED = 14 };

enum { NO_SAMPLE = 16, ONE = 1 << 30, AGE_MAX = CANROLL_AGE_MAX };
enum { STATE_MAX = (1 << 30) - 1, STATE_MIN = -(1 << 30) };

/* A frame as two little-endian words. */
typedef struct {
    uint32_t lo, hi;
} hand_frame;

uint32_t hand_crc(uint32_t start, hand_frame frame);
void hand_read_inputs(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed);
void hand_watch_sensors(canroll_ecu *ecu, const canroll_calibration *cal);
void hand_watch_moments(canroll_ecu *ecu, const canroll_calibration *cal);
void hand_supervise(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed);
void hand_observe(canroll_ecu *ecu, const canroll_calibration *cal, int32_t steps);
void hand_control(canroll_ecu *ecu, const canroll_calibration *cal, int32_t steps);
void hand_allocate(canroll_ecu *ecu, const canroll_calibration *cal);
void hand_guard(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed);
void hand_bound(canroll_ecu *ecu, const canroll_calibration *cal);
void hand_note_command(canroll_ecu *ecu, const canroll_calibration *cal);
void hand_trigger(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed);
void hand_transmit(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed);

/* v within 31 bits, so that a sum of two fits 32. */
static inline int32_t bits_31(int32_t v)
{
    return (v > STATE_MAX) ? STATE_MAX : ((v < STATE_MIN) ? STATE_MIN : v);
}

static inline int32_t limit(int32_t v, int32_t lo, int32_t hi)
{
    return (v > hi) ? hi : ((v < lo) ? lo : v);
}

/* a + b, at most AGE_MAX. */
static inline int32_t aged(int32_t a, int32_t b)
{
    return (a + b > AGE_MAX) ? AGE_MAX : a + b;
}

/* a b / 2^n to nearest, for a constant n and a result of 32 bits. */
static inline int32_t product(int32_t a, int32_t b, int32_t n)
{
    return (int32_t)(((int64_t)a * b + ((int64_t)1 << (n - 1))) >> n);
}

/* The low word of v / 2^n, rounded down, n below 32. */
static inline int32_t shifted(int64_t v, uint32_t n)
{
    const uint32_t hi = (uint32_t)((uint64_t)v >> 32);
    return (int32_t)(((uint32_t)v >> n) | ((hi << 1) << (31 - n)));
}

/* v / 2^n to nearest, within 31 bits: whatever has 32 bits before the last halving is. */
static inline int32_t state_of(int64_t v, uint32_t n)
{
    const int32_t hi = (int32_t)(v >> 32);
    int32_t twice;
    if (n > 32) {
        twice = hi >> (n - 33);
    } else {
        twice = shifted(v, n - 1);
        if ((hi >> (n - 1)) != (twice >> 31)) {
            return (hi < 0) ? STATE_MIN : STATE_MAX;
        }
    }
    return bits_31((twice >> 1) + (twice & 1));
}

#endif
