"""The record of a run: one piece of memory with fields that are numbers, arrays and records, shared by Python and
machine code, and the image that it is in, with the records of stages and room for numbers behind it.

A place is an index into the numbers of the whole record. Tables, whose lengths are not known when compiling, the
records of stages and the rows are reached by their places. Addresses are at two borders only: to MuJoCo's own memory,
and to the machine code of stages.
"""

import functools
import mmap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...control.model import model_dtype
from ...errors import Fault, InputError
from ...physics.buoyancy import WET
from ...physics.contacts import CARRIER, CONTACT, PAIR
from ...physics.effects import EFFECTS, INERTIAS, NO_EFFECTS, STATES, TABLES, WRENCHES
from ...physics.hydrodynamics import WATER
from ...physics.operational import TOOL
from ...physics.surfaces import SURFACE
from ...physics.tree import FRAME, LINK
from ...physics.varying import ROWS
from ...stages.signals import (
    CLOCK,
    GIVEN,
    MEASURED,
    RECORDED,
    TRUE,
    TRUTH,
    WRENCH_COMMAND,
    actuation_given,
    effect_given,
    encoder_given,
    joints_given,
    record_dtype,
    thrusters_given,
    wrist_given,
)

NUMBERS = 1 << 24
"""Numbers that a record of a run may have, with all that lies behind it."""
MOST_STAGES, MOST_SPANS, MOST_BANDS = 32, 256, 8
MOST_ROWS = 4096
"""Rows of a table that a reset may give, if the table at the start is no longer."""

TRUTHS = record_dtype(CLOCK + TRUE)
"""Record given to navigation: the state and the contact force of the instant."""
_OTHERS = {s.name for s in GIVEN + TRUE} - {s.name for s in MEASURED} | {s.name for s in TRUE[:4]}
_OTHERS |= {"tau_cmd", "f_contact_m_W", *(CONTACT.names or ())}
ROW = record_dtype(tuple(s for s in RECORDED if s.name in ("t", "f_contact_W") or s.name not in _OTHERS))
"""The recorded signals that the core computes; all others lie where a stage or the contact has set them."""

STOP_NONE, STOP_STATE, STOP_COMMAND, STOP_THRUST, STOP_STAGE, STOP_WAITING, STOP_JOINT = range(7)
JOINT_BOUND = 1e3
"""Largest |q| and |q_dot| of a joint in a run [rad or m, and per second]."""


def _whole(*names: str) -> list[tuple[str, str]]:
    """Fields that are integers."""
    return [(name, "i8") for name in names]


MUJOCO = np.dtype(
    [
        *_whole("time_at", "R_at"),  # mjData.time, and xmat of the body
        *_whole("qpos_at", "qvel_at", "qacc_at"),  # of the free joint and of the joints behind it
        *_whole("M_at"),  # the entries of mjData.M from the free joint's on
        *_whole("qLD_at", "qLDiagInv_at"),  # the same entries of the factor, or 0 if mj_factorM has to factor all of M
        *_whole("passive_at"),  # mjData.qfrc_passive
        *_whole("ctrl_at", "controls"),  # mjData.ctrl, and how many there are
        *_whole("solved_at"),  # the contact sensor: found, normal force (3) in W, of the last step
    ],
    align=True,
)
"""The border to MuJoCo: addresses in one mjData, all 0 in an engine without it."""

BODY = np.dtype(
    [
        ("M_RB", "f8", (6, 6)),
        ("M_inv", "f8", (6, 6)),  # inverse of the inertia
        ("M_inv_open", "f8", (6, 6)),  # inverse of M_RB + M_A, without what an effect adds
        ("mass", "f8"),
        ("r_g", "f8", (3,)),
        ("gravity_W", "f8", (3,)),
        ("softness", "f8"),  # of MuJoCo's contact [1/kg]
    ],
    align=True,
)
"""The vehicle of the free_body engine."""

STAGE = np.dtype(
    [
        ("code_at", "i8"),  # machine code, or 0 if the stage runs as plain Python
        *_whole("settings", "state", "given", "state_dot", "out"),  # places; of a user's stage, in its own memory
        *_whole("states", "period_steps"),  # numbers in state; time steps from one call to the next
        ("period", "f8"),
        *_whole("instant", "key"),  # number of its calls, and key of its random numbers
    ],
    align=True,
)
"""One stage of the loop. Its input begins with a clock: time, period, instant and key."""


def room_for(n: int) -> int:
    """Room for n entries: vehicles among more or fewer walls share their machine code."""
    return n and max(8, 1 << (n - 1).bit_length())


@functools.cache
def plant_dtype(n: int, effects: np.dtype = NO_EFFECTS, own_effects: int = 0, own_frames: int = 0) -> np.dtype:
    """The vehicle in the water, with n joints, these effects, so many of a user's own, and their frames."""
    affected = any(effects[name].shape[0] for name in WRENCHES)
    advancing = any(effects[name].shape[0] for name in STATES)
    inert = sum(effects[name].shape[0] for name in INERTIAS)
    return np.dtype(
        [
            ("mujoco", MUJOCO),
            ("M_rows", "i8", (n + 1,)),  # where the row of each link begins in the entries of mjData.M
            ("calls", "i8"),
            # the state and the contact with the wall as the engine has them
            ("time", "f8"),
            ("qpos", "f8", (7 + n,)),
            ("qvel", "f8", (6 + n,)),
            ("qacc", "f8", (6 + n,)),
            ("R_WB", "f8", (3, 3)),
            ("solved", "f8", (4,)),  # whether the probe touched [wall] in the last step, and the normal force in W
            # the water
            ("water", WATER),
            ("effects", effects),
            ("affected", "i8", (int(affected),)),  # empty without one of the velocity
            ("advancing", "i8", (int(advancing),)),  # empty without one with states
            ("inert", "i8", (inert,)),  # empty without one that has inertia
            ("wet", WET, (int(effects["buoyancy"].shape[0] > 0),)),  # empty of a vehicle far below the surface
            ("tau_effects", "f8", (own_effects, 6)),  # wrenches of a user's effects, held over a step, in their frames
            ("effect_frames", CARRIER, (own_frames,)),  # these frames, empty if all are B
            ("nu", "f8", (6,)),
            ("nu_r", "f8", (6,)),
            ("work", "f8", (6,)),
            ("wrench", "f8", (6 + n,)),  # generalised wrench of the water, in B
            ("added", "f8", (21,)),
            ("M_left", "f8", (21,)),  # mjData.M after the callback
            ("passive_before", "f8", (6 + n,)),  # qfrc_passive before the callback
            ("passive_left", "f8", (6 + n,)),  # qfrc_passive after the callback
            ("f_applied_W", "f8", (3,)),  # contact forces that no contact solver applies: their sum on the base
            ("tau_applied_B", "f8", (6,)),  # and wrench at B's origin
            # the links, base first
            ("links", LINK, (1 + n,)),  # for the water
            ("frames", FRAME, (1 + n,)),
            ("M_BB", "f8", (6, 6)),  # added mass of all links, about B's origin in B
            ("gravity_W", "f8", (3,)),
            ("gravity_B", "f8", (3,)),
        ],
        align=True,
    )


def wrist_dtype(n: int) -> np.dtype:
    """The wrist sensor."""
    return np.dtype(
        [
            ("given", record_dtype(wrist_given(n))),
            ("reading", "f8", (6,)),
            *((name, LINK, (1 + n,)) for name in ("rigid", "wet", "model")),  # true links, water on them, estimates
            *((name, "f8", (3,)) for name in ("rigid_gravity_B", "wet_gravity_B", "gravity_B", "gravity_W")),
            ("sensor", TOOL),  # its frame S on the link behind it
            *_whole("weighs", "dynamic"),  # whether the model has weight, and motion
            ("q_ddot", "f8", (n,)),  # of the measured state
            ("q_dot_before", "f8", (n,)),  # of the instant before
            ("nu_before", "f8", (6,)),
            ("modelled", "f8", (6,)),
            ("work", "f8", (6,)),
        ],
        align=True,
    )


@dataclass(frozen=True)
class Shape:
    """The numbers on which the layout of a record depends, and with it the machine code.

    Attributes:
        joints, thrusters: how many the vehicle has.
        carriers: frames that contact bodies are fixed to.
        carried: whether one of them may be not B.
        surfaces, pairs: room for so many walls and contacts.
        resolves: whether the law's command is resolved, at a tool or with joints.
        effects: the arrays of records of the effects of the water, with the room for each.
        own_effects: how many effects of a user's own there are.
        own_frames: their number again if one of them acts in another frame than B, otherwise 0.
    """

    joints: int = 0
    thrusters: int = 0
    carriers: int = 0
    carried: bool = False
    surfaces: int = 0
    pairs: int = 0
    resolves: bool = False
    effects: np.dtype = NO_EFFECTS
    own_effects: int = 0
    own_frames: int = 0

    @property
    @functools.cache  # noqa: B019  # they are few
    def layout(self) -> np.dtype:
        """The record of a run: the plant, and the closed loop around it."""
        n, m, pairs = self.joints, self.thrusters, self.pairs
        fields = [
            ("plant", plant_dtype(n, self.effects, self.own_effects, self.own_frames)),
            ("body", BODY),
            ("address", "i8"),  # of this record, for the machine code of stages
            # settings
            ("timestep", "f8"),
            *_whole("steps", "window_step"),  # number of time steps of the run, and the first one of the final window
            ("epsilon", "f8", (6,)),
            ("speed_bound", "f8", (6,)),
            ("position_bound", "f8"),
            ("tau_bound", "f8"),
            # contacts
            ("surfaces", SURFACE, (self.surfaces,)),
            ("pairs", PAIR, (pairs,)),
            *_whole("surface_count", "pair_count"),
            ("f_pairs", "f8", (pairs, 3)),  # force of each pair in W
            ("depths", "f8", (pairs,)),
            ("carriers", CARRIER, (self.carriers,)),
            ("carried", "i8", (int(self.carried),)),  # empty if all of them are B
            ("no_contact", CONTACT),
            ("push", "f8", (1,)),  # sum of all normal forces of the step
            # stages
            ("stages", STAGE, (MOST_STAGES,)),
            *_whole("stage_count", "actuation", "next"),  # indices of the first that is given tau_cmd, and of the next
            ("signals", record_dtype(GIVEN + TRUTH)),  # the signals that the law is given
            ("base", record_dtype(CLOCK + MEASURED)),  # the measurements at B, if the law is at a tool
            (
                "sensed",
                record_dtype(CLOCK + MEASURED),
            ),  # the measurements, if an observer replaces their force
            ("command", record_dtype((*CLOCK, WRENCH_COMMAND))),  # of the law, where something is before the actuation
            ("delayed", record_dtype((*CLOCK, WRENCH_COMMAND))),
            ("allocation", record_dtype(actuation_given(m))),
            ("commands", record_dtype(thrusters_given(m))),
            ("around", record_dtype(effect_given(m)), (max(1, self.own_frames),)),  # what effects are given, by frames
            ("tau_cmd", "i8"),  # place of the law's command
            ("has_task", "i8"),  # whether the impedance task sets s
            # thrusters
            ("columns", "f8", (m, 6)),  # the columns of B
            ("columns_hat", "f8", (m, 6)),  # and of the file's
            *_whole("believed", "ideal"),  # whether tau_hat may differ from tau; whether the thrust is u_cmd
            ("tau_lost", "f8", (6,)),  # the actuation's tau_cmd - tau_hat
            *((name, "f8", (m,)) for name in ("low", "high", "thrust_of_ctrl")),  # limits of the vehicle's file
            ("places", "f8", (m if self.effects["buoyancy"].shape[0] else 0, 3)),  # in B, of a vehicle at the surface
            ("ctrl_index", "i8", (m,)),
            ("thrust", "f8", (m,)),  # as the thrusters set it
            ("u", "f8", (m,)),  # within the limits of the vehicle's file
            ("saturated", "i8"),  # whether a command is at its limit
            ("limited", "f8", (m,)),  # time of each command at its limits until t_k
            ("limited_next", "f8", (m,)),  # and until t_(k+1)
            ("tau_before", "f8", (6,)),
            # joints
            ("model", model_dtype(n)),
            ("encoder", record_dtype(encoder_given(n))),  # positions and velocities at t_k
            ("joints", record_dtype(joints_given(n))),  # what their interface is given
            ("encoded", "i8"),  # whether the encoder is not perfect
            ("frames_m", FRAME, (1 + n,)),  # of the links at the measured positions, if it is not
            ("q_ddot", "f8", (n,)),  # of the last step
            ("tau_q_demand", "f8", (n,)),  # torque that the interface sets
            ("tau_q", "f8", (n,)),  # and the torque of the motors
            ("motor_index", "i8", (n,)),  # index in ctrl, -1 without a motor
            ("torque_of_ctrl", "f8", (n,)),
            ("saturation", "f8", (n,)),  # time at the motors' limits until t_k
            ("saturation_next", "f8", (n,)),  # and until t_(k+1)
            ("q_safe", "f8", (n,)),  # initial positions
            # the current step
            ("remaining", "i8"),  # evaluations that are steps, before Simulation has the next word
            ("step", "i8"),  # number of steps begun
            ("observed", "i8"),  # the step for which state and contact were read, plus one
            ("pending", "i8"),  # whether the last step still lacks its contact force and acceleration
            ("t", "f8"),
            ("true", TRUTHS),
            ("quat_WT", "f8", (4,)),  # attitude of the true tool
            ("qpos_safe", "f8", (7,)),  # initial pose
            # rows
            ("row", ROW),
            ("row_steps", "i8"),  # time steps from row to row
            ("spans", "i8", (MOST_SPANS, 2)),  # place and size of each part of a row
            ("banded", "i8", (MOST_BANDS, 2)),  # place and size of each signal with a band
            *_whole("span_count", "banded_count"),
            *_whole("bands", "band_steps"),  # place of their least and largest values; steps since the last row
            *_whole("rows", "row_width", "row_capacity", "row_count"),  # their place; the last counts the written ones
            # why the run stops: divergence or an error of a stage
            *_whole("stop", "stop_index"),
            ("stop_value", "f8"),
        ]
        if n:
            fields.append(("wrist", wrist_dtype(n)))
        return np.dtype(fields, align=True)


@functools.cache
def alone_dtype(joints: int, effects: np.dtype = NO_EFFECTS) -> np.dtype:
    """A vehicle in the water without a closed loop."""
    return np.dtype([("plant", plant_dtype(joints, effects))], align=True)


@functools.cache
def with_numbers(dtype: np.dtype) -> np.dtype:
    """A record as kernels have it: with the fields ``numbers`` and ``integers``, which are all of its memory and what
    lies behind it."""
    fields: Any = dtype.fields
    names = [*fields, "numbers", "integers"]
    formats = [*(kind for kind, *_ in fields.values()), ("f8", (NUMBERS,)), ("i8", (NUMBERS,))]
    offsets = [*(at for _, at, *_ in fields.values()), 0, 0]
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": 8 * NUMBERS})


def integers_of(kind: np.dtype, at: int = 0) -> Iterator[int]:
    """The offsets of the integers of a record that lies at an offset [bytes]."""
    if kind.subdtype is not None:
        base, shape = kind.subdtype
        for k in range(int(np.prod(shape))):
            yield from integers_of(base, at + k * base.itemsize)
    elif kind.fields is not None:
        for part, offset, *_ in kind.fields.values():
            yield from integers_of(part, at + offset)
    elif kind.kind == "i":
        yield at


@dataclass(frozen=True)
class Field:
    """A part of the first record of an image: its offset [bytes] and its dtype."""

    offset: int
    dtype: np.dtype

    @classmethod
    def of(cls, record: np.dtype, *names: str) -> "Field":
        """A field of a field of a record."""
        part, offset = record, 0
        for name in names:
            fields: Any = part.fields
            part, at = fields[name][:2]
            offset += at
        return cls(offset, part)

    @property
    def place(self) -> int:
        return self.offset // 8

    def entry(self, i: int) -> "Field":
        """An entry of an array, along its first axis."""
        kind: Any = self.dtype.subdtype
        base, (_, *shape) = kind
        part = np.dtype((base, tuple(shape))) if shape else base
        return Field(self.offset + i * part.itemsize, part)


NODES = ".nodes"
"""The end of the names of the rooms for nodes of Gauss-Markov processes."""


class Image:
    """Memory with records by their names, and rooms of so many numbers each.

    Attributes:
        numbers: all of it as float64 numbers; a place is an index into them.
        fixed: the bytes of the records, without the rooms.
    """

    def __init__(self, records: Mapping[str, np.dtype], rooms: Mapping[str, int]) -> None:
        self._at: dict[str, tuple[int, np.dtype]] = {}
        at = 0
        for name, kind in records.items():
            self._at[name] = at, kind
            at += -(-kind.itemsize // 8) * 8
        self._rooms, size = dict[str, tuple[int, int]](), at
        for name, n in rooms.items():
            self._rooms[name] = size // 8, n
            size += 8 * n
        if size > 8 * NUMBERS:
            raise InputError(f"a run has room for {NUMBERS} numbers; its tables and settings have more")
        # pages that nobody touches take no memory, and a copy of the process has its own
        self.bytes = np.frombuffer(mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE), np.uint8)
        self.fixed, self.numbers = self.bytes[:at], self.bytes.view(np.float64)
        self.address = int(self.bytes.ctypes.data)

    def record(self, name: str) -> np.ndarray:
        """A record (1,)."""
        at, kind = self._at[name]
        return np.ndarray(1, kind, self.bytes, at)

    def view(self, field: Field) -> np.ndarray:
        """A part of the first record: a record (1,), or an array."""
        if field.dtype.subdtype is None:
            return np.ndarray(1, field.dtype, self.bytes, field.offset)
        base, shape = field.dtype.subdtype
        return np.ndarray(shape, base, self.bytes, field.offset)

    def place(self, array: np.ndarray) -> int:
        """The place of the first number of an array in this memory."""
        return (int(array.ctypes.data) - self.address) // 8

    def room(self, name: str) -> tuple[int, np.ndarray]:
        """The place of a room and its numbers."""
        place, n = self._rooms[name]
        return place, self.numbers[place : place + n]

    def saved(self) -> dict[str, np.ndarray]:
        """Copies of what a step changes: the records, and the nodes of Gauss-Markov processes. The tables change at a
        reset, and rows and bands belong to a run that is recorded."""
        found = {name: self.room(name)[1].copy() for name in self._rooms if name.endswith(NODES)}
        return {"": self.fixed.copy(), **found}

    def put_back(self, saved: Mapping[str, np.ndarray]) -> None:
        """Put back what :meth:`saved` gave."""
        for name, numbers in saved.items():
            (self.room(name)[1] if name else self.fixed)[:] = numbers

    def check_room(self, name: str, key: str, table: np.ndarray) -> None:
        """Raise InputError if the rows (n, width) of the table of a key are more than its room takes."""
        _, room = self.room(name)
        if table.size > room.size:
            most = room.size // table.shape[1]
            raise InputError([Fault(key, f"has {len(table)} rows; a reset takes {most}; make a new Simulation")])

    def put(self, name: str, table: np.ndarray) -> tuple[int, int]:
        """Put the rows (n, width) of a table into its room. Returns its place and n."""
        place, room = self.room(name)
        room[: table.size] = table.reshape(-1)
        return place, len(table)


def water_rooms() -> dict[str, int]:
    """The rooms for the tables of the water, and for the nodes of its Gauss-Markov processes."""
    rooms = {f"{name}.{field}": MOST_ROWS * width for name, each in TABLES.items() for field, width in each.items()}
    kinds: dict[str, Any] = {name: kind.fields for name, kind in EFFECTS.items()}
    processes = {name: fields["deviation"][0].shape[0] for name, fields in kinds.items() if "nodes" in fields}
    return rooms | {f"{name}{NODES}": n * ROWS for name, n in processes.items()}
