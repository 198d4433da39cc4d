"""Vehicles of a world that are stepped together, since something couples them."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..errors import Fault, InputError
from ..physics.coupling import pull_together
from ..physics.effects import state_of
from ..physics.kernels import called_on
from ..plant.coupling import Coupling, coupling_faults
from .simulation import Simulation


_STEPS = 1000
"""Steps of all vehicles from one look at signals and rows to the next."""


class OtherStopped(Exception):
    """Another vehicle of a world has stopped, whose name is the argument, and the step can't be taken."""


class CoupledSimulation(Simulation):
    """A Simulation of one vehicle of a world, which :class:`Lockstep` steps."""

    _in_world = True


class Lockstep:
    """Simulations that take each step together: at an instant the couplings are found from the states of all vehicles,
    and then each takes a step with these forces, as a single engine does with all forces of an instant."""

    def __init__(self, sims: Mapping[str, Simulation], couplings: Sequence[Coupling]) -> None:
        """Raises InputError for a coupling that the time step does not resolve, or that begins far from its length."""
        self._sims, self.steps, self.stopped = sims, 0, ""
        timestep = next(iter(sims.values())).scenario.simulation.timestep
        faults = list[Fault]()
        self._pulls, places = [], dict.fromkeys(sims, 0)
        for i, coupling in enumerate(couplings):
            one, two = (sims[name] for name in coupling.vehicles)
            for fault in coupling_faults(coupling, (one.setup, two.setup), timestep):
                faults.append(Fault(f"couplings[{i}].{fault.key}", fault.message))
            states = [sim.memory.run["plant"]["effects"][state_of("couplings")][0] for sim in (one, two)]
            pulled = []
            for name, state in zip(coupling.vehicles, states, strict=True):
                pulled.append(state[places[name] : places[name] + 1])
                places[name] += 1
            motions = [each for sim in (one, two) for each in sim.motion]
            self._pulls.append(called_on(pull_together, coupling.tie, *motions, *pulled))
        if faults:
            raise InputError(faults, "scenario")

    def pull(self) -> None:
        """Find the forces of the step that begins at the instant in hand."""
        for pull in self._pulls:
            pull()

    def run(self, n: int) -> None:
        """Take n steps, or fewer if a vehicle stops."""
        sims = list(self._sims.items())
        for _ in range(n):
            self.pull()
            for name, sim in sims:
                sim.run(1, np.inf)
                if sim.memory.run["stop"][0]:
                    self.stopped = name
            if self.stopped:
                return
            self.steps += 1
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
            if self.steps == before and self.stopped and self.stopped != name:
                raise OtherStopped(self.stopped)
            return self.steps - before

        return advance
