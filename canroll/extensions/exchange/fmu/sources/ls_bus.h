/* CAN frames as bus operations of fmi-ls-bus 1.0 (low cut); numbers are little-endian. */
#ifndef LS_BUS_H
#define LS_BUS_H

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "fmu.h"

enum { LS_FORMAT_ERROR = 0x01, LS_CAN = 0x10, LS_CAN_FD = 0x11, LS_CONFIRM = 0x20,
       LS_BUS_ERROR = 0x31, LS_CONFIGURATION = 0x40, LS_STATUS = 0x41, LS_WAKE_UP = 0x42 };
enum { LS_HEAD = 8, LS_CAN_HEAD = 16, LS_CAN_FD_HEAD = 17 };

/* A frame; `fd` 0 is a classic one. */
typedef struct {
    uint32_t ident;
    uint8_t extended, remote, fd, switched, error_state, length;
    uint8_t data[64];
} ls_frame;

static inline uint32_t ls_number(const uint8_t *at, int bytes)
{
    uint32_t value = 0;
    for (int k = bytes - 1; k >= 0; k--) {
        value = value << 8 | at[k];
    }
    return value;
}

static inline uint8_t *ls_put(uint8_t *at, uint32_t value, int bytes)
{
    for (int k = 0; k < bytes; k++) {
        *at++ = (uint8_t)(value >> 8 * k);
    }
    return at;
}

/* Room for an operation of `size` bytes, its head written; NULL if the buffer is full. */
static inline uint8_t *ls_open(fmu_buffer *buffer, uint32_t code, uint32_t size)
{
    if (size > FMU_BUFFER - buffer->size) {
        return NULL;
    }
    uint8_t *at = buffer->data + buffer->size;
    buffer->size += size;
    return ls_put(ls_put(at, code, 4), size, 4);
}

static inline bool ls_transmit(fmu_buffer *buffer, const ls_frame *frame)
{
    uint32_t head = frame->fd ? LS_CAN_FD_HEAD : LS_CAN_HEAD;
    uint32_t held = frame->remote ? 0 : frame->length;
    uint8_t *at = ls_open(buffer, frame->fd ? LS_CAN_FD : LS_CAN, head + held);
    if (at == NULL) {
        return false;
    }
    at = ls_put(at, frame->ident, 4);
    *at++ = frame->extended;
    if (frame->fd) {
        *at++ = frame->switched;
        *at++ = frame->error_state;
    } else {
        *at++ = frame->remote;
    }
    at = ls_put(at, frame->length, 2);
    memcpy(at, frame->data, held);
    return true;
}

static inline bool ls_confirm(fmu_buffer *buffer, uint32_t ident)
{
    uint8_t *at = ls_open(buffer, LS_CONFIRM, LS_HEAD + 4);
    if (at == NULL) {
        return false;
    }
    ls_put(at, ident, 4);
    return true;
}

/* Read a transmit operation; false if it is none, or its lengths contradict each other. */
static inline bool ls_read(const uint8_t *operation, uint32_t size, ls_frame *frame)
{
    uint32_t code = ls_number(operation, 4);
    uint32_t head = code == LS_CAN_FD ? LS_CAN_FD_HEAD : LS_CAN_HEAD;
    if ((code != LS_CAN && code != LS_CAN_FD) || size < head) {
        return false;
    }
    const uint8_t *at = operation + LS_HEAD;
    memset(frame, 0, sizeof *frame);
    frame->fd = code == LS_CAN_FD;
    frame->ident = ls_number(at, 4);
    frame->extended = at[4] != 0;
    if (frame->fd) {
        frame->switched = at[5] != 0;
        frame->error_state = at[6] != 0;
    } else {
        frame->remote = at[5] != 0;
    }
    uint32_t length = ls_number(operation + head - 2, 2);
    uint32_t held = frame->remote ? 0 : length;
    if (length > (frame->fd ? 64u : 8u) || head + held > size
        || frame->ident >= (frame->extended ? 1u << 29 : 1u << 11)) {
        return false;
    }
    frame->length = (uint8_t)length;
    memcpy(frame->data, operation + head, held);
    return true;
}

#endif
