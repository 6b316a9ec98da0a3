/* The least that the example needs, for a Cortex-M: no heap, all memory is static. */
#ifndef FREERTOS_CONFIG_H
#define FREERTOS_CONFIG_H

void board_exit(int code);

#define configCPU_CLOCK_HZ 25000000u
/* the period of the controller, {tick_us} us, is a multiple of this */
#define configTICK_RATE_HZ {rate}u
#define configTICK_TYPE_WIDTH_IN_BITS TICK_TYPE_WIDTH_32_BITS
#define configUSE_PREEMPTION 1
#define configMAX_PRIORITIES 4
#define configMINIMAL_STACK_SIZE 128
#define configSUPPORT_STATIC_ALLOCATION 1
#define configSUPPORT_DYNAMIC_ALLOCATION 0
#define configKERNEL_PROVIDED_STATIC_MEMORY 1
#define configUSE_IDLE_HOOK 0
#define configUSE_TICK_HOOK 0
#define configCHECK_FOR_STACK_OVERFLOW 0
#define configKERNEL_INTERRUPT_PRIORITY 255
#define configMAX_SYSCALL_INTERRUPT_PRIORITY 0xA0
#define configASSERT(holds) if (!(holds)) { board_exit(2); }
#define INCLUDE_xTaskDelayUntil 1

/* the names in the vector table of board/startup.c */
#define vPortSVCHandler board_svc
#define xPortPendSVHandler board_pendsv
#define xPortSysTickHandler board_systick

#endif
