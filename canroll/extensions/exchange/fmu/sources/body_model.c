/* A vehicle alone as a model: forces, steering and road in, its motion out, every millisecond. */
#include <stdio.h>

#include "fmu.h"

#define STEP_NS 1000000

void model_defaults(model *m)
{
    body_image(&m->vehicle);
}

bool model_start(model *m, int64_t now_ns, fmu_reason *why)
{
    if (now_ns != 0) {
        snprintf(why->text, sizeof why->text, "the vehicle starts at time 0");
        return false;
    }
    body_step(m->vehicle.state, m->vehicle.inputs, m->vehicle.parameters, m->vehicle.outputs, 0.0);
    return true;
}

bool model_advance(model *m, fmu_buffer *tx, int64_t until_ns, fmu_reason *why)
{
    (void)tx, (void)why;
    for (; m->time_ns + STEP_NS <= until_ns; m->time_ns += STEP_NS) {
        body_step(m->vehicle.state, m->vehicle.inputs, m->vehicle.parameters, m->vehicle.outputs,
                  1e-3);
    }
    return true;
}

bool model_receive(model *m, fmu_buffer *tx, size_t port, const uint8_t *operation, uint32_t size,
                   int64_t now_ns, fmu_reason *why)
{
    (void)m, (void)tx, (void)port, (void)operation, (void)size, (void)now_ns, (void)why;
    return false;
}

int64_t model_next(model *m, fmu_buffer *tx, size_t port, int64_t now_ns)
{
    (void)m, (void)tx, (void)port, (void)now_ns;
    return -1;
}

int64_t model_period_ns(const model *m)
{
    (void)m;
    return 0;
}

int64_t model_shift_ns(const model *m)
{
    (void)m;
    return 0;
}
