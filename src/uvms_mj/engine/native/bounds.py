"""The bounds of a run, and the first reason why it stops."""

from ...physics.kernels import kernel
from .layouts import JOINT_BOUND, STOP_COMMAND, STOP_JOINT, STOP_NONE, STOP_STATE
from .memory import floats


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
    true = loop.true
    for i in range(3):
        if not abs(true.p_WB[i] - loop.qpos_safe[i]) <= loop.position_bound:
            stop_run(loop, STOP_STATE, i, true.p_WB[i])
    for i in range(6):
        if not abs(true.nu[i]) <= loop.speed_bound[i]:
            stop_run(loop, STOP_STATE, 3 + i, true.nu[i])


@kernel
def check_command(loop):
    """Stop the run if tau_cmd is out of bounds."""
    tau_cmd = floats(loop.tau_cmd_at, 6)
    for i in range(6):
        if not abs(tau_cmd[i]) <= loop.tau_bound:
            stop_run(loop, STOP_COMMAND, i, tau_cmd[i])


@kernel
def observe_joints(context, loop):
    """Copy the positions and velocities of the joints, and stop the run if they are out of bounds."""
    n = loop.joints
    q, q_dot = floats(loop.q_at, n), floats(loop.q_dot_at, n)
    q_now, q_dot_now = floats(context.q_at, n), floats(context.q_dot_at, n)
    for k in range(n):
        q[k], q_dot[k] = q_now[k], q_dot_now[k]
        if not abs(q[k]) <= JOINT_BOUND:
            stop_run(loop, STOP_JOINT, k, q[k])
        if not abs(q_dot[k]) <= JOINT_BOUND:
            stop_run(loop, STOP_JOINT, k + n, q_dot[k])
