/* A session: steps, each a call of the firmware or a comparison, and what the reference gave. The
   runner is test_session.c. */
#ifndef SESSION_H
#define SESSION_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "canroll.h"

/* In the data of a step its operation is followed by so many numbers (LEB128: seven bits a byte,
   the lowest first, the eighth bit set but in the last), by the bytes that it is given and by those
   that are expected. */
typedef struct {
    const char *name;
    uint16_t numbers, array, expected;
} session_operation;

typedef struct {
    const char *name;
    const uint8_t *steps;
    size_t size;
} session_part;

extern const session_operation session_operations[];
extern const session_part session_parts[];
extern const size_t session_count;
extern uint8_t session_actual[];
extern const char session_verdict[];

void session_run(int32_t operation, const int32_t *n, const uint8_t *array);

static inline int session_big_endian(void)
{
    const uint16_t one = 1u;
    return *(const uint8_t *)&one == 0u;
}

/* Where a record has the byte that a little-endian machine has at a place: on a big-endian machine
   the bytes of each word have the opposite order. ends are those of stretches of words and of
   bytes in turn, the first of words. */
static inline size_t session_place(const size_t *ends, size_t at)
{
    size_t stretch = 0u;
    while (at >= ends[stretch]) {
        stretch++;
    }
    return ((stretch & 1u) == 0u && session_big_endian()) ? (at ^ 3u) : at;
}

static inline void session_copy(uint8_t *to, const uint8_t *from, size_t bytes)
{
    memcpy(to, from, bytes);
}

static inline void session_number(uint8_t *to, int32_t value)
{
    for (size_t k = 0u; k < 4u; k++) {
        to[k] = (uint8_t)(((uint32_t)value >> (8u * k)) & 255u);
    }
}

/* A word of the memory, the lowest byte first. */
static inline void session_memory(uint8_t *to, const uint8_t *from, size_t bytes)
{
    for (size_t k = 0u; k < bytes; k++) {
        to[k] = from[session_big_endian() ? (bytes - 1u - k) : k];
    }
}

static inline void session_fill(
    void *record, const size_t *ends, const uint8_t *data, size_t bytes)
{
    for (size_t k = 0u; k < bytes; k++) {
        ((uint8_t *)record)[session_place(ends, k)] = data[k];
    }
}

static inline void session_flip(void *record, const size_t *ends, int32_t at, int32_t bits)
{
    uint8_t *byte = &((uint8_t *)record)[session_place(ends, (size_t)at)];
    *byte = (uint8_t)(*byte ^ (uint8_t)bits);
}

/* CRC-32 of a record. */
static inline void session_digest(
    uint8_t *to, const void *record, const size_t *ends, size_t bytes)
{
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t k = 0u; k < bytes; k++) {
        crc ^= ((const uint8_t *)record)[session_place(ends, k)];
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc >> 1) ^ (0xEDB88320u & (0u - (crc & 1u)));
        }
    }
    session_number(to, (int32_t)~crc);
}

#endif
