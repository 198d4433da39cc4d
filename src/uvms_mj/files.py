"""Files: files that the package ships, TOML read in bounded time, Python source, and atomic writing."""

import ast
import contextlib
import dataclasses
import functools
import inspect
import linecache
import os
import re
import tempfile
import textwrap
import threading
import tomllib
import types
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from .errors import InputError, number_hint, shortened, suggestion

_PACKAGE = Path(__file__).parent
_SHIPPED = {
    "scenarios": (".toml", _PACKAGE / "scenarios"),
    "studies": (".toml", _PACKAGE / "studies" / "shipped"),
    "models": (".xml", _PACKAGE.parents[1] / "models", _PACKAGE / "models"),  # in a checkout; in a wheel
    "examples": (".*", _PACKAGE.parents[1] / "examples", _PACKAGE / "examples"),
}
"""Suffix and folders of the shipped files."""


def shipped(kind: str) -> dict[str, Path]:
    """The shipped files of a kind, "scenarios", "studies", "models" or "examples", by their names without suffix."""
    suffix, *folders = _SHIPPED[kind]
    return {path.stem: path for folder in folders for path in sorted(Path(folder).glob(f"*{suffix}"))}


_found: dict[tuple[str, str], Path] = {}


def shipped_file(kind: str, name: str) -> Path | None:
    """A shipped file of a kind by its name; None if there is none. The folders are read anew for a name that is not
    known or has gone."""
    path = _found.get((kind, name))
    if path is None or not is_file(path):
        path = shipped(kind).get(name)
        if path is not None:
            _found[kind, name] = path
    return path


def is_file(path: str | os.PathLike) -> bool:
    """Whether a file is there; false for a name that the system does not take, for example a text of 256 characters."""
    try:
        return Path(path).is_file()
    except OSError:
        return False


def is_folder(path: str | os.PathLike) -> bool:
    """Whether a folder is there, as :func:`is_file`."""
    try:
        return Path(path).is_dir()
    except OSError:
        return False


def toml_path(given: str | os.PathLike, noun: str, kind: str) -> Path:
    """Path of a TOML file, or of the shipped one of a kind by its name; ``noun`` is its word in messages. Raises
    InputError if there is none."""
    if not isinstance(given, str | os.PathLike):
        raise InputError(f"{noun} {shortened(given)}: must be a name, or the path of a TOML file")
    path = Path(given)
    if is_file(path):
        return path
    if is_folder(path):
        raise InputError(f"{noun} {str(given)!r}: is a folder; name a TOML file in it")
    if (found := shipped_file(kind, str(given))) is not None:
        return found
    known = shipped(kind)
    if path.suffix == ".toml" or len(path.parts) > 1:
        raise InputError(f"{noun} {str(given)!r}: no such file; built-in {kind}: {', '.join(sorted(known))}")
    raise InputError(f"{noun} {str(given)!r}: neither a file nor built in; {suggestion(str(given), known)}")


def tables_of(path: Path, noun: str) -> dict[str, Any]:
    """The tables of a TOML file, with its name if it gives none; ``noun`` is its word in messages. Raises InputError if
    it can't be read."""
    try:
        tables = parsed_toml(text_of(path))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a {noun} in TOML: {error}{_hint_of_line(path, error)}") from None
    tables.setdefault("name", path.stem)
    return tables


def _hint_of_line(path: Path, error: Exception) -> str:
    """The hint on the number in the line of a TOML file that an error names; empty without such a number."""
    if not (found := re.search(r"at line (\d+)", str(error))):
        return ""
    line = text_of(path).splitlines()[int(found[1]) - 1]
    value = line.partition("=")[2].partition("#")[0].strip()
    return next(filter(None, (number_hint(each) for each in (value, *value.strip("[]").split(",")))), "")


_MOST_BYTES = 1_000_000
"""Size limit of a scenario file. A scenario with every key has 2 kB."""
_WORD = r"""(?:"[^"\n]*"|'[^'\n]*'|(?<![\w-])[\w-]++)"""
_LONG_KEY = re.compile(rf"{_WORD}(?:[ \t]*+\.[ \t]*+{_WORD}){{50}}")
"""A dotted key of more than fifty words. The time that tomllib takes grows with the square of the key's length: minutes
for 100 kB."""


def parsed_toml(text: str) -> dict[str, Any]:
    """Parse TOML text into tables, in bounded time. Raises ValueError if the text is not TOML, is too long, or is
    nested too deeply."""
    if len(text) > _MOST_BYTES:
        raise ValueError(f"it has more than {_MOST_BYTES} characters")
    if _LONG_KEY.search(text):
        raise ValueError("a dotted key has more than fifty words")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("its lists or tables are nested too deeply") from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # Python's limit for int()
        raise ValueError("an integer has thousands of digits") from None


def text_of(path: Path) -> str:
    """Text of a file, cut one byte above the size limit. Raises OSError or UnicodeDecodeError."""
    with path.open("rb") as file:
        return file.read(_MOST_BYTES + 1).decode("utf-8-sig")


def plain(value: Any) -> Any:
    """Dataclasses, mappings and tuples as the tables and lists of TOML. A key whose value is None is left out."""
    if isinstance(value, float | int | str):
        return value
    if dataclasses.is_dataclass(value):
        return plain({f.name: getattr(value, f.name) for f in dataclasses.fields(value)})
    if isinstance(value, Mapping):
        return {k: plain(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    return value


_BARE_POINT = re.compile(r"[+-]?(\d+\.|\.\d+)([eE][+-]?\d+)?")
"""Numbers that are not TOML but common elsewhere: 5. and .2"""


def parse_setting(text: str) -> tuple[str, Any]:
    """Parse ``key=value``. The value is TOML, or a string without quotes. Raises InputError if there is no ``=``, or
    the value begins like a list, a table or a string and is not valid TOML."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise InputError(f"--set {shortened(text)}: must be key=value, for example --set wall.stiffness=2e4")
    key, value = key.strip(), value.strip()
    try:
        tables = parsed_toml(f"value = {value}")
        if set(tables) != {"value"}:
            raise InputError(f"--set {shortened(text)}: must be one key and one value")
        return key, tables["value"]
    except InputError:
        raise
    except ValueError as error:
        if _BARE_POINT.fullmatch(value):
            return key, float(value)
        if value[:1] in ("[", "{", '"', "'"):
            hint = "; in TOML, write numbers with a leading digit (0.28) and strings in quotes"
            hint = next(filter(None, map(number_hint, value.strip("[]").split(","))), hint)
            raise InputError(f"--set {shortened(text)}: {error}{hint}") from None
        return key, value


@contextlib.contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to, then move that file to ``path`` and replace an existing one.

    If writing fails, ``path`` is unchanged. The temporary file is in a new folder beside ``path``, so that it can't
    overwrite a file of the user's. The folder is removed at the end. Raises InputError if the file can't be written.
    """
    try:
        with tempfile.TemporaryDirectory(prefix=".uvms-mj-", dir=path.parent) as folder:
            part = Path(folder, path.name)
            yield part
            os.replace(part, path)
    except OSError as error:
        raise InputError(f"{path}: can't write it: {error.strerror or error}") from None


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Create a folder, if it is not there, check that it is writable before anything is computed, and lock it against
    other processes that write there. The lock belongs to the process and leaves no file; of the new folders, those that
    are empty at the end are removed, so that a command that is refused leaves nothing.

    Raises InputError if the folder can't be created or written to, or if another process writes there."""
    import fcntl

    made = missing(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        place = os.open(folder, os.O_RDONLY)
    except OSError as error:
        remove_if_empty(made)
        raise InputError(f"--out {folder}: can't write there: {error.strerror}") from None
    try:
        try:
            fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"--out {folder}: another run is writing there; choose another folder") from None
        except OSError:  # the file system has no locks
            pass
        try:
            yield
        finally:  # within the lock: the folder of another run, which has not written yet, is empty too
            remove_if_empty(made)
    finally:
        os.close(place)


def missing(folder: Path) -> list[Path]:
    """The folder and its parents that do not exist yet, inner first."""
    return [path for path in (folder, *folder.parents) if not os.path.lexists(path)]


def remove_if_empty(folders: Sequence[Path]) -> None:
    """Remove folders, inner first, up to the first one that has something in it."""
    with contextlib.suppress(OSError):
        for folder in folders:
            folder.rmdir()


_parsing = threading.Lock()
"""Two threads must not parse at once: CPython 3.11 counts the depth of both in one place, and raises SystemError."""


class SourceChanged(OSError):
    """A function's file has another text than what was loaded."""


def function_tree(function: types.FunctionType) -> tuple[ast.stmt, list[str]]:
    """The tree of a function's source, and its lines, without the indentation of the first one; of a lambda, the tree
    of the function with its value.

    Raises OSError if the source is in no file, or is not the function's any more; and SyntaxError if it can't stand
    alone. The lines are found by their numbers in the code; ``inspect.getsource`` reads every token, which takes twenty
    times as long, and is asked if the code doesn't have a number for the last line.
    """
    code = function.__code__
    linecache.checkcache(code.co_filename)
    text = linecache.getlines(code.co_filename, function.__globals__)
    ours = function.__module__.startswith(f"{__package__}.")  # nobody edits it while it runs
    if text and not ours and code not in _codes("".join(text)):
        raise SourceChanged(f"{code.co_filename} has changed since it was loaded")
    lines = text[code.co_firstlineno - 1 :]
    if code.co_name == "<lambda>" and (tree := _lambda_tree(code, parsed("".join(text)))) is not None:
        return tree, [line.rstrip() for line in lines]
    end = max((last or 0 for _, last, _, _ in code.co_positions()), default=0) - code.co_firstlineno + 1
    while end < len(lines) and (not lines[end].strip() or _margin(lines[end]) > _margin(lines[0])):
        end += 1  # statements without effect are not in the code
    try:
        source = textwrap.dedent("".join(lines[:end]))
        return parsed(source).body[0], source.splitlines()
    except (SyntaxError, IndexError):
        source = textwrap.dedent(inspect.getsource(function))
        return parsed(source).body[0], source.splitlines()


def _lambda_tree(code: types.CodeType, module: ast.Module) -> ast.FunctionDef | None:
    """The tree of a lambda in a file, as a function's; None if it can't be told from others."""
    places = [(line, start) for line, _, start, _ in code.co_positions() if line and start]
    found = [each for each in ast.walk(module) if isinstance(each, ast.Lambda) and places]
    found = [each for each in found if all(_is_at(each.body, *place) for place in places)]
    if len(found) != 1 or found[0].lineno != code.co_firstlineno:
        return None
    tree = parsed("def function(): pass").body[0]
    assert isinstance(tree, ast.FunctionDef)
    tree.name, tree.args = "<lambda>", found[0].args
    tree.body = [ast.copy_location(ast.Return(found[0].body), found[0].body)]
    ast.copy_location(tree, found[0])
    return ast.increment_lineno(tree, 1 - code.co_firstlineno)


def _is_at(node: ast.expr, line: int, column: int) -> bool:
    assert node.end_lineno is not None
    assert node.end_col_offset is not None
    return (node.lineno, node.col_offset) <= (line, column) < (node.end_lineno, node.end_col_offset)


@functools.lru_cache(100)
def _codes(text: str) -> frozenset[types.CodeType]:
    """The code of all functions of a source."""
    with _parsing, warnings.catch_warnings(action="ignore"):
        todo, found = [compile(text, "", "exec", dont_inherit=True)], set[types.CodeType]()
    while todo:
        found.add(code := todo.pop())
        todo += [each for each in code.co_consts if isinstance(each, types.CodeType)]
    return frozenset(found)


def _margin(line: str) -> int:
    return len(line) - len(line.lstrip())


def parsed(source: str | bytes) -> ast.Module:
    """The tree of Python source. Raises SyntaxError."""
    with _parsing:
        return ast.parse(source)
