"""Pages of the reference that come from the tables of the program: keys, signals, metrics, stages, commands, topics."""

import contextlib
import dataclasses
import io
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from uvms_mj import simulate
from uvms_mj.cli import main as uvms_mj
from uvms_mj.cli.common import Listing
from uvms_mj.cli.listing import (
    key_list,
    metric_list,
    recorded_signals,
    shipped_stages,
    signal_list,
    stage_list,
    stage_signals,
    toml_value,
)
from uvms_mj.records.mcap import topics
from uvms_mj.records.mcap.layout import Format
from uvms_mj.reproduce.bench import page as bench_page
from uvms_mj.reproduce.bench import results
from uvms_mj.reproduce.bench.task import tasks
from uvms_mj.scenario import STAGES, Scenario
from uvms_mj.stages import signals
from uvms_mj.studies.plan import file as study_file
from uvms_mj.studies.tune import problem as tune_tables

NAMES = ("keys", "signals", "stages", "metrics", "study_keys", "environment", "commands", "topics", "bench_tasks")
"""The pages, without suffix. None of them is in the repository."""


def write(folder: Path) -> None:
    """Write the pages into a folder. A page that is there with the same text is left alone."""
    for name in NAMES:
        file, text = folder / f"{name}.md", globals()[f"_{name}"]()
        if not file.exists() or file.read_text() != text:
            file.write_text(text)


def _keys() -> str:
    """The keys of a scenario by table."""
    listed = key_list()
    parts = [
        "# Keys of a scenario",
        "A scenario is a TOML file of tables. `uvms-mj keys` prints this list, and `uvms-mj keys wall` a part of it. A "
        "key is set in the file, by `--set wall.stiffness=2e4` on the command line, or in Python by "
        '`Scenario.load("push_wall", {"wall.stiffness": 2e4})`. Units are SI. [](stages.md) describes the stages.',
    ]
    for table in dict.fromkeys(key.partition(".")[0] for key, *_ in listed.rows):
        rows = [row for row in listed.rows if row[0].partition(".")[0] == table]
        parts += [f"## {table}", _table(listed.columns, rows)]
    return _page(parts)


def _signals() -> str:
    """The groups of signals that stages are given, and the signals that a run records."""
    parts = [
        "# Signals",
        "Signals that the stages of a run are given and set, by group, and signals that a run records. `uvms-mj "
        "signals` prints them. Units are SI; W is the world with x towards the wall and z up, B the body with x "
        "forward, y left and z up. [](stage.md) lists the groups that each stage is given.",
    ]
    groups: Mapping[str, Sequence[signals.Signal]] = {
        name: getattr(signals, name)
        for name in ("CLOCK", "MEASURED", "TRUE", "REFERENCE", "ERRORS", "ESTIMATES", "APPLIED", "IMPEDANCE", "TASK")
    }
    for name, group in groups.items():
        parts += [f"## {name}", GROUPS[name], _listed(signal_list(name, group))]
    clock = {signal.name for signal in signals.CLOCK}
    for name, table in OWN_GROUPS.items():
        given = stage_signals(table)[0]
        known = clock | ({"tau_cmd"} if table == "actuation" else set())
        parts += [f"## {name}", GROUPS[name], _table(given.columns, [row for row in given.rows if row[0] not in known])]
    parts += ["## TRUTH", GROUPS["TRUTH"], _listed(signal_list("TRUTH", signals.TRUTH))]
    for listed, heading in zip(recorded_signals(), ("Recorded signals", "Bands"), strict=True):
        text = re.sub(r"trace\.(band\()?<name>\)?", r"``\g<0>``", listed.title.partition(": ")[2])
        said = f"Read by {text}" if text.startswith("``") else text[0].upper() + text[1:]
        parts += [f"## {heading}", f"{_code(said)}.", _listed(listed)]
    return _page(parts)


OWN_GROUPS = {
    "ALLOCATION": "actuation",
    "COMMANDS": "thrusters",
    "JOINTS": "joints",
    "ENCODER": "encoder",
    "WRIST": "wrist",
}
"""Groups of one stage only, besides CLOCK, with its table of a scenario."""
GROUPS = {
    "CLOCK": "Given to every stage.",
    "MEASURED": "The measurements, set by the sensors (navigation).",
    "TRUE": "Given to the sensors: the truth of the instant. `nu_dot` and `tau` belong to the last step.",
    "REFERENCE": "The desired motion, set by guidance.",
    "ERRORS": "Measurement minus reference.",
    "ESTIMATES": "The controller's model of the vehicle.",
    "APPLIED": "The thrust that the controller believes to have acted since the last step; zero before the first one.",
    "IMPEDANCE": "The desired impedance of the scenario.",
    "TASK": "Set by the impedance task, for laws that use it.",
    "ALLOCATION": "Given to the actuation of a vehicle with n thrusters, besides `tau_cmd`.",
    "COMMANDS": "Given to the model of the thrusters behind the allocation.",
    "JOINTS": "Given to the interface of the joints' motors.",
    "ENCODER": "Given to the encoder of the joints.",
    "WRIST": "Given to the force and torque sensor in the arm.",
    "TRUTH": "Given to the yardsticks only: `ideal`, eq. (13), `ideal_admittance` and `ideal_parallel`.",
}


def _stages() -> str:
    """The shipped stages with their settings."""
    parts = [
        "# Stages that ship",
        "Laws, references, sensors and thrusters with their settings, by the table of the scenario that chooses them. "
        "`uvms-mj stages` prints this list, and `uvms-mj stages gsta t200` a part of it. [](stage.md) is the contract "
        "of a stage of your own.",
    ]
    for table, choice in STAGES.items():
        common = {field.name for field in choice.base.setting_fields()}
        parts += [f"## {table}", f"`{table}.name` chooses the {choice.base.room.noun}."]
        parts += [f"All of them have `{'`, `'.join(sorted(common))}`."] if common else []
        for stage in shipped_stages(choice).values():
            listed = stage_list(stage)
            name, _, summary = listed.title.partition(": ")
            own = [row for row in listed.rows if row[0] not in common]
            parts += [f"### {name}", _code(summary)]
            parts += [_table(listed.columns, own)] if own else []
            parts += [f"{_code(note[0].upper() + note[1:])}." for note in listed.notes]
    return _page(parts)


def _metrics() -> str:
    return _page(
        [
            "# Metrics",
            "Numbers of a run that a study keeps: the names in `keep.metrics` and `[success]` of a study, and in "
            "`[objective]` and `[[constraint]]` of a tuning. `uvms-mj metrics` prints them. A vector is kept whole; "
            "`success`, `constraint` and `objective` take one of its components, `final.position_m.x`. A metric of "
            "your own is a function, `path/to/file.py:function`.",
            _listed(metric_list()),
        ]
    )


def _study_keys() -> str:
    """The tables of a study file and of a tuning file."""
    parts = [
        "# Keys of studies and tunings",
        "A study file is TOML. Its base is a scenario, and its tables say which keys vary, how the draws are made, and "
        "which numbers are kept. A tuning file is a study file of one law with four more tables. See "
        "[](../how_to/study.md) and [](../how_to/tune.md).",
    ]
    tables = study_file.TABLES | {name: (part,) for name, part in tune_tables.TABLES.items()}
    headings = {"": ["At the top"], "gain": ["[[gain]]"], "constraint": ["[[constraint]]"]}
    headings["vary"] = ["[[vary]] with values", "[[vary]] as a grid", "[[vary]] with a distribution"]
    for name, kinds in tables.items():
        for heading, part in zip(headings.get(name, [f"[{name}]"]), kinds, strict=True):
            fields = [field for field in dataclasses.fields(part) if field.name not in tables]
            rows = [(field.name, _default(field), field.metadata.get("meaning", "")) for field in fields]
            parts += [f"## {heading}", _table(("key", "default", "meaning"), rows)]
    return _page(parts)


def _environment() -> str:
    """The task as an environment, from the docstrings of its modules and of their classes."""
    return _page(
        [
            "# The environment",
            'Keyword arguments of `gymnasium.make("uvms_mj/PushWall-v0", ...)`, of '
            '`gymnasium.make_vec("uvms_mj/PushWall-v0", n, ...)` and of `uvms_mj.envs.load("push_wall", ...)`; '
            "`uvms_mj.envs.PushWorld` is of several vehicles. "
            "[](../how_to/learn.md) shows them at work.",
            "```{eval-rst}\n.. automodule:: uvms_mj.envs.push\n   :no-members:",
            ".. autoclass:: uvms_mj.envs.push.Pushes",
            ".. autoclass:: uvms_mj.envs.Seen",
            ".. automodule:: uvms_mj.envs.domain\n   :no-members:",
            ".. autoclass:: uvms_mj.envs.gym.PushWall",
            ".. autoclass:: uvms_mj.envs.gym.PushWallVec",
            ".. autoclass:: uvms_mj.envs.PushWorld\n   :members: reset, step\n```",
        ]
    )


def _default(field: dataclasses.Field) -> str:
    value = field.default_factory() if field.default_factory is not dataclasses.MISSING else field.default
    if dataclasses.is_dataclass(value):  # the logs that are kept, whose word is their kind
        value = getattr(value, "kind", "")
    return "required" if value is dataclasses.MISSING else toml_value(value)


def _commands() -> str:
    """The help of every command."""
    parts = [
        "# Commands",
        "Each command explains itself with `--help`, as below. Exit status 0 is success, 2 an error in the input or a "
        "run that failed.",
    ]
    context = click.Context(uvms_mj, info_name="uvms-mj", max_content_width=100, terminal_width=100)
    for name, command in sorted(_every(uvms_mj, context, ())):
        parts += [f"## uvms-mj {name}", f"```text\n{command}\n```"]
    return _page(parts)


def _every(group: Any, context: click.Context, before: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    """The commands of a group and of the groups in it, with their help."""
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        within = click.Context(command, info_name=name, parent=context, max_content_width=100, terminal_width=100)
        yield " ".join((*before, name)), command.get_help(within)
        if isinstance(command, click.Group):
            yield from _every(command, within, (*before, name))


def _topics() -> str:
    """The topics of the logs of four short runs, which together have every kind of topic."""
    runs = {
        "Every run": ("push_wall", {}),
        "A current that is not constant, real thrusters, sensors with errors": (
            "push_wall_gusts",
            {"thrusters.name": "t200", "navigation.name": "sensors", "controller.delay": 1e-3},
        ),
        "Further walls, contact bodies": ("press_pile", {}),
        "A vehicle with an arm and a tool": ("tool_push", {}),
    }
    parts = [
        "# Topics of a log",
        "A log is an MCAP file of ROS 2 messages. [](log.md) describes the file; here is every topic. Rows are written "
        "at the log rate, 1 kHz by default, arrows 20 times a second, and constants once at the start.",
    ]
    known: set[str] = set()
    for heading, (scenario, changes) in runs.items():
        with warnings.catch_warnings(), contextlib.redirect_stderr(io.StringIO()):
            warnings.simplefilter("ignore")  # such a run is too short to say anything about its loop
            header = simulate(Scenario.load(scenario, changes | {"simulation.duration": 0.01})).header
        once, arrows = {topic.name for topic in topics.once(header)[0]}, topics.arrows().name
        rows = []
        for topic in Format(header).topics:
            if topic.name not in known:
                written = "once" if topic.name in once else "20 Hz" if topic.name == arrows else "row"
                rows.append((topic.name, written, topic.type, topic.frame, topic.unit, topic.meaning))
                known.add(topic.name)
        parts += [f"## {heading}", _table(("topic", "written", "type", "frame", "unit", "meaning"), rows)]
    parts.append(
        "A state of a law is on `/law/` with its name, `/law/z` of GSTA, and a state of another stage on `/signals/`."
    )
    return _page(parts)


def _bench_tasks() -> str:
    """The tasks of the benchmark, with the results of the shipped laws."""
    found = results.shipped()
    parts = [
        "# Tasks of Contact-10",
        "The ten tasks of [](../evidence/contact10.md): why each is there, its levels, what passes a draw, and how the "
        f"shipped laws fare, on {bench_page.drawn(found)}. `uvms-mj bench tasks` prints the tasks, and `uvms-mj bench` "
        "runs them. The numbers are of the level that a law holds, or of level 1. *Never* stands for a number that most"
        " draws lack, or that the worst one lacks.",
    ]
    for task in tasks().values():
        if (found["tasks"][task.name]["version"], found["tasks"][task.name]["digest"]) != (task.version, task.digest):
            raise ValueError(f"the shipped result has another {task.name}: run scripts/draw_docs.py contact10")
        bounds = [
            (f"`{name}`", bench_page.bounds(name, limit), task.why[name]) for name, limit in task.criteria.items()
        ]
        entries = [*task.tables.get("vary", ()), *task.tables["levels"].get("vary", ())]
        drawn = [entry.get("key") or ", ".join(entry["keys"]) for entry in entries]
        law = bench_page.table(found, task)
        parts += [
            f"## {task.number}. {task.name}",
            f"*{task.title}.* {task.reason}",
            "- " + "\n- ".join(task.literature),
            f"Version {task.version}. Each draw has its own `{'`, `'.join(drawn)}`.",
            _table(("level", "difficulty"), [(str(i), text) for i, text in enumerate(task.levels, 1)]),
            "A draw is passed if the run completes and meets:",
            _table(("metric", "bounds", "why"), bounds),
            *_halves((law.corner, *law.heads), [(name, *map(str, cells)) for name, cells in law.rows]),
            *([f"`ideal`: {task.truth}"] if task.truth else []),
        ]
    return _page(parts)


def _halves(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """The numbers of the laws, and then the bounds that each of them is near to or fails by, in words."""
    numbers = len(columns) - 2
    yield _table(columns[:numbers], [row[:numbers] for row in rows])
    yield "Share of the bounds that a law needs, and what it fails by at the next level:"
    yield _table((columns[0], *columns[numbers:]), [(row[0], *row[numbers:]) for row in rows])


def _page(parts: Sequence[str]) -> str:
    return "\n\n".join(parts) + "\n"


def _listed(listed: Listing) -> str:
    return _table(listed.columns, listed.rows)


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table whose first cells are names. Columns without any cell are left out."""
    used = [i for i, _ in enumerate(columns) if i == 0 or any(row[i] not in ("", "-") for row in rows)]
    lines = ["| " + " | ".join(columns[i] for i in used) + " |", "|" + "---|" * len(used)]
    for row in rows:
        cells = [_cell(columns[i], row[i]) for i in used]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cell(column: str, text: str) -> str:
    """A cell: names, defaults and types as code, as they are typed, and words with their characters kept."""
    names = column in ("name", "key", "topic", "type", "default", "setting", "gain")
    code = names and text not in ("", "-", "required")
    return (f"`{text}`" if code else _code(text)).replace("|", r"\|")


def _code(text: str) -> str:
    """Text of the program in Markdown: its double backquotes and paths are code, and other marks are kept as they
    are."""
    text = re.sub(r"(?<!`)path/to/[\w.:]*\w", r"``\g<0>``", text)
    parts = re.split(r"``(.+?)``", re.sub(r":\w+:`~?\.?([^`]+)`", r"``\1``", text))
    plain = [re.sub(r"([\\*<>\[\]])", r"\\\1", part) for part in parts[::2]]
    return "".join(a + (f"`{b}`" if b else "") for a, b in zip(plain, [*parts[1::2], ""], strict=True))
