"""The closed loop of one vehicle, prepared in Python and run by the callback."""

import functools
import time
from collections.abc import Mapping

import mujoco
import numpy as np

from ...control.base import Controller
from ...control.design import Design, Estimates
from ...errors import Fault, InputError
from ...guidance import FilteredSteps
from ...physics.model import COEFFICIENTS
from ...plant.vehicle import Vehicle
from ...plant.wall import contact_settings
from ...scenario import Scenario
from ...stages.base import is_shipped
from ...stages.signals import FINAL_WINDOW_S, OWN_UNIT, RECORDED, Signal, thruster_signal
from .arena import MARGIN, NEARBY, Arena
from .attachment import Attachment
from .callback import entry_points
from .compilation import NotCompiled
from .laws import RAISED, compile_law
from .layouts import LOOP, ROW_SIZE, SIGNALS, SIGNALS_AND_TRUTH, STOP_COMMAND, STOP_LAW, STOP_STATE
from .memory import stopped
from .plain_law import PlainLaw

SPEED_BOUND = (100.0,) * 3 + (200.0,) * 3
"""Speeds above this mean that the simulation has diverged [m/s, rad/s]."""
POSITION_BOUND = 1e4
"""A larger distance from the start along any axis means that the simulation has diverged [m]."""
TAU_BOUND = 1e7
"""A larger entry of tau_cmd means that the simulation has diverged [N, N m]."""
SEARCH_S = 0.25
"""Wall time from one search of a law's margins to the next [s]. A search takes a few milliseconds."""
DEFAULT_EPSILON = 1e-3
"""Width of the boundary layer for controllers without a gain of that name: the paper's value."""

_AXES = ["u", "v", "w", "p", "q", "r"]


class ClosedLoop:
    """The data that the callback needs for one run, and the rows that it writes.

    Args:
        model, data: the plant's, with the initial state.
        attachment: the attached vehicle.
        design: desired impedance and estimates.
        sensors: addresses of the contact's sensors in mjData.sensordata, of :class:`uvms_mj.plant.build.Plant`.
        reach: distance of the contact point from B's origin [m].
        scenario: all other settings of the run.
        row_steps: time steps from row to row.
        chunk: largest number of steps from one :meth:`clear_rows` to the next.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        attachment: Attachment,
        design: Design,
        sensors: Mapping[str, int],
        reach: float,
        scenario: Scenario,
        row_steps: int,
        chunk: int,
    ) -> None:
        self._model, self._data, self.design = model, data, design
        self.controller = scenario.controller
        self.timestep = scenario.simulation.timestep
        vehicle, n = attachment.vehicle, len(attachment.vehicle.thrusters)
        self.signals: tuple[Signal, ...] = (*RECORDED, thruster_signal(n), *law_signals(self.controller))
        self._context = attachment.context
        self._loop = np.zeros(1, LOOP)
        self._gains = self.controller.record()
        self._state, self._state_dot = (type(self.controller).state_record() for _ in range(2))
        period = self.controller.period
        period_steps = 1 if period is None else round(period / self.timestep)
        width = ROW_SIZE + n + self._state.nbytes // 8
        self._rows = np.zeros((chunk // row_steps + 2, width))
        reference = scenario.reference
        assert isinstance(reference, FilteredSteps)
        waypoints = reference.steps
        settings = {
            "timestep": self.timestep,
            "period_steps": period_steps,
            "row_steps": row_steps,
            "steps": scenario.steps,
            "window_step": max(0, scenario.steps - round(FINAL_WINDOW_S / self.timestep)),
            "bandwidth": reference.bandwidth,
            "start": reference.start or scenario.initial.position,
            "waypoints": len(waypoints),
            "epsilon": getattr(self.controller, "epsilon", DEFAULT_EPSILON),  # of each axis
            "speed_bound": SPEED_BOUND,
            "position_bound": POSITION_BOUND,
            "tau_bound": TAU_BOUND,
            "reveals": self.controller.uses_truth,
            "controls": model.nu,
            "thrusters": n,
            "states": self._state.nbytes // 8,
            "row_width": width,
            "row_capacity": len(self._rows),
        }
        for name, value in settings.items():
            self._loop[name] = value
        self._loop["row"]["first_contact"] = -1.0
        for name, value in contact_settings(scenario.wall, design.M, design.normal, reach).items():
            self._loop["contact"][name] = value
        self._loop["task"] = scenario.task.record(self)
        self._set_coefficients("estimates", vehicle, scenario.estimates, model.opt.gravity)
        self._set_coefficients("true_coefficients", vehicle, Estimates(), model.opt.gravity)
        signals = self._loop["signals"]
        signals["period"] = period_steps * self.timestep
        signals["M_hat"], signals["M_d"], signals["D_d"] = design.M_hat, design.M_d, design.D_d
        signals["K_d"], signals["quat_d"] = np.diag(design.K_d), design.quat_d
        signals["K_f"], signals["F_d"] = scenario.impedance.K_f, scenario.impedance.F_d
        self._loop["truth"]["M"] = design.M
        joint = model.body_jntadr[attachment.body_id]
        qpos, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
        self._loop["qpos_safe"] = data.qpos[qpos : qpos + 7]
        # _memory keeps every array alive whose address is in the record
        memory = {
            "times_at": np.array([w.time for w in waypoints], dtype=float),
            "positions_at": np.array([w.position for w in waypoints], dtype=float),
            "B_at": np.ascontiguousarray(vehicle.B.T),  # thruster by thruster
            "B_pinv_at": np.ascontiguousarray(np.linalg.pinv(vehicle.B)),
            "u_min_at": vehicle.u_min,
            "u_max_at": vehicle.u_max,
            "thrust_of_ctrl_at": vehicle.thrust_of_ctrl,
            "ctrl_index_at": np.array(vehicle.actuator_ids, dtype=np.int64),
            "u_at": np.zeros(n),
            "gains_at": self._gains,
            "state_at": self._state,
            "state_dot_at": self._state_dot,
            "rows_at": self._rows,
            "qacc_at": data.qacc[dof:],
            "ctrl_at": data.ctrl,
            "contact_at": data.sensordata[sensors["contact"] :],
            "distance_at": data.sensordata[sensors["distance"] :],
            "fromto_at": data.sensordata[sensors["fromto"] :],
        }
        self._memory = memory
        for name, array in memory.items():
            self._loop[name] = array.ctypes.data
        base = self._loop.ctypes.data
        for name in ("signals", "tau_cmd", "row"):
            self._loop[f"{name}_at"] = self._loop[name].ctypes.data
        self._law, self.not_compiled = None, ""
        self._guarded, self._searched = not is_shipped(self.controller), time.monotonic()
        if self._guarded:
            self._loop["gains_at"] = self._arena.address
        try:
            self._law = compile_law(self.controller)
            self._loop["law_at"] = self._law.address
        except NotCompiled as reason:
            self.not_compiled = str(reason)
        self._context["loop_at"] = base

    def _set_coefficients(self, record: str, vehicle: Vehicle, factors: Estimates, gravity: np.ndarray) -> None:
        values = {
            "M_RB": factors.coriolis * vehicle.M_RB,
            "M_A": factors.coriolis * vehicle.M_A,
            "D_linear": factors.damping * vehicle.D_linear,
            "D_quadratic": factors.damping * vehicle.D_quadratic,
            "mass": factors.restoring * vehicle.mass,
            "displaced_mass": factors.restoring * vehicle.displaced_mass,
            "r_g": vehicle.r_g,
            "r_b": vehicle.r_b,
            "gravity_W": gravity,
        }
        assert set(values) == set(COEFFICIENTS.names or ())
        for name, value in values.items():
            self._loop[record][name] = value

    @functools.cached_property
    def _arena(self) -> Arena:
        return Arena(self._gains, self._state, SIGNALS_AND_TRUTH if self.controller.uses_truth else SIGNALS)

    @functools.cached_property
    def _plain_law(self) -> PlainLaw:
        return PlainLaw(self.controller, self._arena)

    @property
    def compiled(self) -> bool:
        """Whether the law runs as machine code."""
        return self._law is not None

    @property
    def width(self) -> int:
        """Numbers in a row."""
        return self._rows.shape[1]

    @property
    def step(self) -> int:
        """Number of steps done."""
        return int(self._loop["step"][0])

    @property
    def time(self) -> float:
        """Time of the step in hand, or of the divergence [s]."""
        return self.step * self.timestep

    @property
    def evaluations(self) -> int:
        """Number of MuJoCo's calls of the callback."""
        return int(self._context["calls"][0])

    def rows(self) -> np.ndarray:
        """The rows (n, width) written since :meth:`clear_rows`, the last step's included. A view."""
        entry_points().finish.ctypes(self._context.ctypes.data)
        return self._rows[: int(self._loop["rows"][0])]

    def clear_rows(self) -> None:
        """Discard the rows, to make room for the next chunk."""
        self._loop["rows"] = 0

    def prepare(self) -> bool:
        """Sense at t_k for a law that runs as plain Python; True if a control instant is due."""
        mujoco.mj_kinematics(self._model, self._data)  # the wall's sensors get the values of the coming step
        mujoco.mj_sensorPos(self._model, self._data)
        return bool(entry_points().sense.ctypes(self._context.ctypes.data))

    def call_law(self) -> None:
        """Run the law as plain Python on the sensed signals.

        Raises:
            LawFault: the law raised or violated its contract.
        """
        self._fill_arena()
        self._plain_law()
        made = self._arena.arrays
        self._loop["tau_cmd"][0] = made["tau_cmd"]
        self._state[:], self._state_dot[:] = made["state"], made["state_dot"]

    def _fill_arena(self) -> None:
        assert LOOP.fields is not None
        start, size = LOOP.fields["signals"][1], self._arena.sizes["signals"]
        self._arena.fill(self._loop.view(np.uint8)[start : start + size], self._state)

    def check_law(self, last: bool = False) -> None:
        """Report a failure of the law. Call this after each chunk, and with ``last`` after the last one.

        Raises:
            LawFault: the law raised or violated its contract.
            KeyboardInterrupt: a signal arrived during a loop of the law.
        """
        stopped_it = self._loop["stop"][0] == STOP_LAW
        now = time.monotonic()
        if self._guarded:
            everything = stopped_it or last or now - self._searched > SEARCH_S
            if everything:
                self._searched = now
            fault = self._arena.overrun(MARGIN if everything else NEARBY)
            if fault:
                raise self._plain_law.fault(fault)
        if stopped_it:
            if stopped[0]:
                stopped[0] = 0
                raise KeyboardInterrupt
            fault = self._arena.fault() if self._loop["stop_index"][0] != RAISED else ""
            self._arena.reset()
            self._fill_arena()
            raise self._plain_law.explain(fault)

    @property
    def divergence(self) -> str:
        """The first variable to leave its bound, as text; empty if there is none."""
        loop = self._loop[0]
        i, value = int(loop["stop_index"]), float(loop["stop_value"])
        if loop["stop"] == STOP_STATE and i < 3:
            return f"position {'xyz'[i]} = {value:.6g} m, more than {POSITION_BOUND:g} m from where it began"
        if loop["stop"] == STOP_STATE:
            unit = "m/s" if i < 6 else "rad/s"
            return f"velocity {_AXES[i - 3]} = {value:.6g} {unit}, beyond {SPEED_BOUND[i - 3]:g} {unit}"
        if loop["stop"] == STOP_COMMAND:
            unit = "N" if i < 3 else "N m"
            what = f"beyond {TAU_BOUND:g} {unit}" if np.isfinite(value) else "not a finite number"
            return f"tau_cmd[{i}] = {value:.6g} {unit}, {what}"
        return ""


def law_signals(controller: Controller) -> tuple[Signal, ...]:
    """A controller's states as recorded signals.

    Raises:
        InputError: a state's name is taken by a recorded signal or an attribute of a trace, or is not an identifier.
    """
    taken = {signal.name for signal in (*RECORDED, thruster_signal(0))}
    taken |= {*dir(np.recarray), "arrays", "duration_s", "file", "message", "notes", "push", "save", "scenario"}
    taken |= {"columns", "load", "of", "header", "outcome", "rows", "to_dataframe"}
    taken |= {"signals", "status", "steps", "wall_time_s", "analytic", "allow_pickle"}
    names = type(controller).states
    wrong = "is the name of a recorded signal or of an attribute; choose another"
    faults = [Fault(f"states[{name!r}]", wrong) for name in names if name in taken]
    faults += [Fault(f"states[{name!r}]", "is not an identifier") for name in names if not name.isidentifier()]
    if faults:
        raise InputError(faults, f"the law {controller.label()}")
    return tuple(
        Signal(name, (size,), type(controller).units.get(name, OWN_UNIT), "B", f"state {name} of {controller.label()}")
        for name, size in type(controller).states.items()
    )
