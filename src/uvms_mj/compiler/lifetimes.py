"""Variables, and the memory of the arrays that they stand for.

As in Python, a name stands for an array, and several names may stand for one. An array that a statement makes is in
memory which the function has for that statement. In a loop, the statement makes it again at each turn, while a name may
still stand for the one before: ``before = x`` and then ``x = x + 1.0``. So an array that is bound to a name in a loop
is copied to memory for which no name stands. If no name in a loop may stand for an array that another name has made
there, one such memory is enough for each statement. Otherwise there is one more of them than there are names, and a
free one is sought at run time.
"""

import ast
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from llvmlite import ir

from .cells import CELLS
from .expressions import Expressions, Variable
from .refusals import SMEARED
from .values import BYTE, POINTER, WORD, Kind, Memory, Value, argument_kind, bundle, is_dense, items_of, leaves_of


def bindings(statements: Iterable[ast.stmt], lists: Collection[str] = (), walrus: bool = True) -> Iterator[str]:
    """The names that statements bind, each as often as one of them does.

    To go through all nodes takes a tenth of the translation, so that ``lists``, names whose lists may change in place,
    and ``walrus``, whether an expression may bind a name, are asked first.
    """
    for statement in statements:
        if isinstance(statement, ast.FunctionDef):
            yield statement.name
            continue
        if walrus:
            for each in ast.iter_child_nodes(statement):
                if isinstance(each, ast.expr):
                    yield from (part.target.id for part in ast.walk(each) if isinstance(part, ast.NamedExpr))
        if lists:
            yield from (each for each in _changed(statement) if each in lists)
        for case in getattr(statement, "cases", ()):
            yield from bindings(case.body, lists, walrus)
        for target in getattr(statement, "targets", [getattr(statement, "target", None)]):
            yield from _names_in(target)
        for part in ("body", "orelse"):
            yield from bindings(getattr(statement, part, ()), lists, walrus)


def _names_in(target: ast.expr | None) -> Iterator[str]:
    """The names in a target of an assignment that it binds."""
    if isinstance(target, ast.Name):
        yield target.id
    elif isinstance(target, ast.Tuple | ast.List):
        for each in target.elts:
            yield from _names_in(each)
    elif isinstance(target, ast.Starred):
        yield from _names_in(target.value)


def _changed(statement: ast.stmt) -> Iterator[str]:
    """Names of the objects that a statement changes in place."""
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call):
        function = statement.value.func
        if isinstance(function, ast.Attribute) and function.attr in ("append", "extend", "insert", "reverse"):
            yield from (each.id for each in [function.value] if isinstance(each, ast.Name))
    targets = getattr(statement, "targets", [statement.target] if isinstance(statement, ast.AugAssign) else ())
    for each in (part for target in targets for part in ast.walk(target)):
        if isinstance(each, ast.Subscript) and isinstance(each.value, ast.Name):
            yield each.value.id


class Again(Exception):
    """A function must be translated again: a name has another kind than was believed, or a loop must be written out."""


@dataclass
class Plan:
    """Knowledge of a function from translating it before.

    Attributes:
        kinds: of the names that are bound to values of several kinds.
        written_out: the places of loops whose turns are written out one by one.
        in_memory: names that stand for arrays of several places in a record with cells.
    """

    kinds: dict[str, Kind] = field(default_factory=dict)
    written_out: set[tuple[int, int]] = field(default_factory=set)
    in_memory: set[str] = field(default_factory=set)


@dataclass
class Turning:
    """The outermost loop that turns.

    Attributes:
        names: names that are bound in it.
        taken: arrays that are not new, for which its names stand from some turn on.
        kept: for each array that a turn keeps, where its memory is to be chosen, where the code goes on, the slot for
            the memory's address, and its size [bytes].
    """

    names: set[str]
    taken: list[Value] = field(default_factory=list)
    kept: list[tuple[ir.Block, ir.Block, ir.Value, int]] = field(default_factory=list)


class Lifetimes(Expressions):
    """The variables of one function."""

    plan: Plan
    block: int
    turning: Turning | None

    def start(self, plan: Plan) -> None:
        self.plan, self.block, self.turning = plan, 0, None
        self.written_out = 0  # loops around this place whose turns are written out
        self.copies = 1  # of this place, by these loops
        self.turnings: list[Turning] = []
        self.views: dict[str, set[str | Memory]] = {}  # of what each name is a view, by the keys of names
        self.bound_anew: dict[str, int] = {}  # how often, by a statement that no way leads around
        self.pointers: list[ir.Value] = []  # the slots of all names that stand for arrays

    def bindings(self, statements: Iterable[ast.stmt]) -> Iterator[str]:
        raise NotImplementedError  # a function has it

    def turning_of(self, node: ast.stmt) -> Turning:
        """The outermost loop, when a loop begins."""
        if self.turning is not None:
            return self.turning
        self.turnings.append(Turning(set(self.bindings([node]))))
        return self.turnings[-1]

    def variable(self, name: str) -> Value:
        its = self.variables[name]
        numbers = its.numbers
        if numbers is None:
            numbers = tuple(self.at.load(slot, typ=kind) for slot, kind in zip(its.slots, its.kind.llvm, strict=True))
        turns = self.turning is not None and name in self.turning.names
        value = Value(its.kind, numbers, False, its.steady and not turns, roots=frozenset({self._key(name)}))
        return bundle(items_of(value), its.kind.form) if its.kind.items is not None else value

    def _key(self, name: str) -> str:
        """A name since the last statement that bound it anew, so that what it stood for before does not count."""
        return f"{name} {self.bound_anew.get(name, 0)}"

    def bind(self, name: str, value: Value, once: bool = False) -> None:
        """Let a name stand for a value. ``once``: no other statement binds the name."""
        self.assigned.add(name)
        self.constants.pop(name, None)
        known = argument_kind(value).constant if value.kind.is_number else None
        if once and (known is not None or value.kind.is_none):
            self.constants[name] = value
            if not self.written_out:
                return
        if self.block <= 1 and self.turning is None:
            self.bound_anew[name] = self.bound_anew.get(name, 0) + 1
        its_views = self.views.setdefault(self._key(name), set())
        for leaf in leaves_of(value):
            its_views |= {Memory(own=True)} if leaf.fresh else leaf.roots
        if self.turning is not None:
            value = self._kept(value)
        if (wanted := self.plan.kinds.get(name)) is not None:
            value = self._adapted_if_it_can(value, wanted)
        kind, its = value.kind.variable, self.variables.get(name)
        if value.place is not None and name not in self.plan.in_memory:
            if its is None or its.block == self.block:
                self.variables[name] = Variable(kind, [], self.block, value.steady, tuple(value.llvm))
                return
            self.plan.in_memory.add(name)
            raise Again
        if its is not None and its.at_place and its.block != self.block:
            self.plan.in_memory.add(name)
            raise Again
        if once and self.turning is None and not self.written_out:
            numbers = tuple(self.adapted(value, kind))
            self.variables[name] = Variable(kind, [], self.block, value.steady, numbers)
            return
        if its is None or its.at_place or (its.kind != kind and its.block == self.block):
            its = self.variables[name] = Variable(kind, self._slots(kind), self.block)
        if its.kind != kind:
            self.plan.kinds[name] = self._one_kind(name, its.kind, kind)
            raise Again
        its.steady = its.steady and value.steady
        for slot, each in zip(its.slots, self.adapted(value, kind), strict=True):
            self.at.store(each, slot)

    def origins(self, value: Value) -> set[Memory]:
        """The memory that an array may be in. The values of a name are collected from all statements since one that no
        way leads around bound it anew."""
        if value.fresh:
            return {Memory(own=True)}
        todo, found = list(value.roots), set[str | Memory]()
        while todo:
            each = todo.pop()
            if each not in found:
                found.add(each)
                todo += self.views[each] if isinstance(each, str) else []
        return {each for each in found if isinstance(each, Memory)}

    def demand_apart(self, target: Value, value: Value) -> None:
        """End early where NumPy fills an array of one axis from memory of its own that it goes through at another step.

        NumPy copies it forward then, with nothing in between: ``x[::2] = x[:3]`` reads numbers that it has just
        written. It copies rightly where the steps are equal or opposite, and where the target has more axes."""
        shapes = self.shape_of(target), self.shape_of(value)
        if value.fresh or not self.unit.checked or len(shapes[0]) != 1 or not shapes[1]:
            return
        steps = target.kind.strides[0], value.kind.strides[-1]
        if steps[0] == steps[1] or steps[0] * steps[1] < 0 or target.kind.size < 2 or value.kind.size < 2:
            return
        ends = [sorted((0, (each.kind.size - 1) * step)) for each, step in zip((target, value), steps, strict=True)]
        if target.place is not None or value.place is not None:
            if self._may_meet_in_cells(target, value, ends):
                self.lack("in a fleet, an array is filled from a part of itself with another step; write .copy()")
            return
        (low, high), (first, last) = (
            [self.at.ptrtoint(self.shifted(each.llvm[0], WORD(end)), WORD) for end in both]
            for each, both in zip((target, value), ends, strict=True)
        )
        apart = self.at.or_(self.at.icmp_unsigned("<", high, first), self.at.icmp_unsigned("<", last, low))
        self.demand(apart, SMEARED)

    @staticmethod
    def _may_meet_in_cells(target: Value, value: Value, ends: Sequence[Sequence[int]]) -> bool:
        if target.place is None or value.place is None:
            return CELLS in (target.kind.readonly[: len(CELLS)], value.kind.readonly[: len(CELLS)])
        first, second = target.place.offset, value.place.offset
        return first + ends[0][0] <= second + ends[1][1] and second + ends[1][0] <= first + ends[0][1]

    def _slots(self, kind: Kind) -> list[ir.Value]:
        slots = [self.entry.alloca(each) for each in kind.llvm]
        for slot, each in zip(slots, kind.llvm, strict=True):
            if each == POINTER:
                self.entry.store(ir.Constant(POINTER, None), slot)
                self.pointers.append(slot)
        return slots

    def _one_kind(self, name: str, before: Kind, now: Kind) -> Kind:
        """The kind of a name that is bound to values of two kinds."""
        if before.is_number and now.is_number:
            return self.unified([Value(before, ()), Value(now, ())])
        items = before.items, now.items, self.plan.kinds.get(name)
        if before.form == now.form and items[0] and items[1] and items[2] is None and len(items[0]) == len(items[1]):
            pairs = zip(items[0], items[1], strict=True)
            return replace(before, items=tuple(a if a == b else self._one_kind("an item", a, b) for a, b in pairs))
        same = before.items is None and now.items is None and before.shape == now.shape and before.base == now.base
        same = same and before.form == now.form
        if not same or self.plan.kinds.get(name) is not None:
            self.kind_changes()
            self.lack(f"{name} is {now.described()} here, and {before.described()} before")
        readonly = before.readonly or now.readonly
        self.may_write(before, now)
        if before.is_array and before.strides != now.strides:
            self.lack(f"{name} has its numbers in another order here than before; write .copy(), or another name")
        return replace(before, readonly=readonly)

    def kind_changes(self) -> None:
        """Look at a name that gets another kind. A loop may be written out for it, so that each turn has its own."""

    def _adapted_if_it_can(self, value: Value, wanted: Kind) -> Value:
        if value.kind.is_number and wanted.is_number:
            return Value(wanted, (self.converted(value, wanted.base),))
        if wanted.items is not None and value.kind.items is not None and len(value.kind.items) == len(wanted.items):
            items = zip(items_of(value), wanted.items, strict=True)
            return bundle([self._adapted_if_it_can(item, its) for item, its in items], value.kind.form)
        if wanted.items is not None or wanted.form is not None:
            return value
        if value.kind.shape != wanted.shape or value.kind.base != wanted.base:
            return value
        if value.kind.readonly != wanted.readonly:
            self.may_write(value.kind)
        if value.kind.strides != wanted.strides:
            self.lack("its numbers are in another order here than before; write .copy(), or another name")
        return replace(value, kind=wanted)

    # memory of what a loop makes

    def _kept(self, value: Value) -> Value:
        """A value that is bound in a loop; a new array in memory that no name has."""
        if value.kind.items is not None:
            return bundle([self._kept(item) for item in items_of(value)], value.kind.form)
        if not value.kind.is_array:
            return value
        assert self.turning is not None
        if value.fleeting:
            self.lack("it may be an array of this turn only; write .copy()")
        if not value.fresh:
            if not value.steady:
                self.turning.taken.append(value)
            return value
        slot, size = self.entry.alloca(POINTER), value.kind.size * value.kind.base.itemsize
        choice, onward = self.at.append_basic_block(), self.at.append_basic_block()
        self.at.branch(choice)
        self.at.position_at_end(onward)
        self.turning.kept.append((choice, onward, slot, size))
        if not is_dense(value.kind):
            self.lack("it is a part of a new array; write .copy() behind it")
        kind = replace(value.kind, readonly="")
        kept = Value(kind, (self.at.load(slot, typ=POINTER),), steady=False)
        self.fill(kept, value)
        return replace(kept, kind=replace(kind, readonly=value.kind.readonly))

    def lasting(self, value: Value) -> Value:
        return value if self.turning is None else self._kept(value)

    def kept(self, value: Value) -> Value:
        """A value in a loop, before anything else is made; a new array in memory that no name has."""
        if not any(leaf.fresh for leaf in leaves_of(value)):
            return value
        return replace(self._kept(value), roots=value.roots | {Memory(own=True)})

    def finish_turnings(self) -> None:
        """Reserve the memory that loops keep arrays in, at the end of the function, when all names are known."""
        for turning in self.turnings:
            shared = any(each.own for value in turning.taken for each in self.origins(value))
            for choice, onward, slot, size in turning.kept:
                self.at.position_at_end(choice)
                self.at.store(self._free_memory(size) if shared else self.reserve(size), slot)
                self.at.branch(onward)

    def _free_memory(self, size: int) -> ir.Value:
        """Memory for which no name stands."""
        n = len(self.pointers) + 1
        size = -(-size // 8) * 8
        memory = self.reserve(n * size)
        pointers = [self.at.ptrtoint(self.at.load(slot, typ=POINTER), WORD) for slot in self.pointers]
        first = self.at.ptrtoint(memory, WORD)
        best = self.at.gep(memory, [WORD((n - 1) * size)], source_etype=BYTE)
        for k in reversed(range(n - 1)):
            start = self.at.add(first, WORD(k * size))
            taken: ir.Value = ir.Constant(ir.IntType(1), 0)
            for pointer in pointers:
                inside = self.at.icmp_unsigned("<", self.at.sub(pointer, start), WORD(size))
                taken = self.at.or_(taken, inside)
            best = self.at.select(taken, best, self.at.gep(memory, [WORD(k * size)], source_etype=BYTE))
        return best
