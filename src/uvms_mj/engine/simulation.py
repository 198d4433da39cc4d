"""``Simulation``: a scenario that its caller steps. ``simulate`` is built on it."""

from __future__ import annotations  # Signals is below

import dataclasses
import functools
import os
import threading
import time
import warnings
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, ClassVar, NoReturn

import numpy as np

from ..actuation.base import GREATEST_US, LEAST_US, NEUTRAL_US, Actuation, Autopilot, Pwm
from ..errors import Fault, InputError, suggestion
from ..plant.mjcf import Mjcf
from ..quantities import overrides_of
from ..scenario import Scenario
from ..setup.base import Setup
from ..setup.changes import Change, Reads, changed
from ..setup.checks import checked, warnings_of
from ..setup.world import World
from ..stages.loader import functions_again, stage_keeps
from ..stages.signals import Signal, no_signal, record_dtype
from .engines import Engine, FreeEngine, MujocoEngine
from .native.guard import end_copy, no_exit
from .native.loop import Diverged, stop_reason
from .native.memory import settle_modes, stopped
from .native.net import Net, NetWarning, Watch
from .native.plain_stage import called
from .native.record import STOP_STAGE
from .native.run_memory import RunMemory

ENGINES: dict[str, Callable[[Setup], Engine]] = {each.name: each for each in (MujocoEngine, FreeEngine)}
"""The engines by name: ``mujoco`` runs every scenario, ``free_body`` where :func:`.engines.refusals` has none."""

CHUNK_S = 0.25
"""Wall time after which a chunk ends early, for slow stages [s]."""
SLICE_STEPS = 1000
"""Largest number of steps from one reading of the clock to the next with a user's stage: it may become slow at any
step. A reading costs as much as some fifteen steps of a free vehicle."""


@dataclasses.dataclass(frozen=True, eq=False)
class Saved:
    """The state of a :class:`Simulation` at an instant, of its :meth:`~Simulation.save`."""

    of: Simulation
    setup: Setup
    numbers: Mapping[str, np.ndarray]
    engine: Any


class Simulation:
    """A scenario that is compiled and built once, and then stepped by the caller::

        with Simulation(Scenario.load("push_wall")) as sim:
            for seed in range(10):
                sim.reset({"wall.position": 1.0 + 0.01 * seed}, seed=seed)
                sim.step(1000)
                print(sim.t, sim.signals.nu)

    With ``controller.name = "external"`` the caller sets ``tau_cmd`` before a step, with ``actuation.name`` "external"
    the thrusts ``u``, and with "pwm" the pulse widths ``pwm_cmd``. Several simulations may run in threads of one
    process.

    Args:
        scenario: the scenario; default: the paper's.
        engine: "mujoco", or "free_body", which steps one free vehicle without MuJoCo, several times as fast
            (:mod:`.engines`).
        mjcf: the vehicle's model, in place of the file of ``scenario.vehicle.model``.
        looks: whether ``model`` has the looks of the vehicle and the walls, water behind them, light, and the camera
            "overview". They change no number and cost a step nothing; without them, a Simulation is made sooner.

    Attributes:
        engine: the engine's name.
        model: MuJoCo's model. InputError with the engine free_body.
        data: MuJoCo's data. ``mujoco.mj_forward`` may be called with it; only :meth:`step` takes steps. If ``qpos`` or
            ``qvel`` is changed between steps, navigation measures it from the following instant on. InputError with
            the engine free_body.
        setup: the scenario with the plant and the design matrices.

    Raises:
        InputError: the input is invalid, or the engine can't run the scenario.
    """

    _in_world: ClassVar[bool] = False
    """Whether the couplings of the vehicle are computed where it is stepped."""

    def __init__(
        self,
        scenario: Scenario | None = None,
        *,
        engine: str = "mujoco",
        mjcf: Mjcf | None = None,
        looks: bool = True,
    ) -> None:
        self.setup = checked(valid_scenario(scenario).with_fresh_stages(), mjcf, self._in_world)
        settle_modes()  # which a user's file may change by what it imports
        if looks:
            self.setup = dataclasses.replace(self.setup, plant=dataclasses.replace(self.setup.plant, looks=True))
        self._base = self.setup
        self._engine = engine_of(engine, self.setup)
        self._finalizer = weakref.finalize(self, self._engine.close)
        try:
            self._memory = self._remembered()
        except BaseException:
            self.close()
            raise
        self._stages = self._memory.stages
        self._plain = [stage for stage in self._stages.running if stage.code is None]
        self._net = Net(self._stages.running, self._stages.rows)
        self._net.begin()
        self._users = [stage for stage in self._stages.running if stage.users]
        self._foreign = [stage for stage in self._users if stage.code is None or stage.library]
        self._plain_users = [stage for stage in self._users if stage.code is None]
        # what closed forms and notes, which call the functions of the stages, leave in a file is in no run
        self._begin_plain(functions_again([type(stage.stage) for stage in self._plain_users]))
        self._slice, self._alone = 1, OneThread(self._engine)
        self._signals, self._ready = Signals(self._memory.views()), False

    def _remembered(self) -> RunMemory:
        return RunMemory(self.setup, self._engine)

    @functools.cached_property
    def _reads(self) -> Reads:
        """The parts of the first setup that functions read, as resets find them."""
        return Reads(self._base)

    @property
    def engine(self) -> str:
        return self._engine.name

    @property
    def model(self) -> Any:
        return self._engine.model

    @property
    def data(self) -> Any:
        return self._engine.data

    @property
    def motion(self) -> tuple[np.ndarray, np.ndarray]:
        """The live pose (7,) and velocity (6,) of the vehicle, as a free joint has them: the velocity in W, and the
        angular velocity in B."""
        return self._engine.qpos, self._engine.qvel

    @property
    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """:attr:`motion` with the live positions (n,) and velocities (n,) of the joints behind them."""
        return self._engine.state

    @property
    def chunk_steps(self) -> int:
        """Largest number of steps of a call of :meth:`run` with rows."""
        return self._memory.chunk_steps

    @property
    def scenario(self) -> Scenario:
        """The scenario with the overrides of the last reset."""
        return self.setup.scenario

    @property
    def signals(self) -> Signals:
        """The signals by name: a float, or a live, read-only view; copy what you keep."""
        self.prepare()
        return self._signals

    @property
    def steps(self) -> int:
        """Number of time steps done."""
        return int(self._memory.run["step"][0] + self._memory.run["pending"][0])

    @property
    def t(self) -> float:
        """Time of the instant in hand [s]."""
        return self.steps * self.scenario.simulation.timestep

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings about the scenario, computed at each call."""
        silent = (stage.silent for stage in self._stages.running)
        return (*warnings_of(self.setup), *self.slow_stages, *filter(None, silent))

    @property
    def slow_stages(self) -> tuple[str, ...]:
        """Notes on the stages that run as plain Python, and on what of them lives on from run to run."""
        kept = (note for stage in self._plain_users if (note := stage_keeps(stage.stage)))
        return (*(stage.slow for stage in self._plain), *kept)

    @property
    def recorded(self) -> tuple[Signal, ...]:
        """The signals that a run of this scenario records."""
        return tuple(signal for signal, _ in self._memory.recorded)

    @property
    def tau_cmd(self) -> np.ndarray:
        """(6,) commanded wrench [N, N m]. With the controller ``external`` the caller sets it before a step."""
        return _view(self._stages.tau_cmd, self.scenario.controller.external)

    @property
    def u(self) -> np.ndarray:
        """(n,) commanded thrusts [N]. With the actuation ``external`` the caller sets it before a step."""
        return _view(self._stages.u_cmd, self.scenario.actuation.external)

    @property
    def pwm_cmd(self) -> np.ndarray:
        """(n,) pulse widths commanded [us], from 1100 to 1900; 1500 is neutral. With the actuation ``pwm`` the caller
        sets them before a step. InputError with another actuation."""
        return self._state_of(Pwm, "pwm_cmd")

    @property
    def given(self) -> np.ndarray:
        """The record (1,) of the signals that a law is given, at the instant in hand."""
        kind = record_dtype(type(self.scenario.controller).given())  # the beginning of the record of signals
        return _view(self._stages.signals.view(np.uint8)[: kind.itemsize].view(kind), False)

    @property
    def frame(self) -> np.ndarray:
        """(1,) number of the frame of the pulse widths. With the actuation ``autopilot`` the caller sets it before a
        step. InputError with another actuation."""
        return self._state_of(Autopilot, "frame")

    def _state_of(self, kind: type[Actuation], name: str) -> np.ndarray:
        """A state of the actuation that the caller sets. Raises InputError for another kind of actuation."""
        actuation = self.scenario.actuation
        if not isinstance(actuation, kind):
            raise InputError([Fault("actuation.name", f"{actuation.label()}: {name} needs {kind.name}")])
        return _view(self._stages.stages["actuation"].state[name][0], True)

    def reset(self, overrides: Mapping[str, Any] | None = None, *, seed: int | None = None) -> None:
        """Return to the start without compiling or building anything.

        Args:
            overrides: dotted keys with values that replace the values of the scenario that the Simulation was made
                with, ``{"wall.position": 1.2, "controller.k_1": 8.0}``, until the next reset. All keys of a scenario
                are possible but ``vehicle.*``, the names of stages, the integrator, the frame of the task, and the
                keys that decide which contacts, delay or schedule there are.
            seed: replaces ``simulation.seed``.

        Raises:
            InputError: a key or value is invalid, or needs a new Simulation. The Simulation is as it was before.
        """
        given = overrides_of(overrides)
        if seed is not None:
            given["simulation.seed"] = seed
        with self._alone:
            setup, change = self._base, Change(given, self._reads)
            if given:
                setup = changed(setup, change, "reset")
            functions = functions_again([type(stage.stage) for stage in self._plain_users])
            self._memory.restart(setup, change)
            self._net.begin()
            self.setup = setup
            self._begin_plain(functions)
            self._prepare()

    def begin(self, setup: Setup) -> None:
        """Return to the start with the numbers of another setup of the same shape, also with another vehicle, until the
        next reset. An identification tries thousands of vehicles so.

        Raises:
            InputError: the engine has the vehicle in MuJoCo's model, or the setup needs a new Simulation.
        """
        if self._engine.name != FreeEngine.name:
            raise InputError([Fault("engine", f"{self._engine.name} can't change its vehicle; use {FreeEngine.name}")])
        with self._alone:
            functions = functions_again([type(stage.stage) for stage in self._plain_users])
            self._memory.begin(setup)
            self._stages.start(setup.scenario)
            self._net.begin()
            self.setup = setup
            self._begin_plain(functions)
            self._prepare()

    def _begin_plain(self, functions: Sequence[Callable]) -> None:
        """Begin a run of the users' stages that run as plain Python, with their functions."""
        for stage, function in zip(self._plain_users, functions, strict=True):
            stage.begin_plain(function, int(self._stages.rows["key"][self._stages.running.index(stage)]))

    def set(self, overrides: Mapping[str, Any]) -> None:
        """Change numbers of the scenario during the run, from the next step on, until the next reset.

        Args:
            overrides: as in :meth:`reset`, without ``initial`` and ``simulation``.

        Raises:
            InputError: a key or value is invalid, or can't change during a run. Nothing is changed then.
        """
        with self._alone:
            given = overrides_of(overrides, "set: overrides")
            setup = changed(self.setup, Change(given), "set")
            delayed = ("controller.delay", "controller.period") if self.scenario.controller.delay is not None else ()
            fixed = sorted(key for key in given if key.startswith(("initial.", "simulation.", *delayed)))
            if fixed:
                raise InputError([Fault(name, "can't change during a run; give it to reset") for name in fixed], "set")
            self._memory.rewrite(setup)
            self.setup = setup
            if self._ready:
                self._prepare()  # the water at the instant in hand

    def save(self) -> Saved:
        """The state at the instant in hand, for :meth:`restore`.

        Raises:
            InputError: a stage is plain Python, or in C, and may keep numbers that are not saved; or the run is
                recorded.
        """
        self._refuse_unsaved("save")
        with self._alone:
            self._prepare()
            return Saved(self, self.setup, self._memory.image.saved(), self._engine.saved())

    def restore(self, saved: Saved) -> None:
        """Return to the instant of a :meth:`save`, as often as wanted: the steps that follow have the same bits.

        Raises:
            InputError: ``saved`` is of another Simulation, or a reset or ``set`` has come in between.
        """
        if saved.of is not self:
            raise InputError("restore: the state was saved by another Simulation")
        if saved.setup is not self.setup:
            raise InputError("restore: since the state was saved, a reset or set has changed numbers of the run")
        self._refuse_unsaved("restore")
        with self._alone:
            self._memory.image.put_back(saved.numbers)
            self._engine.put_back(saved.engine)
            self._ready = True

    def _refuse_unsaved(self, what: str) -> None:
        if self._memory.run["row_capacity"][0]:
            raise InputError(f"{what}: the run is recorded; step a Simulation of your own")
        if self._foreign:
            names = ", ".join(called(stage.stage) for stage in self._foreign)
            raise InputError(f"{what}: {names} may keep numbers that are not saved: it is no compiled Python")

    def step(self, n: int = 1) -> None:
        """Take n time steps, at native speed and without Python's global lock.

        Raises:
            InputError: n is no number of steps, or no speed controller takes a pulse width.
            Diverged: the state or a command left its bounds. The message names it. Only reset goes on.
            StageFault: a user's stage raised or violated its contract.
            RuntimeError: mjcb_control was replaced, or somebody else has stepped ``data``.
        """
        self.refuse_step(n)
        with self._alone:
            self._run(n, np.inf)
            self._prepare()
        if (diverged := self.diverged) is not None:
            raise diverged

    def refuse_step(self, n: int) -> None:
        """Raise InputError if n is no number of steps, and for a pulse width that no speed controller takes, such as 0
        for no signal."""
        if not isinstance(n, int | np.integer) or n < 0:
            raise InputError(f"step: {n!r} is not a number of steps")
        if not isinstance(self.scenario.actuation, Pwm):
            return
        wrong = [i for i, pulse in enumerate(self.pwm_cmd.tolist()) if not LEAST_US <= pulse <= GREATEST_US]
        if wrong:
            place = f"pwm_cmd[{wrong[0]}] = {self.pwm_cmd[wrong[0]]:g} us"
            raise InputError(f"{place}: must be from {LEAST_US:g} to {GREATEST_US:g} us; {NEUTRAL_US:g} us is neutral")

    def run(self, n: int, seconds: float) -> int:
        """Take at most n steps for about so many seconds of wall time, and return how many were taken.

        Unlike :meth:`step`, it neither prepares the next instant nor raises if the run diverges: see :meth:`check` and
        :attr:`divergence`.
        """
        with self._alone:
            return self._run(n, seconds)

    def _run(self, n: int, seconds: float) -> int:
        return self._guarded(self._advance, n, seconds)

    def _guarded(self, function: Callable, *arguments: Any) -> Any:
        """Call a function by which stages run: one in foreign machine code neither ends this process without a word,
        nor goes on in a copy of it."""
        if not self._foreign:
            return function(*arguments)
        process = os.getpid()
        who = " or ".join(called(stage.stage) for stage in self._foreign)
        with no_exit(who, no_copy=any(stage.library for stage in self._foreign)):
            try:
                return function(*arguments)
            finally:
                end_copy(process)

    def _advance(self, n: int, seconds: float) -> int:
        process = os.getpid()
        run, most = self._memory.run, SLICE_STEPS if self._users else self.chunk_steps
        if not run["stop"][0]:
            self._engine.check(self.t, self.scenario.simulation.timestep)
        self._ready, done, start = False, 0, time.perf_counter()
        now, step, compared = start, self.steps, -1
        while done < n and now - start < seconds and not run["stop"][0]:
            size, begun = min(self._slice, n - done), now
            if self._net.watches:
                if step >= compared:  # the step of the next comparison, which may be this one
                    compared = step + self._net.steps_ahead(step)
                size = max(1, min(size, compared - step))
            if self._plain or step == compared:
                size = 1
                self._run_stages(len(self._stages.rows))
            self._engine.step(size)
            if self._foreign:
                end_copy(process)  # before it goes on
            if run["stop"][0] == STOP_STAGE and self._goes_on_plain():
                size, compared = self.steps - step, -1
            step, done, now = step + size, done + size, time.perf_counter()
            self._slice = max(1, min(most, int(CHUNK_S * size / max(now - begun, 1e-9))))
        return done

    @property
    def memory(self) -> RunMemory:
        """The memory of the run, which :class:`.batch.Batch` reads and steps."""
        return self._memory

    @property
    def compares(self) -> bool:
        """Whether the first instants of a user's stage are being compared with plain Python."""
        return any(watch.account.is_new for watch in self._net.watches.values())

    @property
    def all_native(self) -> bool:
        """Whether its steps are machine code without Python or MuJoCo between them."""
        return self._engine.name == FreeEngine.name and not self._plain and not isinstance(self.scenario.actuation, Pwm)

    def one_step(self) -> Callable[[], object]:
        """The function of one step, after a look at the engine: its own where no stage is a user's, which would be
        watched, or plain Python, which would wait."""
        with self._alone:
            if self._users or self._plain:
                return functools.partial(self._run, 1, np.inf)
            self._engine.check(self.t, self.scenario.simulation.timestep)
            self._ready = False
            return functools.partial(self._engine.step, 1)

    @property
    def diverged(self) -> Diverged | None:
        """The exception of a run that has left its bounds; None of any other."""
        return Diverged(f"t = {self.t:.6g} s: {self.divergence}") if self.divergence else None

    def record(self, row_steps: int) -> RunMemory:
        """Record a row every so many time steps, from the start of the run. The memory must be emptied at least once in
        :attr:`chunk_steps` steps."""
        self._memory.record(row_steps)
        return self._memory

    def finish(self) -> None:
        """Evaluate the instant in hand without a step, so that its row is complete."""
        self._guarded(self._finish)

    def _finish(self) -> None:
        if self._plain:
            self._run_stages(len(self._stages.rows))
        self._engine.evaluate()

    def prepare(self) -> None:
        """Compute measurements and reference of the instant in hand, unless it is done."""
        if not self._ready:
            with self._alone:
                self._prepare()

    def _prepare(self) -> None:
        """Run the stages before the law at the instant in hand. Raises StageFault if a stage raised or violated its
        contract."""
        self._guarded(self._run_stages, self._stages.control)
        self._ready = True
        self.check()

    def _run_stages(self, end: int) -> None:
        self._engine.sense()
        held = self._net.hold(self.steps) if self._net.watches else []
        try:
            self._run_until(end)
        finally:
            self._net.release(held)

    def _run_until(self, end: int) -> None:
        memory = self._memory
        while (waiting := memory.code["advance"].ctypes(memory.address, end)) >= 0:
            try:
                if self._stages.running[waiting].code is None:
                    self._stages.running[waiting].call_plain()
                elif not self._compare(self._net.watches[waiting]):
                    return
            except BaseException:
                self._stages.take_back(waiting)
                raise
            memory.run["next"] = waiting + 1

    def _compare(self, watch: Watch) -> bool:
        """Call a compiled stage, and compare it with plain Python. Returns False if it stops the run. Raises
        StageFault if Python does."""
        stages, run = self._stages, self._memory.run
        instant, first = int(stages.rows["instant"][watch.index]) - 1, watch.in_first_run
        code, difference = watch.compare(instant)
        if difference:
            self._distrust(watch.index, difference, surely_right_before=first, fault=not code)
            watch.give()
        elif code:
            run["stop"], run["stop_index"], run["next"] = STOP_STAGE, code, watch.index
            return False
        return True

    def _goes_on_plain(self) -> bool:
        """After a stop by a compiled stage, let Python go on where it can."""
        run = self._memory.run
        waiting, code = int(run["next"][0]), int(run["stop_index"][0])
        stage = self._stages.running[waiting]
        if not stage.compared or stopped[0] or not (why := stage.ends_alone(code)):
            return False
        self._distrust(waiting, f"machine code ended early ({why})", surely_right_before=True)
        self._stages.take_back(waiting)
        run["stop"], run["stop_index"] = 0, 0
        self._engine.go_back(self.t)
        return True

    def _distrust(self, index: int, why: str, surely_right_before: bool, fault: bool = False) -> None:
        """Let a compiled stage run as plain Python from the instant in hand on, and say so. ``fault``: it gave another
        number, and did not only end early, as at an integer of more than 64 bits."""
        stage = self._stages.running[index]
        before = "" if surely_right_before else "; what it gave before may be wrong, too: run again"
        said = f"at t = {self.t:.6g} s {why}{before}"
        warnings.warn(
            f"{called(stage.stage)} goes on as plain Python, which is slow: {said}"
            f"{'. That is a fault of uvms-mj: please report it with this file' if fault else ''}",
            NetWarning,
            stacklevel=2,
        )
        stage.distrust(said)
        self._stages.rows["code_at"][index] = 0
        self._net.watches.pop(index, None)
        for each in (self._plain, self._plain_users, self._foreign):
            each.append(stage)

    def check(self) -> None:
        """Report a failure of a user's stage.

        Raises:
            StageFault: a stage raised or violated its contract.
            KeyboardInterrupt: a signal arrived during a loop of the stage.
        """
        self._memory.check_stages()

    @property
    def divergence(self) -> str:
        """The first variable to leave its bound, as text; empty if there is none."""
        return stop_reason(self._memory.run[0])

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        raise TypeError("a Simulation can't be copied or pickled: make another one, Simulation(sim.scenario)")

    def close(self) -> None:
        """Detach the hydrodynamics. Calling it again has no effect."""
        self._finalizer()

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def valid_scenario(scenario: Scenario | None) -> Scenario:
    """The scenario, or the default one. Raises InputError if it is of another type."""
    if isinstance(scenario, World):
        raise InputError("scenario: is a world of several vehicles; use WorldSimulation(world)")
    if not isinstance(scenario, Scenario | None):
        raise InputError(f"scenario: expected a Scenario, got {scenario!r}; use Scenario.load(name or path)")
    return scenario if scenario is not None else Scenario()


def _view(array: np.ndarray, writable: bool) -> np.ndarray:
    view = array.view()
    view.flags.writeable = writable
    return view


class Signals:
    """The signals of a Simulation by name: ``signals.nu``, ``signals["nu"]``.

    A scalar is a float. A vector is a live, read-only view: copy what you keep. Between steps the state, the
    measurements, the reference, the errors and the task are of the instant in hand; tau_cmd, u, tau, nu_dot,
    f_contact_W and the running signals are of the step before it.
    """

    def __init__(self, memories: Mapping[str, np.ndarray]) -> None:
        self.__dict__["_views"] = memories

    def __getitem__(self, name: str) -> Any:  # an array or a float
        try:
            return _value(self._views[name])
        except KeyError:
            raise KeyError(no_signal(name, self._views)) from None

    def __getattr__(self, name: str) -> Any:
        views = self.__dict__.get("_views", {})
        if name not in views:
            raise AttributeError(no_signal(name, views))
        return _value(views[name])

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"signals.{name} can't be assigned: signals are read-only")

    def __iter__(self) -> Iterator[str]:
        return iter(self._views)

    def __len__(self) -> int:
        return len(self._views)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._views]

    def __repr__(self) -> str:
        return f"<Signals {', '.join(self._views)}>"


def _value(view: np.ndarray) -> np.ndarray | float:
    return view if view.ndim else float(view)


class OneThread:
    """A context in which the engine is open and no other thread uses the Simulation.

    Raises:
        RuntimeError: the engine is closed, or another thread is in this context.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine, self._lock = engine, threading.RLock()

    def __enter__(self) -> None:
        if self._engine.closed:
            raise RuntimeError("the Simulation is closed; make a new one")
        if not self._lock.acquire(blocking=False):
            raise RuntimeError("another thread uses this Simulation at this moment; give each thread its own")

    def __exit__(self, *exception: object) -> None:
        self._lock.release()


def engine_of(name: str, setup: Setup) -> Engine:
    """A new engine. Raises InputError if there is none of this name, or it can't run the scenario."""
    if name not in ENGINES:
        of_many = "takes many runs at once: in a study, or as uvms_mj.Fleet; a single run takes free_body"
        hint = of_many if name == "gpu" else f"is not an engine; {suggestion(str(name), ENGINES)}"
        raise InputError(f"engine {name!r}: {hint}")
    return ENGINES[name](setup)
