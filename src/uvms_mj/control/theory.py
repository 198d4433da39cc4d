"""The theory of a run's law: its rest, its warnings and its certificate, as the law's methods give them.

A class that defines its own law does not inherit the theory of another one. If a method of a user's law fails, one
sentence reports it, and the run goes on without that part of the theory.
"""

import math
import traceback
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files import shortened
from .base import Controller
from .rest import NoClosedForm, SteadyState

if TYPE_CHECKING:
    from .certificate import Certificate

_SIZES = {"position": 3, "quat": 4, "s": 6, "tau": 6}


class TheoryWarning(UserWarning):
    """The closed form of a user's law can't be used."""


class _TheoryError(Exception):
    """A user's theory failed. The message is a sentence for the user."""


def steady_state(setup: Any) -> SteadyState | NoClosedForm:
    """The steady state that a run's law predicts, or the reason why it has no closed form.

    Args:
        setup: the run's :class:`uvms_mj.analysis.setup.Setup`.
    """
    controller = setup.scenario.controller
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            found = _ask(controller, "at_rest", setup)
        return NoClosedForm(found) if isinstance(found, str) else _checked(found, controller)
    except (ArithmeticError, np.linalg.LinAlgError) as error:  # of a shipped law with extreme numbers
        return NoClosedForm(f"the static balance has no finite result: {error}")
    except _TheoryError as error:
        warnings.warn(f"{error}; the run has no closed form", TheoryWarning, stacklevel=2)
        return NoClosedForm(str(error))


def law_notes(setup: Any) -> list[str]:
    """The warnings that a run's law gives before the first step."""
    controller = setup.scenario.controller
    try:
        found = _ask(controller, "notes", setup)
    except _TheoryError as error:
        return [str(error)]
    if any(not isinstance(note, str) for note in found):
        return [f"{controller.label()}.notes must give warnings as texts, not {shortened(found)}"]
    return found


def certificate(setup: Any) -> "Certificate | None":
    """The certificate of a run's law, or None if it has none.

    Raises:
        InputError: a gain is too large or too small to compute with.
    """
    return _ask(setup.scenario.controller, "certificate", setup)


def _ask(controller: Controller, name: str, setup: Any) -> Any:
    """The result of a method of a law's theory, with notes as a list. Raises _TheoryError if a user's method fails."""
    owner: Any = next(cls for cls in type(controller).__mro__ if name in vars(cls))
    of_this_law = (
        controller.law is owner.law and controller.uses_truth == owner.uses_truth and controller.states == owner.states
    )
    try:
        found = getattr(controller, name)(setup) if of_this_law else getattr(Controller, name)(controller, setup)
        return ([found] if isinstance(found, str) else list(found)) if name == "notes" else found
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a user's method may raise anything, also SystemExit
        if owner.__module__.startswith(f"{__package__}."):
            raise
        lines = [f"{Path(f.filename).name}, line {f.lineno}" for f in traceback.extract_tb(error.__traceback__)[1:]]
        where = f"{lines[0]}: " if lines else ""
        raise _TheoryError(f"{controller.label()}.{name} failed: {where}{type(error).__name__}: {error}") from None


def _checked(found: Any, controller: Controller) -> SteadyState | NoClosedForm:
    """A user's result with its numbers as floats. Raises _TheoryError if it is not a valid one."""
    if isinstance(found, NoClosedForm):
        return found
    state = found if isinstance(found, SteadyState) else SteadyState(found)
    try:
        given = {name: getattr(state, name) for name in _SIZES}
        arrays = {name: np.array(value, float) for name, value in given.items() if value is not None}
        valid = not isinstance(state.force, bool) and 0.0 <= float(state.force) < math.inf
        if not valid or any(a.shape != (_SIZES[n],) or not np.isfinite(a).all() for n, a in arrays.items()):
            raise ValueError
        return SteadyState(float(state.force), **arrays)
    except (TypeError, ValueError, OverflowError):
        raise _TheoryError(
            f"{controller.label()}.at_rest returned {shortened(found)}: it must return the pushing force [N], zero or "
            "positive, a SteadyState of finite numbers, or a text with the reason why there is no closed form"
        ) from None
