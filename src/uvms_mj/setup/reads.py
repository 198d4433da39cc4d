"""Which parts of a setup a function reads: it need not be called again for a setup that differs in others.

A part is a key of a plain table, ``wall.stiffness``, a stage or a list of tables as a whole, ``controller`` and
``walls``, or one of ``design`` and ``contacts``. The plant is none: no change reaches it.
"""

import dataclasses
import functools
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Set
from typing import Any

from ..stages.base import Stage, is_shipped
from .base import Setup


class Reads:
    """The parts of a setup that functions read, each found by one call.

    A function depends on its arguments and the setup alone, which is the last of them. So it gives the same, and reads
    the same, of each setup that agrees with this one in the parts that it reads of this one.
    """

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self.found: dict[Hashable, Set[str]] = {}
        self.users = {table for table, stage in setup.scenario.named_stages.items() if not is_shipped(stage)}

    def find(self, function: Callable[..., Any], *arguments: Any) -> Set[str]:
        """The parts that a function reads."""
        found = set[str]()
        made = function(*arguments, watched(self._setup, found))
        if isinstance(made, Iterator):
            deque(made, maxlen=0)
        self.found[function, *arguments] = found
        return found


class Change:
    """Overrides of a scenario by dotted keys, as :func:`uvms_mj.quantities.overrides_of` gives them, and which
    functions of its setup they concern: all of them without :class:`Reads` of this setup."""

    def __init__(self, overrides: Mapping[str, Any], reads: Reads | None = None) -> None:
        self.overrides, self._reads = overrides, reads
        whole = [key.partition("[")[0] for key in overrides]
        self._parts = {*whole, *(key.partition(".")[0] for key in whole)}

    def add(self, parts: Iterable[str]) -> None:
        """Add parts that have been made anew."""
        self._parts |= {*parts}

    def concerns(self, function: Callable[..., Any], *arguments: Any) -> bool:
        """Whether a function of arguments and a setup has to be called again."""
        if self._reads is None:
            return True
        found = self._reads.found.get((function, *arguments))
        return not self._parts.isdisjoint(self._reads.find(function, *arguments) if found is None else found)

    def concerns_stage(self, function: Callable[..., Any], table: str, *arguments: Any) -> bool:
        """As :meth:`concerns`, for a function of the name of a table and more that calls a method of its stage. A
        user's method may read anything."""
        return self._reads is None or table in self._reads.users or self.concerns(function, table, *arguments)


ANYTHING = Change({})
"""What concerns every function."""


def watched(setup: Setup, found: set[str]) -> Any:
    """A copy of a setup that notes in ``found`` the parts that are read of it."""
    tables = {f.name: getattr(setup.scenario, f.name) for f in dataclasses.fields(setup.scenario)}
    plain = {
        name: _noting(table, found, f"{name}.")
        for name, table in tables.items()
        if dataclasses.is_dataclass(table) and not isinstance(table, Stage)
    }
    scenario = _noting(setup.scenario, found, "", plain)
    return _noting(setup, found, "", {"scenario": scenario, "plant": setup.plant})


def _noting(value: Any, found: set[str], prefix: str, unnoted: dict[str, Any] | None = None) -> Any:
    """A copy of a dataclass, without what it has cached, that notes which of its fields are read, but for those whose
    values are given."""
    given, names = unnoted or {}, [f.name for f in dataclasses.fields(value)]
    copy = object.__new__(_noting_class(type(value), prefix, frozenset(names).difference(given)))
    fields = {name: getattr(value, name) for name in names} | given
    object.__getattribute__(copy, "__dict__").update(fields, _found=found)
    return copy


@functools.cache
def _noting_class(kind: Any, prefix: str, noted: frozenset[str]) -> type:
    read = object.__getattribute__

    def note(self: Any, part: str) -> None:
        read(self, "__dict__").get("_found", set()).add(part)  # a changed copy has none; who made it has read all

    def __getattribute__(self: Any, name: str) -> Any:
        if name in noted:
            note(self, prefix + name)
        elif name == "__dict__" and prefix:
            note(self, prefix[:-1])
        return read(self, name)

    def __eq__(self: Any, other: object) -> bool:
        names = [f.name for f in dataclasses.fields(kind)]
        return isinstance(other, kind) and all(getattr(self, name) == getattr(other, name) for name in names)

    methods: dict[str, Any] = {"__getattribute__": __getattribute__}
    if kind.__eq__ is not object.__eq__:
        methods |= {"__eq__": __eq__, "__hash__": kind.__hash__}
    return type(kind.__name__, (kind,), methods)
