"""The plant of a scenario: the true vehicle, and one MuJoCo model with vehicle, wall and a contact sensor.

The true vehicle has the coefficients of its file with the factors and offsets of the scenario's ``[vehicle]``, which
change what moves in the water. The laws' estimates, the default M_d and the allocation keep the numbers of the file, as
a control system keeps the numbers of a data sheet. A payload is a point mass on the base or on a link that the
laws do not know. It adds its mass to the rigid body, and the water that it displaces to the buoyancy. Added mass and
drag stay as in the file.

The wall is a spring and a damper in N/m and N s/m (paper eq. (34)). MuJoCo's contacts are mass-normalised. The contact
is this spring and damper, for any added mass, with a sphere as probe, a constant impedance d = 1e-4 in ``solimp``, and
``solref = (-k_c w (1 - d), -b_c w (1 - d))``, where w is the compiled ``body_invweight0`` of the vehicle's body. The
remaining softness of MuJoCo acts as an inerter of d times the rigid mass. The contact pair is frictionless (condim 1),
because MuJoCo's friction cone couples the slip into the normal force of a contact this soft. :mod:`.physics.contacts`
computes friction from the distance of the shapes at the instant. Friction and the law therefore use the contact of the
same instant.

The probe is centred on the origin of the frame of the task, so that the wall's normal force gives no moment there. In
B, its radius is the vehicle's reach forward; at a site, it is the size of the site. Contact begins when the origin is
at x_c, and in pictures the front of the vehicle or of the tool is then at the wall's face. At a site, w belongs to the
link that carries it.
"""

import dataclasses
import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import mujoco
import numpy as np

from ..errors import Fault, InputError, suggestion
from ..physics.frames import BODY, quat_from_euler_deg, rotation_matrix
from ..physics.statics import Statics
from ..stages.setup import ScenarioLike
from .arm import Body, set_constraints, skew
from .contacts import Contacts, Probe, contacts_of, surfaces_of
from .geometry import Geometry
from .looks import PREFIX, add_surroundings
from .mjcf import Mjcf
from .settings import Initial, Payload, Surface, VehicleChoice, Wall
from .vehicle import Vehicle, free_body_id, free_joint_addresses

_Body = TypeVar("_Body", bound=Body)


@functools.lru_cache(maxsize=8)
def perturbed(nominal: Vehicle, choice: VehicleChoice) -> Vehicle:
    """The true vehicle, from the vehicle of a file.

    Raises:
        InputError: ``thruster_offset`` does not have one offset a thruster, or would move a pure moment, or a payload
            is on a link that the vehicle does not have.
    """
    if choice == VehicleChoice(choice.model, contact_bodies=choice.contact_bodies, name=choice.name):
        return nominal
    B, places = nominal.B.copy(), nominal.places
    if choice.thruster_offset is not None:
        _refuse(nominal, choice.thruster_offset)
        B[3:] += np.cross(np.array(choice.thruster_offset), nominal.B[:3].T).T
        places = places + np.array(choice.thruster_offset)
    names = [nominal.body, *(link.name for link in nominal.arm.links)]
    if faults := payload_faults(choice.payloads, names):
        raise InputError(faults, "scenario")
    B.setflags(write=False)
    links = tuple(
        dataclasses.replace(_perturbed(link, link.name, choice), friction=choice.coulomb_friction * link.friction)
        for link in nominal.arm.links
    )
    base = _perturbed(nominal, nominal.body, choice)
    return dataclasses.replace(base, B=B, places=places, arm=dataclasses.replace(nominal.arm, links=links))


def _perturbed(body: _Body, name: str, choice: VehicleChoice) -> _Body:
    """The base or a link with the factors and payloads of the vehicle."""
    true = dataclasses.replace(
        body,
        M_RB=choice.mass * body.M_RB,
        M_A=choice.added_mass * body.M_A,
        D_linear=choice.linear_damping * body.D_linear,
        D_quadratic=choice.quadratic_damping * body.D_quadratic,
        displaced_mass=choice.displaced_mass * body.displaced_mass,
    )
    for array in (true.M_RB, true.M_A, true.D_linear, true.D_quadratic):
        array.setflags(write=False)
    return loaded(true, [each for each in choice.payloads if each.link == name])


def _refuse(nominal: Vehicle, offsets: tuple[tuple[float, ...], ...]) -> None:
    n = len(nominal.thrusters)
    if len(offsets) != n:
        thrusters = ", ".join(nominal.thrusters)
        wrong = f"has {len(offsets)} offsets; {n} are needed, of {thrusters}"
        raise InputError([Fault("vehicle.thruster_offset", wrong)], "scenario")
    faults = [
        Fault(f"vehicle.thruster_offset[{i}]", f"{nominal.thrusters[i]} is a pure moment: an offset has no effect")
        for i, offset in enumerate(offsets)
        if any(offset) and not nominal.B[:3, i].any()
    ]
    if faults:
        raise InputError(faults, "scenario")


def apply_to_model(model: mujoco.MjModel, body_id: int, actuator_ids: tuple[int, ...], choice: VehicleChoice) -> None:
    """Give a compiled model the masses, the gears and the thrusters of the true vehicle.

    A motor acts at its site with a force and a moment in the site's frame. An offset of the thruster is the moment of
    its force about the site, so that a site may have several motors.
    """
    if choice.mass != 1.0:
        bodies = model.body_rootid == body_id
        model.body_mass[bodies] *= choice.mass
        model.body_inertia[bodies] *= choice.mass
        mujoco.mj_setConst(model, mujoco.MjData(model))  # body_invweight0, which the wall's spring needs
    model.dof_frictionloss[:] *= choice.coulomb_friction
    if choice.thruster_offset is not None:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        R_WB = rotation_matrix(data.xquat[body_id])
        for i, offset in zip(actuator_ids, choice.thruster_offset, strict=True):
            if any(offset):
                R_WS = data.site_xmat[model.actuator_trnid[i, 0]].reshape(3, 3)
                model.actuator_gear[i, 3:] += np.cross(R_WS.T @ R_WB @ np.array(offset), model.actuator_gear[i, :3])


def payload_faults(payloads: Sequence[Payload], names: Sequence[str]) -> list[Fault]:
    """Errors for payloads on bodies that the vehicle, with these names of its base and links, does not have."""
    return [
        Fault(f"vehicle.payloads[{i}].link", f"{each.link!r} is not a link or the base; {suggestion(each.link, names)}")
        for i, each in enumerate(payloads)
        if each.link not in names
    ]


def loaded(body: _Body, payloads: Sequence[Payload]) -> _Body:
    """The base or a link with payloads."""
    for payload in payloads:
        m, p, displaced = payload.mass, np.array(payload.position), payload.displaced_mass
        S = skew(p)
        M_RB = body.M_RB + m * np.block([[np.eye(3), -S], [S, -S @ S]])
        total = body.displaced_mass + displaced
        r_b = (body.displaced_mass * body.r_b + displaced * p) / total if total > 0.0 else body.r_b
        for array in (M_RB, r_b):
            array.setflags(write=False)
        body = dataclasses.replace(body, M_RB=M_RB, displaced_mass=total, r_b=r_b)
    return body


def load(spec: mujoco.MjSpec, model: mujoco.MjModel, payloads: Sequence[Payload], factor: float) -> None:
    """Add payloads to the bodies of a spec before it is compiled. ``model`` is the compiled model of the file, and
    ``factor`` is what all masses of the compiled model are multiplied by afterwards."""
    for name in dict.fromkeys(payload.link for payload in payloads):
        found = model.body(name)
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, found.iquat)
        R = turn.reshape(3, 3)
        masses = [float(found.mass[0]), *(each.mass / factor for each in payloads if each.link == name)]
        places = [found.ipos.copy(), *(np.array(each.position) for each in payloads if each.link == name)]
        m = sum(masses)
        centre = sum(mass * place for mass, place in zip(masses, places, strict=True)) / m
        inertia = R @ np.diag(found.inertia) @ R.T
        for mass, place in zip(masses, places, strict=True):
            S = skew(place - centre)
            inertia = inertia - mass * S @ S
        body = spec.body(name)
        principal, axes = np.linalg.eigh(inertia)
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, (axes * np.sign(np.linalg.det(axes))).ravel())
        body.explicitinertial, body.mass, body.ipos = True, m, centre
        body.inertia, body.iquat, body.fullinertia = principal, quat, [np.nan] * 6


BEYOND = 0.01
"""How far beyond its range a joint may start, as its limits give way [rad or m]."""


def check_fit(scenario: ScenarioLike, nominal: Vehicle) -> None:
    """Raise InputError if the frame of the task is not a site of the vehicle, or the initial joints do not fit it."""
    frame, arm, faults = scenario.task.frame, nominal.arm, []
    if frame != BODY and frame not in arm.sites:
        tools = [BODY, *(name for name in arm.sites if name not in nominal.thrusters)]
        none = f"{frame!r} is no site of {nominal.body}, which has none for a tool; choose {BODY}"
        known = f"{frame!r} is not {BODY!r} or a site; {suggestion(frame, tools)}"
        faults.append(Fault("task.frame", known if tools[1:] else none))
    if not arm.links and scenario.vehicle.coulomb_friction != 1.0:
        faults.append(Fault("vehicle.coulomb_friction", f"has no effect: {nominal.body} has no joints"))
    names = [link.name for link in arm.links]
    for i, link in enumerate(scenario.estimates.links):
        if link.name not in names:
            wrong = f"{link.name!r} is not a link of {nominal.body}; {suggestion(link.name, names)}"
            faults.append(Fault(f"estimates.links[{i}].name", wrong))
    given = scenario.initial.joints
    if given is not None and len(given) != len(arm.links):
        joints = ", ".join(arm.joints) or "none"
        faults.append(
            Fault("initial.joints", f"has {len(given)} positions; {nominal.body} has {len(names)} ({joints})")
        )
    elif given is not None:
        faults += [
            Fault(f"initial.joints[{i}]", wrong)
            for i, (q, link) in enumerate(zip(given, arm.links, strict=True))
            if (wrong := link.out_of_range(q, BEYOND))
        ]
    if faults:
        raise InputError(faults, "scenario")


Inertias = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Inertias (6, 6) of the true vehicle, of its file, and of the estimates."""


def task_inertias(scenario: ScenarioLike, nominal: Vehicle) -> Inertias:
    """The inertias at the frame of the task in the initial posture. At a tool they are Lambda."""
    true, estimates = perturbed(nominal, scenario.vehicle), scenario.estimates
    if scenario.task.frame == BODY and not nominal.arm.links:
        return true.M, nominal.M, estimates.inertia * nominal.M
    factors = (estimates.inertia, *(estimates.of(link.name).inertia for link in nominal.arm.links))
    place = scenario.initial.joints, scenario.task.frame
    M, M_file, M_hat = (_inertia(v, *place, f) for v, f in ((true, None), (nominal, None), (nominal, factors)))
    return M, M_file, M_hat


@functools.lru_cache(maxsize=8)
def _inertia(
    vehicle: Vehicle, joints: tuple[float, ...] | None, frame: str, factors: tuple[float, ...] | None
) -> np.ndarray:
    statics = Statics(vehicle, vehicle.arm.start(joints))
    M = statics.inertia(factors)
    if frame == BODY:
        found = np.ascontiguousarray(M[:6, :6])
    else:
        J = statics.jacobian(vehicle.arm.sites[frame])
        Lambda = np.linalg.inv(J @ np.linalg.solve(M, J.T))
        found = 0.5 * (Lambda + Lambda.T)
    found.setflags(write=False)
    return found


IMPEDANCE = 1e-4
"""Impedance d of the contact pair, constant in solimp."""
_OURS = PREFIX
_TOLERANCE = 1e-15
"""Tolerance of MuJoCo's constraint solver. Its default, 1e-8, can leave an error of 2e-7 of the force at rest."""
_INTEGRATORS = {"euler": "mjINT_EULER", "implicitfast": "mjINT_IMPLICITFAST"}


@dataclass(frozen=True, eq=False)
class Plant:
    """A vehicle in front of a wall, and its MuJoCo model, which is compiled when it is first used."""

    mjcf: Mjcf
    """The vehicle's MJCF, without wall and sensors."""
    vehicle: Vehicle
    """The true one: the MJCF's with the factors of ``choice``."""
    geometry: Geometry
    """Shapes of the vehicle."""
    probe: Probe
    choice: VehicleChoice
    wall: Wall
    walls: tuple[Surface, ...]
    """All walls."""
    timestep: float
    integrator: str
    looks: bool = False
    """Whether the model has the looks of its vehicle and walls, for pictures; its numbers are the same."""

    @functools.cached_property
    def model(self) -> mujoco.MjModel:
        """The compiled model. Its geoms for drawing only are omitted, which makes a step faster, and skins take their
        place."""
        spec = self.mjcf.drawn_spec() if self.looks else self.mjcf.spec()
        spec.option.timestep = self.timestep
        spec.option.integrator = getattr(mujoco.mjtIntegrator, _INTEGRATORS[self.integrator])
        _add_surroundings(spec, self.vehicle.body, self.wall, self.probe)
        if self.choice.payloads:
            load(spec, self.mjcf.compiled(self.mjcf.spec()), self.choice.payloads, self.choice.mass)
        model = self.mjcf.compiled(spec)
        if self.looks:
            spec.compiler.discardvisual = False  # parts for drawing only have been removed
            add_surroundings(spec, self.vehicle.body, self.choice.contact_bodies, self.walls)
            model = self.mjcf.compiled(spec)
        apply_to_model(model, free_body_id(model, self.vehicle.body), self.vehicle.actuator_ids, self.choice)
        set_constraints(model)
        set_wall(model, self.probe.body, self.wall, self.wall.position + self.probe.radius)
        return model

    @property
    def softness(self) -> float:
        """Softness R of the contact pair: the acceleration that a unit of the spring's force is worth to MuJoCo's
        solver [1/kg]."""
        return (1.0 - IMPEDANCE) / IMPEDANCE * self.mjcf.inverse_weight / self.choice.mass

    @functools.cached_property
    def body_id(self) -> int:
        """The id of the vehicle's body."""
        return free_body_id(self.model, self.vehicle.body)

    @functools.cached_property
    def contact_sensor(self) -> int:
        """Address in sensordata of the contact of the probe and the wall: whether they touch, and the normal force (3)
        in W that MuJoCo's solver applies."""
        return int(self.model.sensor(f"{_OURS}contact").adr[0])

    def initial_data(self, initial: Initial) -> mujoco.MjData:
        """Data at an initial state."""
        data, (qpos, dof) = mujoco.MjData(self.model), free_joint_addresses(self.model, self.body_id)
        put_at(initial, data.qpos[qpos : qpos + 7], data.qvel[dof : dof + 6])
        joints = self.initial_joints(initial)
        data.qpos[qpos + 7 : qpos + 7 + len(joints)] = joints
        return data

    def initial_joints(self, initial: Initial) -> np.ndarray:
        """(n,) positions of the joints at an initial state [rad or m]."""
        return self.vehicle.arm.start(initial.joints)


def put_at(initial: Initial, qpos: np.ndarray, qvel: np.ndarray) -> None:
    """Set qpos (7,) and qvel (6,) of the vehicle's free joint to an initial state."""
    quat = quat_from_euler_deg(*initial.attitude_deg)
    qpos[:3], qpos[3:] = initial.position, quat
    qvel[:] = initial.velocity
    mujoco.mju_rotVecQuat(qvel[:3], qvel[:3].copy(), quat)


def set_wall(model: mujoco.MjModel, body: str, wall: Wall, face: float) -> None:
    """Move the wall's face to x of W [m], and set stiffness and damping of the contact pair of the probe on a body in
    N/m and N s/m."""
    scale = model.body(body).invweight0[0] * (1.0 - IMPEDANCE)
    model.pair(f"{_OURS}contact").solref[:] = -wall.stiffness * scale, -wall.damping * scale
    model.geom(f"{_OURS}wall").pos[0] = face


def build(scenario: ScenarioLike, mjcf: Mjcf | None = None) -> tuple[Plant, Contacts, Inertias]:
    """The plant of a scenario, the contacts beside the probe's with ``[wall]``, and the inertias of
    :func:`task_inertias`. ``mjcf`` replaces the model of ``scenario.vehicle.model``. Raises InputError if the
    vehicle's file can't be used or is not physical, or the scenario does not fit it."""
    if not isinstance(mjcf, Mjcf | None):
        raise InputError(f"mjcf: expected an Mjcf, got {mjcf!r}; use Mjcf.find(name or path)")
    mjcf = mjcf if mjcf is not None else Mjcf.find(scenario.vehicle.model)
    nominal, choice, stepping = mjcf.vehicle, scenario.vehicle, scenario.simulation
    check_fit(scenario, nominal)
    true, probe = perturbed(nominal, choice), Probe.of(scenario.task.frame, mjcf)
    contacts = contacts_of(scenario, probe, nominal)
    walls = surfaces_of(scenario, probe.radius)
    plant = Plant(
        mjcf, true, mjcf.geometry, probe, choice, scenario.wall, walls, stepping.timestep, stepping.integrator
    )
    return plant, contacts, task_inertias(scenario, nominal)


def _plain_class(spec: mujoco.MjSpec) -> mujoco.MjsDefault:
    """A default class for hidden geoms that have no mass, touch only in pairs, and inherit no place or shape from the
    vehicle's own classes."""
    plain = spec.add_default(f"{_OURS}plain", spec.default)
    geom = plain.geom
    geom.pos, geom.quat, geom.fromto = [0, 0, 0], [1, 0, 0, 0], [np.nan] * 6
    geom.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    geom.mass, geom.meshname, geom.material = 0.0, "", ""
    geom.contype, geom.conaffinity, geom.rgba, geom.group = 0, 0, [0] * 4, 4
    return plain


def _add_surroundings(spec: mujoco.MjSpec, vehicle: str, wall: Wall, probe: Probe) -> None:
    """Add wall, probe, contact pair, sensor and options to the vehicle's model."""
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.tolerance = _TOLERANCE
    # with one vehicle and one wall, constraint islands save no time
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET | mujoco.mjtDisableBit.mjDSBL_ISLAND
    spec.body(vehicle).simple = False
    spec.compiler.discardvisual = True
    plain = _plain_class(spec)
    spec.body(probe.body).add_geom(
        plain, name=f"{_OURS}probe", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[probe.radius, 0, 0], pos=probe.carrier.p
    )
    spec.worldbody.add_geom(
        plain,
        name=f"{_OURS}wall",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[wall.position + probe.radius, 0, 0],
        quat=[np.sqrt(0.5), 0, -np.sqrt(0.5), 0],  # its normal is -x of W
        size=[1, 1, 0.1],  # for drawing only: the plane has no edge
    )
    spec.add_pair(
        name=f"{_OURS}contact",
        geomname1=f"{_OURS}wall",
        geomname2=f"{_OURS}probe",
        condim=1,
        solimp=[IMPEDANCE, IMPEDANCE, 0.001, 0.5, 1],
        margin=0,
        gap=0,
    )
    sensor = spec.add_sensor(name=f"{_OURS}contact", type=mujoco.mjtSensor.mjSENS_CONTACT)
    sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_GEOM, f"{_OURS}wall"
    sensor.reftype, sensor.refname = mujoco.mjtObj.mjOBJ_GEOM, f"{_OURS}probe"
    wanted = (mujoco.mjtConDataField.mjCONDATA_FOUND, mujoco.mjtConDataField.mjCONDATA_FORCE)
    sensor.intprm[:3] = [sum(1 << int(bit) for bit in wanted), 3, 1]
