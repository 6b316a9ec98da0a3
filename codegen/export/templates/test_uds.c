/* Runs a session of UDS: frames and the frames that the reference answered. It is also how a board
   runs the service: the loop, then the service, then its frame. */
#include "canroll.h"
#include "canroll_gains.h"
#include "uds_session.h"

#if __STDC_HOSTED__
#include <stdio.h>
#endif

int main(void);

static const canroll_calibration calibration = CANROLL_CALIBRATION_INITIALISER;
static canroll_ecu ecu;
static canroll_uds uds;

static int failed(int32_t tick)
{
#if __STDC_HOSTED__
    printf("FAIL: UDS, tick %ld: another answer\n", (long)tick);
#else
    (void)tick;
#endif
    return 1;
}

int main(void)
{
    int32_t command = 0, answer = 0;
    if (canroll_init(&ecu, &calibration) != 0) {
        return failed(0);
    }
    canroll_uds_init(&uds, &ecu);
    for (int32_t tick = 0; tick < UDS_TICKS; tick++) {
        if (command < UDS_COMMANDS && uds_commands[command].tick == tick) {
            canroll_uds_receive(&uds, uds_commands[command].payload, uds_commands[command].length);
            command++;
        }
        canroll_tick(&ecu, &calibration, 1);
        canroll_uds_tick(&uds, &ecu, &calibration, 1);
        if (uds.tx_pending == 1) {
            uds.tx_pending = 0;
            if (answer >= UDS_ANSWERS || uds_answers[answer].tick != tick) {
                return failed(tick);
            }
            for (int32_t k = 0; k < 8; k++) {
                if (uds_answers[answer].payload[k] != uds.tx_payload[k]) {
                    return failed(tick);
                }
            }
            answer++;
        }
    }
    if (answer != UDS_ANSWERS) {
        return failed(UDS_TICKS);
    }
#if __STDC_HOSTED__
    printf("PASS: UDS, %d frames and %d answers, byte for byte\n", UDS_COMMANDS, UDS_ANSWERS);
#endif
    return 0;
}
