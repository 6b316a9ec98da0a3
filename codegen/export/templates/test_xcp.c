/* Runs a session of XCP: commands and the frames that the reference answered. It is also how a board
   runs the service: the loop on the page that the tool chose, then the service, then its frames. */
#include "canroll.h"
#include "canroll_gains.h"
#include "layout.h"
#include "xcp_session.h"

#if __STDC_HOSTED__
#include <stdio.h>
#endif

int main(void);

static const canroll_calibration calibration = CANROLL_CALIBRATION_INITIALISER;
static canroll_calibration working;
static canroll_ecu ecu;
static canroll_xcp xcp;

static int failed(int32_t tick)
{
#if __STDC_HOSTED__
    printf("FAIL: XCP, tick %ld: another answer\n", (long)tick);
#else
    (void)tick;
#endif
    return 1;
}

/* Whether the bytes are the answer's; those of a word are in the order of this machine. */
static int same(const xcp_frame *answer, const uint8_t *payload)
{
    for (int32_t k = 0; k < answer->length; k++) {
        int32_t at = k;
        if (answer->word > 0 && layout_big_endian() && k >= answer->word && k < answer->word + 4) {
            at = (2 * answer->word) + 3 - k;
        }
        if (answer->payload[k] != payload[at]) {
            return 0;
        }
    }
    return 1;
}

int main(void)
{
    int32_t command = 0, answer = 0;
    if (canroll_init(&ecu, &calibration) != 0) {
        return failed(0);
    }
    /* on a board: the addresses of the two records, as the A2L has them */
    canroll_xcp_init(&xcp, &calibration, &working, XCP_STATE_ADDRESS, XCP_PAGE_ADDRESS);
    for (int32_t tick = 0; tick < XCP_TICKS; tick++) {
        if (command < XCP_COMMANDS && xcp_commands[command].tick == tick) {
            canroll_xcp_receive(&xcp, xcp_commands[command].payload, xcp_commands[command].length);
            command++;
        }
        canroll_tick(&ecu, (xcp.ecu_page == 1) ? &working : &calibration, 1);
        canroll_xcp_tick(&xcp, &ecu, &calibration, &working, 1);
        for (int32_t slot = 0; slot < CANROLL_N_SLOTS; slot++) {
            if (xcp.tx_pending[slot] == 0) {
                continue;
            }
            xcp.tx_pending[slot] = 0;
            if (answer >= XCP_ANSWERS || xcp_answers[answer].tick != tick
                || xcp_answers[answer].length != xcp.tx_length[slot]) {
                return failed(tick);
            }
            if (!same(&xcp_answers[answer], xcp.tx_payload[slot])) {
                return failed(tick);
            }
            answer++;
        }
    }
    if (answer != XCP_ANSWERS) {
        return failed(XCP_TICKS);
    }
#if __STDC_HOSTED__
    printf("PASS: XCP, %d commands and %d answers, byte for byte\n", XCP_COMMANDS, XCP_ANSWERS);
#endif
    return 0;
}
