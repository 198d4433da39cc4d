"""Loading of controllers: a built-in class by its name, or a user's class from a file."""

import dataclasses
import hashlib
import importlib.util
import os
import sys
import traceback
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from ..errors import Fault, InputError, suggestion
from .base import Controller
from .contract import check_contract
from .fosm import Fosm
from .gsta import Gsta
from .ideal import Ideal
from .impedance import Impedance
from .sta import Sta

BUILT_IN: dict[str, type[Controller]] = {cls.name: cls for cls in (Impedance, Fosm, Gsta, Sta, Ideal)}


def load_controller(table: Mapping[str, Any], known: type[Controller] | None = None) -> Controller:
    """Make the controller of a ``[controller]`` table.

    Args:
        table: ``name`` is a built-in law or ``path/to/file.py:ClassName`` (default gsta); every other key is a gain.
        known: a class to use without loading it, if ``name`` is its source.

    Raises:
        InputError: the law is not found, or a gain is unknown, missing or out of range; names every such gain.
    """
    gains = dict(table)
    source = gains.pop("name", Gsta.name)
    cls = known if known is not None and source == known.source() else controller_class(source)
    choices = [f.name for f in cls.gain_fields()]
    faults = [
        Fault(f"controller.{key}", f"{cls.label()} has no such gain; {suggestion(key, choices)}")
        for key in gains
        if key not in choices
    ]
    missing = [
        f.name
        for f in cls.gain_fields()
        if f.name not in gains and f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
    ]
    if missing:
        raise InputError([*faults, *(Fault(f"controller.{key}", f"{cls.label()} needs this gain") for key in missing)])
    try:
        controller = cls(**{key: value for key, value in gains.items() if key in choices})
    except InputError as error:
        raise InputError([*faults, *error.faults]) from None
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a user's __post_init__ may raise anything, also SystemExit
        raise InputError([*faults, Fault("controller", f"{cls.label()}: {type(error).__name__}: {error}")]) from error
    if faults:
        raise InputError(faults)
    return controller


def controller_class(source: Any) -> type[Controller]:
    """The controller class of a built-in name or of ``path/to/file.py:ClassName``.

    Raises:
        InputError: there is no such class, or it is not a valid controller.
    """
    if not isinstance(source, str):
        raise InputError([Fault("controller.name", f"{source!r} is not the name of a law; {_known()}")])
    if source in BUILT_IN:
        return BUILT_IN[source]
    file, colon, class_name = source.rpartition(":")
    if not colon or not file.endswith(".py"):
        hint = suggestion(source, BUILT_IN)
        raise InputError(
            [Fault("controller.name", f"no law {source!r}; {hint}; for your own law give path/to/file.py:ClassName")]
        )
    path = Path(file)
    if not path.is_file():
        raise InputError([Fault("controller.name", f"no file {file!r} (looked in {Path.cwd()})")])
    module = _load(path.absolute())
    laws = {
        name: value
        for name, value in vars(module).items()
        if isinstance(value, type) and issubclass(value, Controller) and value is not Controller
    }
    if class_name not in laws:
        there = f"its laws are {', '.join(sorted(laws))}" if laws else "it has no class derived from Controller"
        raise InputError([Fault("controller.name", f"no law {class_name!r} in {file}; {there}")])
    cls = laws[class_name]
    check_contract(cls, file)
    return cls


def has_built_in_law(controller: Controller) -> bool:
    """Whether a controller has the law, states and signals of a built-in class. A derived class may differ in its
    gains only."""
    return any(
        isinstance(controller, cls)
        and type(controller).law is cls.law
        and controller.uses_truth == cls.uses_truth
        and controller.states == cls.states
        for cls in BUILT_IN.values()
    )


def _known() -> str:
    return f"choose from {', '.join(BUILT_IN)}"


def _load(path: Path) -> ModuleType:
    """Import a user's file anew, with its folder on sys.path for the file's imports."""
    name = f"uvms_mj_law_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None  # the suffix is .py
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look up their module there
    if str(path.parent) not in sys.path:
        sys.path.insert(0, str(path.parent))
    # Python's byte-code cache misses the second of two edits within a second
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    # functions that numba compiles during the import, e.g. by numba.guvectorize, must check their indices
    bounds, os.environ["NUMBA_BOUNDSCHECK"] = os.environ.get("NUMBA_BOUNDSCHECK"), "1"
    try:
        spec.loader.exec_module(module)
    except BaseException as error:  # the file may raise anything, also SystemExit
        del sys.modules[name]
        if isinstance(error, KeyboardInterrupt):
            raise
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        line = frames[-1].lineno if frames else getattr(error, "lineno", None)
        where = f"{path.name}, line {line}" if line else path.name
        raise InputError([Fault("controller.name", f"{where}: {type(error).__name__}: {error}")]) from error
    finally:
        sys.dont_write_bytecode = before
        del os.environ["NUMBA_BOUNDSCHECK"]
        if bounds is not None:
            os.environ["NUMBA_BOUNDSCHECK"] = bounds
    return module


def table_of(controller: Controller) -> dict[str, Any]:
    """The ``[controller]`` table from which :func:`load_controller` makes an equal controller."""
    return {
        "name": controller.source(),
        **{f.name: getattr(controller, f.name) for f in dataclasses.fields(controller)},
    }
