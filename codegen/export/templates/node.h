/* What every board does around the loop, once a period: take the frames received, run the loop, send
   its frames. The board gives the three functions of its drivers; defaults of node.c are a silent bus. */
#ifndef NODE_H
#define NODE_H

#include <stdint.h>

#define NODE_BYTES {bytes}
/* Bit of an identifier: it has 29 bits. */
#define NODE_EXTENDED 0x40000000u

/* Start; 0, or the rule by which the calibration is refused: then there must be no node_tick. */
int32_t node_start(void);
/* Run a period, with the number of periods gone by since the last. */
void node_tick(int32_t elapsed);
/* Microseconds of a period, and periods since the start. */
int32_t node_period_us(void);
int32_t node_time(void);

/* To be given by the board: the next frame of its driver's queue, 1 where there is one. */
int node_next(uint32_t *identifier, uint8_t payload[NODE_BYTES], int32_t *length);
/* Queue a frame; fd: 0 classic, 1 CAN FD, 3 CAN FD with bit-rate switch. */
void node_send(uint32_t identifier, const uint8_t *payload, int32_t length, int32_t fd);
/* The loop has run to its end: trigger the watchdog here. Called once for each node_tick that did. */
void node_alive(void);

#endif
