/* How a board runs the controller: SysTick gives the period, the CAN driver the frames.
   Give can_next and can_send your driver's code; as they stand the controller meets a silent bus
   and stays in INIT, which lets this run on any Cortex-M and in an emulator. */
#include "canroll.h"
#include "canroll_gains.h"{secoc_include}

#define CLOCK_HZ 25000000u
#define SYSTICK ((volatile uint32_t *)0xE000E010u)

int main(void);{secoc_prototype}
int can_next(uint32_t *identifier, uint8_t payload[{bytes}], int32_t *length);
void can_send(uint32_t identifier, const uint8_t payload[{bytes}], int32_t length);

static const canroll_calibration calibration = CANROLL_CALIBRATION_INITIALISER;
static canroll_ecu ecu;{secoc_record}

/* The next received frame, 1 where there is one. May also live in the receive interrupt. */
__attribute__((weak)) int can_next(uint32_t *identifier, uint8_t payload[{bytes}], int32_t *length)
{
    *identifier = 0;
    *length = 0;
    payload[0] = 0;
    return 0;
}

/* Queues a frame. */
__attribute__((weak)) void can_send(uint32_t identifier, const uint8_t payload[{bytes}], int32_t length)
{
    (void)identifier;
    (void)payload;
    (void)length;
}

static void receive_all(void)
{
    uint32_t identifier;
    uint8_t payload[{bytes}];
    int32_t length;
    while (can_next(&identifier, payload, &length)) {
        for (int32_t message = 0; message < CANROLL_N_RX; message++) {
            if ((uint32_t)canroll_signals_rx_ids[message] == identifier{secoc_verified}) {
                canroll_receive(&ecu, message, payload, length);
            }
        }
        /* a driver that gives back the ECU's own frames must leave them out here */
        for (int32_t slot = 0; slot < CANROLL_N_TX; slot++) {
            if ((uint32_t)canroll_signals_tx_ids[slot] == identifier
                && canroll_signals_tx_lengths[slot] != 0u) {
                canroll_receive(&ecu, CANROLL_N_RX + slot, payload, length);
            }
        }
    }
}

static void send_all(void)
{
    for (int32_t slot = 0; slot < CANROLL_N_TX; slot++) {
        if (ecu.tx_pending[slot] == 1) {
            ecu.tx_pending[slot] = 0;{secoc_protected}
            can_send((uint32_t)canroll_signals_tx_ids[slot], ecu.tx_payload[slot],
                canroll_signals_tx_lengths[slot]);
        }
    }
}

int main(void)
{
    int32_t ticks = 0;
    if (canroll_init(&ecu, &calibration) != 0) {
        return 1;
    }{secoc_start}
    SYSTICK[1] = (uint32_t)calibration.tick_us * (CLOCK_HZ / 1000000u) - 1u;
    SYSTICK[2] = 0;
    SYSTICK[0] = 5u;
    while (ticks < 20) { /* a product runs for ever; the example ends, so that it can be tested */
        if ((SYSTICK[0] & 0x10000u) != 0u) {
            receive_all();{secoc_elapsed}
            canroll_tick(&ecu, &calibration, 1);
            send_all();
            ticks++;
        }
    }
    return 0;
}
