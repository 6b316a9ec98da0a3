/* Replays traffic from a file of the host (semihosting) and writes what the ECU did to another. */
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
    if (canroll_init(&ecu, &calibration) != 0) {
        return 4;
    }
    for (int32_t t = 0; t < ticks; t++) {
        uint32_t used, *low;
        int32_t frames = 0;
        if (transfer(6, in, &elapsed, sizeof elapsed) || transfer(6, in, &frames, sizeof frames)) {
            return 5;
        }
        for (; frames > 0; frames--) {
            if (transfer(6, in, &event, sizeof event)) {
                return 6;
            }
            canroll_receive(&ecu, event.message, event.payload, event.length);
        }
        for (low = &board_stack_low; low < stack_pointer(); low++) {
            *low = PAINT;
        }
        replay_begin();
        canroll_tick(&ecu, &calibration, elapsed);
        replay_end();
        for (low = &board_stack_low; *low == PAINT; low++) {
        }
        used = (uint32_t)stack_pointer() - (uint32_t)low;
        depth = (used > depth) ? used : depth;
        if (transfer(5, out, &ecu, sizeof ecu)) {
            return 7;
        }
        for (int32_t slot = 0; slot < CANROLL_N_TX; slot++) {
            ecu.tx_pending[slot] = 0;
        }
    }
    out = open_file("replay.stack", 12, 5);
    if (out < 0 || transfer(5, out, &depth, sizeof depth)) {
        return 8;
    }
    return 0;
}
