/* A hood as an FMI 2 unit written by somebody else: a spring (100 N/m) between two bodies, and a
   tendon that pulls the second along its x axis and the first back.  Its excursion grows with time,
   so that a state tells.  Values: 0 position (2x3), 6 rotation (2x3x3), 24 tension, 25 force (2x3),
   31 moment (2x3), 37 pull's force (3), 40 pull's moment (3), 43 excursion. */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#define EXPORT __attribute__((visibility("default")))
#define STIFFNESS 100.0
#define COMPLIANCE 1e-3
#define CREEP 1e-2
enum { POSITION = 0, ROTATION = 6, TENSION = 24, FORCE = 25, PULL = 37, EXCURSION = 43, ALL = 44 };
typedef struct { double value[ALL], time; } Unit;

static void answer(const double *in, double *out) {
    for (int i = 0; i < 3; i++) {
        double spring = -STIFFNESS * (in[POSITION + 3 + i] - in[POSITION + i]);
        double force = spring + in[TENSION] * in[ROTATION + 9 + 3 * i];
        out[FORCE + 3 + i] = force;
        out[FORCE + i] = -force;
    }
    out[EXCURSION] = COMPLIANCE * in[TENSION];
}

EXPORT void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources,
                             const void *callbacks, int visible, int logging) {
    Unit *unit = calloc(1, sizeof(Unit));
    for (int i = 0; i < 18; i += 9)
        for (int j = 0; j < 3; j++) unit->value[ROTATION + i + 4 * j] = 1.0;
    return unit;
}
/* What the standard also asks for and nobody calls here. */
#define UNUSED(name) EXPORT int name(void) { return 3; }
UNUSED(fmi2GetTypesPlatform) UNUSED(fmi2GetVersion) UNUSED(fmi2SetDebugLogging)
UNUSED(fmi2Terminate) UNUSED(fmi2Reset) UNUSED(fmi2GetInteger) UNUSED(fmi2GetBoolean)
UNUSED(fmi2GetString) UNUSED(fmi2SetInteger) UNUSED(fmi2SetBoolean) UNUSED(fmi2SetString)
UNUSED(fmi2SerializedFMUstateSize) UNUSED(fmi2SerializeFMUstate) UNUSED(fmi2DeSerializeFMUstate)
UNUSED(fmi2SetRealInputDerivatives) UNUSED(fmi2GetRealOutputDerivatives) UNUSED(fmi2CancelStep)
UNUSED(fmi2GetStatus) UNUSED(fmi2GetRealStatus) UNUSED(fmi2GetIntegerStatus)
UNUSED(fmi2GetBooleanStatus) UNUSED(fmi2GetStringStatus)
EXPORT void fmi2FreeInstance(void *unit) { free(unit); }
EXPORT int fmi2SetupExperiment(void *u, int td, double t, double start, int sd, double stop) {
    return 0;
}
EXPORT int fmi2EnterInitializationMode(void *u) { return 0; }
EXPORT int fmi2ExitInitializationMode(void *u) { return 0; }
EXPORT int fmi2GetReal(Unit *u, const unsigned vr[], size_t n, double value[]) {
    for (size_t i = 0; i < n; i++) value[i] = u->value[vr[i]];
    return 0;
}
EXPORT int fmi2SetReal(Unit *u, const unsigned vr[], size_t n, const double value[]) {
    for (size_t i = 0; i < n; i++) u->value[vr[i]] = value[i];
    return 0;
}
EXPORT int fmi2DoStep(Unit *u, double time, double step, int no_set_state) {
    if (u->value[TENSION] > 50.0) return 3;
    u->time += step;
    answer(u->value, u->value);
    u->value[EXCURSION] += CREEP * u->time;
    return 0;
}
EXPORT int fmi2GetFMUstate(Unit *u, void **state) {
    if (*state == NULL) *state = malloc(sizeof(Unit));
    memcpy(*state, u, sizeof(Unit));
    return 0;
}
EXPORT int fmi2SetFMUstate(Unit *u, const void *state) {
    memcpy(u, state, sizeof(Unit));
    return 0;
}
EXPORT int fmi2FreeFMUstate(Unit *u, void **state) {
    free(*state);
    *state = NULL;
    return 0;
}
/* Of forces and excursion by positions, rotations and tension, product rule and all. */
EXPORT int fmi2GetDirectionalDerivative(Unit *u, const unsigned unknown[], size_t n,
                                        const unsigned known[], size_t m, const double seed[],
                                        double slope[]) {
    double d[ALL] = {0}, out[ALL] = {0};
    for (size_t i = 0; i < m; i++) d[known[i]] = seed[i];
    for (int i = 0; i < 3; i++) {
        int axis = ROTATION + 9 + 3 * i;
        double turned = d[TENSION] * u->value[axis] + u->value[TENSION] * d[axis];
        out[FORCE + 3 + i] = turned - STIFFNESS * (d[POSITION + 3 + i] - d[POSITION + i]);
        out[FORCE + i] = -out[FORCE + 3 + i];
    }
    out[EXCURSION] = COMPLIANCE * d[TENSION];
    for (size_t k = 0; k < n; k++) slope[k] = out[unknown[k]];
    return 0;
}
