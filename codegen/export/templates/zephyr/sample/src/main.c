/* The controller on the CAN bus of a Zephyr board (chosen zephyr,canbus); see board/node.h. */
#include <string.h>

#include <zephyr/device.h>
#include <zephyr/drivers/can.h>
#include <zephyr/kernel.h>

#include "node.h"

static const struct device *const bus = DEVICE_DT_GET(DT_CHOSEN(zephyr_canbus));
static K_TIMER_DEFINE(periods, NULL, NULL);
CAN_MSGQ_DEFINE(received, 32);

int node_next(uint32_t *identifier, uint8_t payload[NODE_BYTES], int32_t *length)
{
    struct can_frame frame;
    while (k_msgq_get(&received, &frame, K_NO_WAIT) == 0) {
        if ((frame.flags & CAN_FRAME_RTR) == 0) {
            const size_t size = can_dlc_to_bytes(frame.dlc);
            *identifier = frame.id | ((frame.flags & CAN_FRAME_IDE) != 0 ? NODE_EXTENDED : 0u);
            *length = (int32_t)size;
            memcpy(payload, frame.data, MIN(size, (size_t)NODE_BYTES));
            return 1;
        }
    }
    return 0;
}

/* A frame that finds the controller's buffers full is lost, as on any bus that is not there. */
void node_send(uint32_t identifier, const uint8_t *payload, int32_t length, int32_t fd)
{
    struct can_frame frame = { 0 };
    frame.id = identifier & ~NODE_EXTENDED;
    frame.dlc = can_bytes_to_dlc((uint8_t)length);
    frame.flags = ((identifier & NODE_EXTENDED) != 0u ? CAN_FRAME_IDE : 0)
        | ((fd & 1) != 0 ? CAN_FRAME_FDF : 0) | ((fd & 2) != 0 ? CAN_FRAME_BRS : 0);
    memcpy(frame.data, payload, MIN((size_t)length, sizeof frame.data));
    (void)can_send(bus, &frame, K_NO_WAIT, NULL, NULL);
}

int main(void)
{
    const struct can_filter every = { .flags = 0, .id = 0, .mask = 0 };
    const struct can_filter every_extended = { .flags = CAN_FILTER_IDE, .id = 0, .mask = 0 };
    if (!device_is_ready(bus) || node_start() != 0
        || can_add_rx_filter_msgq(bus, &received, &every) < 0
        || can_add_rx_filter_msgq(bus, &received, &every_extended) < 0
        || can_set_mode(bus, {fd_mode}) != 0 || can_start(bus) != 0) {
        return 1;
    }
    k_timer_start(&periods, K_USEC(node_period_us()), K_USEC(node_period_us()));
    for (;;) {
        /* waits for the next period, and counts those gone by */
        node_tick((int32_t)k_timer_status_sync(&periods));
    }
}
