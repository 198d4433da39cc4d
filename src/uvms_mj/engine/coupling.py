"""Vehicles of a world that are stepped together, since something couples them."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..errors import Fault, InputError
from ..physics.coupling import PULLED, TIE, pull_together
from ..physics.effects import state_of
from ..plant.coupling import Coupling, coupling_faults
from .native.compilation import native_function
from .native.loop import many_runs
from .simulation import Simulation

_STEPS = 1000
"""Steps of all vehicles from one look at signals and rows to the next."""
_POSE, _VELOCITY = np.dtype(("f8", (7,))), np.dtype(("f8", (6,)))


class OtherStopped(Exception):
    """Another vehicle of a world has stopped, whose name is the argument, and the step can't be taken."""


class CoupledSimulation(Simulation):
    """A Simulation of one vehicle of a world, which :class:`Lockstep` steps."""

    _in_world = True


class Lockstep:
    """Simulations that take each step together: at an instant the couplings are found from the states of all vehicles,
    and then each takes a step with these forces, as a single engine does with all forces of an instant.

    With the engine free_body and compiled stages, the steps of all vehicles are one call of machine code.

    Attributes:
        steps: number of steps that all have taken.
        stopped: name of the vehicle that has stopped; empty if none has.
    """

    def __init__(self, sims: Mapping[str, Simulation], couplings: Sequence[Coupling]) -> None:
        """Raises InputError for a coupling that the time step does not resolve, or that begins far from its length."""
        self._sims, self.steps, self.stopped = sims, 0, ""
        timestep = next(iter(sims.values())).scenario.simulation.timestep
        faults = [
            Fault(f"couplings[{i}].{fault.key}", fault.message)
            for i, coupling in enumerate(couplings)
            for fault in coupling_faults(coupling, [sims[name].setup for name in coupling.vehicles], timestep)
        ]
        if faults:
            raise InputError(faults, "scenario")
        pull = native_function(pull_together, [TIE, *(_POSE, _VELOCITY) * 2, PULLED, PULLED])
        self._pull, self._kept = pull.ctypes, [coupling.tie for coupling in couplings]
        at, rows = dict.fromkeys(sims, 0), []
        for tie, coupling in zip(self._kept, couplings, strict=True):
            arrays = [tie, *(array for name in coupling.vehicles for array in sims[name].motion)]
            for name in coupling.vehicles:
                states = sims[name].memory.run["plant"]["effects"][state_of("couplings")][0]
                arrays.append(states[at[name] : at[name] + 1])
                at[name] += 1
            rows.append([pull.address, *(array.ctypes.data for array in arrays)])
        self._ties = np.array(rows, np.int64)
        self._runs = np.zeros((len(sims), 2), np.int64)

    def pull(self) -> None:
        """Find the forces of the step that begins at the instant in hand."""
        for row in self._ties.tolist():
            self._pull(*row[1:])

    def run(self, n: int) -> None:
        """Take n steps, or fewer if a vehicle stops."""
        sims = list(self._sims.values())
        if all(sim.all_native and not sim.compares for sim in sims):
            self._runs[:] = [(sim.memory.code["free_steps"].address, sim.memory.address) for sim in sims]
            ties, runs = (self._ties.ctypes.data, len(self._ties)), (self._runs.ctypes.data, len(sims))
            self.steps += (done := many_runs()["step_together"].ctypes(*ties, *runs, n))
        else:
            done, steps = 0, [sim.one_step() for sim in sims]
            stops = [sim.memory.run["stop"] for sim in sims]
            while done < n and not any(stop[0] for stop in stops):
                self.pull()
                for step in steps:
                    step()
                done += not any(stop[0] for stop in stops)
            self.steps += done
        if done < n:
            self.stopped = next(name for name, sim in self._sims.items() if sim.memory.run["stop"][0])
        self.pull()

    def of(self, name: str) -> Callable[[int], int]:
        """What takes at most n steps of one vehicle, and returns how many it took. The first vehicle that asks for
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
