"""Memory for a user's law: copies of its arguments, each with a guarded margin on either side.

A write that misses an array by up to a megabyte hits a margin and not the loop's own records. The margins are filled
with a NaN, which propagates through all arithmetic with a number read from there and is then detected.
"""

import math
import mmap
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

MARGIN = (1 << 20) + 4096
"""Size of the margin on either side of an array [bytes]."""
PATTERN = 0x7FF8DECADE0FACED
"""Contents of the margins: a quiet NaN that no computation produces."""
UNSET = PATTERN + 1
"""Contents of tau_cmd before the first call: a second NaN, which shows that the law did not set an entry."""
NEAR = 8
"""Numbers of each margin, next to its array, that are checked after each call of a compiled law."""
NEARBY = 4096
"""Bytes on either side of an array that are checked after each chunk, and after each call of a plain Python law."""
REGIONS = ("gains", "signals", "state", "state_dot", "tau_cmd")


def offsets(sizes: Mapping[str, int]) -> dict[str, int]:
    """Offset of each array [bytes] from the arrays' sizes [bytes]; also of ``own_gains``, the copy of the gains to
    compare with, and of ``end``."""
    found, place = {}, 0
    for name in REGIONS:
        found[name] = place + MARGIN
        place = found[name] + sizes[name] + MARGIN
    return found | {"own_gains": place, "end": place + sizes["gains"]}


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
    """The arguments of a law: gains, signals, states, their derivatives and tau_cmd.

    Args:
        gains: record of the gains (1,).
        state: record of the states (1,).
        signals: dtype of the record of signals.
    """

    def __init__(self, gains: np.ndarray, state: np.ndarray, signals: np.dtype) -> None:
        states = spread(state.dtype)
        kinds = {"gains": gains.dtype, "signals": signals, "state": states, "state_dot": states}
        self.sizes = {name: kind.itemsize for name, kind in kinds.items()} | {"tau_cmd": 48}
        self.offsets = offsets(self.sizes)
        memory = mmap.mmap(-1, self.offsets["end"])
        self._words = np.frombuffer(memory, np.int64)
        self._words[:] = PATTERN
        self.arrays = {name: np.ndarray(1, kind, memory, self.offsets[name]) for name, kind in kinds.items()}
        self._part("tau_cmd")[:] = UNSET
        self.arrays["tau_cmd"] = self._part("tau_cmd").view(float)
        self._own_gains = self._words[self.offsets["own_gains"] // 8 :].view(gains.dtype)
        self.arrays["gains"][:] = self._own_gains[:] = gains
        self._part("signals")[:] = 0
        for record in ("state", "state_dot"):
            self._set(record, dict.fromkeys(states.names or (), 0.0))

    @property
    def address(self) -> int:
        """Address of the first byte."""
        return int(self._words.ctypes.data)

    def fill(self, signals: np.ndarray, state: np.ndarray) -> None:
        """Copy the signals and states of a control instant into the arena.

        Args:
            signals: record of the signals, as bytes.
            state: record of the states (1,).
        """
        self._part("signals")[:] = signals.view(np.int64)
        self._set("state", {name: state[name] for name in state.dtype.names or ()})

    def reset(self) -> None:
        """Restore the gains, and set state_dot and tau_cmd to zero."""
        self.arrays["gains"][:] = self._own_gains
        self._part("tau_cmd")[:] = 0
        self._set("state_dot", dict.fromkeys(self.arrays["state_dot"].dtype.names or (), 0.0))

    def _set(self, record: str, values: Mapping[str, Any]) -> None:
        for name, value in values.items():  # field by field: the margins between them stay as they are
            self.arrays[record][name] = value

    def _part(self, name: str) -> np.ndarray:
        start = self.offsets[name] // 8
        return self._words[start : start + self.sizes[name] // 8]

    def fault(self) -> str:
        """The law's violation as a predicate, e.g. "changed its gain k_1 from ..."; empty if there is none."""
        return self.overrun() or self.changed_gain() or self.not_finite()

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
        """Each guarded array: what a law calls its beginning and its end, and where they are [numbers]."""
        for name in REGIONS:
            start = self.offsets[name] // 8
            fields = self.arrays[name].dtype.fields
            if name in ("state", "state_dot") and fields and self.sizes[name]:
                for state, (kind, place, *_) in fields.items():
                    called, first = f"{name}.{state}", start + place // 8
                    yield called, called, first, first + kind.itemsize // 8
            else:
                yield self._called(name, 0), self._called(name, -1), start, start + self.sizes[name] // 8

    def _called(self, name: str, field: int) -> str:
        """Name of an array as a law writes it; of a record, the name of its first (0) or last (-1) field."""
        names = self.arrays[name].dtype.names
        return f"{name}.{names[field]}" if names and self.sizes[name] else name

    def changed_gain(self) -> str:
        """The first gain that the law changed, as a predicate; empty if there is none."""
        for name in self._own_gains.dtype.names or ():
            now, was = self.arrays["gains"][name][0], self._own_gains[name][0]
            if np.asarray(now).tobytes() != np.asarray(was).tobytes():
                return f"changed its gain {name} from {_shown(was)} to {_shown(now)}; gains are constant during a run"
        return ""

    def not_finite(self) -> str:
        """The first entry of tau_cmd, state_dot or state that is not finite or was never set, as a predicate; empty
        if there is none."""
        tau_cmd = self.arrays["tau_cmd"]
        for i in range(6):
            if not math.isfinite(tau_cmd[i]):
                if tau_cmd.view(np.int64)[i] == UNSET:
                    return f"left tau_cmd[{i}] unset: a law must fill all six entries of tau_cmd; {_IGNORED}"
                return f"set tau_cmd[{i}] to {tau_cmd[i]}"
        for record in ("state_dot", "state"):
            for name in self.arrays[record].dtype.names or ():
                for i, value in enumerate(self.arrays[record][name][0]):
                    if not math.isfinite(value):
                        verb = "set" if record == "state_dot" else "let"
                        return f"{verb} {record}.{name}[{i}] {'to' if verb == 'set' else 'become'} {value}"
        return ""


_IGNORED = "its return value is ignored"


def _overrun(array: str, count: int, reach: int, side: str) -> str:
    numbers = "1 number" if count == 1 else f"{count} numbers"
    return f"wrote {numbers} {side} of {array}, up to {reach} bytes away"


def _shown(value: np.ndarray) -> str:
    return str(np.asarray(value).tolist())
