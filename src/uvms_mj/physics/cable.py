r"""A cable that moves: lumped nodes between a fixed or moving end, the anchor, and a point of the vehicle.

N elements join N + 1 nodes. An element is a spring without bending stiffness, which pulls and can't push, along the
unit vector e from its first node to its second one. A node has the mass m, weight, buoyancy and drag of half of each
element beside it (Morison; Walton and Polachek 1960; Hall and Goupee, "Validation of a lumped-mass mooring line model",
Ocean Eng. 104, 2015). With its velocity w relative to the water, its tangent t, and the parts of w along and across it,

.. math::

    (m + m_a P)\, \dot v = (m - \rho V) g + (\rho V + m_a P)\, a_c - D w + T_+ e_+ - T_- e_-, \qquad
    D = \tfrac12 \rho d \ell \left( C_n |w_n| P + \pi C_t |w_t|\, t t^\top \right),

with :math:`P = I - t t^\top`, :math:`m_a = C_a \rho V`, and the acceleration a_c of the water that passes.

**Step.** The tensions of a step are implicit, so that no axial stiffness limits it. With the length l and the
compliance :math:`c = \ell/EA`, which may be zero, each element has

.. math::

    T \ge 0, \qquad c\, T - (l + h\, e^\top \Delta v^{+} - \ell) \ge 0, \qquad \text{one of both zero},

for the difference of the velocities of its nodes at the end of the step, which are linear in the tensions: one
tridiagonal system for the elements that pull. Which ones pull is found by trying. Drag is linearly implicit: |w| is of
the beginning. :math:`h^2 (T_+/l_+ + T_-/l_-)` of the step before is added to what a node's acceleration across the
tangent meets, and to nothing else. It slows the waves of a string by :math:`(h c/\ell)^2` of themselves, and keeps them
stable at every step.

**The vehicle's end.** There the vehicle's apparent mass :math:`\Lambda = (J M^{-1} J^\top)^{-1}` is in the same
equations. All other forces on the vehicle belong to the step before, known from the point's acceleration a and the
cable's force f of that step:

.. math::

    \Lambda\, (v^+ - v)/h = \Lambda\, a^{-} - f^{-} + f.

So no force is found before the cable's, in no engine, and an error of the prediction is mended in the next step.

**Contact.** A node below the floor or inside a wall of the run feels a spring and a damper of 100 Hz along the normal
n, critically damped and without friction, where it is deepest. With the depth :math:`\delta` and the wall's velocity
:math:`v_w` they are implicit, too,

.. math::

    f = (m + m_a)\, \omega \left( \omega \delta - (h \omega + 2)\, n^\top (v^+ - v_w) \right),

and change the inverse of the node by a matrix of rank one. An element between two nodes touches nothing.
"""

import math
from typing import Any

import numpy as np

from .frames import to_body, to_world, velocity_at
from .kernels import kernel
from .surfaces import signed_distance, surface_velocity

CABLE = np.dtype(
    [
        ("timestep", "f8"),  # h [s]
        ("r", "f8", (3,)),  # of its end on the vehicle in B [m]
        ("inertia", "f8", (3, 3)),  # Lambda in B [kg]
        # the anchor
        ("place", "f8", (3,)),  # at t = 0, without the sine [m, W]
        ("velocity", "f8", (3,)),  # [m/s, W]
        ("amplitude", "f8", (3,)),  # of a sine [m, W]
        ("omega", "f8"),  # [rad/s]
        # an element
        ("length", "f8"),  # without tension [m]
        ("compliance", "f8"),  # c [m/N]
        ("mass", "f8"),  # [kg]
        ("displaced", "f8"),  # rho V [kg]
        ("added", "f8"),  # m_a [kg]
        ("drag_across", "f8"),  # [N s^2/m^2]
        ("drag_along", "f8"),  # [N s^2/m^2]
        ("floor", "f8"),  # z of the floor, -inf without one [m]
    ],
    align=True,
)
"""One cable. Without a record of it, after a reset, its time step is zero."""
NODE = np.dtype([("start", "f8", (3,))], align=True)
"""A node of a cable: where it begins in W [m]."""
STOP = 2.0 * math.pi * 100.0
"""Angular frequency of a node in contact [rad/s]."""
_SHORT = 1e-9
"""An element that is shorter, relative to its length without tension, has no direction, and does not pull."""


def cable_state(nodes: int) -> np.dtype:
    """The states of a cable with so many nodes, all zero before it begins: positions, velocities, tensions of the
    elements, and both of the step's end."""
    fields: list[Any] = [
        ("begun", "f8"),
        ("p", "f8", (nodes, 3)),  # [m, W]
        ("tension", "f8", (max(nodes - 1, 0),)),  # of the step in hand [N]
        ("v", "f8", (nodes, 3)),  # [m/s, W]
        ("v_next", "f8", (nodes, 3)),
        ("before", "f8", (max(nodes - 1, 0),)),  # tension of the step before [N]
        ("f", "f8", (3,)),  # on the vehicle [N, W]
        ("f_before", "f8", (3,)),  # in the step before
        ("v_before", "f8", (3,)),  # of the end [m/s, W]
    ]
    return np.dtype(fields, align=True)


@kernel
def anchor_at(cable, t, p):
    """Set p (3,) to the place of the anchor at the time t [s], in W."""
    p[:] = cable.place + t * cable.velocity + math.sin(cable.omega * t) * cable.amplitude


@kernel
def place_ends(cable, nodes, state, t, p_WB, R_WB, nu):
    """Put both ends of a cable where they are at the time t [s]; at its beginning all other nodes where they begin."""
    p, v, n, r_W, next_p = state.p, state.v, state.p.shape[0] - 1, np.zeros(3), np.zeros(3)
    to_world(R_WB, cable.r, r_W)
    anchor_at(cable, t, p[0])
    anchor_at(cable, t + cable.timestep, next_p)
    p[n] = p_WB[:3] + r_W
    to_world(R_WB, velocity_at(nu, cable.r), v[n])
    state.v_next[0] = (next_p - p[0]) / cable.timestep
    if state.begun == 0.0:
        state.begun = 1.0
        v[0], state.v_before[:] = state.v_next[0], v[n]
        for i in range(1, n):
            p[i] = nodes[i].start
            v[i] = 0.0


NODE_MATRIX = ("across", "more_along", "low", "high", "both", "share")
"""Columns of the inverse A^-1 = a_n I + (a_t - a_n) t t^T - s z z^T of a node: a_n, a_t - a_n, its products with the
directions of the elements below and above it, twice with one and once with both, and s, zero without contact."""
_ACROSS, _MORE, _LOW, _HIGH, _BOTH, _SHARE = range(len(NODE_MATRIX))


@kernel
def swing(cable, state, R_WB, gravity_W, flows, surfaces, walls):
    """Find the tensions of a step, the velocities at its end, and the force on the vehicle. The rows of flows (n, 6)
    are the velocity of the water at each node and its acceleration along its path [m/s, m/s^2, W]. So many of the
    SURFACE records ``surfaces`` are walls."""
    p, v, u, h = state.p, state.v, state.v_next, cable.timestep
    n = p.shape[0] - 1
    e, lengths, per_length = np.zeros((n, 3)), np.zeros(n), np.zeros(n)
    t, z, A = np.zeros((n + 1, 3)), np.zeros((n + 1, 3)), np.zeros((n + 1, len(NODE_MATRIX)))
    for j in range(n):
        d = p[j + 1] - p[j]
        lengths[j] = math.sqrt(d @ d)
        if lengths[j] > _SHORT * cable.length:
            per_length[j] = 1.0 / lengths[j]
            e[j] = per_length[j] * d
    weight, out = (cable.mass - cable.displaced) * gravity_W, np.zeros(3)
    for i in range(1, n):
        below, above = e[i - 1], e[i]
        chord = below + above
        size = chord @ chord
        if size > _SHORT:  # no tangent where the cable turns back
            t[i] = (1.0 / math.sqrt(size)) * chord
        w = v[i] - flows[i, :3]
        along = t[i] @ w
        D_n = cable.drag_across * math.sqrt(max(0.0, w @ w - along * along))
        D_t = cable.drag_along * abs(along)
        stiff = state.before[i - 1] * per_length[i - 1] + state.before[i] * per_length[i]
        a_n = 1.0 / (cable.mass + cable.added + h * (D_n + h * stiff))
        more = 1.0 / (cable.mass + h * D_t) - a_n
        a_c = flows[i, 3:]
        f = weight + (cable.displaced + cable.added) * a_c - D_n * w
        f -= (cable.added * (a_c @ t[i]) + (D_t - D_n) * along) * t[i]
        a, k_low, k_high = a_n * f + more * (t[i] @ f) * t[i], t[i] @ below, t[i] @ above
        A[i, _ACROSS], A[i, _MORE] = a_n, more
        A[i, _LOW], A[i, _HIGH] = a_n + more * k_low * k_low, a_n + more * k_high * k_high
        A[i, _BOTH] = a_n * (below @ above) + more * k_low * k_high
        depth, wall = cable.floor - p[i, 2], -1
        for k in range(walls):
            inside = -signed_distance(surfaces[k], p[i], out)
            if inside > depth:
                depth, wall = inside, k
        if depth > 0.0:
            touch(cable, surfaces, wall, depth, p[i], v[i], t[i], below, above, A[i], z[i], a)
        u[i] = v[i] + h * a
    low = np.zeros(3)
    end_of(cable, state, R_WB, gravity_W, flows[n], e[n - 1], u[n], low)
    A[n, _LOW] = e[n - 1] @ low
    tensions(cable, state, e, lengths, u, A)
    T = state.tension
    for i in range(1, n):
        pull = T[i] * e[i] - T[i - 1] * e[i - 1]
        u[i] += h * (A[i, _ACROSS] * pull + (A[i, _MORE] * (t[i] @ pull)) * t[i])
        if A[i, _SHARE] != 0.0:
            u[i] -= h * A[i, _SHARE] * (z[i] @ pull) * z[i]
    u[n] -= h * T[n - 1] * low
    state.f[:] = -T[n - 1] * e[n - 1]
    half_element(cable, v[n], flows[n], e[n - 1], gravity_W, (u[n] - v[n]) / h, state.f)


@kernel
def touch(cable, surfaces, wall, depth, p, v, t, below, above, A, z, a):
    """Change the inverse of a node at a depth [m] inside a wall, or below the floor with a wall of -1, and its
    acceleration a (3,) without tension, by the spring and the damper there: a matrix of rank one (Sherman and
    Morrison)."""
    n, rate = np.array([0.0, 0.0, 1.0]), v[2]
    if wall >= 0:
        signed_distance(surfaces[wall], p, n)
        v_wall = np.zeros(3)
        surface_velocity(surfaces[wall], p, v_wall)
        rate = n @ (v - v_wall)
    h, m = cable.timestep, cable.mass + cable.added
    stop = m * STOP * (h * STOP + 2.0)
    push = m * STOP * STOP * depth - stop * rate
    if push <= 0.0:
        return
    z[:] = A[_ACROSS] * n + (A[_MORE] * (t @ n)) * t
    a += push * z
    share = h * stop / (1.0 + h * stop * (n @ z))
    a -= share * (n @ a) * z
    at_low, at_high = z @ below, z @ above
    A[_LOW] -= share * at_low * at_low
    A[_HIGH] -= share * at_high * at_high
    A[_BOTH] -= share * at_low * at_high
    A[_SHARE] = share


@kernel
def settle(cable, nodes, state, gravity_W, flows, p_WB, surfaces, steps, walls):
    """Let a cable whose ends are held go to its rest in water that moves by the rows of flows (n, 6), among so many
    walls: at each peak of its kinetic energy all of it is stopped (Day 1965). Ends at rest, or after so many steps."""
    R_WB, nu, before, n = np.eye(3), np.zeros(6), 0.0, state.p.shape[0] - 1
    for _ in range(steps):
        place_ends(cable, nodes.nodes, state, 0.0, p_WB, R_WB, nu)
        swing(cable, state, R_WB, gravity_W, flows, surfaces, walls)
        advance_cable(cable, state)
        energy = 0.0
        for i in range(1, n):
            energy += state.v[i] @ state.v[i]
        if energy < before:
            if before < 1e-16:
                break
            state.v[:], energy = 0.0, 0.0
        before = energy


@kernel
def half_matrices(cable, v, flow, t, mass, drag):
    """Set mass (3, 3) and drag (3, 3) of the half element at the vehicle [kg, N s/m]."""
    w = v - flow[:3]
    along = w @ t
    across = w - along * t
    tt = np.outer(t, t)
    P = np.eye(3) - tt
    mass[:] = 0.5 * (cable.mass * np.eye(3) + cable.added * P)
    drag[:] = 0.5 * (cable.drag_across * math.sqrt(across @ across) * P + cable.drag_along * abs(along) * tt)


@kernel
def half_forces(cable, flow, t, gravity_W):
    """Weight, buoyancy and the force of accelerated water on the half element at the vehicle [N, W]."""
    a_c = flow[3:]
    f = (cable.mass - cable.displaced) * gravity_W + cable.displaced * a_c + cable.added * (a_c - (a_c @ t) * t)
    return 0.5 * f


@kernel
def half_element(cable, v, flow, t, gravity_W, a, f):
    """Add to f (3,) what the half element at the vehicle pulls with at the acceleration a (3,)."""
    mass, drag = np.zeros((3, 3)), np.zeros((3, 3))
    half_matrices(cable, v, flow, t, mass, drag)
    f += half_forces(cable, flow, t, gravity_W) - drag @ (v + cable.timestep * a - flow[:3]) - mass @ a


@kernel
def end_of(cable, state, R_WB, gravity_W, flow, t, u, low):
    """Set the velocity u (3,) of the vehicle's end without tension, its change ``low`` (3,) by tension, and state.f to
    zero."""
    h, v = cable.timestep, state.v[state.p.shape[0] - 1]
    mass, drag = np.zeros((3, 3)), np.zeros((3, 3))
    half_matrices(cable, v, flow, t, mass, drag)
    inertia = R_WB @ cable.inertia @ R_WB.T
    f = inertia @ ((v - state.v_before) / h) - state.f_before
    f += half_forces(cable, flow, t, gravity_W) - drag @ (v - flow[:3])
    A = np.linalg.inv(inertia + mass + h * drag)
    u[:] = v + h * (A @ f)
    low[:] = A @ t
    state.f[:] = 0.0


@kernel
def tensions(cable, state, e, lengths, u, A):
    """Set the tensions (n,) for the directions e (n, 3) and lengths (n,) of the elements, the velocities u (n + 1, 3)
    without tension, and A (n + 1, 6) of the nodes: a linear complementarity problem with a tridiagonal matrix."""
    n, h, T = lengths.shape[0], cable.timestep, state.tension
    main, off, right = np.zeros(n), np.zeros(n), np.zeros(n)  # off: with the next element
    pulls, c, x = np.zeros(n), np.zeros(n), np.zeros(n)
    for j in range(n):
        main[j] = cable.compliance + h * h * (A[j + 1, _LOW] + A[j, _HIGH])
        off[j] = -h * h * A[j + 1, _BOTH]
        right[j] = lengths[j] - cable.length + h * (e[j] @ (u[j + 1] - u[j]))
        if state.before[j] > 0.0 or right[j] > 0.0:
            pulls[j] = 1.0
    for _ in range(2 * n + 2):
        solve_pulling(main, off, right, pulls, c, x, T)
        if not changed(main, off, right, pulls, T):
            break
    for j in range(n):
        T[j] = max(0.0, T[j])


@kernel
def solve_pulling(main, off, right, pulls, c, x, T):
    """Solve for the tensions T (n,) of the elements that pull; all others have none (Thomas)."""
    n, back, c_before, x_before = T.shape[0], 0.0, 0.0, 0.0
    for j in range(n):
        pivot, value = main[j] - back * c_before, right[j] - back * x_before
        c_before, x_before, back = 0.0, 0.0, off[j]
        if pulls[j] != 0.0 and pivot > 0.0:
            per_pivot = 1.0 / pivot
            c_before, x_before = back * per_pivot, value * per_pivot
        c[j], x[j] = c_before, x_before
    behind = 0.0
    for k in range(n):
        behind = x[n - 1 - k] - c[n - 1 - k] * behind
        T[n - 1 - k] = behind


@kernel
def changed(main, off, right, pulls, T) -> bool:
    """Let go of elements that would push, and let elements pull that would get too long. Returns whether there was
    any."""
    n, any_changed = T.shape[0], False
    for j in range(n):
        if pulls[j] != 0.0:
            if T[j] < 0.0:
                pulls[j], any_changed = 0.0, True
        else:
            rest = right[j]
            if j > 0:
                rest -= off[j - 1] * T[j - 1]
            if j + 1 < n:
                rest -= off[j] * T[j + 1]
            if rest > 0.0 and main[j] > 0.0:
                pulls[j], any_changed = 1.0, True
    return any_changed


@kernel
def add_pull(cable, state, R_WB, tau):
    """Add the force of a cable to tau (6,) [N, N m, B]."""
    f = np.zeros(3)
    to_body(R_WB, state.f, f)
    tau[:3] += f
    tau[3:] += np.cross(cable.r, f)


@kernel
def advance_cable(cable, state):
    """Go to the end of the step whose velocities and tensions are known."""
    n = state.p.shape[0] - 1
    state.f_before[:], state.v_before[:] = state.f, state.v[n]
    for i in range(n):
        state.v[i] = state.v_next[i]
        state.p[i] += cable.timestep * state.v[i]
    state.before[:] = state.tension
