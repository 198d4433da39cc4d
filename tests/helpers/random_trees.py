"""Random vehicles with joints, and the MJCF text of a twin's tree."""

from dataclasses import replace

import mujoco
import numpy as np

from tree_twin import Rigid, TwinBody, TwinTree, turn
from twin import Array, rotation
from vehicles import dissipative, in_water


def random_rotation(rng: np.random.Generator) -> Array:
    axis = rng.normal(size=3)
    return turn(axis / np.linalg.norm(axis), rng.uniform(-np.pi, np.pi))


def _rigid(rng: np.random.Generator, mass: float, size: float) -> Rigid:
    """Six point masses, so that the inertia is that of a real body."""
    points = rng.normal(size=(6, 3)) * size
    r_g = points.mean(axis=0)
    spread = points - r_g
    inertia = mass / 6.0 * sum(s @ s * np.eye(3) - np.outer(s, s) for s in spread)
    return Rigid(mass, r_g, inertia)


def _body(rng: np.random.Generator, parent: int) -> TwinBody:
    scale = 1.0 if parent < 0 else 0.3
    a, axis = rng.normal(size=(6, 6)), rng.normal(size=3)
    masses = rng.uniform(2.0, 8.0, 2) * scale if rng.random() < 0.5 else rng.uniform(4.0, 12.0, 1) * scale
    parts = tuple(_rigid(rng, float(mass), 0.3 * scale) for mass in masses)
    return TwinBody(
        parent,
        parts,
        M_A=(a @ a.T + 0.1 * np.eye(6)) * scale,
        D_linear=dissipative(rng, 10.0 * scale),
        D_quadratic=dissipative(rng, 30.0 * scale),
        displaced_mass=float(sum(part.mass for part in parts) * rng.uniform(0.7, 1.3)),
        r_b=rng.normal(size=3) * 0.1,
        p_0=rng.normal(size=3) * 0.3,
        R_0=random_rotation(rng),
        slide=bool(rng.random() < 0.3),
        axis=axis / np.linalg.norm(axis),
        anchor=rng.normal(size=3) * 0.2,
    )


def random_tree(seed: int, joints: int, chain: float = 0.6, **others) -> TwinTree:
    """A tree with full matrices everywhere; ``chain`` is how often a link hangs at the last one, not at any other."""
    rng = np.random.default_rng(seed)
    links = range(1, joints + 1)
    parents = [-1, *(k - 1 if rng.random() < chain else int(rng.integers(0, k)) for k in links)]
    order: list[int] = []  # depth first, as MuJoCo numbers bodies

    def visit(k: int) -> None:
        order.append(k)
        for child in range(k + 1, joints + 1):
            if parents[child] == k:
                visit(child)

    visit(0)
    bodies = tuple(_body(rng, order.index(parents[k]) if k else -1) for k in order)
    water = {
        "v_c_W": rng.normal(size=3) * 0.5,
        "disturbance_bias": rng.normal(size=6),
        "disturbance_amplitude": rng.normal(size=6),
        "disturbance_frequency_hz": rng.uniform(0, 1, 6),
    }
    return TwinTree(bodies, **(water | others))


def still(tree: TwinTree) -> TwinTree:
    """The tree in still water without a disturbance."""
    zero = np.zeros(6)
    return replace(tree, v_c_W=zero[:3], disturbance_bias=zero, disturbance_amplitude=zero)


def of_bodies(tree: TwinTree, change) -> TwinTree:
    """The tree with each body replaced by ``change(body)``."""
    return replace(tree, bodies=tuple(change(body) for body in tree.bodies))


def drag_free(tree: TwinTree) -> TwinTree:
    none = np.zeros((6, 6))
    return of_bodies(tree, lambda body: replace(body, D_linear=none, D_quadratic=none))


def neutral(tree: TwinTree) -> TwinTree:
    """The tree with each body's buoyancy equal to its weight, in size and place."""

    def change(body: TwinBody) -> TwinBody:
        r_g = sum(part.mass * part.r_g for part in body.parts) / body.mass
        return replace(body, displaced_mass=body.mass, r_b=r_g)

    return of_bodies(tree, change)


def random_state(tree: TwinTree, seed: int, rate: float = 2.0) -> tuple[Array, Array, Array, Array]:
    """p_WB, quat_WB, q and zeta."""
    rng = np.random.default_rng(seed)
    quat = rng.normal(size=4)
    q = rng.uniform(-1.0, 1.0, tree.n) * np.array([0.3 if body.slide else np.pi for body in tree.bodies[1:]])
    return rng.normal(size=3), quat / np.linalg.norm(quat), q, rng.normal(size=6 + tree.n) * rate


# MJCF


def _numbers(values) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))


def _quat(R: Array) -> Array:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(R).ravel())
    return quat


def _inertial(part: Rigid, p: Array, R: Array) -> str:
    """The part in a frame that has the pose p, R in the part's own."""
    principal, axes = np.linalg.eigh(part.inertia)
    if np.linalg.det(axes) < 0.0:
        axes = -axes
    return (
        f'<inertial pos="{_numbers(R.T @ (part.r_g - p))}" quat="{_numbers(_quat(R.T @ axes))}" '
        f'mass="{part.mass!r}" diaginertia="{_numbers(principal)}"/>'
    )


def _element(tree: TwinTree, k: int, frame: tuple[Array, Array]) -> str:
    """A body with all that hangs at it; ``frame`` is that of the element around it, in the frame of its parent. Each
    further part is a welded body, and the links hang at the last."""
    body, (p_F, R_F) = tree.bodies[k], frame
    here = p, R = np.zeros(3), np.eye(3)
    name, place = ("rov", "") if k == 0 else (f"link{k}", "")
    head = '<freejoint/><site name="origin"/>'
    if k > 0:
        place = f'pos="{_numbers(R_F.T @ (body.p_0 - p_F))}" quat="{_numbers(_quat(R_F.T @ body.R_0))}"'
        kind = "slide" if body.slide else f'hinge" pos="{_numbers(body.anchor)}'
        head = f'<joint name="joint{k}" type="{kind}" axis="{_numbers(body.axis)}" damping="{body.damping!r}"/>'
        head += '<site name="tool"/>' if k == tree.n else ""
    first, *others = body.parts
    inside, tail = head + _inertial(first, *here), ""
    for part in others:
        p, R = here = np.array([0.1, -0.2, 0.3]), rotation([0.5, 0.5, -0.1, 0.7])
        inside += f'{tail}<body pos="{_numbers(p)}" quat="{_numbers(_quat(R))}">{_inertial(part, p, R)}'
        tail = "</body>"
    inside += "".join(_element(tree, c, here) for c in range(k + 1, tree.n + 1) if tree.bodies[c].parent == k)
    return f'<body name="{name}" {place} simple="false">{inside}{tail}</body>'


def _coefficients(tree: TwinTree) -> str:
    entries = {}
    for k, body in enumerate(tree.bodies):
        before = f"link{k}." if k else ""
        entries |= {
            f"{before}M_A": body.M_A,
            f"{before}D_linear": body.D_linear,
            f"{before}D_quadratic": body.D_quadratic,
            f"{before}displaced_mass": body.displaced_mass,
            f"{before}center_of_buoyancy": body.r_b,
        }
    return "".join(f'<numeric name="{k}" size="{np.size(v)}" data="{_numbers(v)}"/>' for k, v in entries.items())


def tree_xml(tree: TwinTree, timestep: float = 1e-4, integrator: str = "Euler") -> str:
    """MJCF of the tree, a vehicle's file with the step of a run: with one motor per axis of the base and one per joint,
    and the site ``tool`` in the frame of the last link."""
    axes = "".join(f'<motor name="m{i}" site="origin" gear="{_numbers(np.eye(6)[i])}"/>' for i in range(6))
    joints = "".join(f'<motor joint="joint{k}" gear="1" ctrlrange="-1000 1000"/>' for k in range(1, tree.n + 1))
    return f"""<mujoco><option gravity="0 0 {-tree.gravity!r}" timestep="{timestep!r}" integrator="{integrator}"/>
    <custom>{_coefficients(tree)}</custom><worldbody>{_element(tree, 0, (np.zeros(3), np.eye(3)))}</worldbody>
    <actuator>{axes}{joints}</actuator></mujoco>"""


def load_tree(tree: TwinTree, **options) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(tree_xml(tree, **options))
    return model, mujoco.MjData(model)


def water_of_tree(tree: TwinTree) -> dict:
    """Arguments of attach() for current and disturbance."""
    return in_water(tree.v_c_W, tree.disturbance_bias, tree.disturbance_amplitude, tree.disturbance_frequency_hz)


def place_tree(data, state: tuple[Array, Array, Array, Array], joint: int = 0, dof: int = 0) -> None:
    """Set the state of the tree whose free joint begins at these entries of qpos and qvel."""
    p, quat, q, zeta = state
    data.qpos[joint : joint + 7 + len(q)] = [*p, *quat, *q]
    data.qvel[dof : dof + 6 + len(q)] = [*(rotation(quat) @ zeta[:3]), *zeta[3:]]


def tree_state(data, n: int, joint: int = 0, dof: int = 0) -> tuple[Array, Array, Array, Array]:
    """p_WB, quat_WB, q and zeta."""
    qpos, qvel = data.qpos[joint : joint + 7 + n].copy(), data.qvel[dof : dof + 6 + n].copy()
    quat = qpos[3:7] / np.linalg.norm(qpos[3:7])
    return qpos[:3], quat, qpos[7:], np.r_[rotation(quat).T @ qvel[:3], qvel[3:]]


def tree_acceleration(data, n: int, joint: int = 0, dof: int = 0) -> Array:
    """zeta_dot, (6 + n,), from qacc."""
    _, quat, _, zeta = tree_state(data, n, joint, dof)
    qacc = data.qacc[dof : dof + 6 + n]
    return np.r_[rotation(quat).T @ qacc[:3] - np.cross(zeta[3:6], zeta[:3]), qacc[3:]]
