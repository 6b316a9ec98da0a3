/* The vehicle with its driver, actuators and sensors as an FMU. It moves in steps of 1 ms.
 *
 * A step follows from what is known at its beginning, and says what frames are sent until its end:
 * so it is computed as soon as time can pass beyond its beginning, and shown when it has passed. */
#include <stdio.h>
#include <string.h>

#include "fmu.h"
#if FMU_PORTS > 0
#include "ls_bus.h"
#endif

#define STEP_NS 1000000

enum { SENSORS, ACTUATOR };
enum { EXTENDED = 1, REMOTE = 2, FD = 4, BIT_RATE_SWITCH = 8 };

void model_defaults(model *m)
{
    model_image(&m->plant);
    memcpy(m->shown.values, plant_start, sizeof m->shown.values);
}

bool model_start(model *m, int64_t now_ns, fmu_reason *why)
{
    (void)m;
    if (now_ns != 0) {
        snprintf(why->text, sizeof why->text, "the manoeuvre starts at time 0");
        return false;
    }
    return true;
}

static void show(model *m)
{
    plant_record(&m->plant, &m->shown);
}

/* Compute the steps that begin up to `now_ns`; those that have ended are shown. */
static void move(model *m, int64_t now_ns)
{
    while (m->plant.clock.plant_ns <= now_ns) {
        if (m->plant.clock.plant_ns > 0) {
            show(m);
        }
#if FMU_PORTS == 0
        plant_command(&m->plant, PLANT_COMMAND, m->demands, PLANT_CHANNELS,
                      m->plant.clock.plant_ns);
#endif
        plant_advance(&m->plant);
#if FMU_PORTS == 0
        m->plant.queue.count = 0;
#endif
    }
}

#if FMU_PORTS > 0
static bool send(model *m, fmu_buffer *tx, int64_t until_ns, fmu_reason *why)
{
    plant_queue *queue = &m->plant.queue;
    while (queue->count > 0 && queue->entries[0].t_ns <= until_ns) {
        const plant_entries *next = &queue->entries[0];
        ls_frame frame = { .ident = (uint32_t)next->ident,
                           .extended = (next->flags & EXTENDED) != 0,
                           .fd = (next->flags & FD) != 0,
                           .switched = (next->flags & BIT_RATE_SWITCH) != 0,
                           .length = (uint8_t)next->length };
        memcpy(frame.data, next->payload, sizeof frame.data);
        int port = next->node == PLANT_ACTUATOR ? ACTUATOR : SENSORS;
        if (tx != NULL && !ls_transmit(&tx[port], &frame)) {
            snprintf(why->text, sizeof why->text, "more frames in one step than there is room for");
            return false;
        }
        plant_take(queue);
    }
    return true;
}

bool model_advance(model *m, fmu_buffer *tx, int64_t until_ns, fmu_reason *why)
{
    for (size_t port = 0; port < FMU_PORTS && tx != NULL; port++) {
        tx[port].size = 0; /* nobody listens where it was not taken before this step */
    }
    while (m->plant.clock.plant_ns < until_ns) {
        int64_t now_ns = m->plant.clock.plant_ns;
        move(m, now_ns);
        if (!send(m, tx, now_ns < until_ns - STEP_NS ? now_ns + STEP_NS : until_ns, why)) {
            return false;
        }
    }
    if (m->plant.clock.plant_ns == until_ns) {
        show(m);
    }
    return send(m, tx, until_ns, why);
}

bool model_receive(model *m, fmu_buffer *tx, size_t port, const uint8_t *operation, uint32_t size,
                   int64_t now_ns, fmu_reason *why)
{
    (void)tx;
    uint32_t code = ls_number(operation, 4);
    if (port != ACTUATOR || (code != LS_CAN && code != LS_CAN_FD)) {
        return true; /* sensors hear nothing, and nobody what buses report beside frames */
    }
    ls_frame frame;
    if (!ls_read(operation, size, &frame)) {
        snprintf(why->text, sizeof why->text, "a transmit operation with wrong lengths");
        return false;
    }
    int64_t flags = (frame.extended ? EXTENDED : 0) | (frame.remote ? REMOTE : 0)
        | (frame.fd ? FD : 0) | (frame.switched ? BIT_RATE_SWITCH : 0);
    int64_t key = frame.extended ? (int64_t)frame.ident | INT64_C(1) << 30 : frame.ident;
    plant_receive(&m->plant, key, flags, frame.length, frame.data, now_ns);
    return true;
}

int64_t model_next(model *m, fmu_buffer *tx, size_t port, int64_t now_ns)
{
    (void)tx, (void)port;
    move(m, now_ns);
    int64_t next = m->plant.clock.plant_ns;
    if (m->plant.queue.count > 0 && m->plant.queue.entries[0].t_ns < next) {
        next = m->plant.queue.entries[0].t_ns;
    }
    return next;
}
#else
bool model_advance(model *m, fmu_buffer *tx, int64_t until_ns, fmu_reason *why)
{
    (void)tx, (void)why;
    move(m, until_ns - 1);
    if (m->plant.clock.plant_ns == until_ns) {
        show(m);
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
#endif

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
