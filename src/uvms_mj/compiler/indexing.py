"""Fields of records, entries, rows and slices of arrays."""

import ast
from dataclasses import replace
from typing import Any

from llvmlite import ir

from ..errors import suggestion
from .arrays import Arrays
from .codes import INDEX
from .values import BOOL, INT, WORD, Kind, Value, bundle, items_of, view, whole


class Indexing(Arrays):
    """Parts of records and arrays."""

    def value(self, node: ast.expr) -> Value:
        raise NotImplementedError  # expressions have it

    def known(self, node: ast.expr) -> Any:
        raise NotImplementedError

    def test(self, node: ast.expr) -> ir.Value:
        raise NotImplementedError

    def store_all(self, place: Value, value: Value, in_place: bool = False) -> None:
        raise NotImplementedError  # statements have it

    def integer(self, node: ast.expr) -> ir.Value:
        """An index."""
        value = self.value(node)
        if value.kind.is_array or value.kind.items is not None or value.kind.base == BOOL:
            self.lack("an index is one integer or a slice; write a loop, or np.where with a mask")
        if not value.kind.is_number or value.kind.base != INT:
            self.mistake(f"an index is an integer, not {value.kind.described()}")
        return value.llvm[0]

    def constant_integer(self, node: ast.expr, what: str) -> int:
        """An integer that must be known when compiling."""
        number = self.integer(node)
        if not isinstance(number, ir.Constant):
            self.needs_constant(what)
        return int(number.constant)

    def needs_constant(self, what: str) -> None:
        """Refuse what depends on a number that is not known when compiling. A loop may be written out for it."""
        self.lack(f"{what} must be known when compiling")

    def field(self, record: Value, name: str, node: ast.expr) -> Value:
        """A field of a record as a place."""
        fields = record.kind.base.fields if not record.kind.is_array else None
        if fields is None:
            self.mistake(f"{ast.unparse(node)} is {record.kind.described()} and has no {name!r}")
        if name not in fields or name == "_":
            known = [each for each in fields if each != "_"]
            longer = [each for each in known if each.startswith(f"{name}_")]
            hint = f"did you mean {longer[0]!r}?" if longer else suggestion(name, known)
            self.mistake(f"{ast.unparse(node)} has no {name!r}; {hint}")
        dtype, offset = fields[name][:2]
        place = self.shifted(record.llvm[0], WORD(offset))
        part = view(place, dtype, record.kind.readonly)
        return replace(part, steady=record.steady, outer=record.outer)

    def read(self, place: Value) -> Value:
        """The value at a place: a number is loaded, a record or an array stays where it is."""
        if place.kind.is_number:
            return self.load(place.llvm[0], place.kind.base)
        return place

    def part(self, array: Value, index: ast.expr) -> Value:
        """``array[index]`` as a place: of an entry its pointer, of a row or slice a view."""
        if array.kind.items is not None:
            return self._item(array, index)
        if not array.kind.is_array:
            self.mistake(f"{array.kind.described()} has no index")
        indices = self._completed(array, list(index.elts) if isinstance(index, ast.Tuple) else [index])
        pointer, axis = array.llvm[0], 0
        shape: list[int | None] = []
        strides: list[int] = []
        known, length = 0, array.llvm[1:]
        for each in indices:
            if self._is_new_axis(each):
                shape.append(1)
                strides.append(0)
                continue
            stride = array.kind.strides[axis]
            size = array.kind.shape[axis]  # type: ignore[index]  # an array has a shape
            if isinstance(each, ast.Slice):
                first, n, step = (0, None, 1) if _is_all(each) else self._bounds(each, size)
                shape.append(size if _is_all(each) else n)
                strides.append(stride * step)
                known += first * stride
            else:
                number = self._checked(self.integer(each), size, array)
                if axis == 0:
                    length = ()
                if isinstance(number, ir.Constant):
                    known += number.constant * stride
                else:
                    pointer = self.shifted(pointer, self.at.mul(number, WORD(stride)))
            axis += 1
        pointer, kind = self.shifted(pointer, WORD(known)), array.kind
        if not shape:
            return Value(Kind(kind.base, readonly=kind.readonly), (pointer,), array.fresh, array.steady, array.outer)
        part = Kind(kind.base, tuple(shape), tuple(strides), readonly=kind.readonly)
        return Value(part, (pointer, *(length if part.is_open else ())), array.fresh, array.steady, array.outer)

    def _completed(self, array: Value, indices: list[ast.expr]) -> list[ast.expr]:
        """One index for each axis, without ``...``."""
        shape = array.kind.shape or ()
        missing = len(shape) - sum(not self._is_new_axis(i) and not _is_dots(i) for i in indices)
        if missing < 0:
            self.mistake(f"{array.kind.described()} has {len(shape)} {'index' if len(shape) == 1 else 'indices'}")
        rest: list[ast.expr] = [ast.Slice() for _ in range(missing)]
        for k, each in enumerate(indices):
            if _is_dots(each):
                return [*indices[:k], *rest, *indices[k + 1 :]]
        return [*indices, *rest]

    def _is_new_axis(self, node: ast.expr) -> bool:
        if isinstance(node, ast.Constant):
            return node.value is None
        return isinstance(node, ast.Attribute) and node.attr == "newaxis" and self.known(node) is None

    def _bounds(self, node: ast.Slice, size: int | None) -> tuple[int, int, int]:
        """First index, number of indices and step of a slice."""
        if size is None:
            self.lack("the length of this array is not known when compiling")
        given = [
            None if each is None else self.constant_integer(each, "the bounds of a slice")
            for each in (node.lower, node.upper, node.step)
        ]
        if given[2] == 0:
            self.mistake("the step of a slice is not 0")
        found = range(*slice(*given).indices(size))
        return found.start, len(found), found.step

    def _checked(self, index: ir.Value, size: int | None, array: Value) -> ir.Value:
        """An index counted from the front. One that is not known is checked at run time, in users' code."""
        if isinstance(index, ir.Constant):
            if size is not None:
                return self.known_index(index.constant, size)
            if index.constant < 0:
                self.lack("an index into an array of unknown length counts from the front")
            return index
        if not self.unit.checked:
            return index
        length = array.llvm[1] if size is None else WORD(size)
        negative = self.at.icmp_signed("<", index, WORD(0))
        index = self.at.select(negative, self.at.add(index, length), index)
        self.demand(self.at.icmp_unsigned("<", index, length), INDEX)
        return index

    def _item(self, value: Value, index: ast.expr) -> Value:
        """An item of a tuple, or some as a tuple."""
        items = items_of(value)
        if isinstance(index, ast.Slice):
            first, n, step = self._bounds(index, len(items))
            return bundle([items[first + k * step] for k in range(n)])
        number = self.integer(index)
        if isinstance(number, ir.Constant):
            return items[self.known_index(number.constant, len(items)).constant]
        if not all(item.kind.is_number for item in items):
            self.needs_constant("the index of a tuple")
        array = self.as_array(value)
        place = self._checked(number, len(items), array)
        return self.element(array, [place])

    def masked(self, target: Value, mask: Value, value: Value) -> None:
        """``target[mask] = number``."""
        if self.shape_of(mask) != self.shape_of(target) or not value.kind.is_number:
            self.lack("x[mask] = number needs a mask of x's shape and one number; write np.where(mask, value, x)")
        base = target.kind.base

        def body(indices: list[ir.Value]) -> None:
            place = self.pointer(target, indices)
            with self.at.if_then(self.truth(self.element(mask, indices))):
                self.store(self.converted(value, base), place)

        self.each(target.kind.sizes, body)

    def transposed(self, array: Value) -> Value:
        kind = array.kind
        self.shape_of(array)
        return replace(array, kind=replace(kind, shape=kind.sizes[::-1], strides=kind.strides[::-1]))

    def shape_tuple(self, value: Value) -> Value:
        """``x.shape``."""
        sizes = [*value.kind.shape] if value.kind.shape is not None else []
        return bundle([Value(Kind(INT), (value.llvm[1],)) if n is None else whole(n) for n in sizes])

    def is_mask(self, value: Value) -> bool:
        return value.kind.is_array and value.kind.base == BOOL


def _is_all(node: ast.Slice) -> bool:
    return node.lower is None and node.upper is None and node.step is None


def _is_dots(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is ...
