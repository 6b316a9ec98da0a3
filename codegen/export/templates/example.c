/* How a bare board runs the controller: SysTick counts the periods, the loop runs in the background.
   As it stands the controller meets a silent bus and stays in INIT, which lets this run on any
   Cortex-M and in an emulator; see node.h for what your drivers give. */
#include "node.h"

#define CLOCK_HZ 25000000u
#define SYSTICK ((volatile uint32_t *)0xE000E010u)

int main(void);
void board_systick(void);

static volatile uint32_t periods;

void board_systick(void)
{
    periods = periods + 1u;
}

int main(void)
{
    uint32_t done = 0;
    if (node_start() != 0) {
        return 1;
    }
    SYSTICK[1] = (uint32_t)node_period_us() * (CLOCK_HZ / 1000000u) - 1u;
    SYSTICK[2] = 0;
    SYSTICK[0] = 7u;
    while (node_time() < 20) { /* a product runs for ever; the example ends, so that it can be tested */
        const uint32_t now = periods;
        if (now != done) {
            node_tick((int32_t)(now - done));
            done = now;
        }
    }
    return 0;
}
