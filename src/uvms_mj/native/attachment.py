"""Attaching a vehicle's water to a MjModel/MjData pair, and taking it away again."""

import ctypes
import threading
import warnings
import weakref
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from ..dissipation import damping_notes
from ..faults import Fault, InputError
from ..hydrodynamics import WATER, factor
from ..vehicle import Vehicle, free_body_id
from .callback import entry_points
from .layouts import CONTEXT
from .memory import CAPACITY, registry

_lock = threading.RLock()
_attached: dict[int, "Attachment"] = {}
"""By the row of the registry. Keeps the contexts in memory for as long as the callback can reach them."""
_INTEGRATORS = {getattr(mujoco.mjtIntegrator, f"mjINT_{name}") for name in ("EULER", "RK4", "IMPLICIT", "IMPLICITFAST")}


class WaterLost(RuntimeError):
    """Somebody replaced mjcb_control: MuJoCo no longer calls the water."""


_LOST = (
    "mjcb_control was replaced while a vehicle was attached: since then it moves dry. Leave mjcb_control alone between "
    "attach and detach"
)


class Attachment:
    """A vehicle in the water: from :func:`attach` until :meth:`detach`. Also a context manager.

    ``current_W`` may be set at any time, and acts from the next step on.
    """

    __slots__ = ("__weakref__", "_address", "_finalizer", "_row", "body_id", "context", "vehicle")

    def __init__(self, vehicle: Vehicle, context: np.ndarray, data: mujoco.MjData, body_id: int) -> None:
        self.vehicle = vehicle
        self.context = context
        self._address = data._address
        self.body_id = body_id
        self._row = _register(self)
        # an address that is free again must not find an old context
        self._finalizer = weakref.finalize(data, _unregister, self._row)

    @property
    def wrench(self) -> np.ndarray:
        """The water's wrench (6,) on the vehicle at B's origin in B [N, N m], of the last evaluation, without the
        added inertia.

        Raises:
            WaterLost: somebody replaced mjcb_control.
        """
        if self._finalizer.alive and not _installed():
            raise WaterLost(_LOST)
        return self.context["wrench"][0].copy()

    @property
    def current_W(self) -> np.ndarray:
        """(3,) velocity of the water in W [m/s]. A copy: to change it, set it as a whole."""
        return self.context["water"]["v_c_W"][0].copy()

    @current_W.setter
    def current_W(self, value: Sequence[float]) -> None:
        """Raises InputError unless the value is three finite numbers."""
        self.context["water"]["v_c_W"] = _finite_numbers({"current_W": value}, {"current_W": 3})["current_W"]

    def detach(self) -> None:
        """Take the water away; the next forward evaluation is dry. Doing it twice does no harm.

        Warns (RuntimeWarning) if somebody replaced mjcb_control in the meantime.
        """
        if self._finalizer.alive and not _installed():
            warnings.warn(_LOST, RuntimeWarning, stacklevel=2)
        self._finalizer()

    def __enter__(self) -> "Attachment":
        return self

    def __exit__(self, kind: object, *exception: object) -> None:
        if kind is None:
            self.detach()
        else:  # what was raised matters more than a warning
            self._finalizer()


def attach(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    body: str | None = None,
    *,
    current_W: Sequence[float] = (0.0, 0.0, 0.0),
    bias: Sequence[float] = (0.0,) * 6,
    amplitude: Sequence[float] = (0.0,) * 6,
    frequency_hz: Sequence[float] = (0.0,) * 6,
) -> Attachment:
    """Put a vehicle of any model in the water: added mass, Coriolis, damping, buoyancy, current and disturbance.

    From then on every ``mj_step`` and ``mj_forward`` of this ``data``, in MuJoCo's viewer, in dm_control, in
    ``mujoco.rollout`` or in a loop of your own, has the water in it, at native speed and from any thread. Copies of
    ``data`` do not: attach each. The water's wrench is in ``qfrc_passive``, which MuJoCo computes anew in each
    evaluation. ``xfrc_applied`` is yours, and a state that was saved and restored has the water in it once.

    Three things do not know the water, for MuJoCo does not call mjcb_control there. ``mj_inverse`` and MuJoCo's energy
    are those of a dry vehicle. dm_control resets with actuation disabled: after ``physics.reset()``, call
    ``mj_forward`` before the first step. A ``mujoco.set_mjcb_control`` of your own takes the water away: ``wrench``
    then raises :class:`WaterLost`, and ``detach`` warns.

    Args:
        model: a compiled model. The vehicle's coefficients are in it (:mod:`uvms_mj.vehicle`).
        data: its data.
        body: the vehicle's body, which has a free joint; by default the only one.
        current_W: (3,) velocity of the water in W [m/s], constant and irrotational.
        bias, amplitude, frequency_hz: (6,) disturbance wrench bias + amplitude sin(2 pi f t) in B [N, N m, Hz], eq.
            (10).

    Returns:
        The attachment; its ``detach()`` undoes this.

    Raises:
        InputError: the model has what would use a stale or doubled inertia or lose the water, or coefficients that
            are not physical; the body is in the water already, or too many are; somebody else has mjcb_control.
        RuntimeError: this MuJoCo lays mjData out in a way that is not known.

    Warns:
        UserWarning: the vehicle's damping can feed energy in.
    """
    vehicle = Vehicle.from_model(model, body)
    for note in damping_notes(vehicle.body, vehicle.D_linear, vehicle.D_quadratic):
        warnings.warn(note, stacklevel=2)
    return immerse(model, data, vehicle, current_W=current_W, bias=bias, amplitude=amplitude, frequency_hz=frequency_hz)


def immerse(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    vehicle: Vehicle,
    *,
    current_W: Sequence[float],
    bias: Sequence[float],
    amplitude: Sequence[float],
    frequency_hz: Sequence[float],
) -> Attachment:
    """:func:`attach` for a vehicle of the model that was read and checked already."""
    body_id = free_body_id(model, vehicle.body)
    _refuse_unsound(model, body_id)
    context = np.zeros(1, CONTEXT)
    _fill(context[0], model, data, body_id)
    water = context["water"]
    water["M_A"], water["D_linear"], water["D_quadratic"] = vehicle.M_A, vehicle.D_linear, vehicle.D_quadratic
    water["buoyancy_W"] = -vehicle.displaced_mass * model.opt.gravity
    water["r_b"] = vehicle.r_b
    given = {"current_W": current_W, "bias": bias, "amplitude": amplitude, "frequency_hz": frequency_hz}
    numbers = _finite_numbers(given, {name: WATER[field].shape[0] for name, field in _WATER_FIELDS.items()})
    for name, field in _WATER_FIELDS.items():
        water[field] = numbers[name]
    return Attachment(vehicle, context, data, body_id)


_WATER_FIELDS = {"current_W": "v_c_W", "bias": "bias", "amplitude": "amplitude", "frequency_hz": "frequency"}


def _finite_numbers(given: Mapping[str, Any], sizes: Mapping[str, int]) -> dict[str, np.ndarray]:
    """Vectors of finite numbers by name; an InputError names every one that is not."""
    numbers, faults = {}, []
    for name, value in given.items():
        try:
            numbers[name] = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            numbers[name] = np.array(np.nan)
        if numbers[name].shape != (sizes[name],) or not np.isfinite(numbers[name]).all():
            faults.append(Fault(name, f"{value!r}: must be {sizes[name]} finite numbers"))
    if faults:
        raise InputError(faults, "attach")
    return numbers


def _register(attachment: Attachment) -> int:
    """Give an attachment a row of the registry, and install the callback with the first."""
    with _lock:
        for other in _attached.values():
            if (other._address, other.body_id) == (attachment._address, attachment.body_id):
                raise InputError(f"body {attachment.vehicle.body!r}: is in the water already; detach it first")
        row = next((i for i in range(1, CAPACITY) if i not in _attached), None)
        if row is None:
            raise InputError(f"{CAPACITY - 1} vehicles are in the water: one process can't have more")
        if mujoco.get_mjcb_control() is None:
            mujoco.set_mjcb_control(entry_points().control.ctypes)
        elif not _installed():
            raise InputError("another mjcb_control is installed; mujoco.set_mjcb_control(None) removes it")
        _attached[row] = attachment
        registry[row, 1] = attachment.context.ctypes.data
        registry[row, 0] = attachment._address
        registry[0, 0] = max(registry[0, 0], row)
        return row


def _unregister(row: int) -> None:
    with _lock:
        registry[row, 0] = 0
        del _attached[row]
        if not _attached and _installed():
            mujoco.set_mjcb_control(None)


def _installed() -> bool:
    """Whether MuJoCo's mjcb_control is the water's."""
    return mujoco.get_mjcb_control() is entry_points().control.ctypes


def _fill(context: np.void, model: mujoco.MjModel, data: mujoco.MjData, body_id: int) -> None:
    """The addresses that the callback works on; they stand still for as long as mjData lives."""
    joint = model.body_jntadr[body_id]
    qpos, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
    time_at = data.energy.ctypes.data - 8  # mjData.time is the number before mjData.energy
    before, data.time = data.time, 0.123456789
    found = ctypes.c_double.from_address(time_at).value
    data.time = before
    if found != 0.123456789:
        raise RuntimeError(f"MuJoCo {mujoco.__version__} lays mjData out in a way that uvms-mj does not know")
    context["time_at"] = time_at
    context["R_at"] = data.xmat[body_id].ctypes.data
    context["qpos_at"] = data.qpos[qpos:].ctypes.data
    context["qvel_at"] = data.qvel[dof:].ctypes.data
    context["M_at"] = data.M[model.M_rowadr[dof] :].ctypes.data
    if _factors_alone(model, data, body_id):
        context["qLD_at"] = data.qLD[model.M_rowadr[dof] :].ctypes.data
        context["qLDiagInv_at"] = data.qLDiagInv[dof:].ctypes.data
    context["passive_at"] = data.qfrc_passive[dof:].ctypes.data


def _factors_alone(model: mujoco.MjModel, data: mujoco.MjData, body_id: int) -> bool:
    """Whether the vehicle's block of mjData.M can be factored by itself, at a third of the cost of mj_factorM.

    It can where nothing moves on the vehicle; that MuJoCo lays its factor out in this way is tried on the model itself.
    """
    if model.body_dofnum[model.body_rootid == body_id].sum() != 6 or data.qLD.shape != data.M.shape:
        return False
    scratch, dof = mujoco.MjData(model), model.body_dofadr[body_id]
    mujoco.mj_forward(model, scratch)
    block = slice(model.M_rowadr[dof], model.M_rowadr[dof] + 21)
    scratch.M[block] += np.linspace(0.01, 0.02, 21) * scratch.M[block].max()
    mujoco.mj_factorM(model, scratch)
    L, D_inverse = np.zeros(21), np.zeros(6)
    factor(scratch.M[block], L, D_inverse)
    return bool(np.allclose(L, scratch.qLD[block]) and np.allclose(D_inverse, scratch.qLDiagInv[dof : dof + 6]))


def _refuse_unsound(model: mujoco.MjModel, body_id: int) -> None:
    """Refuse what would use a stale or doubled inertia, or lose the water."""
    enable, disable = mujoco.mjtEnableBit, mujoco.mjtDisableBit
    option, faults = model.opt, []

    def refuse(condition, key: str, reason: str) -> None:
        if condition:
            faults.append(Fault(key, reason))

    refuse(
        option.solver == mujoco.mjtSolver.mjSOL_PGS,
        "solver PGS",
        "projects constraints with the inertia from before the added mass; use Newton or CG",
    )
    refuse(
        option.noslip_iterations > 0,
        "noslip_iterations",
        f"is {option.noslip_iterations}; noslip uses the inertia without the added mass; set it to 0",
    )
    refuse(
        option.integrator not in _INTEGRATORS,
        "integrator",
        f"{option.integrator} is not known to use the inertia with the added mass; "
        "use Euler, implicitfast, implicit or RK4",
    )
    refuse(
        option.enableflags & enable.mjENBL_SLEEP,
        "enable sleep",
        "a sleeping vehicle keeps an inertia that already has the added mass in it; disable it",
    )
    refuse(
        option.enableflags & enable.mjENBL_DIAGEXACT,
        "enable diagexact",
        "computes contact softness from the inertia without the added mass; disable it",
    )
    refuse(
        option.disableflags & disable.mjDSBL_ACTUATION,
        "disable actuation",
        "skips mjcb_control, and with it the water; enable actuation",
    )
    dof = model.body_dofadr[body_id]
    damping = model.dof_damping[dof : dof + 6]
    refuse(
        damping.any(),
        "joint damping",
        f"of the free joint is {damping.max():g}; the water's own damping replaces it: set it to 0",
    )
    refuse(
        model.dof_armature[dof : dof + 6].any(),
        "joint armature",
        "of the free joint adds to the inertia what is not the vehicle's; set it to 0",
    )
    refuse(
        option.density > 0 or option.viscosity > 0,
        "density, viscosity",
        f"are {option.density:g} and {option.viscosity:g}; MuJoCo's own fluid would come on top of this one: "
        "set both to 0",
    )
    full = model.M_rownnz[dof : dof + 6] == np.arange(1, 7)
    refuse(
        not full.all(),
        "body",
        'has no room for off-diagonal entries in mjData.M; write <body simple="false">',
    )
    if faults:
        raise InputError(faults, f"body {model.body(body_id).name!r} can't be put in the water")
