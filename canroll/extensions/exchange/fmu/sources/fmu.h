/* What an FMU's model gives to fmu.c, which answers the functions of FMI 3.0 for it.
 *
 * model.h defines `model`, a record without pointers: its copy is the FMU's state. It also defines
 * FMU_PORTS, the number of CAN terminals, FMU_BUFFER, the room of a terminal's operations in
 * bytes, and FMU_TOKEN. Instants are nanoseconds. */
#ifndef FMU_H
#define FMU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "model.h"

enum { FMU_TIME, FMU_FLOAT64, FMU_INT32, FMU_UINT8, FMU_INT64, FMU_BOOLEAN,
       FMU_RX_CLOCK, FMU_RX_DATA, FMU_TX_CLOCK, FMU_TX_DATA };
enum { FMU_READ, FMU_PARAMETER, FMU_INPUT };

/* A variable; its value reference is its place in the table. Of a terminal, `offset` is its number,
 * of all others the place in the model. */
typedef struct {
    uint8_t type, access;
    uint32_t count;
    size_t offset;
} fmu_variable;

extern const fmu_variable fmu_variables[];
extern const size_t fmu_variable_count;

/* Bus operations on their way through a terminal. */
typedef struct {
    uint32_t size;
    uint8_t data[FMU_BUFFER];
} fmu_buffer;

/* Why a call failed, for the importer's log. */
typedef struct {
    char text[200];
} fmu_reason;

/* Fill a zeroed model with the start values of its variables. */
void model_defaults(model *m);
/* Start at `now_ns` with the parameters set; `tx` has FMU_PORTS buffers. */
bool model_start(model *m, int64_t now_ns, fmu_reason *why);
/* Advance to `until_ns`. What is due at that very instant may wait for what is received then. `tx`
 * is NULL where the importer uses no events, so that nobody could take what is sent. */
bool model_advance(model *m, fmu_buffer *tx, int64_t until_ns, fmu_reason *why);
/* Take one bus operation received at `now_ns`. */
bool model_receive(model *m, fmu_buffer *tx, size_t port, const uint8_t *operation, uint32_t size,
                   int64_t now_ns, fmu_reason *why);
/* The next instant after `now_ns` at which a Tx clock that counts down ticks; negative: none is
 * known. All that is received at `now_ns` has been: what follows from it may be begun. */
int64_t model_next(model *m, fmu_buffer *tx, size_t port, int64_t now_ns);
/* The period of the Tx clock and its shift; 0: the clock counts down from event to event. */
int64_t model_period_ns(const model *m);
int64_t model_shift_ns(const model *m);

#endif
