/* A plant of uvms-mj as an FMU of FMI 2.0 for co-simulation. All of a run is one record, a copy of IMAGE; its numbers
   are set and read by their places. */
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "plant.h" /* sizes, places and factors of this plant */

int64_t uvms_mj_free_steps(int64_t record, int64_t steps, int64_t moving);
int64_t uvms_mj_advance(int64_t record, int64_t end);

enum { OK, WARNING, DISCARD, FAILED, FATAL };
typedef void (*logger_type)(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    logger_type logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*step_finished)(void *, int);
    void *environment;
} callbacks;

typedef struct {
    double *numbers;
    double parameters[PARAMETERS + 1];
    callbacks called;
    char name[200];
    int stage;     /* what was called last; see the stages below */
    double end;    /* time that no step may pass */
    int64_t steps; /* time steps done */
} plant;

/* The stages of FMI 2.0 for co-simulation, figure 11: each call is allowed in some of them. A run that has failed takes
   no step: only a reset, a saved state or the end goes on. */
enum { MADE = 1, SET_UP = 2, BEGINNING = 4, RUNNING = 8, ENDED = 16, BROKEN = 32 };

static const unsigned char *image(void)
{
    extern const unsigned char uvms_mj_image[];
    return uvms_mj_image;
}

static int say(plant *p, int status, const char *text)
{
    if (p->called.logger)
        p->called.logger(p->called.environment, p->name, status, "logStatusError", text); /* no text has a % */
    return status;
}

static int say_of(plant *p, const char *name, const char *text)
{
    char both[200];
    snprintf(both, sizeof both, "%s %s", name, text);
    return say(p, FAILED, both);
}

/* Whether a call is allowed now. */
static int allowed(plant *p, int stages, const char *call)
{
    static const char *const words[] = {"before it is set up", "before it is initialized", "while it is initialized", "in a run",
        "after its end", "after it has failed"};
    char both[200];
    int k = 0;
    if (p->stage & stages)
        return 1;
    while (p->stage >> k > 1)
        k++;
    snprintf(both, sizeof both, "%s is not allowed %s", call, words[k]);
    say(p, FAILED, both);
    return 0;
}

/* SHA-256 (FIPS 180-4) of a text of at most 55 bytes; its first 8 bytes. */
static uint64_t digest(const char *text)
{
    static const uint32_t K[64] = {
        0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
        0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
        0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
        0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
        0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
        0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
        0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
        0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};
    uint32_t h[8] = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
    unsigned char block[64] = {0};
    size_t n = strlen(text);
    uint32_t w[64], v[8];
    memcpy(block, text, n);
    block[n] = 0x80;
    block[62] = (unsigned char)(n >> 5), block[63] = (unsigned char)(n << 3);
    for (int i = 0; i < 16; i++)
        w[i] = (uint32_t)block[4 * i] << 24 | block[4 * i + 1] << 16 | block[4 * i + 2] << 8 | block[4 * i + 3];
#define TURN(x, k) ((x) >> (k) | (x) << (32 - (k)))
    for (int i = 16; i < 64; i++) {
        uint32_t a = w[i - 15], b = w[i - 2];
        w[i] = w[i - 16] + (TURN(a, 7) ^ TURN(a, 18) ^ a >> 3) + w[i - 7] + (TURN(b, 17) ^ TURN(b, 19) ^ b >> 10);
    }
    memcpy(v, h, sizeof v);
    for (int i = 0; i < 64; i++) {
        uint32_t e = v[4], a = v[0];
        uint32_t one = v[7] + (TURN(e, 6) ^ TURN(e, 11) ^ TURN(e, 25)) + ((e & v[5]) ^ (~e & v[6])) + K[i] + w[i];
        uint32_t two = (TURN(a, 2) ^ TURN(a, 13) ^ TURN(a, 22)) + ((a & v[1]) ^ (a & v[2]) ^ (v[1] & v[2]));
        memmove(v + 1, v, 7 * sizeof *v);
        v[4] += one, v[0] = one + two;
    }
    return (uint64_t)(h[0] + v[0]) << 32 | (h[1] + v[1]);
}

static void put(plant *p, int64_t place, double value, int whole)
{
    if (whole)
        ((int64_t *)p->numbers)[place] = (int64_t)value;
    else
        p->numbers[place] = value;
}

/* Copy the records of the start, with the numbers that the parameters set. */
static void begin(plant *p)
{
    memset(p->numbers, 0, 8 * (size_t)NUMBERS);
    memcpy(p->numbers, image(), IMAGE_BYTES);
    for (int i = 0; i < TABLES; i++)
        p->numbers[tables[i].place] = tables[i].value;
    for (int i = 0; i < SETS; i++) {
        double value = p->parameters[sets[i].parameter];
        if (value != starts[sets[i].parameter])
            put(p, sets[i].place, sets[i].factor * value + sets[i].offset, 0);
    }
    for (int i = 0; i < KEYS; i++) {
        char text[56];
        snprintf(text, sizeof text, "%lld %s", (long long)p->parameters[SEED], keys[i].name);
        ((int64_t *)p->numbers)[keys[i].place] = (int64_t)(digest(text) >> 2);
    }
    ((int64_t *)p->numbers)[ADDRESS] = (int64_t)(intptr_t)p->numbers;
    p->steps = 0;
}

static int advance(plant *p)
{
    uvms_mj_advance((int64_t)(intptr_t)p->numbers, CONTROL);
    if (((int64_t *)p->numbers)[STOP] != 0) {
        p->stage = BROKEN;
        return say(p, FAILED, stopped(((int64_t *)p->numbers)[STOP]));
    }
    return OK;
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
int fmi2SetDebugLogging(void *c, int on, size_t n, const char *const names[]) { return OK; }

void *fmi2Instantiate(const char *name, int type, const char *guid, const char *place, const callbacks *called, int visible,
    int logs)
{
    plant *p = calloc(1, sizeof(plant));
    if (!p)
        return NULL;
    p->numbers = aligned_alloc(64, (8 * (size_t)NUMBERS + 63) / 64 * 64);
    if (called)
        p->called = *called;
    snprintf(p->name, sizeof p->name, "%s", name ? name : "plant");
    if (!p->numbers || type != 1 || !guid || strcmp(guid, GUID) != 0) {
        say(p, FAILED, type != 1 ? "only co-simulation" : "the model description has another guid");
        free(p->numbers);
        free(p);
        return NULL;
    }
    memcpy(p->parameters, starts, sizeof starts);
    begin(p);
    p->stage = MADE;
    return p;
}

void fmi2FreeInstance(void *c)
{
    if (c)
        free(((plant *)c)->numbers);
    free(c);
}

int fmi2SetupExperiment(void *c, int known, double tolerance, double start, int ends, double end)
{
    plant *p = c;
    if (!allowed(p, MADE | SET_UP, "fmi2SetupExperiment"))
        return FAILED;
    if (start != 0.0)
        return say(p, FAILED, "a run begins at the time 0");
    p->end = ends ? end : INFINITY;
    p->stage = SET_UP;
    return OK;
}

int fmi2EnterInitializationMode(void *c)
{
    plant *p = c;
    if (!allowed(p, SET_UP, "fmi2EnterInitializationMode"))
        return FAILED;
    p->stage = BEGINNING;
    return OK;
}

/* Whether symplectic Euler is stable on the walls, by the same comparison as in a run. */
static int walls_stable(const plant *p)
{
    for (int i = 0; i < WALLS; i++) {
        double x[3], h = TIMESTEP, m = walls[i].mass;
        for (int j = 0; j < 3; j++)
            x[j] = walls[i].parameter[j] < 0 ? walls[i].number[j] : p->parameters[walls[i].parameter[j]];
        if (x[2] > 0.0 && !(h * h * x[0] / m + 2.0 * h * x[1] / m < 4.0))
            return 0;
    }
    return 1;
}

int fmi2ExitInitializationMode(void *c)
{
    plant *p = c;
    if (!walls_stable(p))
        return say(p, FAILED, "wall.stiffness or wall.damping is too much for the plant's time step");
    double inputs[INPUTS + 1];
    if (!allowed(p, BEGINNING, "fmi2ExitInitializationMode"))
        return FAILED;
    for (int i = 0; i < INPUTS; i++)
        inputs[i] = p->numbers[inputs_at[i]];
    begin(p);
    for (int i = 0; i < INPUTS; i++)
        p->numbers[inputs_at[i]] = inputs[i];
    p->stage = RUNNING;
    return advance(p);
}

int fmi2Terminate(void *c)
{
    plant *p = c;
    if (!allowed(p, RUNNING | BROKEN, "fmi2Terminate"))
        return FAILED;
    p->stage = ENDED;
    return OK;
}

int fmi2Reset(void *c)
{
    plant *p = c;
    memcpy(p->parameters, starts, sizeof starts);
    p->stage = MADE;
    begin(p);
    return OK;
}

/* Value references: the parameters, then the inputs, then the outputs. */
int fmi2SetReal(void *c, const unsigned refs[], size_t n, const double values[])
{
    plant *p = c;
    for (size_t i = 0; i < n; i++) {
        unsigned ref = refs[i];
        if (!isfinite(values[i]))
            return say(p, FAILED, "a number is not finite");
        if (ref < PARAMETERS) {
            if (p->stage & ~(MADE | SET_UP | BEGINNING))
                return say_of(p, named[ref], "is a parameter, which is set before the run begins");
            if (values[i] < least[ref] || values[i] > greatest[ref] || (ref == SEED && values[i] != floor(values[i])))
                return say_of(p, named[ref], "is out of its range");
            p->parameters[ref] = values[i];
        } else if (ref < PARAMETERS + INPUTS) {
            if (!allowed(p, MADE | SET_UP | BEGINNING | RUNNING, "fmi2SetReal"))
                return FAILED;
            p->numbers[inputs_at[ref - PARAMETERS]] = values[i];
        } else {
            return say(p, FAILED, "an output can't be set");
        }
    }
    return OK;
}

int fmi2GetReal(void *c, const unsigned refs[], size_t n, double values[])
{
    plant *p = c;
    for (size_t i = 0; i < n; i++) {
        unsigned ref = refs[i];
        if (ref < PARAMETERS)
            values[i] = p->parameters[ref];
        else if (ref < PARAMETERS + INPUTS)
            values[i] = p->numbers[inputs_at[ref - PARAMETERS]];
        else if (ref < PARAMETERS + INPUTS + OUTPUTS)
            values[i] = p->numbers[outputs_at[ref - PARAMETERS - INPUTS]];
        else
            return say(p, FAILED, "no such variable");
    }
    return OK;
}

int fmi2DoStep(void *c, double t, double h, int no_return)
{
    plant *p = c;
    double steps = floor(h / TIMESTEP + 0.5), now = (double)p->steps * TIMESTEP;
    double near = fmin(0.25 * TIMESTEP, 1e-3 * TIMESTEP + 1e-9 * now); /* a master adds up its steps */
    if (!allowed(p, RUNNING, "fmi2DoStep"))
        return FAILED;
    if (!(fabs(t - now) <= near)) {
        char text[120];
        snprintf(text, sizeof text, "a step from t = %.9g s: the run is at t = %.9g s", t, now);
        return say(p, FAILED, text);
    }
    if (!(steps >= 1.0 && steps < 1e15) || fabs(steps * TIMESTEP - h) > 1e-6 * TIMESTEP)
        return say(p, FAILED, "a step must be a multiple of the plant's time step");
    if (now + h > p->end + near)
        return say(p, FAILED, "a step passes the end that fmi2SetupExperiment has set");
    int64_t done = uvms_mj_free_steps((int64_t)(intptr_t)p->numbers, (int64_t)steps, 1);
    p->steps += done;
    return advance(p);
}

int fmi2GetFMUstate(void *c, void **state)
{
    if (!*state)
        *state = malloc(sizeof(plant) + 8 * (size_t)NUMBERS);
    if (!*state)
        return FAILED;
    return OK + (memcpy(*state, c, sizeof(plant)), memcpy((char *)*state + sizeof(plant), ((plant *)c)->numbers, 8 * (size_t)NUMBERS), 0);
}

int fmi2SetFMUstate(void *c, void *state)
{
    plant *p = c, *then = state;
    memcpy(p->numbers, (char *)state + sizeof(plant), 8 * (size_t)NUMBERS);
    memcpy(p->parameters, then->parameters, sizeof p->parameters);
    p->stage = then->stage, p->end = then->end, p->steps = then->steps;
    ((int64_t *)p->numbers)[ADDRESS] = (int64_t)(intptr_t)p->numbers;
    return OK;
}

int fmi2FreeFMUstate(void *c, void **state)
{
    free(*state);
    *state = NULL;
    return OK;
}

int fmi2SerializedFMUstateSize(void *c, void *state, size_t *size)
{
    *size = sizeof(plant) + 8 * (size_t)NUMBERS;
    return OK;
}

int fmi2SerializeFMUstate(void *c, void *state, char bytes[], size_t size)
{
    if (size < sizeof(plant) + 8 * (size_t)NUMBERS)
        return FAILED;
    memcpy(bytes, state, sizeof(plant) + 8 * (size_t)NUMBERS);
    return OK;
}

int fmi2DeSerializeFMUstate(void *c, const char bytes[], size_t size, void **state)
{
    if (size != sizeof(plant) + 8 * (size_t)NUMBERS || (!*state && !(*state = malloc(size))))
        return FAILED;
    memcpy(*state, bytes, size);
    return OK;
}

#define NONE(NAME) \
    int NAME(void *c) { return say(c, FAILED, #NAME " is not offered"); }
NONE(fmi2GetInteger) NONE(fmi2GetBoolean) NONE(fmi2GetString) NONE(fmi2SetInteger) NONE(fmi2SetBoolean)
NONE(fmi2SetString) NONE(fmi2GetDirectionalDerivative) NONE(fmi2SetRealInputDerivatives)
NONE(fmi2GetRealOutputDerivatives) NONE(fmi2CancelStep) NONE(fmi2GetStatus) NONE(fmi2GetRealStatus)
NONE(fmi2GetIntegerStatus) NONE(fmi2GetBooleanStatus) NONE(fmi2GetStringStatus)
