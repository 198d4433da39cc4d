r"""Effects of the water beside added mass, damping and buoyancy. Each has a record and a kernel, called at a port:

- flow (:func:`add_flows`): the motion of the water at a place, with its gradients: :mod:`.current`, which what is in
  its way turns aside (:mod:`.obstacle`), and :mod:`.waves`;
- push (:func:`add_pushes`): a wrench (6,) about B's origin in B of the time alone, added to tau: the disturbance of
  eq. (10), a vector that varies (:mod:`.varying`);
- inertia (:func:`add_inertias`): inertia of the base, and the wrench of its change: :mod:`.near_wall`, and of a
  vehicle at the surface :mod:`.buoyancy`;
- wrench (:func:`add_effects`): a wrench (6,) about B's origin in B, added to tau, from the velocity nu_r (6,) of the
  base relative to the water in B. Closed forms call it, too;
- pull (:func:`find_pulls`, :func:`add_pulls`): a force that is found once a time step, from pose, velocity and states:
  a cable that moves, :mod:`.cable`; a coupling to another vehicle, :mod:`.coupling`, which whoever steps both finds;
- state (:func:`advance_effects`): numbers that advance once a time step, and that a reset returns.

A vehicle has an array of records of each effect; of an empty array no machine code is left, so that an absent effect
costs nothing.

**Tether.** Its drag is a lumped quadratic one at the point of attachment. With the velocity :math:`w` of the water
relative to the vehicle at the point :math:`r_t`, the force of a cable of the length L and the diameter d is

.. math::

    f = \tfrac12 \rho\, C_d\, d\, L\, |w|\, w, \qquad w = -(v_r + \omega \times r_t),

the cross-flow drag of a cylinder (Fossen 2021, sec. 6.4.3, Morison's equation without inertia). The cable's own motion,
weight, tension and inertia are neglected; :mod:`.cable` has them. L is the length whose drag the vehicle bears: half of
a straight cable across the current that is held at its other end. Its power in the water is never positive.

**Fins.** A fin is a thin plate of the area A with the frame F at its centre of pressure r: x along its chord, z along
its span, y its normal. A deflection turns chord and normal about the span. With the fin's velocity v in the water,
without its part along the span, and the angle of attack :math:`\alpha = \mathrm{atan2}(v_y, v_x)`,

.. math::

    f = -\tfrac12 \rho A |v| \left( C_L(\alpha)\, (e_z \times v) + C_D(\alpha)\, v \right).

Below the stall angle :math:`\alpha_s` the flow is attached (Hoerner and Borst, "Fluid-dynamic lift", 1985; Fossen 2021,
sec. 9.7), and beyond it the fin is a plate across the flow with the drag coefficient :math:`C_{90}`; both meet at the
stall angle without a jump:

.. math::

    C_L = \begin{cases} C_\alpha\, \alpha \\
        C_\alpha\, \alpha_s \sin 2\alpha / \sin 2\alpha_s \end{cases} \qquad
    C_D = \begin{cases} C_{D0} + k\, C_L^2 & |\alpha| \le \alpha_s \\
        C_s + (C_{90} - C_s) \dfrac{\sin^2\alpha - \sin^2\alpha_s}{\cos^2\alpha_s} & \text{beyond} \end{cases}

A plate has no front: the coefficients repeat after half a turn of :math:`\alpha`. The lift does no work, and the
drag takes energy out at every angle.

A fin may be moved by an actuator. Its deflection :math:`\delta`, beyond the fixed one, is a state of the effect. It
follows a mix of the commanded wrench, within its limit, with a first-order lag T and a limited rate:

.. math::

    \delta_c = \mathrm{sat}_{\delta_{max}}(m^\top \tau_{cmd}), \qquad
    \delta_{k+1} = \delta_k + \mathrm{sat}_{h \dot\delta_{max}}\left((1 - e^{-h/T})(\delta_c - \delta_k)\right).

It turns the fin about the span through its centre of pressure, and no water's moment acts on the actuator.

**Drag at a place.** With the velocity v of the place r relative to the water and a coefficient :math:`c_i` for each
axis of B, one for motion along it and one for motion against it, the force is one of

.. math::

    f_i = -c_i(\mathrm{sgn}\, v_i)\, |v_i|\, v_i, \qquad f_i = -c_i(\mathrm{sgn}\, v_i)\, |v|\, v_i.

The first takes each axis by itself, as D_quadratic does. The second, of the speed, is for equal coefficients the drag
of a sphere, the same in every direction. No coefficient is negative, so that both take energy out of every motion.

**Products of velocities.** Each adds :math:`c\, \nu_a \nu_b` or :math:`c\, \nu_a |\nu_b|` to one component of tau, as
hydrodynamic derivatives do that a vehicle's file has (SNAME 1950).
"""

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from .buoyancy import VOLUME
from .cable import CABLE, NODE, add_pull, advance_cable, cable_state, place_ends, swing
from .coupling import COUPLING, PULL, PULLED, TOUCH, begin_pull
from .current import CURRENT, add_current
from .frames import cross, velocity_at
from .kernels import kernel
from .near_wall import HULL, PAD, add_hull_inertia, add_hull_wrench, add_pad_inertia, add_pad_wrench
from .obstacle import OBSTACLE, turn_aside
from .varying import add_sines, add_table_and_noise, varying
from .waves import WAVE, add_waves

RHO = 1000.0
"""Density of the water for these forces [kg/m^3]. Sea water has 2.5 % more, which is far less than their coefficients
are uncertain."""

TETHER = np.dtype([("factor", "f8"), ("r", "f8", (3,))], align=True)
"""f / (abs(w) w) [N s^2/m^2], and the point of attachment in B [m]."""

FIN = np.dtype(
    [
        ("factor", "f8"),  # rho A / 2 [kg/m]
        ("r", "f8", (3,)),  # centre of pressure in B [m]
        ("R_BF", "f8", (3, 3)),  # with the deflection
        ("lift_slope", "f8"),  # C_alpha [1/rad]
        ("stall", "f8"),  # alpha_s [rad]
        ("drag", "f8"),  # C_D0 [1]
        ("induced", "f8"),  # k [1]
        ("across", "f8"),  # C_90 [1]
        # of the actuator
        ("mixing", "f8", (6,)),  # m [rad/N, rad/(N m)]
        ("lag", "f8"),  # T [s]
        ("limit", "f8"),  # of delta, 0 for a fixed fin [rad]
        ("rate", "f8"),  # of its change [rad/s]
    ],
    align=True,
)
"""One fin."""

DRAG = np.dtype(
    [
        ("r", "f8", (3,)),  # place in B [m]
        ("forward", "f8", (3,)),  # c_i of a velocity along the axes of B [N s^2/m^2]
        ("backward", "f8", (3,)),  # against them
        ("of_speed", "i8"),  # whether it is the speed that multiplies v_i, and not abs(v_i)
    ],
    align=True,
)
"""The drag at one place."""

PRODUCT = np.dtype(
    [
        ("axis", "i8"),  # of tau
        ("first", "i8"),  # of nu
        ("second", "i8"),
        ("bars", "i8"),  # whether the second is a magnitude
        ("coefficient", "f8"),  # N or N m by units of the velocities
    ],
    align=True,
)
"""One product of velocities."""

DISTURBANCE = varying(6)
"""The disturbance of eq. (10) in B [N, N m]."""

EFFECTS = {
    "current": CURRENT,
    "disturbance": DISTURBANCE,
    "obstacle": OBSTACLE,
    "sea": WAVE,
    "pads": PAD,
    "near_wall": HULL,
    "buoyancy": VOLUME,
    "tether": TETHER,
    "cable": CABLE,
    "nodes": NODE,
    "fins": FIN,
    "drag": DRAG,
    "products": PRODUCT,
    "couplings": COUPLING,
    "pulls": np.dtype([("coupling", "i8")], align=True),
    "touches": np.dtype([("coupling", "i8")], align=True),
}
"""The records of the effects, by the names of their tables; products are of a vehicle's file, a
cable with its nodes is of the table of the tether, and each coupling has a pull, whose state is its force. A coupling
of a surface has a touch at its first vehicle, whose state is the contact."""

FLOWS, PUSHES, INERTIAS = ("current", "obstacle", "sea"), ("disturbance",), ("pads", "near_wall", "buoyancy")
"""The effects that move the water, that push the vehicle as time goes, and that change its inertia."""
PULLS = ("cable", "nodes", "couplings", "pulls", "touches")
"""The effects that pull at the vehicle with states of their own."""
WRENCHES = tuple(name for name in EFFECTS if name not in (*FLOWS, *PUSHES, *INERTIAS, *PULLS))
"""All others, which add a wrench by the velocity in the water."""
TABLES = {"current": {"table": 4, "shear": 2}, "disturbance": {"table": 7}}
"""The tables of an effect, each the name of the field with its place, and the width of its rows."""
STATES: dict[str, Callable[[int], Any]] = {
    "fins": lambda nodes: "f8",
    "cable": cable_state,
    "couplings": lambda nodes: PULLED,
    "pulls": lambda nodes: PULL,
    "touches": lambda nodes: TOUCH,
}
"""The states of each record of an effect that has states, with so many nodes of a cable: of a fin its delta [rad]. They
begin at zero, advance once a time step by :func:`advance_effects`, and a reset returns them."""


@functools.cache
def effects_dtype(counts: tuple[tuple[str, int], ...]) -> np.dtype:
    """Arrays of records, by how many there are of each effect, and of the states of the records."""
    there = dict(counts)
    fields: list[Any] = [(name, kind, (there.get(name, 0),)) for name, kind in EFFECTS.items()]
    nodes = there.get("nodes", 0)
    fields += [(state_of(name), kind(nodes), (there.get(name, 0),)) for name, kind in STATES.items()]
    return np.dtype(fields, align=True)


def counted(records: np.ndarray) -> tuple[tuple[str, int], ...]:
    """How many records (1,) of :func:`effects_dtype` there are of each effect that there is."""
    return _counts(records.dtype)


@functools.cache
def _counts(kind: np.dtype) -> tuple[tuple[str, int], ...]:
    fields: Any = kind.fields
    sizes = {name: fields[name][0].shape[0] for name in EFFECTS}
    return tuple((name, n) for name, n in sizes.items() if n)


def moving(records: np.ndarray) -> bool:
    """Whether the water of records (1,) moves not the same at all times and places."""
    others = [records[name] for name in FLOWS if name != "current"]
    return not records["current"]["constant"][0, 0] or any(each.size and each.view(np.uint8).any() for each in others)


def state_of(effect: str) -> str:
    """The name of the array of the states of an effect."""
    return f"{effect}_state"


NO_EFFECTS = effects_dtype(())
"""The arrays where there is no effect."""


@kernel
def add_flows(effects, numbers, t, p_W, v, v_dot, gradient) -> float:
    """Add the motion of the water by all effects that move it, at the place p_W (3,) [m, W] and the time t [s]: its
    velocity to v (3,) [m/s, W], the time derivative there to v_dot (3,), and dv_i/dx_j to gradient (3, 3) [1/s].
    ``numbers`` has the tables. Returns the pressure head of the waves [m]."""
    for k in range(effects.current.shape[0]):
        add_current(effects.current[k], numbers, t, p_W, v, v_dot, gradient)
    for k in range(effects.obstacle.shape[0]):
        if in_the_way(effects.obstacle[k]):
            turn_aside(effects.obstacle[k], p_W, v, v_dot, gradient)
    return add_sea(effects, t, p_W, v, v_dot, gradient)


@kernel
def add_sea(effects, t, p_W, v, v_dot, gradient) -> float:
    """As :func:`add_flows`, of the waves alone."""
    if effects.sea.shape[0] == 0:
        return 0.0
    return add_waves(effects.sea, t, p_W, v, v_dot, gradient)


@kernel
def in_the_way(obstacle) -> bool:
    """Whether there is an obstacle: a reset leaves an empty record of one that it takes away."""
    return obstacle.half_width + obstacle.radius > 0.0


@kernel
def add_pushes(effects, numbers, t, tau):
    """Add the wrenches of all effects of the time t [s] alone to tau (6,) [N, N m, B]. ``numbers`` has the tables."""
    for k in range(effects.disturbance.shape[0]):
        push = np.zeros(6)
        add_sines(effects.disturbance[k], t, push)
        add_table_and_noise(effects.disturbance[k], numbers, t, push, np.zeros(6))  # its rate is not used
        tau += push


@kernel
def add_inertias(plant, dry, R_WB, M):
    """Add the inertia of all effects that have one to M (6, 6), about B's origin in B, and to the composite inertias of
    the links that carry them. M has the added mass of the base far below the surface, of which the share ``dry`` is
    above."""
    effects, p_WB, links, frames = plant.effects, plant.qpos[:3], plant.links, plant.frames
    for k in range(effects.pads.shape[0]):
        if effects.pads[k].radius > 0.0:  # a reset leaves an empty record of a pad that it takes away
            add_pad_inertia(effects.pads[k], p_WB, R_WB, M)
    for k in range(effects.near_wall.shape[0]):
        hull, own = effects.near_wall[k], np.zeros((6, 6))
        if hull.radius > 0.0:
            above = hull.link
            add_hull_inertia(hull, frames[above].R_BL, frames[above].p_BL, p_WB, R_WB, own)
            M += own
            for _ in range(frames[hull.link].depth):
                add_inertia_to(links[above], own)
                above = frames[above].parent
    if effects.buoyancy.shape[0] != 0:  # of a vehicle without links
        M -= dry * links[0].M


@kernel
def add_inertia_to(link, M):
    """Add an inertia M (6, 6) about B's origin in B to the composite inertia of a link."""
    J = link.composite
    for i in range(3):
        J[i] += M[i, :3]
        J[3 + i] += M[i, 3:]
        J[6 + i] += M[3 + i, 3:]


@kernel
def add_inertia_wrenches(plant, R_WB, nu):
    """Add to the wrenches F of the links what the change of these inertias does at the velocity nu (6,) of the base,
    where the links have their motion relative to the water at B; the change at the surface has the velocity in the
    water (:func:`.buoyancy.meet_surface`)."""
    effects, p_WB, links, frames, water = plant.effects, plant.qpos[:3], plant.links, plant.frames, plant.water
    tau, V, A = links[0].F, np.zeros(6), np.zeros(6)
    for k in range(effects.pads.shape[0]):
        if effects.pads[k].radius > 0.0:
            add_pad_wrench(effects.pads[k], p_WB, R_WB, nu, tau)
    for k in range(effects.near_wall.shape[0]):
        hull = effects.near_wall[k]
        if hull.radius > 0.0:
            link, frame = links[hull.link], frames[hull.link]
            v_c = nu[:3] - plant.nu_r[:3]
            V[:], A[:] = link.V, link.A
            V[:3] += v_c
            A[:3] -= cross(link.V[3:], v_c)
            if water.unsteady != 0:
                A[:3] += R_WB.T @ water.v_c_dot_W
            add_hull_wrench(hull, frame.R_BL, frame.p_BL, p_WB, R_WB, V, A, link.F)


@kernel
def add_effects(effects, nu_r, tau):
    """Add the wrenches of all effects of the velocity nu_r (6,) relative to the water [m/s, rad/s, B] to tau (6,) [N,
    N m, B]."""
    for k in range(effects.tether.shape[0]):
        add_tether(effects.tether[k], nu_r, tau)
    for k in range(effects.fins.shape[0]):
        add_fin(effects.fins[k], effects.fins_state[k], nu_r, tau)
    for k in range(effects.drag.shape[0]):
        add_drag(effects.drag[k], nu_r, tau)
    for k in range(effects.products.shape[0]):
        add_product(effects.products[k], nu_r, tau)


@kernel
def find_pulls(plant, numbers, t, p_WB, R_WB, nu, surfaces, walls):
    """Find the forces of all effects that pull, in the step that begins at the time t [s] in the water of a plant,
    among so many walls, SURFACE records at their places."""
    effects, water = plant.effects, plant.water
    for k in range(effects.couplings.shape[0]):
        begin_pull(effects.couplings_state[k], effects.pulls_state[k])
    if effects.cable.shape[0] != 0:
        cable, state = effects.cable[0], effects.cable_state[0]
        if cable.timestep == 0.0:  # a reset leaves an empty record of a cable that it takes away
            return
        place_ends(cable, effects.nodes, state, t, p_WB, R_WB, nu)
        flows, gradient = np.zeros((state.p.shape[0], 6)), np.zeros((3, 3))
        for i in range(state.p.shape[0]):
            if water.unsteady != 0:
                gradient[:] = 0.0
                add_flows(effects, numbers, t, state.p[i], flows[i, :3], flows[i, 3:], gradient)
                flows[i, 3:] += gradient @ flows[i, :3]
            else:
                flows[i, :3] = water.v_c_W
        swing(cable, state, R_WB, plant.gravity_W, flows, surfaces, walls)


@kernel
def add_pulls(effects, R_WB, tau):
    """Add the forces of :func:`find_pulls` to tau (6,) [N, N m, B]."""
    if effects.cable.shape[0] != 0 and effects.cable[0].timestep > 0.0:
        add_pull(effects.cable[0], effects.cable_state[0], R_WB, tau)
    for k in range(effects.couplings.shape[0]):
        tau += effects.couplings_state[k].tau


@kernel
def advance_effects(effects, nu_r, tau_cmd, h):
    """Advance the states of all effects by a time step h [s], which begins with the velocity nu_r (6,) relative to the
    water [m/s, rad/s, B], and in which tau_cmd (6,) is commanded [N, N m, B]."""
    for k in range(effects.fins.shape[0]):
        if effects.fins[k].limit > 0.0:
            effects.fins_state[k] = deflected(effects.fins[k], effects.fins_state[k], tau_cmd, h)
    if effects.cable.shape[0] != 0 and effects.cable[0].timestep > 0.0:
        advance_cable(effects.cable[0], effects.cable_state[0])


@kernel
def add_tether(tether, nu_r, tau):
    """Add the drag of a tether."""
    w = -velocity_at(nu_r, tether.r)
    f = tether.factor * math.sqrt(w @ w) * w
    tau[:3] += f
    tau[3:] += cross(tether.r, f)


@kernel
def add_fin(fin, delta, nu_r, tau):
    """Add lift and drag of a fin with the deflection delta [rad] beyond the fixed one."""
    r, R = fin.r, fin.R_BF
    v = R.T @ velocity_at(nu_r, r)
    v[2] = 0.0
    C_L, C_D = fin_coefficients(fin, math.atan2(v[1], v[0]) - delta)
    lift = C_L * cross(np.array([0.0, 0.0, 1.0]), v)
    f = R @ (-fin.factor * math.sqrt(v @ v) * (lift + C_D * v))
    tau[:3] += f
    tau[3:] += cross(r, f)


@kernel
def deflected(fin, delta, tau_cmd, h) -> float:
    """The deflection of a fin one time step h [s] after delta [rad]."""
    wanted, kept = min(fin.limit, max(-fin.limit, fin.mixing @ tau_cmd)), 0.0
    if 700.0 * fin.lag > h:  # nothing is kept of a shorter one
        kept = math.exp(-h / fin.lag)
    most = fin.rate * h
    return delta + min(most, max(-most, (1.0 - kept) * (wanted - delta)))


@kernel
def fin_coefficients(fin, alpha):
    """C_L and C_D at an angle of attack [rad]."""
    if alpha > 0.5 * math.pi:  # a plate has no front
        alpha -= math.pi
    elif alpha < -0.5 * math.pi:
        alpha += math.pi
    if abs(alpha) <= fin.stall:
        C_L = fin.lift_slope * alpha
        return C_L, fin.drag + fin.induced * C_L * C_L
    most = fin.lift_slope * fin.stall
    at_stall, sine, cosine = fin.drag + fin.induced * most * most, math.sin(fin.stall), math.cos(fin.stall)
    part = (math.sin(alpha) ** 2 - sine * sine) / (cosine * cosine)
    return most * math.sin(2.0 * alpha) / (2.0 * sine * cosine), at_stall + (fin.across - at_stall) * part


@kernel
def add_drag(drag, nu_r, tau):
    """Add the drag at a place."""
    v = velocity_at(nu_r, drag.r)
    c = np.where(v > 0.0, drag.forward, drag.backward)
    speed = math.sqrt(v @ v) * np.ones(3) if drag.of_speed != 0 else np.abs(v)
    f = -c * speed * v
    tau[:3] += f
    tau[3:] += cross(drag.r, f)


@kernel
def add_product(product, nu_r, tau):
    """Add a product of velocities."""
    second = abs(nu_r[product.second]) if product.bars != 0 else nu_r[product.second]
    tau[product.axis] += product.coefficient * nu_r[product.first] * second
