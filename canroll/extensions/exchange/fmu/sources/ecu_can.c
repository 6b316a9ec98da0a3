/* The ECU's frames at its CAN terminal. */
#include <stdio.h>

#include "canroll_frames.h"
#include "ecu_tables.h"
#include "ls_bus.h"

void ecu_defaults(model *m)
{
    (void)m;
}

void ecu_before(model *m)
{
    (void)m;
}

bool ecu_after(model *m, fmu_buffer *tx, int slot, fmu_reason *why)
{
    const ecu_frame *sent = &ecu_sent[slot];
    ls_frame frame = { .ident = sent->ident, .extended = sent->extended, .fd = sent->fd,
                       .switched = sent->switched, .length = sent->length };
    if (tx == NULL || sent->length == 0) {
        return true;
    }
    for (size_t k = 0; k < sent->length && k < sizeof m->ecu.tx_payload[slot]; k++) {
        frame.data[k] = m->ecu.tx_payload[slot][k];
    }
    if (ls_transmit(&tx[0], &frame)) {
        return true;
    }
    snprintf(why->text, sizeof why->text,
             "nobody takes the frames sent: activate CAN.Tx_Clock and read CAN.Tx_Data");
    return false;
}

bool model_receive(model *m, fmu_buffer *tx, size_t port, const uint8_t *operation, uint32_t size,
                   int64_t now_ns, fmu_reason *why)
{
    (void)tx, (void)port, (void)now_ns;
    uint32_t code = ls_number(operation, 4);
    if (code != LS_CAN && code != LS_CAN_FD) {
        return true; /* what buses report beside frames */
    }
    ls_frame frame;
    if (!ls_read(operation, size, &frame)) {
        snprintf(why->text, sizeof why->text, "a transmit operation with wrong lengths");
        return false;
    }
    for (size_t k = 0; k < ECU_RECEIVED; k++) {
        const ecu_frame *wanted = &ecu_received[k];
        if (!frame.remote && frame.ident == wanted->ident && frame.extended == wanted->extended
            && frame.fd == wanted->fd) {
            canroll_receive(&m->ecu, wanted->slot, frame.data, frame.length);
        }
    }
    for (int32_t slot = 0; slot < CANROLL_N_TX; slot++) {
        const ecu_frame *own = &ecu_sent[slot];
        if (!frame.remote && own->length != 0 && frame.ident == own->ident
            && frame.extended == own->extended && frame.fd == own->fd) {
            canroll_receive(&m->ecu, CANROLL_N_FRAMES + slot, frame.data, frame.length);
        }
    }
    return true;
}
