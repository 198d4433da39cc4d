"""The source files that a user's stage is made of."""

import ast
import sys
import sysconfig
import types
from importlib.util import find_spec
from pathlib import Path

from ...files import parsed

_PACKAGE = Path(__file__).parents[2]
_FOREIGN = tuple(Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib"))


def source_files(module: types.ModuleType) -> list[Path]:
    """Files of a module and of its direct and indirect imports, except installed packages and the standard library; of
    a stage in C or a library, its file.

    Imports are read from the source, because a constant imported from another file leaves no trace in the module.
    """
    found: dict[Path, None] = {}
    todo = [Path(str(module.__file__)).resolve()]
    while todo:
        path = todo.pop()
        if path in found or not path.is_file() or (found and path.suffix != ".py"):
            continue
        if found and any(path.is_relative_to(folder) for folder in (*_FOREIGN, _PACKAGE)):
            continue
        found[path] = None
        if path.suffix != ".py":
            continue
        for node in ast.walk(parsed(path.read_bytes())):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            todo += [origin for name in names if (origin := _origin(name)) is not None]
    return sorted(found)


def _origin(name: str) -> Path | None:
    loaded = sys.modules.get(name)
    if loaded is not None:
        file = getattr(loaded, "__file__", None)
        return Path(file).resolve() if file else None
    try:
        spec = find_spec(name)
    except (ImportError, ValueError, AttributeError):
        return None
    return Path(spec.origin).resolve() if spec is not None and spec.origin and spec.has_location else None
