"""Why a run stopped: the first variable that left its bounds, as text."""

import numpy as np

from .record import JOINT_BOUND, STOP_COMMAND, STOP_JOINT, STOP_STATE, STOP_THRUST, STOP_WAITING

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
