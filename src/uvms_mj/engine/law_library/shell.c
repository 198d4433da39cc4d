/* The functions of a law's library around the machine code of its stages. law_ and LAW_ stand for the library's name. */
#include "law.h"
#include "image.h" /* MARK, EXPORT, tables of places, the record before the first period */

extern int64_t law_chain(int64_t record, int64_t address, int64_t constants);

static uint64_t bits_of(double x)
{
    union {
        double number;
        uint64_t bits;
    } both;
    both.number = x;
    return both.bits;
}

/* Whether a number is finite. A compiler that is told that all of them are can't leave it out. */
static int finite(double x)
{
    return (bits_of(x) & UINT64_C(0x7ff0000000000000)) != UINT64_C(0x7ff0000000000000);
}

static int all_finite(const double *x, int n)
{
    int i;
    for (i = 0; i < n; i++)
        if (!finite(x[i]))
            return 0;
    return 1;
}

/* Whether a sum is rounded to the nearest double, and once, and a small product is not flushed to zero. */
static int rounds_as_here(void)
{
    volatile double one = 1.0, half = 1.1102230246251565e-16, more = 1.1102230246251568e-16, small = 2.2250738585072014e-308;
    volatile double down = one + half, up = one + more, minus = -one - more, part = small * 0.5;
    return down == one && up == 1.0000000000000002 && minus == -1.0000000000000002 && part != 0.0;
}

static void copy(double *to, const double *from, int n)
{
    int i;
    for (i = 0; i < n; i++)
        to[i] = from[i];
}

static void quiet(LAW *self)
{
    int i;
    for (i = 0; i < 6; i++)
        self->record[TAU_HAT + i] = 0.0; /* what a neutral command is believed to give */
}

static void begin(LAW *self)
{
    int k, at = 0;
    unsigned i;
    union {
        uint64_t bits;
        double number;
    } both;
    for (k = 0; k < IMAGE_RUNS; k++) {
        both.bits = image[k];
        for (i = 0; i < image_lengths[k]; i++)
            self->record[at++] = both.number;
    }
    self->last = 0.0;
    self->first = 0.0;
    self->begun = 0; /* 1: there was a time; 2: there was a command, the first one at the time first */
    self->fault = 0;
    self->mark = MARK;
}

int law_init_of(uint64_t layout, LAW *self)
{
    if (layout != LAW_LAYOUT)
        return LAW_OTHER_HEADER;
    if (!self)
        return LAW_NULL;
    self->mark = 0;
    if (!rounds_as_here())
        return LAW_OTHER_ARITHMETIC;
    begin(self);
    return LAW_OK;
}

int law_reset(LAW *self)
{
    law_settings kept;
    if (!self)
        return LAW_NULL;
    if (self->mark != MARK)
        return LAW_NOT_BEGUN;
    law_get(self, &kept);
    begin(self);
    return law_set_of(LAW_LAYOUT, self, &kept);
}

int law_get(const LAW *self, law_settings *settings)
{
    int k;
    double *words = (double *)settings;
    if (!self || !settings)
        return LAW_NULL;
    if (self->mark != MARK)
        return LAW_NOT_BEGUN;
    for (k = 0; k < (int)(sizeof settings_at / sizeof *settings_at); k++) {
        copy(words, self->record + settings_at[k].place, settings_at[k].n);
        words += settings_at[k].n;
    }
    return LAW_OK;
}

int law_set_of(uint64_t layout, LAW *self, const law_settings *settings)
{
    int k;
    const double *words = (const double *)settings;
    if (layout != LAW_LAYOUT)
        return LAW_OTHER_HEADER;
    if (!self || !settings)
        return LAW_NULL;
    if (self->mark != MARK)
        return LAW_NOT_BEGUN;
    if (!all_finite(words, (int)(sizeof *settings / sizeof *words)))
        return LAW_NOT_FINITE;
    for (k = 0; k < (int)(sizeof settings_at / sizeof *settings_at); k++) {
        copy(self->record + settings_at[k].place, words, settings_at[k].n);
        words += settings_at[k].n;
    }
    return LAW_OK;
}

#ifdef LAW_INERTIAL_PERIOD
/* Whether the filter has an estimate of this time: a first one, or one that a sample of the inertial unit brings here.
   Without a sample it is held, as long as the next one is not due. */
static int filtered(LAW *self, const law_measured *measured, uint64_t present)
{
    double since = measured->t - self->record[SAMPLED], most = LAW_LONGEST_GAP * LAW_INERTIAL_PERIOD;
    int sampled = (present & LAW_INERTIAL) != 0;
    if (present & LAW_START)
        return LAW_OK;
    if (sampled)
        since -= measured->interval;
    if (self->record[FILTERING] == 0.0)
        return LAW_MISSING;
    if (since > most) {
        self->record[FILTERING] = 0.0; /* it has missed a motion: it needs a first estimate again */
        return LAW_MISSING;
    }
    if (sampled ? !(measured->interval > 0.0 && measured->interval <= most) : since > 1.5 * LAW_INERTIAL_PERIOD)
        return LAW_MISSING;
    return sampled && (since > 0.5 * LAW_INERTIAL_PERIOD || since < -0.5 * LAW_INERTIAL_PERIOD) ? LAW_LATE : LAW_OK;
}

/* Tell the filter which samples are new. */
static void tell(LAW *self, double t, uint64_t present)
{
    int k;
    for (k = 0; k < (int)(sizeof flags_at / sizeof *flags_at); k++)
        self->record[flags_at[k].place] = present & (uint64_t)flags_at[k].bit ? 1.0 : 0.0;
    if (present & (LAW_START | LAW_INERTIAL)) {
        self->record[SAMPLED] = t;
        self->record[FILTERING] = 1.0;
    }
}
#endif

/* Why a measurement is refused, or LAW_OK, or LAW_LATE. What is there is in present; an aid that is not finite is not. */
static int judged(LAW *self, const law_measured *measured, const double *words, uint64_t *present)
{
    double since, square = 0.0;
    int i, k, late = LAW_OK, left_out = LAW_OK;
    if (!finite(measured->t))
        return LAW_NOT_FINITE;
    since = measured->t - self->last;
    if (self->begun) {
        if (!(since > 0.0))
            return LAW_TIME_BACK;
        if (since < 0.5 * LAW_PERIOD || since > 1.5 * LAW_PERIOD)
            late = LAW_LATE;
        if (since > LAW_LONGEST_GAP * LAW_PERIOD)
            late = LAW_GAP;
    }
    self->last = measured->t;
    if (!self->begun)
        self->begun = 1;
    if (self->fault)
        return LAW_FAULT;
    if ((measured->present & LAW_NEEDED) != LAW_NEEDED)
        return LAW_MISSING;
    *present = measured->present;
    for (k = 0; k < (int)(sizeof measured_at / sizeof *measured_at); k++) {
        if ((*present & (uint64_t)measured_at[k].bit) && !all_finite(words, measured_at[k].n)) {
#ifdef LAW_INERTIAL_PERIOD
            if (!(measured_at[k].bit & AIDS))
                return LAW_NOT_FINITE;
            *present &= ~(uint64_t)measured_at[k].bit;
            left_out = LAW_LEFT_OUT;
#else
            return LAW_NOT_FINITE;
#endif
        }
        words += measured_at[k].n;
    }
    for (i = 0; i < 4; i++)
        square += measured->quat_WB[i] * measured->quat_WB[i];
#ifdef LAW_INERTIAL_PERIOD
    if (!(*present & LAW_START))
        square = 1.0;
#endif
    if (!(square > 0.999999 && square < 1.000001))
        return LAW_NO_ATTITUDE;
#ifdef LAW_INERTIAL_PERIOD
    if (late >= LAW_OK) {
        i = filtered(self, measured, *present);
        late = i == LAW_OK ? late : i;
    }
#endif
    return late == LAW_OK ? left_out : late;
}

#if LAW_GUIDED
int law_step_of(uint64_t layout, LAW *self, const law_measured *measured, law_command *command)
#else
int law_step_of(uint64_t layout, LAW *self, const law_measured *measured, const law_reference *reference,
                law_command *command)
#endif
{
    const double *words;
    double *out = (double *)command;
    uint64_t present = 0;
    int64_t here;
    int k, status;
    if (layout != LAW_LAYOUT)
        return LAW_OTHER_HEADER; /* its structs are others: the caller's header has set a neutral command */
    if (!command)
        return LAW_NULL;
    law_neutral(command);
    if (!self || !measured)
        return LAW_NULL;
    if (self->mark != MARK)
        return LAW_NOT_BEGUN;
    words = (const double *)measured + 2; /* behind t and present */
    status = judged(self, measured, words, &present);
#if !LAW_GUIDED
    if (status >= LAW_OK && !reference)
        status = LAW_MISSING;
    if (status >= LAW_OK && !all_finite((const double *)reference, (int)(sizeof *reference / sizeof(double))))
        status = LAW_NOT_FINITE;
#endif
    if (status < LAW_OK) {
        quiet(self);
        return status;
    }
    if (self->begun < 2) {
        self->first = measured->t;
        self->begun = 2;
    }
    self->record[TIME] = measured->t - self->first;
    for (k = 0; k < (int)(sizeof measured_at / sizeof *measured_at); k++) {
        if (present & (uint64_t)measured_at[k].bit)
            copy(self->record + measured_at[k].place, words, measured_at[k].n);
        words += measured_at[k].n;
    }
#ifdef LAW_INERTIAL_PERIOD
    tell(self, measured->t, present);
#endif
#if !LAW_GUIDED
    words = (const double *)reference;
    for (k = 0; k < (int)(sizeof reference_at / sizeof *reference_at); k++) {
        copy(self->record + reference_at[k].place, words, reference_at[k].n);
        words += reference_at[k].n;
    }
#endif
    here = (int64_t)(intptr_t)self->record;
    if (law_chain(here, here, (int64_t)(intptr_t)constants) != 0)
        self->fault = 1;
    for (k = 0; k < (int)(sizeof command_at / sizeof *command_at); k++)
        if (!all_finite(self->record + command_at[k].place, command_at[k].n))
            self->fault = 1;
    if (self->fault) {
        quiet(self);
        return LAW_FAULT;
    }
    for (k = 0; k < (int)(sizeof command_at / sizeof *command_at); k++) {
        copy(out, self->record + command_at[k].place, command_at[k].n);
        out += command_at[k].n;
    }
    command->saturated = bits_of(self->record[SATURATED]);
    return status;
}

const char *law_text(int status)
{
    switch (status) {
TEXTS    }
    return "an unknown status";
}

double law_period(void)
{
    return LAW_PERIOD;
}

uint64_t law_bytes(void)
{
    return sizeof(LAW);
}

uint64_t law_export(void)
{
    return EXPORT;
}
