/* The controller as a task of FreeRTOS; see board/node.h for what your drivers give. */
#include "FreeRTOS.h"
#include "task.h"

#include "node.h"

#define STACK_WORDS 256

int main(void);
void board_exit(int code);

static StaticTask_t task;
static StackType_t stack[STACK_WORDS];

/* Each period once, at its time; what another task held up is made up for in one step. */
static void control(void *unused)
{
    const TickType_t period =
        (TickType_t)(((uint64_t)node_period_us() * configTICK_RATE_HZ) / 1000000u);
    TickType_t due = xTaskGetTickCount();
    (void)unused;
    while (node_time() < 20) { /* a product runs for ever; this ends, so that it can be tested */
        (void)xTaskDelayUntil(&due, period);
        const TickType_t missed = (xTaskGetTickCount() - due) / period;
        due += missed * period;
        node_tick(1 + (int32_t)missed);
    }
    board_exit(0);
}

int main(void)
{
    if (node_start() != 0) {
        return 1;
    }
    (void)xTaskCreateStatic(control, "roll", STACK_WORDS, NULL, configMAX_PRIORITIES - 1, stack, &task);
    vTaskStartScheduler();
    return 1;
}
