"""MuJoCo's warnings as Python's. By itself MuJoCo writes them into MUJOCO_LOG.TXT in the working folder."""

import contextlib
import warnings
from collections.abc import Iterator

import mujoco


class MujocoWarning(UserWarning):
    """MuJoCo met a number that it can't go on with."""


@contextlib.contextmanager
def mujoco_warnings() -> Iterator[None]:
    """Collect what MuJoCo says, and warn of it once, at the end."""
    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
        for text in dict.fromkeys(said):
            warnings.warn(f"MuJoCo: {text}", MujocoWarning, stacklevel=4)
