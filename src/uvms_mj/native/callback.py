"""MuJoCo's ``mjcb_control`` in machine code: the water, and around it the closed loop where there is one.

MuJoCo calls it in every forward evaluation of every model of the process, after it has built and factored the
joint-space inertia and before it uses it. The callback looks the mjData up among the attached ones and returns at
once from a stranger's.
"""

import functools
from typing import NamedTuple

from ..frames import body_velocity, to_world
from ..hydrodynamics import added_inertia, factor, water_wrench
from ..kernels import kernel
from .compilation import NativeFunction, native_function
from .loop import begin_step, finish_step, hold, sense
from .memory import context_at, floats, loop_at, mj_factorM, registered, triples


@kernel
def add_inertia(context, R_WB, model, data):
    """Add T^T M_A T to mjData.M and factor it, unless this M has it already.

    mj_forwardSkip and mjd_transitionFD evaluate again on an M that was not rebuilt; it is then what the callback
    left, bit for bit.
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
def apply_wrench(context, R_WB):
    """Put the wrench (6,) in B at B's origin into xfrc_applied, which acts in W at the centre of mass.

    What somebody else wrote there since the last call (the mouse in MuJoCo's viewer, a user's loop) is kept beside it.
    """
    xfrc, left, other, wrench = floats(context.xfrc_at, 6), context.xfrc_left, context.xfrc_other, context.wrench
    same = True
    for i in range(6):
        if xfrc[i] != left[i]:
            same = False
    if not same:
        for i in range(6):
            other[i] = xfrc[i]
    r, work = context.r_com, context.work
    work[0] = wrench[3] - (r[1] * wrench[2] - r[2] * wrench[1])
    work[1] = wrench[4] - (r[2] * wrench[0] - r[0] * wrench[2])
    work[2] = wrench[5] - (r[0] * wrench[1] - r[1] * wrench[0])
    to_world(R_WB, wrench, left)
    to_world(R_WB, work, work)
    for i in range(3):
        left[i + 3] = work[i]
    for i in range(6):
        left[i] += other[i]
        xfrc[i] = left[i]


@kernel
def evaluate(context, model, data):
    """One forward evaluation of one attached vehicle."""
    context.calls += 1
    R_WB = triples(context.R_at, 3)
    add_inertia(context, R_WB, model, data)
    t = floats(context.time_at, 1)[0]
    if context.loop_at != 0:
        loop = loop_at(context.loop_at)
        if not begin_step(context, loop):
            hold(context, loop)
            return
        t = loop.t
    body_velocity(R_WB, floats(context.qvel_at, 6), context.nu)
    water_wrench(context.water, t, R_WB, context.nu, context.nu_r, context.work, context.wrench)
    apply_wrench(context, R_WB)


def _callback(model, data):
    table = registered()
    for i in range(1, table[0, 0] + 1):
        if table[i, 0] == data:
            evaluate(context_at(table[i, 1]), model, data)


def _sense(address):
    context = context_at(address)
    loop = loop_at(context.loop_at)
    finish_step(context, loop)
    if loop.step % loop.period_steps == 0:
        sense(context, loop)
        return 1
    return 0


def _finish(address):
    context = context_at(address)
    finish_step(context, loop_at(context.loop_at))


class EntryPoints(NamedTuple):
    """The machine code that Python hands to MuJoCo or calls between chunks."""

    control: NativeFunction
    sense: NativeFunction
    finish: NativeFunction


@functools.cache
def entry_points() -> EntryPoints:
    """Loaded or compiled at the first use."""
    return EntryPoints(
        native_function(_callback, 2, False),
        native_function(_sense, 1, True),
        native_function(_finish, 1, False),
    )
