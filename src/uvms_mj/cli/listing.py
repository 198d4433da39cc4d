"""``uvms-mj controllers``, ``stages``, ``keys``, ``signals`` and ``metrics``: lists of laws, stages, scenario keys,
signals and metrics; ``vehicles``: the vehicles that ship, or the numbers of a vehicle's file
and its first sea trial.
"""

import contextlib
import dataclasses
import difflib
import itertools
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

from .common import Listing, bad_input, draw_to_files, facts, printable, refuse_existing, warn
from .options import command, force_option, json_option, path_option

if TYPE_CHECKING:
    from ..stages.base import Stage
    from ..stages.loader import Choice
    from ..stages.signals import Signal


@command()
@click.argument("laws", nargs=-1, metavar="[LAW]...")
def controllers(laws: tuple[str, ...]) -> None:
    """List the laws with their gains, units and defaults; LAW may be path/to/my_law.py:MyLaw."""
    with bad_input():
        from ..scenario import CHOICES

        choice = CHOICES["controller"]
        _print_stages([choice.stage_class(law) for law in laws or choice.shipped])


@command()
@click.argument("names", nargs=-1, metavar="[ROOM] [STAGE]...")
def stages(names: tuple[str, ...]) -> None:
    """List stages with their settings, units, defaults and states: all of them, the stages of ROOM (guidance,
    navigation, control, actuation, a table of a scenario, or a word for its stages such as law or sensor), or each
    STAGE by its name or path/to/file.py:ClassName.

    \b
    uvms-mj stages navigation
    uvms-mj stages gsta t200
    """
    with bad_input():
        from ..scenario import CHOICES

        room = next((word for word in names[:1] if word in _rooms()), None)
        choices = [choice for table, choice in CHOICES.items() if room is None or table in _rooms()[room]]
        if wanted := names[1:] if room else names:
            _print_stages([cls for name in wanted for cls in _named(name, choices, room)])
        else:
            _print_stages([cls for choice in choices for cls in shipped_stages(choice).values()])


def _rooms() -> dict[str, list[str]]:
    """The tables of stages by each word for them: a table, a room, and the further words that messages understand."""
    from ..scenario import CHOICES
    from ..stages.loader import tables_by_word

    named = [word for table, choice in CHOICES.items() for word in (table, choice.base.room.name)]
    rooms = {word: [t for t, choice in CHOICES.items() if word in (t, choice.base.room.name)] for word in named}
    return {word: [table] for word, table in tables_by_word(CHOICES).items()} | rooms


def shipped_stages(choice: "Choice[Any]") -> "dict[str, type[Stage]]":
    """The shipped stages of a table by name; before the laws, the task."""
    from ..control import Controller, ImpedanceTask

    return ({"task": ImpedanceTask} if choice.base is Controller else {}) | dict(choice.shipped)


def _named(name: str, choices: "list[Choice[Any]]", room: str | None) -> "list[type[Stage]]":
    """The stages of a name among these choices, in a room if one is given. Raises InputError if there is none."""
    from ..errors import InputError, suggestion
    from ..stages.foreign import parted
    from ..stages.loader import USERS, give_one, stages_in, users_stages

    shipped = [shipped_stages(choice) for choice in choices]
    if found := [cls for stages in shipped for key, cls in stages.items() if name in (key, cls.label())]:
        return found
    file, class_name = parted(name)
    if class_name:
        there = stages_in(file, "", class_name)
        of_class = [choice for choice in choices if issubclass(there.get(class_name, object), choice.base)]
        if of_class or room:  # of another room, the choice says so
            return [(of_class or choices)[0].stage_class(name)]
        raise InputError(
            f"no stage {class_name!r} in {file}; {suggestion(class_name, there) if there else 'it has none'}"
        )
    if file:
        raise InputError(f"{name!r} names no class; {give_one(name, users_stages(name, ''))}")
    rooms = _rooms()
    known = {each for stages in shipped for each in stages} | (set() if room or name in rooms else rooms.keys())
    hint, own = suggestion(name, known), f"for your own give {USERS}"
    raise InputError(f"no stage {name!r}{f' in {room}' if room else ''}; {hint}; {own}")


def _print_stages(listed: "Sequence[type[Stage]]") -> None:
    """Print a table for each stage, with the name of the scenario's table before the first one of it."""
    table = ""
    for cls in listed:
        if cls.room.table != table:
            click.echo(f"[{cls.room.table}]\n")
        table = cls.room.table
        stage_list(cls).show()
        click.echo()


def stage_list(cls: "type[Stage]") -> Listing:
    """The settings of a stage, with notes on its states."""
    written = "" if (cls.__doc__ or "").startswith(f"{cls.__name__}(") else cls.__doc__  # not dataclass's own
    summary, _, _ = (written or "").strip().partition("\n\n")
    title = f"{cls.label()}: {' '.join(summary.split())}"
    fields, preset_of = _own_settings(cls)
    rows = []
    for field in fields:
        default = "required" if field.default is dataclasses.MISSING else toml_value(field.default)
        rows.append((field.name, default, field.metadata.get("unit", ""), field.metadata.get("meaning", "")))
    notes: tuple[str, ...] = (f"all other settings as in {preset_of}",) if preset_of else ()
    if cls.states:
        notes += ("states: " + ", ".join(f"{name} ({size})" for name, size in cls.states.items()),)
    return Listing(title, (cls.room.setting, "default", "unit", "meaning"), rows, notes, width=80)


def _own_settings(cls: "type[Stage]") -> "tuple[list[dataclasses.Field], str]":
    """The settings to list, and for a preset, which has other defaults only, the name of the stage that it derives
    from."""
    from ..stages.base import is_of_the_package

    fields, parent = list(cls.setting_fields()), cast("type[Stage]", cls.__mro__[1])
    if not is_of_the_package(cls) or not is_of_the_package(parent):
        return fields, ""
    before = {field.name: field.default for field in parent.setting_fields()}
    own = [field for field in fields if field.name not in before or before[field.name] != field.default]
    return own, parent.label()


def toml_value(value: Any) -> str:
    if value is None:
        return "-"
    from ..files import plain

    return json.dumps(plain(value))


words_argument = click.argument("words", nargs=-1, metavar="[WORD]...")


@command()
@words_argument
def keys(words: tuple[str, ...]) -> None:
    """List the keys of a scenario with defaults and units: all keys, or the keys that begin with WORD, or, if there is
    none, the keys with WORD in their name or meaning.

    \b
    uvms-mj keys wall
    uvms-mj keys stiffness damping
    """
    with bad_input():
        from ..scenario import CHOICES

        def of_a_stage(word: str) -> str:
            last = word.rpartition(".")[2].lower()
            every = [cls for choice in CHOICES.values() for cls in shipped_stages(choice).values()]
            owners = [cls.label() for cls in every if last in (field.name.lower() for field in cls.setting_fields())]
            return f"it is a setting of {', '.join(owners)}: uvms-mj stages {owners[0]}" if owners else ""

        listed = key_list()
        near = {part for key, *_ in listed.rows for part in (key, *key.split("."))}
        meanings = {key: meaning for key, *_, meaning in listed.rows}
        listed.show(_wanted(words, meanings, "key", str.startswith, near, of_a_stage))


def key_list() -> Listing:
    """The keys of a scenario. Of a stage, only the keys that all stages of its table have."""
    from ..scenario import keys as scenario_keys

    title = "Keys of a scenario; `uvms-mj stages` lists the settings of each stage"
    rows = [(key, toml_value(default), meaning) for key, default, meaning in scenario_keys()]
    return Listing(title, ("key", "default", "meaning"), rows)


def _wanted(
    words: Sequence[str],
    meanings: Mapping[str, str],
    noun: str,
    named: Callable[[str, str], bool],
    near: Iterable[str],
    elsewhere: Callable[[str], str] = lambda word: "",
) -> set[str]:
    """The names that are meant by words: names for which ``named(name, word)`` is true, or if there is none, names with
    the word in their name or meaning. All names without a word. Raises InputError if a word means none: the message has
    the place where to look for it, ``elsewhere``, or a similar one of the words ``near``."""
    from ..errors import InputError

    found: set[str] = set() if words else {*meanings}
    for word in words:
        low = word.lower()
        meant = {name for name in meanings if named(name.lower(), low)}
        meant = meant or {name for name, meaning in meanings.items() if low in f"{name} {meaning}".lower()}
        if not meant:
            close = difflib.get_close_matches(word, sorted(near), 1)
            hint = f"did you mean {close[0]!r}?" if close else f"uvms-mj {noun}s lists all"
            raise InputError(f"no {noun} has {word!r} in its name or meaning; {elsewhere(word) or hint}")
        found |= meant
    return found


@command()
@words_argument
def signals(words: tuple[str, ...]) -> None:
    """List the signals that each stage receives and sets, and the signals that a run records. First WORDs for stages
    (law, sensor, thrusters, ...), or "recorded", choose the lists. Each other WORD chooses the signal of this name, or,
    if there is none, the signals with WORD in their name or meaning.

    \b
    uvms-mj signals law
    uvms-mj signals recorded force
    """
    with bad_input():
        from ..scenario import CHOICES

        rooms_by_word = _rooms() | {"recorded": []}
        kinds = tuple(itertools.takewhile(rooms_by_word.__contains__, words))
        chosen = [table for table in CHOICES if not kinds or any(table in rooms_by_word[kind] for kind in kinds)]
        inputs, outputs = zip(*map(stage_signals, chosen), strict=True) if chosen else ((), ())
        groups = [*inputs, *(each for each in outputs if len(each.rows) > 1)]
        groups += recorded_signals() if not kinds or "recorded" in kinds else []
        meanings = {name: meaning for listed in groups for name, *_, meaning in listed.rows}
        wanted = _wanted(words[len(kinds) :], meanings, "signal", str.__eq__, {*meanings, *rooms_by_word})
    for listed in groups:
        listed.show(wanted)


def stage_signals(table: str) -> tuple[Listing, Listing]:
    """The signals that a stage of this table of a scenario receives and sets."""
    from ..scenario import CHOICES

    room = CHOICES[table].base.room
    given, out = room.arguments[2], room.arguments[4]
    return (
        signal_list(f"Inputs of the {room.noun}: {given}.<name>", room.given(0)),
        signal_list(f"Outputs of the {room.noun}: {out}.<name>", room.out),
    )


def signal_list(title: str, listed: "Iterable[Signal]") -> Listing:
    """Signals with shape, unit, frame and meaning. A length of zero is the number of thrusters, joints, contacts, fins,
    or nodes or elements of a tether."""
    from ..stages.signals import (
        BAND,
        JOINT_SIGNALS,
        contact_signals,
        coupling_signal,
        deflection_signal,
        joints_given,
        tether_signals,
    )

    counted = dict.fromkeys((signal.name for signal in contact_signals(0)), "contacts")
    counted |= dict.fromkeys(
        [*(signal.name for signal in (*JOINT_SIGNALS, *joints_given(0))), *BAND["tau_q"]], "joints"
    )
    counted[deflection_signal(0).name] = "fins"
    counted[coupling_signal(0).name] = "couplings"
    counted |= zip((signal.name for signal in tether_signals(0)), ("nodes", "elements"), strict=True)
    rows = []
    for signal in listed:
        shape = " x ".join(str(length or counted.get(signal.name, "thrusters")) for length in signal.shape)
        rows.append((signal.name, shape or "scalar", signal.unit, signal.frame, signal.meaning))
    return Listing(title, ("name", "shape", "unit", "frame", "meaning"), rows, fixed=("name", "shape"), width=80)


def recorded_signals() -> list[Listing]:
    """The signals that a run records, and their bands."""
    from ..stages.signals import BAND, PUSH, band_signals, recordable

    own = recordable()
    bands = tuple(edge for signal in (*own, PUSH) if signal.name in BAND for edge in band_signals(signal))
    return [
        signal_list("Recorded signals: trace.<name>; the states of the stages are recorded too", own),
        signal_list("Bands: recorded where rows are further apart than steps; trace.band(<name>) has both", bands),
    ]


@command()
@words_argument
def metrics(words: tuple[str, ...]) -> None:
    """List the metrics that a study can keep. Each WORD chooses the metric of this name, or, if there is none, the
    metrics with WORD in their name or meaning.

    They are the names in keep.metrics and [success] of a study, and in [objective] and [[constraint]] of a tuning. A
    metric of your own is path/to/file.py:function.

    \b
    uvms-mj metrics contact
    """
    with bad_input():
        listed = metric_list()
        meanings = {name: said for name, *_, said in listed.rows}
        listed.show(_wanted(words, meanings, "metric", str.__eq__, meanings))


def metric_list() -> Listing:
    """The metrics that a study can keep."""
    from ..studies.plan.metrics import METRICS, columns_of, unit_of_column

    rows = []
    for name, each in METRICS.items():
        parts = [column.removeprefix(f"{name}.") for column in columns_of(name)]
        shown = parts if len(parts) < 10 else [parts[0], "..", parts[-1]]
        columns = "" if parts == [name] else f"; .{', .'.join(shown)}"
        rows.append((name, unit_of_column(name), each.meaning + columns))
    return Listing("Metrics of a run", ("name", "unit", "meaning"), rows, fixed=("name",), width=80)


@command()
@click.argument("names", nargs=-1, metavar="[VEHICLE]...")
@click.option("--check", is_flag=True, help="Its first sea trial: trim, speeds, decay, stability, and what to look at.")
@path_option("-o", "--out", metavar="DIR", help="With --check of one vehicle: folder of the page, report.html.")
@force_option
@json_option
def vehicles(names: tuple[str, ...], check: bool, out: str | None, force: bool, as_json: bool) -> None:
    """List the vehicles that ship with their source, licence and trust, or the numbers of each VEHICLE, which may be
    path/to/vehicle.xml.

    \b
    uvms-mj vehicles
    uvms-mj vehicles bluerov2_heavy
    uvms-mj vehicles my_rov.xml --check --out trial
    uvms-mj run --set vehicle.model=bluerov2_heavy

    --check computes by formulas the tests of a first day in water: terminal speeds and decay times in six axes, the
    reach of the thrusters, the attitude at rest, stability straight ahead (Munk moment), energy, and its numbers
    without unit beside the shipped vehicles'. A wrong sign or unit of the file shows there.
    """
    if check or out:
        _check(names, check, out, force, as_json)
        return
    with bad_input():
        from ..files import shipped
        from ..plant.description import described
        from ..plant.mjcf import Mjcf
        from ..plant.vehicle import notes_on_damping

        found = {name: Mjcf.find(name) for name in names or shipped("models")}
        about = {name: described(mjcf) for name, mjcf in found.items()}
    if as_json:
        click.echo(json.dumps(about, allow_nan=False))
        return
    if not names:
        _print_list(about)
        return
    for name, mjcf in found.items():
        _print_one(name, about[name])
        for note in notes_on_damping(mjcf.vehicle):
            warn(note)


def _check(names: tuple[str, ...], check: bool, out: str | None, force: bool, as_json: bool) -> None:
    """The first sea trial of vehicles, as tables, as JSON, or of one as a page."""
    with bad_input():
        from ..errors import InputError
        from ..files import locked
        from ..plant.mjcf import Mjcf
        from ..plant.sea_trial import as_numbers, trial
        from .vehicle_check import check as shown

        if not check:
            raise InputError("--out: is for --check")
        if not names:
            raise InputError("--check: name a vehicle, as uvms-mj vehicles bluerov1 --check")
        if out and (len(names) > 1 or as_json):
            raise InputError("--out: is for the tables of one vehicle")
        folder = Path(out) if out else None
        if folder is not None:
            refuse_existing("--out", folder, force)
            draw_to_files()
        found = {name: Mjcf.find(name).vehicle for name in names}
        if as_json:
            numbers = {name: as_numbers(trial(vehicle)) for name, vehicle in found.items()}
            click.echo(json.dumps(numbers, allow_nan=False))
            return
        with contextlib.nullcontext() if folder is None else locked(folder):
            for name, vehicle in found.items():
                shown(name, vehicle, folder)


def _print_list(about: dict[str, dict[str, Any]]) -> None:
    from ..plant.description import REMARKS, remark

    rows = []
    for name, each in about.items():
        parts = [each, *each["links"]]
        masses = ", ".join(f"{sum(part[word] for part in parts):.4g}" for word in ("mass", "displaced_mass"))
        remarks = "\n".join(printable(remark(each, word)) for word in REMARKS[1:])
        numbers = str(len(each["thrusters"])), f"{each['axes']} of 6", str(len(each["links"]))
        rows.append((name, masses, *numbers, remarks))
    title = "Vehicles: --set vehicle.model=NAME; `uvms-mj vehicles NAME` lists the numbers of one"
    columns = ("name", "mass, displaced [kg]", "thrusters", "axes", "joints", "source, licence, trust")
    Listing(title, columns, rows, fixed=("name",), width=80, ruled=True).show()


def _print_one(name: str, each: dict[str, Any]) -> None:
    from ..plant.description import rows
    from ..plant.vehicle import AXES

    about = [(row, printable(value)) for row, value in rows(each)]
    facts(printable(f"{name}: {each['description'] or 'a vehicle without a description'}"), about).show()
    thrusters = []
    for thruster, given in each["thrusters"].items():
        least, greatest = ("none" if x is None else f"{x:.4g}" for x in (given["least"], given["greatest"]))
        limits = "none" if least == greatest == "none" else f"{least} .. {greatest}"
        thrusters.append((printable(thruster), *(f"{round(x, 4) + 0.0:.4g}" for x in given["wrench"]), limits))
    title = f"Thrusters: wrench of 1 N, body frame; they span {each['axes']} of 6 axes"
    Listing(title, ("name", *AXES, "limits [N]"), thrusters, fixed=("name", *AXES), width=80).show()
    if each["links"]:
        print_arm(each)


def print_arm(about: dict[str, Any]) -> None:
    """Print joints, links and sites of a vehicle that :func:`..plant.description.described_arm` describes."""
    from ..plant.description import coefficient_rows, numbers_text

    columns = ("joint", "moves", "type", "range", "motor", "speed limit", "gear friction", "armature")
    joints = [
        (printable(link["joint"]), printable(link["name"]), link["type"], *_joint(link)) for link in about["links"]
    ]
    Listing("Joints, from the base outwards", columns, joints, fixed=("joint", "moves"), width=80).show()
    for link in about["links"]:
        rows = [*coefficient_rows(link)]
        if link["strip_theory"]:
            rows.append(("by strip theory", f"{', '.join(link['strip_theory'])}: from its capsules and cylinders"))
        facts(printable(f"Link {link['name']}, carried by {link['carried_by']}"), rows).show()
    sites = []
    for name, site in about["sites"].items():
        far = "without limit" if site["reach"] is None else f"at most {site['reach']:.4g}"
        place = printable(site["carried_by"]), numbers_text(site["position"])
        sites.append((printable(name), *place, f"{site['radius']:.4g}", far))
    if sites:
        heads = ("site", "carried by", "position [m]", "radius [m]", "reach from the first joint [m]")
        Listing("Sites that can be the tool: --set task.frame=NAME", heads, sites, fixed=("site",), width=80).show()


def _joint(link: dict[str, Any]) -> tuple[str, ...]:
    """Range, motor, speed limit, friction and armature of a joint, with their units."""
    turns = link["type"] == "hinge"
    place, torque, scale = ("deg", "N m", 180.0 / math.pi) if turns else ("m", "N", 1.0)
    least, greatest = link["range"]
    limits = "none" if least is None or greatest is None else f"{scale * least:.4g} .. {scale * greatest:.4g} {place}"
    motor = "none" if not link["motor"] else "no limit" if link["effort"] is None else f"{link['effort']:.4g} {torque}"
    speed = "none" if link["speed_limit"] is None else f"{scale * link['speed_limit']:.4g} {place}/s"
    friction = f"{link['damping']:.4g} {torque} s{'' if turns else '/m'}, {link['friction']:.4g} {torque}"
    return limits, motor, speed, friction, f"{link['armature']:.4g} {'kg m^2' if turns else 'kg'}"
