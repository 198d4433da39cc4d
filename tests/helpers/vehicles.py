"""Vehicles for tests: MJCF from the twin's parameters, alone or with a second free body."""

import mujoco
import numpy as np

from twin import TwinParameters, skew
from uvms_mj import Current, Disturbance

_MOTORS = np.eye(6)


def _numbers(values) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))


def vehicle_xml(
    parameters: TwinParameters, crowded: bool = False, option: str = "", motors: bool = True, products: str = ""
) -> str:
    """MJCF of a vehicle with the twin's coefficients and one motor per axis; ``crowded`` adds a free ball before it,
    ``products`` are those of velocities."""
    r_g, m = np.asarray(parameters.r_g), parameters.mass
    I_g = np.asarray(parameters.inertia) + m * skew(r_g) @ skew(r_g)  # parallel axis theorem
    full = (I_g[0, 0], I_g[1, 1], I_g[2, 2], I_g[0, 1], I_g[0, 2], I_g[1, 2])
    buoyancy = m * parameters.gravity if parameters.buoyancy is None else parameters.buoyancy
    numerics = {
        "M_A": parameters.M_A,
        "displaced_mass": buoyancy / parameters.gravity,
        "center_of_buoyancy": parameters.r_b,
    }
    for D, times in ((parameters.D_linear, 1), (parameters.D_quadratic, 2)):
        numerics |= {
            f"{'XYZKMN'[i]}_{'uvwpqr'[j] * times}": -value for (i, j), value in np.ndenumerate(D) if value or i == j
        }
    custom = "".join(f'<numeric name="{k}" size="{np.size(v)}" data="{_numbers(v)}"/>' for k, v in numerics.items())
    custom += f'<text name="products" data="{products}"/>' if products else ""
    ball = '<body name="ball" pos="0 9 0"><freejoint/><geom size="0.1"/></body>' if crowded else ""
    actuators = "".join(f'<motor name="m{i}" site="origin" gear="{_numbers(_MOTORS[i])}"/>' for i in range(6))
    return f"""<mujoco><option gravity="0 0 {-parameters.gravity!r}" timestep="{parameters.timestep!r}" {option}/>
    <custom>{custom}</custom>
    <worldbody>{ball}<body name="rov" simple="false"><freejoint/><site name="origin"/>
    <inertial pos="{_numbers(r_g)}" mass="{m!r}" fullinertia="{_numbers(full)}"/></body></worldbody>
    <actuator>{actuators if motors else ""}</actuator></mujoco>"""


def dissipative(rng: np.random.Generator, scale: float) -> np.ndarray:
    """A full D (6, 6), as good for linear as for quadratic damping: its diagonal outweighs rows and columns."""
    D = rng.uniform(-1, 1, (6, 6)) * scale / 12
    return D + np.diag(rng.uniform(1, 2, 6) * scale / 2 + 1e-3)


def random_parameters(seed: int, **others) -> TwinParameters:
    """A vehicle with full M_A, D and inertia, a centre of gravity far off the origin, current and disturbance."""
    rng = np.random.default_rng(seed)
    points, masses = rng.normal(size=(8, 3)) * 0.3 + rng.normal(size=3) * 0.3, rng.uniform(0.5, 2.0, 8)
    m = float(masses.sum())
    a = rng.normal(size=(6, 6))
    return TwinParameters(
        mass=m,
        inertia=sum(w * (p @ p * np.eye(3) - np.outer(p, p)) for w, p in zip(masses, points, strict=True)),
        r_g=masses @ points / m,
        r_b=rng.normal(size=3) * 0.1,
        buoyancy=float(m * 9.81 * rng.uniform(0.8, 1.2)),
        M_A=a @ a.T * 2.0,
        D_linear=dissipative(rng, 10.0),
        D_quadratic=dissipative(rng, 30.0),
        v_c_W=rng.normal(size=3) * 0.5,
        disturbance_bias=rng.normal(size=6),
        disturbance_amplitude=rng.normal(size=6),
        disturbance_frequency_hz=rng.uniform(0, 1, 6),
        **others,
    )


def load(parameters: TwinParameters, **options) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(vehicle_xml(parameters, **options))
    return model, mujoco.MjData(model)


def water_of(parameters: TwinParameters) -> dict:
    """Arguments of attach() for current and disturbance."""
    return in_water(
        parameters.v_c_W,
        parameters.disturbance_bias,
        parameters.disturbance_amplitude,
        parameters.disturbance_frequency_hz,
    )


def in_water(v_c_W, bias, amplitude, frequency_hz) -> dict:
    """Arguments of attach() for a constant current (3,) in W and a disturbance (6,)."""
    six = (tuple(np.broadcast_to(each, 6).astype(float).tolist()) for each in (bias, amplitude, frequency_hz))
    return {"current": Current.of(v_c_W), "disturbance": Disturbance(*six)}


def place(model, data, position=(0, 0, 0), quat=(1, 0, 0, 0), nu=(0,) * 6) -> None:
    """Set the vehicle's pose in W and its velocity in B."""
    joint = model.body("rov").jntadr[0]
    qpos, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
    data.qpos[qpos : qpos + 7] = [*position, *quat]
    v_W = np.zeros(3)
    mujoco.mju_rotVecQuat(v_W, np.array(nu[:3], float), np.array(quat, float))
    data.qvel[dof : dof + 6] = [*v_W, *nu[3:]]


def state(model, data) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """p_WB, quat_WB and nu of the vehicle."""
    joint = model.body("rov").jntadr[0]
    qpos, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
    quat = data.qpos[qpos + 3 : qpos + 7].copy()
    inverse, v = np.zeros(4), np.zeros(3)
    mujoco.mju_negQuat(inverse, quat)
    mujoco.mju_rotVecQuat(v, data.qvel[dof : dof + 3], inverse)
    return data.qpos[qpos : qpos + 3].copy(), quat, np.concatenate([v, data.qvel[dof + 3 : dof + 6]])


def text_of(products: dict[str, float]) -> str:
    """Products of velocities as a vehicle's file has them."""
    return " ".join(f"{name} {c!r}" for name, c in products.items())


def workless(rng: np.random.Generator, n: int) -> dict[str, float]:
    """Products that do no work, c nu_k nu_j on axis i and -c nu_k nu_i on axis j, by their names."""
    found = dict[str, float]()
    for _ in range(n):
        (i, j), k, c = rng.choice(6, 2, replace=False), rng.integers(0, 6), float(rng.normal())
        for axis, other, sign in ((i, j, 1.0), (j, i, -1.0)):
            a, b = sorted((int(other), int(k)))
            name = "XYZKMN"[axis] + "uvwpqr"[a] + "uvwpqr"[b]
            found[name] = found.get(name, 0.0) + sign * c
    return found


def force_of(products: dict[str, float], nu) -> np.ndarray:
    """(6,) wrench of products of velocities, by their names alone."""
    tau = np.zeros(6)
    for name, c in products.items():
        axis, velocities = name[0], name[1:]
        factors = [abs(nu["uvwpqr".index(x)]) for x in velocities.split("|")[1::2]]
        factors += [nu["uvwpqr".index(x)] for part in velocities.split("|")[::2] for x in part]
        tau["XYZKMN".index(axis)] += c * np.prod(factors)
    return tau
