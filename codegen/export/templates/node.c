#include "node.h"
#include "canroll.h"
#include "canroll_frames.h"
#include "canroll_gains.h"{secoc_include}
{secoc_prototype}
static const canroll_calibration calibration = CANROLL_CALIBRATION_INITIALISER;
static canroll_ecu ecu;{secoc_record}

__attribute__((weak)) int node_next(uint32_t *identifier, uint8_t payload[NODE_BYTES],
    int32_t *length)
{
    *identifier = 0;
    *length = 0;
    payload[0] = 0;
    return 0;
}

__attribute__((weak)) void node_send(uint32_t identifier, const uint8_t *payload, int32_t length,
    int32_t fd)
{
    (void)identifier;
    (void)payload;
    (void)length;
    (void)fd;
}

__attribute__((weak)) void node_alive(void)
{
}

static void receive_all(void)
{
    uint32_t identifier;
    uint8_t payload[NODE_BYTES];
    int32_t length;
    while (node_next(&identifier, payload, &length)) {
        for (int32_t message = 0; message < CANROLL_N_FRAMES; message++) {
            if ((uint32_t)canroll_signals_rx_ids[message] == identifier{secoc_verified}) {
                canroll_receive(&ecu, message, payload, length);
            }
        }
        /* a driver that gives back the ECU's own frames must leave them out here */
        for (int32_t slot = 0; slot < CANROLL_N_TX; slot++) {
            if ((uint32_t)canroll_signals_tx_ids[slot] == identifier
                && canroll_signals_tx_lengths[slot] != 0u) {
                canroll_receive(&ecu, CANROLL_N_FRAMES + slot, payload, length);
            }
        }
    }
}

static void send_all(void)
{
    for (int32_t slot = 0; slot < CANROLL_N_TX; slot++) {
        if (ecu.tx_pending[slot] == 1) {
            ecu.tx_pending[slot] = 0;{secoc_protected}
            node_send((uint32_t)canroll_signals_tx_ids[slot], ecu.tx_payload[slot],
                canroll_signals_tx_lengths[slot], {fd});
        }
    }
}

int32_t node_start(void)
{
    const int32_t rule = canroll_init(&ecu, &calibration);{secoc_start}
    return rule;
}

void node_tick(int32_t elapsed)
{
    const int32_t before = ecu.time;
    receive_all();{secoc_elapsed}
    canroll_tick(&ecu, &calibration, elapsed);
    send_all();
    /* the time is the last that a tick writes: it has passed where the tick ran to its end */
    if (ecu.time != before) {
        node_alive();
    }
}

int32_t node_period_us(void)
{
    return calibration.tick_us;
}

int32_t node_time(void)
{
    return ecu.time;
}
