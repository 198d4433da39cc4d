"""The texts of a law's library: its header, the shell of C with its numbers, and the test with its vectors."""

import dataclasses
import functools
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...control.base import PORT
from ...stages.foreign import is_c_name
from ..udp import LAYOUT, SIGNALS, STATUSES
from .as_law import SUFFIX, AsLaw
from .border import AIDS, LONGEST_GAP, PRESENT, Border, Entry
from .linking import MACHINES
from .vectors import Vectors

_HERE = Path(__file__).parent
_OF_NAME = re.compile(r"\bLAW\b|\bLAW_|\blaw_|(?<=\")law\.h(?=\")|ADAPTER")


def named(text: str, name: str) -> str:
    """A text of C with the name of a library in place of law_ and LAW_, and of LAW, the type."""
    words = {"LAW": name, "LAW_": f"{name.upper()}_", "law_": f"{name}_", "law.h": f"{name}.h"}
    words["ADAPTER"] = f"{name}{SUFFIX}"
    return _OF_NAME.sub(lambda found: words[found[0]], text)


@functools.cache
def is_free(word: str) -> bool:
    """Whether a word may name a library: a name in C that neither its sources nor its files have."""
    sources = "".join(_read(name) for name in ("shell.c", "as_law.c", "test.c", "loop.c"))
    code = re.sub(r"/\*.*?\*/", " ", sources, flags=re.DOTALL)  # without comments
    return is_c_name(word) and word not in re.findall(r"\w+", f"law scenario {code}")


def _fields(entries: Iterable[Entry]) -> Iterable[str]:
    for each in entries:
        shape = "".join(f"[{n}]" for n in each.shape)
        unit = f"[{each.unit}] " if each.unit and each.unit != "-" else ""
        note = f"{unit}{each.meaning}".replace("*/", "* /")
        yield f"    double {each.word}{shape};".ljust(36) + f" /* {note} */"


def _filter_period(border: Border) -> str:
    """A line of the header on the filter in the library."""
    if border.chain.filter is None:
        return ""
    period = float(border.chain.filter.compiled.settings["interval"][0])
    return f"#define LAW_INERTIAL_PERIOD {period!r} /* [s] from one sample of the inertial unit to the next */\n"


def _struct(name: str, lines: Iterable[str]) -> str:
    body = "\n".join(lines)
    return f"typedef struct {name} {{\n{body}\n}} {name};\n"


def header(border: Border, name: str, about: str) -> str:
    """The header of a library in C99 and C++: ``about`` is a sentence on its law and scenario."""
    bits = {group: 1 << k for k, group in enumerate(PRESENT)}
    groups = border.groups
    of_group = {group: ", ".join(e.name for e in border.measured if e.group == group) for group in groups}
    flags = "\n".join(f"#define LAW_{g.upper()} {bits[g]} /* {of_group[g]} */" for g in groups)
    statuses = "\n".join(
        f"#define LAW_{word} {'(' if n < 0 else ''}{n}{')' if n < 0 else ''} /* {said} */"
        for word, (n, said) in STATUSES.items()
    )
    guided = not border.reference
    time = "    double t;".ljust(36) + " /* [s] time of the measurements, after the time of the last call */"
    present = "    uint64_t present;".ljust(36) + " /* which of them are there: the sum of the constants above */"
    saturated = "    uint64_t saturated;".ljust(36) + " /* 1 if a thrust is at its limit */"
    structs = [
        _struct("law_measured", [time, present, *_fields(border.measured)]),
        *([] if guided else [_struct("law_reference", _fields(border.reference))]),
        _struct("law_settings", _fields(border.settings) if border.settings else ["    double unused;"]),
        _struct("law_command", [*_fields(border.command), saturated]),
    ]
    neutral = [
        f"        command->{e.name}[k] = {border.neutral!r};"
        for e in border.command
        if e.name in ("pwm", "thruster_cmd")
    ]
    m = border.chain.thrusters
    text = _HEADER
    for word, value in {
        "ABOUT": about,
        "LAYOUT_NUMBER": f"UINT64_C({border.layout})",
        "RECORD_NUMBERS": str(border.chain.kind.itemsize // 8),
        "PERIOD_S": repr(border.chain.period),
        "GAP_PERIODS": str(LONGEST_GAP),
        "THRUSTER_COUNT": str(m),
        "IS_GUIDED": str(int(guided)),
        "FLAGS": flags,
        "NEEDED_FLAGS": " | ".join(f"LAW_{g.upper()}" for g in border.needed) or "0",
        "FILTER_PERIOD": _filter_period(border),
        "STATUSES": statuses,
        "STRUCTS": "\n".join(structs),
        "NEUTRAL_PULSES": "".join(f"\n    for (k = 0; k < LAW_THRUSTERS; k++)\n{line}" for line in neutral),
        "REFERENCE_PARAMETER": "" if guided else "const law_reference *reference, ",
        "REFERENCE_GIVEN": "" if guided else "reference, ",
    }.items():
        text = text.replace(f"@{word}@", value)
    return named(text, name)


_HEADER = """/* @ABOUT@

   Lengths in m, forces in N, angles in rad, times in s. W is the world with z up, B the body: forward, left, up.
   C99 and C++. No memory is allocated, and nothing is kept beside the instance: several may run in several threads. */
#ifndef LAW_H
#define LAW_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define LAW_LAYOUT @LAYOUT_NUMBER@ /* of these structs: another library has another number */
#define LAW_PERIOD @PERIOD_S@ /* [s] from one call of law_step to the next */
#define LAW_LONGEST_GAP @GAP_PERIODS@ /* periods after which a call is refused once */
#define LAW_THRUSTERS @THRUSTER_COUNT@
#define LAW_GUIDED @IS_GUIDED@ /* 1: the reference is in the library; 0: it is given to law_step */
#define LAW_NUMBERS @RECORD_NUMBERS@

/* what is measured, bits of law_measured.present */
@FLAGS@
#define LAW_NEEDED (@NEEDED_FLAGS@) /* in each call */
@FILTER_PERIOD@
/* what the functions return; below zero the command is neutral: no thrust */
@STATUSES@

/* One controller. Its fields are not yours. */
typedef struct LAW {
    uint64_t mark;
    double last;
    uint64_t begun, fault;
    double first;
    double record[LAW_NUMBERS];
} LAW;

@STRUCTS@
int law_init_of(uint64_t layout, LAW *self);
int law_set_of(uint64_t layout, LAW *self, const law_settings *settings);
int law_step_of(uint64_t layout, LAW *self, const law_measured *measured, @REFERENCE_PARAMETER@law_command *command);

/* Begin again, with the settings in hand. */
int law_reset(LAW *self);
/* The settings in hand. */
int law_get(const LAW *self, law_settings *settings);
/* A status in words. */
const char *law_text(int status);
double law_period(void);
uint64_t law_bytes(void);
/* The number of this export, by which a run knows it. */
uint64_t law_export(void);

/* Make a command neutral: no thrust. */
static inline void law_neutral(law_command *command)
{
    unsigned k;
    double *numbers = (double *)command;
    for (k = 0; k < sizeof *command / sizeof *numbers; k++)
        numbers[k] = 0.0;@NEUTRAL_PULSES@
    command->saturated = 0;
}

/* Begin, with the settings of the scenario. Call it first, once. */
static inline int law_init(LAW *self)
{
    return law_init_of(LAW_LAYOUT, self);
}

/* Change settings, at any time after init. They keep their values at a reset. */
static inline int law_set(LAW *self, const law_settings *settings)
{
    return law_set_of(LAW_LAYOUT, self, settings);
}

/* Take one period: the command for measurements. Call it each LAW_PERIOD. */
static inline int law_step(LAW *self, const law_measured *measured, @REFERENCE_PARAMETER@law_command *command)
{
    if (command)
        law_neutral(command);
    return law_step_of(LAW_LAYOUT, self, measured, @REFERENCE_GIVEN@command);
}

#ifdef __cplusplus
}
#endif

#endif
"""


def _table(name: str, entries: Sequence[Entry]) -> str:
    rows = ", ".join(f"{{{e.place}, {e.n}}}" for e in entries) or "{0, 0}"
    return f"static const struct {{\n    int place, n;\n}} {name}[] = {{{rows}}};\n"


def _bit(group: str) -> int:
    return 1 << PRESENT.index(group)


def _measured_table(border: Border) -> str:
    """The places of the measurements with the bit of their group."""
    rows = ", ".join(f"{{{e.place}, {e.n}, {_bit(e.group)}}}" for e in border.measured)
    return f"static const struct {{\n    int place, n, bit;\n}} measured_at[] = {{{rows}}};\n"


def _filter_table(border: Border) -> str:
    """The places of what the filter is told of its samples."""
    chain, flags = border.chain, border.flags
    if not flags:
        return ""
    aids = sum(_bit(group) for group in flags if group in AIDS)
    rows = ", ".join(f"{{{place}, {_bit(group)}}}" for group, place in flags.items())
    return (
        f"#define SAMPLED {chain.place_of('sampled')}\n#define FILTERING {chain.place_of('filtering')}\n"
        f"#define AIDS {aids}\n"
        f"static const struct {{\n    int place, bit;\n}} flags_at[] = {{{rows}}};\n"
    )


def _words(values: np.ndarray) -> str:
    """64-bit words, eight a line."""
    return _line(values.size) % tuple(values.tolist())


@functools.cache
def _line(n: int) -> str:
    """The format of n words: to format one after the other takes twice as long."""
    words = ["0x%xu"] * n
    return ",\n".join(",".join(words[k : k + 8]) for k in range(0, n, 8))


def image(border: Border, name: str, export: int) -> str:
    """The numbers of the shell: the export's own, places of what is exchanged, and the record before the first
    period."""
    chain = border.chain
    parts = [
        f"#define MARK UINT64_C(0x{border.mark:x})\n#define EXPORT UINT64_C({export})\n",
        f"#define TIME {chain.place_of('t')}\n#define SATURATED {chain.place_of('saturated')}\n",
        f"#define TAU_HAT {chain.place_of('signals', 'tau_hat')}\n",
        _measured_table(border),
        _filter_table(border),
        _table("reference_at", border.reference) if border.reference else "",
        _table("settings_at", border.settings),
        _table("command_at", border.command),
        f"static const uint64_t constants[] = {{{_words(np.frombuffer(chain.constants or bytes(8), '<u8'))}}};\n",
        *_runs(chain.image.view("<u8")),
    ]
    return named("".join(parts), name)


def _runs(words: np.ndarray) -> Iterable[str]:
    """The record before the first period as runs of equal words."""
    starts = np.flatnonzero(np.concatenate([[True], words[1:] != words[:-1]]))
    lengths = np.diff(np.append(starts, len(words)))
    yield f"#define IMAGE_RUNS {len(starts)}\n"
    yield f"static const uint64_t image[IMAGE_RUNS] = {{\n{_words(words[starts])}}};\n"
    yield f"static const unsigned image_lengths[IMAGE_RUNS] = {{{', '.join(map(str, lengths.tolist()))}}};\n"


def as_law(border: Border, law: AsLaw) -> dict[str, str]:
    """The library as a law of a run, in C: its numbers and its function."""
    numbers = ", ".join(f"UINT64_C({each})" for each in law.numbers)
    parts = [f"#define RECORDS {numbers}\n#define GAINS {sum(e.n for e in law.gains)}\n"]
    for table, entries in (
        ("measured_in", border.measured),
        ("reference_in", border.reference),
        ("impedance_in", law.impedance),
    ):
        moved = [dataclasses.replace(each, place=law.place(each)) for each in entries]
        parts.append(_table(table, moved) if moved or table == "impedance_in" else "")
    return {"as_law.h": "".join(parts), "as_law.c": named(_read("as_law.c"), law.name.removesuffix(SUFFIX))}


@functools.cache
def _read(file: str) -> str:
    return (_HERE / file).read_text(encoding="utf-8")


def shell(name: str) -> str:
    """The functions of a library."""
    texts = "".join(f'    case LAW_{word}:\n        return "{said}";\n' for word, (_, said) in STATUSES.items())
    return named(_read("shell.c").replace("TEXTS", texts), name)


def test(name: str) -> str:
    """The program that compares a library with the recorded steps."""
    return named(_read("test.c"), name)


def loop(border: Border, name: str, asked: bool) -> str:
    """The program that answers frames of measurements over UDP or a serial line, and a run over UDP if one can ask;
    otherwise a request has no measurements for it."""
    fields: Any = SIGNALS.fields

    def taken(entries: Iterable[Entry], struct: str) -> str:
        places = ((each, fields[each.name][1] // 8) for each in entries)
        return "".join(
            f"    take({'' if each.shape else '&'}{struct}.{each.name}, request, {place}, {each.n});\n"
            for each, place in places
        )

    measured = border.measured if asked else ()
    text = _read("loop.c")
    for word, value in {
        "LAYOUT_OF_SIGNALS": str(LAYOUT),
        "SIGNALS_COUNT": str(SIGNALS.itemsize // 8),
        "STANDARD_PORT": str(PORT),
        "REFERENCE_STRUCT": "    law_reference reference;\n" if border.reference else "",
        "REFERENCE_ARGUMENT": "&reference, " if border.reference else "",
        "FRAME_ARGUMENT": "&given.reference, " if border.reference else "",
        "SETTINGS": taken((each for each in border.settings if each.name in fields), "settings"),
        "PRESENT_IN_A_REQUEST": "LAW_NEEDED" if asked else "0",
        "MEASUREDREFERENCE": taken(measured, "measured") + taken(border.reference, "reference"),
    }.items():
        text = re.sub(rf"\b{word}" if word != "REFERENCE_ARGUMENT" else word, value, text)
    return named(text.replace("libLAW", f"lib{name}"), name)


_SEGMENT = np.dtype(
    [("name", "S24"), ("last", "f8"), *((name, "i4") for name in ("begun", "first", "steps", "change", "changes", "_"))]
)
"""A segment in :func:`told`."""


def _segments(vectors: Vectors) -> Iterator[tuple[str, float, int, int, int, int, int]]:
    """Name, last, begun, first row, number of rows, first change and number of changes of each segment."""
    first = before = 0
    for each in vectors.segments:
        yield each.name, each.last, int(each.begun), first, len(each.rows), before, len(each.changes)
        first, before = first + len(each.rows), before + len(each.changes)


def _command_names(border: Border) -> str:
    names = [f"{e.name}[{i}]" if e.shape else e.name for e in border.command for i in range(e.n)] + ["saturated"]
    quoted = ", ".join(f'"{each}"' for each in names)
    return f"static const char *const command_names[] = {{{quoted}}};"


def vectors_apart(border: Border, file: str) -> str:
    """As :func:`vectors_text`, for a program that is linked with a file of :func:`told`: it is compiled before the run
    is recorded, and a compiler takes longer to read the steps than to compile the test."""
    words = 3 + sum(each.n for each in (*border.measured, *border.reference, *border.command))
    return f"""extern const uint64_t told[] __asm__("_binary_{file}_start");
#define SEGMENTS ((int)told[0])
#define STEPS ((int)told[1])
#define CHANGES ((int)told[2])
struct segment {{
    char name[24];
    double last;
    int begun, first, steps, change, changes, none;
}};
#define segments ((const struct segment *)(const void *)(told + 3))
#define change_at ((const uint64_t *)(const void *)(segments + SEGMENTS))
#define change_to (change_at + CHANGES)
#define rows ((const uint64_t(*)[{words}])(const void *)(change_to + CHANGES))
{_command_names(border)}
"""


def told(vectors: Vectors) -> bytes:
    """The recorded steps in memory, for :func:`vectors_apart`."""
    changes = np.array([change for each in vectors.segments for change in each.changes], np.uint64).reshape(-1, 2)
    segments = np.array([(*each, 0) for each in _segments(vectors)], _SEGMENT)
    sizes = np.array([len(segments), vectors.steps, len(changes)], np.uint64)
    rows = [each.rows for each in vectors.segments]
    return b"".join(each.tobytes() for each in (sizes, segments, changes.T, *rows))


def vectors_text(border: Border, vectors: Vectors, name: str) -> str:
    """The recorded steps, for the test."""
    changes = [change for each in vectors.segments for change in each.changes]
    segments = [f'{{"{each[0]}", {", ".join(map(repr, each[1:]))}}}' for each in _segments(vectors)]
    places = ", ".join(str(place) for place, _ in changes) or "0"
    values = _words(np.array([value for _, value in changes] or [0], np.uint64))
    rows = np.concatenate([each.rows for each in vectors.segments])
    text = f"""/* Recorded steps of {vectors.about}. */
#define SEGMENTS {len(segments)}
#define STEPS {len(rows)}
#define CHANGES {max(1, len(changes))}
static const struct {{
    const char *name;
    double last;
    int begun, first, steps, change, changes;
}} segments[SEGMENTS] = {{{", ".join(segments)}}};
static const int change_at[CHANGES] = {{{places}}};
static const uint64_t change_to[CHANGES] = {{{values}}};
{_command_names(border)}
/* time and measurements, {"reference, " if border.reference else ""}command */
"""
    kind = f"const uint64_t rows[STEPS][{rows.shape[1]}]"
    return f"{named(text, name)}static {kind} = {{\n{','.join([f'{{{_words(row)}}}' for row in rows])}}};\n"


def left_behind(border: Border) -> Iterable[str]:
    """The parts of the scenario that are not in the library, and their substitutes: a sentence for each."""
    filters = [each for each in border.chain.left if each.startswith("navigation ")]
    others = [each for each in border.chain.left if each not in filters]
    if others:
        yield f"not in the library, which takes your measurements and gives commands: {', '.join(others)}"
    for each in filters:
        given = ", ".join(entry.word for entry in border.measured if entry.group in ("pose", "velocity"))
        yield (
            f"not in the library: {each}; {given} must be the estimate of the vehicle's own filter, and the recorded "
            "steps have the run's"
        )


def _programs(program: str, name: str, targets: Sequence[str], end: str = "") -> str:
    """Lines of a shell that compile test.c or loop.c and run it: on each target itself, and on another machine."""
    lines = []
    for target in targets:
        made = f"-std=c99 {program}.c {target}/lib{name}.a -o {program} &&"
        if MACHINES[target].shared:
            lines += [f"# {target}: on the target itself", f"cc {made} ./{program}{end}"]
        machine = MACHINES[target]
        lines += [
            f"# {target}: on another machine",
            f"{machine.compiler} {made} qemu-{machine.emulator} ./{program}{end}",
        ]
    return "\n".join(lines)


_SAMPLES = """
if (first) measured.present |= LAW_START;       /* the first estimate, once; from then on: */
if (new_imu) measured.present |= LAW_INERTIAL;  /* and the other sensors when they have a new sample */"""
_ESTIMATE = """
The Kalman filter is in the library. Its first estimate comes with `LAW_START`, in the first call and after a reset. A
sample of the inertial unit is due each LAW_INERTIAL_PERIOD; `interval` is the time since the last one that was taken,
so that it covers lost ones. The other sensors come when they come, and one that is not finite is left out
(`LAW_LEFT_OUT`). All sensors are at B's origin. The command has the estimate.
"""


def readme(
    border: Border,
    name: str,
    title: str,
    rows: Sequence[Sequence[str]],
    made: Sequence[str],
    bits: str,
    again: Sequence[str],
    asked: int,
    adapter: int,
) -> str:
    """The page beside a library. ``rows`` are the rows of the table of targets; ``again`` are the targets whose
    library can be a law of a run; ``asked`` is the number of the export, if a run can ask loop.c;
    ``adapter`` are the bytes at most of the object by which a run takes the library as its law."""
    chain = border.chain
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    given = ", ".join(f"`{each.name}`" for each in border.measured)
    samples = "" if chain.filter is None else _SAMPLES
    estimate = "" if chain.filter is None else _ESTIMATE
    stages = ", ".join(link.name for link in chain.links)
    guidance = (
        "The reference comes from the scenario's guidance."
        if not border.reference
        else ("You give the reference to each call, as `law_reference`.")
    )
    reference = "" if not border.reference else "&reference, "
    left = "".join(f"{sentence[0].upper()}{sentence[1:]}. " for sentence in left_behind(border))
    law = ""
    targets = [row[0] for row in rows]
    if again:
        of = "x86_64" if "x86_64" in again else again[0]
        run = f"uvms-mj run scenario.toml --controller {of}/lib{name}.so:{name}{SUFFIX}"
        law = f"As a law of uvms-mj on {of} it gives the run again:\n\n```sh\n{run}\n```\n\n"
    bare = (
        """
Without an operating system, build `test.c` as a part of your program, with its compiler and its `printf`.
"""
        if any(not MACHINES[each].shared for each in targets)
        else ""
    )
    apart = (
        f"""
`{name}{SUFFIX}`, by which uvms-mj takes the library as a law, is an object of its own of at most {adapter} bytes, which
are in no column: a program that does not call it does not carry it."""
        if adapter
        else ""
    )
    if asked:
        loops = _programs("loop", name, [each for each in targets if MACHINES[each].shared], " &")
        run = f"uvms-mj run scenario.toml --controller udp controller.export={asked}"
        law += f"""The processor in the loop with the plant gives the run again, too. `loop.c` answers over UDP on its
own machine; choose one line. The run knows this export by its number:

```sh
{loops}
{run}
```

On the vehicle it takes frames of measurements, on that port or on a serial line: `./loop /dev/ttyAMA0 115200`. The
head of `loop.c` has their layout.

"""
    elif any(MACHINES[each].shared for each in targets):
        law += """`loop.c` takes frames of measurements, over UDP on its own machine or on a serial line:
`./loop /dev/ttyAMA0 115200`. Its head has their layout. A run can't ask the program for its commands.

"""
    return named(
        f"""# {name}: {title}

One control system as a library in C99 and C++17, for the processor of a vehicle: from measurements to the thrust of
each thruster{" and the pulse of its speed controller" if border.neutral is not None else ""}. Its stages are {stages}:
the machine code of the run. {left}{guidance} {bits}

| target | code | constants | record | stack | takes from the program |
|---|---|---|---|---|---|
{table}

The record is the memory of one controller; you give it. Nothing is allocated, and nothing is kept beside it. The stack
is for a call of `law_step`. The last column has the functions that a C library, or the compiler's own one, has.{apart}

## Use

```c
#include "{name}.h"
static LAW controller;                    /* {name}_init(&controller) before the first step */
law_measured measured = {{0}};
law_command command;
measured.t = now;                         /* [s] */
measured.present = LAW_NEEDED;            /* leave a bit out where a sensor has no new sample */
/* fill {given} */{samples}
int status = law_step(&controller, &measured, {reference}&command);
if (status < 0)                           /* the command is neutral: no thrust */
    report(law_text(status));
```

Call it each {chain.period:g} s. A call that comes late says so (`LAW_LATE`); after {LONGEST_GAP} periods one call is
refused. `law_reset` begins anew, `law_set` changes gains, and each function returns a status.
{estimate}
## Test

`cc` is the target's own compiler. On another machine ziglang makes a program that can be copied there; its first one
for a target takes half a minute. Choose one line:

```sh
{_programs("test", name, targets)}
```
{bare}
It compares {made[0]} recorded steps of {made[1]}, bit for bit, and names the first number and the bit that differs.
Its status is 0 if all are equal.
{made[2]}

{law}## What is not promised

The simulation has the same numbers for the same measurements. You have to show that the law is stable on
your vehicle, with your sensors and thrusters. There is no certification, no real-time operating system and no watchdog.
If the program stops, so must the thrusters: give each pulse a time after which it is neutral.

Apache License 2.0, see LICENSE. `{name}.toml` has the scenario, the gains and the digests; `scenario.toml` has
the scenario alone.
""",
        name,
    )
