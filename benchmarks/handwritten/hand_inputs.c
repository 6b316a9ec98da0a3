/* Received frames: mailbox, E2E profile 1, signals. */
#include <stdbool.h>
#include <stddef.h>
#include "hand.h"

/* the checksum after both bytes of the data id */
enum { CRC_IMU = 32, CRC_MOTION = 148, CRC_ACTUATORS = 11 };
enum { COUNTERS = 15, NO_COUNTER = 255, CHECKS_MAX = 14, STEP_MAX = 15 };

/* CRC-8 SAE J1850 */
static const uint8_t crc_table[256] = {
    0, 29, 58, 39, 116, 105, 78, 83, 232, 245, 210, 207, 156, 129, 166, 187,
    205, 208, 247, 234, 185, 164, 131, 158, 37, 56, 31, 2, 81, 76, 107, 118,
    135, 154, 189, 160, 243, 238, 201, 212, 111, 114, 85, 72, 27, 6, 33, 60,
    74, 87, 112, 109, 62, 35, 4, 25, 162, 191, 152, 133, 214, 203, 236, 241,
    19, 14, 41, 52, 103, 122, 93, 64, 251, 230, 193, 220, 143, 146, 181, 168,
    222, 195, 228, 249, 170, 183, 144, 141, 54, 43, 12, 17, 66, 95, 120, 101,
    148, 137, 174, 179, 224, 253, 218, 199, 124, 97, 70, 91, 8, 21, 50, 47,
    89, 68, 99, 126, 45, 48, 23, 10, 177, 172, 139, 150, 197, 216, 255, 226,
    38, 59, 28, 1, 82, 79, 104, 117, 206, 211, 244, 233, 186, 167, 128, 157,
    235, 246, 209, 204, 159, 130, 165, 184, 3, 30, 57, 36, 119, 106, 77, 80,
    161, 188, 155, 134, 213, 200, 239, 242, 73, 84, 115, 110, 61, 32, 7, 26,
    108, 113, 86, 75, 24, 5, 34, 63, 132, 153, 190, 163, 240, 237, 202, 215,
    53, 40, 15, 18, 65, 92, 123, 102, 221, 192, 231, 250, 169, 180, 147, 142,
    248, 229, 194, 223, 140, 145, 182, 171, 16, 13, 42, 55, 100, 121, 94, 67,
    178, 175, 136, 149, 198, 219, 252, 225, 90, 71, 96, 125, 46, 51, 20, 9,
    127, 98, 69, 88, 11, 22, 49, 44, 151, 138, 173, 176, 227, 254, 217, 196,
};

uint32_t hand_crc(uint32_t start, hand_frame frame)
{
    uint32_t crc = crc_table[start ^ ((frame.lo >> 8) & 255)];
    crc = crc_table[crc ^ ((frame.lo >> 16) & 255)];
    crc = crc_table[crc ^ (frame.lo >> 24)];
    crc = crc_table[crc ^ (frame.hi & 255)];
    crc = crc_table[crc ^ ((frame.hi >> 8) & 255)];
    crc = crc_table[crc ^ ((frame.hi >> 16) & 255)];
    return crc_table[crc ^ (frame.hi >> 24)];
}

/* A frame goes in and out as two words. */
typedef char slots_are_words[(offsetof(canroll_ecu, rx_payload) % 4 == 0) ? 1 : -1];

static volatile uint32_t *words(canroll_ecu *ecu, uint32_t slot)
{
    return (volatile uint32_t *)(volatile void *)ecu->rx_payload[slot];
}

void canroll_receive(canroll_ecu *ecu, int32_t message, const uint8_t p[8], int32_t length)
{
    uint32_t slot;
    volatile uint32_t *to;
    if ((uint32_t)message >= CANROLL_N_FRAMES) {
        if ((uint32_t)message < CANROLL_N_FRAMES + CANROLL_N_TX) {
            ecu->rx_own = (uint8_t)(message - CANROLL_N_FRAMES + 1);
        }
        return;
    }
    if (length < 8) {
        return;
    }
    slot = 2u * (uint32_t)message + ecu->rx_side[message];
    to = words(ecu, slot);
    to[0] = (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
    to[1] = (uint32_t)p[4] | (uint32_t)p[5] << 8 | (uint32_t)p[6] << 16 | (uint32_t)p[7] << 24;
    ecu->rx_fresh[slot] = 1;
}

static uint8_t more(uint8_t checks)
{
    return (checks < CHECKS_MAX) ? (uint8_t)(checks + 1) : CHECKS_MAX;
}

static uint8_t wider(uint8_t step)
{
    return (step < STEP_MAX) ? (uint8_t)(step + 1) : STEP_MAX;
}

/* E2E_P01Check: whether the data of a frame may be used. */
static bool e2e_passed(canroll_ecu *ecu, const canroll_calibration *cal, uint32_t m,
    uint32_t start, hand_frame frame)
{
    const uint8_t counter = (frame.lo >> 8) & 15;
    const uint8_t tolerated = wider(ecu->e2e_delta[m]);
    int32_t step;
    if (counter >= COUNTERS || hand_crc(start, frame) != (frame.lo & 255)) {
        ecu->e2e_delta[m] = tolerated;
        return false;
    }
    step = counter - ecu->e2e_last[m];
    if (step < 0) {
        step += COUNTERS;
    }
    if (ecu->e2e_last[m] == NO_COUNTER) {
        ecu->e2e_delta[m] = cal->e2e_max_delta[m];
        ecu->e2e_last[m] = counter;
        return false;
    }
    if (step == 0) {
        ecu->e2e_delta[m] = tolerated;
        ecu->e2e_repeated[m] = more(ecu->e2e_repeated[m]);
        return false;
    }
    if (step == 1 || step <= tolerated) {
        const bool trusted = ecu->e2e_repeated[m] <= cal->e2e_max_repeated[m];
        ecu->e2e_delta[m] = cal->e2e_max_delta[m];
        ecu->e2e_last[m] = counter;
        ecu->e2e_repeated[m] = 0;
        if (!trusted) {
            ecu->e2e_resync[m] = cal->e2e_sync[m];
            return false;
        }
        if (ecu->e2e_resync[m] > 0) {
            ecu->e2e_resync[m]--;
            return false;
        }
        return true;
    }
    ecu->e2e_delta[m] = tolerated;
    ecu->e2e_repeated[m] = 0;
    ecu->e2e_resync[m] = cal->e2e_sync[m];
    if (ecu->e2e_resync[m] > 0) {
        ecu->e2e_delta[m] = cal->e2e_max_delta[m];
        ecu->e2e_last[m] = counter;
    }
    return false;
}

/* Take the newest frame of message m out of its mailbox, if there is one that may be used. */
static bool took(canroll_ecu *ecu, const canroll_calibration *cal, uint32_t m, uint32_t start,
    int32_t elapsed, hand_frame *frame)
{
    const uint32_t side = ecu->rx_side[m], slot = 2 * m + side;
    ecu->rx_side[m] = (uint8_t)(side ^ 1);
    if (ecu->rx_fresh[slot] != 0) {
        const volatile uint32_t *from = words(ecu, slot);
        ecu->rx_fresh[slot] = 0;
        frame->lo = from[0];
        frame->hi = from[1];
        if (e2e_passed(ecu, cal, m, start, *frame)) {
            ecu->age[m] = 0;
            return true;
        }
    } else {
        ecu->e2e_delta[m] = wider(ecu->e2e_delta[m]);
        ecu->e2e_repeated[m] = more(ecu->e2e_repeated[m]);
    }
    ecu->age[m] = aged(ecu->age[m], elapsed);
    ecu->unchanged[m] = aged(ecu->unchanged[m], elapsed);
    ecu->fresh[m] = 0;
    return false;
}

/* Note whether a frame's sample counter moved. */
static void sampled(canroll_ecu *ecu, uint32_t m, uint8_t sample, uint8_t valid, int32_t elapsed)
{
    ecu->valid[m] = valid;
    if (sample == ecu->last_sample[m]) {
        ecu->unchanged[m] = aged(ecu->unchanged[m], elapsed);
        ecu->fresh[m] = 0;
        return;
    }
    ecu->last_sample[m] = sample;
    ecu->unchanged[m] = 0;
    ecu->fresh[m] = canroll_signals_rx_signals[m];
}

/* raw * (high + low / 65536) to nearest, for 16-bit raw. */
static inline int32_t scaled(int32_t raw, int32_t high, int32_t low)
{
    return raw * high + ((raw * low + 32768) >> 16);
}

/* 0.005 deg/s as rad/s Q27 */
static inline int32_t rate_of(int32_t raw)
{
    return scaled(raw, 11712, 46291);
}

/* 0.00125 m/s2 as Q24 */
static inline int32_t acceleration_of(int32_t raw)
{
    return scaled(raw, 20971, 34078);
}

/* 0.01 km/h as m/s Q20 */
static inline int32_t speed_of(int32_t raw)
{
    return product(raw, 763549742, 18);
}

/* 0.1 deg as rad Q24 */
static inline int32_t angle_of(int32_t raw)
{
    return scaled(raw, 29281, 50190);
}

/* 0.5 N.m as Q14 */
static inline int32_t moment_of(int32_t raw)
{
    return raw * 8192;
}

/* Codes from 0x7ffe (signed) and 0xfffe (unsigned) on say error or not available. */
void hand_read_inputs(canroll_ecu *ecu, const canroll_calibration *cal, int32_t elapsed)
{
    hand_frame f;
    if (took(ecu, cal, CANROLL_RX_IMU, CRC_IMU, elapsed, &f)) {
        const int32_t rate = (int16_t)(f.lo >> 12);
        const int32_t lateral = (int16_t)(f.lo >> 28 | f.hi << 4);
        const int32_t yaw = (int16_t)(f.hi >> 12);
        uint32_t valid = 0;
        if (rate < 0x7ffe) {
            ecu->roll_rate = rate_of(rate);
            valid = 1;
        }
        if (lateral < 0x7ffe) {
            ecu->lateral_acceleration = acceleration_of(lateral);
            valid |= 2;
        }
        if (yaw < 0x7ffe) {
            ecu->yaw_rate = rate_of(yaw);
            valid |= 4;
        }
        ecu->imu_sample = (uint8_t)(f.hi >> 28);
        sampled(ecu, CANROLL_RX_IMU, ecu->imu_sample, (uint8_t)valid, elapsed);
    }
    if (took(ecu, cal, CANROLL_RX_VEHICLE_MOTION, CRC_MOTION, elapsed, &f)) {
        const uint32_t speed = (f.lo >> 12) & 0xffff;
        const int32_t steering = (int16_t)(f.lo >> 28 | f.hi << 4);
        uint32_t valid = 0;
        if (speed < 0xfffe) {
            ecu->speed = speed_of((int32_t)speed);
            valid = 1;
        }
        if (steering < 0x7ffe) {
            ecu->steering = angle_of(steering);
            valid |= 2;
        }
        ecu->motion_sample = (uint8_t)(f.hi >> 28);
        sampled(ecu, CANROLL_RX_VEHICLE_MOTION, ecu->motion_sample, (uint8_t)valid, elapsed);
    }
    if (took(ecu, cal, CANROLL_RX_ACTUATOR_STATE, CRC_ACTUATORS, elapsed, &f)) {
        const int32_t front = (int16_t)(f.lo >> 12);
        const int32_t rear = (int16_t)(f.lo >> 28 | f.hi << 4);
        uint32_t valid = 0;
        if (front < 0x7ffe) {
            ecu->delivered[0] = moment_of(front);
            valid = 1;
        }
        if (rear < 0x7ffe) {
            ecu->delivered[1] = moment_of(rear);
            valid |= 2;
        }
        ecu->status[0] = (f.hi >> 12) & 3;
        ecu->status[1] = (f.hi >> 14) & 3;
        ecu->status[2] = (f.hi >> 16) & 3;
        ecu->status[3] = (f.hi >> 18) & 3;
        ecu->enabled = (f.hi >> 20) & 1;
        ecu->command_held = (f.hi >> 21) & 1;
        ecu->accepted_counter = (f.hi >> 22) & 15;
        ecu->actuator_sample = (f.hi >> 26) & 15;
        sampled(ecu, CANROLL_RX_ACTUATOR_STATE, ecu->actuator_sample, (uint8_t)valid, elapsed);
    }
}
