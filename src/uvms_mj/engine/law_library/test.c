/* Compares the library with recorded steps of a run, bit for bit. Ends with 0 if all are equal, otherwise with 1. */
#include "law.h"
#include "vectors.h"
#include <stdio.h>
#include <string.h>

#ifndef DEEP
#define DEEP 65536 /* bytes of the stack that are looked at */
#endif
#define OUTPUTS ((int)(sizeof(law_command) / 8))

static LAW instance;

/* The stack that a call uses: a pattern below this frame is looked at again after the call. */
#if defined(__GNUC__)
#define APART __attribute__((noinline))
#else
#define APART
#endif
static volatile int paints; /* volatile: one function for both, with one frame */

APART static int below(void)
{
    unsigned char low[DEEP];
    volatile unsigned char *volatile at = low;
    int i = 0;
    if (paints)
        for (i = 0; i < DEEP; i++)
            at[i] = 0xa5;
    else
        while (i < DEEP && at[i] == 0xa5)
            i++;
    return DEEP - i;
}

static int lowest_bit(uint64_t different)
{
    int bit = 0;
    while (!(different >> bit & 1u))
        bit++;
    return bit;
}

int main(void)
{
    int s, k, i, equal = 0, said = 0, stack = 0;
    if (law_init(&instance) != LAW_OK) {
        printf("init: %s\n", law_text(law_init(&instance)));
        return 1;
    }
    for (s = 0; s < SEGMENTS; s++) {
        int same = 0;
        law_init(&instance);
        for (i = 0; i < segments[s].changes; i++)
            memcpy(&instance.record[change_at[segments[s].change + i]], &change_to[segments[s].change + i], 8);
        instance.last = segments[s].last;
        instance.begun = 2 * (uint64_t)segments[s].begun; /* the time of the run */
        for (k = 0; k < segments[s].steps; k++) {
            const uint64_t *row = rows[segments[s].first + k];
            law_measured measured;
            law_command command;
            uint64_t got[sizeof(law_command) / 8];
            int status, differs = 0;
#if !LAW_GUIDED
            law_reference reference;
#endif
            memcpy(&measured, row, sizeof measured);
            row += sizeof measured / 8;
#if !LAW_GUIDED
            memcpy(&reference, row, sizeof reference);
            row += sizeof reference / 8;
#endif
            paints = 1;
            if (k == 1)
                (void)below();
#if LAW_GUIDED
            status = law_step(&instance, &measured, &command);
#else
            status = law_step(&instance, &measured, &reference, &command);
#endif
            if (k == 1) {
                int used;
                paints = 0;
                used = below();
                stack = used > stack ? used : stack;
            }
            memcpy(got, &command, sizeof got);
            for (i = 0; i < OUTPUTS && !differs; i++)
                if (got[i] != row[i])
                    differs = i + 1;
            if (status == LAW_OK && !differs) {
                same++;
            } else if (!said) {
                said = 1;
                printf("%s, step %d at t = %.9g s: ", segments[s].name, k, measured.t);
                if (status != LAW_OK)
                    printf("%s\n", law_text(status));
                else
                    printf("%s: bit %d is the lowest that differs\n", command_names[differs - 1],
                           lowest_bit(got[differs - 1] ^ row[differs - 1]));
            }
        }
        printf("%s: %d of %d steps equal\n", segments[s].name, same, segments[s].steps);
        equal += same;
    }
    printf("%d of %d steps equal; a step used %d bytes of stack\n", equal, STEPS, stack);
    return equal == STEPS ? 0 : 1;
}
