/* Runs the test vectors, saves what outlives a loss of power, and gives it to an ECU that starts
   anew. It is also how a board does it: save and write, or read and restore after the inits. */
#include "canroll.h"
#include "canroll_gains.h"
#include "nvm_session.h"
#include "vectors.h"

#include <string.h>
#if __STDC_HOSTED__
#include <stdio.h>
#endif

int main(void);

static const canroll_calibration calibration = CANROLL_CALIBRATION_INITIALISER;
static canroll_calibration other;
static canroll_ecu ecu, started, next;
static canroll_nvm nvm, memory;
#ifdef NVM_UDS
static canroll_uds uds, uds_started, uds_next;
#endif

static int failed(const char *what)
{
#if __STDC_HOSTED__
    printf("FAIL: NVM, %s\n", what);
#else
    (void)what;
#endif
    return 1;
}

static int32_t restored(const canroll_calibration *its)
{
    memcpy(&next, &started, sizeof next);
    int32_t rule = canroll_nvm_restore(&memory, &next, its);
#ifdef NVM_UDS
    memcpy(&uds_next, &uds_started, sizeof uds_next);
    if (rule == 0) {
        rule = canroll_nvm_uds_restore(&memory, &uds_next, &next, its);
    }
#endif
    return rule;
}

static int as_started(void)
{
#ifdef NVM_UDS
    if (memcmp(&uds_next, &uds_started, sizeof uds_next) != 0) {
        return 0;
    }
#endif
    return memcmp(&next, &started, sizeof next) == 0;
}

int main(void)
{
    int32_t received = 0;
    if (canroll_init(&ecu, &calibration) != 0) {
        return failed("the calibration is refused");
    }
    memcpy(&started, &ecu, sizeof started);
#ifdef NVM_UDS
    canroll_uds_init(&uds, &ecu);
    memcpy(&uds_started, &uds, sizeof uds_started);
#endif
    for (int32_t tick = 0; tick < VECTOR_TICKS; tick++) {
        for (; received < VECTOR_RECEIVED && vector_received[received].tick == tick; received++) {
            canroll_receive(&ecu, vector_received[received].message,
                vector_received[received].payload, vector_received[received].length);
        }
        canroll_tick(&ecu, &calibration, vector_elapsed[tick]);
#ifdef NVM_UDS
        canroll_uds_tick(&uds, &ecu, &calibration, vector_elapsed[tick]);
#endif
        memset(ecu.tx_pending, 0, sizeof ecu.tx_pending);
    }
    canroll_nvm_save(&nvm, &ecu, &calibration);
#ifdef NVM_UDS
    canroll_nvm_uds_save(&nvm, &uds);
#endif
    if ((uint32_t)nvm.crc != NVM_CRC || (size_t)canroll_nvm_size(&nvm) != sizeof nvm) {
        return failed("another record than the reference");
    }
    for (size_t k = 0; k < sizeof nvm; k++) {
        memory = nvm;
        ((uint8_t *)&memory)[k] ^= (uint8_t)(1u << (k & 7u));
        if (restored(&calibration) == 0 || !as_started()) {
            return failed("a damaged record was taken");
        }
    }
    memset(&memory, 0xFF, sizeof memory);
    if (restored(&calibration) != 1 || !as_started()) {
        return failed("blank memory was taken");
    }
    memory = nvm;
    other = calibration;
    other.id = calibration.id ^ 1;
    if (restored(&other) != 3 || !as_started()) {
        return failed("the record of another calibration was taken");
    }
    if (restored(&calibration) != 0 || next.fault_latched != ecu.fault_latched
        || memcmp(next.fault_count, ecu.fault_count, sizeof ecu.fault_count) != 0
        || next.offset_rate != ecu.offset_rate
        || next.offset_acceleration != ecu.offset_acceleration) {
        return failed("faults and offsets are not those that were saved");
    }
#ifdef NVM_UDS
    if (memcmp(uds_next.kept, uds.kept, sizeof uds.kept) != 0) {
        return failed("the snapshots are not those that were saved");
    }
#endif
#if __STDC_HOSTED__
    printf("PASS: NVM, a record of %d bytes\n", (int)sizeof nvm);
#endif
    return 0;
}
