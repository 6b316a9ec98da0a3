/* Start-up of a bare Cortex-M: vector table, .data and .bss, main, exit through semihosting. */
#include <stddef.h>
#include <stdint.h>

extern uint32_t board_data_start, board_data_end, board_data_load;
extern uint32_t board_bss_start, board_bss_end, board_stack_top;

int main(void);
int board_call(int operation, volatile void *argument);
void board_exit(int code);
void board_reset(void);
void board_fault(void);
/* An operating system, or an example, has these of its own. */
void board_svc(void) __attribute__((weak, alias("board_fault")));
void board_pendsv(void) __attribute__((weak, alias("board_fault")));
void board_systick(void) __attribute__((weak, alias("board_fault")));

/* The debugger or emulator carries out the operation; without one this faults. */
__attribute__((naked, noinline)) int board_call(int operation __attribute__((unused)),
    volatile void *argument __attribute__((unused)))
{
    __asm__ volatile("bkpt 0xab\n bx lr");
}

__attribute__((noreturn)) void board_exit(int code)
{
    volatile uint32_t block[2] = { 0x20026u, (uint32_t)code };
    (void)board_call(0x20, block);
    for (;;) {
    }
}

__attribute__((noreturn)) void board_reset(void)
{
    uint32_t *to = &board_data_start;
    const uint32_t *from = &board_data_load;
    while (to < &board_data_end) {
        *to++ = *from++;
    }
    for (to = &board_bss_start; to < &board_bss_end;) {
        *to++ = 0;
    }
    board_exit(main());
}

void board_fault(void)
{
    board_exit(99);
}

__attribute__((section(".vectors"), used)) static void (*const board_vectors[16])(void) = {
    (void (*)(void))&board_stack_top, board_reset, board_fault, board_fault, board_fault,
    board_fault, board_fault, 0, 0, 0, 0, board_svc, board_fault, 0, board_pendsv, board_systick
};

/* Compilers turn loops into these calls even where no library is linked. */
void *memcpy(void *to, const void *from, size_t n);
void *memmove(void *to, const void *from, size_t n);
void *memset(void *to, int value, size_t n);

__attribute__((optimize("no-tree-loop-distribute-patterns")))
void *memcpy(void *to, const void *from, size_t n)
{
    char *a = to;
    const char *b = from;
    while (n-- > 0) {
        *a++ = *b++;
    }
    return to;
}

__attribute__((optimize("no-tree-loop-distribute-patterns")))
void *memmove(void *to, const void *from, size_t n)
{
    char *a = to;
    const char *b = from;
    if (a > b) {
        while (n-- > 0) {
            a[n] = b[n];
        }
        return to;
    }
    return memcpy(to, from, n);
}

__attribute__((optimize("no-tree-loop-distribute-patterns")))
void *memset(void *to, int value, size_t n)
{
    char *a = to;
    while (n-- > 0) {
        *a++ = (char)value;
    }
    return to;
}
