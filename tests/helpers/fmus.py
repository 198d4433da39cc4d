"""FMUs of FMI 2.0 for co-simulation, from C sources written here."""

import subprocess
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from uvms_mj.engine.native.tools import compiler

_SOURCE = """
#include <math.h>
#include <stddef.h>
#include <stdlib.h>

typedef struct { double r[COUNT]; double x[64]; } unit;
typedef void *instance;
static int instances;
static const struct {
    void (*log)(void *, const char *, int, const char *, const char *, ...);
    void *others[3], *environment;
} *called;

static void step(double *r, double *x, double t, double h)
{
BODY
}

static const double start[COUNT] = {START};

static void begin(unit *u)
{
    for (int i = 0; i < COUNT; i++)
        u->r[i] = start[i];
    for (int i = 0; i < 64; i++)
        u->x[i] = 0.0;
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
int fmi2SetDebugLogging(instance c, int on, size_t n, const char *const k[]) { return 0; }
instance fmi2Instantiate(const char *n, int type, const char *guid, const char *r, const void *f, int v, int l)
{
    if (instances++ > 0)
        return NULL; /* one instance in a library, as many tools make them */
    unit *u = malloc(sizeof(unit));
    called = f;
    begin(u);
    return u;
}
void fmi2FreeInstance(instance c) { free(c); instances--; }
int fmi2SetupExperiment(instance c, int d, double tol, double t, int e, double end) { return 0; }
int fmi2EnterInitializationMode(instance c) { return 0; }
int fmi2ExitInitializationMode(instance c) { return 0; }
int fmi2Terminate(instance c) { return 0; }
int fmi2Reset(instance c) { begin(c); return 0; }
int fmi2GetReal(instance c, const unsigned vr[], size_t n, double v[])
{
    for (size_t i = 0; i < n; i++)
        v[i] = ((unit *)c)->r[vr[i]];
    return 0;
}
int fmi2SetReal(instance c, const unsigned vr[], size_t n, const double v[])
{
    for (size_t i = 0; i < n; i++)
        ((unit *)c)->r[vr[i]] = v[i];
    return 0;
}
int fmi2DoStep(instance c, double t, double h, int last)
{
    unit *u = c;
    step(u->r, u->x, t, h);
    if (FAILS && called->log)
        called->log(called->environment, "unit", 3, "logStatusError", SAYS);
    return FAILS ? 3 : 0;
}
#define NOT(NAME) int NAME(void) { return 3; }
NOT(fmi2GetInteger) NOT(fmi2GetBoolean) NOT(fmi2GetString) NOT(fmi2SetInteger) NOT(fmi2SetBoolean) NOT(fmi2SetString)
NOT(fmi2GetFMUstate) NOT(fmi2SetFMUstate) NOT(fmi2FreeFMUstate) NOT(fmi2SerializedFMUstateSize)
NOT(fmi2SerializeFMUstate) NOT(fmi2DeSerializeFMUstate) NOT(fmi2GetDirectionalDerivative)
NOT(fmi2SetRealInputDerivatives) NOT(fmi2GetRealOutputDerivatives) NOT(fmi2CancelStep) NOT(fmi2GetStatus)
NOT(fmi2GetRealStatus) NOT(fmi2GetIntegerStatus) NOT(fmi2GetBooleanStatus) NOT(fmi2GetStringStatus)
"""


def description(
    name: str, parameters: Mapping[str, float], inputs: Sequence[str], outputs: Sequence[str],
    kind: str = "CoSimulation", version: str = "2.0", units: str = "", attributes: Mapping[str, str] | None = None,
    type_: str = "Real",
) -> str:  # fmt: skip
    """modelDescription.xml; ``units`` are its elements Unit, ``attributes`` those of the type of a variable by its
    name, and ``type_`` is the type of the parameters."""
    lines, more = [], {each: f" {given}" for each, given in (attributes or {}).items()}
    for each, start in parameters.items():
        reference = len(lines)
        lines.append(
            f'<ScalarVariable name="{each}" valueReference="{reference}" causality="parameter" variability="fixed">'
            f'<{type_} start="{start!r}"{more.get(each, "")}/></ScalarVariable>'
        )
    for causality, names in (("input", inputs), ("output", outputs)):
        for each in names:
            start = ' start="0.0"' if causality == "input" else ""
            lines.append(
                f'<ScalarVariable name="{each}" valueReference="{len(lines)}" causality="{causality}" '
                f'variability="continuous"><Real{start}{more.get(each, "")}/></ScalarVariable>'
            )
    first = len(parameters) + len(inputs) + 1
    steps = ' canHandleVariableCommunicationStepSize="true"' if kind == "CoSimulation" else ""
    unknowns = "".join(f'<Unknown index="{first + i}"/>' for i in range(len(outputs)))
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription fmiVersion="{version}" modelName="{name}" '
        f'guid="{{{name}}}"><{kind} modelIdentifier="{name}"{steps}/>'
        f"{f'<UnitDefinitions>{units}</UnitDefinitions>' if units else ''}"
        f"<ModelVariables>{''.join(lines)}</ModelVariables>"
        f"<ModelStructure><Outputs>{unknowns}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure>"
        "</fmiModelDescription>\n"
    )


def build(
    folder: Path, name: str, body: str, parameters: Mapping[str, float], inputs: Sequence[str], outputs: Sequence[str],
    fails: str = "0", beside: str = "", says: str = "", **given: Any,
) -> Path:  # fmt: skip
    """An FMU whose step runs ``body``, C with the numbers ``r``: parameters, inputs, outputs; ``x`` is its state, ``t``
    the time and ``h`` the step. ``says`` are the arguments of the logger, after the category, when a step fails.
    ``beside`` is the source of a library beside its own."""
    starts = [*parameters.values(), *[0.0] * (len(inputs) + len(outputs))]
    source = _SOURCE.replace("BODY", body).replace("COUNT", str(len(starts))).replace("FAILS", fails)
    source = source.replace("SAYS", says or '"failed"')
    source = source.replace("START", ", ".join(map(repr, starts)))
    (folder / f"{name}.c").write_text(source)
    library = folder / f"{name}.so"
    options = [
        "-shared",
        "-fPIC",
        "-O2",
        "-ffp-contract=off",
        "-w",
        "-o",
        str(library),
        str(folder / f"{name}.c"),
        "-lm",
    ]
    if beside:
        (folder / "beside.c").write_text(beside)
        subprocess.run([*compiler(), "-shared", "-fPIC", "-o", "libbeside.so", "beside.c"], check=True, cwd=folder)
        options += [f"-L{folder}", "-lbeside", "-Wl,-rpath,$ORIGIN"]
    subprocess.run([*compiler(), *options], check=True)
    path = folder / f"{name}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description(name, parameters, inputs, outputs, **given))
        for each in (library, *([folder / "libbeside.so"] if beside else [])):
            archive.write(each, f"binaries/linux64/{each.name}")
    return path
