"""The recorded signals of a run, and where in its record each of them lies."""

import itertools
from collections.abc import Iterator, Sequence, Set
from dataclasses import fields, replace

import numpy as np

from ...control.base import Controller
from ...control.task import ImpedanceTask
from ...errors import Fault, InputError
from ...navigation import Perfect
from ...records.trace import Trace
from ...setup.base import Setup
from ...stages.base import Stage
from ...stages.signals import (
    BAND,
    BANDED,
    DELAYED,
    IN_TASK_FRAME,
    JOINT_SIGNALS,
    MANIPULABILITY,
    MEASURED_MOTION,
    OWN_UNIT,
    PUSH,
    RECORDED,
    SCHEDULED,
    TOOL,
    UNSTEADY,
    WRIST_READING,
    WRIST_TRUE,
    Signal,
    contact_signals,
    encoder_signals,
    joint_command_signal,
    joint_saturation_signal,
    joint_signals,
    joint_torque_signal,
    thruster_signal,
)
from .bodies import recorded_contacts
from .pipeline import Pipeline
from .record import Image

_ATTRIBUTES = {*dir(np.recarray), *dir(Trace), *(field.name for field in fields(Trace)), "file", "allow_pickle"}
"""Attributes of a trace, and of the formats to which it is exported."""
_OF_THE_TASK = ("s", "zeta", "tau_nom", "boundary_layer_time")


def recorded(run: np.ndarray, stages: Pipeline, setup: Setup) -> list[tuple[Signal, np.ndarray]]:
    """The signals of a row in order, each with its memory in the record of a run. The measurements are recorded unless
    navigation is perfect, the motion of the water unless the current is constant, and the command of the thrusters
    where it may differ from their thrust or from tau_cmd. Raises InputError if two states have one name, or a state's
    name is taken or is not an identifier."""
    scenario, command, u = setup.scenario, run[stages.law], run["u"]
    contact = run["pairs"][0][:1]["contact"] if setup.contacts.paper else run["no_contact"]
    records = [run["row"], run["true"], contact, stages.signals, command]
    places = {name: record[name] for record in reversed(records) for name in record.dtype.names or ()}
    found = [
        (signal, places[signal.name])
        for signal in RECORDED
        if "task" in stages.stages or signal.name not in _OF_THE_TASK
    ]
    if not isinstance(scenario.navigation, Perfect):
        found += [(signal, run[stages.base][signal.name.removesuffix("_m")]) for signal in MEASURED_MOTION]
    found += [(signal, stages.signals[signal.name]) for signal in SCHEDULED if "schedule" in stages.stages]
    found += [(signal, run[stages.behind]["tau_cmd"]) for signal in DELAYED if "delay" in stages.stages]
    if not scenario.current.constant:
        found += [(signal, run["plant"]["water"][signal.name]) for signal in UNSTEADY]
    found += [*recorded_contacts(run, setup.contacts), (thruster_signal(u.size), u)]
    found += stages.commanded(run)
    found += recorded_joints(run, setup)
    found += recorded_wrist(run["wrist"]) if scenario.wrist.runs else []
    found += recorded_tool(run, setup)
    own = [each for each in stages.states() if each[1] != "zeta" or not isinstance(each[0], ImpedanceTask)]
    check_states([(stage, name) for stage, name, _ in own], {signal.name for signal, _ in found})
    found += [(state_signal(stage, name, memory.size), memory) for stage, name, memory in own]
    if not stages.at_tool:
        return found
    at_tool = {*IN_TASK_FRAME, *(name for stage, name, _ in own if isinstance(stage, Controller))}
    return [(replace(each, frame="T") if each.name in at_tool else each, memory) for each, memory in found]


def banded(recorded: Sequence[tuple[Signal, np.ndarray]], run: np.ndarray) -> list[tuple[Signal, np.ndarray]]:
    """The signals with a band, each with its memory, of the recorded ones."""
    found = {signal.name: (signal, memory) for signal, memory in (*recorded, (PUSH, run["push"]))}
    return [found[name] for name in BANDED if name in found]


def check_states(states: Sequence[tuple[Stage, str]], names: Set[str] = frozenset()) -> None:
    """Refuse states that can't be recorded under their names, beside the signals ``names``. Raises InputError if two
    states have one name, or a state's name is taken or is not an identifier."""
    own = (*contact_signals(0), *JOINT_SIGNALS, thruster_signal(0))
    recorded = (*RECORDED, *MEASURED_MOTION, *UNSTEADY, *DELAYED, *SCHEDULED, *TOOL, MANIPULABILITY, *own)
    taken = names | {signal.name for signal in recorded} | {*itertools.chain(*BAND.values())} | _ATTRIBUTES
    faults: dict[Stage, list[Fault]] = {}
    for stage, name in states:
        if name in taken:
            wrong = "is the name of a recorded signal or of an attribute; choose another"
        elif not name.isidentifier():
            wrong = "is not an identifier"
        else:
            others = [other.label() for other, same in states if same == name and other is not stage]
            wrong = f"is also the name of a state of {others[0]}; choose another" if others else ""
        if wrong:
            faults.setdefault(stage, []).append(Fault(f"states[{name!r}]", wrong))
    for stage, found in faults.items():
        raise InputError(found, f"the {stage.room.noun} {stage.label()}")


def state_signal(stage: Stage, name: str, size: int) -> Signal:
    """A state of a stage as a recorded signal."""
    return Signal(name, (size,), type(stage).units.get(name, OWN_UNIT), "B", f"state {name} of {stage.label()}")


def spans(image: Image, memories: Sequence[np.ndarray]) -> Iterator[tuple[int, int]]:
    """Place and size [numbers] of each part of a row; neighbours in memory are one part."""
    place, size = 0, 0
    for memory in memories:
        here = image.place(memory)
        if size and here == place + size:
            size += memory.size
            continue
        if size:
            yield place, size
        place, size = here, memory.size
    yield place, size


def recorded_joints(run: np.ndarray, setup: Setup) -> list[tuple[Signal, np.ndarray]]:
    """The recorded signals, each with its memory; none for a rigid vehicle."""
    n, true, given = len(setup.vehicle.arm.links), run["encoder"], run["joints"]
    if n == 0:
        return []
    found = [*zip(joint_signals(n), (true["q"], true["q_dot"]), strict=True), (joint_torque_signal(n), run["tau_q"])]
    found.append((joint_saturation_signal(n), run["saturation"]))
    if setup.scenario.encoder.runs:
        found += zip(encoder_signals(n), (given["q_m"], given["q_dot_m"]), strict=True)
    if type(setup.interface).torque_controlled:
        found.append((joint_command_signal(n), given["tau_q_cmd"]))
    return found


def recorded_tool(run: np.ndarray, setup: Setup) -> list[tuple[Signal, np.ndarray]]:
    """The recorded signals of a tool, each with its memory."""
    if not setup.at_tool:
        return []
    true, probe = run["true"], run["carriers"][0][:1]
    motion = [true["p_WB"], true["quat_WB"], true["nu"]]
    if not setup.contacts.carriers[0].is_B:
        motion = [probe["p_WC"], run["quat_WT"], probe["nu"]]
    return [*zip(TOOL, motion, strict=True), (MANIPULABILITY, run["model"]["manipulability"])]


def recorded_wrist(record: np.ndarray) -> list[tuple[Signal, np.ndarray]]:
    """The recorded signals, each with its memory."""
    return [(WRIST_TRUE, record["given"]["wrench_S"]), (WRIST_READING, record["reading"])]
