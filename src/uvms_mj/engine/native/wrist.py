"""The stages around a wrist sensor: the wrench that it is exposed to, and the contact wrench behind its reading."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ...physics.frames import add_wrench_from, compose_poses, to_body, to_world, wrench_at
from ...physics.kernels import kernel
from ...physics.tree import coriolis_wrench, damping_wrench, hand_down, move, move_frame, restoring_wrench
from ...stages.base import Room, Stage
from ...stages.joint_signals import WRIST_TRUE
from ...stages.signals import CLOCK, MEASURED, TRUE
from .layouts import CARRIER_SIZE, FRAME_SIZE, LINK_SIZE
from .memory import carrier_at, context_at, floats, frame_at, link_at, loop_at
from .tree import place_links


@kernel
def carried_wrench(tree, first, moving, q_dot, q_ddot, part):
    """Set F of the link ``first`` to the wrench that keeps it and all that it carries in their motion, or at rest if
    ``moving`` is 0, without contacts. Frames, gravity, and V and A of the base are set; ``part`` is (6,) scratch."""
    for k in range(1, tree.links):
        link, frame = link_at(tree.links_at + LINK_SIZE * k), frame_at(tree.frames_at + FRAME_SIZE * k)
        move(link, frame.S, link_at(tree.links_at + LINK_SIZE * frame.parent), q_dot[k - 1])
        for i in range(6):
            link.A[i] += frame.S[i] * q_ddot[k - 1]
        move_frame(link, frame)
    for k in range(first, tree.links):
        link, frame = link_at(tree.links_at + LINK_SIZE * k), frame_at(tree.frames_at + FRAME_SIZE * k)
        restoring_wrench(link, frame, tree.gravity_B, link.F)
        if moving != 0:
            coriolis_wrench(link, part)
            add_wrench_from(frame.R_BL, frame.p_BL, part, link.F)
            damping_wrench(link, part)
            add_wrench_from(frame.R_BL, frame.p_BL, part, link.F)
    for k in range(tree.links - 1, first, -1):
        frame = frame_at(tree.frames_at + FRAME_SIZE * k)
        hand_down(link_at(tree.links_at + LINK_SIZE * k), link_at(tree.links_at + LINK_SIZE * frame.parent))


@kernel
def place_sensor(sensor, frame):
    """Set the pose of the sensor in B from that of the link behind it."""
    compose_poses(frame.R_BL, frame.p_BL, sensor.R_LT, sensor.p_LT, sensor.R_BT, sensor.p_BT)


@kernel
def felt_wrench(wrist, true, out):
    """Set out (6,) to the true wrench of the parent on the links behind the sensor, in S."""
    n, water = wrist.n, context_at(wrist.context_at).water
    q_dot, q_ddot = floats(wrist.q_dot_at, n), floats(wrist.q_ddot_at, n)
    rigid, wet, nu, v_c = link_at(wrist.rigid.links_at), link_at(wrist.wet.links_at), true.nu, wrist.work
    to_body(true.R_WB, true.v_c_W, v_c)
    for i in range(3):
        rigid.V[i], rigid.V[i + 3] = nu[i], nu[i + 3]
        rigid.A[i], rigid.A[i + 3] = true.nu_dot[i], true.nu_dot[i + 3]
        wet.V[i], wet.V[i + 3] = nu[i] - v_c[i], nu[i + 3]
        wet.A[i + 3] = true.nu_dot[i + 3]
    p, q_B, r = nu[3], nu[4], nu[5]
    a_x = true.nu_dot[0] + q_B * v_c[2] - r * v_c[1]  # v_r_dot = v_dot + omega x v_c - R^T v_c_dot
    a_y = true.nu_dot[1] + r * v_c[0] - p * v_c[2]
    a_z = true.nu_dot[2] + p * v_c[1] - q_B * v_c[0]
    to_body(true.R_WB, water.v_c_dot_W, v_c)
    wet.A[0], wet.A[1], wet.A[2] = a_x - v_c[0], a_y - v_c[1], a_z - v_c[2]
    to_body(true.R_WB, wrist.gravity_W, wrist.rigid.gravity_B)
    for i in range(3):
        wrist.moment[i] = wrist.gravity_W[i] - water.a_c_W[i]  # of the displaced water
    to_body(true.R_WB, wrist.moment, wrist.wet.gravity_B)
    carried_wrench(wrist.rigid, wrist.sensor.link, 1, q_dot, q_ddot, wrist.work)
    carried_wrench(wrist.wet, wrist.sensor.link, 1, q_dot, q_ddot, wrist.work)
    at = LINK_SIZE * wrist.sensor.link
    solid, around = link_at(wrist.rigid.links_at + at), link_at(wrist.wet.links_at + at)
    for i in range(6):
        solid.F[i] += around.F[i]
    context = context_at(wrist.context_at)
    if context.carriers != 0:
        release(context, wrist, solid)
    place_sensor(wrist.sensor, frame_at(wrist.rigid.frames_at + FRAME_SIZE * wrist.sensor.link))
    wrench_at(wrist.sensor.R_BT, wrist.sensor.p_BT, solid.F, out)


@kernel
def release(context, wrist, first):
    """Subtract the contact forces on the links behind the sensor from F of the first of them."""
    loop, tree, tau_B = loop_at(context.loop_at), wrist.rigid, wrist.work
    for i in range(6):
        tau_B[i] = 0.0
    for k in range(context.carriers):
        carrier = carrier_at(loop.carriers_at + CARRIER_SIZE * k)
        above = carrier.link
        for _ in range(frame_at(tree.frames_at + FRAME_SIZE * carrier.link).depth):
            if above == wrist.sensor.link:
                add_wrench_from(carrier.R_BC, carrier.p_BC, carrier.tau, tau_B)
            above = frame_at(tree.frames_at + FRAME_SIZE * above).parent
    for i in range(6):
        first.F[i] -= tau_B[i]


@kernel
def modelled_wrench(wrist, instant, period, R_WB, nu):
    """Set ``modelled`` (6,) to the wrench without contacts by the model, from the measured state."""
    n, base = wrist.n, link_at(wrist.model.links_at)
    q_dot, q_ddot = floats(wrist.q_dot_m_at, n), floats(wrist.q_ddot_m_at, n)
    before, q_dot_before = wrist.nu_before, floats(wrist.q_dot_before_at, n)
    for i in range(6):
        base.V[i] = nu[i]
        base.A[i] = (nu[i] - before[i]) / period if instant > 0 else 0.0
        before[i] = nu[i]
    for k in range(n):
        q_ddot[k] = (q_dot[k] - q_dot_before[k]) / period if instant > 0 else 0.0
        q_dot_before[k] = q_dot[k]
    to_body(R_WB, wrist.gravity_W, wrist.model.gravity_B)
    if wrist.places != 0:
        place_links(wrist.model, floats(wrist.q_m_at, n))
    carried_wrench(wrist.model, wrist.sensor.link, wrist.dynamic, q_dot, q_ddot, wrist.work)
    first = link_at(wrist.model.links_at + LINK_SIZE * wrist.sensor.link)
    place_sensor(wrist.sensor, frame_at(wrist.model.frames_at + FRAME_SIZE * wrist.sensor.link))
    wrench_at(wrist.sensor.R_BT, wrist.sensor.p_BT, first.F, wrist.modelled)


@kernel
def contact_behind(wrist, R_WB, out):
    """Set the measured contact force in W and the wrench at B of ``out`` to what the model leaves of the reading."""
    reading, f, tau = floats(wrist.reading_at, 6), wrist.work, out.tau_contact_m_B
    for i in range(6):
        f[i] = (wrist.modelled[i] if wrist.weighs != 0 else 0.0) - reading[i]
        tau[i] = 0.0
    add_wrench_from(wrist.sensor.R_BT, wrist.sensor.p_BT, f, tau)
    to_world(R_WB, tau, out.f_contact_m_W)


@dataclass(frozen=True)
class Felt(Stage):
    """The wrench that the wrist sensor is exposed to. ``state`` is the WRIST record."""

    name = "felt"
    room: ClassVar[Room] = Room("navigation", "felt", lambda thrusters: CLOCK + TRUE, (WRIST_TRUE,))

    @staticmethod
    def step(settings, state, given, state_dot, out):
        felt_wrench(state, given, out)


@dataclass(frozen=True)
class Derived(Stage):
    """The contact force and wrench that are derived from the reading. ``state`` is the WRIST record."""

    name = "derived"
    room: ClassVar[Room] = Room("navigation", "derived", lambda thrusters: CLOCK + MEASURED[:4], MEASURED[4:])

    @staticmethod
    def step(settings, state, given, state_dot, out):
        modelled_wrench(state, given.instant, given.period, given.R_WB, given.nu)
        contact_behind(state, given.R_WB, out)
