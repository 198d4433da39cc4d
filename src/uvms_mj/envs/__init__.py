"""Environments for reinforcement learning and for agents of any kind, on :class:`uvms_mj.Simulation`.

:func:`load` gives a ``dm_control.rl.control.Environment`` (dm_env's interface; extra ``dm``). Gymnasium finds the same
task as ``uvms_mj/PushWall-v0`` (extra ``gym``). :mod:`.push` describes actions, observations and reward.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dm_control.rl.control import Environment


def load(name: str = "push_wall", **settings: Any) -> "Environment":
    """An environment of dm_control with the water attached.

    Args:
        name: name of a scenario, or path of its file.
        settings: keyword arguments of :class:`uvms_mj.envs.push.Push`.

    Raises:
        InputError: an argument is wrong, or the extra ``dm`` is not installed.
    """
    from .dm import environment

    return environment(name, **settings)


def register() -> None:
    """Register the environments with Gymnasium, which calls this at import. It sets the prefix ``uvms_mj/``."""
    from gymnasium.envs.registration import register as add

    add("PushWall-v0", entry_point="uvms_mj.envs.gym:PushWall")


__all__ = ["load", "register"]
