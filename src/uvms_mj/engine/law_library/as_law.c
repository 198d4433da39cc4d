/* The library as a law of uvms-mj, --controller lib.so:NAME_law: given is the record of signals, and the state keeps an
   instance. It is an object of its own, so that a program that does not call it does not carry it. */
#include "law.h"
#include "as_law.h" /* RECORDS, GAINS, tables of places */

extern const uint64_t ADAPTER_records[4];
const uint64_t ADAPTER_records[4] = {RECORDS};

static void copy(double *to, const double *from, int n)
{
    int i;
    for (i = 0; i < n; i++)
        to[i] = from[i];
}

int ADAPTER(const double *gains, double *state, const double *given, double *state_dot, double *tau_cmd)
{
    union {
        LAW self;
        uint64_t words[sizeof(LAW) / 8];
    } kept; /* in halves of 32 bits, since a state must be a finite number */
    uint64_t *halves = (uint64_t *)(void *)state;
    LAW *self = &kept.self;
    law_measured measured;
    law_command command;
    law_settings settings;
    double *words = (double *)(void *)&measured + 2;
    int k, status;
    (void)state_dot;
    for (k = 0; k < (int)(sizeof(LAW) / 8); k++)
        kept.words[k] = halves[2 * k] | halves[2 * k + 1] << 32;
    if (*(const uint64_t *)(const void *)&given[2] == 0) /* the instant */
        law_init(self);
    words = (double *)(void *)&settings;
    copy(words, gains, GAINS);
    for (k = 0; k < (int)(sizeof impedance_in / sizeof *impedance_in); k++)
        copy(words + GAINS + 6 * k, given + impedance_in[k].place, impedance_in[k].n);
    law_set(self, &settings);
    measured.t = given[0];
    measured.present = LAW_NEEDED;
    words = (double *)(void *)&measured + 2;
    for (k = 0; k < (int)(sizeof measured_in / sizeof *measured_in); k++) {
        copy(words, given + measured_in[k].place, measured_in[k].n);
        words += measured_in[k].n;
    }
#if LAW_GUIDED
    status = law_step(self, &measured, &command);
#else
    {
        law_reference reference;
        words = (double *)(void *)&reference;
        for (k = 0; k < (int)(sizeof reference_in / sizeof *reference_in); k++) {
            copy(words, given + reference_in[k].place, reference_in[k].n);
            words += reference_in[k].n;
        }
        status = law_step(self, &measured, &reference, &command);
    }
#endif
    copy(tau_cmd, command.tau_cmd, 6);
    for (k = 0; k < (int)(sizeof(LAW) / 8); k++) {
        halves[2 * k] = kept.words[k] & UINT64_C(0xffffffff);
        halves[2 * k + 1] = kept.words[k] >> 32;
    }
    return status < LAW_OK ? -status : 0;
}
