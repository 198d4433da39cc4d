"""The contract of a control law: gains, states, one function.

A controller is a frozen dataclass of gains that derives from :class:`Controller`, with a static method ``law``::

    @dataclass(frozen=True)
    class Pid(Controller):
        "PID about the reference."
        k_i: float = gain(20.0, "N/(m s)", "integral gain")
        states = {"xi": 6}

        @staticmethod
        def law(gains, state, signals, state_dot, tau_cmd):
            for i in range(6):
                state_dot.xi[i] = signals.eta_e[i]
                tau_cmd[i] = signals.tau_nom[i] - gains.k_i * state.xi[i]

``signals`` has the fields of :data:`uvms_mj.stages.signals.GIVEN`. At a control instant tau_cmd is computed from the
current states; then the states advance by explicit Euler over the control period with ``state_dot``, and tau_cmd is
held until the next instant. The function is compiled; if numba cannot compile it, it runs as plain Python.
"""

from __future__ import annotations  # so that help(Controller) shows short type names

import dataclasses
import functools
import sys
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, get_type_hints

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    TypeAdapter,
    ValidationError,
    with_config,
)
from typing_extensions import TypedDict

from ..errors import Fault, InputError, faults_of
from ..quantities import NonNegative, Positive, Real, Step, Vector6

if TYPE_CHECKING:
    from .certificate import Certificate
    from .rest import SteadyState


def _six(value: Any) -> Any:
    return (value,) * 6 if isinstance(value, int | float) and not isinstance(value, bool) else value


Diagonal = Annotated[Vector6, BeforeValidator(_six)]
"""A diagonal matrix: one number for all six axes, or six numbers."""


def _nonzero(value: tuple[float, ...]) -> tuple[float, ...]:
    if 0.0 in value:
        raise ValueError("must not have a zero: F_2 has to be invertible")
    return value


def _not_positive(value: tuple[float, ...]) -> tuple[float, ...]:
    if max(value) > 0.0:
        raise ValueError("must not have a positive entry: A is negative semi-definite (eq. 8)")
    return value


_NonzeroDiagonal = Annotated[Diagonal, AfterValidator(_nonzero)]
_NegativeDiagonal = Annotated[Diagonal, AfterValidator(_not_positive)]


def gain(default: Any, unit: str, meaning: str) -> Any:
    """A dataclass field for a gain, with its default value, unit and meaning."""
    return dataclasses.field(default=default, metadata={"unit": unit, "meaning": meaning})


def _shared(default: Any, unit: str, meaning: str) -> Any:
    return dataclasses.field(default=default, kw_only=True, metadata={"unit": unit, "meaning": meaning})


@dataclasses.dataclass(frozen=True)
class Controller:
    """Base class of all controllers. It has the control period and the gains of s, which every run records.

    Raises:
        InputError: a gain has the wrong type or is out of range; all errors are reported together.
    """

    period: Step | None = _shared(None, "s", "control period, a multiple of the time step; default: every step")
    F_1: Diagonal = _shared(1.0, "1/s", "gain of the pose error in s, eq. (14)")
    F_2: _NonzeroDiagonal = _shared(1.0, "1", "gain of zeta in s, eq. (14)")
    A: _NegativeDiagonal = _shared(-100.0, "1/s", "pole of zeta, eq. (15)")

    integral: bool = _shared(False, "-", "true: s is M_d^-1 times the integral of eq. (6): A is 0, and s(0) is 0")

    name: ClassVar[str] = ""
    states: ClassVar[Mapping[str, int]] = {}
    units: ClassVar[Mapping[str, str]] = {}
    """Units of the states, for logs and plots. A state with two units has the linear one first."""
    uses_truth: ClassVar[bool] = False
    """Whether signals also has :data:`uvms_mj.stages.signals.TRUTH`. Only the yardstick, Ideal, may set this."""

    def __post_init__(self) -> None:
        given = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        place = f"the gains of {self.label()}"
        try:
            kind: Any = type(self)  # mypy does not see that the class is hashable
            valid = _adapter(kind).validate_python(given)
        except ValidationError as error:
            raise InputError(faults_of(error, "controller"), place) from None
        except Exception as error:  # pydantic and evaluating an annotation raise exceptions of many types
            reason = " ".join(str(error).split("\n\n")[0].split()) or type(error).__name__
            raise InputError(f"an annotation is not a valid type of a gain: {reason}", place) from None
        faults = [
            Fault(f"controller.{name}", f"{value!r}: a gain is a number, true or false, or a tuple of numbers")
            for name, value in valid.items()
            if not _is_gain(value)
        ]
        if faults:
            raise InputError(faults, place)
        for name, value in valid.items():
            object.__setattr__(self, name, value)
        if self.integral:  # with A = 0, eq. (20) integrates the impedance's residual
            if any(self.A) and _six(type(self).A) != self.A:
                fault = Fault("controller.A", f"{list(self.A)!r} must be 0 or omitted if integral is true")
                raise InputError([fault], place)
            object.__setattr__(self, "A", (0.0,) * 6)

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        """Set tau_cmd (6,) and state_dot from gains, state and signals."""
        raise NotImplementedError

    def at_rest(self, setup: Any) -> float | str | SteadyState:
        """Theory of the law: the vehicle at rest at the end of the run. A law may override it.

        Args:
            setup: the run's :class:`uvms_mj.analysis.setup.Setup`: scenario, vehicle, design, task, gravity_W.

        Returns:
            The pushing force on the wall [N], the whole state, or a text with the reason why there is no closed form.
        """
        return "no closed form is known for this law"

    def notes(self, setup: Any) -> Iterable[str]:
        """Theory of the law: warnings for a run with these settings, given before the first step. A law may override
        it."""
        return ()

    def certificate(self, setup: Any) -> Certificate | None:
        """Theory of the law: the rate of disturbance that the gains certainly reject, or None. A law may override
        it."""
        return None

    @classmethod
    def label(cls) -> str:
        """The name in logs and tables: ``name`` if the class sets it, otherwise the class's own name."""
        return cls.__dict__.get("name") or cls.__name__

    @classmethod
    def source(cls) -> str:
        """Where to load this class from: the name of a built-in law, or ``path/to/file.py:ClassName``."""
        if cls.__dict__.get("name") and cls.__module__.startswith(f"{__package__}."):
            return cls.name
        return f"{getattr(sys.modules.get(cls.__module__), '__file__', None) or '<session>'}:{cls.__name__}"

    @classmethod
    def gain_fields(cls) -> tuple[dataclasses.Field, ...]:
        """The fields of the gains: the class's own first, then those of :class:`Controller`."""
        shared = {f.name for f in dataclasses.fields(Controller)}
        own = [f for f in dataclasses.fields(cls) if f.name not in shared]
        return (*own, *(f for f in dataclasses.fields(cls) if f.name in shared))

    def record(self) -> np.ndarray:
        """The gains as a record array (1,): numbers as float64, flags as booleans, tuples as float64 vectors. The
        period and gains that are None are left out."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        kept = {name: np.asarray(value) for name, value in values.items() if value is not None and name != "period"}
        kinds = [(name, "?" if a.dtype == bool else "f8", a.shape) for name, a in kept.items()]
        record = np.zeros(1, np.dtype(kinds, align=True))  # never empty: every class has F_1, F_2 and A
        for name, array in kept.items():
            record[name] = array
        return record

    @classmethod
    def state_record(cls) -> np.ndarray:
        """The states, all zero, as a record array (1,) of float64 vectors."""
        fields = [(name, "f8", (size,)) for name, size in cls.states.items()]
        return np.zeros(1, np.dtype(fields or [("none", "f8", (0,))], align=True))


def _is_gain(value: Any) -> bool:
    if isinstance(value, tuple):
        return bool(value) and all(isinstance(each, int | float) for each in value)
    return value is None or isinstance(value, bool | int | float)


@functools.cache
def _adapter(cls: type[Controller]) -> TypeAdapter:
    """The validator of a class, made once. Gains are checked at construction and never in the loop."""
    hints = get_type_hints(cls, include_extras=True)
    # Any: the fields of this type are known only at run time
    make: Any = TypedDict
    shape = make("shape", {f.name: hints[f.name] for f in dataclasses.fields(cls)})
    return TypeAdapter(with_config(ConfigDict(allow_inf_nan=False))(shape))


__all__ = ["Controller", "Diagonal", "NonNegative", "Positive", "Real", "gain"]
