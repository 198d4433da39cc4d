"""Assignments of one function: names, entries and fields, parts of arrays, and lists that change in place."""

import ast
import types
from collections.abc import Sequence

from .cells import CELLS, ROOMS
from .emission import Module
from .forms import MOST_TURNS
from .known import LIST
from .lifetimes import Lifetimes
from .scalars import operator_name
from .tree_facts import facts_of, held_in
from .values import (
    Value,
    bundle,
    items_of,
    leaves_of,
    shown,
)

_LACKS = "lacks: "


class Assignments(Lifetimes):
    """The statements that bind a name, or store into an array, a record or a list."""

    def __init__(
        self, unit: Module, function: types.FunctionType, tree: ast.FunctionDef, source: Sequence[str], fused: bool
    ) -> None:
        super().__init__(unit, function, source, fused)
        self.tree, self.held_lists = tree, dict[str, str]()
        facts = facts_of(tree)
        self.lists, self.handed, self.leaving = facts.lists, facts.handed, set(facts.leaving)
        self.bound_once, self.unbound, self.walrus = facts.bound_once, facts.unbound, facts.walrus

    def _Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            if not self._list_changes(node.value):
                self.call(node.value)
        elif not isinstance(node.value, ast.Constant):
            self.lack("nothing uses this value")

    def _Assign(self, node: ast.Assign) -> None:
        value = self.value(node.value)
        if len(node.targets) > 1 and value.fresh and self.turning is not None:
            self.lack("one assignment at a time in a loop")
        for target in node.targets:
            self.assign(target, value)

    def _list_changes(self, call: ast.Call) -> bool:
        """Whether a call adds to a list; then the name is bound to a longer one."""
        if not isinstance(call.func, ast.Attribute) or not isinstance(call.func.value, ast.Name):
            return False
        name, method = call.func.value.id, call.func.attr
        if method not in ("append", "extend", "insert", "reverse") or name not in self.assigned:
            return False
        before = self._Name(call.func.value)
        if before.kind.form != LIST:
            return False
        self.changed_list(name)
        items, nodes = items_of(before), self.spread(call.args)
        if call.keywords or len(nodes) != {"insert": 2, "reverse": 0}.get(method, 1):
            self.mistake(f"{method} of a list takes other arguments")
        if method == "append":
            items.append(self.value(nodes[0]))
        elif method == "extend":
            items += self.listed(nodes[0])
        elif method == "insert":
            items.insert(self.constant_integer(nodes[0], "the place in a list"), self.value(nodes[1]))
        else:
            items.reverse()
        if len(items) > MOST_TURNS:
            self.lack(f"a list has at most {MOST_TURNS} items here; write np.zeros(n)")
        self.bind(name, bundle(items, LIST))
        return True

    def _item_stored(self, target: ast.Subscript, value: Value) -> bool:
        """Whether an item of a list is stored; then the name is bound to another list."""
        if not isinstance(target.value, ast.Name) or target.value.id not in self.assigned:
            return False
        name = target.value.id
        if self._present(name).kind.form is None:
            return False
        before = self._Name(target.value)
        if before.kind.form == LIST and not isinstance(target.slice, ast.Slice):
            self.changed_list(name)
            items = items_of(before)
            at = self.known_index(self.constant_integer(target.slice, "the place in a list"), len(items)).constant
            self.bind(name, bundle([*items[:at], value, *items[at + 1 :]], LIST))
            return True
        if self.belongs(before, dict):
            self.changed_list(name)
            self.bind(name, self.dict_of(self.entries(before) | {self.key(self.value(target.slice)): value}))
            return True
        return False

    def changed_list(self, name: str) -> None:
        """Refuse to change a list or a dict that anything else may hold."""
        if name not in self.lists:
            self.lack(f"{name} is changed in place here, and is no list of this function; write np.array([...])")
        if (held := self.held_lists.get(name)) is None:
            held = self.held_lists[name] = held_in(self.tree, name)
        if held:
            self.lack(f"{name} is changed here, and something else holds it, too, in {held!r}; write np.array([...])")

    def _AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.assign(node.target, self.value(node.value))

    def assign(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Name):
            self.bind(target.id, value, once=target.id in self.bound_once)
        elif isinstance(target, ast.Tuple | ast.List):
            self._unpack(target.elts, value)
        elif isinstance(target, ast.Subscript) and self._item_stored(target, value):
            pass
        elif isinstance(target, ast.Subscript) and (mask := self._mask(target)) is not None:
            array = self.value(target.value)
            self._refuse_readonly(array)
            self.masked(array, mask, value)
        else:
            self.store_all(self.place(target), value)

    def _unpack(self, targets: Sequence[ast.expr], value: Value) -> None:
        stars = [k for k, each in enumerate(targets) if isinstance(each, ast.Starred)]
        items = self.unpacked(value, None if stars else len(targets))
        if stars:
            first, last = stars[0], len(items) - (len(targets) - stars[0] - 1)
            if last < first:
                self.mistake(f"{len(items)} values can't be unpacked into {len(targets) - 1} names and a list")
            items = [*items[:first], bundle(items[first:last], LIST), *items[last:]]
            targets = [each.value if isinstance(each, ast.Starred) else each for each in targets]
        if self.turning is not None and any(map(_may_be_a_names, items)):
            items = [self.kept(item) for item in items]  # all of them before a name is bound to another array
        for target, item in zip(targets, items, strict=True):
            self.assign(target, item)

    def _mask(self, target: ast.Subscript) -> Value | None:
        """The index of ``x[mask]``, if it is a mask."""
        index = target.slice
        if not isinstance(index, ast.Compare | ast.BinOp | ast.UnaryOp | ast.Name):
            return None
        value = self.value(index)
        if self.is_mask(value):
            return value
        self.evaluated[id(index)] = value  # it is read once more, as an index
        return None

    def place(self, node: ast.expr) -> Value:
        """Where an assignment stores."""
        if isinstance(node, ast.Subscript):
            owner = self.value(node.value)
            if owner.kind.form is not None:
                self.lack(f"{owner.kind.described()} is not changed in place here; write np.array([...]) or a new one")
            if owner.kind.items is not None:
                self.mistake("a tuple can't be changed")
            return self.part(owner, node.slice)
        if not isinstance(node, ast.Attribute):
            self.lack(f"nothing can be stored in {ast.unparse(node)}")
        owner = self.value(node.value)
        if owner.kind.base.fields is None:
            self.lack(f"nothing can be stored in {ast.unparse(node)}")
        return self.field(owner, node.attr, node.value)

    def store_all(self, place: Value, value: Value, in_place: bool = False) -> None:
        """Store a number, or the numbers of an array, in a place; ``in_place``, as an operation does."""
        self._refuse_readonly(place)
        if in_place and len(value.kind.sizes) > len(place.kind.sizes):
            self.mistake(f"{value.kind.described()} does not fit into one of shape {shown(place.kind.sizes)}")
        if place.kind.is_array:
            nested, value = value.kind.items is not None, self.as_array(value)
            if nested and len(value.kind.sizes) > len(place.kind.sizes):
                self.mistake(
                    f"a sequence of shape {shown(value.kind.sizes)} does not fit into {shown(place.kind.sizes)}"
                )
            if not in_place:
                self.demand_apart(place, value)
            self.fill(place, self.apart(value))
        elif place.kind.is_number:
            self.store(self.converted(value, place.kind.base), place.llvm[0])
        else:
            self.lack("a record is stored field by field")

    def _refuse_readonly(self, place: Value) -> None:
        if place.kind.items is not None:
            self.mistake("a tuple can't be changed")
        if place.kind.readonly.startswith(CELLS):
            self.unit.cells.writes_memory(place.kind.readonly)
            return
        if place.kind.readonly == ROOMS:
            self.needs_constant("which number of a run changes")
        if place.kind.readonly.startswith(_LACKS):
            self.lack(place.kind.readonly.removeprefix(_LACKS))
        if place.kind.readonly:
            self.mistake(place.kind.readonly)

    def _AugAssign(self, node: ast.AugAssign) -> None:
        name = operator_name(node.op)
        if isinstance(node.target, ast.Name):
            before, value = self.value(node.target), self.value(node.value)
            if before.kind.is_array:
                self.store_all(before, self.binary(name, before, value), in_place=True)
                return
            if before.kind.form == LIST and value.kind.items is not None:
                self.changed_list(node.target.id)
            after = self.reduced_operation(name, before, value)
            self.bind(node.target.id, self.binary(name, before, value) if after is None else after)
            return
        owner = node.target.value if isinstance(node.target, ast.Subscript) else None
        if isinstance(owner, ast.Name) and owner.id in self.lists and self._present(owner.id).kind.form is not None:
            assert isinstance(node.target, ast.Subscript)
            before = self.value(ast.Subscript(owner, node.target.slice, ast.Load()))
            value = self.value(node.value)
            if before.kind.is_array:  # the array that the list holds, for every name of it
                self.store_all(before, self.binary(name, before, value), in_place=True)
            else:
                self.assign(node.target, self.binary(name, before, value))
            return
        place = self.place(node.target)
        self.store_all(place, self.binary(name, self.read(place), self.value(node.value)), in_place=True)


def _may_be_a_names(value: Value) -> bool:
    """Whether a part may be an array that a loop has made for a name."""
    return any(leaf.kind.is_array and not leaf.fresh and not leaf.steady for leaf in leaves_of(value))
