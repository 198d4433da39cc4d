"""Arrays: element by element with NumPy's broadcasting, products, reductions, copies; fields, entries, rows, slices."""

import ast
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir

from .refusals import INDEX, field_suggestion
from .scalars import Scalars
from .values import (
    BOOL,
    DOUBLE,
    FLOAT,
    INT,
    SCALARS,
    WORD,
    Kind,
    Place,
    Value,
    bundle,
    contiguous,
    is_dense,
    items_of,
    scalar,
    shown,
    view,
    whole,
)

ROWS = 4
"""Rows of a product that are summed side by side, so that one sum does not wait for the other."""
WRITTEN_OUT = 216
"""So many multiplications of a product are written out in a user's function, as of two matrices (6, 6); more are loops,
which take a fifth of the time to compile, and none longer to run."""
_ONLY_READ = "NumPy gives a view here that is only read; write .copy()"
_BLOCK, _LANES = 128, 8
"""NumPy sums up to 128 numbers in eight partial sums, and halves longer arrays."""


class Arrays(Scalars):
    """Operations on arrays, and their parts."""

    def value(self, node: ast.expr) -> Value:
        raise NotImplementedError  # expressions have it

    def known(self, node: ast.expr) -> Any:
        raise NotImplementedError

    def test(self, node: ast.expr) -> ir.Value:
        raise NotImplementedError

    def store_all(self, place: Value, value: Value, in_place: bool = False) -> None:
        raise NotImplementedError  # statements have it

    def stored_in(self, target: Value, result: Value) -> Value:
        """An array, after a result is stored in it."""
        self.store_all(target, result, in_place=True)
        return target

    # arrays of what is not one

    def as_array(self, value: Value) -> Value:
        """An array or a number as it is; of a tuple, the array of its items."""
        return value if value.kind.items is None else self.stacked([self.as_array(each) for each in items_of(value)])

    def stacked(self, parts: Sequence[Value], axis: int = 0) -> Value:
        """Numbers as an array, or arrays of one shape as one with an axis more."""
        if not parts:
            self.lack("an array needs at least one number")
        shape = self.shape_of(parts[0])
        if any(self.shape_of(part) != shape for part in parts):
            self.mistake(f"the parts have different shapes: {', '.join(shown(self.shape_of(part)) for part in parts)}")
        base = self.base_of(parts)
        if not shape:
            out = self.made(base, (len(parts),))
            for k, part in enumerate(parts):
                self.put(self.converted(part, base), out, [WORD(k)])
            return out
        if not -len(shape) - 1 <= axis <= len(shape):
            self.mistake(f"arrays of shape {shown(shape)} can't be stacked along axis {axis}")
        axis = axis % (len(shape) + 1)
        out = self.temporary(base, (*shape[:axis], len(parts), *shape[axis:]))
        for k, part in enumerate(parts):
            self.fill(self._along(out, axis, k), part)
        return out

    def joined(self, parts: Sequence[Value], axis: int = 0) -> Value:
        """Arrays one behind the other along an axis."""
        shapes = [self.shape_of(part) for part in parts]
        ndim = len(shapes[0])
        if not -ndim <= axis < max(ndim, 1):
            self.mistake(f"arrays of shapes {', '.join(map(shown, shapes))} have no axis {axis}")
        axis = axis % ndim if ndim else 0
        if not ndim or len({(len(shape), _without(shape, axis)) for shape in shapes}) > 1:
            self.mistake(f"arrays of shapes {', '.join(map(shown, shapes))} can't be joined along axis {axis}")
        total = sum(shape[axis] for shape in shapes)
        out = self.temporary(self.base_of(parts), (*shapes[0][:axis], total, *shapes[0][axis + 1 :]))
        at = 0
        for part, shape in zip(parts, shapes, strict=True):
            self.fill(self.span(out, axis, at, shape[axis]), part)
            at += shape[axis]
        return self.laid(out, np.concatenate([*map(self.like, parts)], axis)) if ndim > 1 else out

    def span(self, array: Value, axis: int, first: int, n: int) -> Value:
        """n entries of an array along an axis: a view."""
        kind = array.kind
        pointer = self.shifted(array.llvm[0], WORD(first * kind.strides[axis]))
        sizes = (*kind.sizes[:axis], n, *kind.sizes[axis + 1 :])
        return Value(replace(kind, shape=sizes), (pointer,))

    def _along(self, array: Value, axis: int, k: int) -> Value:
        """The part of an array at index k of an axis: a view, or the pointer of an entry as a view of shape ()."""
        kind = array.kind
        pointer = self.shifted(array.llvm[0], WORD(k * kind.strides[axis]))
        return Value(Kind(kind.base, _without(kind.sizes, axis), _without(kind.strides, axis)), (pointer,))

    # shapes

    def shape_of(self, value: Value) -> tuple[int, ...]:
        if value.kind.is_open:
            self.lack("the length of this array is not known when compiling")
        if not value.kind.is_number and value.kind.base not in SCALARS:
            self.mistake(f"numbers or arrays of them are needed here, not {value.kind.described()}")
        return value.kind.sizes

    def base_of(self, values: Sequence[Value]) -> np.dtype:
        """The type of an array of several values."""
        bases = {value.kind.base for value in values}
        return BOOL if bases == {BOOL} else self.common(values)

    def broadcast(self, values: Sequence[Value]) -> tuple[int, ...]:
        shapes = [self.shape_of(value) for value in values]
        try:
            return np.broadcast_shapes(*shapes)
        except ValueError:
            of = [shown(shape) for shape, value in zip(shapes, values, strict=True) if value.kind.is_array]
            return self.mistake(f"arrays of shapes {' and '.join(of)} do not fit together")

    # element by element

    def elementwise(self, function: Callable[..., Value], *given: Value) -> Value:
        """A function of numbers, of the entries of several values."""
        values = [self.as_array(value) for value in given]
        shape = self.broadcast(values)
        if not any(value.kind.is_array for value in values):
            return function(*values)
        if not np.prod(shape, dtype=int):
            return self.temporary(FLOAT, shape)
        out, axes = list[Value](), self.axes_in_memory(values, shape)

        def body(indices: list[ir.Value]) -> None:
            result = function(*(self.element(value, indices) for value in values))
            if not out:
                out.append(self.made(result.kind.base, shape, axes))
            self.put(result.llvm[0], out[0], indices)

        self.each(shape, body)
        return out[0]

    def axes_in_memory(self, values: Sequence[Value], shape: tuple[int, ...]) -> tuple[int, ...]:
        """The order in memory of the axes of a new array that NumPy makes entry by entry: it follows the values (order
        K), and decides which reshape is a view. Empty if it is the usual order."""
        values = [value for value in values if value.kind.is_array]
        if not self.unit.checked or len(shape) < 2 or all(_is_usual(value.kind) for value in values):
            return ()
        if any(0 in value.kind.strides for value in values):
            self.lack("NumPy's result of a repeated array is in an order of its own; write .copy()")
        flags: list[Any] = [*[["readonly"]] * len(values), ["writeonly", "allocate"]]
        strides = np.nditer([*map(self.like, values), None], ["zerosize_ok"], flags, order="K").operands[-1].strides
        return tuple(sorted(range(len(shape)), key=lambda axis: -strides[axis]))

    def laid(self, value: Value, result: np.ndarray) -> Value:
        """A new array with its axes in the order of memory that NumPy's result has, of arrays like those here."""
        scale = value.kind.base.itemsize / result.dtype.itemsize
        kind = Kind(value.kind.base, result.shape, tuple(int(scale * stride) for stride in result.strides))
        if not self.unit.checked or (_is_usual(kind) and _is_usual(value.kind)) or value.kind.strides == kind.strides:
            return value
        if not is_dense(kind):
            self.lack("NumPy's result is in an order of its own; write .copy() behind it")
        out = Value(kind, (self.reserve(kind.size * kind.base.itemsize),), fresh=True)
        self.fill(out, value)
        return out

    def like(self, value: Value) -> np.ndarray:
        """An array of NumPy's with the shape, the type and the strides of a value. NumPy itself says with it whether it
        makes a view, and in which order a result is."""
        kind, shape = value.kind, self.shape_of(value)
        ends = [(n - 1) * stride for n, stride in zip(shape, kind.strides, strict=True)] if kind.size else []
        low, high = sum(min(0, each) for each in ends), sum(max(0, each) for each in ends)
        return np.ndarray(shape, kind.base, np.zeros(high - low + kind.base.itemsize, np.uint8), -low, kind.strides)

    def binary(self, name: str, left: Value, right: Value) -> Value:
        """``left + right`` and so on, of numbers or arrays."""
        if name == "MatMult":
            return self.product(self.as_array(left), self.as_array(right))
        if left.kind.is_number and right.kind.is_number:
            return self.of_python(name, left, right)
        if not left.kind.is_array and not right.kind.is_array:
            self.lack("tuples have no arithmetic; write np.array(...)")
        values = [self.as_array(left), self.as_array(right)]
        if name in ("Add", "Sub", "Mult", "FloorDiv", "Mod", "Pow") and self.base_of(values) == BOOL:
            self.lack("NumPy adds truth values in a way of its own; write 1.0 * x")
        if name == "Pow":
            return self.raised(*values)
        return self.elementwise(lambda a, b: self.operation(name, a, b), *values)

    def raised(self, base: Value, exponent: Value) -> Value:
        """``base ** exponent`` of arrays, and ``np.power``."""
        repeated = exponent.kind.is_array and exponent.kind.sizes != self.broadcast([base, exponent])
        if repeated or 0 in exponent.kind.strides:
            self.lack("NumPy raises to repeated exponents in ways of its own; write a loop")
        one = not exponent.kind.is_array
        return self.elementwise(lambda a, b: self.power(a, b, one), base, exponent)

    def fill(self, target: Value, value: Value) -> None:
        """Store a value, of the target's shape or broadcast to it, into the entries of an array."""
        value, shape = self.as_array(value), self.shape_of(target)
        given = self.shape_of(value)
        while len(given) > len(shape) and given[0] == 1:
            value = self._along(value, 0, 0)
            given = given[1:]
        try:
            fits = np.broadcast_shapes(given, shape) == shape
        except ValueError:
            fits = False
        if not fits:
            self.mistake(f"{value.kind.described()} does not fit into one of shape {shown(shape)}")
        target, base = self.written_in(target), target.kind.base

        def body(indices: list[ir.Value]) -> None:
            number = self.converted(self.element(value, indices), base)
            self.store(number, self.pointer(target, indices))

        self.each(shape, body)

    def written_in(self, target: Value) -> Value:
        """An array whose entries are all stored: of one in cells that takes a loop, its memory, which is written."""
        if target.place is None or target.kind.size <= self.unit.unrolled:
            return target
        memory = self.unit.cells.in_memory(self, target)
        self.unit.cells.writes_memory(memory.kind.readonly)
        return memory

    def copied(self, value: Value, keeps_order: bool = False) -> Value:
        """A new array with the entries of another one, in the usual order of memory, or in its."""
        shape = self.shape_of(value)
        out = self.made(value.kind.base, shape, self.axes_in_memory([value], shape) if keeps_order else ())
        self.each(out.kind.sizes, lambda indices: self.put(self.element(value, indices).llvm[0], out, indices))
        return out

    def apart(self, value: Value) -> Value:
        """An array that is not changed by a store into another one."""
        value = self.as_array(value)
        return value if value.fresh or not value.kind.is_array else self.copied(value)

    def flat(self, value: Value) -> Value:
        """An array with one axis: a view where the entries follow each other, otherwise a copy."""
        return self.arranged(value, np.ravel)

    def arranged(self, value: Value, arrange: Callable[[np.ndarray], Any]) -> Value:
        """The numbers of an array in another shape or order: a view where NumPy makes one, which says so itself, of an
        array like it. Of several arrays, a tuple."""
        if not value.kind.is_array:
            self.lack("a number has no shape")
        kind, shape, like = value.kind, self.shape_of(value), self.like(value)
        numbers = np.arange(1, kind.size + 1).reshape(shape)
        with self.refused_by_numpy():
            result, order = arrange(like), arrange(numbers)

        def part(result: np.ndarray, order: np.ndarray, alone: bool) -> Value:
            if not np.may_share_memory(like, result) or (value.fresh and not alone):
                return self.laid(self.gathered([value], order), result)
            first = result.__array_interface__["data"][0] - like.__array_interface__["data"][0] if result.size else 0
            words = (self.shifted(value.llvm[0], WORD(first)),) if first else value.llvm
            readonly = kind.readonly if result.flags.writeable else f"lacks: {_ONLY_READ}"
            part = replace(kind, shape=result.shape, strides=result.strides, readonly=readonly)
            return replace(value, kind=part, llvm=words)

        if isinstance(result, np.ndarray):
            return part(result, order, True)
        return bundle([part(*each, False) for each in zip(result, order, strict=True)])

    @contextmanager
    def refused_by_numpy(self) -> Iterator[None]:
        """If NumPy refuses it, too, for arrays like the function's, the function's author has to change it."""
        try:
            yield
        except (ValueError, TypeError, IndexError) as error:
            self.mistake(str(error))

    def numbered(self, values: Sequence[Value]) -> list[np.ndarray]:
        """Arrays of integers with the shapes of values: the entries are numbered from 1, one value after the other."""
        found, so_far = [], 1
        for value in values:
            shape = self.shape_of(value)
            size = int(np.prod(shape, dtype=int))
            found.append(np.arange(so_far, so_far + size).reshape(shape))
            so_far += size
        return found

    def gathered(self, values: Sequence[Value], order: np.ndarray, base: np.dtype | None = None) -> Value:
        """A new array of entries of several values: ``order`` has their numbers, as of :meth:`numbered`; 0 is zero."""
        base = self.base_of(values) if base is None else base
        shape, order = order.shape, order.ravel()
        out = self.made(base, shape)
        places = np.arange(len(order))
        first = 1
        for value, own in zip(values, self.numbered(values), strict=True):
            taken = (order >= first) & (order < first + own.size)
            self._spread(out, places[taken], value, order[taken] - first)
            first += own.size
        if not order.all():
            self._spread(out, places[order == 0], self.constant(0), order[order == 0])
        return out

    def _spread(self, out: Value, places: np.ndarray, value: Value, order: np.ndarray) -> None:
        """Set entries of a new array, by their numbers, to the entries of a value."""
        base, sizes, strides = out.kind.base, value.kind.sizes, value.kind.strides
        if out.kind.size <= self.unit.unrolled:
            for place, number in zip(places, order, strict=True):
                entry = self.element(value, [WORD(int(i)) for i in np.unravel_index(number, sizes)] if sizes else [])
                self.put(
                    self.converted(entry, base), out, [WORD(int(i)) for i in np.unravel_index(place, out.kind.sizes)]
                )
            return
        if not len(places):
            return
        to = self._by_index(places * base.itemsize)
        if not value.kind.is_array:
            number = self.converted(value, base)
            self.turns(WORD(len(places)), lambda i: self.store(number, self.shifted(out.llvm[0], to(i))))
            return
        indices = np.unravel_index(order, sizes)
        source = self._by_index(sum((i * stride for i, stride in zip(indices, strides, strict=True)), 0 * order))

        def body(i: ir.Value) -> None:
            array = self.reached(value, [i])
            number = self.load(self.shifted(array.llvm[0], source(i)), value.kind.base)
            self.store(self.converted(number, base), self.shifted(out.llvm[0], to(i)))

        self.turns(WORD(len(places)), body)

    def _by_index(self, numbers: np.ndarray) -> Callable[[ir.Value], ir.Value]:
        """Integers by their index, at run time."""
        steps = np.diff(numbers)
        if not len(steps) or (steps == steps[0]).all():
            step = int(steps[0]) if len(steps) else 0
            return lambda i: self.at.add(self.at.mul(i, WORD(step)), WORD(int(numbers[0])))
        memory = self.unit.constant_array(numbers.astype(INT))
        return lambda i: self.at.load(self.at.gep(memory, [i], source_etype=WORD), typ=WORD)

    def literal(self, array: np.ndarray) -> Value:
        """A new array with numbers that are known when compiling."""
        out = self.made(array.dtype, array.shape)
        if array.size <= self.unit.unrolled:
            for index, number in np.ndenumerate(array):
                self.put(self.constant(number).llvm[0], out, [WORD(i) for i in index])
            return out
        memory = self.unit.constant_array(np.ascontiguousarray(array))
        self.fill(out, Value(contiguous(array.dtype, array.shape), (memory,)))
        return out

    # products

    def product(self, a: Value, b: Value) -> Value:
        """``a @ b``; each sum is in the order of the indices."""
        left, right = self.shape_of(a), self.shape_of(b)
        if not (0 < len(left) <= 2 and 0 < len(right) <= 2):
            self.mistake(f"@ takes vectors and matrices, not shapes {shown(left)} and {shown(right)}")
        m = left[-1]
        if m != right[0]:
            self.mistake(f"arrays of shapes {shown(left)} and {shown(right)} do not fit in a matrix product")
        base = self.common([a, b])

        def sums(rows: Sequence[list[ir.Value]], column: list[ir.Value]) -> Sequence[ir.Value]:
            """The entries of some rows and of one column of the result."""

            def term(row: list[ir.Value], k: ir.Value) -> Value:
                return self.operation("Mult", self.element(a, [*row, k]), self.element(b, [k, *column]))

            return self._side_by_side(m, [partial(term, row) for row in rows], base, 3 if many else None)

        many = (self.unit.checked or not self.unit.cells) and int(np.prod((*left, *right[1:]), dtype=int)) > WRITTEN_OUT
        if len(left) == 1 and len(right) == 1:
            return scalar(sums([[]], [])[0], base)
        by_row = len(left) == 2 and left[0] > ROWS and not self.unit.checked and not self.unit.cells
        out = (self.temporary if many or by_row else self.made)(base, (*left[:-1], *right[1:]))
        if by_row:
            self.turns(
                WORD(left[0]), lambda i: self.each(right[1:], lambda j: self.put(sums([[i]], j)[0], out, [i, *j]))
            )
            return out
        self._fill_product(out, left[:-1], right[1:], sums, many)
        return out

    def _fill_product(
        self,
        out: Value,
        rows: tuple[int, ...],
        columns: tuple[int, ...],
        sums: Callable[[Sequence[list[ir.Value]], list[ir.Value]], Sequence[ir.Value]],
        many: bool,
    ) -> None:
        """Set the entries of a product, some rows at a time; of ``many``, in loops."""

        def block(first: ir.Value, n: int) -> None:
            def column(j: list[ir.Value]) -> None:
                places = [[self.at.add(first, WORD(i))] if n > 1 else [first] for i in range(n)]
                if isinstance(first, ir.Constant):
                    places = [[WORD(first.constant + i)] for i in range(n)]
                for place, number in zip(places, sums(places, j), strict=True):
                    self.put(number, out, [*place, *j])

            of_all(column)

        def of_all(body: Callable[[list[ir.Value]], None]) -> None:
            if many and columns:
                self.turns(WORD(columns[0]), lambda j: body([j]))
            else:
                self.each(columns, body)

        if not rows:
            of_all(lambda j: self.put(sums([[]], j)[0], out, j))
            return
        whole_blocks = rows[0] // ROWS
        if rows[0] <= self.unit.unrolled and not (many and whole_blocks > 1):
            for i in range(whole_blocks):
                block(WORD(i * ROWS), ROWS)
        else:
            self.turns(WORD(whole_blocks), lambda i: block(self.at.mul(i, WORD(ROWS)), ROWS))
        for i in range(whole_blocks * ROWS, rows[0]):
            block(WORD(i), 1)

    def _side_by_side(
        self, n: int, terms: Sequence[Callable[[ir.Value], Value]], base: np.dtype, most: int | None = None
    ) -> Sequence[ir.Value]:
        """Several sums of n terms, each in the order of the indices; up to ``most`` additions are written out."""
        if not n:
            return [SCALARS[base](0) for _ in terms]

        most = self.unit.unrolled - 1 if most is None else most

        def further(so_far: Sequence[ir.Value], k: ir.Value) -> list[ir.Value]:
            return [
                self.operation("Add", scalar(each, base), term(k)).llvm[0]
                for each, term in zip(so_far, terms, strict=True)
            ]

        return self.folded(n, [self.converted(term(WORD(0)), base) for term in terms], further, most)

    # reductions

    def reduced(self, value: Value, axis: int | None, reduce: Callable[[int, Callable, bool], Value]) -> Value:
        """``reduce(n, term, in_order)`` of all entries, or along an axis; ``term(i)`` is the entry at an index."""
        value = self.as_array(value)
        shape = self.shape_of(value)
        if not shape:
            return reduce(1, lambda _: value, False)
        if axis is None or len(shape) == 1:
            if axis not in (None, 0, -1):
                self.mistake(f"an array of shape {shown(shape)} has no axis {axis}")
            flat = self.flat(value)
            return reduce(flat.kind.size, lambda i: self.element(flat, [i]), False)
        if not -len(shape) <= axis < len(shape):
            self.mistake(f"an array of shape {shown(shape)} has no axis {axis}")
        axis %= len(shape)
        rest, out = _without(shape, axis), list[Value]()

        def body(indices: list[ir.Value]) -> None:
            def term(i: ir.Value) -> Value:
                return self.element(value, [*indices[:axis], i, *indices[axis:]])

            result = reduce(shape[axis], term, np.prod(shape[axis + 1 :]) != 1)
            if not out:
                out.append(self.made(result.kind.base, rest))
            self.put(result.llvm[0], out[0], indices)

        if len(rest) > 1 and self.unit.checked and not _is_usual(value.kind):
            self.lack("the order of memory of its result is NumPy's own; write it for x.copy()")
        self.each(rest, body)
        return out[0]

    def in_turn(self, n: int, term: Callable[[ir.Value], Value], step: Callable[[Value, Value], Value]) -> Value:
        """``step(step(term 0, term 1), term 2)`` and so on."""
        if not n:
            self.mistake("an array of no numbers has no such value")
        first = term(WORD(0))
        base = step(first, first).kind.base

        def further(so_far: Sequence[ir.Value], i: ir.Value) -> list[ir.Value]:
            return [self.converted(step(scalar(so_far[0], base), term(i)), base)]

        return scalar(self.folded(n, [self.converted(first, base)], further)[0], base)

    def total(self, n: int, term: Callable[[ir.Value], Value], in_order: bool) -> Value:
        """A sum as NumPy's: of up to eight numbers, or between rows, in order; otherwise of eight partial sums."""
        if not n:
            return self.constant(0.0)
        first = term(WORD(0))
        base = FLOAT if first.kind.base == FLOAT else INT
        if base == INT:
            return scalar(self._side_by_side(n, [term], base)[0], base)
        in_lanes = not in_order and n >= _LANES
        found = self._in_lanes(n, term, 0) if in_lanes else scalar(self._side_by_side(n, [term], base)[0], base)
        return scalar(self.at.fadd(found.llvm[0], DOUBLE(0.0)), FLOAT)  # NumPy begins with 0.0: a sum is never -0.0

    def _in_lanes(self, n: int, term: Callable[[ir.Value], Value], start: int) -> Value:
        def add(a: Value, b: Value) -> Value:
            return scalar(self.at.fadd(a.llvm[0], b.llvm[0]), FLOAT)

        if n > _BLOCK:
            half = n // 2 - n // 2 % _LANES
            return add(self._in_lanes(half, term, start), self._in_lanes(n - half, term, start + half))

        def further(so_far: Sequence[ir.Value], k: ir.Value) -> list[ir.Value]:
            at = self.at.add(self.at.mul(k, WORD(_LANES)), WORD(start))
            numbers = [term(self.at.add(at, WORD(j))).llvm[0] for j in range(_LANES)]
            return [self.at.fadd(each, number) for each, number in zip(so_far, numbers, strict=True)]

        sums = self.folded(n // _LANES, [term(WORD(start + j)).llvm[0] for j in range(_LANES)], further, 0)
        lanes = [scalar(each, FLOAT) for each in sums]
        while len(lanes) > 1:
            lanes = [add(lanes[i], lanes[i + 1]) for i in range(0, len(lanes), 2)]
        result = lanes[0]
        for i in range(n - n % _LANES, n):
            result = add(result, term(WORD(start + i)))
        return result

    def all_of(self, tests: Value) -> Value:
        """Whether all of an array's truth values are true."""
        if tests.kind.is_number:
            return tests
        if not tests.kind.size:
            return self.constant(True)

        def both(a: Value, b: Value) -> Value:
            return scalar(self.at.and_(self.truth(a), self.truth(b)), BOOL)

        return self.reduced(tests, None, lambda n, term, _: self.in_turn(n, term, both))

    def place_of(self, n: int, term: Callable[[ir.Value], Value], sign: str) -> Value:
        """The index of the first least (greatest) number, or of the first NaN."""
        if not n:
            self.mistake("an array of no numbers has no such value")
        first = term(WORD(0))
        base = first.kind.base

        def further(so_far: Sequence[ir.Value], i: ir.Value) -> list[ir.Value]:
            best, number = scalar(so_far[0], base), term(i)
            take = self.comparison(sign, number, best).llvm[0]
            if base == FLOAT:
                take = self.at.and_(self.at.or_(take, self.is_nan(number)), self.at.not_(self.is_nan(best)))
            return [self.at.select(take, number.llvm[0], best.llvm[0]), self.at.select(take, i, so_far[1])]

        return scalar(self.folded(n, [first.llvm[0], WORD(0)], further, 0)[1], INT)

    # parts of records and arrays

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
            hint = field_suggestion(name, [each for each in fields if each != "_"])
            self.mistake(f"{ast.unparse(node)} has no {name!r}; {hint}")
        dtype, offset = fields[name][:2]
        place = self.shifted(record.llvm[0], WORD(offset))
        part = view(place, dtype, record.kind.readonly)
        return replace(part, steady=record.steady, roots=record.roots, fleeting=record.fleeting)

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
                    if isinstance(pointer, Place):
                        self.reaches(array, each)
                        array = self.unit.cells.in_memory(self, array)
                        pointer = array.llvm[0]
                    pointer = self.shifted(pointer, self.at.mul(number, WORD(stride)))
            axis += 1
        pointer, kind = self.shifted(pointer, WORD(known)), array.kind
        if not shape:
            return replace(array, kind=Kind(kind.base, readonly=kind.readonly), llvm=(pointer,))
        part = Kind(kind.base, tuple(shape), tuple(strides), readonly=kind.readonly)
        return replace(array, kind=part, llvm=(pointer, *(length if part.is_open else ())))

    def reaches(self, array: Value, index: ast.expr) -> None:
        """Look at an index into an array with cells that is not known when compiling. A loop may be written out for
        it."""

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
            form = value.kind.form if getattr(value.kind.form, "of", None) is list else None
            return bundle([items[first + k * step] for k in range(n)], form)
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
        target, base = self.written_in(target), target.kind.base

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


def _indices(number: int, sizes: tuple[int, ...]) -> list[ir.Value]:
    """Of the entry with this number in C order."""
    return [WORD(int(i)) for i in np.unravel_index(number, sizes)] if sizes else []


def _without(items: tuple[int, ...], axis: int) -> tuple[int, ...]:
    return (*items[:axis], *items[axis + 1 :])


def _is_all(node: ast.Slice) -> bool:
    return node.lower is None and node.upper is None and node.step is None


def _is_dots(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is ...


def _is_usual(kind: Kind) -> bool:
    """Whether the axes of an array follow each other in memory as in an array from np.zeros."""
    strides = [abs(stride) for n, stride in zip(kind.sizes, kind.strides, strict=True) if n > 1]
    return 0 not in strides and strides == sorted(strides, reverse=True)
