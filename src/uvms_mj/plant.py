"""Vehicle, wall and contact sensor in one MuJoCo model.

The wall is a spring and damper in N/m and N s/m (paper eq. (34)). MuJoCo's contacts are mass-normalised: with an
elliptic cone, a sphere as probe, the impedance d of ``solimp`` constant at 1e-4 and ``solref = (-k_c w (1 - d), -b_c
w (1 - d))``, w the compiled ``body_invweight0`` of the vehicle's body, the contact is exactly that spring and damper,
whatever the added mass. The probe is centred on B's origin, so that the wall gives no moment, and is as large as the
vehicle reaches forward: contact begins when the origin is at x_c, and the picture shows the vehicle's front on the
wall's face.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from .design import Design
from .frames import quat_from_euler_deg
from .geometry import Geometry
from .mjcf import Mjcf
from .scenario import Scenario
from .vehicle import Vehicle, free_body_id
from .vehicle_files import check_model

IMPEDANCE = 1e-4
"""d of solimp."""
_OURS = "uvms_mj/"  # no vehicle's own names collide with these
_INTEGRATORS = {"euler": "mjINT_EULER", "implicitfast": "mjINT_IMPLICITFAST"}


@dataclass(frozen=True, eq=False)
class Plant:
    """A compiled model and where things are in it."""

    model: mujoco.MjModel
    vehicle: Vehicle
    design: Design
    body_id: int
    sensor: int
    """Address of the contact sensor in sensordata: found, force (3) and position (3) in W."""
    mjcf: Mjcf
    """The vehicle's own model."""
    geometry: Geometry
    """What it looks like; the probe's radius is its reach."""

    def initial_data(self, scenario: Scenario) -> mujoco.MjData:
        """Data at the scenario's initial state."""
        data = mujoco.MjData(self.model)
        joint = self.model.body_jntadr[self.body_id]
        qpos, dof = self.model.jnt_qposadr[joint], self.model.jnt_dofadr[joint]
        quat = quat_from_euler_deg(*scenario.initial.attitude_deg)
        data.qpos[qpos : qpos + 3] = scenario.initial.position
        data.qpos[qpos + 3 : qpos + 7] = quat
        v_W = np.zeros(3)
        mujoco.mju_rotVecQuat(v_W, np.array(scenario.initial.velocity[:3]), quat)
        data.qvel[dof : dof + 3] = v_W
        data.qvel[dof + 3 : dof + 6] = scenario.initial.velocity[3:]
        return data


def build(scenario: Scenario, mjcf: Mjcf | None = None) -> Plant:
    """The plant of a scenario, without the geoms that only a picture needs: a step is faster and does the same.

    Args:
        scenario: what to build.
        mjcf: the vehicle's model, where it is not to be looked up by ``scenario.vehicle.model``.

    Raises:
        InputError: the vehicle's file can't be used, or is not physical.
    """
    mjcf = mjcf if mjcf is not None else Mjcf.find(scenario.vehicle.model)
    spec = mjcf.spec()
    whole = mjcf.compiled(spec)
    check_model(whole, mjcf.name)
    vehicle = Vehicle.from_model(whole)
    design = Design.of(scenario, vehicle)
    geometry = Geometry.of(whole, free_body_id(whole, vehicle.body))
    _add_surroundings(spec, vehicle.body, scenario, geometry.reach)
    model = mjcf.compiled(spec)
    _calibrate(model, design, vehicle, scenario)
    sensor = model.sensor(f"{_OURS}contact").adr[0]
    return Plant(model, vehicle, design, free_body_id(model, vehicle.body), int(sensor), mjcf, geometry)


def _plain_class(spec: mujoco.MjSpec) -> mujoco.MjsDefault:
    """A default class for geoms that have no mass, and inherit no place or shape from the vehicle's own classes."""
    plain = spec.add_default(f"{_OURS}plain", spec.default)
    geom = plain.geom
    geom.pos, geom.quat, geom.fromto = [0, 0, 0], [1, 0, 0, 0], [np.nan] * 6
    geom.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    geom.mass, geom.meshname, geom.material = 0.0, "", ""
    return plain


def _add_surroundings(spec: mujoco.MjSpec, body_name: str, scenario: Scenario, reach: float) -> None:
    """Wall, probe, contact pair, contact sensor and options, added to a vehicle's own model."""
    spec.option.timestep = scenario.simulation.timestep
    spec.option.integrator = getattr(mujoco.mjtIntegrator, _INTEGRATORS[scenario.simulation.integrator])
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    # one vehicle and one wall: nothing to gain from splitting constraints into islands
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET | mujoco.mjtDisableBit.mjDSBL_ISLAND
    body = spec.body(body_name)
    body.simple = False
    spec.compiler.discardvisual = True
    plain = _plain_class(spec)
    pair_only = {"contype": 0, "conaffinity": 0}
    body.add_geom(
        plain,
        name=f"{_OURS}probe",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[reach, 0, 0],
        rgba=[0] * 4,
        group=4,
        **pair_only,
    )
    face = scenario.wall.position + reach
    spec.worldbody.add_geom(
        plain,
        name=f"{_OURS}wall",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[face, 0, 0],
        quat=[np.sqrt(0.5), 0, -np.sqrt(0.5), 0],  # its normal is -x of W
        size=[1, 1, 0.1],  # for drawing only: the plane has no edge
        rgba=[0] * 4,
        group=4,
        **pair_only,
    )
    spec.add_pair(
        name=f"{_OURS}contact",
        geomname1=f"{_OURS}wall",
        geomname2=f"{_OURS}probe",
        condim=3 if scenario.wall.friction > 0 else 1,
        friction=[scenario.wall.friction] * 2 + [0] * 3,
        solimp=[IMPEDANCE, IMPEDANCE, 0.001, 0.5, 1],
        margin=0,
        gap=0,
    )
    sensor = spec.add_sensor(name=f"{_OURS}contact", type=mujoco.mjtSensor.mjSENS_CONTACT)
    sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_GEOM, f"{_OURS}wall"
    sensor.reftype, sensor.refname = mujoco.mjtObj.mjOBJ_GEOM, f"{_OURS}probe"
    data_bits = mujoco.mjtConDataField
    wanted = (data_bits.mjCONDATA_FOUND, data_bits.mjCONDATA_FORCE, data_bits.mjCONDATA_POS)
    sensor.intprm[:3] = [sum(1 << int(bit) for bit in wanted), 3, 1]


def _calibrate(model: mujoco.MjModel, design: Design, vehicle: Vehicle, scenario: Scenario) -> None:
    """Stiffness and damping of the compiled contact pair in N/m and N s/m."""
    w = model.body_invweight0[free_body_id(model, vehicle.body), 0]
    scale = w * (1.0 - IMPEDANCE)
    pair = model.pair(f"{_OURS}contact").id
    model.pair_solref[pair] = -scenario.wall.stiffness * scale, -scenario.wall.damping * scale
    # Sticking friction: a damper along the wall as strong as the step allows, up to the Coulomb limit
    lightest = 1.0 / np.linalg.eigvalsh(np.linalg.inv(design.M)[:3, :3])[-1]
    model.pair_solreffriction[pair] = 0.0, -0.5 * lightest / scenario.simulation.timestep * scale
