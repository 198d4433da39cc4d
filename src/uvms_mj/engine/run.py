"""``simulate(scenario) -> Trace`` runs a scenario in chunks at native speed."""

import dataclasses
import functools
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence

import mujoco
import numpy as np

from ..analysis.ranges import no_overflow
from ..analysis.sampling import SamplingWarning, check, row_steps_of
from ..analysis.setup import set_up
from ..control import Controller
from ..control.theory import steady_state
from ..errors import InputError
from ..plant.mjcf import Mjcf
from ..plant.mujoco_warnings import mujoco_warnings
from ..records.header import Header, Outcome, Sink, Status, sources_of, versions
from ..records.trace import Trace
from ..records.writing import Writing
from ..scenario import Scenario
from ..stages.base import Stage, is_shipped
from ..stages.contract import check_contract
from ..stages.recorded import Recorded
from .native.attachment import immerse
from .native.closed_loop import ClosedLoop
from .native.plain_law import LawFault

CHUNK_STEPS = 1000
"""Largest number of steps in a chunk: a few milliseconds of wall time."""
CHUNK_S = 0.25
"""Wall time after which a chunk ends early, for slow laws [s]."""
SLICE_STEPS = 50
"""Largest number of steps from one reading of the clock to the next: a law may become slow at any step."""


class LawError(RuntimeError):
    """A law raised, wrote outside its arrays, changed a gain or gave a number that is not finite. The message names the
    law and, where it is known, the line; ``trace`` has the samples up to then."""

    def __init__(self, message: str, trace: Trace) -> None:
        super().__init__(message)
        self.trace = trace


class SinkError(RuntimeError):
    """A sink raised and stopped the run. ``trace`` has the samples kept in memory, ``__cause__`` the exception."""

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
    sinks: Sequence[Sink] = (),
    keep_s: float | None = None,
    mjcf: Mjcf | None = None,
) -> Trace:
    """Run a scenario.

    Args:
        scenario: the scenario to run; default: the paper's.
        controller: a controller in place of the scenario's.
        log_rate: samples per second [Hz], which must divide the step rate; ``"full"`` for every step; default: 1 kHz,
            or a rate near it that divides the step rate.
        progress: called after each chunk with the number of steps done and the run's number of steps.
        sinks: receivers of the samples during the run, e.g. ``McapLog("run.mcap")``; called on a separate thread.
        keep_s: length of the run's end that the trace keeps in memory [s]; default: the whole run.
        mjcf: the vehicle's model, e.g. ``trace.header.mjcf``, in place of the file of ``scenario.vehicle.model``.

    Returns:
        The trace. If the run diverged or was interrupted (Ctrl-C), the trace has the samples up to then, and
        ``trace.status`` gives the reason.

    Raises:
        InputError: the input is invalid; raised before the first step.
        LawError: the law raised, wrote outside its arrays, changed a gain or gave a number that is not finite.
        SinkError: a sink raised, e.g. because the disk is full; its output up to then is kept.
    """
    scenario = scenario if scenario is not None else Scenario()
    if not isinstance(scenario, Scenario):
        raise InputError(f"scenario: expected a Scenario, got {scenario!r}; use Scenario.load(name or path)")
    if controller is not None and not isinstance(controller, Controller):
        raise InputError(f"controller: expected a Controller, got {controller!r}; use e.g. Gsta(k_1=8.0)")
    if controller is not None:
        scenario = dataclasses.replace(scenario, controller=controller)
    row_steps = row_steps_of(scenario.simulation.timestep, log_rate)
    with mujoco_warnings():
        run = _Run(scenario, row_steps, progress, sinks, keep_s, mjcf)
        for note in run.notes:
            warnings.warn(note, SamplingWarning, stacklevel=2)
        return run.go()


def _check_stage(stage: Stage) -> None:
    """Check that a stage can run by itself.

    Raises:
        InputError: its code is from a log, it violates its contract, or its outputs are set by a caller.
    """
    room, label = stage.room, stage.label()
    if isinstance(stage, Recorded):
        raise InputError(
            f"the {room.noun} {stage.source()} is in the log as text, which is never run: "
            f"pass the controller from the {room.noun}'s file"
        )
    if stage.external:
        raise InputError(
            f"{room.table}.name: {label} leaves {room.out[0].name} to the caller of a Simulation; "
            f"a run needs another {room.noun}"
        )
    if not is_shipped(stage):
        check_contract(type(stage))
        if room.table != "controller":
            raise InputError(f"{room.table}.name: {label}: a run with your own {room.noun} is not possible yet")


class _Run:
    """One run, from the initial state to the trace."""

    def __init__(
        self,
        scenario: Scenario,
        row_steps: int,
        progress: Callable[[int, int], None] | None,
        sinks: Sequence[Sink],
        keep_s: float | None,
        mjcf: Mjcf | None,
    ) -> None:
        for stage in scenario.stages:
            _check_stage(stage)
        self.scenario, self.row_steps, self.progress = scenario, row_steps, progress
        self.sinks, self.keep_s = sinks, np.inf if keep_s is None else keep_s
        with no_overflow(scenario):
            setup = set_up(scenario, mjcf)
            self.plant, self.design = setup.plant, setup.design
            self.notes = check(setup)
        self.rest = functools.partial(steady_state, setup)
        self.data = self.plant.initial_data(scenario.initial)
        self.blocks: deque[np.ndarray] = deque()

    def go(self) -> Trace:
        """Attach the vehicle, step until the run ends or is stopped, and make the trace."""
        plant, disturbance = self.plant, self.scenario.disturbance
        with immerse(
            plant.model,
            self.data,
            plant.vehicle,
            current_W=self.scenario.current.velocity_W,
            bias=disturbance.bias,
            amplitude=disturbance.amplitude,
            frequency_hz=disturbance.frequency_hz,
        ) as attachment:
            loop = ClosedLoop(
                plant.model,
                self.data,
                attachment,
                self.design,
                plant.sensors,
                plant.geometry.reach,
                self.scenario,
                self.row_steps,
                CHUNK_STEPS,
            )
            if not loop.compiled:
                law = self.scenario.controller.label()
                note = f"{law} runs as plain Python, which is slow, because numba can't compile it: {loop.not_compiled}"
                self.notes.append(note)
                warnings.warn(note, PlainPythonWarning, stacklevel=4)
            self.header = Header(
                scenario=self.scenario,
                signals=loop.signals,
                row_steps=self.row_steps,
                rest=self.rest,
                notes=tuple(self.notes),
                mjcf=plant.mjcf,
                geometry=plant.geometry,
                sources=sources_of(self.scenario, len(plant.vehicle.thrusters)),
                versions=versions(),
            )
            with Writing(self.sinks, self.header) as self.writing:
                outcome, raised = self._outcome(loop)
                self._take_rows(loop)
                self.writing.end(outcome)
            kept = np.concatenate(self.blocks) if self.blocks else np.zeros((0, loop.width))
            trace = Trace.of(self.header, kept, outcome)
            if isinstance(raised, LawFault):
                raise LawError(outcome.message, trace) from raised.__cause__
            if raised is not None:
                raise raised
            if self.writing.error is not None:
                raise SinkError(self.writing.message, trace) from self.writing.error
            return trace

    def _outcome(self, loop: ClosedLoop) -> tuple[Outcome, Exception | None]:
        """Step to the end. Returns the outcome, and the exception of the law or of another part, if any."""
        status, message = Status.completed, ""
        raised: Exception | None = None
        start = time.perf_counter()
        try:
            for done in self._chunks(loop):
                if self.progress is not None:
                    self.progress(done, self.scenario.steps)
                if loop.divergence:
                    status, message = Status.unstable, f"t = {loop.time:.6g} s: {loop.divergence}. {_HINT}"
                    break
                if self.writing.error is not None:
                    status, message = Status.failed, f"t = {loop.time:.6g} s: {self.writing.message}"
                    break
        except KeyboardInterrupt:
            status, message = Status.interrupted, f"t = {loop.time:.6g} s: stopped from outside"
        except Exception as error:  # a LawFault, or an error of this package
            status, raised, message = Status.failed, error, f"t = {loop.time:.6g} s: {error}"
        wall_time_s = time.perf_counter() - start
        return Outcome(status, message, min(loop.step, self.scenario.steps), wall_time_s), raised

    def _chunks(self, loop: ClosedLoop) -> Iterator[int]:
        """Step through the run. The rows of a chunk are taken even if it raises."""
        model, data, steps = self.plant.model, self.data, self.scenario.steps
        done, n = 0, 1
        while done < steps:
            end = min(done + CHUNK_STEPS - done % CHUNK_STEPS, steps)
            start = now = time.perf_counter()
            try:
                while done < end and now - start < CHUNK_S and not loop.divergence:
                    n, begun = min(n, end - done), now
                    if loop.compiled:
                        mujoco.mj_step(model, data, n)
                    else:
                        self._python_step(loop)
                    done, now = done + n, time.perf_counter()
                    n = max(1, min(SLICE_STEPS, int(CHUNK_S * n / max(now - begun, 1e-9)))) if loop.compiled else 1
            finally:
                self._take_rows(loop)
            self._after(loop, done)
            if not loop.divergence and done == steps:  # the final state, from which no step begins
                self._forward(loop)
                self._take_rows(loop)
                self._after(loop, done + 1)
            yield done

    def _take_rows(self, loop: ClosedLoop) -> None:
        """Pass the rows on. An interrupt between any two lines, or a second call, neither loses nor repeats a row."""
        rows = loop.rows()
        if len(rows) and (not self.blocks or rows[0, 0] > self.blocks[-1][-1, 0]):
            block = rows.copy()
            block.setflags(write=False)  # sinks and trace share it
            first_step = round(block[0, 0] / self.scenario.simulation.timestep)
            self.writing.put(-(-first_step // self.row_steps), block)
            self.blocks.append(block)
        while len(self.blocks) > 1 and self.blocks[-1][-1, 0] - self.blocks[1][0, 0] >= self.keep_s:
            self.blocks.popleft()
        loop.clear_rows()

    def _python_step(self, loop: ClosedLoop) -> None:
        self._python_law(loop)
        mujoco.mj_step(self.plant.model, self.data)

    def _python_law(self, loop: ClosedLoop) -> None:
        if loop.prepare():
            loop.call_law()

    def _forward(self, loop: ClosedLoop) -> None:
        if not loop.compiled:
            self._python_law(loop)
        mujoco.mj_forward(self.plant.model, self.data)

    def _after(self, loop: ClosedLoop, evaluations: int) -> None:
        """Raise on failures that compiled code can only record: of the law, or by a replaced callback."""
        loop.check_law(last=loop.step >= self.scenario.steps)
        if not loop.divergence and loop.evaluations != evaluations:
            raise RuntimeError("mjcb_control was replaced during the run: hydrodynamics were no longer applied")


_HINT = "Try a smaller simulation.timestep, smaller gains, or a softer wall."
