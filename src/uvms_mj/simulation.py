"""``simulate(scenario) -> Trace``: chunk by chunk at native speed."""

import dataclasses
import inspect
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import mujoco
import numpy as np

from .checks import SamplingWarning, check, row_steps_of
from .closed_forms import steady_state
from .control import Controller
from .native.attachment import attach
from .native.closed_loop import ClosedLoop
from .plant import build
from .scenario import Scenario
from .signals import split_rows
from .trace import Status, Trace

CHUNK_STEPS = 1000
"""Steps from one turn of Python to the next: a few milliseconds."""


class LawError(RuntimeError):
    """A law raised. The message names the user's line; ``trace`` is what was recorded until then."""

    def __init__(self, message: str, trace: Trace) -> None:
        super().__init__(message)
        self.trace = trace


class PlainPythonWarning(UserWarning):
    """A law runs as plain Python because numba can't compile it."""


def simulate(
    scenario: Scenario | None = None,
    controller: Controller | None = None,
    *,
    log_rate: float | str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Trace:
    """Run a scenario.

    Args:
        scenario: what to run; default: the paper's scenario.
        controller: a law with its gains, in place of the scenario's.
        log_rate: samples a second [Hz], which must divide the step rate; ``"full"`` for every step; default 1 kHz, or
            the step rate
            nearest to it that divides.
        progress: called now and then with the steps done and their number.

    Returns:
        The trace. A run that became unstable or was interrupted (Ctrl-C) returns what it had recorded;
        ``trace.status`` tells.

    Raises:
        InputError: something in the input is unphysical; found before the first step.
        LawError: the law raised.
    """
    scenario = scenario if scenario is not None else Scenario()
    if controller is not None:
        scenario = dataclasses.replace(scenario, controller=controller)
    row_steps = row_steps_of(scenario.simulation.timestep, log_rate)
    run = _Run(scenario, row_steps, progress)
    for note in run.notes:
        warnings.warn(note, SamplingWarning, stacklevel=2)
    return run.go()


class _Run:
    """One run, from the initial state to the trace."""

    def __init__(self, scenario: Scenario, row_steps: int, progress: Callable[[int, int], None] | None) -> None:
        self.scenario, self.row_steps, self.progress = scenario, row_steps, progress
        self.plant = build(scenario)
        self.notes = list(check(scenario, self.plant.vehicle, self.plant.design))
        self.data = self.plant.initial_data(scenario)
        gravity = self.plant.model.opt.gravity
        self.analytic = steady_state(scenario, self.plant.vehicle, self.plant.design, gravity)
        self.blocks: list[np.ndarray] = []
        self.wall_time_s = 0.0

    def go(self) -> Trace:
        """Attach the vehicle, step to the end or to whatever stops the run, and make the trace."""
        plant, current, disturbance = self.plant, self.scenario.current, self.scenario.disturbance
        beta = np.deg2rad(current.direction_deg)
        with attach(
            plant.model,
            self.data,
            plant.vehicle.body,
            current_W=(current.speed * np.cos(beta), current.speed * np.sin(beta), 0.0),
            bias=disturbance.bias,
            amplitude=disturbance.amplitude,
            frequency_hz=disturbance.frequency_hz,
        ) as attachment:
            loop = ClosedLoop(
                plant.model,
                self.data,
                attachment,
                plant.design,
                plant.sensor,
                self.scenario,
                self.row_steps,
                CHUNK_STEPS,
            )
            if not loop.compiled:
                law = self.scenario.controller.label()
                note = f"{law} runs as plain Python, numba can't compile it: {loop.not_compiled}"
                self.notes.append(note)
                warnings.warn(note, PlainPythonWarning, stacklevel=4)
            status, message = Status.completed, ""
            start = time.perf_counter()
            try:
                for done in self._chunks(loop):
                    self.wall_time_s = time.perf_counter() - start
                    if self.progress is not None:
                        self.progress(done, self.scenario.steps)
                    if loop.fault:
                        status, message = Status.unstable, f"t = {loop.time:.6g} s: {loop.fault}. {_HINT}"
                        break
            except KeyboardInterrupt:
                status, message = Status.interrupted, f"t = {loop.time:.6g} s: stopped from outside"
            except _LawRaised as error:
                message = f"t = {loop.time:.6g} s: {_users_line(error.cause, self.scenario.controller)}"
                raise LawError(message, self._trace(loop, Status.interrupted, message)) from error.cause
            self.wall_time_s = time.perf_counter() - start
            return self._trace(loop, status, message)

    def _chunks(self, loop: ClosedLoop) -> Iterator[int]:
        """Step through the run; after each chunk its rows are taken, whatever happens next."""
        model, data, steps = self.plant.model, self.data, self.scenario.steps
        done = 0
        while done < steps:
            n = min(CHUNK_STEPS, steps - done)
            try:
                if loop.compiled:
                    mujoco.mj_step(model, data, n)
                else:
                    self._python_steps(loop, n)
            finally:
                self._take_rows(loop)
            done += n
            self._after(loop, done)
            if not loop.fault and done == steps:  # the state at the end, which no step begins from
                self._forward(loop)
                self._take_rows(loop)
                self._after(loop, done + 1)
            yield done

    def _take_rows(self, loop: ClosedLoop) -> None:
        """Keep the rows; an interrupt between two lines of this, and a second call, neither lose nor double any."""
        rows = loop.rows()
        if len(rows) and (not self.blocks or rows[0, 0] > self.blocks[-1][-1, 0]):
            self.blocks.append(rows.copy())
        loop.clear_rows()

    def _python_steps(self, loop: ClosedLoop, n: int) -> None:
        for _ in range(n):
            self._python_law(loop)
            mujoco.mj_step(self.plant.model, self.data)
            if loop.fault:
                return

    def _python_law(self, loop: ClosedLoop) -> None:
        if loop.prepare():
            try:
                loop.call_law()
            except (Exception, SystemExit) as error:
                raise _LawRaised(error) from error

    def _forward(self, loop: ClosedLoop) -> None:
        if not loop.compiled:
            self._python_law(loop)
        mujoco.mj_forward(self.plant.model, self.data)

    def _after(self, loop: ClosedLoop, evaluations: int) -> None:
        """What compiled code could only note: a law that raised, a callback that was taken away."""
        if loop.law_raised:
            try:
                with np.errstate(divide="raise", invalid="raise"):
                    loop.call_law()  # again on the same signals, as plain Python: its exception names the line
            except (Exception, SystemExit) as error:
                raise _LawRaised(error) from error
            raise _LawRaised(RuntimeError("raised when compiled, but not as plain Python on the same signals"))
        if not loop.fault and loop.evaluations != evaluations:
            raise RuntimeError("mjcb_control was replaced during the run: the water was lost")

    def _trace(self, loop: ClosedLoop, status: Status, message: str) -> Trace:
        self._take_rows(loop)
        rows = np.concatenate(self.blocks) if self.blocks else np.zeros((0, loop.width))
        return Trace(
            scenario=self.scenario,
            signals=loop.signals,
            arrays=split_rows(rows, loop.signals),
            status=status,
            message=message,
            steps=min(loop.step, self.scenario.steps),
            wall_time_s=self.wall_time_s,
            analytic=self.analytic,
            notes=tuple(self.notes),
        )


class _LawRaised(Exception):
    def __init__(self, cause: BaseException) -> None:
        self.cause = cause


_HINT = "Try a smaller simulation.timestep, smaller gains, or a softer wall."


def _users_line(error: BaseException, controller: Controller) -> str:
    """Where in the law's own file an exception came from."""
    file = inspect.getfile(type(controller).law)
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == file]
    what = f"{type(error).__name__}: {error}"
    if not frames:
        return f"the law {controller.label()} {what}"
    return f"{Path(file).name}, line {frames[-1].lineno}, in {frames[-1].name}: {frames[-1].line}: {what}"
