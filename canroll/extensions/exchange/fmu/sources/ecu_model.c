/* The ECU as an FMU: its loop ticks with the simulation's time.
 *
 * Tick k starts at the start time + ECU_PHASE_NS + k * the calibration's tick, after all that was
 * received up to and including that instant; so it runs when time passes on from there. */
#include <stdio.h>
#include <string.h>

#include "ecu_tables.h"

static const canroll_calibration gains = CANROLL_CALIBRATION_INITIALISER;

void model_defaults(model *m)
{
    m->calibration = gains;
    ecu_defaults(m);
}

/* CRC-32 (ISO-HDLC) of the calibration's bytes before its own. */
static uint32_t checksum(const canroll_calibration *calibration)
{
    const uint8_t *bytes = (const uint8_t *)calibration;
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t k = 0; k < offsetof(canroll_calibration, crc); k++) {
        crc ^= bytes[k];
        for (int bit = 0; bit < 8; bit++) {
            crc = crc >> 1 ^ (crc & 1 ? 0xEDB88320u : 0u);
        }
    }
    return ~crc;
}

static void publish(model *m)
{
    for (size_t k = 0; k < ECU_SHOWN; k++) {
        const uint8_t *at = (const uint8_t *)&m->ecu + ecu_shown[k].offset;
        int32_t word = 0;
        if (ecu_shown[k].wide) {
            memcpy(&word, at, sizeof word);
        } else {
            word = *at;
        }
        m->shown[k] = (double)word / ecu_shown[k].one;
    }
}

bool model_start(model *m, int64_t now_ns, fmu_reason *why)
{
    uint32_t crc = checksum(&m->calibration);
    memcpy(&m->calibration.crc, &crc, sizeof crc);
    int32_t rule = canroll_init(&m->ecu, &m->calibration);
    if (rule != 0) {
        snprintf(why->text, sizeof why->text,
                 "the ECU refuses the calibration: rule %d of its check", (int)rule);
        return false;
    }
    m->start_ns = now_ns;
    publish(m);
    return true;
}

bool model_advance(model *m, fmu_buffer *tx, int64_t until_ns, fmu_reason *why)
{
    const int64_t period = model_period_ns(m);
    while (m->start_ns + ECU_PHASE_NS + (m->ticks + 1) * period < until_ns) {
        m->ticks++;
        ecu_before(m);
        canroll_tick(&m->ecu, &m->calibration, 1);
        for (int slot = 0; slot < CANROLL_N_TX; slot++) {
            if (m->ecu.tx_pending[slot] == 1) {
                m->ecu.tx_pending[slot] = 0;
                if (!ecu_after(m, tx, slot, why)) {
                    return false;
                }
            }
        }
        publish(m);
    }
    return true;
}

int64_t model_next(model *m, fmu_buffer *tx, size_t port, int64_t now_ns)
{
    (void)m, (void)tx, (void)port, (void)now_ns;
    return -1;
}

int64_t model_period_ns(const model *m)
{
    return 1000 * (int64_t)m->calibration.tick_us;
}

int64_t model_shift_ns(const model *m)
{
    (void)m;
    return ECU_PHASE_NS + ECU_RUN_TIME_NS;
}
