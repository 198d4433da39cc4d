r"""Coupled vehicles at rest: their poses, the loads of their couplings, and the internal forces in what they hold.

The unknowns are the wrench of the couplings on each vehicle with a law, in B, and the pose of each load, which has no
thrusters or no law. Under a constant wrench a law rests where its closed form says, as under a constant disturbance
(:mod:`uvms_mj.control.theory.balance`). At rest the couplings give these wrenches at the poses of both ends, and the
forces on each load are in balance:

.. math::

    \tau_i - \sum \tau_{couplings}(\eta_i(\tau_i), \eta_j) = 0, \qquad
    d - g(\eta_j) + \tau_c(\eta_j) + \sum \tau_{couplings}(\eta_i, \eta_j) = 0.

Newton's method solves them from the wrenches that the laws demand and from the initial poses of the loads, with
differences for the derivatives. A load that may turn freely, as a bar about its own line, keeps the turn that it has.
A vehicle pushes on a load as its impedance says: with :math:`K_f = I` and its target where it rests, with F_d.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..control.base import NoClosedForm
from ..control.theory.balance import unknown
from ..control.theory.predictions import steady_state
from ..control.theory.terms import Balance, Pose, ThrustMap
from ..physics.coupling import COUPLING, PULLED, internal_forces, press_together, pull_together
from ..physics.coupling_ends import place_end
from ..physics.frames import quat_from_euler_deg
from ..physics.kernels import Record, record_of
from ..physics.tree import FRAME
from ..plant.coupling import Coupling
from ..plant.effects import situation_of
from .base import Setup, set_up
from .world import World, checked_world

_MOST, _HALVINGS = 60, 12
"""Most steps of Newton's method, and of one step's halvings."""
_ENOUGH, _SAME = 1e-12, 1e-9
"""Residual over the largest wrench at which the method ends, and at which the rest counts if it gets no smaller [1]."""
_FORCE, _PLACE = 1e-3, 1e-6
"""Changes for derivatives: of a wrench [N, N m], and of a pose [m, rad]."""


@dataclass(frozen=True, eq=False)
class CoupledRest:
    """A rest of coupled vehicles. Whether the motion from the start reaches it, and stays, is not known.

    Attributes:
        couplings: of the world, in its order.
        positions, quats: (3,) in W [m] and (4,) of each coupled vehicle by its name.
        forces: (n, 3) of each coupling on its first vehicle in W [N]. The force on the second one is the opposite.
        points: (n, 3) where they act in W [m].
        loads: the names of the vehicles without thrusters or without a law.
    """

    couplings: tuple[Coupling, ...]
    positions: Mapping[str, np.ndarray]
    quats: Mapping[str, np.ndarray]
    forces: np.ndarray
    points: np.ndarray
    loads: tuple[str, ...]

    def on(self, vehicle: str) -> np.ndarray:
        """The forces (m, 3) of its couplings on a vehicle in W [N], as its signal ``f_couplings_W`` has them."""
        signs = [(1.0, -1.0)[each.vehicles.index(vehicle)] for each in self.couplings if vehicle in each.vehicles]
        return np.array(signs)[:, None] * self.forces[self._of(vehicle)]

    def internal(self, vehicle: str) -> np.ndarray:
        """The internal forces (m, 3) among :meth:`on` in W [N]."""
        return internal_forces(self.points[self._of(vehicle)], self.on(vehicle))

    @property
    def announced(self) -> list[str]:
        """A sentence for each vehicle: the forces of its couplings, and of a load the internal force."""
        found = []
        for name in self.positions:
            others = [each.vehicles[1 - each.vehicles.index(name)] for each in self.couplings if name in each.vehicles]
            pulls = ", ".join(
                f"{other} [{', '.join(f'{x:.4g}' for x in force)}] N"
                for other, force in zip(others, self.on(name).round(6) + 0.0, strict=True)
            )
            internal = np.linalg.norm(self.internal(name), axis=1).max().round(6)
            held = f", an internal force of {internal:.4g} N" if name in self.loads and len(others) > 1 else ""
            found.append(f"{name} at rest feels in W: {pulls}{held}")
        return found

    def _of(self, vehicle: str) -> list[int]:
        return [i for i, each in enumerate(self.couplings) if vehicle in each.vehicles]


class _NoRest(Exception):
    """There is no closed form; the argument is the reason."""


class _Held:
    """A vehicle with a law, whose unknown is the wrench of its couplings in B."""

    step = _FORCE

    def __init__(self, name: str, setup: Setup) -> None:
        self.name, self._setup = name, setup
        self._bias = np.array(setup.scenario.disturbance.bias)
        self.start = np.array(setup.scenario.impedance.at_end[1])
        self.pose = functools.lru_cache(maxsize=32)(self._pose)  # most differences of Newton's method move another body

    def placed(self, x: np.ndarray) -> np.ndarray:
        """Its pose (7,) under a wrench (6,). Raises _NoRest."""
        return self.pose(x.tobytes())

    def _pose(self, wrench: bytes) -> np.ndarray:
        scenario = self._setup.scenario
        bias = tuple((self._bias + np.frombuffer(wrench)).tolist())
        pushed = dataclasses.replace(scenario, disturbance=dataclasses.replace(scenario.disturbance, bias=bias))
        found = steady_state(set_up(pushed, self._setup.plant.mjcf))
        if isinstance(found, NoClosedForm) or found.position is None or found.quat is None:
            raise _NoRest(f"{self.name}: {getattr(found, 'reason', 'its law predicts no pose')}")
        return np.concatenate([found.position, found.quat])

    def moved(self, x: np.ndarray, change: np.ndarray) -> np.ndarray:
        return x + change

    def lacks(self, x: np.ndarray, pulled: np.ndarray) -> np.ndarray:
        """The residual (6,), under the wrench (6,) of its couplings in B [N, N m]."""
        return x - pulled


class _Load:
    """A vehicle without thrusters or without a law, whose unknown is its pose (7,)."""

    step = _PLACE

    def __init__(self, name: str, setup: Setup) -> None:
        reason = unknown(setup, 0.0, False)
        thrust_map = ThrustMap.of(setup)
        if isinstance(thrust_map, str) or reason:
            raise _NoRest(f"{name}: {reason or thrust_map}")
        self.name, self._balance = name, Balance(setup, 0.0, thrust_map)
        initial = setup.scenario.initial
        self.start = np.concatenate([initial.position, quat_from_euler_deg(*initial.attitude_deg)])

    def _at(self, x: np.ndarray) -> Pose:
        return self._balance.pose(x[:3], x[3:])

    def placed(self, x: np.ndarray) -> np.ndarray:
        return x

    def moved(self, x: np.ndarray, change: np.ndarray) -> np.ndarray:
        pose = self._balance.moved(self._at(x), change)
        return np.concatenate([pose.position, pose.quat])

    def lacks(self, x: np.ndarray, pulled: np.ndarray) -> np.ndarray:
        pose = self._at(x)
        if self._balance.rubs(self._balance.contacts(pose.position, pose.R_WB)[1]):
            raise _NoRest(f"{self.name}: with friction, the rest position depends on the path")
        return pulled - self._balance.thrust(pose)


class _Tie:
    """A coupling of two vehicles at rest."""

    def __init__(self, key: str, coupling: Coupling, setups: Sequence[Setup]) -> None:
        self._key = key
        self._frames = [setup.vehicle.arm.frames.view(np.dtype((Record, FRAME))) for setup in setups]
        records = (coupling.records(situation_of(setup.scenario, setup.plant)) for setup in setups)
        self._ends = [record_of(np.array(each, COUPLING)) for each in records]
        self._pulled = [record_of(np.zeros(1, PULLED)) for _ in setups]
        self._rubs, self._touch = False, None
        if coupling.surface is None:
            self._force = functools.partial(pull_together, record_of(coupling.tie[None]))
        else:
            touch = record_of(coupling.touch(setups, np.inf)[None])  # after which a bumper has settled
            self._rubs, touch.pair.contact.friction = touch.pair.contact.friction > 0.0, 0.0
            self._touch, self._force = touch, functools.partial(press_together, touch)

    def pull(self, poses: Sequence[np.ndarray]) -> list[np.ndarray]:
        """The wrenches (6,) on both vehicles at their poses (7,), in B of each. Raises _NoRest."""
        for end, frames, pose, pulled in zip(self._ends, self._frames, poses, self._pulled, strict=True):
            place_end(end, frames, pose, np.zeros(6), pulled)
        self._force(*self._pulled)
        if self._touch is not None and self._rubs and self._touch.pair.contact.touching:
            raise _NoRest(f"{self._key}: with friction, the rest position depends on the path")
        return [pulled.tau_next.copy() for pulled in self._pulled]

    @property
    def force(self) -> np.ndarray:
        """The force (3,) on the first vehicle of the latest :meth:`pull` in W [N]."""
        return np.array(self._pulled[0].f_W_next)

    @property
    def point(self) -> np.ndarray:
        """Where it acts, in W [m]."""
        x_1, x_2 = (np.array(pulled.p_WC) for pulled in self._pulled)
        if self._touch is None:
            return 0.5 * (x_1 + x_2)
        return x_1 + (self._touch.pair.contact.arm_W if self._touch.pair.contact.touching else 0.0)


def coupled_rest(world: World) -> CoupledRest | NoClosedForm:
    """A rest of the coupled vehicles of a world, or the reason why none is known.

    Raises:
        InputError: a vehicle or a coupling of the world is invalid.
    """
    if not world.couplings:
        return NoClosedForm("nothing is coupled")
    checked_world(world)
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            return _solved(world)
    except _NoRest as reason:
        return NoClosedForm(str(reason))
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        return NoClosedForm(f"the balance of the coupled vehicles has no finite result: {error}")


def _solved(world: World) -> CoupledRest:
    """The rest by Newton's method. Raises _NoRest."""
    names = [name for name in world.scenarios if name in world.coupled]
    setups = {name: set_up(dataclasses.replace(world.scenarios[name], couplings=())) for name in names}
    for name, setup in setups.items():
        if setup.vehicle.arm.links:
            raise _NoRest(f"{name} has joints; the rest of coupled vehicles is known for rigid ones")
    steered = {
        name: setup.vehicle.thrusters and setup.scenario.controller.name != "none" for name, setup in setups.items()
    }
    made = (_Held if steered[name] else _Load for name in names)
    bodies = [kind(name, setup) for kind, (name, setup) in zip(made, setups.items(), strict=True)]
    ties = [
        (_Tie(f"couplings[{i}]", each, [setups[name] for name in each.vehicles]), [*map(names.index, each.vehicles)])
        for i, each in enumerate(world.couplings)
    ]

    def residual(xs: Sequence[np.ndarray]) -> np.ndarray:
        poses = [body.placed(x) for body, x in zip(bodies, xs, strict=True)]
        pulled = np.zeros((len(bodies), 6))
        for tie, (one, two) in ties:
            for k, tau in zip((one, two), tie.pull([poses[one], poses[two]]), strict=True):
                pulled[k] += tau
        return np.concatenate([body.lacks(x, tau) for body, x, tau in zip(bodies, xs, pulled, strict=True)])

    def changed(xs: Sequence[np.ndarray], change: np.ndarray) -> list[np.ndarray]:
        return [body.moved(x, part) for body, x, part in zip(bodies, xs, change.reshape(-1, 6), strict=True)]

    steps = np.repeat([body.step for body in bodies], 6)
    xs = [body.start for body in bodies]
    found = residual(xs)
    for _ in range(_MOST):
        largest = max(1.0, *(float(np.abs(tie.force).max()) for tie, _ in ties))
        size = float(np.abs(found).max())
        if size < _ENOUGH * largest:
            break
        units = np.diag(steps)
        slopes = [(residual(changed(xs, unit)) - residual(changed(xs, -unit))) / (2.0 * unit.sum()) for unit in units]
        # a change in units of the steps, so that forces and places are of one size; what may move freely stays
        change = -np.linalg.lstsq(np.array(slopes).T * steps, found, rcond=1e-10)[0] * steps
        shorter, reason = False, "the balance of the coupled vehicles was not found from their start"
        for halving in range(_HALVINGS):
            tried = changed(xs, change / 2.0**halving)
            try:
                now = residual(tried)
            except _NoRest as raised:  # on the way there, or at the rest
                reason = str(raised)
                continue
            if shorter := bool(np.abs(now).max() < size):
                break
        if not shorter:
            if size < _SAME * largest:
                break
            raise _NoRest(reason)
        xs, found = tried, now
    else:
        raise _NoRest("the balance of the coupled vehicles was not found from their start")
    residual(xs)  # the ties have the forces of the latest call
    poses = {body.name: body.placed(x) for body, x in zip(bodies, xs, strict=True)}
    forces, points = (np.array([getattr(tie, name) for tie, _ in ties]) for name in ("force", "point"))
    positions, quats = ({name: pose[part] for name, pose in poses.items()} for part in (slice(0, 3), slice(3, 7)))
    loads = tuple(body.name for body in bodies if isinstance(body, _Load))
    return CoupledRest(world.couplings, positions, quats, forces, points, loads)
