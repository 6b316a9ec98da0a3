/* Runs a session and compares every byte with what the reference gave. On a host it prints the
   verdict; on a bare target the exit code is the verdict. */
#include "session.h"

#if __STDC_HOSTED__
#include <stdio.h>
#endif

#define NUMBERS 4

int main(void);

static int32_t number(const uint8_t **at)
{
    uint32_t value = 0u, byte;
    unsigned int shift = 0u;
    do {
        byte = *(*at)++;
        value |= (byte & 127u) << shift;
        shift += 7u;
    } while ((byte & 128u) != 0u);
    return (int32_t)value;
}

static int failed(
    const session_part *part, long step, const session_operation *operation, size_t byte, int other)
{
#if __STDC_HOSTED__
    printf("FAIL: %s, step %ld: %s: byte %lu is %d, not %d\n", part->name, step, operation->name,
        (unsigned long)byte, (int)session_actual[byte], other);
#else
    (void)part;
    (void)step;
    (void)operation;
    (void)byte;
    (void)other;
#endif
    return 1;
}

int main(void)
{
    for (size_t number_of = 0u; number_of < session_count; number_of++) {
        const session_part *part = &session_parts[number_of];
        const uint8_t *at = part->steps;
        for (long step = 0; at < part->steps + part->size; step++) {
            int32_t numbers[NUMBERS] = { 0 };
            const int32_t code = *at++;
            const session_operation *operation = &session_operations[code];
            for (size_t k = 0u; k < operation->numbers; k++) {
                numbers[k] = number(&at);
            }
            session_run(code, numbers, at);
            at += operation->array;
            for (size_t k = 0u; k < operation->expected; k++) {
                if (session_actual[k] != *at) {
                    return failed(part, step, operation, k, *at);
                }
                at++;
            }
        }
    }
#if __STDC_HOSTED__
    printf("PASS: %s\n", session_verdict);
#endif
    return 0;
}
