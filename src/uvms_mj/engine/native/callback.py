"""MuJoCo's ``mjcb_control`` in machine code: hydrodynamics and, with a controller, the closed loop.

MuJoCo calls it in every forward evaluation of every model of the process, after it has built and factored the
joint-space inertia and before it uses it. The callback returns immediately if the mjData is not attached. This module
is the border to MuJoCo's memory: the state is copied to the record, and inertia, forces and commands are written to
mjData.

MuJoCo's timers stand still while a Simulation steps. MuJoCo's Python package sets ``mjcb_time``, with which ``mj_step``
reads the clock some thirty times a step for ``mjData.timer``. That takes a fifth of the step of a rigid vehicle, and
nobody asks for these times in a run.
"""

import ctypes
import threading
from typing import Any

import numpy as np

from ...physics.buoyancy import dry_fraction
from ...physics.effects import add_inertias, add_pulls
from ...physics.flow import flow
from ...physics.frames import body_velocity, to_world
from ...physics.hydrodynamics import added_inertia, factor, water_wrench
from ...physics.kernels import fused, kernel
from ...physics.tree import along_joint, compose_links, deliverable, full_inertia, joint_column, place_links
from .compilation import made_once, native_function
from .loop import begin_step, finish_step, flow_again, observe, run_stages
from .memory import call_code, clock, floats, frozen_clock, mj_factorM, mujoco_library, registered, triples
from .record import STOP_NONE, alone_dtype, with_numbers


@kernel
def read_state(plant):
    """Copy the state of the vehicle from mjData to the record, and set the frames of its links."""
    mujoco, n = plant.mujoco, plant.links.shape[0] - 1
    R, qpos, qvel = triples(mujoco.R_at, 3), floats(mujoco.qpos_at, 7 + n), floats(mujoco.qvel_at, 6 + n)
    plant.time = floats(mujoco.time_at, 1)[0]
    plant.R_WB[:], plant.qpos[:], plant.qvel[:] = R, qpos, qvel
    if n > 0:
        place_links(plant.frames, plant.qpos, 7)


@kernel
def read_step(plant):
    """Copy the results of MuJoCo's last step to the record."""
    mujoco = plant.mujoco
    plant.qacc[:], plant.solved[:] = floats(mujoco.qacc_at, plant.qacc.shape[0]), floats(mujoco.solved_at, 4)


@fused
def add_inertia(plant, model, data):
    """Add the added mass of all links to mjData.M and factor it, unless M already contains it.

    mj_forwardSkip and mjd_transitionFD evaluate again without rebuilding M. M is then bit for bit as the callback left
    it. A row of M has the entries of the base, of the joints from the base to the link, and of the link's own joint.
    """
    mujoco, links, frames, R_WB, left = plant.mujoco, plant.links, plant.frames, plant.R_WB, plant.M_left
    n = links.shape[0] - 1
    M = floats(mujoco.M_at, plant.M_rows[n] + 21 + n)
    same = True
    for i in range(21):  # added mass of any link is added mass of the base
        if M[i] != left[i]:
            same = False
    if same:
        return
    compose_links(links, frames)
    full_inertia(links[0].composite, plant.M_BB)
    dry = 0.0
    if plant.wet.shape[0] != 0:  # of this evaluation, whose flow comes later
        dry = dry_fraction(plant.effects, plant.time, plant.qpos[:3], R_WB)
    add_inertias(plant, dry, R_WB, plant.M_BB)
    added_inertia(plant.M_BB, R_WB, plant.added)
    for i in range(21):
        M[i] += plant.added[i]
        left[i] = M[i]
    for k in range(1, n + 1):
        link, frame, row = links[k], frames[k], plant.M_rows[k]
        joint_column(link, frame.S)
        F, above, place_of = link.F, k, row + 5 + frame.depth
        for _ in range(frame.depth):
            joint = frames[above]
            M[place_of] += along_joint(joint.S, F)
            above = joint.parent
            place_of -= 1
        to_world(R_WB, F, plant.work)
        for i in range(3):
            M[row + i] += plant.work[i]
            M[row + 3 + i] += F[3 + i]
    if mujoco.qLD_at != 0:
        factor(M, floats(mujoco.qLD_at, 21), floats(mujoco.qLDiagInv_at, 6))
    else:
        mj_factorM(model, data)


@kernel
def passive_with_water(plant):
    """Set ``passive_left`` to the vehicle's entries of mjData.qfrc_passive with the wrench of the water.

    MuJoCo has just reset these entries. If mj_forwardSkip skipped that stage, they still have the values that the
    callback left.
    """
    before, left, N = plant.passive_before, plant.passive_left, plant.wrench.shape[0]
    keep_passive(plant, 0, 6)
    to_world(plant.R_WB, plant.wrench, left)  # a free joint's force is in W, its moment in B
    left[:3] += before[:3]
    if N > 6:
        keep_passive(plant, 6, N)
    left[3:] = before[3:] + plant.wrench[3:]


@kernel
def keep_passive(plant, first, end):
    """Set entries of ``passive_before`` to mjData.qfrc_passive, unless the callback has left these entries."""
    passive = floats(plant.mujoco.passive_at, plant.wrench.shape[0])[first:end]
    if np.any(passive != plant.passive_left[first:end]):
        plant.passive_before[first:end] = passive


@kernel
def add_contacts(run):
    """Add the contact forces that MuJoCo's contact solver does not apply to ``passive_left``."""
    plant, left = run.plant, run.plant.passive_left
    left[:3] += plant.f_applied_W
    left[3:6] += plant.tau_applied_B[3:]


@kernel
def write_passive(plant):
    """Write the vehicle's entries of mjData.qfrc_passive."""
    passive = floats(plant.mujoco.passive_at, plant.wrench.shape[0])
    passive[:] = plant.passive_left


@kernel
def apply_thrust(run):
    """Write u to MuJoCo's ctrl, which it applies in this step."""
    ctrl = floats(run.plant.mujoco.ctrl_at, run.plant.mujoco.controls)
    for k in range(run.u.shape[0]):
        ctrl[run.ctrl_index[k]] = run.u[k] / run.thrust_of_ctrl[k]
    if run.tau_q.shape[0] != 0:
        drive_joints(run, ctrl)


@kernel
def drive_joints(run, ctrl):
    """Write the motors' torques, within their limits, to MuJoCo's ctrl (m,)."""
    demand, q_dot, effort, speed_limit = run.tau_q_demand, run.encoder.q_dot, run.joints.effort, run.joints.speed_limit
    for k in range(run.tau_q.shape[0]):
        tau = deliverable(demand[k], q_dot[k], effort[k], speed_limit[k])
        run.tau_q[k] = tau
        if run.motor_index[k] >= 0:
            ctrl[run.motor_index[k]] = tau / run.torque_of_ctrl[k]
            run.saturation[k] = run.saturation_next[k]
            most = deliverable(2.0 * demand[k], q_dot[k], effort[k], speed_limit[k])
            if tau == most and demand[k] != 0.0:  # the motor would give no more
                run.saturation_next[k] += run.timestep


@kernel
def freeze(run):
    """After a stop, keep MuJoCo at a harmless state for the rest of the chunk, which is not recorded."""
    mujoco, n = run.plant.mujoco, run.tau_q.shape[0]
    qpos, qvel = floats(mujoco.qpos_at, 7 + n), floats(mujoco.qvel_at, 6 + n)
    ctrl = floats(mujoco.ctrl_at, mujoco.controls)
    qpos[:7], qpos[7:], qvel[:] = run.qpos_safe, run.q_safe, 0.0
    for k in range(mujoco.controls):
        ctrl[k] = 0.0


@kernel
def add_mass(plant, model, data):
    """Read the state, and add the added mass to mjData.M."""
    plant.calls += 1
    read_state(plant)
    add_inertia(plant, model, data)


@kernel
def flow_at_evaluation(plant, numbers):
    """Compute the motion of the water in an evaluation that is no step of a run."""
    plant.water.fresh = 0
    flow(plant, numbers, plant.time, plant.qpos[:3], plant.R_WB, plant.nu)
    add_pulls(plant.effects, plant.R_WB, plant.water.tau_dist)  # of the last step


@kernel
def set_water_wrench(plant):
    """Set the wrench of the water, and with it ``passive_left``."""
    water_wrench(plant, plant.R_WB, plant.nu, plant.wrench)
    passive_with_water(plant)


def evaluate_alone(alone, model, data):
    """Apply the hydrodynamics of one attached vehicle in one forward evaluation."""
    plant = alone.plant
    add_mass(plant, model, data)
    body_velocity(plant.R_WB, plant.qvel, plant.nu)
    flow_at_evaluation(plant, alone.numbers)
    set_water_wrench(plant)
    write_passive(plant)


def evaluate(run, model, data):
    """Apply the hydrodynamics of a run's vehicle in one forward evaluation, and run its loop if it is a step."""
    plant = run.plant
    add_mass(plant, model, data)
    stepping = run.remaining > 0  # otherwise somebody evaluates the state between two steps
    if stepping:
        run.remaining -= 1
        read_step(plant)
        if not begin_step(run):
            freeze(run)
            return
        apply_thrust(run)
    body_velocity(plant.R_WB, plant.qvel, plant.nu)
    if not stepping:
        flow_at_evaluation(plant, run.numbers)
    set_water_wrench(plant)
    if run.pairs.shape[0] != 0:
        add_contacts(run)
    write_passive(plant)


def advance(run, end) -> int:
    """Prepare step k: complete the step before it, and run its stages up to index ``end``. Returns the index of a stage
    that waits for Python to call it, otherwise -1."""
    if run.plant.mujoco.qpos_at != 0:
        read_state(run.plant)
        read_step(run.plant)
    finish_step(run)
    if run.stop == STOP_NONE:
        observe(run)
    if run.stop == STOP_NONE:
        flow_again(run)
        return run_stages(run, end)
    return -1


def finish(run):
    """Complete the last step."""
    if run.plant.mujoco.qpos_at != 0:
        read_step(run.plant)
    finish_step(run)


def _callback(model, data):
    table = registered()
    for i in range(1, table[0, 0] + 1):
        if table[i, 0] == data:
            call_code(table[i, 2], table[i, 1], model, data)


@made_once
def mjcb_control() -> Any:
    """The callback: it calls the code of each attached vehicle of an mjData."""
    return native_function(_callback, ["i8", "i8"]).ctypes


@made_once
def evaluation(joints: int, effects: np.dtype) -> int:
    """The address of the code of a forward evaluation of a vehicle with so many joints and these effects of the water,
    without a closed loop."""
    kind = with_numbers(alone_dtype(joints, effects))
    return native_function(evaluate_alone, [kind, "i8", "i8"], joints > 0).address


_clock = ctypes.c_void_p.in_dll(mujoco_library, "mjcb_time")
_show = ctypes.CFUNCTYPE(ctypes.c_double)


def _stopped() -> float:
    return frozen_clock()[0]


@made_once
def stopped_clock() -> int:
    """The address of a clock that shows when it was stopped, loaded at the first call. Without a clock, a thread within
    mj_step might call none."""
    return native_function(_stopped, []).address


class _Timers:
    """Context in which the timers of all threads stand still, and after which they go on as if they had not; several
    threads can enter it at once."""

    def __init__(self) -> None:
        self._lock, self._inside, self._before = threading.Lock(), 0, _clock.value

    def __enter__(self) -> None:
        with self._lock:
            if self._inside == 0:
                self._before = _clock.value
                clock[0] = _show(self._before)() if self._before else 0.0
                _clock.value = stopped_clock()
            self._inside += 1

    def __exit__(self, *exception: object) -> None:
        with self._lock:
            self._inside -= 1
            if self._inside == 0 and _clock.value == stopped_clock():  # otherwise somebody has set another clock
                _clock.value = self._before


timers_stopped = _Timers()
