"""The contract of a control law: gains, states, one function.

A controller is a stage (:mod:`uvms_mj.stages.base`) with gains as settings and ``law`` as its static method::

        @staticmethod
        def law(gains, state, signals, state_dot, tau_cmd):
            for i in range(6):
                state_dot.xi[i] = signals.eta_e[i]
                tau_cmd[i] = signals.tau_nom[i] - gains.k_i * state.xi[i]

``signals`` has the fields of :data:`uvms_mj.stages.signals.GIVEN`.
The computation delay of a law is a stage behind it. :class:`External` is given its command by the caller, and
:class:`Udp` by another process, which answers over UDP in lockstep.
"""

from __future__ import annotations  # so that help(Controller) shows short type names

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NoReturn

import numpy as np
from pydantic import Field

from ..errors import Fault
from ..quantities import Number, Step, Vector6, refusing, repeated, within
from ..stages.base import Room, Stage, setting, shared
from ..stages.setup import ScenarioLike, SetupLike
from ..stages.signals import CLOCK, GIVEN, TASK_GIVEN, TRUTH, WRENCH_COMMAND, Signal

if TYPE_CHECKING:
    from .theory.certificate import Certificate


Diagonal = Annotated[Vector6, repeated(6)]
"""A diagonal matrix: one number for all six axes, or six numbers."""
NonNegativeDiagonal = Annotated[Diagonal, refusing(lambda x: min(x) < 0.0, "must not have a negative entry")]
PositiveDiagonal = Annotated[Diagonal, refusing(lambda x: min(x) < 1e-12, "must not have a zero or negative entry")]

gain = setting


@dataclasses.dataclass(frozen=True, eq=False)
class SteadyState:
    """A vehicle at rest. A theory that predicts the force alone leaves out the rest.

    Attributes:
        force: pushing force on the wall [N], zero if the vehicle rests short of it.
        position: (3,) position of B's origin in W [m].
        quat: (4,) attitude.
        s: (6,) sliding variable.
        tau: (6,) wrench of the thrusters in B [N, N m].
        reached: whether the motion from the start comes to this rest, and stays (:mod:`.theory.balance`).
        contacts: all contacts about the rest (:class:`.theory.contacts_about_rest.ContactsAtRest`), where shapes are in
            the way.
    """

    force: float
    position: np.ndarray | None = None
    quat: np.ndarray | None = None
    s: np.ndarray | None = None
    tau: np.ndarray | None = None
    reached: bool = dataclasses.field(default=False, kw_only=True)
    contacts: Any = dataclasses.field(default=None, kw_only=True, repr=False)


@dataclasses.dataclass(frozen=True)
class NoClosedForm:
    """The reason why a scenario has no steady state in closed form."""

    reason: str

    @property
    def force(self) -> NoReturn:
        """Raises AttributeError, which gives the reason."""
        raise AttributeError(f"no closed form: {self.reason}")


@dataclasses.dataclass(frozen=True)
class Controller(Stage):
    """Base class of all controllers.

    Raises:
        InputError: a gain has the wrong type or is out of range; all errors are reported together.
    """

    period: Step | None = shared(None, "s", "control period, a multiple of the time step; default: every step")
    delay: Annotated[Number, within(0.0, 10.0, "s")] | None = shared(
        None, "s", "computation delay, a multiple of the time step: the command of t_k acts from t_k + delay on"
    )

    room: ClassVar[Room] = Room(
        name="control",
        table="controller",
        given=lambda thrusters: GIVEN,
        out=(WRENCH_COMMAND,),
        noun="law",
        setting="gain",
        method="law",
        arguments=("gains", "state", "signals", "state_dot", "tau_cmd"),
        theory=("at_rest", "notes", "certificate"),
    )
    uses_task: ClassVar[bool] = True
    """Whether signals has :data:`uvms_mj.stages.signals.TASK`. If False, the impedance task does not run, and s, zeta
    and tau_nom are not recorded."""
    uses_truth: ClassVar[bool] = False
    """Whether signals also has :data:`uvms_mj.stages.signals.TRUTH`. Only the yardstick, Ideal, may set this."""

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        """Set tau_cmd (6,) and state_dot from gains, state and signals."""
        raise NotImplementedError

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        return {**super().constants(setup), "delay": None}  # not the law's

    def at_rest(self, setup: SetupLike) -> float | str | SteadyState:
        """Theory of the law: the vehicle at rest at the end of the run. A law may override it.

        It gives the pushing force on the wall [N], the whole state, or a text with the reason why there is no closed
        form, from the run's :class:`uvms_mj.setup.base.Setup`: scenario, vehicle, design, task, gravity_W.
        """
        return "no closed form is known for this law"

    def notes(self, setup: SetupLike) -> Iterable[str]:
        """Theory of the law: warnings for a run with these settings, given before the first step. A law may override
        it."""
        return ()

    def certificate(self, setup: SetupLike) -> Certificate | None:
        """Theory of the law: the rate of disturbance that the gains certainly reject, or None. A law may override
        it."""
        return None

    @classmethod
    def given(cls, thrusters: int = 0) -> tuple[Signal, ...]:
        return (GIVEN if cls.uses_task else TASK_GIVEN) + (TRUTH if cls.uses_truth else ())


@dataclasses.dataclass(frozen=True)
class External(Controller):
    """A wrench from outside: the caller of a Simulation sets tau_cmd."""

    name = "external"
    external: ClassVar[bool] = True
    by_caller: ClassVar[str] = "tau_cmd"
    uses_task: ClassVar[bool] = False

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        pass


@dataclasses.dataclass(frozen=True)
class NoLaw(Controller):
    """No command, of a body without thrusters that others carry."""

    name = "none"
    uses_task: ClassVar[bool] = False

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = 0.0

    def at_rest(self, setup: SetupLike) -> str:
        return "there is no law"


MOST_WAITING = 1000
"""Control periods that a computation delay may last."""


@dataclass(frozen=True)
class Delay(Stage):
    """The computation delay: the command of the law's instant t_k reaches the actuation at t_k + controller.delay.
    Before the first one it is zero."""

    name = "delay"
    memory: ClassVar = {"queue": (MOST_WAITING + 1, 6)}
    room: ClassVar[Room] = Room("control", "delay", lambda thrusters: (*CLOCK, WRENCH_COMMAND), (WRENCH_COMMAND,))

    @staticmethod
    def steps(scenario: ScenarioLike) -> tuple[int, int, int]:
        """Time steps of the control period, of the delay, and of their greatest common divisor, the stage's period."""
        h = scenario.simulation.timestep
        period, delay = round(scenario.control_period / h), round(scenario.controller.delay / h)
        return period, delay, math.gcd(period, delay)

    def period_in(self, scenario: ScenarioLike) -> float:
        """The greatest common divisor of the control period and the delay [s]."""
        return self.steps(scenario)[2] * scenario.simulation.timestep

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """The control period and the delay in periods of the stage."""
        period, delay, own = self.steps(setup.scenario)
        return {"control": period / own, "delay": delay / own}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        control, delay = int(settings.control), int(settings.delay)
        if given.instant % control == 0:
            state.queue[given.instant // control % (MOST_WAITING + 1)] = given.tau_cmd
        if given.instant < delay:
            out[:] = 0.0
        else:
            out[:] = state.queue[(given.instant - delay) // control % (MOST_WAITING + 1)]


def delay_faults(scenario: ScenarioLike) -> Iterator[Fault]:
    """Errors in the computation delay: it is a multiple of the time step, and not too many control periods long."""
    h, delay = scenario.simulation.timestep, scenario.controller.delay
    if delay is None:
        return
    if abs(delay / h - round(delay / h)) > 1e-6:
        n = int(delay / h)
        nearest = f"the nearest are {n * h:g} and {(n + 1) * h:g} s"
        yield Fault("controller.delay", f"{delay:g} s is not a multiple of the time step {h:g} s; {nearest}")
    elif delay > MOST_WAITING * scenario.control_period * (1.0 + 1e-9):
        longest = f"{MOST_WAITING} control periods of {scenario.control_period:g} s"
        yield Fault(
            "controller.delay", f"{delay:g} s must be at most {MOST_WAITING * scenario.control_period:g} s, {longest}"
        )


PORT = 9100


@dataclass(frozen=True)
class Udp(Controller):
    """A law of another process: it is given the signals of each instant, and answers with tau_cmd, in lockstep."""

    port: Annotated[int, Field(strict=True, ge=1, le=65535)] = gain(PORT, "1", "UDP port of the law")
    timeout: Annotated[Number, within(0.01, 3600.0, "s")] = gain(10.0, "s", "longest wall time without an answer")

    export: Annotated[int, Field(strict=True, ge=0, lt=2**48)] = gain(
        0, "1", "number of the export that answers, from its README; 0: any law"
    )
    host: Annotated[str, Field(min_length=1, max_length=253)] = gain(
        "127.0.0.1", "1", "name or IPv4 address of the law's machine"
    )

    name = "udp"
    external: ClassVar[bool] = True
    by_caller: ClassVar[str] = "tau_cmd"

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """None: the function has nothing to compute."""
        return {}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        pass

    def at_rest(self, setup: SetupLike) -> str:
        return "the law runs in another process"
