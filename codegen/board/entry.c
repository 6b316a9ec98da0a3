/* Keeps the three entry points in an image that something outside calls, such as an emulator. */
#include "canroll.h"

void canroll_idle(canroll_ecu *ecu, const canroll_calibration *cal, const uint8_t *payload)
{
    for (;;) {
        (void)canroll_init(ecu, cal);
        canroll_receive(ecu, 0, payload, 8);
        canroll_tick(ecu, cal, 1);
    }
}
