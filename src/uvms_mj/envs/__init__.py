"""Environments for reinforcement learning and for agents of any kind, on :class:`uvms_mj.Simulation`.

:func:`load` gives a ``dm_control.rl.control.Environment`` (dm_env's interface; extra ``dm``). Importing this module
registers the same task with Gymnasium as ``uvms_mj/PushWall-v0`` (extra ``gym``). :class:`PushWorld` is the task for
several vehicles of a world (extra ``gym``). :mod:`.push` describes actions, observations and reward.
"""

import contextlib
from typing import TYPE_CHECKING, Any

from ..errors import needs_extra
from .push import Seen as Seen

if TYPE_CHECKING:
    from dm_control.rl.control import Environment

    from .world import PushWorld as PushWorld


def load(name: str = "push_wall", **settings: Any) -> "Environment":
    """An environment of dm_control with the water attached, of a scenario's name or the path of its file. The settings
    are the keyword arguments of :class:`uvms_mj.envs.push.Push`.

    Raises:
        InputError: an argument is wrong, or the extra ``dm`` is not installed.
    """
    with needs_extra("dm"):
        from dm_control.rl import control

        from .dm import PushTask, WaterPhysics
    from .push import Push

    push = Push(name, **settings)
    return control.Environment(WaterPhysics(push), PushTask(push), n_sub_steps=push.steps_each)


with contextlib.suppress(ModuleNotFoundError):  # without Gymnasium there is nothing to register with
    from gymnasium.envs.registration import register

    register(
        "uvms_mj/PushWall-v0",
        entry_point="uvms_mj.envs.gym:PushWall",
        vector_entry_point="uvms_mj.envs.gym:PushWallVec",
    )


def __getattr__(name: str) -> object:
    """Import ``PushWorld`` on first use: it needs Gymnasium."""
    if name != "PushWorld":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from .world import PushWorld

    return PushWorld
