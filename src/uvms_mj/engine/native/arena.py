"""Memory for a user's stage: copies of its arguments, each with a guarded margin on either side.

A write that misses an array by up to a megabyte hits a margin and not the loop's own records. The margins are filled
with a NaN, which propagates through all arithmetic with a number read from there and is then detected.
"""

import math
import mmap
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ...physics.frames import rotation_matrix
from ...stages.base import Room

MARGIN = (1 << 20) + 4096
"""Size of the margin on either side of an array [bytes]."""
PATTERN = 0x7FF8DECADE0FACED
"""Contents of the margins: a quiet NaN that no computation produces."""
UNSET = PATTERN + 1
"""Contents of the output before the first call: a second NaN, which shows that the stage did not set an entry."""
NEAR = 8
"""Numbers of each margin, next to its array, that are checked after each call of a compiled stage."""
NEARBY = 4096
"""Bytes on either side of an array that are checked after each chunk, and after each call of a plain Python stage."""
UNIT = 1e-6
"""Largest difference of a quaternion's squared length from 1."""
SAME = 1e-5
"""Largest difference of an entry of a rotation matrix from the matrix of its quaternion."""
REGIONS = ("settings", "given", "state", "state_dot", "out")


def offsets(sizes: Mapping[str, int]) -> dict[str, int]:
    """Offset of each array [bytes] from the arrays' sizes [bytes]; also of ``own_settings``, the copy of the settings
    to compare with, of ``matrix``, nine numbers for a rotation matrix, and of ``end``."""
    found, place = {}, 0
    for name in REGIONS:
        found[name] = place + MARGIN
        place = found[name] + sizes[name] + MARGIN
    behind = place + sizes["settings"]
    return found | {"own_settings": place, "matrix": behind, "end": behind + 72}


def attitudes(out: np.dtype) -> tuple[tuple[str, str], ...]:
    """The names of the quaternions of an output, each with the name of its rotation matrix, or empty."""
    names = out.names or ()
    found = [(name, name.replace("quat", "R")) for name in names if name.startswith("quat")]
    return tuple((quat, R if R in names else "") for quat, R in found)


def spread(states: np.dtype) -> np.dtype:
    """The record of states as it is in the arena: a margin behind each state and one before the next."""
    names, kinds = states.names or (), [states[name] for name in states.names or ()]
    places, place = [], 0
    for kind in kinds:
        places.append(place)
        place += kind.itemsize + 2 * MARGIN
    size = places[-1] + kinds[-1].itemsize
    return np.dtype({"names": names, "formats": kinds, "offsets": places, "itemsize": size}, align=True)


class Arena:
    """The arguments of a stage: settings (1,), what it is given, states (1,), their derivatives and its output, a
    record or an array of float64. The messages use the words of the stage's room."""

    def __init__(self, room: Room, settings: np.ndarray, state: np.ndarray, given: np.dtype, out: np.dtype) -> None:
        self.room = room
        names = room.arguments
        self.names = dict(zip(("settings", "state", "given", "state_dot", "out"), names, strict=True))
        states = spread(state.dtype)
        kinds = {"settings": settings.dtype, "given": given, "state": states, "state_dot": states, "out": out}
        self.sizes = {name: kind.itemsize for name, kind in kinds.items()}
        self.offsets = offsets(self.sizes)
        memory = mmap.mmap(-1, self.offsets["end"], flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        if hasattr(mmap, "MADV_HUGEPAGE"):  # of Linux: the arrays lie far apart, and each small page costs a look-up
            memory.madvise(mmap.MADV_HUGEPAGE)
        self._words = np.frombuffer(memory, np.int64)
        self._words[:] = PATTERN
        self.arrays = {name: np.ndarray(1, kind, memory, self.offsets[name]) for name, kind in kinds.items()}
        if out.names is None:
            self.arrays["out"] = self.arrays["out"][0]
        self._own_settings = self._words[self.offsets["own_settings"] // 8 :][: settings.nbytes // 8].view(
            settings.dtype
        )
        self.part("given")[:] = 0
        self.take_settings(settings)
        self.start()

    def take_settings(self, settings: np.ndarray) -> None:
        """Copy other settings (1,) into the arena."""
        self.arrays["settings"][:] = self._own_settings[:] = settings

    def start(self) -> None:
        """Prepare for a run. The states are those of the loop at each instant."""
        self.reset()
        self.part("out")[:] = UNSET
        for name in self.room.optional:
            self.arrays["out"][name] = 0.0
        self._set("state", dict.fromkeys(self.arrays["state"].dtype.names or (), 0.0))

    @property
    def address(self) -> int:
        """Address of the first byte."""
        return int(self._words.ctypes.data)

    def fill(self, given: np.ndarray, state: np.ndarray) -> None:
        """Copy what a stage is given at an instant, a record (1,), and its states (1,) into the arena."""
        self.part("given")[:] = given.view(np.int64)
        self._set("state", {name: state[name] for name in state.dtype.names or ()})

    def take(self, state: np.ndarray, state_dot: np.ndarray, out: np.ndarray) -> None:
        """Copy states (1,), their derivatives (1,) and the output out of the arena."""
        for name in state.dtype.names or ():
            state[name], state_dot[name] = self.arrays["state"][name], self.arrays["state_dot"][name]
        out.view(np.int64)[:] = self.part("out")

    def reset(self) -> None:
        """Restore the settings, and set state_dot and the output to zero."""
        self.arrays["settings"][:] = self._own_settings
        self.part("out")[:] = 0
        self._set("state_dot", dict.fromkeys(self.arrays["state_dot"].dtype.names or (), 0.0))

    def _set(self, record: str, values: Mapping[str, Any]) -> None:
        for name, value in values.items():  # field by field: the margins between them stay as they are
            self.arrays[record][name] = value

    def part(self, name: str) -> np.ndarray:
        """The numbers of an argument as integers."""
        start = self.offsets[name] // 8
        return self._words[start : start + self.sizes[name] // 8]

    def fault(self) -> str:
        """The violation as a predicate, e.g. "changed its gain k_1 from ..."; empty if there is none."""
        return self.overrun() or self.wrong()

    def overrun(self, margin: int = MARGIN) -> str:
        """The array that was overrun, the direction and the distance, as a predicate; empty if there is none.

        Args:
            margin: bytes to search on either side of each array.
        """
        margin //= 8
        for first, last, start, end in self._arrays():
            before = np.flatnonzero(self._words[start - margin : start] != PATTERN)
            behind = np.flatnonzero(self._words[end : end + margin] != PATTERN)
            if len(before):
                return _overrun(first, len(before), 8 * (margin - before[0]), "before the beginning")
            if len(behind):
                return _overrun(last, len(behind), 8 * (behind[-1] + 1), "beyond the end")
        return ""

    def _arrays(self) -> Iterator[tuple[str, str, int, int]]:
        """Each guarded array: what the stage calls its beginning and its end, and where they are [numbers]."""
        for name in REGIONS:
            start = self.offsets[name] // 8
            fields = self.arrays[name].dtype.fields
            if name in ("state", "state_dot") and fields and self.sizes[name]:
                for state, (kind, place, *_) in fields.items():
                    called, first = f"{self.names[name]}.{state}", start + place // 8
                    yield called, called, first, first + kind.itemsize // 8
            else:
                yield self._called(name, 0), self._called(name, -1), start, start + self.sizes[name] // 8

    def _called(self, name: str, field: int) -> str:
        """Name of an array as the stage writes it; of a record, the name of its first (0) or last (-1) field."""
        names = self.arrays[name].dtype.names
        called = self.names[name]
        return f"{called}.{names[field]}" if names and self.sizes[name] else called

    def wrong(self) -> str:
        """As :meth:`fault`, without the margins."""
        return self.changed_setting() or self.not_finite() or self.wrong_attitude()

    def changed_setting(self) -> str:
        """The first setting that the stage changed, as a predicate; empty if there is none."""
        noun = self.room.setting
        for name in self._own_settings.dtype.names or ():
            now, was = self.arrays["settings"][name][0], self._own_settings[name][0]
            if np.asarray(now).tobytes() != np.asarray(was).tobytes():
                change = f"from {_shown(was)} to {_shown(now)}"
                return f"changed its {noun} {name} {change}; {noun}s are constant during a run"
        return ""

    def not_finite(self) -> str:
        """The first entry of the output, of state_dot or of state that is not finite or was never set, as a predicate;
        empty if there is none."""
        out, called = self.arrays["out"], self.names["out"]
        fields = {f"{called}.{name}": out[name].reshape(-1) for name in out.dtype.names or ()} or {called: out}
        for name, values in fields.items():
            for i, value in enumerate(values):
                if values.view(np.int64)[i] == UNSET:
                    return f"left {name}[{i}] unset: {self._demand()}; its return value is ignored"
                if not math.isfinite(value):
                    return f"set {name}[{i}] to {value}"
        for record in ("state_dot", "state"):
            for name in self.arrays[record].dtype.names or ():
                for i, value in enumerate(self.arrays[record][name][0]):
                    if not math.isfinite(value):
                        verb = "set" if record == "state_dot" else "let"
                        return f"{verb} {record}.{name}[{i}] {'to' if verb == 'set' else 'become'} {value}"
        return ""

    def wrong_attitude(self) -> str:
        """The first quaternion of the output that is not a unit quaternion, or the rotation matrix that has another
        attitude, as a predicate; empty if there is none."""
        out, called = self.arrays["out"], self.names["out"]
        for name, R in attitudes(out.dtype):
            quat = out[name][0]
            if not abs(quat @ quat - 1.0) <= UNIT:
                return f"set {called}.{name} to length {math.sqrt(quat @ quat):.9g}: it must be a unit quaternion"
            if R and not (abs(out[R][0] - rotation_matrix(quat)) <= SAME).all():
                same = f"uvms_mj.physics.frames.rotation({called}.{name}, {called}.{R}) sets it"
                return f"set {called}.{R} to another attitude than {called}.{name}: {same}"
        return ""

    def _demand(self) -> str:
        fields, called = self.arrays["out"].dtype.names, self.names["out"]
        who = f"{'an' if self.room.noun[0] in 'aeiou' else 'a'} {self.room.noun}"
        if fields:
            return f"{who} must set {', '.join(fields)} of {called}"
        number = {6: "six"}.get(len(self.arrays["out"]), len(self.arrays["out"]))
        return f"{who} must fill all {number} entries of {called}, as in {called}[:] = ..."


def _overrun(array: str, count: int, reach: int, side: str) -> str:
    numbers = "1 number" if count == 1 else f"{count} numbers"
    return f"wrote {numbers} {side} of {array}, up to {reach} bytes away"


def _shown(value: np.ndarray) -> str:
    return str(np.asarray(value).tolist())
