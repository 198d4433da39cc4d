"""``simulate(scenario) -> Trace`` runs a scenario in chunks at native speed."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from typing import overload

import numpy as np

from ..control import Controller
from ..control.base import Udp
from ..errors import InputError, shortened
from ..plant.mjcf import Mjcf, mujoco_warnings
from ..records.header import Sink
from ..records.trace import Trace
from ..scenario import Scenario
from ..setup.world import World
from .simulation import Simulation, valid_scenario
from .udp import UdpLaw
from .vehicle_run import Guide, Peer, Run, drive, followed, refuse_callers, row_steps_of, told
from .world_run import simulate_world


@overload
def simulate(
    scenario: World,
    controller: None = None,
    *,
    log_rate: float | str | None = None,
    progress: Callable[[int, int], None] | bool | None = None,
    sinks: Mapping[str, Sequence[Sink]] | tuple[()] = (),
    keep_s: float | None = None,
    engine: str = "mujoco",
) -> dict[str, Trace]: ...
@overload
def simulate(
    scenario: Scenario | None = None,
    controller: Controller | None = None,
    *,
    log_rate: float | str | None = None,
    progress: Callable[[int, int], None] | bool | None = None,
    sinks: Sequence[Sink] = (),
    keep_s: float | None = None,
    engine: str = "mujoco",
    mjcf: Mjcf | None = None,
    peer: Peer | None = None,
    guides: Sequence[Guide] = (),
) -> Trace: ...


def simulate(
    scenario: Scenario | World | None = None,
    controller: Controller | None = None,
    *,
    log_rate: float | str | None = None,
    progress: Callable[[int, int], None] | bool | None = None,
    sinks: Sequence[Sink] | Mapping[str, Sequence[Sink]] = (),
    keep_s: float | None = None,
    engine: str = "mujoco",
    mjcf: Mjcf | None = None,
    peer: Peer | None = None,
    guides: Sequence[Guide] = (),
) -> Trace | dict[str, Trace]:
    """Run a scenario.

    Args:
        scenario: the scenario to run, or a world; default: the paper's.
        controller: a controller in place of the scenario's.
        log_rate: samples per second [Hz], which must divide the step rate; ``"full"`` for every step; default: 1 kHz,
            or a rate near it that divides the step rate.
        progress: True for a progress bar, or a function that is called after each chunk with the number of steps done
            and the run's number of steps.
        sinks: receivers of the samples during the run, e.g. ``McapLog("run.mcap")``; called on a separate thread. Of a
            world, a mapping from the names of vehicles to them.
        keep_s: length of the run's end that the trace keeps in memory [s]; default: the whole run.
        engine: "mujoco" or "free_body", as in :class:`Simulation`.
        mjcf: the vehicle's model, e.g. ``trace.header.mjcf``, in place of the file of ``scenario.vehicle.model``.
        peer: another program that sets the commands which a stage leaves to the caller of a Simulation.
        guides: those who let the run go on, and change numbers of it, e.g. ``Again(trace.outcome.changes)``.

    Returns:
        The trace; of a world, the trace of each vehicle by its name. If the run diverged or was interrupted (Ctrl-C),
        the trace has the samples up to then, and ``trace.status`` gives the reason.

    Raises:
        InputError: the input is invalid; raised before the first step.
        LawError: the law raised, used an index out of bounds or gave a number that is not finite.
        SinkError: a sink raised, e.g. because the disk is full; its output up to then is kept.
    """
    if isinstance(scenario, World):
        if controller is not None or mjcf is not None or peer is not None or guides:
            raise InputError("controller, mjcf, peer and guides are of one vehicle; a world has several")
        return simulate_world(scenario, log_rate, progress, sinks, keep_s, engine)
    if isinstance(sinks, Mapping):
        raise InputError("sinks: of one vehicle they are a list")
    scenario = valid_scenario(scenario)
    if controller is not None and not isinstance(controller, Controller):
        loaded = f'; a name belongs to the scenario: Scenario.load("push_wall", controller={shortened(controller)})'
        hint = loaded if isinstance(controller, str) else ""
        raise InputError(f"controller: expected a Controller, got {controller!r}; use e.g. Gsta(k_1=8.0){hint}")
    if controller is not None:
        scenario = dataclasses.replace(scenario, controller=controller)
    if isinstance(scenario.controller, Udp) and peer is None:
        with closing(UdpLaw.of(scenario)) as law:
            return simulate(
                scenario, log_rate=log_rate, progress=progress, sinks=sinks, keep_s=keep_s, engine=engine, mjcf=mjcf,
                peer=law, guides=guides,
            )  # fmt: skip
    row_steps = row_steps_of(scenario.simulation.timestep, log_rate)
    if peer is None:
        refuse_callers(scenario)
    label = f"{scenario.name} · {scenario.controller.label()}"
    with (
        followed(progress, label, scenario.simulation.timestep) as advance,
        mujoco_warnings(),
        Simulation(scenario, engine=engine, mjcf=mjcf, looks=False) as sim,
    ):
        run = Run(sim, row_steps, sinks, np.inf if keep_s is None else keep_s, told(sim), peer, guides)
        drive({"": run}, advance)
        return run.result()
