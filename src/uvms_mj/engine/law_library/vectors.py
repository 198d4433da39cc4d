"""Recorded steps of a run, for the test of a law's library: in free motion, at the touch and pressing."""

import sys
import warnings
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...compiler.apart import forked
from ...errors import Fault, InputError
from ...physics.frames import rotation_matrix
from ..native.chain import Here
from ..simulation import Saved, Simulation
from .border import AIDS, INERTIAL, OF_FILTER, PRESENT, START, Border, Entry

LENGTH = 400
"""Recorded periods of each segment."""
NEAR = 1e-6
"""Largest difference of a command from the command of the run, over the largest of its kind."""
_PRESSING_S = 1.0
"""Time from the touch to the last segment [s]."""
_LOOK_S = 0.5
"""Time between two looks for a touch [s]."""
_LONGER = 10
"""How many times longer the time steps of a first look for a touch are."""
_REST = 1e-4
"""A vehicle that moves no faster, also in its joints, is at rest [m/s, rad/s]."""
_MOST_S = 60.0
"""A look that takes longer is given up [s]."""


@dataclass(frozen=True)
class Segment:
    """Consecutive periods of a run: the words of their records, and the record before them as its differences from the
    first one.

    Attributes:
        last, begun: time of the period before, and whether there is one.
        changes: place and word of each difference.
        rows: (n, words) measurements, reference and command.
    """

    name: str
    last: float
    begun: bool
    changes: Sequence[tuple[int, int]]
    rows: np.ndarray


@dataclass(frozen=True)
class Vectors:
    """The segments, and a text about them. ``apart``: the largest difference of a command from the run's, over the
    largest of its kind; zero for a rigid vehicle, whose commands are the run's bit for bit."""

    about: str
    segments: tuple[Segment, ...]
    apart: float = 0.0

    @property
    def steps(self) -> int:
        return sum(len(each.rows) for each in self.segments)


def recorded(sim: Simulation, border: Border, text: str, entry: str) -> Vectors:
    """Record a run. With joints, the run rounds some products and sums once, which a library does not: then the
    commands come from the chain on this processor, ``text`` with the function ``entry``, and must be near the run's
    commands. Raises InputError if they are not, or if the measurements are not the chain's."""
    every, total = border.chain.steps, sim.scenario.steps
    last = max(1, total // every)
    sim.run(every, np.inf)
    touch, saved = (None, ()) if _rests_apart(sim) else _first_touch(sim, every)
    starts = {"free motion": 0}
    length = LENGTH if touch is not None else 3 * LENGTH
    if touch is not None:
        starts["touch"] = max(LENGTH, touch - LENGTH // 2)
        starts["pressing"] = max(starts["touch"] + LENGTH, touch + round(_PRESSING_S / border.chain.period))
    sim.reset()
    segments, here = [], border.chain.here(text, entry) if border.chain.joints else None
    for name, start in starts.items():
        if start >= last and segments:
            continue
        before = [each for each in saved if sim.steps < each[0] <= start * every]
        if before:
            sim.restore(before[-1][1])
        ahead = start * every - sim.steps
        if sim.run(ahead, np.inf) < ahead:
            break
        segments.append(_segment(sim, border, name, min(length, last - start), here))
    scenario, apart = sim.scenario, max(each for _, each in segments)
    if not apart <= NEAR:
        raise InputError(f"export law: a command is {apart:.2g} of the largest one apart from the run's")
    about = f"{scenario.name}, law {scenario.controller.label()}"
    return Vectors(about, tuple(each for each, _ in segments), apart)


def _rests_apart(sim: Simulation) -> bool:
    """Whether a run ends at rest without a contact, as a run with longer time steps shows in a tenth of the time: where
    a vehicle rests does not depend on them. Of a run that does not take them, or moves at its end, nothing is known. A
    stage may fail with them, so a copy of this process takes them; elsewhere than on Linux that is not sure to work."""
    return sys.platform == "linux" and forked(lambda: bytes([_ends_apart(sim)]), _MOST_S)() == bytes([True])


def _ends_apart(sim: Simulation) -> bool:
    longer, speeds = _LONGER * sim.scenario.simulation.timestep, deque[float](maxlen=4)
    warnings.simplefilter("ignore")
    sim.reset({"simulation.timestep": longer})
    first, slices = sim.memory.run["row"]["first_contact"], max(1, round(_LOOK_S / longer))
    while first[0] < 0.0 and sim.steps < sim.scenario.steps and sim.run(slices, np.inf):
        speeds.append(float(np.abs(sim.state[1]).max()))
    return bool(first[0] < 0.0 and sim.steps >= sim.scenario.steps and max(speeds) < _REST)


def _first_touch(sim: Simulation, every: int) -> tuple[int | None, Sequence[tuple[int, Saved]]]:
    """The period of the first contact, None without one; and states before it, each with its steps. A stage in C may
    keep numbers of its own, so that its run has none."""
    row = sim.memory.run["row"]
    slices = max(1, round(_LOOK_S / sim.scenario.simulation.timestep))
    saved = deque[tuple[int, Saved]](maxlen=2 + LENGTH // 2 * every // slices)
    while row["first_contact"][0] < 0.0 and sim.steps < sim.scenario.steps:
        with suppress(InputError):
            saved.append((sim.steps, sim.save()))
        if sim.run(slices, np.inf) == 0:
            return None, saved
    first = float(row["first_contact"][0])
    return None if first < 0.0 else round(first / sim.scenario.simulation.timestep) // every, saved


def _segment(sim: Simulation, border: Border, name: str, n: int, here: Here | None) -> tuple[Segment, float]:
    chain, memory = border.chain, sim.memory
    start = sim.steps // chain.steps
    first = chain.image.view("<u8")
    image = chain.image_of(memory).view("<u8") if start else first  # a reset has begun the first instant
    changes = [(int(k), int(image[k])) for k in np.flatnonzero(image != first)]
    entries = (*border.measured, *border.reference)
    reads, writes = _sources(sim, border, entries), _sources(sim, border, border.command)
    base = memory.run[chain.measured]
    gaps = [np.full(each.n, np.nan) for each in entries]
    rows, apart, needed = [], 0.0, {"", *border.needed}
    if here is not None:
        here.numbers.view("<u8")[:] = image
    for k in range(n):
        sim.prepare()
        if not np.array_equal(base["R_WB"][0], rotation_matrix(base["quat_WB"][0])):
            wrong = "its R_WB is not exactly the rotation matrix of its quat_WB, of which the library computes it"
            raise InputError([Fault("navigation.name", wrong)], "export law")
        t = (start + k) * chain.steps * sim.scenario.simulation.timestep
        groups = {*needed, *_samples(sim, border)}
        given = [
            np.array(each, float).reshape(-1) if entry.group in groups else gap
            for entry, each, gap in zip(entries, reads, gaps, strict=True)
        ]
        present = sum(1 << k for k, group in enumerate(PRESENT) if group in groups)
        row = [np.array([t]).view("<u8"), np.array([present], "<u8"), *(each.view("<u8") for each in given)]
        if sim.run(chain.steps, np.inf) < chain.steps:
            break
        found, saturated = [np.array(each, float).reshape(-1) for each in writes], int(memory.run["saturated"][0])
        if here is not None:
            near, found, saturated = found, *_taken(here, border, t, groups, given)
            apart = max(apart, *(_difference(*each) for each in zip(near, found, strict=True)))
        rows.append(np.concatenate([*row, *(each.view("<u8") for each in found), np.array([saturated], "<u8")]))
    last = (start - 1) * chain.steps * sim.scenario.simulation.timestep if start else 0.0
    return Segment(name, last, start > 0, changes, np.array(rows)), apart


def _samples(sim: Simulation, border: Border) -> Sequence[str]:
    """The groups of the filter's samples that are new at the instant in hand."""
    link = border.chain.filter
    if link is None or sim.steps % link.period_steps:
        return ()
    if sim.steps == 0:
        return (START,)
    new = link.compiled.state["present"][0]
    return (INERTIAL, *(group for group, flag in zip(AIDS, new, strict=True) if flag > 0.0))


def _taken(
    here: Here, border: Border, t: float, groups: set[str], given: Sequence[np.ndarray]
) -> tuple[list[np.ndarray], int]:
    """The commands of a period on this processor, and whether a thrust is at its limit."""
    here.record["t"] = t
    for entry, each in zip((*border.measured, *border.reference), given, strict=True):
        if entry.group in groups:
            here.numbers[entry.place : entry.place + entry.n] = each
    for group, place in border.flags.items():
        here.numbers[place] = group in groups
    if here.take() != 0:
        raise InputError("export law: a stage ends early in the library, and not in the run")
    found = [here.numbers[each.place : each.place + each.n].copy() for each in border.command]
    return found, int(here.record["saturated"][0])


def _difference(run: np.ndarray, library: np.ndarray) -> float:
    """The largest difference of a command, over the largest number of it."""
    return float(np.abs(run - library).max() / max(1e-6, np.abs(run).max()))


def _sources(sim: Simulation, border: Border, entries: Sequence[Entry]) -> list[np.ndarray]:
    """The memory of the run that holds each field."""
    run: Any = sim.memory.run
    stages = sim.memory.stages
    places = {
        "tau_cmd": stages.command,
        "u_cmd": stages.u_cmd,
        "tau_hat": run["signals"]["tau_hat"],
        "tau_q": run["tau_q_demand"],
        "q_m": run["joints"]["q_m"],
        "q_dot_m": run["joints"]["q_dot_m"],
    }
    if "thrusters" in stages.stages and "command" in (stages.stages["thrusters"].state.dtype.names or ()):
        places |= dict.fromkeys(("pwm", "thruster_cmd"), stages.stages["thrusters"].state["command"])
    if "wrist" in (run.dtype.names or ()):
        places["wrench_m_S"] = run["wrist"]["reading"]
    found = []
    for each in entries:
        if each.group in OF_FILTER:
            found.append(_of_filter(border, each))
            continue
        known = places.get(each.name)
        if known is None:
            base = run[stages.base] if each.group else run["signals"]
            known = base[each.name]
        found.append(known)
    return found


def _of_filter(border: Border, entry: Entry) -> np.ndarray:
    """The memory of the run that holds a sample of the filter's sensors."""
    link = border.chain.filter
    assert link is not None
    name = next(name for signal, name in OF_FILTER[entry.group] if signal.name == entry.name)
    return link.compiled.state[name] if name else link.compiled.settings[entry.name]
