"""One step of the closed loop: observation, stages, thrusters, running signals, rows and bounds.

The functions work on records and arrays only. Stages are called by their addresses, so that this code is the same for
every stage, and for both engines. Row k has the state at t_k, the stages' outputs for it, and the contact force at t_k.
MuJoCo computes this force during step k, so the row is completed at the start of the next step, or when the rows are
read.
"""

import math
import sys

from ...physics.contact import contact_force
from ...physics.frames import body_acceleration, body_velocity, rotation
from ...physics.kernels import kernel
from .bounds import check_command, check_state, observe_joints, stop_run
from .carrying import place_carriers, press_links, work_on_walls
from .flow import flow
from .layouts import STAGE_SIZE, STOP_NONE, STOP_STAGE, STOP_THRUST, STOP_WAITING
from .memory import call_stage, carrier_at, clock_at, floats, integers, stage_at
from .touching import touch

_LARGEST = sys.float_info.max


@kernel
def observe(context, loop):
    """Read the state, compute the contact force at t_k and check the bounds, once per step.

    qpos and qvel are valid before a step as well as within it.
    """
    if loop.observed == loop.step + 1:
        return
    loop.observed = loop.step + 1
    loop.t = loop.step * loop.timestep
    true, contact = loop.true, loop.contact
    qpos = floats(context.qpos_at, 7)
    for i in range(3):
        true.p_WB[i] = qpos[i]
    norm = math.sqrt(qpos[3] * qpos[3] + qpos[4] * qpos[4] + qpos[5] * qpos[5] + qpos[6] * qpos[6])
    for i in range(4):
        true.quat_WB[i] = qpos[3 + i] / norm
    rotation(true.quat_WB, true.R_WB)
    body_velocity(true.R_WB, floats(context.qvel_at, 6), true.nu)
    if loop.joints != 0:
        observe_joints(context, loop)
    distance = floats(loop.distance_at, 1)[0]
    fromto = floats(loop.fromto_at, 6)
    if context.carriers == 0:
        contact_force(contact, distance, fromto, true.p_WB, true.R_WB, true.nu, loop.timestep)
    else:
        place_carriers(context, loop)
        probe = carrier_at(loop.carriers_at)
        contact_force(contact, distance, fromto, probe.p_WC, probe.R_WC, probe.nu, loop.timestep)
    flow(context, loop.t, true.p_WB, true.R_WB, true.nu)
    context.water.fresh = 1
    for i in range(3):
        true.f_contact_W[i] = contact.f_W[i]
        true.v_c_W[i] = context.water.v_c_W[i]
    for i in range(6):
        true.tau_contact_B[i] = contact.tau_B[i]
    if context.pairs != 0:
        touch(context, loop)
    if context.carriers != 0:
        press_links(context, loop)
    check_state(loop)


@kernel
def flow_again(context, loop):
    """Compute the motion of the water at t_k again if its settings have changed since it was observed."""
    if context.water.fresh == 0:
        true = loop.true
        flow(context, loop.t, true.p_WB, true.R_WB, true.nu)
        context.water.fresh = 1


@kernel
def begin_stage(loop, stage):
    """Advance the states of a stage to t_k, and set its clock."""
    state, state_dot = floats(stage.state_at, stage.states), floats(stage.state_dot_at, stage.states)
    for i in range(stage.states):
        state[i] += stage.period * state_dot[i]
    clock = clock_at(stage.given_at)
    clock.t = loop.t
    clock.period = stage.period
    clock.instant = stage.instant
    clock.key = stage.key
    stage.instant += 1


@kernel
def run_stages(loop, end) -> int:
    """Run the stages before index ``end`` that are due at t_k and have not run yet, in order.

    Returns the index of a stage that waits for Python to call it, otherwise -1.
    """
    for i in range(loop.next, end):
        loop.next = i
        stage = stage_at(loop.stages_at + STAGE_SIZE * i)
        if stage.period_steps == 1 or loop.step % stage.period_steps == 0:
            if i == loop.actuation:
                check_command(loop)
                if loop.stop != STOP_NONE:
                    return -1
            begin_stage(loop, stage)
            if stage.code_at == 0:
                return i
            wrong = call_stage(
                stage.code_at, stage.settings_at, stage.state_at, stage.given_at, stage.state_dot_at, stage.out_at
            )
            if wrong != 0:
                stop_run(loop, STOP_STAGE, wrong, 0.0)
                return -1
        loop.next = i + 1
    return -1


@kernel
def limit_thrust(loop):
    """Set u to the thrusts within the limits of the vehicle's file, and tau = B u."""
    n, true = loop.thrusters, loop.true
    u_cmd, produced, u = floats(loop.u_cmd_at, n), floats(loop.thrust_at, n), floats(loop.u_at, n)
    u_min, u_max = floats(loop.u_min_at, n), floats(loop.u_max_at, n)
    low, high = floats(loop.low_at, n), floats(loop.high_at, n)
    loop.saturated = 0
    for k in range(n):
        if not abs(produced[k]) <= _LARGEST:
            stop_run(loop, STOP_THRUST, k, produced[k])
        thrust = min(high[k], max(low[k], produced[k]))
        if not abs(thrust) <= loop.tau_bound:  # MuJoCo would ignore it
            stop_run(loop, STOP_THRUST, k, thrust)
        u[k] = thrust
        if u_cmd[k] <= u_min[k] or u_cmd[k] >= u_max[k]:
            loop.saturated = 1
    add_columns(floats(loop.columns_at, 6 * n), u, low, high, n, true.tau)


@kernel
def add_columns(columns, u, low, high, n, wrench):
    """Set the wrench (6,) B u of n thrusts within their limits; ``columns`` (6 n,) are those of B."""
    x_0, x_1, x_2, x_3, x_4, x_5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        thrust = min(high[k], max(low[k], u[k]))
        x_0 += columns[6 * k] * thrust
        x_1 += columns[6 * k + 1] * thrust
        x_2 += columns[6 * k + 2] * thrust
        x_3 += columns[6 * k + 3] * thrust
        x_4 += columns[6 * k + 4] * thrust
        x_5 += columns[6 * k + 5] * thrust
    wrench[0], wrench[1], wrench[2], wrench[3], wrench[4], wrench[5] = x_0, x_1, x_2, x_3, x_4, x_5


@kernel
def believe_thrust(loop):
    """Set tau_hat, the wrench of the commanded thrusts as the controller knows the thrusters, for the next instant, and
    the part of tau_cmd that it lacks."""
    tau_hat, tau = floats(loop.tau_hat_at, 6), loop.true.tau
    if loop.columns_hat_at == 0:
        for i in range(6):
            tau_hat[i] = tau[i]
    else:
        n = loop.thrusters
        u_cmd, u_min, u_max = floats(loop.u_cmd_at, n), floats(loop.u_min_at, n), floats(loop.u_max_at, n)
        add_columns(floats(loop.columns_hat_at, 6 * n), u_cmd, u_min, u_max, n, tau_hat)
    if loop.tau_lost_at != 0:
        tau_cmd, tau_lost = floats(loop.tau_given_at, 6), floats(loop.tau_lost_at, 6)
        for i in range(6):
            tau_lost[i] = tau_cmd[i] - tau_hat[i]


@kernel
def begin_step(context, loop) -> bool:
    """Do everything up to the thrust of step k. Returns True if the step may continue."""
    finish_step(context, loop)
    if loop.stop == STOP_NONE:
        observe(context, loop)
    if loop.stop == STOP_NONE:
        waiting = run_stages(loop, loop.stages)
        if waiting >= 0:
            stop_run(loop, STOP_WAITING, waiting, 0.0)
    if loop.stop == STOP_NONE:
        limit_thrust(loop)
        believe_thrust(loop)
    if loop.stop != STOP_NONE:
        return False
    row, true = loop.row, loop.true
    row.t = loop.t
    flow_again(context, loop)
    for i in range(6):
        row.tau_dist[i] = context.water.tau_dist[i]
    if loop.step > 0:
        for i in range(6):
            change = abs(true.tau[i] - loop.tau_before[i])
            row.tau_variation[i] += change
            row.tau_step_max[i] = max(row.tau_step_max[i], change)
    for i in range(6):
        row.tau_max[i] = max(row.tau_max[i], abs(true.tau[i]))
        loop.tau_before[i] = true.tau[i]
    loop.pending = 1
    return True


@kernel
def finish_step(context, loop):
    """Complete step k, whose contact force and acceleration are now known: running signals, and a row if one is due."""
    if loop.pending == 0:
        return
    loop.pending = 0
    row, true, contact, h = loop.row, loop.true, loop.contact, loop.timestep
    for i in range(3):
        loop.moment_B[i] = contact.tau_B[i + 3]
    solved = floats(loop.contact_at, 4)
    for i in range(3):
        row.f_contact_W[i] = contact.f_tangential_W[i] + (solved[1 + i] if solved[0] != 0.0 else 0.0)
    push, push_before = -row.f_contact_W[0], loop.push[0]
    if context.pairs != 0:
        push += loop.push_of_pairs
        for i in range(3):
            row.f_contact_W[i] += context.f_pairs_W[i]
            loop.moment_B[i] += context.tau_pairs_B[i + 3]
    if context.carriers != 0:
        work_on_walls(context, loop)
    loop.push[0], loop.push_shown[0] = push, max(0.0, push)
    if push > 0.0 and push_before <= 0.0:
        row.touches += 1.0
        if row.first_contact < 0.0:
            row.first_contact = loop.t
    row.force_peak = max(row.force_peak, push)
    if loop.step > 0:  # trapezoidal rule, by which a linear spring does no work over a rebound
        row.impulse += 0.5 * h * (push + push_before)
        for i in range(3 if context.carriers == 0 else 0):
            row.wall_work -= 0.5 * (row.f_contact_W[i] + loop.f_before_W[i]) * (true.p_WB[i] - loop.p_before[i])
            row.wall_work -= 0.5 * (loop.moment_B[i] + loop.moment_before_B[i]) * h * true.nu[i + 3]
        if loop.step > loop.window_step:
            row.final_impulse += 0.5 * h * (push + push_before)
    if loop.step == loop.window_step:
        row.final_low, row.final_high = push, push
    elif loop.step > loop.window_step:
        row.final_low, row.final_high = min(row.final_low, push), max(row.final_high, push)
    body_acceleration(true.R_WB, floats(loop.qacc_at, 6), true.nu, true.nu_dot)
    if loop.joints != 0:
        q_ddot, qacc = floats(loop.q_ddot_at, loop.joints), floats(loop.qacc_at + 48, loop.joints)
        for k in range(loop.joints):
            q_ddot[k] = qacc[k]
    if loop.banded != 0:
        widen_bands(loop)
    write_row(loop)
    if loop.saturated != 0:  # for the coming step
        row.saturation_time += h
    for i in range(6):
        row.effort[i] += h * true.tau[i] * true.tau[i]
    if loop.s_at != 0:
        s = floats(loop.s_at, 6)
        for i in range(6):
            if abs(s[i]) < loop.epsilon[i]:
                row.boundary_layer_time[i] += h
    for i in range(3):
        loop.f_before_W[i] = row.f_contact_W[i]
        loop.moment_before_B[i] = loop.moment_B[i]
        loop.p_before[i] = true.p_WB[i]
    loop.step += 1
    loop.next = 0


@kernel
def write_row(loop):
    """Append row k, gathered from where each recorded signal lies, if one is due."""
    if not (loop.rows < loop.row_capacity and (loop.step % loop.row_steps == 0 or loop.step == loop.steps)):
        return
    row_at = loop.rows_at + 8 * loop.rows * loop.row_width
    spans = integers(loop.spans_at, 2 * loop.spans)
    for k in range(loop.spans):
        n = spans[2 * k + 1]
        copy_numbers(floats(spans[2 * k], n), n, floats(row_at, n))
        row_at += 8 * n
    loop.rows += 1
    loop.band_steps = 0


@kernel
def widen_bands(loop):
    """Widen the band of each banded signal to its value of step k; the first step after a row begins a new band."""
    at, banded = loop.bands_at, integers(loop.banded_at, 2 * loop.banded)
    for k in range(loop.banded):
        n = banded[2 * k + 1]
        now, low, high = floats(banded[2 * k], n), floats(at, n), floats(at + 8 * n, n)
        if loop.band_steps == 0:
            copy_numbers(now, n, low)
            copy_numbers(now, n, high)
        else:
            for i in range(n):
                low[i], high[i] = min(low[i], now[i]), max(high[i], now[i])
        at += 16 * n
    loop.band_steps += 1


@kernel
def copy_numbers(source, n, target):
    """Copy n numbers."""
    for i in range(n):
        target[i] = source[i]
