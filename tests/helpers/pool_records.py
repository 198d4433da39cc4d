"""Records of a pool that the simulator itself makes, in the files of Kolano and Davidson."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from uvms_mj.reproduce.validate.data import AXES, ZERO, Attitude, Motion
from uvms_mj.reproduce.validate.vehicle import Variant, floating


def reach(end: tuple[float, ...], duration: float = 7.0) -> Motion:
    """A smooth motion of the joints from the folded arm to a posture [rad], with a second of rest at both ends."""
    t = np.linspace(0.0, duration, 501)
    share = np.clip((t - 1.0) / (duration - 2.0), 0.0, 1.0)
    q = np.array([0.0, 0.1, 0.1, -1.3]) + np.outer(share**3 * (10.0 - 15.0 * share + 6.0 * share**2), end)
    return Motion(0.0, duration, CubicSpline(t, q))


def write(folder: Path, name: str, motion: Motion, variant: Variant, late: float = 0.0, lost: float = 0.0) -> None:
    """Write the three files of a record. The clock of both instruments is late by a time [s]. From 3 s on the pitch of
    the motion capture is wrong by an angle [deg]: it takes one marker for another."""
    found = floating(motion, variant)
    measured = replace(found, t=found.t + late)
    wrong = np.zeros_like(found.angles)
    wrong[found.t > 3.0, 1] = np.radians(lost)
    quaternions(measured).to_csv(folder / f"{name}_imu.csv", index=False)
    quaternions(replace(measured, angles=measured.angles + wrong)).to_csv(folder / f"{name}_mocap.csv", index=False)
    t = np.arange(motion.begin, motion.end, 0.016)
    columns = {f"{axis}_pos": q for axis, q in zip(AXES, (motion.q(t) + ZERO).T, strict=True)}
    pd.DataFrame({"time_secs": t} | columns).to_csv(folder / f"{name}_joint_states.csv", index=False)


def quaternions(attitude: Attitude) -> pd.DataFrame:
    x, y, z, w = Rotation.from_euler("ZYX", attitude.angles[:, ::-1]).as_quat().T
    return pd.DataFrame({"time_secs": attitude.t, "x_ori": -x, "y_ori": -y, "z_ori": -z, "w_ori": -w})
