"""The plant agrees with results of other projects and, for a vehicle with cross damping, with the matrix equation.

The numbers and their sources are in tests/data. No code of other projects is used here.
"""

import tomllib
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from twin import TwinParameters, matrix_acceleration, rotation
from uvms_mj import Current, attach
from uvms_mj.physics.frames import body_acceleration, quat_from_euler_deg
from uvms_mj.plant.dissipation import damping_notes
from vehicles import load, place, vehicle_xml

DATA = Path(__file__).parents[1] / "data"
ELLIPSOIDS = tomllib.loads((DATA / "gz_sim_ellipsoids.toml").read_text())
FLIP = np.diag([1.0, -1.0, -1.0])
"""From forward, right, down (north, east, down) to forward, left, up (north, west, up), and back."""
FLIP_6 = np.kron(np.eye(2), FLIP)


def nu_dot(parameters: TwinParameters, quat: np.ndarray, nu: np.ndarray, tau: np.ndarray, **water) -> np.ndarray:
    """(6,) MuJoCo's acceleration in B, with hydrodynamics attached."""
    model, data = load(parameters)
    with attach(model, data, **water):
        return of_state(model, data, quat, nu, tau)


def of_state(model, data, quat: np.ndarray, nu: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """(6,) MuJoCo's acceleration in B at a state, with the thrusts tau."""
    place(model, data, quat=quat, nu=nu)
    data.ctrl[:] = tau
    mujoco.mj_forward(model, data)
    out = np.empty(6)
    body_acceleration(rotation(quat), data.qacc, nu, out)
    return out


@pytest.mark.parametrize("body", ["body1", "body2", "body3"])
def test_gazebos_ellipsoids_end_in_its_expected_state(body):
    """The error is within a fifth of the tolerances of Gazebo's test. The wrench is that of the middle of each step."""
    expected, wrench, h = ELLIPSOIDS[body], ELLIPSOIDS["wrench"], 5e-4
    parameters = TwinParameters(
        mass=ELLIPSOIDS["mass"],
        inertia=np.diag(ELLIPSOIDS["inertia"]),
        r_g=(0.0, 0.0, 0.0),
        M_A=np.diag(expected["added_mass"]),
        D_linear=np.zeros((6, 6)),
        D_quadratic=np.zeros((6, 6)),
        timestep=h,
    )
    model = mujoco.MjModel.from_xml_string(vehicle_xml(parameters, option='integrator="RK4"', motors=False))
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    with attach(model, data):
        for k in range(round(ELLIPSOIDS["duration"] / h)):
            for part, name in ((slice(0, 3), "force"), (slice(3, 6), "torque")):
                phase = np.pi * wrench[f"{name}_omega_over_pi"] * (k + 0.5) * h
                data.xfrc_applied[1, part] = np.array(wrench[name]) * np.sin(phase)
            mujoco.mj_step(model, data)
    axis, R_WB = np.zeros(3), rotation(data.qpos[3:7])
    mujoco.mju_quat2Vel(axis, data.qpos[3:7], 1.0)
    angle = np.linalg.norm(axis)
    reached = {
        "position": data.qpos[:3],
        "angle": angle,
        "axis": axis / angle,
        "linear_velocity": data.qvel[:3],
        "angular_velocity": R_WB @ data.qvel[3:],
    }
    for name, value in reached.items():
        error = np.linalg.norm(np.atleast_1d(value - np.array(expected[name])))
        assert error <= 0.2 * ELLIPSOIDS["tolerance"][name], name


@pytest.mark.slow
def test_accelerations_are_those_of_the_python_vehicle_simulator():
    """300 random vehicles with full M_A and D, full inertia, r_g and r_b, in a state and a current.

    The numbers were computed by scripts/reference_accelerations.py with the functions of gnc.py of
    https://github.com/cybergalactic/PythonVehicleSimulator, commit c717e073d7a839dcb5956cf20c595132f1fa249a (MIT), in
    its frames with z down.
    """
    with np.load(DATA / "python_vehicle_simulator.npz", allow_pickle=False) as file:
        gravity, columns = (
            float(file["gravity"]),
            {name: file[name].astype(float) for name in file if name != "gravity"},
        )
    assert len(columns["nu_dot"]) == 300
    errors = []
    for k in range(300):
        x = {name: column[k] for name, column in columns.items()}
        r_g, m = FLIP @ x["r_g"], float(x["mass"])
        parameters = TwinParameters(
            mass=m,
            inertia=FLIP @ x["I_g"] @ FLIP + m * (r_g @ r_g * np.eye(3) - np.outer(r_g, r_g)),
            r_g=r_g,
            r_b=FLIP @ x["r_b"],
            gravity=gravity,
            buoyancy=float(x["buoyancy"]),
            M_A=FLIP_6 @ x["M_A"] @ FLIP_6,
            D_linear=FLIP_6 @ x["D_linear"] @ FLIP_6,
            D_quadratic=FLIP_6 @ x["D_quadratic"] @ FLIP_6,
        )
        roll, pitch, yaw = np.degrees(x["euler"])
        ours = nu_dot(
            parameters,
            quat_from_euler_deg(roll, -pitch, -yaw),
            FLIP_6 @ x["nu"],
            FLIP_6 @ x["tau"],
            current=Current.of(FLIP @ x["v_c_n"]),
        )
        errors.append(np.linalg.norm(FLIP_6 @ ours - x["nu_dot"]) / np.linalg.norm(x["nu_dot"]))
    assert max(errors) <= 1e-12


def lauv() -> TwinParameters:
    """LAUV after da Silva et al. (2007). Its cross damping couples sway and yaw, and heave and pitch. The source gives
    only M_A and D, so I_b is that of a homogeneous cylinder, 1.1 m long and 0.15 m in diameter."""
    transverse = 18.0 * (3.0 * 0.075**2 + 1.1**2) / 12.0
    D_linear, D_quadratic = np.diag([2.4, 23, 23, 0.3, 9.7, 9.7]), np.diag([2.4, 80, 80, 0.0006, 9.1, 9.1])
    D_linear[1, 5], D_linear[2, 4], D_linear[4, 2], D_linear[5, 1] = 11.5, -11.5, 3.1, -3.1
    D_quadratic[1, 5], D_quadratic[2, 4], D_quadratic[4, 2], D_quadratic[5, 1] = 0.3, -0.3, 1.5, -1.5
    return TwinParameters(
        mass=18.0,
        inertia=np.diag([0.5 * 18.0 * 0.075**2, transverse, transverse]),
        r_g=(0.0, 0.0, 0.0),
        M_A=np.diag([1.0, 16, 16, 0.005, 1.3, 1.3]),
        D_linear=D_linear,
        D_quadratic=D_quadratic,
        v_c_W=(0.4, -0.3, 0.1),
    )


@pytest.mark.slow
def test_lauvs_cross_damping_is_that_of_the_matrix_equation(rng):
    """MuJoCo's acceleration equals that of the matrix equation at 200 random states. The cross terms are not small."""
    parameters, missing = lauv(), []
    D_linear, D_quadratic = parameters.D_linear, parameters.D_quadratic
    diagonal = replace(parameters, D_linear=np.diag(np.diag(D_linear)), D_quadratic=np.diag(np.diag(D_quadratic)))
    assert damping_notes("lauv", D_linear, D_quadratic) == []
    model, data = load(parameters)
    with attach(model, data, current=Current.of(parameters.v_c_W)):
        for _ in range(200):
            quat, nu = rng.normal(size=4), rng.normal(size=6) * [1.5, 0.5, 0.5, 0.5, 0.5, 0.5]
            quat, tau = quat / np.linalg.norm(quat), rng.normal(size=6) * 10
            ours = of_state(model, data, quat, nu, tau)
            expected, without = (
                matrix_acceleration(each, np.zeros(3), quat, nu, tau, 0.0)[[1, 2, 4, 5]]
                for each in (parameters, diagonal)
            )
            assert np.linalg.norm(ours[[1, 2, 4, 5]] - expected) <= 1e-9 * np.linalg.norm(expected)
            missing.append(np.linalg.norm(without - expected) / np.linalg.norm(expected))
    assert np.median(missing) > 0.1
