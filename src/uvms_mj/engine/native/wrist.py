"""The stages around a wrist sensor: the wrench that it is exposed to, and the contact wrench behind its reading."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ...physics.carriers import add_turned
from ...physics.frames import to_body, to_world
from ...physics.kernels import kernel
from ...physics.tree import coriolis_wrench, damping_wrench, hand_down, move, restoring_wrench
from ...stages.base import Room, Stage
from ...stages.joint_signals import WRIST_TRUE
from ...stages.signals import CLOCK, KNOWN, TRUE
from .layouts import CARRIER_SIZE, LINK_SIZE
from .memory import carrier_at, context_at, floats, link_at, loop_at
from .tree import place_links


@kernel
def carried_wrench(tree, first, moving, q, q_dot, q_ddot, part):
    """Set f of the link ``first`` to the wrench that keeps it and all that it carries in their motion, or at rest if
    ``moving`` is 0, without contacts. nu, a and gravity of the base are set; ``part`` is (6,) scratch."""
    place_links(tree, q)
    for k in range(1, tree.links):
        link = link_at(tree.links_at + LINK_SIZE * k)
        move(link, link_at(tree.links_at + LINK_SIZE * link.parent), q_dot[k - 1])
        for i in range(6):
            link.a[i] += link.S[i] * q_ddot[k - 1]
    for k in range(first, tree.links):
        link = link_at(tree.links_at + LINK_SIZE * k)
        restoring_wrench(link, link.f)
        if moving != 0:
            coriolis_wrench(link, part)
            for i in range(6):
                link.f[i] += part[i]
            damping_wrench(link, part)
            for i in range(6):
                link.f[i] += part[i]
    for k in range(tree.links - 1, first, -1):
        link = link_at(tree.links_at + LINK_SIZE * k)
        hand_down(link, link_at(tree.links_at + LINK_SIZE * link.parent))


@kernel
def at_sensor(wrist, f, out):
    """Set out (6,) to a wrench f (6,) at the link's origin, in its axes, as one at the sensor's origin in S."""
    R, p, m = wrist.R_LS, wrist.p_LS, wrist.moment
    m[0] = f[3] - (p[1] * f[2] - p[2] * f[1])
    m[1] = f[4] - (p[2] * f[0] - p[0] * f[2])
    m[2] = f[5] - (p[0] * f[1] - p[1] * f[0])
    for i in range(3):
        out[i] = R[0, i] * f[0] + R[1, i] * f[1] + R[2, i] * f[2]
        out[i + 3] = R[0, i] * m[0] + R[1, i] * m[1] + R[2, i] * m[2]


@kernel
def felt_wrench(wrist, true, out):
    """Set out (6,) to the true wrench of the parent on the links behind the sensor, in S."""
    n, water = wrist.n, context_at(wrist.context_at).water
    q, q_dot, q_ddot = floats(wrist.q_at, n), floats(wrist.q_dot_at, n), floats(wrist.q_ddot_at, n)
    rigid, wet, nu, v_c = link_at(wrist.rigid.links_at), link_at(wrist.wet.links_at), true.nu, wrist.work
    to_body(true.R_WB, true.v_c_W, v_c)
    for i in range(3):
        rigid.nu[i], rigid.nu[i + 3] = nu[i], nu[i + 3]
        rigid.a[i], rigid.a[i + 3] = true.nu_dot[i], true.nu_dot[i + 3]
        wet.nu[i], wet.nu[i + 3] = nu[i] - v_c[i], nu[i + 3]
        wet.a[i + 3] = true.nu_dot[i + 3]
    p, q_B, r = nu[3], nu[4], nu[5]
    a_x = true.nu_dot[0] + q_B * v_c[2] - r * v_c[1]  # v_r_dot = v_dot + omega x v_c - R^T v_c_dot
    a_y = true.nu_dot[1] + r * v_c[0] - p * v_c[2]
    a_z = true.nu_dot[2] + p * v_c[1] - q_B * v_c[0]
    to_body(true.R_WB, water.v_c_dot_W, v_c)
    wet.a[0], wet.a[1], wet.a[2] = a_x - v_c[0], a_y - v_c[1], a_z - v_c[2]
    to_body(true.R_WB, wrist.gravity_W, rigid.gravity)
    for i in range(3):
        wrist.moment[i] = wrist.gravity_W[i] - water.a_c_W[i]  # of the displaced water
    to_body(true.R_WB, wrist.moment, wet.gravity)
    carried_wrench(wrist.rigid, wrist.link, 1, q, q_dot, q_ddot, wrist.work)
    carried_wrench(wrist.wet, wrist.link, 1, q, q_dot, q_ddot, wrist.work)
    solid, around = (
        link_at(wrist.rigid.links_at + LINK_SIZE * wrist.link),
        link_at(wrist.wet.links_at + LINK_SIZE * wrist.link),
    )
    for i in range(6):
        solid.f[i] += around.f[i]
    context = context_at(wrist.context_at)
    if context.carriers != 0:
        release(context, wrist, solid)
    for i in range(6):
        wrist.work[i] = solid.f[i]
    at_sensor(wrist, wrist.work, out)


@kernel
def release(context, wrist, first):
    """Subtract the contact forces on the links behind the sensor from f of the first of them."""
    loop, tree, tau_B = loop_at(context.loop_at), wrist.rigid, wrist.modelled
    for i in range(6):
        tau_B[i] = 0.0
    for k in range(context.carriers):
        carrier = carrier_at(loop.carriers_at + CARRIER_SIZE * k)
        above = carrier.link
        for _ in range(link_at(tree.links_at + LINK_SIZE * carrier.link).depth):
            if above == wrist.link:
                add_turned(carrier.R_BC, carrier.p_BC, carrier.tau, tau_B)
            above = link_at(tree.links_at + LINK_SIZE * above).parent
    R, p = first.R_BL, first.p_BL
    x = tau_B[3] - (p[1] * tau_B[2] - p[2] * tau_B[1])  # the moment about the link's origin, in B
    y = tau_B[4] - (p[2] * tau_B[0] - p[0] * tau_B[2])
    z = tau_B[5] - (p[0] * tau_B[1] - p[1] * tau_B[0])
    for i in range(3):
        first.f[i] -= R[0, i] * tau_B[0] + R[1, i] * tau_B[1] + R[2, i] * tau_B[2]
        first.f[i + 3] -= R[0, i] * x + R[1, i] * y + R[2, i] * z


@kernel
def modelled_wrench(wrist, instant, period, R_WB, nu):
    """Set ``modelled`` (6,) to the wrench without contacts by the model, from the measured state."""
    n, base = wrist.n, link_at(wrist.model.links_at)
    q, q_dot, q_ddot = floats(wrist.q_m_at, n), floats(wrist.q_dot_m_at, n), floats(wrist.q_ddot_m_at, n)
    before, q_dot_before = wrist.nu_before, floats(wrist.q_dot_before_at, n)
    for i in range(6):
        base.nu[i] = nu[i]
        base.a[i] = (nu[i] - before[i]) / period if instant > 0 else 0.0
        before[i] = nu[i]
    for k in range(n):
        q_ddot[k] = (q_dot[k] - q_dot_before[k]) / period if instant > 0 else 0.0
        q_dot_before[k] = q_dot[k]
    to_body(R_WB, wrist.gravity_W, base.gravity)
    carried_wrench(wrist.model, wrist.link, wrist.dynamic, q, q_dot, q_ddot, wrist.work)
    at_sensor(wrist, link_at(wrist.model.links_at + LINK_SIZE * wrist.link).f, wrist.modelled)


@kernel
def contact_behind(wrist, R_WB, out):
    """Set the measured contact force in W and the wrench at B of ``out`` to what the model leaves of the reading."""
    reading, link = floats(wrist.reading_at, 6), link_at(wrist.model.links_at + LINK_SIZE * wrist.link)
    R, p, f, m, tau = link.R_BL, link.p_BL, wrist.work, wrist.moment, out.tau_contact_m_B
    for i in range(6):
        f[i] = (wrist.modelled[i] if wrist.weighs != 0 else 0.0) - reading[i]
    x, y, z = f[0], f[1], f[2]
    to_world(wrist.R_LS, f, m)  # the force in the link's axes
    a = wrist.R_LS[0, 0] * f[3] + wrist.R_LS[0, 1] * f[4] + wrist.R_LS[0, 2] * f[5]
    b = wrist.R_LS[1, 0] * f[3] + wrist.R_LS[1, 1] * f[4] + wrist.R_LS[1, 2] * f[5]
    c = wrist.R_LS[2, 0] * f[3] + wrist.R_LS[2, 1] * f[4] + wrist.R_LS[2, 2] * f[5]
    s = wrist.p_LS
    a += s[1] * m[2] - s[2] * m[1]  # the moment about the link's origin
    b += s[2] * m[0] - s[0] * m[2]
    c += s[0] * m[1] - s[1] * m[0]
    x, y, z = m[0], m[1], m[2]
    for i in range(3):
        tau[i] = R[i, 0] * x + R[i, 1] * y + R[i, 2] * z
        tau[i + 3] = R[i, 0] * a + R[i, 1] * b + R[i, 2] * c
    tau[3] += p[1] * tau[2] - p[2] * tau[1]
    tau[4] += p[2] * tau[0] - p[0] * tau[2]
    tau[5] += p[0] * tau[1] - p[1] * tau[0]
    to_world(R_WB, tau, out.f_contact_m_W)


@dataclass(frozen=True)
class Felt(Stage):
    """The wrench that the wrist sensor is exposed to. ``state`` is the WRIST record."""

    name = "felt"
    needs: ClassVar = ()
    room: ClassVar[Room] = Room("navigation", "felt", lambda thrusters: CLOCK + TRUE, (WRIST_TRUE,))

    @staticmethod
    def step(settings, state, given, state_dot, out):
        felt_wrench(state, given, out)


@dataclass(frozen=True)
class Derived(Stage):
    """The contact force and wrench that are derived from the reading. ``state`` is the WRIST record."""

    name = "derived"
    needs: ClassVar = ()
    room: ClassVar[Room] = Room("navigation", "derived", lambda thrusters: CLOCK + KNOWN[:4], KNOWN[4:])

    @staticmethod
    def step(settings, state, given, state_dot, out):
        modelled_wrench(state, given.instant, given.period, given.R_WB, given.nu)
        contact_behind(state, given.R_WB, out)
