"""Changes by the functions of a file, whose values are no constants of a run."""

import ast
import functools
import inspect
import linecache
import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..files import parsed

_CHANGING = (
    *("append", "appendleft", "extend", "insert", "pop", "popleft", "popitem", "remove", "clear", "sort", "reverse"),
    *("update", "setdefault", "add", "discard", "rotate", "fill", "resize", "put", "partition", "setflags"),
    *("__setitem__", "__setattr__"),
)
_FIRST = ("__init__", "__post_init__", "__new__", "__set_name__", "__init_subclass__")


@dataclass
class Changes:
    """Global names, and attributes of objects, with a line where a function changes them. ``called`` has the objects
    that only methods change, of a list or a dict, each method with a line. ``files`` are the files that were read."""

    names: dict[str, int] = field(default_factory=dict)
    attributes: dict[str, int] = field(default_factory=dict)
    called: dict[str, dict[str, int]] = field(default_factory=dict)
    files: tuple[str, ...] = ()

    def of(self, name: str, value: Any, table: Mapping[str, int]) -> int:
        """A line where a name or an attribute of a table is changed, with its value now; otherwise 0. A method of a
        user's own class changes what its own text changes."""
        for method, line in self.called.get(name, {}).items():
            its = inspect.getattr_static(type(value), method, None)
            if not isinstance(its, types.FunctionType) or its.__code__.co_filename not in self.files:
                return line
        return table.get(name, 0)


def changes_of(function: types.FunctionType) -> Changes:
    """Changes by the functions in a function's file, and in the files of its global names. A file that can't be read
    changes nothing."""
    files = sorted({function.__code__.co_filename, str(function.__globals__.get("__file__", ""))})
    found = Changes()
    for file in files:
        linecache.checkcache(file)
        its = _changes("".join(linecache.getlines(file)))
        called = {name: found.called.get(name, {}) | its.called.get(name, {}) for name in found.called | its.called}
        found = Changes(found.names | its.names, found.attributes | its.attributes, called, tuple(files))
    return found


def line_of_print(function: types.FunctionType) -> int:
    """The first line where a function, or one in its file whose name it uses, calls print, or 0."""
    code = function.__code__
    linecache.checkcache(code.co_filename)
    try:
        tree = parsed("".join(linecache.getlines(code.co_filename)))
    except SyntaxError:
        return 0
    named: dict[str, list[Any]] = {}
    waiting, met = list[Any](), list[Any]()
    for each in _functions(tree):
        named.setdefault(getattr(each, "name", ""), []).append(each)
        first = min(at.lineno for at in (each, *getattr(each, "decorator_list", ())))
        waiting += [each] if first == code.co_firstlineno else []
    lines = []
    while waiting:
        met.append(now := waiting.pop())
        nodes = list(ast.walk(now))
        lines += [node.lineno for node in nodes if isinstance(node, ast.Call) and _is_name(node.func, "print")]
        used = {node.id if isinstance(node, ast.Name) else getattr(node, "attr", "") for node in nodes}
        waiting += [each for name in used for each in named.get(name, ()) if each not in (*met, *waiting)]
    return min(lines, default=0)


@functools.lru_cache(maxsize=64)
def _changes(source: str) -> Changes:
    found = Changes()
    try:
        tree = parsed(source)
    except SyntaxError:
        return found
    for function in _functions(tree):
        _look(function, found)
    return found


def _functions(tree: ast.AST) -> Iterator[Any]:
    """The functions of a file that are in no other function."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield node
        else:
            yield from _functions(node)


def _look(function: ast.AST, found: Changes) -> None:
    nodes = list(ast.walk(function))
    shared = {name for node in nodes if isinstance(node, ast.Global) for name in node.names}
    own = {node.arg for node in nodes if isinstance(node, ast.arg)}
    own |= {node.id for node in nodes if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load)}
    own |= {node.name for node in nodes if isinstance(node, ast.FunctionDef | ast.ClassDef) and node is not function}
    own -= shared
    first = getattr(function, "name", "") in _FIRST
    for node in nodes:
        changed: ast.AST | None = None
        if isinstance(node, ast.Name) and node.id in shared and not isinstance(node.ctx, ast.Load):
            found.names.setdefault(node.id, node.lineno)
        elif isinstance(node, ast.Attribute | ast.Subscript) and not isinstance(node.ctx, ast.Load):
            changed = node
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in _CHANGING:
            _note_call(node.func, own, found)
        elif isinstance(node, ast.Call) and _is_name(node.func, "setattr", "delattr"):
            changed = ast.Attribute(node.args[0], _text(node.args[1:2]), ast.Store()) if node.args else None
        if changed is not None:
            _note(changed, own, first, getattr(node, "lineno", 0), found)


def _note_call(method: ast.Attribute, own: set[str], found: Changes) -> None:
    """Note a call that changes its object, if that is a list or a dict, and the object that this one is a part of."""
    of = method.value
    while isinstance(of, ast.Subscript):
        of = of.value
    name = of.attr if isinstance(of, ast.Attribute) else of.id if isinstance(of, ast.Name) and of.id not in own else ""
    if name:
        found.called.setdefault(name, {}).setdefault(method.attr, method.lineno)
    if isinstance(of, ast.Attribute):
        _note(of.value, own, True, method.lineno, found)


def _is_name(node: ast.AST, *names: str) -> bool:
    return isinstance(node, ast.Name) and node.id in names


def _text(nodes: list[ast.expr]) -> str:
    return str(nodes[0].value) if nodes and isinstance(nodes[0], ast.Constant) else ""


def _note(node: ast.AST, own: set[str], first: bool, line: int, found: Changes) -> None:
    """Note the name, and the attributes, that a part belongs to which is stored or changed."""
    while isinstance(node, ast.Attribute | ast.Subscript):
        if isinstance(node, ast.Attribute) and not first:
            found.attributes.setdefault(node.attr, line)
        node = node.value
    if isinstance(node, ast.Name) and node.id not in own:
        found.names.setdefault(node.id, line)
