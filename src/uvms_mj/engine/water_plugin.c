/* The water of uvms-mj on a vehicle with a free joint, as a MuJoCo plugin: added mass in mjData.M, and the wrench of the
   water in qfrc_passive. The records of a vehicle are numbers of its MJCF; the kernels are machine code. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <mujoco/mujoco.h>

#include "water.h" /* sizes and places of the record */

int64_t uvms_mj_water(int64_t record, int64_t model, int64_t data);

static void put(unsigned char *record, size_t place, const void *pointer)
{
    int64_t address = (int64_t)(intptr_t)pointer;
    memcpy(record + place, &address, sizeof address);
}

/* Numbers of a text, at most so many; how many there are, or -1. */
static int numbers_of(const char *text, double *values, int most)
{
    int n = 0;
    for (char *end; *text; text = end) {
        double value = strtod(text, &end);
        if (end == text) {
            while (*text == ' ' || *text == '\n' || *text == '\t')
                text++;
            return *text ? -1 : n;
        }
        if (n == most)
            return -1;
        values[n++] = value;
    }
    return n;
}

/* FNV-1a of a text, 64 bits. */
static uint64_t sum(const char *text)
{
    uint64_t found = 0xcbf29ce484222325;
    for (; *text; text++)
        found = (found ^ (unsigned char)*text) * 0x100000001b3;
    return found;
}

static int fails(const char *said)
{
    mju_warning("uvms_mj water: %s", said);
    return -1;
}

static int nstate(const mjModel *m, int instance) { return 0; }

static int init(const mjModel *m, mjData *d, int instance)
{
    if (mj_version() != mjVERSION_HEADER)
        return fails("the library was made for another version of MuJoCo; export it again");
    int body = -1;
    for (int b = 1; b < m->nbody; b++)
        if (m->body_plugin[b] == instance)
            body = b;
    if (body < 0 || m->body_jntnum[body] != 1 || m->jnt_type[m->body_jntadr[body]] != mjJNT_FREE)
        return fails("the plugin belongs into a body with a free joint");
    if (m->body_simple[body])
        return fails("its body needs simple=\"false\"");
    int dof = m->body_dofadr[body], joints = 0;
    for (int i = dof + 6; i < m->nv && m->body_rootid[m->dof_bodyid[i]] == m->body_rootid[body]; i++)
        joints++;
    if (joints != JOINTS)
        return fails("the vehicle has another number of joints than the library");

    const char *text = mj_getPluginConfig(m, instance, "record");
    char *end = NULL;
    uint64_t given = text ? strtoull(text, &end, 16) : 0;
    if (!text || end != text + 16 || *end != ' ' || sum(end + 1) != given)
        return fails("the attribute record is of no exported vehicle; export it again");
    unsigned char *record = calloc(1, RECORD_BYTES);
    if (!record)
        return fails("no memory");
    for (text = end; *text; text = end) { /* place and number, in turn; the sum vouches for them */
        long place = strtol(text, &end, 10);
        double value = strtod(end, &end);
        memcpy(record + 8 * place, &value, sizeof value);
    }
    for (size_t i = 0; i < sizeof whole / sizeof *whole; i++) { /* whole numbers are exact as doubles */
        double value;
        memcpy(&value, record + whole[i], sizeof value);
        int64_t number = (int64_t)value;
        memcpy(record + whole[i], &number, sizeof number);
    }
    const char *current = mj_getPluginConfig(m, instance, "current");
    double v[3] = {0};
    if (current && *current && (numbers_of(current, v, 3) != 3 || !isfinite(v[0] + v[1] + v[2]))) {
        free(record);
        return fails("the attribute current must be three numbers [m/s]");
    }
    memcpy(record + CURRENT_MEAN, v, sizeof v);
    memcpy(record + CURRENT_NOW, v, sizeof v);
    memcpy(record + GRAVITY, m->opt.gravity, 3 * sizeof(double));

    int first = m->M_rowadr[dof];
    put(record, TIME_AT, &d->time);
    put(record, R_AT, d->xmat + 9 * body);
    put(record, QPOS_AT, d->qpos + m->jnt_qposadr[m->body_jntadr[body]]);
    put(record, QVEL_AT, d->qvel + dof);
    put(record, QACC_AT, d->qacc + dof);
    put(record, M_AT, d->M + first);
    put(record, PASSIVE_AT, d->qfrc_passive + dof);
    put(record, CTRL_AT, d->ctrl);
    for (int k = 1; k <= JOINTS; k++) {
        int64_t row = m->M_rowadr[dof + 5 + k] - first;
        memcpy(record + M_ROWS + 8 * k, &row, sizeof row);
    }
    d->plugin_data[instance] = (uintptr_t)record;
    return 0;
}

static void destroy(mjData *d, int instance)
{
    free((void *)d->plugin_data[instance]);
    d->plugin_data[instance] = 0;
}

/* The copy's M and qfrc_passive may have the water in them: it is noted in the record. The addresses are its own. */
static void copy(mjData *to, const mjModel *m, const mjData *from, int instance)
{
    unsigned char *ours = (void *)to->plugin_data[instance], *theirs = (void *)from->plugin_data[instance];
    unsigned char border[BORDER_BYTES];
    memcpy(border, ours + BORDER, BORDER_BYTES);
    memcpy(ours, theirs, RECORD_BYTES);
    memcpy(ours + BORDER, border, BORDER_BYTES);
}

static void reset(const mjModel *m, mjtNum *state, void *record, int instance) {}

static void compute(const mjModel *m, mjData *d, int instance, int capability)
{
    uvms_mj_water((int64_t)d->plugin_data[instance], (int64_t)(intptr_t)m, (int64_t)(intptr_t)d);
}

mjPLUGIN_LIB_INIT(uvms_mj_water)
{
    static const char *attributes[] = {"record", "current"};
    mjpPlugin plugin;
    int slot;
    if (mjp_getPlugin(NAME, &slot)) /* by another library with the same records */
        return;
    mjp_defaultPlugin(&plugin);
    plugin.name = NAME;
    plugin.nattribute = 2;
    plugin.attributes = attributes;
    plugin.capabilityflags = mjPLUGIN_PASSIVE;
    plugin.nstate = nstate;
    plugin.init = init;
    plugin.destroy = destroy;
    plugin.copy = copy;
    plugin.reset = reset;
    plugin.compute = compute;
    mjp_registerPlugin(&plugin);
}
