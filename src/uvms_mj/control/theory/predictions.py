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

from ...errors import InputError, error_text, shortened
from ...stages.base import Stage
from ...stages.contract import base_of
from ...stages.setup import SetupLike
from ..base import Controller, NoClosedForm, SteadyState
from .own_effects import NotKnownAtRest
from .terms import Balance, ThrustMap

if TYPE_CHECKING:
    from .certificate import Certificate

_SIZES = {"position": 3, "quat": 4, "s": 6, "tau": 6}


_NOT_FOLLOWED = (
    "with [[walls]], contact bodies or a bumper a rest counts if the motion from the start reaches it, "
    "which control.theory.balance.static_balance finds out"
)


class TheoryWarning(UserWarning):
    """The closed form of a user's law can't be used."""


class _TheoryError(InputError):
    """A user's theory failed. The message is a sentence for the user."""


def steady_state(setup: SetupLike) -> SteadyState | NoClosedForm:
    """The steady state that a run's law predicts, or the reason why it has no closed form."""
    controller = setup.scenario.controller
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            found = _ask(controller, "at_rest", setup)
        if isinstance(found, str):
            return NoClosedForm(found)
        state = _checked(found, controller)
        if setup.contacts.springs and not getattr(found, "reached", False):
            return found if isinstance(found, NoClosedForm) else NoClosedForm(_NOT_FOLLOWED)
        weak = "" if controller.is_shipped or isinstance(state, NoClosedForm) else _weak(setup, state.force)
        return NoClosedForm(weak) if weak else state
    except NotKnownAtRest as reason:
        return NoClosedForm(str(reason))
    except (ArithmeticError, np.linalg.LinAlgError) as error:  # of a shipped law with extreme numbers
        return NoClosedForm(f"the static balance has no finite result: {error}")
    except _TheoryError as error:
        warnings.warn(f"{error}; the run has no closed form", TheoryWarning, stacklevel=2)
        return NoClosedForm(str(error))


def stage_notes(stage: Stage, setup: SetupLike) -> list[str]:
    """The warnings that the law or the guidance of a run gives before the first step."""
    try:
        found = _ask(stage, "notes", setup)
    except _TheoryError as error:
        return [str(error)]
    if any(not isinstance(note, str) for note in found):
        return [f"{stage.label()}.notes must give warnings as texts, not {shortened(found)}"]
    return found


def certificate(setup: SetupLike) -> "Certificate | None":
    """The certificate of a run's law, or None if it has none. Raises InputError if a gain is too large or too small to
    compute with, or the method of a user's law fails."""
    controller = setup.scenario.controller
    found = _ask(controller, "certificate", setup)
    if found is None:
        return None
    from .certificate import Certificate

    if not isinstance(found, Certificate):
        raise InputError(f"{controller.label()}.certificate must return a Certificate or None, not {shortened(found)}")
    return found


def _ask(stage: Stage, name: str, setup: SetupLike) -> Any:
    """The result of a method of a stage's theory, notes as a list. Raises _TheoryError if a user's method fails."""
    kind = type(stage)
    owner: Any = next(cls for cls in kind.__mro__ if name in vars(cls))
    if kind.function() is not owner.function() or kind.given() != owner.given() or kind.states != owner.states:
        owner = base_of(kind)
    try:
        found = getattr(owner, name)(stage, setup)
        return ([found] if isinstance(found, str) else list(found)) if name == "notes" else found
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a user's method may raise anything, also SystemExit
        if owner.__module__.startswith(f"{__name__.partition('.')[0]}."):
            raise
        lines = [f"{Path(f.filename).name}, line {f.lineno}" for f in traceback.extract_tb(error.__traceback__)[1:]]
        where = f"{lines[0]}: " if lines else ""
        raise _TheoryError(f"{stage.label()}.{name} failed: {where}{error_text(error)}") from None


def _weak(setup: SetupLike, force: float) -> str:
    """The reason why the thrusters can't hold the force at rest that a user's law predicts for a plain scenario; empty
    if they can, or the scenario is another one."""
    thrust_map = ThrustMap.of(setup) if not setup.no_simple_form else ""
    if isinstance(thrust_map, str):
        return thrust_map
    balance = Balance(setup, 0.0, thrust_map)
    d, g_eta = balance.environment(balance.pose(balance.p_d, balance.quat_d))
    return thrust_map.infeasible(g_eta - d + force * setup.design.normal)


def _checked(found: Any, controller: Controller) -> SteadyState | NoClosedForm:
    """A user's result with its numbers as floats. Raises _TheoryError if it is not a valid one."""
    if isinstance(found, NoClosedForm):
        return found
    state = found if isinstance(found, SteadyState) else SteadyState(found)
    try:
        given = {name: getattr(state, name) for name in _SIZES}
        arrays: dict[str, Any] = {name: np.array(value, float) for name, value in given.items() if value is not None}
        valid = not isinstance(state.force, bool) and 0.0 <= float(state.force) < math.inf
        if not valid or any(a.shape != (_SIZES[n],) or not np.isfinite(a).all() for n, a in arrays.items()):
            raise ValueError
        return SteadyState(float(state.force), **arrays)
    except (TypeError, ValueError, OverflowError):
        raise _TheoryError(
            f"{controller.label()}.at_rest returned {shortened(found)}: it must return the pushing force [N], zero or "
            "positive, a SteadyState of finite numbers, or a text with the reason why there is no closed form"
        ) from None
