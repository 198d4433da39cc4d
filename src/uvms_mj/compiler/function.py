"""One function: its branches, loops and returns, around the assignments of :mod:`.assignments`."""

import ast
import copy
import enum
import types
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from llvmlite import ir

from .assignments import Assignments
from .emission import Module
from .forms import MOST_TURNS, Given
from .lifetimes import Again, Plan, bindings
from .refusals import RAISED
from .values import (
    INT,
    NONE,
    WORD,
    Form,
    Kind,
    Memory,
    Value,
    bundle,
    parts_of,
    scalar,
    unbundled,
    whole,
)


@dataclass
class Loop:
    """A loop, or one turn of a loop that is written out: where continue and break lead, and which names have a value
    there. ``place`` is the loop's in the source if it could be written out, ``turns`` their number then, and ``names``
    are the names of its variables."""

    advance: ir.Block
    end: ir.Block
    place: tuple[int, int] | None = None
    turns: int = 0
    names: frozenset[str] = frozenset()
    at_continue: list[set[str]] = field(default_factory=list)
    at_break: list[set[str]] = field(default_factory=list)
    broken: list[set[str]] | None = None


@dataclass
class Iteration:
    """The range of a loop: the number of turns, and the value of the variable at each. ``apart``: the values have
    kinds of their own, so the turns are written out."""

    n: ir.Value
    item: Callable[[ir.Value], Value]
    apart: bool = False


class Function(Assignments):
    """One function for one combination of its arguments' kinds."""

    def __init__(
        self,
        unit: Module,
        function: types.FunctionType,
        tree: ast.FunctionDef,
        source: Sequence[str],
        fused: bool,
        plan: Plan,
    ) -> None:
        super().__init__(unit, function, tree, source, fused)
        self.start(plan)
        self.loops: list[Loop] = []
        self.exits: dict[int, tuple[ast.AST, ir.Block, list[set[str]]]] = {}
        self.blocks, self.without_value = 0, set[str]()
        self.returns: list[tuple[ir.Block, Value]] = []

    def bindings(self, statements: Iterable[ast.stmt]) -> Iterator[str]:
        """The names that statements bind; one that changes a list binds its name anew."""
        return bindings(statements, self.lists, self.walrus)

    def translate(self, code: ir.Function, kinds: Sequence[Kind]) -> None:
        """Write the body. The values of ``return`` are in :attr:`returns`, each with the block where it is known.
        :meth:`finish` completes the function."""
        self.entry = ir.IRBuilder(code.append_basic_block())  # has the variables, which LLVM moves to registers
        self.at = ir.IRBuilder(code.append_basic_block())
        self.begin = self.at.block
        arguments = self.tree.args
        given, at = code.args, 0
        cells = self.unit.cells.pointers if self.unit.cells else 0
        self.given = code.args[len(code.args) - 1 - cells : -1]
        plain = (*arguments.posonlyargs, *arguments.args, arguments.vararg, *arguments.kwonlyargs, arguments.kwarg)
        names = [each.arg for each in plain if each is not None]
        self.block = 1  # the body's, so that its statements may bind an argument anew
        for k, (name, kind) in enumerate(zip(names, kinds, strict=True)):
            n, like = len(kind.llvm), Value(kind, (), roots=frozenset({Memory(argument=k)}))
            value = unbundled(kind, tuple(given[at : at + n]), like)
            at += n
            self.bind(name, value, once=name in self.unbound)
        self.block = 0
        self.body(self.tree.body)
        if not self.at.block.is_terminated:
            self._leave(Value(NONE, ()))

    def finish(self) -> None:
        """Write what can only be known at the end."""
        self.finish_turnings()
        self.entry.branch(self.begin)

    def _leave(self, value: Value) -> None:
        if any(self._is_given_function(part) for part in parts_of(value.kind)):
            self.lack(
                "it returns a function that it was given, and what that reads around it may change until it is called"
            )
        block = self.at.append_basic_block()
        self.at.branch(block)
        self.returns.append((block, value))

    def _is_given_function(self, kind: Kind) -> bool:
        """Whether it is a function that is written within another one than this."""
        form = kind.form
        if not isinstance(form, Form) or not isinstance(form.of, types.FunctionType):
            return False
        return not any(
            function is form.of for (owner, *_), (function, _) in self.unit.within.items() if owner is self.function
        )

    def body(self, statements: Sequence[ast.stmt], straight: bool = False) -> None:
        """A list of statements. ``straight``: no way leads around them, so that they go on with the list before."""
        before = self.block
        if not straight:
            self.blocks += 1
            self.block = self.blocks
        for statement in statements:
            if self.at.block.is_terminated:
                break
            self.line = statement.lineno
            if not self.unit.left_out or not self._leaves_out(statement):
                self.visit(statement)
        self.block = before

    @contextmanager
    def on_a_way(self) -> Iterator[None]:
        before, self.blocks = self.block, self.blocks + 1
        self.block = self.blocks
        yield
        self.block = before

    def place_of_line(self) -> tuple[str, int]:
        """File and line of the statement."""
        code = self.function.__code__
        return code.co_filename, code.co_firstlineno + self.line - 1

    def _leaves_out(self, statement: ast.stmt) -> bool:
        """Whether a statement is not translated: it is left out, or it reads a name that such a statement binds."""
        within = {id(each) for part in ("body", "orelse") for each in getattr(statement, part, ())}
        parts = [each for each in ast.iter_child_nodes(statement) if id(each) not in within]
        names = {each.id for part in parts for each in ast.walk(part) if isinstance(each, ast.Name)}
        if self.place_of_line() not in self.unit.left_out and not names & self.without_value:
            return False
        self.without_value |= set(self.bindings([statement]))
        return True

    def demand_lasting(self, name: str, node: ast.expr | ast.FunctionDef) -> None:
        if name in self.unbound or id(node) in self.handed:
            return
        if name not in self.bound_once or self.turning is not None or self.written_out or name in self.of_turn:
            self.lack(f"{name} is bound more than once, or in a loop, and read by a function within this one")

    def needs_constant(self, what: str) -> None:
        for loop in reversed(self.loops):
            if loop.place is not None and loop.place not in self.plan.written_out:
                self.plan.written_out.add(loop.place)
                raise Again
        super().needs_constant(what)

    def kind_changes(self) -> None:
        for loop in reversed(self.loops):
            if (
                loop.place is not None
                and loop.place not in self.plan.written_out
                and loop.turns <= 4 * self.unit.unrolled
            ):
                self.plan.written_out.add(loop.place)
                raise Again

    def reaches(self, array: Value, index: ast.expr) -> None:
        names = {each.id for each in ast.walk(index) if isinstance(each, ast.Name)}
        for loop in reversed(self.loops):
            if loop.place is None or loop.place in self.plan.written_out:
                continue
            if array.kind.base.fields is not None or (loop.turns <= self.unit.unrolled and names & loop.names):
                self.plan.written_out.add(loop.place)
                raise Again

    # branches

    def _If(self, node: ast.If) -> None:
        test = self.test(node.test)
        if isinstance(test, ir.Constant):
            self.body(node.body if test.constant else node.orelse, straight=True)
            return
        before, ways = self.assigned, []
        with self.at.if_else(test) as (then, otherwise):
            for way, statements in ((then, node.body), (otherwise, node.orelse)):
                with way:
                    self.assigned = set(before)
                    self.body(statements)
                    if not self.at.block.is_terminated:
                        ways.append(self.assigned)
        self.assigned = set.intersection(*ways) if ways else before
        if not ways:
            self.at.unreachable()

    def _Raise(self, node: ast.Raise) -> None:
        if not self.unit.checked:
            self.lack("kernels do not raise; np.linalg has solve, inv and cholesky for them, which give NaN")
        self.at.ret(WORD(self.code(RAISED)))

    def _Assert(self, node: ast.Assert) -> None:
        self.demand(self.test(node.test), RAISED)

    def _Try(self, node: ast.Try) -> None:
        """A try. Where its body raises, machine code ends early, and Python goes on with its handlers."""
        if node.finalbody or self.trying or not self.unit.checked:
            self.lack("the language has no finally, and no try within another one")
        self.trying = True
        self.body(node.body, straight=True)
        self.trying = False
        if not self.at.block.is_terminated:
            self.body(node.orelse, straight=True)

    def _Pass(self, node: ast.Pass) -> None:
        pass

    def _FunctionDef(self, node: ast.FunctionDef) -> None:
        self.assign(ast.Name(node.name, ast.Store()), self.closure(node))

    def _Global(self, node: ast.Global) -> None:
        """Of names that are only read; one that is bound is refused where it is."""

    def _Delete(self, node: ast.Delete) -> None:
        for each in node.targets:
            if not isinstance(each, ast.Name) or self.loops:
                self.lack("del of names only, and outside of loops")
            self.value(each)
            self.assigned.discard(each.id)

    def _Match(self, node: ast.Match) -> None:
        """As the comparisons that it stands for, one after the other."""
        subject = self.held(self.value(node.subject))
        chain: list[ast.stmt] = []
        for case in reversed(node.cases):
            test = self._matches(case.pattern, subject)
            if case.guard is not None:
                test = ast.BoolOp(ast.And(), [test, case.guard])
            branch = ast.If(test, case.body, chain)
            ast.copy_location(branch, case.pattern)
            chain = [branch]
        self.body(chain, straight=True)

    def _matches(self, pattern: ast.pattern, subject: Value) -> ast.expr:
        if isinstance(pattern, ast.MatchValue):
            return ast.Compare(Given(subject), [ast.Eq()], [pattern.value])
        if isinstance(pattern, ast.MatchSingleton):
            return ast.Compare(Given(subject), [ast.Is()], [ast.Constant(pattern.value)])
        if isinstance(pattern, ast.MatchOr):
            return ast.BoolOp(ast.Or(), [self._matches(each, subject) for each in pattern.patterns])
        if isinstance(pattern, ast.MatchAs) and pattern.name is None and pattern.pattern is None:
            return ast.Constant(True)
        return self.lack("match compares with numbers, texts and `_` here; write if and elif")

    def _Return(self, node: ast.Return) -> None:
        self._returned(node.value)

    def _returned(self, node: ast.expr | None) -> None:
        """Leave with a value; of ``a if test else b``, on two ways, so that each is known to be new or not."""
        if not isinstance(node, ast.IfExp):
            self._leave(Value(NONE, ()) if node is None else self.value(node))
            return
        test = self.test(node.test)
        if isinstance(test, ir.Constant):
            self._returned(node.body if test.constant else node.orelse)
            return
        with self.at.if_else(test) as (then, otherwise):
            with then:
                self._returned(node.body)
            with otherwise:
                self._returned(node.orelse)
        self.at.unreachable()

    # loops

    def _Continue(self, node: ast.Continue) -> None:
        self.loops[-1].at_continue.append(self.assigned)
        self.at.branch(self.loops[-1].advance)

    def _Break(self, node: ast.Break) -> None:
        loop = self.loops[-1]
        (loop.at_break if loop.broken is None else loop.broken).append(self.assigned)
        self.at.branch(self.loops[-1].end)

    def _While(self, node: ast.While) -> None:
        if node.orelse:
            self._with_else(node)
            return
        outer, self.turning = self.turning, self.turning_of(node)
        head, inside, end = (self.at.append_basic_block() for _ in range(3))
        self.at.branch(head)
        self.at.position_at_end(head)
        test = self.test(node.test)
        self.at.cbranch(test, inside, end)
        self.at.position_at_end(inside)
        loop, before = self._loop_of(node, Loop(head, end)), set(self.assigned)
        self._turn(loop, node.body)
        if not self.at.block.is_terminated:
            self.look_for_interrupt()
            self.at.branch(head)
        forever = isinstance(test, ir.Constant) and bool(test.constant)
        self.assigned = (
            set.intersection(*loop.at_break, *([] if forever else [before]))
            if (loop.at_break or not forever)
            else before
        )
        self.at.position_at_end(end)
        if forever and not loop.at_break:
            self.at.unreachable()
        self.turning = outer

    def _turn(self, loop: Loop, statements: Sequence[ast.stmt], straight: bool = False) -> None:
        self.loops.append(loop)
        self.body(statements, straight)
        self.loops.pop()

    def _For(self, node: ast.For) -> None:
        if node.orelse:
            self._with_else(node)
            return
        place = (node.lineno, node.col_offset)
        is_range = isinstance(node.iter, ast.Call) and self.known(node.iter.func) is range
        turns = None if is_range and place not in self.plan.written_out else self.iteration(node.iter)
        if turns is not None and (turns.apart or place in self.plan.written_out):
            self._write_out(node, turns)
            return
        outer, self.turning = self.turning, self.turning_of(node)
        if turns is None:
            assert isinstance(node.iter, ast.Call)
            start, stop, step = self._range(node.iter)
            self._loop(node, start, stop, step, lambda i: scalar(i, INT))
        else:
            self._loop(node, WORD(0), turns.n, 1, turns.item)
        self.turning = outer

    def _with_else(self, node: ast.For | ast.While) -> None:
        """``else`` of a loop: what comes after it unless it was left by break."""
        alone = copy.copy(node)
        alone.orelse = []
        left = self.at.append_basic_block()
        breaks = list[set[str]]()
        self.exits[id(alone)] = alone, left, breaks
        if id(node) in self.leaving:
            self.leaving.add(id(alone))
        self.visit(alone)
        self.body(node.orelse)
        if not self.at.block.is_terminated:
            breaks.append(self.assigned)
            self.at.branch(left)
        self.at.position_at_end(left)
        if breaks:
            self.assigned = set.intersection(*breaks)
        else:
            self.at.unreachable()

    def _loop_of(self, node: ast.For | ast.While, loop: Loop) -> Loop:
        """A loop, whose break leads over its else."""
        if id(node) in self.exits:
            _, loop.end, loop.broken = self.exits[id(node)]
        return loop

    def _range(self, call: ast.Call) -> tuple[ir.Value, ir.Value, int]:
        if not 1 <= len(call.args) <= 3 or call.keywords:
            self.mistake("range takes one to three integers")
        bounds = [self.integer(each) for each in call.args]
        start, stop = (WORD(0), bounds[0]) if len(bounds) == 1 else bounds[:2]
        step = bounds[2] if len(bounds) == 3 else WORD(1)
        if not isinstance(step, ir.Constant):
            self.lack("the step of a range must be known when compiling")
        if step.constant == 0:
            self.mistake("the step of a range is not 0")
        return start, stop, step.constant

    def _loop(
        self, node: ast.For, start: ir.Value, stop: ir.Value, step: int, item: Callable[[ir.Value], Value]
    ) -> None:
        """A loop over integers, with the variable that an item of them gives."""
        n = None
        if isinstance(start, ir.Constant) and isinstance(stop, ir.Constant):
            n = len(range(start.constant, stop.constant, step))
        if n == 0 and not self.unit.checked:  # as of an effect that a plant has not
            return
        few = n is not None and n <= MOST_TURNS
        before, ways = set(self.assigned), list[set[str]]()

        def body(i: ir.Value, advance: ir.Block, end: ir.Block) -> None:
            names = frozenset(each.id for each in ast.walk(node.target) if isinstance(each, ast.Name))
            loop = Loop(advance, end, (node.lineno, node.col_offset) if few else None, n or 0, names)
            self._loop_of(node, loop)
            self.assign(node.target, item(i))
            self._turn(loop, node.body)
            if not self.at.block.is_terminated:
                loop.at_continue.append(self.assigned)
            ways.extend([*loop.at_break, *([] if n else [before])])
            if n and loop.at_continue:
                ways.append(set.intersection(*loop.at_continue))

        self.loop(start, stop, step, body, (lambda: None) if few else self.look_for_interrupt)
        self.assigned = set.intersection(*ways) if ways else before

    def _write_out(self, node: ast.For, turns: Iteration) -> None:
        """A loop whose turns are written out, so that its variable is known in each."""
        if not isinstance(turns.n, ir.Constant) and not turns.apart:  # it was constant until more was known to change
            self.plan.written_out.discard((node.lineno, node.col_offset))
            raise Again
        if not isinstance(turns.n, ir.Constant) or turns.n.constant > MOST_TURNS:
            self.lack(f"this loop has to be written out, and has more than {MOST_TURNS} turns")
        end, ways = self.at.append_basic_block(), []
        around, self.copies = self.copies, self.copies * max(1, turns.n.constant)
        if self.copies > MOST_TURNS and self.unit.checked:
            self.lack(f"this loop and those around it have to be written out, and have more than {MOST_TURNS} turns")
        inside, of_turn = set(self.bindings(node.body)), set(self.bindings([node]))
        self.written_out += 1
        for k in range(turns.n.constant):
            following = self.at.append_basic_block()
            loop = self._loop_of(node, Loop(following, end))
            self._assign_known(node.target, turns.item(WORD(k)), inside)
            self._turn(loop, node.body, straight=id(node) not in self.leaving)
            for name in of_turn:  # known in its own turn only
                self.constants.pop(name, None)
            ways += loop.at_break
            if not self.at.block.is_terminated:
                self.at.branch(following)
                loop.at_continue.append(self.assigned)
            self.at.position_at_end(following)
            if not loop.at_continue:
                self.at.unreachable()
                break
            self.assigned = set.intersection(*loop.at_continue)
        if not self.at.block.is_terminated:
            ways.append(self.assigned)
            self.at.branch(end)
        self.written_out, self.copies = self.written_out - 1, around
        self.at.position_at_end(end)
        self.assigned = set.intersection(*ways) if ways else self.assigned
        for name in inside:  # it has a place for one turn
            if (its := self.variables.get(name)) is not None and its.at_place:
                self.assigned.discard(name)

    def _assign_known(self, target: ast.expr, value: Value, inside: set[str]) -> None:
        """Bind a loop's variable for one turn. Its number is known in the turn unless the body binds it, too."""
        plain = isinstance(target, ast.Tuple) and not any(isinstance(each, ast.Starred) for each in target.elts)
        if isinstance(target, ast.Tuple) and plain and value.kind.items is not None:
            for each, item in zip(target.elts, self.unpacked(value, len(target.elts)), strict=True):
                self._assign_known(each, item, inside)
            return
        self.assign(target, value)
        if isinstance(target, ast.Name) and target.id not in inside and value.constant is not None:
            self.constants[target.id] = value

    def iteration(self, node: ast.expr) -> Iteration:
        """The range of a loop: a range, an array, a tuple, enumerate or zip of them."""
        known = self.known(node.func) if isinstance(node, ast.Call) else None
        if isinstance(node, ast.Call) and known is range:
            start, stop, step = self._range(node)
            n = self._turns_of(start, stop, step)
            return Iteration(n, lambda i: self._advanced(start, i, step))
        if isinstance(node, ast.Call) and known is enumerate:
            named = {each.arg: each.value for each in node.keywords}
            if not 1 <= len(node.args) <= 2 or named.keys() - {"start"} or (named and len(node.args) == 2):
                self.lack("enumerate takes what it runs over, and start")
            inner = self.iteration(node.args[0])
            start = node.args[1] if len(node.args) == 2 else named.get("start")
            first = WORD(0) if start is None else self.integer(start)
            return Iteration(inner.n, lambda i: bundle([self._advanced(first, i, 1), inner.item(i)]), inner.apart)
        if isinstance(node, ast.Call) and known is zip:
            if [each.arg for each in node.keywords] not in ([], ["strict"]):
                self.lack("zip takes what it runs over, and strict")
            parts = [self.iteration(each) for each in node.args]
            lengths = {part.n.constant if isinstance(part.n, ir.Constant) else None for part in parts}
            if node.keywords and (len(lengths) > 1 or None in lengths):
                self.lack("zip with strict needs parts of one length, known when compiling")
            return self._zipped(parts)
        if isinstance(node, ast.Call) and known is reversed and len(node.args) == 1 and not node.keywords:
            return self._reversed(node.args[0])
        if isinstance(node, ast.Call) and known is map and len(node.args) > 1 and not node.keywords:
            function, parts = node.args[0], [self.iteration(each) for each in node.args[1:]]
            if isinstance(function, ast.Name | ast.Lambda):
                function = Given(self.value(function))

            def called(i: ir.Value) -> Value:
                return self.held(self.visit(ast.Call(function, [Given(part.item(i)) for part in parts], [])))

            return Iteration(self._zipped(parts).n, called, apart=True)
        if isinstance(node, ast.GeneratorExp):
            return self._over_generator(node)
        value = self.value(node)
        found = self.object_of(value)
        if isinstance(found, str):
            return self._over_items([self.frozen(each) for each in found])
        if isinstance(found, type) and issubclass(found, enum.Enum):
            return self._over_items([self.frozen(each) for each in found])
        if isinstance(found, range):
            return self._over_items([self.frozen(each) for each in found])
        if value.kind.items is not None or self.is_dict(value):
            return self._over_items(self.unpacked(value, None))
        if not value.kind.shape:
            self.mistake(f"{value.kind.described()} can't be run over")
        name = f"array at {node.lineno}:{node.col_offset}"  # a name, so that its memory is kept while the loop turns
        self.bind(name, value)
        array = self.variable(name)
        n = array.kind.shape[0]  # type: ignore[index]  # numbers are refused above
        return Iteration(array.llvm[1] if n is None else WORD(n), lambda i: self.at_index(self.variable(name), i))

    def _reversed(self, node: ast.expr) -> Iteration:
        """A loop over reversed values; each is read at its turn."""
        if isinstance(node, ast.GeneratorExp) or (
            isinstance(node, ast.Call) and self.known(node.func) in (map, zip, enumerate, reversed)
        ):
            self.mistake("reversed takes what has a length")
        inner = self.iteration(node)
        last = self.operation("Sub", scalar(inner.n, INT), whole(1))
        return Iteration(inner.n, lambda i: inner.item(self._back(last, i)), inner.apart)

    def _back(self, last: Value, i: ir.Value) -> ir.Value:
        return self.operation("Sub", last, scalar(i, INT)).llvm[0]

    def _over_generator(self, node: ast.GeneratorExp) -> Iteration:
        """The values of a generator; each is made at its turn."""
        first, *rest = node.generators
        if rest or first.ifs or first.is_async:
            self.lack("a loop over a generator with several loops, or with a condition; write a list")
        inner = self.iteration(first.iter)

        def item(i: ir.Value) -> Value:
            with self.bound(self._names_of(first.target, inner.item(i))):
                return self.held(self.value(node.elt))

        return Iteration(inner.n, item, apart=True)

    def _over_items(self, items: list[Value]) -> Iteration:
        def item(i: ir.Value) -> Value:
            return items[i.constant]

        return Iteration(WORD(len(items)), item, apart=True)

    def _zipped(self, parts: list[Iteration]) -> Iteration:
        n = parts[0].n
        for part in parts[1:]:
            if isinstance(n, ir.Constant) and isinstance(part.n, ir.Constant):
                n = WORD(min(n.constant, part.n.constant))
            else:
                n = self.better("<", scalar(n, INT), scalar(part.n, INT)).llvm[0]
        return Iteration(n, lambda i: bundle([part.item(i) for part in parts]), any(part.apart for part in parts))

    def _turns_of(self, start: ir.Value, stop: ir.Value, step: int) -> ir.Value:
        if isinstance(start, ir.Constant) and isinstance(stop, ir.Constant):
            return WORD(len(range(start.constant, stop.constant, step)))
        far = self.operation("Sub", scalar(stop, INT), scalar(start, INT))
        ahead = self.operation("Add", far, whole(step - 1 if step > 0 else step + 1))
        return self.better(">", whole(0), self.operation("FloorDiv", ahead, whole(step))).llvm[0]

    def _advanced(self, start: ir.Value, i: ir.Value, step: int) -> Value:
        by = self.operation("Mult", scalar(i, INT), whole(step))
        return self.operation("Add", scalar(start, INT), by)

    def at_index(self, array: Value, i: ir.Value) -> Value:
        """An entry or a row."""
        if array.place is not None and not isinstance(i, ir.Constant):
            self.reaches(array, ast.Name("", ast.Load()))
            array = self.unit.cells.in_memory(self, array)
        kind = array.kind
        place = self.shifted(array.llvm[0], self.distance([i], kind.strides[:1]))
        part = Kind(kind.base, (kind.shape or ())[1:] or None, kind.strides[1:], readonly=kind.readonly)
        return self.read(replace(array, kind=part, llvm=(place,)))
