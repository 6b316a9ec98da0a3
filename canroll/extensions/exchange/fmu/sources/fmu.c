/* FMI 3.0 for Co-Simulation: variables from a table, the state as one record, clocks of terminals. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"
#include "fmu.h"

#define PORTS (FMU_PORTS > 0 ? FMU_PORTS : 1)
#define NANOSECONDS 1000000000

#define LATEST_S 9e9

typedef enum { INSTANTIATED, INITIALISATION, EVENT, STEP, TERMINATED } phase;

/* All that an FMU state holds. */
typedef struct {
    int64_t now_ns;
    uint32_t phase;
    uint8_t rx_active[PORTS], tx_active[PORTS];
    fmu_buffer rx[PORTS], tx[PORTS];
    model m;
} fmu_state;

typedef struct {
    fmu_state state;
    bool events;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} fmu_instance;

static fmi3Status failed(const fmu_instance *fmu, const char *format, ...)
{
    char text[320];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    if (fmu->log != NULL) {
        fmu->log(fmu->environment, fmi3Error, "logStatusError", text);
    }
    return fmi3Error;
}

#define IN(phase) (1u << (phase))
#define RUNNING (IN(EVENT) | IN(STEP))
#define SETTABLE (IN(INSTANTIATED) | IN(INITIALISATION) | RUNNING)

/* Whether a function may be called in the present phase, a bit of `phases`. Values are read in all
 * of them. */
static bool called_in(const fmu_instance *fmu, uint32_t phases, const char *function)
{
    static const char *const names[] = { "before initialization mode", "in initialization mode",
                                         "in event mode", "in step mode", "after termination" };
    if ((phases & IN(fmu->state.phase)) != 0u) {
        return true;
    }
    failed(fmu, "%s must not be called %s", function, names[fmu->state.phase]);
    return false;
}

/* Whether seconds are a number, and not too many for nanoseconds in 64 bits. */
static bool countable(fmi3Float64 seconds)
{
    return isfinite(seconds) && fabs(seconds) <= LATEST_S;
}

static int64_t nanoseconds(fmi3Float64 seconds)
{
    return (int64_t)llround(seconds * 1e9);
}

static void set_up(fmu_instance *fmu)
{
    memset(&fmu->state, 0, sizeof fmu->state);
    model_defaults(&fmu->state.m);
}

/* Life of an instance. */

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[])
{
    (void)instance, (void)loggingOn, (void)nCategories, (void)categories;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
    fmi3Boolean visible, fmi3Boolean loggingOn, fmi3Boolean eventModeUsed,
    fmi3Boolean earlyReturnAllowed, const fmi3ValueReference requiredIntermediateVariables[],
    size_t nRequiredIntermediateVariables, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage, fmi3IntermediateUpdateCallback intermediateUpdate)
{
    (void)instanceName, (void)resourcePath, (void)visible, (void)loggingOn;
    (void)earlyReturnAllowed, (void)requiredIntermediateVariables;
    (void)nRequiredIntermediateVariables, (void)intermediateUpdate;
    fmu_instance *fmu = calloc(1, sizeof *fmu);
    if (fmu == NULL) {
        return NULL;
    }
    fmu->environment = instanceEnvironment;
    fmu->log = logMessage;
    fmu->events = eventModeUsed;
    if (instantiationToken == NULL || strcmp(instantiationToken, FMU_TOKEN) != 0) {
        failed(fmu, "the instantiation token is not that of the model description");
        free(fmu);
        return NULL;
    }
    set_up(fmu);
    return fmu;
}

fmi3Instance fmi3InstantiateModelExchange(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
    fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage)
{
    (void)instanceName, (void)instantiationToken, (void)resourcePath, (void)visible;
    (void)loggingOn, (void)instanceEnvironment, (void)logMessage;
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
    fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage, fmi3ClockUpdateCallback clockUpdate,
    fmi3LockPreemptionCallback lockPreemption, fmi3UnlockPreemptionCallback unlockPreemption)
{
    (void)instanceName, (void)instantiationToken, (void)resourcePath, (void)visible;
    (void)loggingOn, (void)instanceEnvironment, (void)logMessage, (void)clockUpdate;
    (void)lockPreemption, (void)unlockPreemption;
    return NULL;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined,
                                       fmi3Float64 tolerance, fmi3Float64 startTime,
                                       fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    (void)toleranceDefined, (void)tolerance, (void)stopTimeDefined, (void)stopTime;
    fmu_instance *fmu = instance;
    if (!called_in(fmu, IN(INSTANTIATED), "fmi3EnterInitializationMode")) {
        return fmi3Error;
    }
    if (!countable(startTime)) {
        return failed(fmu, "a start at %g s: it must be a number up to %g", startTime, LATEST_S);
    }
    fmu->state.now_ns = nanoseconds(startTime);
    fmu->state.phase = INITIALISATION;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    fmu_instance *fmu = instance;
    fmu_state *s = &fmu->state;
    fmu_reason why = { "" };
    if (!called_in(fmu, IN(INITIALISATION), "fmi3ExitInitializationMode")) {
        return fmi3Error;
    }
    if (!model_start(&s->m, s->now_ns, &why)) {
        return failed(fmu, "%s", why.text);
    }
    s->phase = fmu->events ? EVENT : STEP;
    return fmi3OK;
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    fmu_instance *fmu = instance;
    if (!called_in(fmu, IN(STEP), "fmi3EnterEventMode")) {
        return fmi3Error;
    }
    if (!fmu->events) {
        return failed(fmu, "event mode was not asked for when the FMU was instantiated");
    }
    fmu->state.phase = EVENT;
    return fmi3OK;
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    fmu_instance *fmu = instance;
    fmu_state *s = &fmu->state;
    if (!called_in(fmu, IN(EVENT), "fmi3EnterStepMode")) {
        return fmi3Error;
    }
    for (size_t port = 0; port < FMU_PORTS; port++) {
        if (s->tx_active[port]) {
            s->tx[port].size = 0;
            s->tx_active[port] = 0;
        }
    }
    s->phase = STEP;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    fmu_instance *fmu = instance;
    if (!called_in(fmu, RUNNING, "fmi3Terminate")) {
        return fmi3Error;
    }
    fmu->state.phase = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    set_up(instance);
    return fmi3OK;
}

/* Steps and events. */

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint,
                      fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                      fmi3Boolean *eventHandlingNeeded, fmi3Boolean *terminateSimulation,
                      fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    fmu_instance *fmu = instance;
    fmu_state *s = &fmu->state;
    fmi3Float64 until = currentCommunicationPoint + communicationStepSize;
    fmu_reason why = { "" };
    *eventHandlingNeeded = *terminateSimulation = *earlyReturn = fmi3False;
    *lastSuccessfulTime = currentCommunicationPoint;
    if (!called_in(fmu, IN(STEP), "fmi3DoStep")) {
        return fmi3Error;
    }
    if (!countable(currentCommunicationPoint) || !countable(until)) {
        return failed(fmu, "a step from %g s of %g s: both must be numbers, the end up to %g s",
                      currentCommunicationPoint, communicationStepSize, LATEST_S);
    }
    int64_t from_ns = nanoseconds(currentCommunicationPoint);
    int64_t until_ns = nanoseconds(until);
    if (from_ns != s->now_ns || until_ns < from_ns) {
        return failed(fmu, "a step from %.9f s to %.9f s, but the time is %.9f s",
                      1e-9 * (double)from_ns, 1e-9 * (double)until_ns, 1e-9 * (double)s->now_ns);
    }
    bool done = model_advance(&s->m, fmu->events ? s->tx : NULL, until_ns, &why);
    s->now_ns = until_ns;
    if (!done) {
        return failed(fmu, "%s", why.text);
    }
    *lastSuccessfulTime = until;
    return fmi3OK;
}

static bool received(fmu_instance *fmu, size_t port)
{
    fmu_state *s = &fmu->state;
    const fmu_buffer *rx = &s->rx[port];
    uint32_t at = 0;
    fmu_reason why = { "" };
    while (at < rx->size) {
        const uint8_t *here = rx->data + at;
        uint32_t left = rx->size - at, size = 0;
        for (int k = 3; left >= 8 && k >= 0; k--) {
            size = size << 8 | here[4 + k];
        }
        if (size < 8 || size > left) {
            failed(fmu, "terminal %zu: byte %u of what it received begins no bus operation", port,
                   (unsigned)at);
            return false;
        }
        if (!model_receive(&s->m, s->tx, port, here, size, s->now_ns, &why)) {
            failed(fmu, "terminal %zu: %s", port, why.text);
            return false;
        }
        at += size;
    }
    return true;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation,
                                    fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged,
                                    fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime)
{
    fmu_instance *fmu = instance;
    fmu_state *s = &fmu->state;
    *discreteStatesNeedUpdate = *terminateSimulation = fmi3False;
    *nominalsOfContinuousStatesChanged = *valuesOfContinuousStatesChanged = fmi3False;
    *nextEventTimeDefined = fmi3False;
    *nextEventTime = 0.0;
    bool good = true;
    if (!called_in(fmu, IN(EVENT), "fmi3UpdateDiscreteStates")) {
        return fmi3Error;
    }
    for (size_t port = 0; port < FMU_PORTS; port++) {
        if (s->rx_active[port]) {
            good = received(fmu, port) && good;
            s->rx[port].size = 0;
            s->rx_active[port] = 0;
        }
    }
    return good ? fmi3OK : fmi3Error;
}

/* Variables. */

static const fmu_variable *variable(const fmu_instance *fmu, fmi3ValueReference reference,
                                    uint8_t type)
{
    if (reference < fmu_variable_count && fmu_variables[reference].type == type) {
        return &fmu_variables[reference];
    }
    failed(fmu, "no variable of this type has the value reference %u", (unsigned)reference);
    return NULL;
}

static fmi3Status get(fmu_instance *fmu, uint8_t type, size_t width,
                      const fmi3ValueReference references[], size_t n, void *values, size_t room)
{
    uint8_t *at = values;
    for (size_t k = 0; k < n; k++) {
        const fmu_variable *v = variable(fmu, references[k], type);
        if (v == NULL) {
            return fmi3Error;
        }
        if (v->count > room) {
            return failed(fmu, "fewer values than the variables have elements");
        }
        memcpy(at, (const uint8_t *)&fmu->state.m + v->offset, v->count * width);
        at += v->count * width;
        room -= v->count;
    }
    return room == 0 ? fmi3OK : failed(fmu, "more values than the variables have elements");
}

static fmi3Status set(fmu_instance *fmu, uint8_t type, size_t width,
                      const fmi3ValueReference references[], size_t n, const void *values,
                      size_t held)
{
    const uint8_t *at = values;
    if (!called_in(fmu, SETTABLE, "a function that sets values")) {
        return fmi3Error;
    }
    for (size_t k = 0; k < n; k++) {
        const fmu_variable *v = variable(fmu, references[k], type);
        if (v == NULL) {
            return fmi3Error;
        }
        if (v->access == FMU_READ || (v->access == FMU_PARAMETER && fmu->state.phase > INITIALISATION)) {
            return failed(fmu, "the variable with value reference %u cannot be set now",
                          (unsigned)references[k]);
        }
        if (v->count > held) {
            return failed(fmu, "fewer values than the variables have elements");
        }
        memcpy((uint8_t *)&fmu->state.m + v->offset, at, v->count * width);
        at += v->count * width;
        held -= v->count;
    }
    return held == 0 ? fmi3OK : failed(fmu, "more values than the variables have elements");
}

#define VARIABLES(name, type, code)                                                                \
    fmi3Status fmi3Get##name(fmi3Instance instance, const fmi3ValueReference valueReferences[],    \
                             size_t nValueReferences, type values[], size_t nValues)               \
    {                                                                                              \
        return get(instance, code, sizeof *values, valueReferences, nValueReferences, values,      \
                   nValues);                                                                       \
    }                                                                                              \
    fmi3Status fmi3Set##name(fmi3Instance instance, const fmi3ValueReference valueReferences[],    \
                             size_t nValueReferences, const type values[], size_t nValues)         \
    {                                                                                              \
        return set(instance, code, sizeof *values, valueReferences, nValueReferences, values,      \
                   nValues);                                                                       \
    }

#define NO_VARIABLES(name, type)                                                                   \
    fmi3Status fmi3Get##name(fmi3Instance instance, const fmi3ValueReference valueReferences[],    \
                             size_t nValueReferences, type values[], size_t nValues)               \
    {                                                                                              \
        (void)valueReferences, (void)values, (void)nValues;                                        \
        return nValueReferences == 0 ? fmi3OK : failed(instance, "no variable has the type " #name); \
    }                                                                                              \
    fmi3Status fmi3Set##name(fmi3Instance instance, const fmi3ValueReference valueReferences[],    \
                             size_t nValueReferences, const type values[], size_t nValues)         \
    {                                                                                              \
        (void)valueReferences, (void)values, (void)nValues;                                        \
        return nValueReferences == 0 ? fmi3OK : failed(instance, "no variable has the type " #name); \
    }

VARIABLES(Int32, fmi3Int32, FMU_INT32)
VARIABLES(UInt8, fmi3UInt8, FMU_UINT8)
VARIABLES(Int64, fmi3Int64, FMU_INT64)
VARIABLES(Boolean, fmi3Boolean, FMU_BOOLEAN)
NO_VARIABLES(Float32, fmi3Float32)
NO_VARIABLES(Int8, fmi3Int8)
NO_VARIABLES(Int16, fmi3Int16)
NO_VARIABLES(UInt16, fmi3UInt16)
NO_VARIABLES(UInt32, fmi3UInt32)
NO_VARIABLES(UInt64, fmi3UInt64)
NO_VARIABLES(String, fmi3String)

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                          size_t nValueReferences, fmi3Float64 values[], size_t nValues)
{
    fmu_instance *fmu = instance;
    for (size_t k = 0; k < nValueReferences; k++) {
        fmi3ValueReference reference = valueReferences[k];
        if (reference < fmu_variable_count && fmu_variables[reference].type == FMU_TIME) {
            if (nValues == 0) {
                return failed(fmu, "fewer values than the variables have elements");
            }
            *values++ = 1e-9 * (double)fmu->state.now_ns;
            nValues--;
            continue;
        }
        const fmu_variable *v = variable(fmu, reference, FMU_FLOAT64);
        size_t count = v == NULL ? 0 : v->count;
        if (v == NULL || count > nValues
            || get(fmu, FMU_FLOAT64, sizeof *values, &reference, 1, values, count) != fmi3OK) {
            return fmi3Error;
        }
        values += count;
        nValues -= count;
    }
    return nValues == 0 ? fmi3OK : failed(fmu, "more values than the variables have elements");
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                          size_t nValueReferences, const fmi3Float64 values[], size_t nValues)
{
    return set(instance, FMU_FLOAT64, sizeof *values, valueReferences, nValueReferences, values,
               nValues);
}

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                         size_t nValueReferences, size_t valueSizes[], fmi3Binary values[],
                         size_t nValues)
{
    fmu_instance *fmu = instance;
    fmu_state *s = &fmu->state;
    if (nValues != nValueReferences) {
        return failed(fmu, "as many binary values as variables are needed");
    }
    for (size_t k = 0; k < nValueReferences; k++) {
        const fmu_variable *v = variable(fmu, valueReferences[k], FMU_TX_DATA);
        if (v == NULL) {
            return fmi3Error;
        }
        valueSizes[k] = s->tx_active[v->offset] ? s->tx[v->offset].size : 0;
        values[k] = s->tx[v->offset].data;
    }
    return fmi3OK;
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                         size_t nValueReferences, const size_t valueSizes[],
                         const fmi3Binary values[], size_t nValues)
{
    fmu_instance *fmu = instance;
    if (!called_in(fmu, IN(EVENT), "fmi3SetBinary")) {
        return fmi3Error;
    }
    if (nValues != nValueReferences) {
        return failed(fmu, "as many binary values as variables are needed");
    }
    for (size_t k = 0; k < nValueReferences; k++) {
        const fmu_variable *v = variable(fmu, valueReferences[k], FMU_RX_DATA);
        if (v == NULL) {
            return fmi3Error;
        }
        if (valueSizes[k] > FMU_BUFFER) {
            return failed(fmu, "%zu bytes of bus operations at once, room is for %d", valueSizes[k],
                          FMU_BUFFER);
        }
        fmu_buffer *rx = &fmu->state.rx[v->offset];
        rx->size = (uint32_t)valueSizes[k];
        memcpy(rx->data, values[k], valueSizes[k]);
    }
    return fmi3OK;
}

/* Clocks. */

static uint8_t *clock_of(fmu_instance *fmu, fmi3ValueReference reference)
{
    if (reference < fmu_variable_count) {
        const fmu_variable *v = &fmu_variables[reference];
        if (v->type == FMU_RX_CLOCK) {
            return &fmu->state.rx_active[v->offset];
        }
        if (v->type == FMU_TX_CLOCK) {
            return &fmu->state.tx_active[v->offset];
        }
    }
    failed(fmu, "no clock has the value reference %u", (unsigned)reference);
    return NULL;
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                        size_t nValueReferences, fmi3Clock values[])
{
    for (size_t k = 0; k < nValueReferences; k++) {
        const uint8_t *active = clock_of(instance, valueReferences[k]);
        if (active == NULL) {
            return fmi3Error;
        }
        values[k] = *active != 0;
    }
    return fmi3OK;
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                        size_t nValueReferences, const fmi3Clock values[])
{
    fmu_instance *fmu = instance;
    if (!called_in(fmu, IN(EVENT), "fmi3SetClock")) {
        return fmi3Error;
    }
    for (size_t k = 0; k < nValueReferences; k++) {
        uint8_t *active = clock_of(fmu, valueReferences[k]);
        if (active == NULL) {
            return fmi3Error;
        }
        *active = values[k];
    }
    return fmi3OK;
}

/* Interval of a Tx clock in nanoseconds; false if no next tick is known. */
static bool interval_of(fmu_instance *fmu, fmi3ValueReference reference, int64_t *interval)
{
    const fmu_variable *v = variable(fmu, reference, FMU_TX_CLOCK);
    *interval = -1;
    if (v == NULL) {
        return false;
    }
    *interval = model_period_ns(&fmu->state.m);
    if (*interval == 0) {
        if (!called_in(fmu, RUNNING, "a function that gets intervals")) {
            return false;
        }
        int64_t next = model_next(&fmu->state.m, fmu->state.tx, v->offset, fmu->state.now_ns);
        *interval = next < 0 ? -1 : next - fmu->state.now_ns;
    }
    return true;
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance,
                                  const fmi3ValueReference valueReferences[],
                                  size_t nValueReferences, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[])
{
    for (size_t k = 0; k < nValueReferences; k++) {
        int64_t interval;
        if (!interval_of(instance, valueReferences[k], &interval)) {
            return fmi3Error;
        }
        intervals[k] = interval < 0 ? 0.0 : 1e-9 * (double)interval;
        qualifiers[k] = interval < 0 ? fmi3IntervalNotYetKnown : fmi3IntervalChanged;
    }
    return fmi3OK;
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance,
                                   const fmi3ValueReference valueReferences[],
                                   size_t nValueReferences, fmi3UInt64 counters[],
                                   fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
{
    for (size_t k = 0; k < nValueReferences; k++) {
        int64_t interval;
        if (!interval_of(instance, valueReferences[k], &interval)) {
            return fmi3Error;
        }
        counters[k] = interval < 0 ? 0 : (fmi3UInt64)interval;
        resolutions[k] = NANOSECONDS;
        qualifiers[k] = interval < 0 ? fmi3IntervalNotYetKnown : fmi3IntervalChanged;
    }
    return fmi3OK;
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                               size_t nValueReferences, fmi3Float64 shifts[])
{
    fmu_instance *fmu = instance;
    for (size_t k = 0; k < nValueReferences; k++) {
        if (variable(fmu, valueReferences[k], FMU_TX_CLOCK) == NULL) {
            return fmi3Error;
        }
        shifts[k] = 1e-9 * (double)model_shift_ns(&fmu->state.m);
    }
    return fmi3OK;
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                size_t nValueReferences, fmi3UInt64 counters[],
                                fmi3UInt64 resolutions[])
{
    fmu_instance *fmu = instance;
    for (size_t k = 0; k < nValueReferences; k++) {
        if (variable(fmu, valueReferences[k], FMU_TX_CLOCK) == NULL) {
            return fmi3Error;
        }
        counters[k] = (fmi3UInt64)model_shift_ns(&fmu->state.m);
        resolutions[k] = NANOSECONDS;
    }
    return fmi3OK;
}

/* The state as one record. */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    fmu_instance *fmu = instance;
    if (*FMUState == NULL) {
        *FMUState = malloc(sizeof fmu->state);
    }
    if (*FMUState == NULL) {
        return failed(fmu, "out of memory");
    }
    memcpy(*FMUState, &fmu->state, sizeof fmu->state);
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState)
{
    fmu_instance *fmu = instance;
    if (FMUState == NULL) {
        return failed(fmu, "no state is given");
    }
    memcpy(&fmu->state, FMUState, sizeof fmu->state);
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    (void)instance;
    free(*FMUState);
    *FMUState = NULL;
    return fmi3OK;
}

/* A serialised state begins with the token, so that another FMU's is refused, and ends with the
 * CRC-32 of all before it, lowest byte first, so that a damaged one is. */

#define SERIALISED (sizeof FMU_TOKEN + sizeof(fmu_state) + 4)

static uint32_t checksum(const uint8_t *bytes, size_t size)
{
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t k = 0; k < size; k++) {
        crc ^= bytes[k];
        for (int bit = 0; bit < 8; bit++) {
            crc = crc >> 1 ^ (crc & 1u ? 0xEDB88320u : 0u);
        }
    }
    return ~crc;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size)
{
    (void)instance, (void)FMUState;
    *size = SERIALISED;
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState,
                                 fmi3Byte serializedState[], size_t size)
{
    if (FMUState == NULL) {
        return failed(instance, "no state is given");
    }
    if (size < SERIALISED) {
        return failed(instance, "room for %zu bytes, the state has %zu", size, SERIALISED);
    }
    memcpy(serializedState, FMU_TOKEN, sizeof FMU_TOKEN);
    memcpy(serializedState + sizeof FMU_TOKEN, FMUState, sizeof(fmu_state));
    uint32_t crc = checksum(serializedState, SERIALISED - 4);
    for (size_t k = 0; k < 4; k++) {
        serializedState[SERIALISED - 4 + k] = (uint8_t)(crc >> 8 * k);
    }
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[],
                                   size_t size, fmi3FMUState *FMUState)
{
    if (size != SERIALISED || memcmp(serializedState, FMU_TOKEN, sizeof FMU_TOKEN) != 0) {
        return failed(instance, "the serialised state is not one of this FMU");
    }
    uint32_t crc = checksum(serializedState, SERIALISED - 4);
    for (size_t k = 0; k < 4; k++) {
        if (serializedState[SERIALISED - 4 + k] != (uint8_t)(crc >> 8 * k)) {
            return failed(instance, "the serialised state is damaged: its CRC is another");
        }
    }
    if (*FMUState == NULL) {
        *FMUState = malloc(sizeof(fmu_state));
    }
    if (*FMUState == NULL) {
        return failed(instance, "out of memory");
    }
    memcpy(*FMUState, serializedState + sizeof FMU_TOKEN, sizeof(fmu_state));
    return fmi3OK;
}

/* Unsupported optional functions of FMI, and those of model exchange. */

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#define REFUSES(name, parameters, why)                                                             \
    fmi3Status name parameters                                                                     \
    {                                                                                              \
        return failed(instance, why);                                                              \
    }

#define REFERENCES fmi3Instance instance, const fmi3ValueReference references[], size_t count
#define VALUES fmi3Instance instance, fmi3Float64 values[], size_t n
#define DERIVATIVES                                                                                \
    fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,                  \
        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed, \
        fmi3Float64 sensitivity[], size_t nSensitivity
#define NO_STRUCTURE "there are no structural parameters"
#define NO_DEPENDENCIES "dependencies are not provided"
#define NO_DERIVATIVES "derivatives are not provided"
#define FIXED_INTERVALS "the intervals of the clocks cannot be set"
#define FIXED_SHIFTS "the shifts of the clocks cannot be set"
#define NO_SCHEDULE "scheduled execution is not supported"
#define NO_EXCHANGE "model exchange is not supported"

REFUSES(fmi3EnterConfigurationMode, (fmi3Instance instance), NO_STRUCTURE)
REFUSES(fmi3ExitConfigurationMode, (fmi3Instance instance), NO_STRUCTURE)
REFUSES(fmi3GetNumberOfVariableDependencies,
        (fmi3Instance instance, fmi3ValueReference valueReference, size_t *nDependencies),
        NO_DEPENDENCIES)
REFUSES(fmi3GetVariableDependencies,
        (fmi3Instance instance, fmi3ValueReference dependent, size_t elementIndicesOfDependent[],
         fmi3ValueReference independents[], size_t elementIndicesOfIndependents[],
         fmi3DependencyKind dependencyKinds[], size_t nDependencies),
        NO_DEPENDENCIES)
REFUSES(fmi3GetDirectionalDerivative, (DERIVATIVES), NO_DERIVATIVES)
REFUSES(fmi3GetAdjointDerivative, (DERIVATIVES), NO_DERIVATIVES)
REFUSES(fmi3SetIntervalDecimal, (REFERENCES, const fmi3Float64 intervals[]), FIXED_INTERVALS)
REFUSES(fmi3SetIntervalFraction,
        (REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]), FIXED_INTERVALS)
REFUSES(fmi3SetShiftDecimal, (REFERENCES, const fmi3Float64 shifts[]), FIXED_SHIFTS)
REFUSES(fmi3SetShiftFraction,
        (REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]), FIXED_SHIFTS)
REFUSES(fmi3GetOutputDerivatives,
        (REFERENCES, const fmi3Int32 orders[], fmi3Float64 values[], size_t nValues),
        NO_DERIVATIVES)
REFUSES(fmi3ActivateModelPartition,
        (fmi3Instance instance, fmi3ValueReference clockReference, fmi3Float64 activationTime),
        NO_SCHEDULE)
REFUSES(fmi3EnterContinuousTimeMode, (fmi3Instance instance), NO_EXCHANGE)
REFUSES(fmi3CompletedIntegratorStep,
        (fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
         fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation),
        NO_EXCHANGE)
REFUSES(fmi3SetTime, (fmi3Instance instance, fmi3Float64 time), NO_EXCHANGE)
REFUSES(fmi3SetContinuousStates,
        (fmi3Instance instance, const fmi3Float64 values[], size_t n), NO_EXCHANGE)
REFUSES(fmi3GetContinuousStateDerivatives, (VALUES), NO_EXCHANGE)
REFUSES(fmi3GetEventIndicators, (VALUES), NO_EXCHANGE)
REFUSES(fmi3GetContinuousStates, (VALUES), NO_EXCHANGE)
REFUSES(fmi3GetNominalsOfContinuousStates, (VALUES), NO_EXCHANGE)

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nEventIndicators)
{
    (void)instance;
    *nEventIndicators = 0;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nContinuousStates)
{
    (void)instance;
    *nContinuousStates = 0;
    return fmi3OK;
}
