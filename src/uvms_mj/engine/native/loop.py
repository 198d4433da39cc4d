"""One step of the closed loop: observation, stages, thrusters, running signals, rows and bounds; why it stopped; the
loop around one free rigid body without MuJoCo; and many runs in one call.

The functions work on the record of a run alone. Stages are called by their addresses, so that this code is the same for
every stage, and for both engines. Row k has the state at t_k, the stages' outputs for it, and the contact force at t_k.
MuJoCo computes this force during step k, so the row is completed at the start of the next step, or when the rows are
read.
"""

import math
import sys
from typing import Any

import numpy as np

from ...physics.buoyancy import covered
from ...physics.contacts import force_of_step, move_walls, place_carriers, press_contacts
from ...physics.effects import add_inertias, add_pulls, advance_effects, find_pulls
from ...physics.flow import flow
from ...physics.frames import body_acceleration, body_velocity, rotation
from ...physics.free_body import free_acceleration, soft_contact, symplectic_step
from ...physics.hydrodynamics import water_wrench
from ...physics.kernels import kernel
from ...physics.linear_algebra import cholesky, inverse
from .compilation import NativeFunction, made_once, native_functions
from .memory import call_code, floats
from .record import (
    JOINT_BOUND,
    NUMBERS,
    STOP_COMMAND,
    STOP_JOINT,
    STOP_NONE,
    STOP_STAGE,
    STOP_STATE,
    STOP_THRUST,
    STOP_WAITING,
)

SPEED_BOUND = (100.0,) * 3 + (200.0,) * 3
"""Speeds above this mean that the simulation has diverged [m/s, rad/s]."""
POSITION_BOUND = 1e4
"""A larger distance from the start along any axis means that the simulation has diverged [m]."""
TAU_BOUND = 1e7
"""A larger entry of tau_cmd, or thrust, means that the simulation has diverged [N, N m]."""

_AXES = ["u", "v", "w", "p", "q", "r"]


class Diverged(RuntimeError):
    """The state, tau_cmd or u left its bounds. The message names the time, the variable and the bound."""


def stop_reason(run: np.void) -> str:
    """The first variable of the record of a run to leave its bound, as text; empty if there is none."""
    if not run["stop"]:  # asked after each step
        return ""
    i, value = int(run["stop_index"]), float(run["stop_value"])
    if run["stop"] == STOP_STATE and i < 3:
        return f"position {'xyz'[i]} = {value:.6g} m, more than {POSITION_BOUND:g} m from where it began"
    if run["stop"] == STOP_STATE:
        unit = "m/s" if i < 6 else "rad/s"
        return f"velocity {_AXES[i - 3]} = {value:.6g} {unit}, beyond {SPEED_BOUND[i - 3]:g} {unit}"
    if run["stop"] == STOP_COMMAND:
        unit = "N" if i < 3 else "N m"
        what = f"beyond {TAU_BOUND:g} {unit}" if np.isfinite(value) else "not a finite number"
        return f"tau_cmd[{i}] = {value:.6g} {unit}, {what}"
    if run["stop"] == STOP_THRUST:
        return f"u[{i}] = {value:.6g} N, {f'beyond {TAU_BOUND:g} N' if np.isfinite(value) else 'not a finite number'}"
    if run["stop"] == STOP_JOINT:
        n = len(run["tau_q"])
        what = f"position of joint {i + 1}" if i < n else f"velocity of joint {i - n + 1}"
        return f"{what} = {value:.6g}, beyond {JOINT_BOUND:g}"
    assert run["stop"] != STOP_WAITING, "a stage in plain Python was not called"
    return ""


_LARGEST = sys.float_info.max


@kernel
def stop_run(run, kind, index, value):
    """Stop the run and record the first reason: its kind, an index and the value out of bounds."""
    if run.stop == STOP_NONE:
        run.stop = kind
        run.stop_index = index
        run.stop_value = value


@kernel
def observe(run):
    """Read the state, compute the contact force at t_k and check the bounds, once per step.

    The state is valid before a step as well as within it.
    """
    if run.observed == run.step + 1:
        return
    run.observed = run.step + 1
    observe_anew(run)


@kernel
def observe_anew(run):
    """As :func:`observe`, where nobody has observed the step."""
    run.t = run.step * run.timestep
    plant, true, qpos = run.plant, run.true, run.plant.qpos
    true.p_WB[:] = qpos[:3]
    true.quat_WB[:] = qpos[3:7] / math.sqrt(qpos[3:7] @ qpos[3:7])
    rotation(true.quat_WB, true.R_WB)
    body_velocity(true.R_WB, plant.qvel, true.nu)
    if run.tau_q.shape[0] != 0:
        observe_joints(run)
    if run.pairs.shape[0] != 0:
        move_walls(run)
    flow_of_step(run)
    true.v_c_W[:] = plant.water.v_c_W
    true.wave_head = plant.water.wave_head
    if run.carried.shape[0] != 0:
        place_carriers(run)
    if run.pairs.shape[0] != 0:
        press_contacts(run)
    check_state(run)


@kernel
def observe_joints(run):
    """Copy the positions and velocities of the joints, also as measurements if the encoder is perfect, and stop the run
    if they are out of bounds."""
    n, plant, true, given = run.tau_q.shape[0], run.plant, run.encoder, run.joints
    true.q[:], true.q_dot[:] = plant.qpos[7:], plant.qvel[6:]
    if run.encoded == 0:
        given.q_m[:], given.q_dot_m[:] = true.q, true.q_dot
    for k in range(n):
        if not abs(true.q[k]) <= JOINT_BOUND:
            stop_run(run, STOP_JOINT, k, true.q[k])
        if not abs(true.q_dot[k]) <= JOINT_BOUND:
            stop_run(run, STOP_JOINT, k + n, true.q_dot[k])


@kernel
def check_state(run):
    """Stop the run if the position or the velocity is out of bounds. A NaN fails every comparison."""
    true = run.true
    for i in range(3):
        if not abs(true.p_WB[i] - run.qpos_safe[i]) <= run.position_bound:
            stop_run(run, STOP_STATE, i, true.p_WB[i])
    for i in range(6):
        if not abs(true.nu[i]) <= run.speed_bound[i]:
            stop_run(run, STOP_STATE, 3 + i, true.nu[i])


@kernel
def flow_again(run):
    """Compute the motion of the water at t_k again if its settings have changed since it was observed."""
    if run.plant.water.fresh == 0:
        flow_of_step(run)


@kernel
def flow_of_step(run):
    """Compute the motion of the water at t_k, and what pulls from t_k on."""
    plant, true = run.plant, run.true
    flow(plant, run.numbers, run.t, true.p_WB, true.R_WB, true.nu)
    surfaces, walls = run.surfaces, run.surface_count
    find_pulls(plant, run.numbers, run.t, true.p_WB, true.R_WB, true.nu, surfaces, walls)
    add_pulls(plant.effects, true.R_WB, plant.water.tau_dist)
    plant.water.fresh = 1


@kernel
def begin_stage(run, stage):
    """Advance the states of a stage to t_k, and set its clock."""
    numbers, clock = run.numbers, stage.given
    for i in range(stage.states):
        numbers[stage.state + i] += stage.period * numbers[stage.state_dot + i]
    numbers[clock] = run.t
    numbers[clock + 1] = stage.period
    run.integers[clock + 2] = stage.instant
    run.integers[clock + 3] = stage.key
    stage.instant += 1


@kernel
def run_stages(run, end) -> int:
    """Run the stages before index ``end`` that are due at t_k and have not run yet, in order.

    Returns the index of a stage that waits for Python to call it, otherwise -1. The run may have stopped.
    """
    for i in range(run.next, end):
        run.next = i
        if not run_stage(run, run.stages[i], i):
            return i if run.stop == STOP_NONE else -1
        run.next = i + 1
    return -1


@kernel
def run_every_stage(run, end) -> int:
    """As :func:`run_stages`, where no stage waits for Python, so that none has run yet."""
    run_stages_between(run, 0, end)
    return -1


@kernel
def run_stages_between(run, first, end):
    """Run the stages from index ``first`` to the one before ``end`` that are due at t_k. The run may have stopped."""
    for i in range(first, end):
        if not run_stage(run, run.stages[i], i):
            return


@kernel
def run_stage(run, stage, i) -> bool:
    """Run a stage, number i, if it is due at t_k. Returns False if it waits for Python, or the run has stopped."""
    if stage.period_steps == 1 or run.step % stage.period_steps == 0:
        if i == run.actuation:
            check_command(run)
            if run.stop != STOP_NONE:
                return False
        begin_stage(run, stage)
        if stage.code_at == 0:
            return False
        at = run.address
        wrong = call_code(
            stage.code_at, at + 8 * stage.settings, at + 8 * stage.state, at + 8 * stage.given,
            at + 8 * stage.state_dot, at + 8 * stage.out,
        )  # fmt: skip
        if wrong != 0:
            stop_run(run, STOP_STAGE, wrong, 0.0)
            return False
    return True


@kernel
def check_command(run):
    """Stop the run if tau_cmd is out of bounds."""
    for i in range(6):
        command = run.numbers[run.tau_cmd + i]
        if not abs(command) <= run.tau_bound:
            stop_run(run, STOP_COMMAND, i, command)


@kernel
def limit_thrust(run):
    """Set u to the thrusts within the limits of the vehicle's file, of propellers in the water, and tau = B u."""
    u_cmd, u_min, u_max = run.commands.u_cmd, run.allocation.u_min, run.allocation.u_max
    run.saturated = 0
    for k in range(run.u.shape[0]):
        produced = u_cmd[k] if run.ideal != 0 else run.thrust[k]
        if not abs(produced) <= _LARGEST:
            stop_run(run, STOP_THRUST, k, produced)
        thrust = min(run.high[k], max(run.low[k], produced))
        if not abs(thrust) <= run.tau_bound:  # MuJoCo would ignore it
            stop_run(run, STOP_THRUST, k, thrust)
        if run.places.shape[0] != 0:
            thrust *= covered(run.plant.effects, run.t, run.true.p_WB + run.true.R_WB @ run.places[k])
        run.u[k] = thrust
        if u_cmd[k] <= u_min[k] or u_cmd[k] >= u_max[k]:
            run.saturated = 1
            run.limited_next[k] += run.timestep
    add_columns(run.columns, run.u, run.low, run.high, run.true.tau)


@kernel
def add_columns(columns, u, low, high, wrench):
    """Set the wrench (6,) B u of n thrusts within their limits; ``columns`` (n, 6) are the columns of B."""
    wrench[:] = 0.0
    for k in range(u.shape[0]):
        wrench += columns[k] * min(high[k], max(low[k], u[k]))


@kernel
def estimate_wrench(run):
    """Set tau_hat, the wrench of the commanded thrusts as the controller knows the thrusters, for the next instant, and
    the part of tau_cmd that it lacks."""
    tau_hat, tau, given = run.signals.tau_hat, run.true.tau, run.allocation
    if run.believed == 0:
        tau_hat[:] = tau
    else:
        add_columns(run.columns_hat, run.commands.u_cmd, given.u_min, given.u_max, tau_hat)
    run.tau_lost[:] = given.tau_cmd - tau_hat


@kernel
def begin_step(run) -> bool:
    """Do everything up to the thrust of step k. Returns True if the step may continue."""
    finish_step(run)
    if run.stop != STOP_NONE:
        return False
    observe(run)
    if run.stop != STOP_NONE:
        return False
    waiting = run_stages(run, run.stage_count)
    if waiting >= 0:
        stop_run(run, STOP_WAITING, waiting, 0.0)
    if run.stop != STOP_NONE:
        return False
    return apply_thrust(run)


@kernel
def apply_thrust(run) -> bool:
    """Set the thrust of step k, whose stages have run, and the running signals that it changes. Returns True if the
    step may continue."""
    limit_thrust(run)
    estimate_wrench(run)
    if run.stop != STOP_NONE:
        return False
    row, tau = run.row, run.true.tau
    row.t = run.t
    flow_again(run)
    row.tau_dist[:] = run.plant.water.tau_dist
    if run.step > 0:
        change = np.abs(tau - run.tau_before)
        row.tau_variation += change
        row.tau_step_max[:] = np.maximum(row.tau_step_max, change)
    row.tau_max[:] = np.maximum(row.tau_max, np.abs(tau))
    run.tau_before[:] = tau
    run.pending = 1
    return True


@kernel
def finish_step(run):
    """Complete step k, whose contact force and acceleration are now known: running signals, and a row if one is due."""
    if run.pending != 0:
        run.pending = 0
        complete_step(run)


@kernel
def complete_step(run):
    """As :func:`finish_step`, of a step that surely lacks them."""
    complete_row(run)
    write_row(run)
    if run.saturated != 0:  # for the coming step
        run.row.saturation_time += run.timestep
        run.limited[:] = run.limited_next
    if run.plant.wet.shape[0] != 0 and run.plant.wet[0].fraction == 0.0:
        run.plant.wet[0].dry_time += run.timestep
    run.row.effort += run.timestep * run.true.tau * run.true.tau
    if run.has_task != 0:
        run.row.boundary_layer_time += np.where(np.abs(run.signals.s) < run.epsilon, run.timestep, 0.0)
    if run.plant.advancing.shape[0] != 0:
        advance_effects(run.plant.effects, run.plant.nu_r, run.allocation.tau_cmd, run.timestep)
    run.step += 1
    run.next = 0


@kernel
def complete_row(run):
    """Complete the row of step k: contact force, acceleration, and the running signals until t_k."""
    plant, row, true, h, push_before = run.plant, run.row, run.true, run.timestep, run.push[0]
    if run.pairs.shape[0] != 0:
        force_of_step(run)
    push = run.push[0]
    if push > 0.0 and push_before <= 0.0:
        row.touches += 1.0
        if row.first_contact < 0.0:
            row.first_contact = run.t
    row.force_peak = max(row.force_peak, push)
    if run.step > 0:  # trapezoidal rule
        row.impulse += 0.5 * h * (push + push_before)
        if run.step > run.window_step:
            row.final_impulse += 0.5 * h * (push + push_before)
    if run.step == run.window_step:
        row.final_low, row.final_high = push, push
    elif run.step > run.window_step:
        row.final_low, row.final_high = min(row.final_low, push), max(row.final_high, push)
    body_acceleration(true.R_WB, plant.qacc, true.nu, true.nu_dot)
    run.q_ddot[:] = plant.qacc[6:]
    if run.banded_count != 0:
        widen_bands(run)


@kernel
def write_row(run):
    """Append row k, gathered from where each recorded signal lies, if one is due."""
    if not (run.row_count < run.row_capacity and (run.step % run.row_steps == 0 or run.step == run.steps)):
        return
    at = run.rows + run.row_count * run.row_width
    for k in range(run.span_count):
        n = run.spans[k, 1]
        copy_numbers(run.numbers, run.spans[k, 0], n, at)
        at += n
    run.row_count += 1
    run.band_steps = 0


@kernel
def widen_bands(run):
    """Widen the band of each banded signal to its value of step k; the first step after a row begins a new band."""
    numbers, low = run.numbers, run.bands
    for k in range(run.banded_count):
        now, n = run.banded[k, 0], run.banded[k, 1]
        high = low + n
        if run.band_steps == 0:
            copy_numbers(numbers, now, n, low)
            copy_numbers(numbers, now, n, high)
        else:
            for i in range(n):
                numbers[low + i] = min(numbers[low + i], numbers[now + i])
                numbers[high + i] = max(numbers[high + i], numbers[now + i])
        low += 2 * n
    run.band_steps += 1


@kernel
def copy_numbers(numbers, source, n, target):
    """Copy n numbers from a place to another one."""
    for i in range(n):
        numbers[target + i] = numbers[source + i]


def free_steps(run, n, moving) -> int:
    """Take n time steps, or evaluate the instant in hand if ``moving`` is 0. Returns the number of steps that were
    taken before the run stopped."""
    for k in range(n):
        if not free_step(run, moving):
            return k
    return n


@kernel
def free_step(run, moving) -> bool:
    """Take one time step, or evaluate the instant in hand if ``moving`` is 0. Returns False if the run has stopped."""
    if not begin_step(run):
        return False
    free_motion(run, moving)
    return True


@kernel
def free_motion(run, moving):
    """Find the acceleration of step k from its thrust, and move on by it unless ``moving`` is 0."""
    plant, body, true, solved = run.plant, run.body, run.true, run.plant.solved
    water_wrench(plant, true.R_WB, true.nu, plant.wrench)
    tau = plant.wrench + true.tau
    if run.pairs.shape[0] != 0:
        tau += plant.tau_applied_B
    if plant.inert.shape[0] != 0:
        M, open_water, dry = body.M_RB + plant.links[0].M, body.M_RB + plant.links[0].M, 0.0
        if plant.wet.shape[0] != 0:
            dry = 1.0 - plant.wet[0].fraction
        add_inertias(plant, dry, true.R_WB, M)
        if np.array_equal(M, open_water):  # a reset has taken these effects away
            body.M_inv[:] = body.M_inv_open
        else:
            cholesky(M, M)
            inverse(M, body.M_inv)
    free_acceleration(body, true.R_WB, true.nu, tau, plant.qacc)
    if run.pairs.shape[0] != 0:
        pair, contact = run.pairs[0], run.pairs[0].contact
        solved[0] = 0.0
        if pair.solved != 0 and contact.touching != 0:
            f_n = soft_contact(body, contact, pair.depth, true.R_WB, plant.qvel, plant.qacc)
            solved[0], solved[1:] = 1.0, f_n * contact.normal_W
    if moving != 0:
        symplectic_step(plant.qpos, plant.qvel, plant.qacc, run.timestep)


@kernel
def fleet_steps(run, n):
    """Take n time steps of a run of a fleet, each complete when the next one begins."""
    for _ in range(n):
        if not free_step(run, 1):
            return
        complete_step(run)


@kernel
def fleet_look(run, law, through):
    """Run the stages before index ``law`` at the instant in hand of a run of a fleet; and if ``through`` is not 0,
    evaluate the whole instant, and complete its row."""
    observe(run)
    if run.stop != STOP_NONE:
        return
    run_stages_between(run, 0, law)
    if through == 0 or run.stop != STOP_NONE:
        return
    run_stages_between(run, law, run.stage_count)
    if run.stop == STOP_NONE and apply_thrust(run):
        free_motion(run, 0)
        complete_row(run)


@kernel
def finished(run):
    """In place of :func:`finish_step` in a fleet, whose steps are complete."""


_PLACES, _TABLE = np.dtype(("i8", (NUMBERS,))), np.dtype(("f8", (NUMBERS,)))


def take_steps(runs, first, last, n, step, advance, control):
    """Take n time steps in each of the runs ``first`` to ``last``, by the addresses of their records, and prepare the
    next one: its stages up to index ``control``. ``step`` and ``advance`` are addresses of machine code."""
    for i in range(first, last):
        call_code(step, runs[i], n, 1)
        call_code(advance, runs[i], control)


def step_together(ends, end_count, ties, tie_count, runs, run_count, n) -> int:
    """Take n time steps in each of some runs: let each take a step, and then find what couples them in the next one. A
    row (6,) of ``ends`` has the addresses of :func:`uvms_mj.physics.coupling.place_end` and of its arguments, a row
    (4,) of ``ties`` the addresses of the forces between two ends, and a row (2,) of ``runs`` the addresses of the
    machine code of a step and of the run's record. Returns the number of steps that all runs have taken before one
    of them stopped."""
    for k in range(n):
        for i in range(run_count):
            if call_code(runs[2 * i], runs[2 * i + 1], 1, 1) == 0:
                return k
        for i in range(end_count):
            at = 6 * i
            call_code(ends[at], ends[at + 1], ends[at + 2], ends[at + 3], ends[at + 4], ends[at + 5])
        for i in range(tie_count):
            at = 4 * i
            call_code(ties[at], ties[at + 1], ties[at + 2], ties[at + 3])
    return n


def gather(runs, n, places, count, table):
    """Copy ``count`` numbers of each of n runs to the rows of a table, by their places in the record."""
    for i in range(n):
        numbers = floats(runs[i], NUMBERS)
        for k in range(count):
            table[i * count + k] = numbers[places[k]]


def scatter(runs, n, places, count, table):
    """Copy the rows of a table to the records, the reverse of :func:`gather`."""
    for i in range(n):
        numbers = floats(runs[i], NUMBERS)
        for k in range(count):
            numbers[places[k]] = table[i * count + k]


@made_once
def many_runs() -> dict[str, NativeFunction]:
    """The machine code of this module, by name."""
    copy: list[np.dtype | str] = [_PLACES, "i8", _PLACES, "i8", _TABLE]
    parts: dict[Any, list[np.dtype | str]] = {take_steps: [_PLACES, *["i8"] * 6], gather: copy, scatter: copy}
    parts[step_together] = [*[_PLACES, "i8"] * 3, "i8"]
    return {each.__name__: code for each, code in zip(parts, native_functions(parts), strict=True)}


@kernel
def take_period(chain, address, constants) -> int:
    """Take one period of a chain at the time ``chain.t`` [s] with the measurements in its record, which is at an
    address. The settings that nobody changes are at the address ``constants``. Returns 0, or the number of the stage
    that ended early, or -1 for a command out of bounds."""
    chain.address = address
    if chain.turns != 0:
        rotation(chain.measured.quat_WB, chain.measured.R_WB)
    for i in range(chain.stages.shape[0]):
        stage = chain.stages[i]
        if chain.waits[i] > 0:
            chain.waits[i] -= 1
        else:
            chain.waits[i] = stage.period_steps - 1
            if i == chain.actuation:
                check_command(chain)
                if chain.stop != STOP_NONE:
                    return -1
            begin_stage(chain, stage)
            settings = (constants if chain.fixed[i] != 0 else address) + 8 * stage.settings
            wrong = call_code(
                stage.code_at, settings, address + 8 * stage.state, address + 8 * stage.given,
                address + 8 * stage.state_dot, address + 8 * stage.out,
            )  # fmt: skip
            if wrong != 0:
                return i + 1
    u_cmd, u_min, u_max = chain.commands.u_cmd, chain.allocation.u_min, chain.allocation.u_max
    tau_hat = chain.signals.tau_hat
    if chain.believed == 0:
        add_columns(chain.columns, u_cmd, chain.low, chain.high, tau_hat)
    else:
        add_columns(chain.columns_hat, u_cmd, u_min, u_max, tau_hat)
    chain.saturated = 0
    for k in range(u_cmd.shape[0]):
        if u_cmd[k] <= u_min[k] or u_cmd[k] >= u_max[k]:
            chain.saturated = 1
    chain.step += 1
    return 0
