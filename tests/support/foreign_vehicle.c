/* A van as another tool might export it, FMI 2.0: single-track model, roll of the body, its own
 * units (wheel angle in degrees, moments in kN.m), and ways to fail at a chosen time. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

enum { DELTA, MOMENT_FRONT, MOMENT_REAR, GRIP, INPUTS };
enum { V0 = 10, CRASH, FAIL, LOSE, SECONDS, PARAMETERS };
enum { PX = 20, PY, PSI, V, AY, R, PHI, P, VY, OUTPUTS };

typedef struct {
    double value[OUTPUTS];
    fmi2CallbackFunctions tool;
} van;

static const double MASS = 2520, INERTIA_YAW = 6000, INERTIA_ROLL = 1700, HEIGHT = 0.6;
static const double FRONT = 1.4, REAR = 1.9, STIFF_FRONT = 140e3, STIFF_REAR = 160e3;
static const double ROLL_STIFFNESS = 120e3, ROLL_DAMPING = 9e3, G = 9.81, DEGREE = M_PI / 180;

static void advance(van *s, double dt)
{
    double *q = s->value, delta = q[DELTA] * DEGREE, v = q[V0];
    double front = q[GRIP] * STIFF_FRONT * (delta - (q[VY] + FRONT * q[R]) / v);
    double rear = -q[GRIP] * STIFF_REAR * (q[VY] - REAR * q[R]) / v;
    double moment = 1e3 * (q[MOMENT_FRONT] + q[MOMENT_REAR]);
    q[AY] = (front + rear) / MASS;
    double roll = q[PHI] * DEGREE;
    double roll_acc = (MASS * HEIGHT * (q[AY] + G * sin(roll)) + moment - ROLL_STIFFNESS * roll
                       - ROLL_DAMPING * q[P]) / INERTIA_ROLL;
    q[PX] += dt * (v * cos(q[PSI]) - q[VY] * sin(q[PSI]));
    q[PY] += dt * (v * sin(q[PSI]) + q[VY] * cos(q[PSI]));
    q[PSI] += dt * q[R];
    q[VY] += dt * (q[AY] - v * q[R]);
    q[R] += dt * (FRONT * front - REAR * rear) / INERTIA_YAW;
    q[P] += dt * roll_acc;
    q[PHI] += dt * q[P] / DEGREE;
    q[V] = v;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *tool, fmi2Boolean visible,
                              fmi2Boolean logging)
{
    van *s = calloc(1, sizeof *s);
    s->tool = *tool;
    s->value[V0] = 10;
    s->value[GRIP] = 1;
    s->value[CRASH] = s->value[FAIL] = s->value[LOSE] = 1e9;
    return s;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real step, fmi2Boolean final)
{
    van *s = c;
    if (now >= s->value[CRASH]) {
        abort();
    }
    if (now >= s->value[FAIL]) {
        s->tool.logger(s->tool.componentEnvironment, "van", fmi2Error, "", "the tyre has burst");
        return fmi2Error;
    }
    for (int k = 0; k < 10; k++) {
        advance(s, step / 10);
    }
    if (now >= s->value[LOSE]) {
        s->value[PHI] = NAN;
    }
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    ((van *)c)->value[V] = ((van *)c)->value[V0];
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real v[])
{
    for (size_t k = 0; k < n; k++) {
        ((van *)c)->value[vr[k]] = v[k];
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real v[])
{
    for (size_t k = 0; k < n; k++) {
        v[k] = ((van *)c)->value[vr[k]];
    }
    return fmi2OK;
}

void fmi2FreeInstance(fmi2Component c)
{
    free(c);
}

const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

const char *fmi2GetVersion(void)
{
    return "2.0";
}

/* What the van does without. */
#define NOT_HERE(name, ...) fmi2Status name(fmi2Component c, ##__VA_ARGS__) { return fmi2OK; }
#define V const fmi2ValueReference v[], size_t n
NOT_HERE(fmi2SetDebugLogging, fmi2Boolean on, size_t n, const fmi2String names[])
NOT_HERE(fmi2SetupExperiment, fmi2Boolean t, fmi2Real e, fmi2Real s, fmi2Boolean d, fmi2Real p)
NOT_HERE(fmi2EnterInitializationMode)
NOT_HERE(fmi2Terminate)
NOT_HERE(fmi2Reset)
NOT_HERE(fmi2GetInteger, V, fmi2Integer x[])
NOT_HERE(fmi2GetBoolean, V, fmi2Boolean x[])
NOT_HERE(fmi2GetString, V, fmi2String x[])
NOT_HERE(fmi2SetInteger, V, const fmi2Integer x[])
NOT_HERE(fmi2SetBoolean, V, const fmi2Boolean x[])
NOT_HERE(fmi2SetString, V, const fmi2String x[])
NOT_HERE(fmi2GetFMUstate, fmi2FMUstate *s)
NOT_HERE(fmi2SetFMUstate, fmi2FMUstate s)
NOT_HERE(fmi2FreeFMUstate, fmi2FMUstate *s)
NOT_HERE(fmi2SerializedFMUstateSize, fmi2FMUstate s, size_t *n)
NOT_HERE(fmi2SerializeFMUstate, fmi2FMUstate s, fmi2Byte b[], size_t n)
NOT_HERE(fmi2DeSerializeFMUstate, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
NOT_HERE(fmi2GetDirectionalDerivative, const fmi2ValueReference u[], size_t n,
         const fmi2ValueReference k[], size_t m, const fmi2Real d[], fmi2Real x[])
NOT_HERE(fmi2SetRealInputDerivatives, V, const fmi2Integer o[], const fmi2Real x[])
NOT_HERE(fmi2GetRealOutputDerivatives, V, const fmi2Integer o[], fmi2Real x[])
NOT_HERE(fmi2CancelStep)
NOT_HERE(fmi2GetStatus, const fmi2StatusKind k, fmi2Status *x)
NOT_HERE(fmi2GetRealStatus, const fmi2StatusKind k, fmi2Real *x)
NOT_HERE(fmi2GetIntegerStatus, const fmi2StatusKind k, fmi2Integer *x)
NOT_HERE(fmi2GetBooleanStatus, const fmi2StatusKind k, fmi2Boolean *x)
NOT_HERE(fmi2GetStringStatus, const fmi2StatusKind k, fmi2String *x)
