"""Vehicles of a world that are stepped together, since something couples them; and a world that its caller steps."""

from __future__ import annotations  # WorldSimulation is below

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..errors import Fault, InputError
from ..physics.coupling import press_together, pull_together
from ..physics.coupling_ends import place_end
from ..physics.effects import state_of
from ..plant.coupling import Coupling
from ..quantities import overrides_of
from ..setup.world import World, coupling_errors, each_vehicle
from .native.compilation import NativeFunction, native_function
from .native.loop import many_runs
from .simulation import Diverged, Saved, Simulation

_OF_END, _CONTACTS = ("couplings", state_of("couplings")), state_of("touches")
"""Fields of the effects in a vehicle's record: an end of a coupling and its state, and the state of a contact."""
_STEPS = 1000
"""Steps of all vehicles from one look at signals and rows to the next."""


class _Call(NamedTuple):
    """Machine code with the arrays on which it is called."""

    function: NativeFunction
    arrays: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, function: Callable, *arrays: np.ndarray) -> _Call:
        """The code of a kernel on arrays that lie densely in memory; a record is an array ()."""
        kinds = [np.dtype((each.dtype, each.shape)) for each in arrays]
        return cls(native_function(function, kinds), arrays)

    @property
    def row(self) -> list[int]:
        """The address of the code and the addresses of the arrays."""
        return [self.function.address, *(array.ctypes.data for array in self.arrays)]

    def __call__(self) -> None:
        self.function.ctypes(*(array.ctypes.data for array in self.arrays))


class OtherStopped(Exception):
    """Another vehicle of a world has stopped, whose name is the argument, and the step can't be taken."""


class CoupledSimulation(Simulation):
    """A Simulation of one vehicle of a world, which :class:`Lockstep` steps."""

    _in_world = True

    def observe_again(self) -> None:
        """Observe the instant in hand with the forces that were found since."""
        self._memory.run["observed"] = 0
        self._ready = False
        self.prepare()


def simulation_of(world: World, name: str, engine: str) -> Simulation:
    """The Simulation of a vehicle of a world, for :class:`Lockstep` if something couples it. Raises InputError if the
    input is invalid."""
    kind = CoupledSimulation if name in world.coupled else Simulation
    return kind(world.scenarios[name], engine=engine, looks=False)


class Lockstep:
    """Simulations that take each step together: at an instant the couplings are found from the states of all vehicles,
    and then each takes a step with these forces, as a single engine does with all forces of an instant.

    With the engine free_body and compiled stages, the steps of all vehicles are one call of machine code.

    Attributes:
        steps: number of steps that all have taken.
        stopped: name of the vehicle that has stopped; empty if none has.
    """

    def __init__(self, sims: Mapping[str, CoupledSimulation], couplings: Sequence[Coupling]) -> None:
        """Raises InputError for a coupling that the time step does not resolve, or that begins far from its length."""
        self._sims, self.steps, self.stopped = sims, 0, ""
        timestep = next(iter(sims.values())).scenario.simulation.timestep
        faults = [*coupling_errors(couplings, {name: sim.setup for name, sim in sims.items()}, timestep)]
        if faults:
            raise InputError(faults, "scenario")
        self._ends, self._ties = list[_Call](), list[_Call]()
        self._touches = list[tuple[np.ndarray, np.ndarray]]()
        at, touching = dict.fromkeys(sims, 0), dict.fromkeys(sims, 0)
        for coupling in couplings:
            pulled = list[np.ndarray]()
            for name in coupling.vehicles:
                plant, k = sims[name].memory.run["plant"], at[name]
                own, state = (plant["effects"][each][0, k : k + 1].reshape(()) for each in _OF_END)
                self._ends.append(_Call.of(place_end, own, plant["frames"][0], *sims[name].state, state))
                pulled.append(state)
                at[name] += 1
            if coupling.surface is None:
                self._ties.append(_Call.of(pull_together, coupling.tie, *pulled))
                continue
            first = coupling.vehicles[0]
            k = touching[first]
            touch = sims[first].memory.run["plant"]["effects"][_CONTACTS][0, k : k + 1].reshape(())
            touching[first] += 1
            settings = coupling.touch([sims[name].setup for name in coupling.vehicles], timestep)
            self._touches.append((touch, settings))
            self._ties.append(_Call.of(press_together, touch, *pulled))
        self._rows = [np.array([call.row for call in calls], np.int64) for calls in (self._ends, self._ties)]
        self._runs, self._found = np.zeros((len(sims), 2), np.int64), False

    def pull(self) -> None:
        """Find the forces of the step that begins at the instant in hand. Contacts with surfaces advance their states:
        call it once an instant."""
        for call in (*self._ends, *self._ties):
            call()

    def run(self, n: int) -> None:
        """Take n steps, or fewer if a vehicle stops, and find the forces of the step after them."""
        if not self._found:
            self._find()
        sims = list(self._sims.values())
        steps = [sim.one_step() for sim in sims]
        if all(sim.all_native and not sim.compares for sim in sims):
            self._runs[:] = [(sim.memory.code["free_steps"].address, sim.memory.address) for sim in sims]
            calls = [number for rows in self._rows for number in (rows.ctypes.data, len(rows))]
            done = many_runs()["step_together"].ctypes(*calls, self._runs.ctypes.data, len(sims), n)
        else:
            done = 0
            stops = [sim.memory.run["stop"] for sim in sims]
            while done < n and not any(stop[0] for stop in stops):
                for step in steps:
                    step()
                if not any(stop[0] for stop in stops):
                    self.pull()
                    done += 1
        self.steps += done
        if done < n:
            self.stopped = next(name for name, sim in self._sims.items() if sim.memory.run["stop"][0])

    def _find(self) -> None:
        """Find the forces of the first step, of contacts that begin."""
        for touch, settings in self._touches:
            touch[...] = settings
        self.pull()
        self._found = True

    def begin(self) -> None:
        """Begin at the instant in hand, of vehicles that nobody has stepped otherwise."""
        self.stopped = ""
        self._find()
        for sim in self._sims.values():
            sim.observe_again()

    def of(self, name: str) -> Callable[[int], int]:
        """A function of at most n steps of one vehicle, which returns their number. The first vehicle that asks for
        steps takes them with all. Raises :class:`OtherStopped` if another vehicle has stopped."""
        taken = 0

        def advance(n: int) -> int:
            nonlocal taken
            if self.steps == taken and not self.stopped:
                self.run(min(n, _STEPS))
            before, taken = taken, self.steps
            if taken == before and self.stopped not in ("", name):
                raise OtherStopped(self.stopped)
            return taken - before

        return advance


@dataclass(frozen=True, eq=False)
class SavedWorld:
    """The state of a :class:`WorldSimulation` at an instant: the states of its vehicles, and their common steps."""

    world: World
    vehicles: Mapping[str, Saved]
    steps: int


class WorldSimulation:
    """A world that its caller steps, a :class:`Simulation` of each vehicle::

        with WorldSimulation(World.load("press_bar"), engine="free_body") as sim:
            sim.step(1000)
            print(sim.t, sim.vehicles["bar"].signals.f_couplings_W)

    Args:
        world: the world.
        engine: "mujoco" or "free_body".

    Attributes:
        vehicles: the Simulation of each vehicle by its name, to read signals and to set commands. Only :meth:`step` of
            the world takes steps, and only its :meth:`reset` returns to the start.

    Raises:
        InputError: the input is invalid.
    """

    def __init__(self, world: World, *, engine: str = "mujoco") -> None:
        self.world, self._base = world, world
        self.vehicles: dict[str, Simulation] = {}

        def made(name: str) -> None:
            self.vehicles[name] = simulation_of(world, name, engine)  # one by one: close needs those before an error

        try:
            each_vehicle(world.scenarios, made, "scenario")
            coupled = {name: sim for name, sim in self.vehicles.items() if isinstance(sim, CoupledSimulation)}
            self._alone = [sim for name, sim in self.vehicles.items() if name not in coupled]
            self._together = Lockstep(coupled, world.couplings) if coupled else None
            self._begin()
        except BaseException:
            self.close()
            raise

    def _begin(self) -> None:
        """Find the forces of the instant in hand before anybody reads a signal of it."""
        if self._together is not None:
            self._together.begin()

    @property
    def steps(self) -> int:
        """Number of time steps done."""
        return next(iter(self.vehicles.values())).steps

    @property
    def t(self) -> float:
        """Time of the instant in hand [s]."""
        return next(iter(self.vehicles.values())).t

    def step(self, n: int = 1) -> None:
        """Take n time steps in all vehicles.

        Raises:
            Diverged: a vehicle left its bounds. The message names it. Only reset goes on.
            StageFault: a user's stage raised or violated its contract.
            InputError: n is no number of steps, or a vehicle has a pulse width that no speed controller takes.
        """
        for sim in self.vehicles.values():
            sim.refuse_step(n)
        for sim in self._alone:
            sim.run(n, np.inf)
        if self._together is not None:
            self._together.run(n)
        for sim in self.vehicles.values():
            sim.prepare()
        for name, sim in self.vehicles.items():
            if (diverged := sim.diverged) is not None:
                raise Diverged(f"{name}: {diverged}")

    def reset(self, overrides: Mapping[str, Any] | None = None, *, seed: int | None = None) -> None:
        """Return to the start, with overrides as of :meth:`World.load` until the next reset.

        Raises:
            InputError: a key or value is invalid, or needs a new WorldSimulation. All vehicles are then at the start of
                the world that they were made with.
        """
        given = overrides_of(overrides) | ({} if seed is None else {"simulation.seed": seed})
        fixed = [key for key in given if key.startswith(("couplings", "simulation.timestep"))]
        if fixed:
            wrong = "reset can't change it; make a new WorldSimulation"
            raise InputError([Fault(key, wrong) for key in fixed], "reset")
        self.world = self._base.updated(given, place="reset")
        own = self._base.overrides_of_each(given)
        try:
            each_vehicle(self.vehicles, lambda name: self.vehicles[name].reset(own[name]), "reset")
        except InputError:
            self.world = self._base
            for sim in self.vehicles.values():
                sim.reset()
            raise
        finally:
            self._begin()

    def save(self) -> SavedWorld:
        """The state of all vehicles at the instant in hand, for :meth:`restore`. Raises InputError as
        :meth:`Simulation.save` does."""
        saved = {name: sim.save() for name, sim in self.vehicles.items()}
        return SavedWorld(self.world, saved, 0 if self._together is None else self._together.steps)

    def restore(self, saved: SavedWorld) -> None:
        """Return to the instant of a :meth:`save`: the steps that follow have the same bits. Raises InputError as
        :meth:`Simulation.restore` does."""
        if saved.vehicles.keys() != self.vehicles.keys():
            raise InputError("restore: the state was saved by another WorldSimulation")
        for name, sim in self.vehicles.items():
            sim.restore(saved.vehicles[name])
        self.world = saved.world
        if self._together is not None:
            self._together.steps, self._together.stopped = saved.steps, ""

    def close(self) -> None:
        """Close all Simulations. Calling it again has no effect."""
        for sim in self.vehicles.values():
            sim.close()

    def __enter__(self) -> WorldSimulation:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
