"""Forms that reduce to numbers, arrays and tuples: objects known when compiling, lists, dicts, comprehensions.

An object that is known when compiling, as a text, a class, a function or a dict of the module, has no code. A list is a
tuple that belongs to ``list``, and a dict is a tuple with known keys. Both are values: a change in place makes
another one, and is refused where anything else could hold the list. A comprehension is written out.
"""

import ast
import dataclasses
import enum
import functools
import inspect
import types
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from llvmlite import ir

from ..files import parsed
from .known import LIST, MISSING, TEXT, KnownObjects
from .values import (
    BOOL,
    FLAG,
    FLOAT,
    INT,
    NONE,
    WORD,
    Form,
    Memory,
    Value,
    bundle,
    items_of,
    known_object,
    scalar,
    whole,
)

MOST_TURNS = 256
"""A loop of up to so many turns may be written out, with those around it, and is not looked at for an interrupt."""
_OF_TEXTS = ("lower", "upper", "strip", "startswith", "endswith", "replace", "split", "title", "capitalize", "format")
_OF_DICTS = ("get", "items", "keys", "values")


class Given(ast.expr):
    """A value in place of an expression."""

    def __init__(self, value: Value) -> None:
        super().__init__()
        self.value = value


class Forms(KnownObjects):
    """Texts, lists and dicts, comprehensions, comparisons and functions within functions."""

    def known(self, node: ast.expr) -> Any:
        return self.object_of(node.value) if isinstance(node, Given) else super().known(node)

    def variable(self, name: str) -> Value:
        raise NotImplementedError  # statements have it

    def iteration(self, node: ast.expr) -> Any:
        raise NotImplementedError

    def deciding(
        self, operands: Iterable[Callable[[], Value]], operator: ast.boolop, last: Callable[[], Value]
    ) -> Value:
        raise NotImplementedError  # expressions have it

    # texts

    def _Constant(self, node: ast.Constant) -> Value:
        if isinstance(node.value, bytes | complex) or node.value is ...:
            self.lack(f"the language has no {type(node.value).__name__}")
        return self.frozen(node.value)

    def _Given(self, node: Given) -> Value:
        return node.value

    def _JoinedStr(self, node: ast.JoinedStr) -> Value:
        found, is_known = "", True
        for each in node.values:
            if isinstance(each, ast.Constant):
                found += str(each.value)
                continue
            assert isinstance(each, ast.FormattedValue)
            known = self.python(self.value(each.value))
            plain = each.conversion == -1 and each.format_spec is None
            is_known = is_known and plain and type(known) in (str, int)
            found += str(known)
        return known_object(found if is_known else TEXT)

    def reduced_operation(self, name: str, left: Value, right: Value) -> Value | None:
        """``+`` and ``*`` of tuples and lists, ``+`` and ``%`` with a text; None of anything else."""
        for one, other in ((left, right), (right, left)):
            if name == "Mult" and self._in_order(one) and other.kind.is_number and other.kind.base == INT:
                if other.constant is None:
                    self.needs_constant("how often a list is repeated")
                times = int(other.constant or 0)
                if len(items_of(one)) * times > 16 * MOST_TURNS:
                    self.lack("a list is too long here; write np.full(n, value)")
                return bundle([self.held(each) for each in items_of(one)] * times, one.kind.form)
        if name == "Add" and self._in_order(left) and self._in_order(right):
            if left.kind.form != right.kind.form:
                self.mistake("a list is added to a list, and a tuple to a tuple")
            return bundle([*items_of(left), *items_of(right)], left.kind.form)
        texts = [isinstance(self.object_of(each), str) for each in (left, right)]
        if all(texts) and name == "Add":
            return known_object(self.object_of(left) + self.object_of(right))
        if texts[0] and name == "Mod":
            return known_object(TEXT)
        return None

    @staticmethod
    def _in_order(value: Value) -> bool:
        return value.kind.items is not None and value.kind.form in (None, LIST)

    def _of_text(self, text: str, name: str, arguments: Sequence[Value]) -> Value:
        known = [self.python(each) for each in arguments]
        if name not in _OF_TEXTS:
            self.lack(f"the language has no method {name} of a text")
        if name == "format" or MISSING in known:
            return known_object(TEXT)
        return self.frozen(getattr(text, name)(*known))

    # lists and dicts

    def spread(self, nodes: Sequence[ast.expr]) -> list[ast.expr]:
        """Expressions, with the items behind a star one by one."""
        found: list[ast.expr] = []
        for node in nodes:
            found += [Given(each) for each in self.listed(node.value)] if isinstance(node, ast.Starred) else [node]
        return found

    def _Tuple(self, node: ast.Tuple) -> Value:
        return bundle([self.value(each) for each in self.spread(node.elts)])

    def _List(self, node: ast.List) -> Value:
        return bundle([self.value(each) for each in self.spread(node.elts)], LIST)

    def _Set(self, node: ast.Set) -> Value:
        known = [self.python(self.value(each)) for each in node.elts]
        if MISSING in known:
            self.lack("the language has no set; write a tuple")
        return known_object(frozenset(known))

    def _Dict(self, node: ast.Dict) -> Value:
        found: dict[Any, Value] = {}
        for key, value in zip(node.keys, node.values, strict=True):
            if key is None:
                found |= self.entries(self.value(value))
            else:
                known = self.key(self.value(key))
                found[known] = self.held(self.value(value))
        return self.dict_of(found)

    def dict_of(self, entries: Mapping[Any, Value]) -> Value:
        """A dict. Its first item keeps it from being read as a tuple."""
        return bundle([known_object(dict), *entries.values()], Form(dict, tuple(entries)))

    def key(self, value: Value) -> Any:
        """A key of a dict."""
        known = self.python(value)
        if known is MISSING:
            self.needs_constant("the key of a dict")
        return known

    def is_dict(self, value: Value) -> bool:
        return self.belongs(value, dict) or type(self.object_of(value)) is dict

    @staticmethod
    def belongs(value: Value, of: Any) -> bool:
        """Whether a value has items that belong to a type of Python."""
        return isinstance(value.kind.form, Form) and value.kind.form.of is of

    def entries(self, value: Value) -> dict[Any, Value]:
        """The entries of a dict."""
        known = self.object_of(value)
        if type(known) is dict:
            return {key: self.frozen(each) for key, each in known.items()}
        if not self.belongs(value, dict):
            self.mistake(f"a dict is needed here, not {value.kind.described()}")
        return dict(zip(value.kind.form.keys, items_of(value)[1:], strict=True))  # type: ignore[union-attr]  # a dict has a form

    def _entry(self, known: dict, node: ast.Subscript) -> Any:
        key = self.key(self.value(node.slice))
        return known[key] if key in known else self.mistake(f"{ast.unparse(node.value)} has no key {key!r}")

    def of_dict(self, value: Value, node: ast.Subscript) -> Value:
        """``d[key]``."""
        known = self.object_of(value)
        if type(known) is dict:
            return self.frozen(self._entry(known, node))
        key, entries = self.key(self.value(node.slice)), self.entries(value)
        return entries[key] if key in entries else self.mistake(f"{ast.unparse(node.value)} has no key {key!r}")

    def _method_of_dict(self, value: Value, name: str, arguments: Sequence[Value]) -> Value:
        entries = self.entries(value)
        if name == "get" and 1 <= len(arguments) <= 2:
            key = self.key(arguments[0])
            return entries[key] if key in entries else [*arguments, Value(NONE, ())][1]
        if name not in _OF_DICTS or arguments:
            self.lack(f"the language has no method {name} of a dict")
        keys = [self.frozen(key) for key in entries]
        pairs = [bundle(list(pair)) for pair in zip(keys, entries.values(), strict=True)]
        return bundle({"items": pairs, "keys": keys, "values": list(entries.values())}[name])

    def method_of(self, value: Value, name: str, node: ast.Call) -> Value | None:
        """A method of what is no array: of a text, a dict, a tuple, an object with fields; None of anything else."""
        known = self.object_of(value)
        if isinstance(known, str):
            return self._of_text(known, name, [self.value(each) for each in self.spread(node.args)])
        if self.is_dict(value):
            return self._method_of_dict(value, name, [self.value(each) for each in self.spread(node.args)])
        if value.kind.items is None:
            return None
        if self.belongs(value, list) or value.kind.form is None:
            return self._method_of_items(value, name, [self.value(each) for each in self.spread(node.args)])
        return None

    def _method_of_items(self, value: Value, name: str, arguments: Sequence[Value]) -> Value:
        known = [self.python(each) for each in (value, *arguments)]
        if name == "copy" and value.kind.form == LIST:
            return value
        if name in ("index", "count") and len(arguments) == 1 and MISSING not in known:
            if name == "index" and known[1] not in known[0]:
                self.mistake(f"{known[1]!r} is not in it")
            return whole(getattr(known[0], name)(known[1]))
        return self.lack(f"the language has no method {name} of {value.kind.described()} here")

    def field_of(self, value: Value, name: str) -> Value | None:
        """A field of a named tuple or of an object of a dataclass."""
        form = value.kind.form
        if not isinstance(form, Form) or not isinstance(form.of, type) or form.of in (list, dict):
            return None
        if name not in form.keys:
            return None
        return items_of(value)[form.keys.index(name) + (not issubclass(form.of, tuple))]

    def made_by(self, of: type, positional: Sequence[Value], named: Mapping[str, Value]) -> Value | None:
        """An object of a class of named tuples or of a dataclass; None of another class."""
        is_tuple = issubclass(of, tuple) and hasattr(of, "_fields")
        if is_tuple:
            names = list(of._fields)  # type: ignore[attr-defined]  # a named tuple has them
            plain = of.__new__.__code__.co_filename.startswith("<") and "__init__" not in vars(of)
        elif dataclasses.is_dataclass(of):
            names = [each.name for each in dataclasses.fields(of) if each.init]
            own = ("__post_init__", "__new__", "__getattr__", "__getattribute__")
            plain = of.__dataclass_params__.init  # type: ignore[attr-defined]  # a dataclass has them
            plain = plain and not any(word in vars(each) for each in of.__mro__[:-1] for word in own)
            plain = plain and len(names) == len(dataclasses.fields(of))
            plain = plain and all(each.default_factory is dataclasses.MISSING for each in dataclasses.fields(of))
        else:
            return None
        if not plain:
            self.lack(f"the language does not make a {of.__name__}, which has an __init__ of its own")
        try:
            bound = inspect.signature(of).bind(*positional, **named)
        except TypeError as error:
            self.mistake(f"{of.__name__}: {error}")
        bound.apply_defaults()
        values = [each if isinstance(each, Value) else self.frozen(each) for each in bound.arguments.values()]
        values = [self.held(each) for each in values]
        return bundle(values if is_tuple else [known_object(of), *values], Form(of, tuple(names)))

    def replaced(self, value: Value, named: Mapping[str, Value]) -> Value:
        """A named tuple with other fields."""
        form = value.kind.form
        assert isinstance(form, Form)
        if unknown := named.keys() - set(form.keys):
            self.mistake(f"{form.of.__name__} has no field {min(unknown)!r}")
        items = zip(form.keys, items_of(value), strict=True)
        return bundle([named.get(name, item) for name, item in items], form)

    def held(self, value: Value) -> Value:
        """A value that something else holds from now on, so that nobody may take its memory for a result."""
        if value.kind.items is not None:
            return bundle([self.held(item) for item in items_of(value)], value.kind.form)
        if not value.fresh:
            return value
        return replace(value, fresh=False, fleeting=True, roots=value.roots | {Memory(own=True)})

    # what is written out

    def listed(self, node: ast.expr) -> list[Value]:
        """The values that something runs over, one by one."""
        return list(self.each_of(node))

    def each_of(self, node: ast.expr) -> Iterator[Value]:
        """The values that something runs over, each made when it is asked for, as in Python."""
        if isinstance(node, ast.GeneratorExp):
            for names in self.turns_of_comprehension(node.generators):
                with self.bound(names):
                    value = self.value(node.elt)
                yield value
            return
        turns = self.iteration(node)
        if not isinstance(turns.n, ir.Constant):
            self.needs_constant("the number of values here")
        if turns.n.constant > MOST_TURNS:
            self.lack(f"more than {MOST_TURNS} values are not written out; write a loop")
        for k in range(turns.n.constant):
            yield turns.item(WORD(k))

    @contextmanager
    def bound(self, names: Mapping[str, Value]) -> Iterator[None]:
        """The names of a comprehension, for one turn."""
        before = [(name, name in self.locals, name in self.assigned, self.constants.get(name)) for name in names]
        self.locals |= names.keys()
        self.assigned |= names.keys()
        self.constants |= names
        outer, self.of_turn = self.of_turn, self.of_turn | names.keys()
        yield
        self.of_turn = outer
        for name, local, assigned, constant in before:
            if not local:
                self.locals.discard(name)
            if not assigned:
                self.assigned.discard(name)
            if constant is None:
                self.constants.pop(name, None)
            else:
                self.constants[name] = constant

    def _names_of(self, target: ast.expr, value: Value) -> dict[str, Value]:
        if isinstance(target, ast.Name):
            return {target.id: self.held(value)}
        if not isinstance(target, ast.Tuple | ast.List):
            self.lack("a comprehension binds names")
        items = self.unpacked(value, len(target.elts))
        return {
            name: each
            for part, item in zip(target.elts, items, strict=True)
            for name, each in self._names_of(part, item).items()
        }

    def unpacked(self, value: Value, n: int | None) -> list[Value]:
        """The values of a tuple or an array, one by one."""
        if self.is_dict(value):
            items = [self.frozen(key) for key in self.entries(value)]
        elif value.kind.items is not None and not self._opaque(value):
            items = items_of(value)
        elif value.kind.is_array and self.shape_of(value):
            items = [self.at_index(value, WORD(i)) for i in range(self.shape_of(value)[0])]
        else:
            self.mistake(f"{value.kind.described()} can't be unpacked")
        if n is not None and len(items) != n:
            self.mistake(f"{len(items)} values can't be unpacked into {n} names")
        return items

    @staticmethod
    def _opaque(value: Value) -> bool:
        form = value.kind.form
        return isinstance(form, Form) and not (isinstance(form.of, type) and issubclass(form.of, tuple | list))

    def at_index(self, array: Value, i: ir.Value) -> Value:
        raise NotImplementedError  # statements have it

    def turns_of_comprehension(
        self, generators: Sequence[ast.comprehension], around: Mapping[str, Value] = types.MappingProxyType({})
    ) -> Iterator[dict[str, Value]]:
        """The names of each turn, which whoever uses the turn binds. ``around``: of the loops before."""
        if not generators:
            yield dict(around)
            return
        first, *rest = generators
        if first.is_async:
            self.lack("the language has no async")
        values = self.each_of(first.iter)
        while True:
            with self.bound(around):
                value = next(values, None)
                if value is None:
                    return
                names = dict(around) | self._names_of(first.target, value)
            with self.bound(names):
                is_taken = all(self._decided(test) for test in first.ifs)
            if is_taken:
                yield from self.turns_of_comprehension(rest, names)

    def _decided(self, node: ast.expr) -> bool:
        test = self.test(node)
        if not isinstance(test, ir.Constant):
            self.lack("how many values a comprehension has must be known when compiling; write a loop, or np.where")
        return bool(test.constant)

    def _ListComp(self, node: ast.ListComp) -> Value:
        found = []
        for names in self.turns_of_comprehension(node.generators):
            with self.bound(names):
                found.append(self.value(node.elt))
            if len(found) > MOST_TURNS:
                self.lack(f"a comprehension of more than {MOST_TURNS} values is not written out; write a loop")
        return bundle(found, LIST)

    def _DictComp(self, node: ast.DictComp) -> Value:
        found = {}
        for names in self.turns_of_comprehension(node.generators):
            with self.bound(names):
                found[self.key(self.value(node.key))] = self.held(self.value(node.value))
        return self.dict_of(found)

    def all_or_any(self, node: ast.expr, operator: ast.boolop) -> Value:
        """``all`` and ``any`` of a generator: nothing behind the deciding value is evaluated."""

        def operands() -> Iterator[Callable[[], Value]]:
            if isinstance(node, ast.GeneratorExp):
                for names in self.turns_of_comprehension(node.generators):
                    yield functools.partial(self._in_turn, names, node.elt)
            else:
                for value in self.each_of(node):
                    yield functools.partial(self._true, value)

        return self.deciding(operands(), operator, lambda: self.constant(isinstance(operator, ast.And)))

    def _in_turn(self, names: Mapping[str, Value], node: ast.expr) -> Value:
        with self.bound(names):
            return scalar(self.test(node), BOOL)

    def _true(self, value: Value) -> Value:
        return scalar(self.is_true(value), BOOL)

    def is_true(self, value: Value) -> ir.Value:
        """A value as a truth value."""
        if self.is_dict(value):
            return FLAG(bool(self.entries(value)))
        known = self.object_of(value)
        if known is not MISSING:
            if isinstance(known, str | frozenset | type | enum.Enum | types.FunctionType):
                return FLAG(bool(known))
            self.lack(f"whether {value.kind.described()} is true is not known")
        if value.kind.is_none or (value.kind.items is not None and not self._opaque(value)):
            return FLAG(bool(value.kind.items))
        if value.kind.is_array and value.kind.sizes and value.kind.size == 1:
            value = self.element(value, [WORD(0)] * len(value.kind.sizes))
        if not value.kind.is_number:
            self.mistake(f"{value.kind.described()} is neither true nor false; use .any() or .all()")
        return self.truth(value)

    # comparisons

    def same_object(self, left: Value, right: Value) -> Value:
        """``left is right``."""
        values = (left, right)
        if any(value.kind.is_none for value in values):
            return self.constant(all(value.kind.is_none for value in values))
        known = [self.object_of(value) for value in values]
        if MISSING in known or isinstance(known[0], str):
            self.lack("`is` compares with None, or objects that are known when compiling; write ==")
        return self.constant(known[0] is known[1])

    def contains(self, left: Value, right: Value) -> Value:
        """``left in right``."""
        if self.is_dict(right):
            return self.constant(self.key(left) in self.entries(right))
        known = [self.python(left), self.python(right)]
        if known[1] is not MISSING and isinstance(known[1], range | frozenset | set | str | tuple | list):
            if known[0] is not MISSING:
                return self.constant(known[0] in known[1])
            if isinstance(known[1], range) and left.kind.is_number and left.kind.base != FLOAT:
                return self._in_range(left, known[1])
        if isinstance(known[1], frozenset | set):
            right = bundle([self.frozen(each) for each in sorted(known[1], key=str)])
        if right.kind.is_array:
            equal = self.elementwise(functools.partial(self.comparison, "=="), right, left)
            return self.reduced(equal, None, lambda n, term, _: self.in_turn(n, term, lambda a, b: self._or(a, b)))
        if right.kind.items is None or self._opaque(right):
            self.lack(f"the language has no `in` of {right.kind.described()}; write the comparisons")
        found = self.constant(False)
        for item in items_of(right):
            found = self._or(found, self.equal(left, item))
        return found

    def _in_range(self, left: Value, within: range) -> Value:
        if within.step != 1:
            self.lack("`in range` has a step of 1 here")
        first = self.comparison(">=", left, whole(within.start))
        return scalar(self.at.and_(first.llvm[0], self.comparison("<", left, whole(within.stop)).llvm[0]), BOOL)

    def _or(self, left: Value, right: Value) -> Value:
        for one, other in ((left, right), (right, left)):
            if one.constant is not None:
                return self.constant(True) if one.constant else other
        return scalar(self.at.or_(left.llvm[0], right.llvm[0]), BOOL)

    def equal(self, left: Value, right: Value) -> Value:
        """Whether two items of lists, or an item and what is sought in a list, are the same."""
        known = [self.python(left), self.python(right)]
        if MISSING not in known:
            return self.constant(bool(known[0] == known[1]))
        if left.kind.is_number and right.kind.is_number:
            if all(value.kind.base == FLOAT and value.constant is None for value in (left, right)):
                self.lack("a list finds the same object equal, NaN too; write the comparisons")
            return self.comparison("==", left, right)
        kinds = (left.kind, right.kind)
        if any(kind.is_array for kind in kinds):
            self.lack("an item is an array here; write the comparisons")
        if all(kind.items is not None for kind in kinds):
            return self.equal_items(left, right)
        return self.constant(False)

    def equal_items(self, left: Value, right: Value) -> Value:
        """Whether two tuples, or two lists, are equal."""
        kinds = (left.kind, right.kind)
        if any(self._opaque(value) for value in (left, right)):
            self.lack("the items of dicts and objects are compared one by one here")
        lists = [kind.form == LIST for kind in kinds]
        if lists[0] != lists[1] or len(items_of(left)) != len(items_of(right)):
            return self.constant(False)
        both: ir.Value = FLAG(True)
        for one, other in zip(items_of(left), items_of(right), strict=True):
            same = self.equal(one, other).llvm[0]
            if isinstance(same, ir.Constant):
                if not same.constant:
                    return self.constant(False)
                continue
            both = same if isinstance(both, ir.Constant) else self.at.and_(both, same)
        return self.constant(True) if isinstance(both, ir.Constant) else scalar(both, BOOL)

    # types

    def is_instance(self, value: Value, of: Value) -> Value:
        """``isinstance``."""
        wanted = self.python(of)
        wanted = wanted if isinstance(wanted, tuple) else (wanted,)
        if not all(isinstance(each, type) for each in wanted):
            self.lack("the types of isinstance must be known when compiling")
        known = self.object_of(value)
        if known is not MISSING:
            return self.constant(isinstance(known, wanted))
        kind = value.kind
        if kind.is_none:
            return self.constant(isinstance(None, wanted))
        if kind.is_array:
            return self.constant(issubclass(np.ndarray, wanted))
        if kind.items is not None:
            of_python = kind.form.of if isinstance(kind.form, Form) else tuple
            return self.constant(isinstance(of_python, type) and issubclass(of_python, wanted))
        if not kind.is_number:
            self.lack("isinstance of a record is not known when compiling")
        may = {FLOAT: (float, np.float64), INT: (int, np.int64), BOOL: (bool, np.bool_)}[kind.base]
        found = {issubclass(each, wanted) for each in may}
        if len(found) > 1:
            self.lack("whether this is a number of Python or of NumPy is not known when compiling")
        return self.constant(found.pop())

    # functions within functions

    def _Lambda(self, node: ast.Lambda) -> Value:
        return self.closure(node)

    def closure(self, node: ast.Lambda | ast.FunctionDef) -> Value:
        """A function within a function, with what it reads around it. As in Python it reads what these names stand for
        when it is called, so that each is bound once."""
        if isinstance(node, ast.FunctionDef) and node.decorator_list:
            self.lack("a function with a decorator is not compiled")
        if any(isinstance(each, ast.Nonlocal) for each in ast.walk(node)):
            self.lack("a function does not bind a name of the function around it; return it, or keep it in an array")
        defaults = [each for each in (*node.args.defaults, *node.args.kw_defaults) if each is not None]
        if not all(isinstance(each, ast.Constant) for each in defaults):
            self.lack("a function within a function has numbers or texts for its defaults")
        key = self.function, node.lineno, node.col_offset
        if key not in self.unit.within:
            free = _free(node, self.locals | set(self.function.__code__.co_freevars))
            tree = _as_function(node, free)
            function = _made(tree, self.function)
            self.unit.within[key] = function, free
            self.unit.trees[function] = tree, self.source
        function, free = self.unit.within[key]
        for name in free:
            self.demand_lasting(name, node)
        captured = [self.held(self.value(ast.Name(name, ast.Load()))) for name in free]
        return bundle([known_object(function), *captured], Form(function, free))

    def demand_lasting(self, name: str, node: ast.expr | ast.FunctionDef) -> None:
        raise NotImplementedError  # statements have it


def _free(node: ast.Lambda | ast.FunctionDef, around: Collection[str]) -> tuple[str, ...]:
    """The names that a function within a function reads from around it."""
    outer = parsed("def outer(): pass").body[0]
    assert isinstance(outer, ast.FunctionDef)
    names: list[ast.expr] = [ast.Name(name, ast.Store()) for name in sorted(around)]
    outer.body = [ast.Assign([name], ast.Constant(None)) for name in names]
    outer.body.append(ast.Expr(node) if isinstance(node, ast.Lambda) else node)
    code = compile(ast.fix_missing_locations(ast.Module([outer], [])), "", "exec").co_consts[0]
    (inner,) = (each for each in code.co_consts if isinstance(each, types.CodeType))
    return inner.co_freevars


def _as_function(node: ast.Lambda | ast.FunctionDef, further: Sequence[str] = ()) -> ast.FunctionDef:
    """The tree of a function, which is given further values by their names."""
    made = parsed("def function(): pass").body[0]
    assert isinstance(made, ast.FunctionDef)
    its = node.args
    made.args = ast.arguments(
        its.posonlyargs, its.args, its.vararg, [*its.kwonlyargs, *(ast.arg(name) for name in further)],
        [*its.kw_defaults, *(None for _ in further)], its.kwarg, its.defaults,
    )  # fmt: skip
    if isinstance(node, ast.Lambda):
        made.body = [ast.copy_location(ast.Return(node.body), node.body)]
    else:
        made.name, made.body = node.name, node.body
    return ast.fix_missing_locations(ast.copy_location(made, node))


def _made(tree: ast.FunctionDef, around: types.FunctionType) -> types.FunctionType:
    """The function of a tree, at the place in the source of the function around it."""
    module = compile(ast.Module([tree], []), around.__code__.co_filename, "exec")
    (code,) = (each for each in module.co_consts if isinstance(each, types.CodeType))
    code = code.replace(co_firstlineno=around.__code__.co_firstlineno)
    made = types.FunctionType(code, around.__globals__, tree.name)
    defaults = [each.value for each in tree.args.defaults if isinstance(each, ast.Constant)]
    named = zip(tree.args.kwonlyargs, tree.args.kw_defaults, strict=True)
    made.__defaults__ = tuple(defaults)
    made.__kwdefaults__ = {each.arg: its.value for each, its in named if isinstance(its, ast.Constant)}
    made.__module__ = around.__module__
    return made
