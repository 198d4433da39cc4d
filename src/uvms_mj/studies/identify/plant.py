"""The prediction of the plant for an experiment with given coefficients and unknowns.

A motion is a run of the engine free_body from a start. A towing is the equation of steady motion, eq. (1) without
weight and buoyancy: tau = C(nu) nu + D(nu) nu. A trim is the attitude in which the moments of weight, buoyancy and the
given wrench balance.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from ...engine.simulation import Simulation
from ...errors import Fault, InputError
from ...physics.frames import rotation_matrix
from ...physics.statics import Statics
from ...plant.mjcf import Mjcf
from ...plant.vehicle import Vehicle
from ...plant.water import MOST_ROWS, Current, Disturbance
from ...scenario import Scenario
from .data import LATER, Data, Inputs

_APART = 0.05
"""Longest time from one row of a run to the next [s]."""
FAR = 1e6
"""The error of coefficients that no vehicle can have, or with which a run diverges."""


class Plant:
    """The plant of a motion: a Simulation that is begun anew for each vehicle."""

    def __init__(self, data: Data, mjcf: Mjcf, timestep: float, thrusters: Mapping[str, Any] | None) -> None:
        """Raises InputError if the engine free_body can't run the vehicle, or it has no curve of pulses."""
        self.data, inputs = data, data.inputs
        self.h = timestep
        overrides: dict[str, Any] = {
            "wall.present": False,
            "controller.name": "external",
            "simulation.timestep": timestep,
            "simulation.duration": max(timestep * np.ceil((1.0 + LATER) * data.span / timestep), timestep),
            "current.speed": 0.0,
        }
        if inputs is not None and inputs.name == "u":
            overrides["actuation.name"] = "external"
        if inputs is not None and inputs.name == "pwm":
            overrides["actuation.name"] = "pwm"
            overrides |= {f"thrusters.{key}": value for key, value in (thrusters or {"name": "t200"}).items()}
        if inputs is not None and inputs.name == "tau":
            n = len(self._table(inputs, data.experiment.delay))
            if n > MOST_ROWS:
                way = "cut the log with between, or give fewer samples with hold = 'linear'"
                wrong = f"{len(inputs.t)} samples are {n} rows of a wrench, and a run takes {MOST_ROWS}; {way}"
                raise InputError([Fault("inputs.tau", wrong)])
        scenario = Scenario.load("push_wall", overrides)
        self._simulation = Simulation(scenario, engine="free_body", mjcf=mjcf, looks=False)
        self._setup, self.steps = self._simulation.setup, scenario.steps
        spacing = min(float(np.median(np.diff(each.t))) for each in data.channels)
        self.every = max(1, round(min(spacing, _APART) / timestep))
        memory = self._simulation.record(self.every)
        self._places, at = dict[str, slice](), 0
        for signal, array in memory.recorded:
            self._places[signal.name] = slice(at, at + array.size)
            at += array.size

    def rows(self, vehicle: Vehicle, start: np.ndarray, current: np.ndarray, delay: float) -> dict[str, np.ndarray]:
        """Times t (n,), p_WB (n, 3), quat_WB (n, 4) and nu (n, 6) of a run.

        Args:
            start: (12,) position [m], roll, pitch, yaw [rad] and velocity in B [m/s, rad/s].
            current: (3,) in W [m/s].
            delay: from an input to its effect [s].
        """
        simulation, base, inputs = self._simulation, self._setup.scenario, self.data.inputs
        initial = dataclasses.replace(
            base.initial,
            position=tuple(start[:3].tolist()),
            attitude_deg=tuple(np.degrees(start[3:6]).tolist()),
            velocity=tuple(start[6:].tolist()),
        )
        speed, heading = float(np.hypot(*current[:2])), float(np.degrees(np.arctan2(current[1], current[0])))
        changed: dict[str, Any] = {
            "initial": initial,
            "current": Current(speed=speed, direction_deg=heading, vertical=float(current[2])),
        }
        if inputs is not None and inputs.name == "tau":
            changed["disturbance"] = Disturbance(table=tuple(map(tuple, self._table(inputs, delay).tolist())))
        scenario = dataclasses.replace(base, **changed)
        plant = dataclasses.replace(self._setup.plant, vehicle=vehicle)
        simulation.begin(dataclasses.replace(self._setup, scenario=scenario, plant=plant))
        memory, blocks, held = simulation.memory, [], self._held(inputs, delay)
        for steps, value in held:
            if value is not None:
                target = simulation.u if inputs is not None and inputs.name == "u" else simulation.pwm_cmd
                target[:] = value
            left = steps
            while left and not simulation.divergence:
                left -= simulation.run(min(left, max(1, simulation.chunk_steps // 2)), np.inf)
                if simulation.memory.run["row_count"][0] > len(memory.rows) // 2:
                    blocks.append(memory.taken().copy())
                    memory.clear()
        simulation.finish()
        blocks.append(memory.taken().copy())
        memory.clear()
        rows = np.concatenate(blocks)
        return {name: rows[:, self._places[name]] for name in ("t", "p_WB", "quat_WB", "nu")}

    def _table(self, inputs: Inputs, delay: float) -> np.ndarray:
        """Rows (n, 7) of a time and a wrench, linear between them. A held input changes during one step, so that each
        step has the mean of the wrench over it, and the fit sees no jump when the delay changes."""
        t = inputs.t + delay
        if inputs.linear:
            times, values = t, inputs.values
        else:
            times = np.concatenate([t[:1], np.stack([t[1:] - self.h, t[1:]], axis=1).ravel()])
            values = np.concatenate([inputs.values[:1], np.repeat(inputs.values, 2, axis=0)[1:-1]])
            keep = np.concatenate([[True], np.diff(times) > 1e-9])
            times, values = times[keep], values[keep]
        first = int(np.searchsorted(times, 0.0, side="right"))
        if first:  # a table begins at zero
            now = [np.interp(0.0, times, column) for column in values.T]
            times, values = np.concatenate([[0.0], times[first:]]), np.concatenate([[now], values[first:]])
        else:
            times, values = np.concatenate([[0.0], times]), np.concatenate([values[:1], values])
        return np.column_stack([times, values])

    def _held(self, inputs: Inputs | None, delay: float) -> list[tuple[int, np.ndarray | None]]:
        """Numbers of steps, each with the thrusts or pulses that are held during them. A step in which they change has
        their mean over it."""
        if inputs is None or inputs.name == "tau":
            return [(self.steps, None)]
        edges = np.arange(self.steps + 1) * self.h
        t, values = inputs.t + delay, inputs.values
        if inputs.linear:
            mean = np.stack([np.interp(edges[:-1] + 0.5 * self.h, t, column) for column in values.T], axis=1)
        else:  # the integral of a held input is linear between its samples
            area = np.concatenate(
                [np.zeros((1, values.shape[1])), np.cumsum(values[:-1] * np.diff(t)[:, None], axis=0)]
            )
            inside = np.stack([np.interp(edges, t, column) for column in area.T], axis=1)
            before, after = np.minimum(edges - t[0], 0.0), np.maximum(edges - t[-1], 0.0)
            whole = inside + before[:, None] * values[:1] + after[:, None] * values[-1:]
            mean = np.diff(whole, axis=0) / self.h
        change = np.flatnonzero(np.abs(np.diff(mean, axis=0)).max(axis=1) > 1e-9 * max(np.abs(values).max(), 1.0)) + 1
        starts = np.concatenate([[0], change])
        return [(int(n), mean[i]) for i, n in zip(starts, np.diff(np.append(starts, self.steps)), strict=True)]

    def predicted(
        self, vehicle: Vehicle, start: np.ndarray, current: np.ndarray, delay: float, clock: float
    ) -> list[np.ndarray]:
        """The values of each channel of the data, or of an attitude the turn from the predicted to the measured one,
        with the opposite sign. The clock of the data is slow by ``clock``: t_run = (1 + clock) t."""
        rows = self.rows(vehicle, start, current, delay)
        t = rows["t"][:, 0]
        kinds = {channel.name.partition(".")[0] for channel in self.data.channels}
        names = {"quat_WB" if kind == "attitude" else kind for kind in kinds}
        splines = {name: CubicSpline(t, rows[name]) for name in names} if len(t) > 3 else {}
        found = list[np.ndarray]()
        for channel in self.data.channels:
            at = (1.0 + clock) * channel.t
            there = at <= (t[-1] if len(t) else -1.0) + 1e-9
            if not splines or not there.all():  # it diverged
                found.append(np.full(len(at), FAR))
                continue
            name, _, part = channel.name.partition(".")
            if name == "attitude":
                assert self.data.quat is not None
                i = ("roll", "pitch", "yaw").index(part)
                found.append(-_turns(splines["quat_WB"](at), self.data.quat)[:, i])
            else:
                i = {"nu": "uvwpqr", "p_WB": "xyz"}[name].index(part)
                found.append(splines[name](at)[:, i])
        return found


def _turns(of: np.ndarray, to: np.ndarray) -> np.ndarray:
    """(n, 3) rotation vectors in B from attitudes (n, 4) to others [rad]."""
    of = of / np.linalg.norm(of, axis=1)[:, None]
    w = np.einsum("ij,ij->i", of, to)
    v = of[:, :1] * to[:, 1:] - to[:, :1] * of[:, 1:] - np.cross(of[:, 1:], to[:, 1:])
    v = np.where(w[:, None] < 0.0, -v, v)
    half = np.arctan2(np.linalg.norm(v, axis=1), np.abs(w))
    return v * (2.0 / np.maximum(np.sinc(half / np.pi), 1e-12))[:, None]


def towing(vehicle: Vehicle, nu: np.ndarray) -> np.ndarray:
    """The wrench (n, 6) that holds steady velocities nu (n, 6) through still water [N, N m], without weight and
    buoyancy. C is the matrix for M = M_RB + M_A, Fossen (2021), 6.2."""
    M = vehicle.M_RB + vehicle.M_A
    momentum = nu @ M.T
    C = np.concatenate(
        [
            np.cross(nu[:, 3:], momentum[:, :3]),
            np.cross(nu[:, :3], momentum[:, :3]) + np.cross(nu[:, 3:], momentum[:, 3:]),
        ],
        axis=1,
    )
    return C + nu @ vehicle.D_linear.T + (np.abs(nu) * nu) @ vehicle.D_quadratic.T


def trim(vehicle: Vehicle, postures: "Postures", tau: np.ndarray) -> np.ndarray:
    """(n, 2) roll and pitch [rad] in which weight, buoyancy and a wrench tau (n, 6) in B balance, yaw being free."""
    moments = postures.moments(vehicle)
    x, y, z = (moments / np.maximum(np.linalg.norm(moments, axis=1), 1e-12)[:, None]).T
    found = np.stack([np.arctan2(y, z), -np.arcsin(np.clip(x, -1.0, 1.0))], axis=1)
    for i in np.flatnonzero(tau[:, 3:].any(axis=1)):
        found[i] = least_squares(_unbalanced, found[i], args=(moments[i], tau[i, 3:])).x
    return found


def _unbalanced(angles: np.ndarray, moment: np.ndarray, K: np.ndarray) -> np.ndarray:
    roll, pitch = angles
    up = np.array([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])
    return np.cross(moment, up) + K - (K @ up) * up  # about the vertical nothing balances a moment


class Postures:
    """The arms of a trim, which do not change with the coefficients."""

    def __init__(self, vehicle: Vehicle, q: np.ndarray, gravity: float) -> None:
        """``q`` (n, m): positions of the joints."""
        self._gravity, self._links = gravity, np.zeros((len(q), 3))
        for i, each in enumerate(q):
            statics = Statics(vehicle, each)
            for link, p, R in zip(vehicle.arm.links, statics.p[1:], statics.R[1:], strict=True):
                self._links[i] += link.displaced_mass * (p + R @ link.r_b) - link.mass * (p + R @ link.r_g)

    def moments(self, vehicle: Vehicle) -> np.ndarray:
        """(n, 3) the sum of each upward force times its place, in B [N m]; the vehicle has the same arm."""
        return self._gravity * (vehicle.displaced_mass * vehicle.r_b - vehicle.mass * vehicle.r_g + self._links)


def plant_of(data: Data, mjcf: Mjcf, timestep: float, thrusters: Mapping[str, Any] | None) -> "Plant | Postures | None":
    """The function that predicts an experiment; it is made once. Raises InputError that names the experiment."""
    try:
        if data.experiment.kind == "motion":
            return Plant(data, mjcf, timestep, thrusters)
    except InputError as error:
        raise InputError(error.faults, f"experiment {data.name!r}") from None
    if data.experiment.kind == "towing":
        return None
    n = len(data.channels[0].t)
    return Postures(mjcf.vehicle, data.given.get("q", np.zeros((n, 0))), float(np.linalg.norm(mjcf.gravity_W)))


def euler_of(quat: np.ndarray) -> np.ndarray:
    """(3,) roll, pitch and yaw [rad] of an attitude."""
    R = rotation_matrix(quat)
    return np.array(
        [np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(np.clip(R[2, 0], -1.0, 1.0)), np.arctan2(R[1, 0], R[0, 0])]
    )
