"""The recorded signals of a run, and where in memory each of them lies."""

import itertools
from collections.abc import Iterator, Sequence, Set
from dataclasses import replace

import numpy as np

from ...control.base import Controller
from ...control.task import ImpedanceTask
from ...errors import Fault, InputError
from ...navigation import Perfect
from ...scenario import Scenario
from ...stages.base import Stage
from ...stages.joint_signals import JOINT_SIGNALS
from ...stages.signals import (
    BAND,
    BANDED,
    DELAYED,
    IN_TASK_FRAME,
    MANIPULABILITY,
    MEASURED_MOTION,
    OWN_UNIT,
    PUSH,
    RECORDED,
    SCHEDULED,
    TOOL,
    UNSTEADY,
    Signal,
    contact_signals,
    thruster_signal,
)
from .contact_list import ContactList
from .joints import Joints
from .stage_table import StageTable

_ATTRIBUTES = {
    *dir(np.recarray),
    *("arrays", "band", "duration_s", "file", "message", "notes", "push", "save", "scenario", "columns", "load", "of"),
    *("header", "outcome", "rows", "to_dataframe", "signals", "status", "steps", "wall_time_s", "analytic"),
    "allow_pickle",
}
"""Attributes of a trace, and of the formats to which it is exported."""
_OF_THE_TASK = ("s", "zeta", "tau_nom", "boundary_layer_time")


def recorded(
    loop: np.ndarray,
    stages: StageTable,
    u: np.ndarray,
    scenario: Scenario,
    water: np.ndarray,
    contacts: ContactList,
    joints: Joints,
) -> list[tuple[Signal, np.ndarray]]:
    """The signals of a row in order, each with its memory. The measurements are recorded unless navigation is perfect,
    the motion of the water, a WATER record, unless the current is constant, and the command of the thrusters where it
    may differ from their thrust or from tau_cmd. Raises InputError if two states have one name, or a state's name is
    taken or is not an identifier."""
    records = [loop["row"], loop["true"], loop["contact"], stages.signals, stages.command]
    places = {name: record[name] for record in reversed(records) for name in record.dtype.names or ()}
    found = [
        (signal, places[signal.name])
        for signal in RECORDED
        if "task" in stages.entries or signal.name not in _OF_THE_TASK
    ]
    if not isinstance(scenario.navigation, Perfect):
        found += [(signal, stages.frame.base[signal.name.removesuffix("_m")]) for signal in MEASURED_MOTION]
    found += [(signal, stages.signals[signal.name]) for signal in SCHEDULED if "schedule" in stages.entries]
    found += [(signal, stages.delayed["tau_cmd"]) for signal in DELAYED if "delay" in stages.entries]
    if not scenario.current.constant:
        found += [(signal, water[signal.name]) for signal in UNSTEADY]
    found += [*contacts.recorded(loop), (thruster_signal(len(u)), u)]
    found += stages.commanded
    found += joints.recorded()
    found += stages.wrist.recorded() if stages.wrist is not None else []
    found += stages.frame.recorded(loop["true"])
    own = [each for each in stages.states() if each[1] != "zeta" or not isinstance(each[0], ImpedanceTask)]
    check_states([(stage, name) for stage, name, _ in own], {signal.name for signal, _ in found})
    found += [(state_signal(stage, name, memory.size), memory) for stage, name, memory in own]
    if not stages.frame.at_tool:
        return found
    at_tool = {*IN_TASK_FRAME, *(name for stage, name, _ in own if isinstance(stage, Controller))}
    return [(replace(each, frame="T") if each.name in at_tool else each, memory) for each, memory in found]


def banded(recorded: Sequence[tuple[Signal, np.ndarray]], loop: np.ndarray) -> list[tuple[Signal, np.ndarray]]:
    """The signals with a band, each with its memory, of the recorded ones."""
    found = {signal.name: (signal, memory) for signal, memory in (*recorded, (PUSH, loop["push_shown"]))}
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


def spans(memories: Sequence[np.ndarray]) -> Iterator[tuple[int, int]]:
    """Address and size [numbers] of each part of a row; neighbours in memory are one part."""
    address, size = 0, 0
    for memory in memories:
        here = memory.ctypes.data
        if size and here == address + 8 * size:
            size += memory.size
            continue
        if size:
            yield address, size
        address, size = here, memory.size
    yield address, size
