/* Replays the test vectors and compares every frame sent and every state with what the reference
   gave. On a host it prints the verdict; on a bare target the exit code is the verdict. */
#include "canroll.h"
#include "canroll_gains.h"
#include "layout.h"
#include "vectors.h"

#if __STDC_HOSTED__
#include <stdio.h>
#endif

int main(void);

static const canroll_calibration calibration = CANROLL_CALIBRATION_INITIALISER;
static canroll_ecu ecu;

/* FNV-1a over the bytes of the state record, of each word the lowest first. */
static uint32_t digest(const canroll_ecu *record)
{
    static const size_t ends[] = LAYOUT_ECU;
    const uint8_t *bytes = (const uint8_t *)record;
    uint32_t hash = 2166136261u;
    for (size_t i = 0; i < sizeof *record; i++) {
        hash = (hash ^ bytes[layout_place(ends, i)]) * 16777619u;
    }
    return hash;
}

static int failed(int32_t tick, const char *what)
{
#if __STDC_HOSTED__
    printf("FAIL: tick %ld: %s\n", (long)tick, what);
#else
    (void)tick;
    (void)what;
#endif
    return 1;
}

int main(void)
{
    int32_t received = 0, sent = 0;
    if (canroll_init(&ecu, &calibration) != 0) {
        return failed(0, "the calibration is refused");
    }
    for (int32_t tick = 0; tick < VECTOR_TICKS; tick++) {
        for (; received < VECTOR_RECEIVED && vector_received[received].tick == tick; received++) {
            canroll_receive(&ecu, vector_received[received].message,
                vector_received[received].payload, vector_received[received].length);
        }
        canroll_tick(&ecu, &calibration, vector_elapsed[tick]);
        for (int32_t slot = 0; slot < CANROLL_N_TX; slot++) {
            if (ecu.tx_pending[slot] == 0) {
                continue;
            }
            ecu.tx_pending[slot] = 0;
            if (sent >= VECTOR_SENT || vector_sent[sent].tick != tick
                || vector_sent[sent].message != slot) {
                return failed(tick, "another frame was sent");
            }
            for (uint32_t k = 0; k < sizeof ecu.tx_payload[slot]; k++) {
                if (vector_sent[sent].payload[k] != ecu.tx_payload[slot][k]) {
                    return failed(tick, "a frame has other bytes");
                }
            }
            sent++;
        }
        if (digest(&ecu) != vector_state[tick]) {
            return failed(tick, "the state differs");
        }
    }
    if (sent != VECTOR_SENT) {
        return failed(VECTOR_TICKS, "a frame is missing");
    }
#if __STDC_HOSTED__
    printf("PASS: %ld ticks, %ld frames sent, all bytes as the reference\n", (long)VECTOR_TICKS,
        (long)sent);
#endif
    return 0;
}
