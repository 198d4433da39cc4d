"""Objects that are known when compiling: of names that a function reads, their attributes, and constants."""

import ast
import enum
import functools
import inspect
import sys
import types
from typing import Any

import numpy as np

from .arrays import Arrays
from .changes import Changes, changes_of
from .values import (
    BOOL,
    FLOAT,
    INT,
    NONE,
    OUTSIDE,
    Form,
    Known,
    Value,
    bundle,
    contiguous,
    items_of,
    known_object,
    whole,
)

MISSING = object()
"""The value of a name that is not known when compiling."""
LIST = Form(list)
_NUMBERS = (bool, int, float, np.bool_, np.int64, np.float64)
_PLAIN = (str, bytes, int, float, complex, list, dict, set, frozenset, tuple, np.ndarray, np.generic, type(None))
"""Objects whose attributes are methods, which the language knows or does not."""
_WITHOUT = (types.FunctionType, types.BuiltinFunctionType, types.MethodType, np.ufunc)
TEXT = object()
"""A text that is not known when compiling, which only can be printed."""


class KnownObjects(Arrays):
    """The objects that expressions stand for without code, and the constants that they become."""

    constants: dict[str, Value]
    assigned: set[str]
    locals: set[str]
    names: dict[str, Any]

    def _entry(self, owner: dict, node: ast.Subscript) -> Any:
        raise NotImplementedError  # forms have it

    @functools.cached_property
    def changes(self) -> Changes:
        """The changes by the functions of this one's file."""
        return changes_of(self.function) if self.unit.checked else Changes()

    def known(self, node: ast.expr) -> Any:
        """The meaning of an expression that is no number, array or tuple: a function, a module, a text; of a global
        name, anything. MISSING for what is not known when compiling."""
        if isinstance(node, ast.Name):
            if node.id in self.locals:
                return self.object_of(self._present(node.id))
            return self._global(node.id)
        if isinstance(node, ast.Attribute):
            owner = self.known(node.value)
            return MISSING if owner is MISSING else self.attribute_of(owner, node)
        if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant | ast.Name | ast.Attribute):
            owner = self.known(node.value)
            if type(owner) is dict:
                return self._entry(owner, node)
        return MISSING

    def _global(self, name: str) -> Any:
        known = self.names.get(name, MISSING)
        if known is MISSING:
            known = self.function.__globals__.get(name, MISSING)
        if known is MISSING:
            self.mistake(f"{name} is not defined")
        if not isinstance(known, types.ModuleType) and (line := self.changes.of(name, known, self.changes.names)):
            self.lack(f"{name} changes in line {line}, while the run goes on; keep it in a state or a memory")
        return known

    def _present(self, name: str) -> Value:
        """The value of a local name, without code for numbers and arrays."""
        if name in self.constants and name in self.assigned:
            return self.constants[name]
        its = self.kind_of_name(name)
        return Value(NONE if its is None or its.form is None else its, ())

    def kind_of_name(self, name: str) -> Any:
        raise NotImplementedError  # expressions have it

    @staticmethod
    def object_of(value: Value) -> Any:
        """The object of a value that is known, otherwise MISSING."""
        form = value.kind.form
        return form.of if isinstance(form, Known) and value.kind.items is None and form.of is not TEXT else MISSING

    def attribute_of(self, owner: Any, node: ast.Attribute) -> Any:
        """An attribute of an object that is known; MISSING for one that the language has a word of its own for."""
        name = node.attr
        if isinstance(owner, tuple) and name in getattr(owner, "_fields", ()):
            return getattr(owner, name)
        if isinstance(owner, _PLAIN) and not isinstance(owner, enum.Enum):
            return MISSING
        if isinstance(owner, _WITHOUT):
            return getattr(owner, name, MISSING)
        self.demand_unchanged(owner, name, node)
        if isinstance(inspect.getattr_static(type(owner), name, None), property):
            return MISSING if isinstance(owner, enum.Enum) else self.lack("the language has no property of an object")
        try:
            return getattr(owner, name)
        except AttributeError:
            return self.mistake(f"{ast.unparse(node.value)} has no {name!r}")

    def demand_unchanged(self, owner: Any, name: str, node: ast.expr) -> None:
        """Refuse an attribute that may be changed in the run."""
        if line := self._changed(owner, name):
            self.lack(f"{ast.unparse(node)} may change in line {line}, while the run goes on; keep it in a state")

    def _changed(self, owner: Any, name: str) -> int:
        """A line where an attribute of an object may be changed in the run, otherwise 0."""
        parameters = getattr(type(owner), "__dataclass_params__", None)
        if isinstance(owner, enum.Enum) or (parameters is not None and parameters.frozen):
            return 0
        if isinstance(owner, types.ModuleType) and self.is_foreign(owner):
            return 0
        value = inspect.getattr_static(owner, name, None)
        return self.changes.of(name, value, self.changes.attributes)

    def frozen(self, value: Any) -> Value:
        """A global number, tuple, list or array as a constant; any other object as one that is known."""
        if value is None:
            return Value(NONE, ())
        if type(value) in _NUMBERS:
            return self.constant(value)
        if isinstance(value, enum.IntEnum):
            return whole(int(value))
        if isinstance(value, np.ndarray):
            return self._frozen_array(value)
        if isinstance(value, np.void):
            self.lack("a global record is not a constant; write its numbers")
        if type(value) in (tuple, list) or (isinstance(value, tuple) and hasattr(value, "_fields")):
            form = None if type(value) is tuple else Form(type(value), getattr(value, "_fields", ()))
            return bundle([self.frozen(each) for each in value], form)
        if isinstance(value, int | float | complex | np.generic) and not isinstance(value, enum.Enum):
            return self.constant(value)
        return known_object(value)

    def _frozen_array(self, array: np.ndarray) -> Value:
        if type(array) is not np.ndarray or array.dtype not in (np.dtype("f8"), INT, BOOL) or not array.dtype.isnative:
            self.lack(f"a constant array has numbers of float64, int64 or bool, not {array.dtype}")
        base = {"f": np.dtype("f8"), "i": INT, "b": BOOL}[array.dtype.kind]
        memory = self.unit.constant_array(np.ascontiguousarray(array, base))
        why = "it is a constant of the compiled code; keep what changes in a state or a memory"
        return Value(contiguous(base, array.shape, f"lacks: {why}"), (memory,), roots=frozenset({OUTSIDE}))

    def python(self, value: Value) -> Any:
        """The object of Python that a value is known to be, otherwise MISSING."""
        kind = value.kind
        if kind.is_none:
            return None
        if kind.items is None:
            known = self.object_of(value)
            if known is MISSING and value.constant is not None:
                known = {INT: int, BOOL: bool, FLOAT: float}[kind.base](value.constant)
            return known
        if kind.form not in (None, LIST):
            return MISSING
        items = [self.python(item) for item in items_of(value)]
        return MISSING if MISSING in items else tuple(items) if kind.form is None else items

    @staticmethod
    def is_foreign(known: Any) -> bool:
        """Whether a module, or a function, belongs to a library, and is in the language by name only."""
        name = known.__name__ if isinstance(known, types.ModuleType) else getattr(known, "__module__", None)
        first = str(name).partition(".")[0]
        return first in ("numpy", "scipy") or first in sys.stdlib_module_names
