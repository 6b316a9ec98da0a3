/* Runs the cases, which reach every statement and branch of the loop, and compares the result of
   canroll_init and all states with what the reference gave. */
#include <stdio.h>
#include <string.h>

#include "canroll.h"
#include "cases.h"
#include "layout.h"

int main(void);

static canroll_calibration calibration;
static canroll_ecu ecu;
static const size_t ecu_ends[] = LAYOUT_ECU;
static const size_t calibration_ends[] = LAYOUT_CALIBRATION;

/* CRC-32 of the state record, of each word the lowest byte first, going on from crc. */
static uint32_t digest(uint32_t crc)
{
    const uint8_t *bytes = (const uint8_t *)&ecu;
    uint32_t rest = ~crc;
    for (size_t i = 0; i < sizeof ecu; i++) {
        rest ^= bytes[layout_place(ecu_ends, i)];
        for (int bit = 0; bit < 8; bit++) {
            rest = (rest >> 1) ^ (0xEDB88320u & (0u - (rest & 1u)));
        }
    }
    return ~rest;
}

static int passes(const case_data *its)
{
    int32_t received = 0;
    uint8_t *bytes = (uint8_t *)&calibration;
    for (size_t i = 0; i < sizeof calibration; i++) {
        bytes[layout_place(calibration_ends, i)] = its->calibration[i];
    }
    memset(&ecu, 0, sizeof ecu);
    if (canroll_init(&ecu, &calibration) != its->rule) {
        return 0;
    }
    uint32_t crc = digest(0u);
    for (int32_t tick = 0; tick < its->ticks; tick++) {
        if (tick == its->flipped) {
            bytes[layout_place(calibration_ends, CASE_CALIBRATION - CASE_FLIPPED)] ^= 1u;
        }
        for (; received < its->received && its->frames[received].tick == tick; received++) {
            const case_frame *frame = &its->frames[received];
            canroll_receive(&ecu, frame->message, frame->payload, frame->length);
        }
        canroll_tick(&ecu, &calibration, its->elapsed[tick]);
        crc = digest(crc);
        for (int32_t slot = 0; slot < CANROLL_N_TX; slot++) {
            ecu.tx_pending[slot] = 0;
        }
    }
    return crc == its->states;
}

int main(void)
{
    for (size_t k = 0; k < CASES; k++) {
        if (sizeof calibration != CASE_CALIBRATION || !passes(&cases[k])) {
            printf("FAIL: case %s\n", cases[k].name);
            return 1;
        }
    }
    printf("PASS: %d cases, all states as the reference\n", CASES);
    return 0;
}
