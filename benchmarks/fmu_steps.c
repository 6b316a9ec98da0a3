/* An importer in C, so that what is timed is the FMU and not its caller. */
#include <dlfcn.h>
#include <stdint.h>
#include <string.h>
#include <time.h>

#include "fmi3FunctionTypes.h"

typedef struct {
    uint32_t rx_clock, rx_data, tx_clock, tx_data;
} terminal;

/* Of this thread's processor time, so that what else runs does not count. */
static double seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void quiet(fmi3InstanceEnvironment e, fmi3Status s, fmi3String c, fmi3String m)
{
    (void)e, (void)s, (void)c, (void)m;
}

#define FUNCTION(name) fmi3##name##TYPE *name = (fmi3##name##TYPE *)dlsym(library, "fmi3" #name)

static fmi3Instance started(void *library, const char *token, fmi3Boolean events)
{
    FUNCTION(InstantiateCoSimulation);
    FUNCTION(EnterInitializationMode);
    FUNCTION(ExitInitializationMode);
    fmi3Instance its = InstantiateCoSimulation("its", token, "", fmi3False, fmi3False, events,
                                               fmi3False, NULL, 0, NULL, quiet, NULL);
    EnterInitializationMode(its, fmi3False, 0.0, 0.0, fmi3False, 0.0);
    ExitInitializationMode(its);
    return its;
}

/* Seconds of `steps` steps of `step` s. */
double fmu_steps(const char *path, const char *token, int64_t steps, double step)
{
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    FUNCTION(DoStep);
    FUNCTION(FreeInstance);
    fmi3Instance its = started(library, token, fmi3False);
    fmi3Boolean a, b, c;
    double last, begin = seconds();
    for (int64_t k = 0; k < steps; k++) {
        if (DoStep(its, (double)k * step, step, fmi3True, &a, &b, &c, &last) != fmi3OK) {
            return -1;
        }
    }
    double end = seconds();
    FreeInstance(its);
    return end - begin;
}

/* Seconds of `ticks` ticks in event mode. `received` are the bus operations of every tick, those of
 * tick k from at[k] to at[k + 1]; what is sent goes to `sent`, up to sent_at[k + 1]. */
double fmu_ticks(const char *path, const char *token, const terminal *port, int64_t ticks,
                 double tick, double run_time, const uint8_t *received, const int64_t *at,
                 uint8_t *sent, int64_t *sent_at)
{
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    FUNCTION(DoStep);
    FUNCTION(EnterEventMode);
    FUNCTION(EnterStepMode);
    FUNCTION(UpdateDiscreteStates);
    FUNCTION(SetClock);
    FUNCTION(SetBinary);
    FUNCTION(GetBinary);
    FUNCTION(FreeInstance);
    fmi3Instance its = started(library, token, fmi3True);
    fmi3Boolean a, b, c, d, e;
    const fmi3Clock on = fmi3ClockActive;
    double next, last, now = 0.0, begin = seconds();
    sent_at[0] = 0;
    UpdateDiscreteStates(its, &a, &b, &c, &d, &e, &next);
    EnterStepMode(its);
    for (int64_t k = 0; k < ticks; k++) {
        double due = (double)(k + 1) * tick;
        DoStep(its, now, due - now, fmi3True, &a, &b, &c, &last);
        EnterEventMode(its);
        size_t size = (size_t)(at[k + 1] - at[k]);
        const uint8_t *data = received + at[k];
        if (size > 0) {
            SetClock(its, &port->rx_clock, 1, &on);
            SetBinary(its, &port->rx_data, 1, &size, &data, 1);
        }
        UpdateDiscreteStates(its, &a, &b, &c, &d, &e, &next);
        EnterStepMode(its);
        now = due + run_time;
        DoStep(its, due, now - due, fmi3True, &a, &b, &c, &last);
        EnterEventMode(its);
        const uint8_t *out = NULL;
        SetClock(its, &port->tx_clock, 1, &on);
        GetBinary(its, &port->tx_data, 1, &size, &out, 1);
        memcpy(sent + sent_at[k], out, size);
        sent_at[k + 1] = sent_at[k] + (int64_t)size;
        UpdateDiscreteStates(its, &a, &b, &c, &d, &e, &next);
        if (EnterStepMode(its) != fmi3OK) {
            return -1;
        }
    }
    double end = seconds();
    FreeInstance(its);
    return end - begin;
}
