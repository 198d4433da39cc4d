"""Records of a pool: a vehicle that floats with its thrusters off while its arm moves.

A record is three files, ``NAME_mocap.csv``, ``NAME_imu.csv`` and ``NAME_joint_states.csv``, with the time in seconds
from the start of the recording in the first column. A record in which the arm moves is a trial, all others are records
at rest. Angles are roll, pitch and yaw of R_WB = R_z(yaw) R_y(pitch) R_x(roll), with z up.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation

from ...errors import Fault, InputError

AXES = ("axis_e", "axis_d", "axis_c", "axis_b")
"""Joints of the arm, from the vehicle outwards."""
ZERO = (3.07, 0.0, 0.0, 2.879)
"""The reading of each joint where the joint angle of the model is zero [rad] (Kolano and Davidson)."""
MOVES = 0.02
"""An arm moves when a joint has left its first posture by this angle [rad]: ten times the noise of the encoders."""
LEAST, MOST = 5.0, 600.0
"""Bounds on the time that the three files of a record share [s]."""
_QUATERNION = ("x_ori", "y_ori", "z_ori", "w_ori")
_COLUMNS = {"mocap": _QUATERNION, "imu": _QUATERNION, "joint_states": tuple(f"{axis}_pos" for axis in AXES)}
"""Columns that are read of each file, besides time_secs."""
_STEP, _WINDOW, _ORDER = 0.02, 31, 3
"""Grid of the smoothed joint angles [s]; points and order of the polynomials that smooth them: 0.6 s, cubic."""


@dataclass(frozen=True, eq=False)
class Attitude:
    """An attitude over time: t (n,) [s], angles (n, 3) roll, pitch, yaw [rad], yaw without jumps."""

    t: np.ndarray
    angles: np.ndarray

    @classmethod
    def of(cls, t: np.ndarray, quat: np.ndarray) -> "Attitude":
        """From unit quaternions (n, 4), w x y z."""
        yaw, pitch, roll = Rotation.from_quat(quat[:, [1, 2, 3, 0]]).as_euler("ZYX").T
        return cls(t, np.column_stack([roll, pitch, np.unwrap(yaw)]))

    def at(self, t: np.ndarray) -> np.ndarray:
        """Angles (m, 3) at other times, linear between the samples."""
        return np.column_stack([np.interp(t, self.t, angle) for angle in self.angles.T])


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion of the joints from ``begin`` to ``end`` [s]: ``q(t)`` and, as ``q(t, 1)``, its rate [rad, rad/s]."""

    begin: float
    end: float
    q: CubicSpline

    @classmethod
    def of(cls, t: np.ndarray, q: np.ndarray) -> "Motion":
        """Smooth samples of the joints' angles, t (n,) and q (n, 4)."""
        grid = np.arange(t[0], t[-1], _STEP)
        even = np.column_stack([np.interp(grid, t, each) for each in q.T])
        return cls(grid[0], grid[-1], CubicSpline(grid, savgol_filter(even, _WINDOW, _ORDER, axis=0)))


@dataclass(frozen=True, eq=False)
class Record:
    """One record: the joint angles of the arm, t (n,) and q (n, 4), and two measurements of the vehicle's attitude."""

    name: str
    t: np.ndarray
    q: np.ndarray
    mocap: Attitude
    imu: Attitude

    @functools.cached_property
    def motion(self) -> Motion:
        return Motion.of(self.t, self.q)

    @property
    def starts(self) -> float:
        """Time at which the arm begins to move [s], infinite where it rests."""
        moved = np.abs(self.q - self.q[0]).max(axis=1) > MOVES
        return float(self.t[np.argmax(moved)]) if moved.any() else np.inf


def records(folder: str | Path) -> tuple[list[Record], list[Record]]:
    """The trials and the records at rest of a folder, sorted by name.

    Raises:
        InputError: there is no such folder, it has no trial, or files are missing or can't be read, all at once.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"--data {folder}: {'is not a folder' if folder.exists() else 'no such folder'}; {_WANTED}")
    stems = sorted(
        {path.name.removesuffix(f"_{kind}.csv") for kind in _COLUMNS for path in folder.glob(f"*_{kind}.csv")}
    )
    if not stems:
        raise InputError(f"--data {folder}: has no record; {_WANTED}")
    faults: list[Fault] = []
    found = [record for stem in stems if (record := _record(folder, stem, faults))]
    if faults:
        raise InputError(faults, f"--data {folder}")
    trials = [record for record in found if record.starts < np.inf]
    if not trials:
        raise InputError(f"--data {folder}: the arm moves in none of its records ({', '.join(stems)})")
    return trials, [record for record in found if record.starts == np.inf]


_WANTED = f"a record is the files {', '.join(f'NAME_{kind}.csv' for kind in _COLUMNS)}"


def _record(folder: Path, name: str, faults: list[Fault]) -> Record | None:
    files = {kind: _columns(folder / f"{name}_{kind}.csv", columns, faults) for kind, columns in _COLUMNS.items()}
    if any(len(values) == 0 for values in files.values()):
        return None
    shared = min(values[-1, 0] for values in files.values()) - max(values[0, 0] for values in files.values())
    if not LEAST <= shared <= MOST:
        faults.append(Fault(name, f"its files share {shared:.4g} s; {LEAST:g} to {MOST:g} s are needed"))
        return None
    attitudes = [Attitude.of(files[kind][:, 0], files[kind][:, [4, 1, 2, 3]]) for kind in ("mocap", "imu")]
    joints = files["joint_states"]
    return Record(name.removeprefix("traj").strip("_"), joints[:, 0], joints[:, 1:] - ZERO, *attitudes)


def _columns(path: Path, names: Sequence[str], faults: list[Fault]) -> np.ndarray:
    """Time and columns (n, 1 + len(names)) of a file; empty after an error, which is appended to ``faults``."""
    import pandas as pd

    names = ("time_secs", *names)
    try:
        frame = pd.read_csv(path)
    except FileNotFoundError:
        faults.append(Fault(path.name, "is missing"))
        return np.empty((0, 0))
    except (OSError, ValueError) as error:  # of pandas: an empty file, rows of different lengths, not text
        faults.append(Fault(path.name, f"can't be read: {' '.join(str(error).split())}"))
        return np.empty((0, 0))
    if missing := [name for name in names if name not in frame]:
        faults.append(Fault(path.name, f"lacks the columns {', '.join(missing)}"))
        return np.empty((0, 0))
    values = frame[list(names)].apply(pd.to_numeric, errors="coerce").to_numpy(float)
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0]
        faults.append(Fault(path.name, f"{names[column]} in line {row + 2} is not a finite number"))
    elif len(values) < 100 or (np.diff(values[:, 0]) <= 0.0).any():
        faults.append(Fault(path.name, "needs at least 100 lines, with time_secs growing from each line to the next"))
    elif names[1:] == _QUATERNION and (np.abs((lengths := np.linalg.norm(values[:, 1:], axis=1)) - 1.0) > 0.01).any():
        row = int(np.argmax(np.abs(lengths - 1.0)))
        faults.append(Fault(path.name, f"the quaternion in line {row + 2} has the length {lengths[row]:.4g}, not 1"))
    else:
        return values
    return np.empty((0, 0))
