"""MuJoCo's ``mjcb_control`` in machine code: hydrodynamics and, with a controller, the closed loop.

MuJoCo calls it in every forward evaluation of every model of the process, after it has built and factored the
joint-space inertia and before it uses it. The callback returns immediately if the mjData is not attached.
"""

import functools
from typing import Any

from ...physics.contact import wrench_at_origin
from ...physics.frames import body_velocity, to_world
from ...physics.hydrodynamics import added_inertia, factor, water_wrench
from ...physics.joints import deliverable
from ...physics.kernels import kernel
from .compilation import native_functions
from .flow import flow
from .free_body import free_steps
from .layouts import BODY, CONTEXT, LOOP, STOP_NONE
from .loop import begin_step, finish_step, flow_again, observe, run_stages
from .memory import context_at, floats, integers, loop_at, mj_factorM, registered, triples
from .tree import add_tree_inertia, apply_to_joints, place_links, water_on_links


@kernel
def add_inertia(context, R_WB, model, data):
    """Add T^T M_A T to mjData.M and factor it, unless M already contains it.

    mj_forwardSkip and mjd_transitionFD evaluate again without rebuilding M. M is then bit for bit as the callback left
    it.
    """
    M = floats(context.M_at, 21)
    left = context.M_left
    same = True
    for i in range(21):
        if M[i] != left[i]:
            same = False
    if same:
        return
    added_inertia(context.water.M_A, R_WB, context.added)
    for i in range(21):
        M[i] += context.added[i]
        left[i] = M[i]
    if context.qLD_at != 0:
        factor(M, floats(context.qLD_at, 21), floats(context.qLDiagInv_at, 6))
    else:
        mj_factorM(model, data)


@kernel
def apply_wrench(context, R_WB, contact):
    """Add the hydrodynamic wrench, the contact's friction and the contacts of the list to the free joint's entries of
    mjData.qfrc_passive.

    MuJoCo has just reset these entries. If mj_forwardSkip skipped that stage, they still have the values that the
    callback left.
    """
    passive, before, left = floats(context.passive_at, 6), context.passive_before, context.passive_left
    same = True
    for i in range(6):
        if passive[i] != left[i]:
            same = False
    if not same:
        for i in range(6):
            before[i] = passive[i]
    to_world(R_WB, context.wrench, left)  # a free joint's force is in W, its moment in B
    for i in range(3):
        left[i] += before[i]
        left[i + 3] = before[i + 3] + context.wrench[i + 3]
    if contact.touching != 0 and contact.friction > 0.0 and context.carriers == 0:
        wrench_at_origin(R_WB, contact.arm_W, contact.f_tangential_W, contact.work, context.work)
        for i in range(3):
            left[i] += contact.f_tangential_W[i]
            left[i + 3] += context.work[i + 3]
    if context.pairs + context.carriers != 0:
        for i in range(3):
            left[i] += context.f_pairs_W[i]
            left[i + 3] += context.tau_pairs_B[i + 3]
    for i in range(6):
        passive[i] = left[i]


@kernel
def apply_thrust(loop):
    """Write u to MuJoCo's ctrl, which it applies in this step."""
    u, thrust_of_ctrl = floats(loop.u_at, loop.thrusters), floats(loop.thrust_of_ctrl_at, loop.thrusters)
    index = integers(loop.ctrl_index_at, loop.thrusters)
    ctrl = floats(loop.ctrl_at, loop.controls)
    for k in range(loop.thrusters):
        ctrl[index[k]] = u[k] / thrust_of_ctrl[k]
    if loop.joints != 0:
        drive_joints(loop, ctrl)


@kernel
def drive_joints(loop, ctrl):
    """Write the motors' torques, within their limits, to MuJoCo's ctrl (m,)."""
    n = loop.joints
    wanted, tau_q, q_dot = floats(loop.wanted_at, n), floats(loop.tau_q_at, n), floats(loop.q_dot_at, n)
    effort, speed_limit = floats(loop.effort_at, n), floats(loop.speed_limit_at, n)
    index, torque_of_ctrl = integers(loop.motor_index_at, n), floats(loop.torque_of_ctrl_at, n)
    saturation, saturation_next = floats(loop.saturation_at, n), floats(loop.saturation_next_at, n)
    for k in range(n):
        tau_q[k] = deliverable(wanted[k], q_dot[k], effort[k], speed_limit[k])
        if index[k] >= 0:
            ctrl[index[k]] = tau_q[k] / torque_of_ctrl[k]
            saturation[k] = saturation_next[k]
            most = deliverable(2.0 * wanted[k], q_dot[k], effort[k], speed_limit[k])
            if tau_q[k] == most and wanted[k] != 0.0:  # the motor would give no more
                saturation_next[k] += loop.timestep


@kernel
def hold(context, loop):
    """After a stop, keep MuJoCo at a harmless state for the rest of the chunk, which is not recorded."""
    qpos, qvel, ctrl = floats(context.qpos_at, 7), floats(context.qvel_at, 6), floats(loop.ctrl_at, loop.controls)
    for i in range(7):
        qpos[i] = loop.qpos_safe[i]
    for i in range(6):
        qvel[i] = 0.0
    for k in range(loop.controls):
        ctrl[k] = 0.0
    if loop.joints != 0:
        n = loop.joints
        q, q_dot, q_safe = floats(context.q_at, n), floats(context.q_dot_at, n), floats(loop.q_safe_at, n)
        for k in range(n):
            q[k] = q_safe[k]
            q_dot[k] = 0.0


@kernel
def evaluate(context, model, data):
    """Apply the hydrodynamics of one attached vehicle in one forward evaluation, and run its loop if it has one."""
    context.calls += 1
    R_WB = triples(context.R_at, 3)
    joints = context.tree.links - 1
    if joints > 0:
        place_links(context.tree, floats(context.q_at, joints))
        add_tree_inertia(context, R_WB, model, data)
    else:
        add_inertia(context, R_WB, model, data)
    contact, alone = context.no_contact, True
    if context.loop_at != 0:
        loop = loop_at(context.loop_at)
        contact = loop.contact
        if loop.remaining > 0:  # otherwise somebody evaluates the state between two steps
            loop.remaining -= 1
            if not begin_step(context, loop):
                hold(context, loop)
                return
            apply_thrust(loop)
            alone = False
    body_velocity(R_WB, floats(context.qvel_at, 6), context.nu)
    if alone:
        context.water.fresh = 0
        flow(context, floats(context.time_at, 1)[0], floats(context.qpos_at, 7), R_WB, context.nu)
    if joints > 0:
        wrench = floats(context.wrench_at, 6 + joints)
        water_on_links(context, R_WB, wrench)
        for i in range(6):
            context.wrench[i] = wrench[i]
        apply_to_joints(context)
    else:
        water_wrench(context.water, R_WB, context.nu, context.nu_r, context.work, context.wrench)
    apply_wrench(context, R_WB, contact)


def _callback(model, data):
    table = registered()
    for i in range(1, table[0, 0] + 1):
        if table[i, 0] == data:
            evaluate(context_at(table[i, 1]), model, data)


def _advance(context, end) -> int:
    """Prepare step k: complete the step before it, and run its stages up to index ``end``. Returns the index of a stage
    that waits for Python to call it, otherwise -1."""
    loop = loop_at(context.loop_at)
    finish_step(context, loop)
    if loop.joints != 0:
        place_links(context.tree, floats(context.q_at, loop.joints))
    if loop.stop == STOP_NONE:
        observe(context, loop)
    if loop.stop == STOP_NONE:
        flow_again(context, loop)
        return run_stages(loop, end)
    return -1


def _finish(context):
    finish_step(context, loop_at(context.loop_at))


def _restore(spans_at, n):
    """Copy n spans of numbers; each is three integers: where to, where from, how many."""
    spans = integers(spans_at, 3 * n)
    for k in range(n):
        now, start = integers(spans[3 * k], spans[3 * k + 2]), integers(spans[3 * k + 1], spans[3 * k + 2])
        for i in range(spans[3 * k + 2]):
            now[i] = start[i]


_BETWEEN: dict[str, tuple[Any, list[Any]]] = {
    "advance": (_advance, [CONTEXT, "i8"]),
    "finish": (_finish, [CONTEXT]),
    "restore": (_restore, ["i8", "i8"]),
}
_OF_MUJOCO = {"control": (_callback, ["i8", "i8"]), **_BETWEEN}
_OF_FREE_BODY = {"free_steps": (free_steps, [CONTEXT, BODY, "i8", "i8"]), **_BETWEEN}
RIGID = {(LOOP, "joints"): 0, (CONTEXT, "carriers"): 0}
"""What the engine free_body knows of each vehicle, so that its machine code has no joints."""


@functools.cache
def entry_point(name: str, rigid: bool = False) -> Any:
    """Machine code called by MuJoCo (control), by the engine free_body (free_steps), or by Python between chunks;
    loaded or compiled at first use. The entry points of an engine share most of their code, and are one module; that
    of free_body is for rigid vehicles alone. One module for both engines would cost a step of free_body an eighth."""
    points = _OF_FREE_BODY if rigid else _OF_MUJOCO
    natives = native_functions(dict(points.values()), RIGID if rigid else {})
    return dict(zip(points, natives, strict=True))[name].ctypes
