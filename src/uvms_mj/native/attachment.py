"""Attaching a vehicle's water to a MjModel/MjData pair, and taking it away again."""

import ctypes
import threading
import weakref
from collections.abc import Sequence

import mujoco
import numpy as np

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


class Attachment:
    """A vehicle in the water: from :func:`attach` until :meth:`detach`. Also a context manager."""

    def __init__(self, vehicle: Vehicle, context: np.ndarray, data: mujoco.MjData, body_id: int) -> None:
        self.vehicle = vehicle
        self.context = context
        self._address = data._address
        self._data = weakref.ref(data)
        self.body_id = body_id
        self._row = _register(self)
        # an address that is free again must not find an old context
        self._finalizer = weakref.finalize(data, _unregister, self._row)

    @property
    def wrench(self) -> np.ndarray:
        """The water's wrench (6,) on the vehicle at B's origin in B [N, N m], of the last evaluation, without the
        added inertia."""
        return self.context["wrench"][0].copy()

    def detach(self) -> None:
        """Take the water away, with what it left in ``xfrc_applied``. Doing it twice does no harm."""
        if not self._finalizer.alive:
            return
        self._finalizer()
        data = self._data()
        if data is not None:
            data.xfrc_applied[self.body_id] = self.context["xfrc_other"][0]

    def __enter__(self) -> "Attachment":
        return self

    def __exit__(self, *exception: object) -> None:
        self.detach()


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

    From then on every ``mj_step`` and ``mj_forward`` of this ``data``, in MuJoCo's viewer, in dm_control or in a loop
    of your own, has the water in it, at native speed and from any thread. Copies of ``data`` do not. dm_control
    resets with actuation disabled, where MuJoCo calls nobody: after ``physics.reset()``, call ``mj_forward`` before
    the first step.

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
    """
    vehicle = Vehicle.from_model(model, body)
    body_id = free_body_id(model, vehicle.body)
    _refuse_unsound(model, body_id)
    context = np.zeros(1, CONTEXT)
    _fill(context[0], model, data, body_id)
    water = context["water"]
    water["M_A"], water["D_linear"], water["D_quadratic"] = vehicle.M_A, vehicle.D_linear, vehicle.D_quadratic
    water["buoyancy_W"] = -vehicle.displaced_mass * model.opt.gravity
    water["r_b"] = vehicle.r_b
    faults: list[Fault] = []
    for name, field, value in (
        ("current_W", "v_c_W", current_W),
        ("bias", "bias", bias),
        ("amplitude", "amplitude", amplitude),
        ("frequency_hz", "frequency", frequency_hz),
    ):
        shape = WATER[field].shape
        try:
            array = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            array = np.array(np.nan)
        if array.shape != shape or not np.isfinite(array).all():
            faults.append(Fault(name, f"{value!r}: must be {shape[0]} finite numbers"))
        else:
            water[field] = array
    if faults:
        raise InputError(faults, "attach")
    return Attachment(vehicle, context, data, body_id)


def _register(attachment: Attachment) -> int:
    """Give an attachment a row of the registry, and install the callback with the first."""
    with _lock:
        for other in _attached.values():
            if (other._address, other.body_id) == (attachment._address, attachment.body_id):
                raise InputError(f"body {attachment.vehicle.body!r}: is in the water already; detach it first")
        row = next((i for i in range(1, CAPACITY) if i not in _attached), None)
        if row is None:
            raise InputError(f"{CAPACITY - 1} vehicles are in the water: one process can't have more")
        if not _attached:
            if mujoco.get_mjcb_control() is not None:
                raise InputError("another mjcb_control is installed; mujoco.set_mjcb_control(None) removes it")
            mujoco.set_mjcb_control(entry_points().control.ctypes)
        _attached[row] = attachment
        registry[row, 1] = attachment.context.ctypes.data
        registry[row, 0] = attachment._address
        registry[0, 0] = max(registry[0, 0], row)
        return row


def _unregister(row: int) -> None:
    with _lock:
        registry[row, 0] = 0
        del _attached[row]
        if not _attached:
            mujoco.set_mjcb_control(None)


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
    context["xfrc_at"] = data.xfrc_applied[body_id].ctypes.data
    context["r_com"] = model.body_ipos[body_id]


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
    gravcomp = model.body_gravcomp[model.body_rootid == body_id]
    refuse(
        gravcomp.any(),
        "gravcomp",
        "would come on top of buoyancy, which is displaced_mass times gravity; leave it out of the vehicle's bodies",
    )
    full = model.M_rownnz[dof : dof + 6] == np.arange(1, 7)
    refuse(
        not full.all(),
        "body",
        'has no room for off-diagonal entries in mjData.M; write <body simple="false">',
    )
    if faults:
        raise InputError(faults, f"body {model.body(body_id).name!r} can't be put in the water")
