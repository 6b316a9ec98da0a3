/* The ECU's signals as plain variables: packed into its frames before every tick, and read from
 * those it sends. */
#include <math.h>

#include "ecu_tables.h"

void ecu_defaults(model *m)
{
    m->calibration.e2e = 0; /* frames that never leave the FMU need no protection */
    for (size_t k = 0; k < ECU_INPUTS; k++) {
        m->inputs[k] = ecu_input_starts[k];
    }
}

static void put(uint8_t *payload, const ecu_signal *signal, int64_t raw)
{
    for (int k = 0; k < signal->pieces; k++) {
        const ecu_piece *piece = &signal->piece[k];
        uint32_t mask = (1u << piece->width) - 1u;
        uint32_t part = (uint32_t)(raw >> piece->signal_bit) & mask;
        payload[piece->byte] =
            (uint8_t)((payload[piece->byte] & ~(mask << piece->bit)) | part << piece->bit);
    }
}

static int64_t taken(const uint8_t *payload, const ecu_signal *signal)
{
    int64_t raw = 0;
    for (int k = 0; k < signal->pieces; k++) {
        const ecu_piece *piece = &signal->piece[k];
        uint32_t mask = (1u << piece->width) - 1u;
        raw |= (int64_t)(payload[piece->byte] >> piece->bit & mask) << piece->signal_bit;
    }
    int64_t half = INT64_C(1) << (signal->length - 1);
    return signal->sign && raw >= half ? raw - 2 * half : raw;
}

void ecu_before(model *m)
{
    uint8_t payloads[ECU_RECEIVED][64] = { { 0 } };
    for (size_t k = 0; k < ECU_INPUTS; k++) {
        const ecu_signal *signal = &ecu_inputs[k];
        double raw = floor((m->inputs[k] - signal->offset) / signal->scale + 0.5);
        raw = fmin(fmax(raw, signal->low), signal->high);
        put(payloads[signal->frame], signal, raw == raw ? (int64_t)raw : 0);
    }
    for (size_t k = 0; k < ECU_COUNTERS; k++) {
        put(payloads[ecu_counters[k].frame], &ecu_counters[k], m->ticks % 16);
    }
    for (size_t k = 0; k < ECU_RECEIVED; k++) {
        canroll_receive(&m->ecu, ecu_received[k].slot, payloads[k], ecu_received[k].length);
    }
}

bool ecu_after(model *m, fmu_buffer *tx, int slot, fmu_reason *why)
{
    (void)tx, (void)why;
    for (size_t k = 0; slot == ECU_COMMAND && k < ECU_OUTPUTS; k++) {
        const ecu_signal *signal = &ecu_outputs[k];
        double raw = (double)taken(m->ecu.tx_payload[slot], signal);
        m->outputs[k] = raw * signal->scale + signal->offset;
    }
    return true;
}

bool model_receive(model *m, fmu_buffer *tx, size_t port, const uint8_t *operation, uint32_t size,
                   int64_t now_ns, fmu_reason *why)
{
    (void)m, (void)tx, (void)port, (void)operation, (void)size, (void)now_ns, (void)why;
    return false;
}
