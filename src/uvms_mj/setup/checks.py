"""Checks before a run begins: errors that refuse it, and warnings.

**The wall.** Symplectic Euler with a step h is stable for a mass m on a spring k and a damper b if h^2 k/m + 2 h b/m <
4. Well below this limit the forces are accurate. With w = sqrt(k/m), the relative error of peak force and rebound is
about (h w)^2/10.
"""

import contextlib
import dataclasses
import functools
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from ..control.base import delay_faults
from ..control.design import demanded_force
from ..control.posture import posture_faults, posture_notes
from ..control.theory.free_motion import FreeMotion
from ..control.theory.own_effects import OwnEffects, longest_step
from ..control.theory.predictions import stage_notes
from ..control.theory.stability import zeta_limit
from ..control.theory.task_motion import Track
from ..control.theory.terms import START_FORCE, ContactSprings, Pose, ThrustMap
from ..errors import Fault, InputError
from ..guidance.base import samples
from ..physics.effects import WRENCHES, counted
from ..physics.frames import BODY, quat_from_euler_deg, rotation_matrix
from ..physics.spanned_axes import LEAST, ROUNDED, WEAK, axes_spanned, axis_strengths, is_unreached
from ..physics.surfaces import SHAPES
from ..plant.contacts import impossible, walls_of
from ..plant.effects import each_table, effect_faults, effect_tables, situation_of
from ..plant.hull import hull_faults, hull_notes
from ..plant.impact import UP_TO
from ..plant.mjcf import Mjcf
from ..plant.obstacle import lost
from ..plant.sea import sea_notes
from ..plant.settings import Surface, contact_settings, in_series_fast, without_effect
from ..plant.vehicle import AXES, Vehicle, notes_on_damping
from ..quantities import idle, leaves, radians_notes
from ..scenario import Scenario
from ..stages.base import Stage
from .base import Setup, set_up
from .deployment import deployment_notes
from .task_frame import task_faults, task_notes

RESOLVED = 0.3
"""Largest h w for which the error of an impact stays below about 1 %."""


class Direction(NamedTuple):
    """Spring [N/m], damper [N s/m] and mass at the contact [kg] of a wall along its normal, or along its face if
    ``prefix`` is "tangential_"; ``table`` is the wall's in the scenario. ``contacts`` is how many contacts of the list
    press on the wall together; 0 for MuJoCo's pair."""

    table: str
    wall: Surface
    prefix: str
    k: float
    b: float
    m: float
    contacts: int = 0

    def source(self, word: str, default: str) -> str:
        """Where the number comes from, if it is not the key's."""
        given = self.prefix == "" or getattr(self.wall, self.prefix + word) is not None
        together = " with all contacts and bumpers" if self.contacts else ""
        return f"{together}{'' if given else f' (by default {default})'}"


def wall_faults(setup: Setup) -> Iterator[Fault]:
    """Errors for springs and dampers of the walls, normal or tangential, with which the time step is unstable, and for
    contacts that are not computed."""
    scenario = setup.scenario
    yield from impossible(scenario, setup.nominal)
    yield from hull_faults(scenario.walls, scenario.sea, situation_of(scenario, setup.plant))
    h = setup.scenario.simulation.timestep
    for each in directions(setup):
        k, b, m = each.k, each.b, each.m
        if each.prefix == "" and not each.wall.linear:
            if h * h * k / m + 2.0 * h * b / m >= 4.0:
                shortest = (math.sqrt(b * b + 4.0 * k * m) - b) / k
                yield Fault(
                    f"{each.table}.contact",
                    f"a time step of {h:g} s does not resolve impacts of {UP_TO:g} m/s of {m:.4g} kg on it: choose a "
                    f"time step below {shortest:.4g} s, or a softer wall",
                )
        elif h * h * k / m >= 4.0:
            stiffest = 4.0 * m / (h * h)
            yield Fault(
                f"{each.table}.{each.prefix}stiffness",
                f"{k:g} N/m{each.source('stiffness', f'{each.table}.stiffness')} is too stiff for a time step of {h:g} "
                f"s and {m:.4g} kg at the contact: choose less "
                f"than {stiffest:.4g} N/m, or a time step below {math.sqrt(4.0 * m / k):.4g} s",
            )
        elif h * h * k / m + 2.0 * h * b / m >= 4.0:
            most = 2.0 * m / h - 0.5 * h * k
            shortest = (math.sqrt(b * b + 4.0 * k * m) - b) / k
            yield Fault(
                f"{each.table}.{each.prefix}damping",
                f"{b:g} N s/m{each.source('damping', f'critical damping for {k:g} N/m')} is too much for a time step "
                f"of {h:g} s and {m:.4g} kg at the contact: "
                f"choose less than {most:.4g} N s/m, or a time step below {shortest:.4g} s",
            )


def wall_notes(setup: Setup) -> Iterator[str]:
    """Warnings for a wall that the time step resolves badly, and for a start inside a wall."""
    h = setup.scenario.simulation.timestep
    for each in directions(setup):
        w = math.sqrt(each.k / each.m)
        if h * w > RESOLVED:
            what = "sticking friction" if each.prefix else "an impact"
            yield (
                f"{what} is badly resolved: at {each.table}.{each.prefix}stiffness = {each.k:g} N/m and {each.m:.4g} "
                f"kg the contact vibrates "
                f"at {w / (2.0 * math.pi):.3g} Hz, {2.0 * math.pi / (h * w):.1f} time steps per period; with a "
                f"simulation.timestep below {RESOLVED / w:.2g} s its forces are accurate to about 1 %"
            )
    yield from without_effect(setup.scenario)
    yield from hull_notes(setup.scenario.walls, setup.scenario.sea)
    for table, one in setup.contacts.walls:
        given = one.tangential_stiffness is not None or one.tangential_damping is not None
        if one.friction == 0.0 and given:
            yield f"{table}.tangential_stiffness and {table}.tangential_damping have no effect: {table}.friction is 0"
    for i, wall in enumerate(setup.scenario.walls):
        if wall.frequency_hz and not any(wall.amplitude):
            yield f"walls[{i}].frequency_hz has no effect: walls[{i}].amplitude is 0"
    yield from _starts_inside(setup)


def _starts_inside(setup: Setup) -> Iterator[str]:
    """Warnings for contacts that start deep inside their wall."""
    pairs, springs = setup.contacts.pairs, ContactSprings(setup)
    if not pairs:
        return
    poses = setup.initial_poses()
    p, R = (np.array([poses[pair.carrier][k] for pair in pairs]) for k in (0, 1))
    _, normal, depths = springs.wrenches(p, R, once=True)
    for pair, force, depth in zip(pairs, normal, depths, strict=True):
        if force > START_FORCE:
            wall = "the wall" if pair.wall_key == "wall" else pair.wall_key
            yield (
                f"{pair.body_key} starts {depth:.4g} m inside {wall}, which pushes it out with {force:.4g} N "
                "at once: change initial.position or the wall's position"
            )


def directions(setup: Setup) -> Iterator[Direction]:
    """Each direction in use, of all contacts of a wall together."""
    for index, (table, each) in enumerate(setup.contacts.walls):
        pairs = [pair for pair in setup.contacts.pairs if pair.surface == index]
        stiffest = max(each.stiffness, each.layer_stiffness or 0.0)
        solved = pairs[0].solved
        m, n = (setup.mass_along_normal(), 0) if solved else (min(map(setup.lightest, pairs)), len(pairs))
        if each.linear:
            fast = [in_series_fast(stiffest, each.damping, *pair.bumper) for pair in pairs]
        else:
            fast = [each.stiffest(pair.radius, m) for pair in pairs]
        yield Direction(table, each, "", sum(k for k, _ in fast), sum(b for _, b in fast), m, n)
        if each.friction > 0.0:
            along = [contact_settings(each, functools.partial(setup.lightest, pair)) for pair in pairs]
            k_t, b_t = (sum(one[f"tangential_{word}"] for one in along) for word in ("stiffness", "damping"))
            yield Direction(table, each, "tangential_", k_t, b_t, setup.mass_along_face() if solved else m, n)


_FAR = 0.1
"""Motion of a joint that no level of the posture holds, from which it is worth a warning [rad or m]."""
_NEAR = 0.7
"""Share of its speed limit from which a joint is near it: the estimate holds for small motions."""
_SAMPLES, _SAMPLED_S = 100, 0.1
"""Number of velocities of the reference for this estimate, and the time between them [s]."""


def free_motion_notes(setup: Setup) -> Iterator[str]:
    """Warnings for a vehicle whose base and joints come to no rest while the law holds the frame of the task, or whose
    joints are too slow for it."""
    scenario, links = setup.scenario, setup.vehicle.arm.links
    if not links or not type(setup.interface).torque_controlled or isinstance(thrust_map := ThrustMap.of(setup), str):
        return
    position, attitude_deg = setup.rest_pose
    push = demanded_force(scenario) if setup.contacts.paper else 0.0
    tau_c = -setup.design.normal * (push if math.isfinite(push) else 0.0)
    motion = FreeMotion(setup, thrust_map, _still(position or setup.initial.position, attitude_deg, tau_c))
    yield from _restless(setup, motion)
    yield from _slow_motors(setup, thrust_map)


def _still(position: Any, attitude_deg: Any, tau_c: np.ndarray) -> Track:
    """The track of a frame that stays at a pose (3,), (3,) [m, deg] with a contact wrench (6,) [N, N m]."""
    quat = quat_from_euler_deg(*attitude_deg)
    return Track([0.0], [Pose(np.array(position), quat, rotation_matrix(quat), tau_c)])


def _restless(setup: Setup, motion: FreeMotion) -> Iterator[str]:
    """A warning if the slow motion from the initial posture comes to no rest, or to one that the motors or thrusters
    can't hold, or moves far where no level holds it."""
    scenario, q = setup.scenario, motion.rest()
    order, frame = scenario.posture.order, scenario.task.frame
    pushed = scenario.mean_flow_W.any() or setup.mean_water.push.any()
    if isinstance(q, str):
        moves, weak = q, ""
    else:
        moves = _moves(setup, q) if pushed and "joints" not in order else ""
        weak = motion.infeasible(motion.push(q).tau)
    if moves and "joints" not in order:
        yield (
            f"nothing holds the motion that posture.order = {json.dumps(order)} leaves free while the law holds "
            f'{frame}: {moves}; add "joints" to it'
        )
    elif moves:
        yield (
            f"the posture gives way while the law holds {frame}: {moves}; choose other initial.joints, a larger "
            "posture.joints_frequency or a weaker current"
        )
    elif weak:
        yield f"the vehicle can't hold its rest behind {frame}: {weak}; choose other initial.joints or a weaker current"


def _moves(setup: Setup, q: np.ndarray) -> str:
    """Which joint is farthest from its start at q (n,); empty if none is far."""
    start = setup.start.q
    k = int(np.abs(q - start).argmax())
    link = setup.vehicle.arm.links[k]
    if abs(q[k] - start[k]) < _FAR:
        return ""
    angles = (f"{x:.3g} m" if link.slide else f"{math.degrees(x):.3g} deg" for x in (start[k], q[k]))
    return f"{link.joint} moves from {' to '.join(angles)}"


def _slow_motors(setup: Setup, thrust_map: ThrustMap) -> Iterator[str]:
    """A warning for joints that come near their speed limits, where a motor gives no torque."""
    scenario, initial = setup.scenario, setup.initial
    motion = FreeMotion(setup, thrust_map, _still(initial.position, initial.attitude_deg, np.zeros(6)))
    every = max(1, round(_SAMPLED_S / scenario.control_period))
    reference = scenario.reference
    velocities = np.zeros((_SAMPLES, 3))
    if not reference.states and not reference.memory and reference.is_shipped:
        velocities = samples(reference, setup, range(0, every * _SAMPLES, every))["p_d_dot"]
    if near := motion.too_fast(velocities, every * scenario.control_period, _NEAR):
        yield (
            "the joints come near their speed limits, at which a motor has no torque left and the law may lose "
            f"{scenario.task.frame}: {near}; choose a slower reference, a larger posture.joints_frequency "
            "or a weaker current"
        )


_SMALL, _LARGE = 1e-6, 1e8
"""If an equation overflows, the message names the keys with numbers outside this range."""


class SamplingWarning(UserWarning):
    """The controller chatters or limit-cycles at this time step or with these gains."""


_MOST_EFFECTS = 8
"""Most effects of a user's own: a run has room for so many stages."""


def checked(scenario: Scenario, mjcf: Mjcf | None = None, in_world: bool = False) -> Setup:
    """Check a scenario and its stages, and build its plant and its design. The first arguments are as for
    :func:`.base.set_up`; a coupling is computed where the vehicle is stepped ``in_world``, with the others. Raises
    InputError if the scenario cannot run."""
    with no_overflow(scenario):
        setup = set_up(scenario, mjcf)
        if not in_world and any(scenario.vehicle.name in each.vehicles for each in scenario.couplings):
            others = "a coupling needs the other vehicle; run the world, not one vehicle of it"
            raise InputError([Fault("couplings", others)], "scenario")
        refuse(setup, scenario.named_stages, CHECKS)
    return setup


@contextlib.contextmanager
def no_overflow(scenario: Scenario) -> Iterator[None]:
    """Name the keys with extreme values if an equation of the design has no finite result.

    Raises:
        InputError: in place of NumPy's exception.
    """
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        extreme = [
            Fault(key, f"{value:g} is too {'large' if abs(value) > 1.0 else 'small'} relative to the other numbers")
            for key, value in leaves(dataclasses.asdict(scenario))
            if isinstance(value, int | float) and value and not _SMALL <= abs(value) <= _LARGE
        ]
        what = f"an equation of the design has no finite result: {error}"
        raise InputError(extreme or [Fault("", what)], what if extreme else "scenario") from None


def refuse(setup: Setup, stages: Mapping[str, Stage], checks: Iterable["Check"]) -> None:
    """Raise for a scenario that cannot run, by the faults of stages, given by their tables, and of further checks.

    Raises:
        InputError: for example, the wall is too stiff for the time step, or a period is not a multiple of it.
    """
    faults = [fault for table, stage in stages.items() for fault in faults_of_stage(table, stage, setup)]
    if len(setup.scenario.effects) > _MOST_EFFECTS:
        wrong = f"has {len(setup.scenario.effects)} effects; at most {_MOST_EFFECTS} are possible"
        faults.append(Fault("effects", wrong))
    faults += [fault for check in checks for fault in check(setup)]
    if faults:
        raise InputError(faults, "scenario")


def faults_of_stage(table: str, stage: Stage, setup: Setup) -> list[Fault]:
    """The faults of a stage that runs, by the keys of its table."""
    return [_fault_of(table, fault) for fault in stage.faults(setup)] if stage.runs else []


def _fault_of(table: str, fault: Fault) -> Fault:
    """The fault of a stage, with the place of the stage in its list: effects[0].at."""
    name = table.partition("[")[0]
    return Fault(table + fault.key.removeprefix(name), fault.message) if fault.key.startswith(f"{name}.") else fault


def warnings_of(setup: Setup) -> list[str]:
    """Warnings for a scenario that runs badly. Raises InputError if numbers are so extreme that an equation
    overflows."""
    scenario, vehicle = setup.scenario, setup.vehicle
    with no_overflow(scenario):
        notes = [note for notes in NOTES for note in notes(setup)]
    further = (*_thruster_notes(vehicle), *_afloat_notes(setup), *notes_on_damping(vehicle), *_effect_notes(setup))
    return [*radians_notes(scenario.to_dict()), *notes, *further]


def _thruster_notes(vehicle: Vehicle) -> Iterator[str]:
    """Warnings for thrusters that do not span all axes, or one of them badly."""
    strengths, axes = axis_strengths(vehicle.B)
    rank, n = axes_spanned(vehicle.B), len(vehicle.thrusters)
    if n == 0:
        return
    thrusters = f"the {n} thrusters of {vehicle.body} span" if n > 1 else f"the thruster of {vehicle.body} spans"
    if rank < 6:
        missing = [axis for axis, lost in zip(AXES, is_unreached(vehicle.B), strict=True) if lost]
        without = f", none gives {' or '.join(missing)}" if missing else ""
        yield f"{thrusters} {rank} of 6 axes{without}: tau is the wrench closest to tau_cmd that they can produce"
    least = float(strengths[rank - 1]) if rank else 1.0
    dropped = float(strengths[rank]) if rank < 6 else 0.0
    if dropped > ROUNDED:
        yield (
            f"the thrusters of {vehicle.body} give one more axis, mostly {_mostly(axes[:, rank])}, with {dropped:.2g} "
            f"of the strongest one. Below {LEAST:g} it counts as the rounding of the file's numbers, and the "
            "allocation leaves it out; write right angles with more digits, or give that axis a thruster"
        )
    if least < WEAK:
        yield (
            f"the thrusters of {vehicle.body} give one axis, mostly {_mostly(axes[:, rank - 1])}, with {least:.2g} of "
            f"the strongest one: a wrench along it takes {1.0 / least:.2g} times the thrust"
        )


def _effect_notes(setup: Setup) -> Iterator[str]:
    """A warning if the time step does not resolve the effects of the water, shipped ones and a user's own."""
    effects, h = setup.scenario.effects, setup.scenario.simulation.timestep
    if setup.not_rigid:
        return  # another note says so of a user's own
    names = [name for name, _ in counted(setup.effects) if name in WRENCHES]
    slopes = setup.effect_slopes
    own = OwnEffects(effects, setup)
    if effects and not own.not_in_the_loop(setup):
        slopes = slopes + own.slopes(setup)
        names.append(own.names)
    if slopes.any() and (longest := longest_step(setup, slopes)) < h:
        yield (
            f"the time step of {h:g} s does not resolve {', '.join(names)}, by slopes at rest: a motion grows and "
            f"changes its sign in each step; {longest:.3g} s do"
        )


def _mostly(axis: np.ndarray) -> str:
    """The name of the largest entry of an axis (6,)."""
    return AXES[int(np.abs(axis).argmax())]


_UNTRIMMED, _UNHELD = 0.02, 1e-3
"""Least buoyancy or weight that is left over and is warned of, relative to the weight: where a caller commands, and
where a law does and the thrusters can't hold it."""


def _afloat_notes(setup: Setup) -> Iterator[str]:
    """A warning if nothing keeps a level vehicle from rising or sinking for ever: the water has neither surface nor
    bottom."""
    vehicle = setup.vehicle
    bodies = (vehicle, *vehicle.arm.links)
    g, mass = float(np.linalg.norm(setup.gravity_W)), sum(body.mass for body in bodies)
    excess = sum(body.displaced_mass for body in bodies) - mass
    if g == 0.0 or (excess > 0.0 and setup.scenario.buoyancy.shapes):
        return
    against = (np.sign(excess) * setup.gravity_W / g) @ vehicle.B[:3]  # push of each thruster per newton of thrust
    by_caller = setup.scenario.controller.external
    with np.errstate(invalid="ignore"):  # no part of a thrust without limits
        push = np.where(against > 0.0, against * vehicle.u_max, against * vehicle.u_min)
    held = not by_caller and float(np.where(np.abs(against) < 1e-9, 0.0, push).sum()) >= abs(excess) * g
    if held or abs(excess) <= (_UNTRIMMED if by_caller else _UNHELD) * mass:
        return
    way, end = ("rises", "surface") if excess > 0.0 else ("sinks", "bottom")
    unheld = "without a command" if by_caller else "and its thrusters can't hold it when it is level: then"
    less = "less" if excess > 0.0 else "more"
    yield (
        f"{vehicle.body} weighs {abs(excess):.3g} kg {less} than the water that it displaces, {unheld} it {way}; the "
        f"water of a run has no {end} (vehicle.displaced_mass is the factor of the buoyancy)"
    )


def _timing_faults(setup: Setup) -> Iterator[Fault]:
    scenario = setup.scenario
    h = scenario.simulation.timestep
    task = {"task": scenario.task} if scenario.controller.uses_task else {}
    for table, stage in (task | scenario.named_stages).items():
        period = stage.period if stage.runs else None
        if period is not None and (round(period / h) < 1 or abs(period / h - round(period / h)) > 1e-6):
            n = max(1, int(period / h))
            nearest = f"the nearest are {n * h:g} and {(n + 1) * h:g} s"
            yield Fault(f"{table}.period", f"{period:g} s is not a multiple of the time step {h:g} s; {nearest}")
    yield from delay_faults(scenario)


def _water_faults(setup: Setup) -> Iterable[Fault]:
    return effect_faults(effect_tables(setup.scenario), situation_of(setup.scenario, setup.plant))


def _obstacle_faults(setup: Setup) -> Iterator[Fault]:
    """Errors for a current that is no potential flow far from an obstacle, for a start or a reference where potential
    flow does not hold, and for a cable that may come to the edge of a face, where it is infinite."""
    scenario = setup.scenario
    obstacle, current = scenario.obstacle, scenario.current
    wall = walls_of(scenario, setup.plant.probe.radius).get(obstacle.key or "")
    if wall is None or any(_water_faults(setup)):
        return
    if current.shear is not None:
        yield Fault("obstacle.wall", "the flow of a sheared current about it is not computed; leave current.shear out")
    if scenario.tether.advances and wall.shape == "plane":
        wrong = "the current at the edges of a face is infinite in potential flow, and a cable may come to them"
        yield Fault("obstacle.half_width", f"{wrong}; take tether.elements = 0, or no [obstacle]")
    places = {"initial.position": ("the vehicle begins", scenario.initial.position)}
    if setup.rest_pose[0] is not None:
        places["reference"] = ("the reference ends", setup.rest_pose[0])
    flow_W, reach = np.array(current.velocity_W), setup.plant.probe.radius
    for key, (what, place) in places.items():
        if where := lost(obstacle, wall, flow_W, np.array(place), reach):
            yield Fault(key, f"{what} {where}, which is not computed for an [obstacle]")


def _surface_faults(setup: Setup) -> Iterator[Fault]:
    """Errors for stages that do not know that a vehicle may leave the water."""
    scenario = setup.scenario
    if not scenario.buoyancy.shapes:
        return
    key = "buoyancy.shapes"
    if scenario.controller.uses_truth:
        law = scenario.controller.label()
        yield Fault(key, f"the law {law} is told the truth of a vehicle far below the surface; take another law")
    if scenario.wrist.runs:
        yield Fault(key, "the true wrench of the wrist's sensor is that far below the surface; take no wrist")


_SHARE = 0.99
"""A greater share of the shapes' volume that is displaced is all of it."""


def _surface_notes(setup: Setup) -> Iterator[str]:
    """A warning for shapes that hold more than the vehicle displaces."""
    buoyancy, displaced = setup.scenario.buoyancy, setup.vehicle.displaced_mass
    if buoyancy.shapes and (filled := buoyancy.filled(displaced)) < _SHARE:
        litres = 1e3 * buoyancy.volume
        yield (
            f"buoyancy.shapes hold {litres:.4g} l, and the vehicle displaces {litres * filled:.4g} l: a share of "
            f"{filled:.3g} of each of them displaces water"
        )


def _contact_notes(setup: Setup) -> Iterator[str]:
    for table, wall in setup.contacts.walls:
        if not wall.linear:
            yield f"notes on chatter, vibration and bounces do not know the {wall.contact} contact of {table}"


def _sea_faults(setup: Setup) -> Iterator[Fault]:
    """Errors for a reference that ends out of the water, for walls that the trough of the waves leaves dry, for a cable
    below the bottom, and for what has the water at B in place of that at a link."""
    scenario, sea, tether = setup.scenario, setup.scenario.sea, setup.scenario.tether
    if not sea.moves:
        return
    place, start_z = setup.rest_pose[0] or scenario.initial.position, scenario.initial.position[2]
    surfaces = bool(scenario.buoyancy.shapes)
    if start_z < sea.bottom or (start_z > sea.trough and not surfaces):
        return  # said by the sea
    if place[2] > sea.trough and not surfaces:
        yield Fault("reference", f"ends at z = {place[2]:g} m, above the trough of the waves, at {sea.trough:g} m")
    elif place[2] < sea.bottom:
        yield Fault("reference", f"ends at z = {place[2]:g} m, below the bottom, at {sea.bottom:g} m")
    for i, wall in enumerate(scenario.walls):
        endless = wall.shape in ("plane", "cylinder")
        z = float(wall.nearest(place)[1][2]) if endless else wall.position[2]
        if z > sea.trough and not surfaces:
            wrong = f"z = {z:g} m{', where it is nearest to the vehicle,' if endless else ''} is above the trough"
            yield Fault(f"walls[{i}].position", f"{wrong} of the waves, at {sea.trough:g} m, where no water carries it")
    if tether.advances and (lowest := min(tether.way(scenario.simulation.duration)[:, 2])) < sea.bottom:
        yield Fault("tether.anchor", f"comes to z = {lowest:g} m, below the bottom of the sea, at {sea.bottom:g} m")
    if tether.advances and tether.floor is not None and tether.floor < sea.bottom:
        yield Fault("tether.floor", f"{tether.floor:g} m is below the bottom of the sea, at {sea.bottom:g} m")
    if not setup.vehicle.arm.links:
        return
    if scenario.wrist.runs:
        wrong = "the true wrench of the wrist's sensor has the water at the vehicle's origin, not at the links"
        yield Fault("sea.height", f"{wrong}; take no wrist")
    for i, effect in enumerate(scenario.effects):
        if effect.at != BODY:
            wrong = f"the waves at {effect.at} are not computed for effects[{i}], which has the water at the origin"
            yield Fault("sea.height", f"{wrong}; let it act at the body")


def _inertia_faults(setup: Setup) -> Iterator[Fault]:
    """Errors for a wrist's sensor that the water at a wall would load from beyond."""
    for i, body in enumerate(setup.scenario.near_wall):
        if body.link is not None and setup.scenario.wrist.runs:
            wrong = "is not in the true wrench of the wrist's sensor: take no wrist, or only what is on the base"
            yield Fault(f"near_wall[{i}].link", f"the water about {body.link!r} at the wall {wrong}")


def _tether_notes(setup: Setup) -> Iterator[str]:
    """Warnings for a cable that ends before the reference does, for one above the waves, and that the notes on a law do
    not know it."""
    tether, sea, end = setup.scenario.tether, setup.scenario.sea, setup.rest_pose[0]
    if not tether.advances:
        return
    if end is not None and not any(tether.anchor_velocity):
        at_rest = np.array(end) + rotation_matrix(setup.design.quat_d) @ tether.position
        if (distance := float(np.linalg.norm(at_rest - tether.anchor))) > tether.length:
            yield (
                f"the reference ends {distance:.4g} m from tether.anchor, and a cable of {tether.length:g} m holds the "
                "vehicle back"
            )
    if sea.moves and (highest := float(max(tether.way(setup.scenario.simulation.duration)[:, 2]))) > sea.trough:
        yield (
            f"tether.anchor, at z = {highest:.4g} m, is above the trough of the waves: the part of the cable out of "
            "the water keeps buoyancy and drag, in water that moves as at the surface"
        )
    if not setup.scenario.obstacle.constant:
        yield f"the cable has no wake behind {setup.scenario.obstacle.key}: its nodes are in potential flow there, too"
    element = tether.length / tether.elements
    for key, wall in walls_of(setup.scenario, setup.plant.probe.radius).items():
        size = SHAPES[wall.shape].size
        if size is not None and element > size(wall.size):
            yield (
                f"an element of the cable, {element:.3g} m, is longer than {key}, of {size(wall.size):.3g} m: "
                "its nodes touch a wall, and between them it may pass through"
            )
    yield "notes on chatter, vibration and bounces do not know the pull of the cable of [tether]"


def _idle_notes(setup: Setup) -> Iterator[str]:
    """Warnings of keys without effect: of the water, since its wave, tether, sine or gust is none, and of a damping
    in whose place another one is given."""
    for _, key, table in each_table(effect_tables(setup.scenario)):
        yield from table.idle(key)
    impedance = setup.scenario.impedance
    if impedance.D_d is not None:
        yield from idle(impedance, "impedance", ("damping_ratio", "damping_period"), "impedance.D_d is given")
    elif not impedance.natural:
        yield from idle(impedance, "impedance", ("damping_period",), "impedance.M_d is not natural")


def _inertia_notes(setup: Setup) -> Iterator[str]:
    if names := setup.scenario.with_inertia:
        yield f"notes on chatter, vibration and bounces do not know the inertia of {', '.join(names)}"


def _sea_notes(setup: Setup) -> Iterator[str]:
    scenario, start = setup.scenario, setup.scenario.initial.position[2]
    g, surfaces = float(np.linalg.norm(setup.gravity_W)), bool(scenario.buoyancy.shapes)
    return sea_notes(scenario.sea, g, setup.vehicle.displaced_mass, start, surfaces)


def _sampling_notes(setup: Setup) -> Iterator[str]:
    """Warnings for any law that uses the task: a zeta that grows."""
    period = setup.scenario.control_period
    if setup.scenario.controller.uses_task and period > (limit := zeta_limit(setup)):
        yield (
            f"zeta, and with it s, grows without bound at a control period of {period:g} s: A = "
            f"{min(setup.task.A):g} 1/s in eq. (15) needs a period of at most {limit:.4g} s"
        )


Check = Callable[[Setup], Iterable[Fault]]
CHECKS: tuple[Check, ...] = (
    *(_timing_faults, task_faults, wall_faults, _water_faults, _obstacle_faults, _sea_faults, _inertia_faults),
    *(_surface_faults, posture_faults),
)
"""The errors of a run beside the errors of its stages."""
NOTES: tuple[Callable[[Setup], Iterable[str]], ...] = (
    wall_notes,
    lambda setup: stage_notes(setup.scenario.reference, setup),
    *(_sampling_notes, posture_notes, task_notes, free_motion_notes),
    *(_idle_notes, _sea_notes, _surface_notes, _inertia_notes, _tether_notes, _contact_notes),
    deployment_notes,
    lambda setup: stage_notes(setup.scenario.controller, setup),
)
"""The warnings of a run."""
