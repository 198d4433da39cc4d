"""Facts about a function that its tree tells before anything is translated: its lists, loops, names and calls."""

import ast
import functools
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .lifetimes import bindings


@dataclass(frozen=True)
class TreeFacts:
    """Facts about a function that its tree tells, whatever its arguments are.

    Attributes:
        lists: names that stand for a list or a dict that it makes.
        handed, leaving: identities of the arguments of calls at once, and of loops that are left before their end.
        bound_once, unbound: names that one statement binds, and parameters that none does.
        walrus: whether an expression binds a name.
    """

    lists: frozenset[str]
    handed: frozenset[int]
    leaving: frozenset[int]
    bound_once: frozenset[str]
    unbound: frozenset[str]
    walrus: bool


@functools.lru_cache(maxsize=4096)  # a tree that is kept keeps its identities
def facts_of(tree: ast.FunctionDef) -> TreeFacts:
    """To go through the tree for each combination of kinds would take a fifth of the translation."""
    nodes: dict[type, list[Any]] = defaultdict(list)
    for each in ast.walk(tree):
        nodes[type(each)].append(each)
    lists, walrus = _lists_of([*nodes[ast.Assign], *nodes[ast.AnnAssign]]), bool(nodes[ast.NamedExpr])
    stored = Counter(bindings(tree.body, lists, walrus))
    parameters = {each.arg for each in ast.walk(tree.args) if isinstance(each, ast.arg)}
    calls = [each for each in nodes[ast.Call] if _calls_at_once(each)]
    return TreeFacts(
        lists,
        frozenset(id(each) for call in calls for each in call.args),
        frozenset(id(loop) for loop in (*nodes[ast.For], *nodes[ast.While]) if _is_left(loop)),
        frozenset(name for name, times in stored.items() if times == 1) - parameters,
        frozenset(parameters) - stored.keys(),
        walrus,
    )


_LISTS = ast.List | ast.ListComp | ast.Dict | ast.DictComp


def _lists_of(assignments: Iterable[ast.Assign | ast.AnnAssign]) -> frozenset[str]:
    """Names that stand for a list or a dict that a function with these assignments makes."""
    found = set()
    for node in assignments:
        value = node.value
        if isinstance(value, ast.BinOp):
            value = value.left if isinstance(value.left, _LISTS) else value.right
        is_call = isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and value.func.id in ("list", "dict")
        if isinstance(value, _LISTS) or is_call:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {each.id for each in targets if isinstance(each, ast.Name)}
    return frozenset(found)


_READERS = (
    "len",
    "sum",
    "min",
    "max",
    "any",
    "all",
    "sorted",
    "tuple",
    "list",
    "enumerate",
    "zip",
    "float",
    "print",
    "dict",
)


def held_in(tree: ast.AST, name: str) -> str:
    """Where something else may come to hold the list that a name of a function stands for: words of the source."""
    parents = {id(child): node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
    for node in ast.walk(tree):
        if isinstance(node, ast.arg) and node.arg == name:
            return name
        if not isinstance(node, ast.Name) or node.id != name:
            continue
        parent = parents[id(node)]
        if isinstance(node.ctx, ast.Store):
            made = ast.List | ast.ListComp | ast.Dict | ast.DictComp | ast.BinOp | ast.Call
            if not isinstance(parent, ast.Assign | ast.AnnAssign | ast.AugAssign) or not isinstance(parent.value, made):
                return ast.unparse(parent)[:60]
            if (isinstance(parent, ast.Assign) and len(parent.targets) > 1) or _is_users(parent.value):
                return ast.unparse(parent)[:60]
            continue
        reads = isinstance(parent, ast.Subscript | ast.Attribute) and parent.value is node
        reads = reads or isinstance(parent, ast.Return | ast.BinOp | ast.Compare | ast.Starred | ast.If | ast.While)
        reads = reads or (isinstance(parent, ast.Call) and node in parent.args and not _is_users(parent))
        if isinstance(parent, ast.Assign) and parent.value is node:  # into a part of an array
            reads = all(isinstance(each, ast.Subscript | ast.Tuple | ast.List) for each in parent.targets)
            parts = (part for each in parent.targets for part in ast.walk(each))
            reads = reads and not any(_is_name(part, name) for part in parts)
        if isinstance(parent, ast.For) and parent.iter is node:
            reads = not any(_is_name(part, name) for each in parent.body for part in ast.walk(each))
        reads = reads and not any(_is_changed(loop.body, name) for loop in _loops_over(node, parents))
        if isinstance(parent, ast.comprehension) and parent.iter is node:
            reads = True
        if not reads:
            return ast.unparse(parent)[:60]
    return ""


def _loops_over(node: ast.AST, parents: Mapping[int, ast.AST]) -> Iterator[ast.For]:
    """The loops that run over an expression with a node in it, such as ``for k, v in enumerate(x)``."""
    while not isinstance(node, ast.stmt):
        above = parents[id(node)]
        if isinstance(above, ast.For) and above.iter is node:
            yield above
        node = above


_READING = ("items", "keys", "values", "get", "index", "count", "copy")


def _is_changed(statements: Sequence[ast.stmt], name: str) -> bool:
    """Whether statements may change the list or the dict that a name stands for."""
    for node in (part for each in statements for part in ast.walk(each)):
        stores = isinstance(getattr(node, "ctx", None), ast.Store | ast.Del)
        if stores and any(_is_name(part, name) for part in ast.walk(node)):
            return True
        method = node.func if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) else None
        if method is not None and _is_name(method.value, name) and method.attr not in _READING:
            return True
    return False


def _calls_at_once(call: ast.Call) -> bool:
    """Whether a call is of a function by its name, which calls a function that it is given, or none."""
    keep = ("list", "tuple", "dict", "set", "zip", "enumerate", "partial")
    return isinstance(call.func, ast.Name) and call.func.id not in keep


def _is_name(node: ast.AST, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name


def _is_users(node: ast.expr | None) -> bool:
    """Whether a call may be of a user's function, which may keep or give back its arguments."""
    if not isinstance(node, ast.Call):
        return False
    if isinstance(node.func, ast.Name):
        return node.func.id not in _READERS
    return not (isinstance(node.func, ast.Attribute) and ast.unparse(node.func).startswith(("np.", "numpy.", "math.")))


def _is_left(loop: ast.For | ast.While) -> bool:
    """Whether a loop has a break or a continue of its own, or a return in it."""
    todo: list[tuple[ast.AST, bool]] = [(each, True) for each in loop.body]
    while todo:
        node, own = todo.pop()
        if isinstance(node, ast.Return) or (own and isinstance(node, ast.Break | ast.Continue)):
            return True
        if not isinstance(node, ast.expr | ast.FunctionDef):
            own = own and not isinstance(node, ast.For | ast.While)
            todo += [(each, own) for each in ast.iter_child_nodes(node)]
    return False
