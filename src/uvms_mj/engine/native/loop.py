"""One step of the closed loop: sensing, law, thrusters, running signals, rows and bounds.

The functions work on records and arrays only. Row k has the state at t_k, the law's outputs for it, and the contact
force at t_k. MuJoCo computes this force during step k, so the row is completed at the start of the next step, or when
the rows are read.
"""

import math

from ...control.task import impedance_task
from ...control.tracking import tracking_errors
from ...guidance.filtered_steps import filtered_steps
from ...navigation.truth import reveal
from ...physics.contact import contact_force
from ...physics.frames import body_acceleration, body_velocity, rotation
from ...physics.hydrodynamics import disturbance
from ...physics.kernels import kernel
from ...physics.model import model_wrenches
from .layouts import ROW_SIZE, STOP_COMMAND, STOP_LAW, STOP_NONE, STOP_STATE
from .memory import call_law, floats, integers, triples


@kernel
def read_state(context, loop):
    """Read t_k, p, quat, R_WB and nu from qpos and qvel, which are valid before a step as well as within it."""
    loop.t = loop.step * loop.timestep
    qpos = floats(context.qpos_at, 7)
    for i in range(3):
        loop.p[i] = qpos[i]
    norm = math.sqrt(qpos[3] * qpos[3] + qpos[4] * qpos[4] + qpos[5] * qpos[5] + qpos[6] * qpos[6])
    for i in range(4):
        loop.quat[i] = qpos[3 + i] / norm
    rotation(loop.quat, loop.R_WB)
    body_velocity(loop.R_WB, floats(context.qvel_at, 6), loop.nu)


@kernel
def observe(context, loop):
    """Read the state and compute the contact force at t_k, once per step."""
    if loop.observed == loop.step + 1:
        return
    loop.observed = loop.step + 1
    read_state(context, loop)
    distance = floats(loop.distance_at, 1)[0]
    fromto = floats(loop.fromto_at, 6)
    contact_force(loop.contact, distance, fromto, loop.p, loop.R_WB, loop.nu, loop.timestep)


@kernel
def sense(context, loop):
    """Advance the law's states to t_k and set all signals for the law, once per control instant."""
    if loop.sensed == loop.step + 1:
        return
    loop.sensed = loop.step + 1
    observe(context, loop)
    signals = loop.signals
    state, state_dot = floats(loop.state_at, loop.states), floats(loop.state_dot_at, loop.states)
    for i in range(loop.states):
        state[i] += signals.period * state_dot[i]
    for i in range(6):
        signals.zeta[i] += signals.period * loop.zeta_dot[i]
        signals.nu[i] = loop.nu[i]
    signals.t = loop.t
    signals.instant = loop.step // loop.period_steps
    for i in range(4):
        signals.quat_WB[i] = loop.quat[i]
    for i in range(3):
        signals.p_WB[i] = loop.p[i]
        for j in range(3):
            signals.R_WB[i, j] = loop.R_WB[i, j]
    filtered_steps(
        loop.t,
        loop.start,
        floats(loop.times_at, loop.waypoints),
        triples(loop.positions_at, loop.waypoints),
        loop.bandwidth,
        signals.p_d,
        signals.p_d_dot,
        signals.p_d_ddot,
    )
    for i in range(3):
        signals.f_contact_m_W[i] = loop.contact.f_W[i]
        signals.tau_contact_m_B[i] = loop.contact.tau_B[i]
        signals.tau_contact_m_B[i + 3] = loop.contact.tau_B[i + 3]
    tracking_errors(signals)
    model_wrenches(loop.estimates, signals.nu, signals.R_WB, signals.C_hat_nu, signals.D_hat_nu, signals.g_hat)
    impedance_task(loop.task, signals.zeta, signals, loop.zeta_dot, signals)
    if loop.reveals != 0:
        reveal(loop.true_coefficients, context.water, signals, loop.truth, loop.work)


@kernel
def allocate(loop):
    """u = B^+ tau_cmd (eq. 25) within the thrusters' limits, and tau = B u."""
    n = loop.thrusters
    u, u_min, u_max = floats(loop.u_at, n), floats(loop.u_min_at, n), floats(loop.u_max_at, n)
    B, B_pinv = floats(loop.B_at, 6 * n), floats(loop.B_pinv_at, 6 * n)
    a, b, c = loop.tau_cmd[0], loop.tau_cmd[1], loop.tau_cmd[2]
    d, e, f = loop.tau_cmd[3], loop.tau_cmd[4], loop.tau_cmd[5]
    x_0, x_1, x_2, x_3, x_4, x_5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    loop.saturated = 0
    for k in range(n):
        row = 6 * k
        total = (B_pinv[row] * a + B_pinv[row + 1] * b) + (B_pinv[row + 2] * c + B_pinv[row + 3] * d)
        total += B_pinv[row + 4] * e + B_pinv[row + 5] * f
        thrust = min(u_max[k], max(u_min[k], total))
        u[k] = thrust
        if thrust != total:
            loop.saturated = 1
        x_0 += B[row] * thrust
        x_1 += B[row + 1] * thrust
        x_2 += B[row + 2] * thrust
        x_3 += B[row + 3] * thrust
        x_4 += B[row + 4] * thrust
        x_5 += B[row + 5] * thrust
    loop.tau[0], loop.tau[1], loop.tau[2] = x_0, x_1, x_2
    loop.tau[3], loop.tau[4], loop.tau[5] = x_3, x_4, x_5


@kernel
def thrust(loop):
    """Write u to MuJoCo's ctrl, which it applies in this step."""
    u, thrust_of_ctrl = floats(loop.u_at, loop.thrusters), floats(loop.thrust_of_ctrl_at, loop.thrusters)
    index = integers(loop.ctrl_index_at, loop.thrusters)
    ctrl = floats(loop.ctrl_at, loop.controls)
    for k in range(loop.thrusters):
        ctrl[index[k]] = u[k] / thrust_of_ctrl[k]


@kernel
def stop_run(loop, kind, index, value):
    """Stop the run and record the first reason: its kind, an index and the value out of bounds."""
    if loop.stop == STOP_NONE:
        loop.stop = kind
        loop.stop_index = index
        loop.stop_value = value


@kernel
def check_state(loop):
    """Stop the run if the position or the velocity is out of bounds. A NaN fails every comparison."""
    for i in range(3):
        if not abs(loop.p[i] - loop.qpos_safe[i]) <= loop.position_bound:
            stop_run(loop, STOP_STATE, i, loop.p[i])
    for i in range(6):
        if not abs(loop.nu[i]) <= loop.speed_bound[i]:
            stop_run(loop, STOP_STATE, 3 + i, loop.nu[i])


@kernel
def control(loop):
    """Call the law, check tau_cmd and allocate it to the thrusters."""
    if loop.law_at != 0:
        at = loop.state_dot_at
        wrong = call_law(loop.law_at, loop.gains_at, loop.state_at, loop.signals_at, at, loop.tau_cmd_at)
        if wrong != 0:
            stop_run(loop, STOP_LAW, wrong, 0.0)
            return
    for i in range(6):
        if not abs(loop.tau_cmd[i]) <= loop.tau_bound:
            stop_run(loop, STOP_COMMAND, i, loop.tau_cmd[i])
            return
    allocate(loop)


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


@kernel
def begin_step(context, loop):
    """Do everything up to the thrust of step k. Returns True if the step may continue."""
    finish_step(context, loop)
    if loop.stop != STOP_NONE:
        return False
    if loop.step % loop.period_steps == 0:
        sense(context, loop)
        check_state(loop)
        if loop.stop == STOP_NONE:
            control(loop)
    else:
        observe(context, loop)
        check_state(loop)
    if loop.stop != STOP_NONE:
        return False
    thrust(loop)
    row = loop.row
    row.t = loop.t
    if loop.step > 0:
        for i in range(6):
            change = abs(loop.tau[i] - loop.tau_before[i])
            row.tau_variation[i] += change
            row.tau_step_max[i] = max(row.tau_step_max[i], change)
    for i in range(6):
        row.tau_max[i] = max(row.tau_max[i], abs(loop.tau[i]))
        loop.tau_before[i] = loop.tau[i]
    loop.pending = 1
    return True


@kernel
def finish_step(context, loop):
    """Complete step k, whose contact force and acceleration are now known: running signals, and a row if one is due."""
    if loop.pending == 0:
        return
    loop.pending = 0
    row, h = loop.row, loop.timestep
    solved, contact = floats(loop.contact_at, 4), loop.contact
    for i in range(3):
        loop.f_contact_W[i] = contact.f_tangential_W[i] + (solved[1 + i] if solved[0] != 0.0 else 0.0)
        loop.moment_B[i] = contact.tau_B[i + 3]
    push, push_before = -loop.f_contact_W[0], -loop.f_before_W[0]
    if push > 0.0 and push_before <= 0.0:
        row.touches += 1.0
        if row.first_contact < 0.0:
            row.first_contact = loop.t
    row.force_peak = max(row.force_peak, push)
    if loop.step > 0:  # trapezoidal rule, by which a linear spring does no work over a rebound
        row.impulse += 0.5 * h * (push + push_before)
        for i in range(3):
            row.wall_work -= 0.5 * (loop.f_contact_W[i] + loop.f_before_W[i]) * (loop.p[i] - loop.p_before[i])
            row.wall_work -= 0.5 * (loop.moment_B[i] + loop.moment_before_B[i]) * h * loop.nu[i + 3]
        if loop.step > loop.window_step:
            row.final_impulse += 0.5 * h * (push + push_before)
    if loop.step == loop.window_step:
        row.final_low, row.final_high = push, push
    elif loop.step > loop.window_step:
        row.final_low, row.final_high = min(row.final_low, push), max(row.final_high, push)
    if (loop.step % loop.row_steps == 0 or loop.step == loop.steps) and loop.rows < loop.row_capacity:
        body_acceleration(loop.R_WB, floats(loop.qacc_at, 6), loop.nu, loop.nu_dot)
        write_row(context, loop)
    if loop.saturated != 0:  # for the coming step
        row.saturation_time += h
    for i in range(6):
        row.effort[i] += h * loop.tau[i] * loop.tau[i]
        if abs(loop.signals.s[i]) < loop.epsilon[i]:
            row.boundary_layer_time[i] += h
    for i in range(3):
        loop.f_before_W[i] = loop.f_contact_W[i]
        loop.moment_before_B[i] = loop.moment_B[i]
        loop.p_before[i] = loop.p[i]
    loop.step += 1


@kernel
def write_row(context, loop):
    """Append row k: the recorded signals, u, and the law's states."""
    row, signals = loop.row, loop.signals
    for i in range(4):
        row.quat_WB[i] = loop.quat[i]
    for i in range(3):
        row.p_WB[i] = loop.p[i]
        row.p_d[i] = signals.p_d[i]
        row.p_d_dot[i] = signals.p_d_dot[i]
        row.f_contact_W[i] = loop.f_contact_W[i]
        row.f_contact_m_W[i] = signals.f_contact_m_W[i]
        row.stretch_W[i] = loop.contact.stretch_W[i]
    for i in range(6):
        row.nu[i] = loop.nu[i]
        row.nu_dot[i] = loop.nu_dot[i]
        row.eta_e[i] = signals.eta_e[i]
        row.nu_e[i] = signals.nu_e[i]
        row.s[i] = signals.s[i]
        row.zeta[i] = signals.zeta[i]
        row.tau_nom[i] = signals.tau_nom[i]
        row.tau_cmd[i] = loop.tau_cmd[i]
        row.tau[i] = loop.tau[i]
    disturbance(context.water, loop.t, row.tau_dist)
    out = floats(loop.rows_at + 8 * loop.rows * loop.row_width, loop.row_width)
    fixed = floats(loop.row_at, ROW_SIZE)
    for i in range(ROW_SIZE):
        out[i] = fixed[i]
    u, state = floats(loop.u_at, loop.thrusters), floats(loop.state_at, loop.states)
    for i in range(loop.thrusters):
        out[ROW_SIZE + i] = u[i]
    for i in range(loop.states):
        out[ROW_SIZE + loop.thrusters + i] = state[i]
    loop.rows += 1
