/* Runs a session of authentication: frames protected, and frames judged, as the reference did. */
#include "canroll.h"
#include "secoc_session.h"

#if __STDC_HOSTED__
#include <stdio.h>
#endif

int main(void);

static canroll_secoc secoc;

static int failed(const char *what, int32_t number)
{
#if __STDC_HOSTED__
    printf("FAIL: SecOC, %s frame %ld\n", what, (long)number);
#else
    (void)what;
    (void)number;
#endif
    return 1;
}

int main(void)
{
    canroll_secoc_start(&secoc, secoc_key, 7, SECOC_LISTENING);
    for (int32_t number = 0; number < SECOC_SENT; number++) {
        uint8_t frame[16] = { 0 };
        for (int32_t k = 0; k < 8; k++) {
            frame[k] = secoc_sent[number].plain[k];
        }
        canroll_secoc_protect(&secoc, secoc_sent[number].slot, frame);
        for (int32_t k = 0; k < 16; k++) {
            if (frame[k] != secoc_sent[number].secured[k]) {
                return failed("sent", number);
            }
        }
    }
    for (int32_t number = 0; number < SECOC_RECEIVED; number++) {
        canroll_secoc_elapse(&secoc, 1);
        if (canroll_secoc_verify(&secoc, 0, secoc_received[number].frame, 16)
            != secoc_received[number].taken) {
            return failed("received", number);
        }
    }
    if (secoc.refused != SECOC_REFUSED) {
        return failed("refused", secoc.refused);
    }
#if __STDC_HOSTED__
    printf("PASS: SecOC, %d frames sent and %d judged, byte for byte\n", SECOC_SENT, SECOC_RECEIVED);
#endif
    return 0;
}
