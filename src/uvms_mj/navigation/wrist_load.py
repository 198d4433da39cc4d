"""The stages around a wrist sensor: the wrench that it is exposed to, and the contact wrench behind its reading."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..physics.frames import add_wrench_from, compose_poses, to_body, to_world, wrench_at
from ..physics.kernels import kernel
from ..physics.tree import (
    coriolis_wrench,
    damping_wrench,
    hand_down,
    measured_frames,
    move,
    move_frame,
    restoring_wrench,
)
from ..stages.base import Room, Stage
from ..stages.signals import CLOCK, MEASURED, TRUE, WRIST_TRUE


@kernel
def carried_wrench(links, frames, gravity_B, first, moving, q_dot, q_ddot, part):
    """Set F of the link ``first`` to the wrench that keeps it and all that it carries in their motion, or at rest if
    ``moving`` is 0, without contacts. Frames, gravity, and V and A of the base are set; ``part`` is (6,) scratch."""
    for k in range(1, links.shape[0]):
        link, frame = links[k], frames[k]
        move(link, frame.S, links[frame.parent], q_dot[k - 1])
        for i in range(6):
            link.A[i] += frame.S[i] * q_ddot[k - 1]
        move_frame(link, frame)
    for k in range(first, links.shape[0]):
        link, frame = links[k], frames[k]
        restoring_wrench(link, frame, gravity_B, link.F)
        if moving != 0:
            coriolis_wrench(link, part)
            add_wrench_from(frame.R_BL, frame.p_BL, part, link.F)
            damping_wrench(link, part)
            add_wrench_from(frame.R_BL, frame.p_BL, part, link.F)
    for k in range(links.shape[0] - 1, first, -1):
        hand_down(links[k], links[frames[k].parent])


@kernel
def place_sensor(sensor, frame):
    """Set the pose of the sensor in B from that of the link behind it."""
    compose_poses(frame.R_BL, frame.p_BL, sensor.R_LT, sensor.p_LT, sensor.R_BT, sensor.p_BT)


@kernel
def felt_wrench(run, true, out):
    """Set out (6,) to the true wrench of the parent on the links behind the sensor, in S."""
    wrist, water, frames, q_dot, q_ddot = run.wrist, run.plant.water, run.plant.frames, run.encoder.q_dot, run.q_ddot
    rigid, wet, nu, v_c, first = wrist.rigid[0], wrist.wet[0], true.nu, wrist.work, wrist.sensor.link
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
    to_body(true.R_WB, wrist.gravity_W, wrist.rigid_gravity_B)
    for i in range(3):
        wrist.moment[i] = wrist.gravity_W[i] - water.a_c_W[i]  # of the displaced water
    to_body(true.R_WB, wrist.moment, wrist.wet_gravity_B)
    carried_wrench(wrist.rigid, frames, wrist.rigid_gravity_B, first, 1, q_dot, q_ddot, wrist.work)
    carried_wrench(wrist.wet, frames, wrist.wet_gravity_B, first, 1, q_dot, q_ddot, wrist.work)
    solid, around = wrist.rigid[first], wrist.wet[first]
    for i in range(6):
        solid.F[i] += around.F[i]
    if run.carriers.shape[0] != 0:
        release(run, solid)
    place_sensor(wrist.sensor, frames[first])
    wrench_at(wrist.sensor.R_BT, wrist.sensor.p_BT, solid.F, out)


@kernel
def release(run, first):
    """Subtract the contact forces on the links behind the sensor from F of the first of them."""
    frames, wrist, tau_B = run.plant.frames, run.wrist, run.wrist.work
    for i in range(6):
        tau_B[i] = 0.0
    for k in range(run.carriers.shape[0]):
        carrier = run.carriers[k]
        above = carrier.link
        for _ in range(frames[carrier.link].depth):
            if above == wrist.sensor.link:
                add_wrench_from(carrier.R_BC, carrier.p_BC, carrier.tau, tau_B)
            above = frames[above].parent
    for i in range(6):
        first.F[i] -= tau_B[i]


@kernel
def modelled_wrench(run, instant, period, R_WB, nu):
    """Set ``modelled`` (6,) to the wrench without contacts by the model, from the measured state."""
    wrist, q_dot = run.wrist, run.joints.q_dot_m
    base, first, before, q_ddot = wrist.model[0], wrist.sensor.link, wrist.nu_before, wrist.q_ddot
    for i in range(6):
        base.V[i] = nu[i]
        base.A[i] = (nu[i] - before[i]) / period if instant > 0 else 0.0
        before[i] = nu[i]
    for k in range(q_dot.shape[0]):
        q_ddot[k] = (q_dot[k] - wrist.q_dot_before[k]) / period if instant > 0 else 0.0
        wrist.q_dot_before[k] = q_dot[k]
    to_body(R_WB, wrist.gravity_W, wrist.gravity_B)
    frames = measured_frames(run, wrist.frames)
    carried_wrench(wrist.model, frames, wrist.gravity_B, first, wrist.dynamic, q_dot, q_ddot, wrist.work)
    place_sensor(wrist.sensor, frames[first])
    wrench_at(wrist.sensor.R_BT, wrist.sensor.p_BT, wrist.model[first].F, wrist.modelled)


@kernel
def contact_behind(wrist, R_WB, out):
    """Set the measured contact force in W and the wrench at B of ``out`` to what the model leaves of the reading."""
    reading, f, tau = wrist.reading, wrist.work, out.tau_contact_m_B
    for i in range(6):
        f[i] = (wrist.modelled[i] if wrist.weighs != 0 else 0.0) - reading[i]
        tau[i] = 0.0
    add_wrench_from(wrist.sensor.R_BT, wrist.sensor.p_BT, f, tau)
    to_world(R_WB, tau, out.f_contact_m_W)


@dataclass(frozen=True)
class WristLoad(Stage):
    """The wrench that the wrist sensor is exposed to. ``state`` is the record of the run."""

    name = "felt"
    room: ClassVar[Room] = Room("navigation", "felt", lambda thrusters: CLOCK + TRUE, (WRIST_TRUE,))

    @staticmethod
    def step(settings, state, given, state_dot, out):
        felt_wrench(state, given, out)


@dataclass(frozen=True)
class WristCompensation(Stage):
    """The contact force and wrench that are derived from the reading. ``state`` is the record of the run."""

    name = "derived"
    room: ClassVar[Room] = Room("navigation", "derived", lambda thrusters: CLOCK + MEASURED[:4], MEASURED[4:])

    @staticmethod
    def step(settings, state, given, state_dot, out):
        modelled_wrench(state, given.instant, given.period, given.R_WB, given.nu)
        contact_behind(state.wrist, given.R_WB, out)
