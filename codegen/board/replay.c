/* Replays traffic from a file of the host (semihosting) and writes what the ECU did to another. */
#include <stddef.h>

#include "canroll.h"

#define ROOM(mailboxes) (sizeof((canroll_ecu *)0)->mailboxes[0])

typedef struct {
    int32_t tick, message, length;
    uint8_t payload[ROOM(rx_payload) > ROOM(tx_payload) ? ROOM(rx_payload) : ROOM(tx_payload)];
} replay_event;

int board_call(int operation, volatile void *argument);
int main(void);
void replay_begin(void);
void replay_end(void);

#define PAINT 0xA5A5A5A5u
#define INLINE __attribute__((always_inline)) static inline

void *memcpy(void *to, const void *from, size_t n);

extern uint32_t board_stack_low;

static canroll_ecu ecu;
static canroll_calibration calibration;

/* An instruction counter watches these two. */
__attribute__((noinline)) void replay_begin(void) { __asm__ volatile("" ::: "memory"); }
__attribute__((noinline)) void replay_end(void) { __asm__ volatile("" ::: "memory"); }

static uint32_t *stack_pointer(void)
{
    uint32_t *top;
    __asm__ volatile("mov %0, sp" : "=r"(top));
    return top;
}

static int open_file(const char *name, uint32_t length, uint32_t mode)
{
    volatile uint32_t block[3] = { (uint32_t)name, mode, length };
    return board_call(1, block);
}

static int transfer(int operation, int file, const void *data, uint32_t size)
{
    volatile uint32_t block[3] = { (uint32_t)file, (uint32_t)data, size };
    return board_call(operation, block);
}

/* On a bus with authenticated frames each part of a tick is counted by itself, in this order: what
   is done once, for each frame received, the loop, and for each frame sent. */
#if __has_include("canroll_secoc.h")
#include "canroll_secoc.h"

static canroll_secoc replay_secoc;

static int replay_start(int in)
{
    struct {
        uint8_t key[16];
        int32_t listening;
    } secret;
    if (transfer(6, in, &secret, sizeof secret)) {
        return 1;
    }
    canroll_secoc_start(&replay_secoc, secret.key, 1, secret.listening);
    return 0;
}

INLINE void replay_elapse(int32_t elapsed)
{
    replay_begin();
    canroll_secoc_elapse(&replay_secoc, elapsed);
    replay_end();
}

INLINE int replay_verify(const replay_event *event)
{
    int32_t taken;
    replay_begin();
    taken = canroll_secoc_verify(&replay_secoc, event->message, event->payload, event->length);
    replay_end();
    return taken == 1 || event->message >= CANROLL_N_FRAMES;
}

/* A copy is protected, so that the record stays what the loop made it. */
INLINE void replay_protect(int32_t slot, replay_event *copy)
{
    if (canroll_signals_tx_lengths[slot] == 0u) {
        return;
    }
    memcpy(copy->payload, ecu.tx_payload[slot], sizeof ecu.tx_payload[slot]);
    replay_begin();
    canroll_secoc_protect(&replay_secoc, slot, copy->payload);
    replay_end();
}
#else
INLINE int replay_start(int in) { (void)in; return 0; }
INLINE void replay_elapse(int32_t elapsed) { (void)elapsed; }
INLINE int replay_verify(const replay_event *event) { (void)event; return 1; }
INLINE void replay_protect(int32_t slot, replay_event *copy) { (void)slot; (void)copy; }
#endif

int main(void)
{
    int32_t ticks = 0, elapsed = 0;
    uint32_t depth = 0;
    replay_event event;
    int in = open_file("replay.in", 9, 1);
    int out = open_file("replay.out", 10, 5);
    if (in < 0 || out < 0) {
        return 2;
    }
    if (transfer(6, in, &ticks, sizeof ticks) || transfer(6, in, &calibration, sizeof calibration)) {
        return 3;
    }
    if (canroll_init(&ecu, &calibration) != 0 || replay_start(in)) {
        return 4;
    }
    for (int32_t t = 0; t < ticks; t++) {
        uint32_t used, *low;
        int32_t frames = 0;
        if (transfer(6, in, &elapsed, sizeof elapsed) || transfer(6, in, &frames, sizeof frames)) {
            return 5;
        }
        for (low = &board_stack_low; low < stack_pointer(); low++) {
            *low = PAINT;
        }
        replay_elapse(elapsed);
        for (; frames > 0; frames--) {
            if (transfer(6, in, &event, sizeof event)) {
                return 6;
            }
            if (replay_verify(&event)) {
                canroll_receive(&ecu, event.message, event.payload, event.length);
            }
        }
        replay_begin();
        canroll_tick(&ecu, &calibration, elapsed);
        replay_end();
        if (transfer(5, out, &ecu, sizeof ecu)) {
            return 7;
        }
        for (int32_t slot = 0; slot < CANROLL_N_TX; slot++) {
            if (ecu.tx_pending[slot] == 1) {
                replay_protect(slot, &event);
            }
            ecu.tx_pending[slot] = 0;
        }
        for (low = &board_stack_low; *low == PAINT; low++) {
        }
        used = (uint32_t)stack_pointer() - (uint32_t)low;
        depth = (used > depth) ? used : depth;
    }
    out = open_file("replay.stack", 12, 5);
    if (out < 0 || transfer(5, out, &depth, sizeof depth)) {
        return 8;
    }
    return 0;
}
