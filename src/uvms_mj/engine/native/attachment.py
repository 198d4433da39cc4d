"""Attaching the hydrodynamics of a vehicle to a MjModel/MjData pair, and detaching them."""

import ctypes
import threading
import warnings
import weakref
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from ...errors import Fault, InputError, suggestion
from ...physics.effects import TABLES
from ...physics.hydrodynamics import factor
from ...plant.effects import Tables, advancing, each_table, effect_faults, effect_records, effect_rows
from ...plant.sea import Sea
from ...plant.settings import Situation
from ...plant.vehicle import Vehicle, free_body_id, free_joint_addresses, notes_on_damping
from ...plant.water import EFFECT_TABLES, Current, Disturbance
from .bodies import Water
from .callback import evaluation, mjcb_control
from .memory import CAPACITY, registry
from .record import Image, alone_dtype, water_rooms

_lock = threading.RLock()
_attached: dict[int, "Attachment"] = {}
"""Attachments by row of the registry. They keep the contexts in memory while the callback can reach them."""


class WaterLost(RuntimeError):
    """mjcb_control or a setting of the model was changed, so that the hydrodynamics are not computed as attached."""


_LOST = (
    "mjcb_control was replaced while a vehicle was attached: its hydrodynamics are no longer applied. Do not set "
    "mjcb_control between attach and detach"
)
_CHANGED = "a setting of the model was changed while a vehicle was attached"


class Attachment:
    """A vehicle with hydrodynamics, from :func:`attach` until :meth:`detach`. It is also a context manager.

    ``current_W`` can be set at any time and takes effect at the next step.
    """

    __slots__ = (
        "__weakref__",
        "_address",
        "_finalizer",
        "_option",
        "_row",
        "_settings",
        "body_id",
        "code",
        "image",
        "plant",
        "vehicle",
        "water",
    )

    def __init__(
        self,
        vehicle: Vehicle,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        body_id: int,
        water: Water,
        image: Image,
        code: int,
    ) -> None:
        self.vehicle, self.body_id, self.water = vehicle, body_id, water
        self._option, self._settings = model.opt, _settings(model.opt)
        self.image, self.plant, self.code = image, image.record("run")["plant"], code
        self._address = data._address
        self._row = _register(self)
        # another mjData at the same address must not find this context
        self._finalizer = weakref.finalize(data, _unregister, self._row)

    @property
    def wrench(self) -> np.ndarray:
        """Hydrodynamic wrench (6,) on the vehicle at B's origin in B [N, N m] at the last evaluation.

        It does not contain the added inertia, which is in mjData.M.

        Raises:
            WaterLost: mjcb_control was replaced, or the model has a setting now that ``attach`` refuses.
        """
        if self._finalizer.alive and (lost := self.lost()):
            raise WaterLost(lost)
        return self.plant["wrench"][0, :6].copy()

    @property
    def current_W(self) -> np.ndarray:
        """(3,) constant part of the current in W [m/s], as a copy. To change it, assign the whole vector."""
        current = self.water.mean_W
        current.setflags(write=False)
        return current

    @current_W.setter
    def current_W(self, value: Sequence[float]) -> None:
        """Set the current. Raises InputError unless the value is three finite numbers."""
        try:
            mean_W = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            mean_W = np.array(np.nan)
        if mean_W.shape != (3,) or not np.isfinite(mean_W).all():
            raise InputError([Fault("current_W", f"{value!r}: must be 3 finite numbers")], "attach")
        self.water.mean_W = mean_W

    @property
    def detached(self) -> bool:
        """Whether the hydrodynamics were removed."""
        return not self._finalizer.alive

    def release(self) -> None:
        """Remove the hydrodynamics without a word about a callback that was replaced."""
        self._finalizer()

    def detach(self) -> None:
        """Remove the hydrodynamics, from the next forward evaluation on. Calling it again has no effect.

        Warns (RuntimeWarning) if mjcb_control was replaced, or a setting of the model was changed to one that
        ``attach`` refuses.
        """
        if self._finalizer.alive and (lost := self.lost()):
            warnings.warn(lost, RuntimeWarning, stacklevel=2)
        self._finalizer()

    def lost(self) -> str:
        """Why the attached hydrodynamics act no longer; empty if they act."""
        if not _installed():
            return _LOST
        if _settings(self._option) == self._settings:
            return ""
        changed = [str(fault) for fault in _solver_faults(self._option)]
        if self._option.gravity.tobytes() != self._settings[0]:
            changed.append(f"gravity: is {self._option.gravity} now; buoyancy has {self.plant['gravity_W'][0]}")
        return f"{_CHANGED}: {'; '.join(changed)}" if changed else ""

    def __enter__(self) -> "Attachment":
        return self

    def __exit__(self, kind: object, *exception: object) -> None:
        if kind is None:
            self.detach()
        else:  # the exception is more important than a warning
            self._finalizer()


STILL: Tables = {"current": Current(speed=0.0), "disturbance": Disturbance()}
"""The effects of still water."""
SITUATION = Situation()


def attach(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    body: str | None = None,
    *,
    seed: int = 0,
    **effects: Any,
) -> Attachment:
    """Add hydrodynamics to a vehicle in any model: added mass, Coriolis, damping, buoyancy and effects of the water.

    They act in every ``mj_step`` and ``mj_forward`` of this ``data``, in MuJoCo's viewer, in dm_control, in
    ``mujoco.rollout`` or in your own loop, at native speed and from any thread. They do not act on copies of ``data``:
    attach each copy. The wrench is in ``qfrc_passive``, which MuJoCo computes anew in each evaluation.
    ``xfrc_applied`` is free for your own forces. Restoring a saved state does not apply the hydrodynamics twice. After
    ``mj_copyData`` into attached data, call ``mj_forward`` before any ``mj_forwardSkip``: the copied inertia and forces
    may have the hydrodynamics in them. The model's settings are read here, and once: gravity for buoyancy, and what is
    refused below. Detach before you change them.

    In three cases MuJoCo does not call mjcb_control. ``mj_inverse`` and MuJoCo's energy are as for a vehicle without
    hydrodynamics. dm_control resets with actuation disabled: after ``physics.reset()``, call ``mj_forward`` before the
    first step. Your own ``mujoco.set_mjcb_control`` replaces the hydrodynamics: ``wrench`` then raises
    :class:`WaterLost`, and ``detach`` warns. They do so for changed settings of the model, too.

    Args:
        model: a compiled model that contains the vehicle's coefficients (:mod:`uvms_mj.plant.vehicle`).
        data: its data.
        body: the vehicle's body, which has a free joint; by default the only body with one.
        seed: of Gauss-Markov processes. It and the time of ``data`` alone decide them.
        effects: the effects of the water, each by the name of its table in a scenario: ``current=Current(speed=0.3,
            deviation=(0.1, 0.1, 0.0))``, by default still water, ``disturbance=Disturbance(...)``,
            ``tether=Tether(...)``, ``fins=[Fin(...), ...]``, ``drag=[Drag(...), ...]``; one table, or a list of them.
            A current that is known as a vector (3,) in W is ``Current.of(v_c_W)``.

    Returns:
        The attachment. Its ``detach()`` removes the hydrodynamics.

    Raises:
        InputError: a setting of the model would use a stale or doubled inertia or skip the hydrodynamics;
            coefficients are not physical; the body is already attached, or too many are; another mjcb_control is
            installed.
        RuntimeError: the layout of mjData in this version of MuJoCo is unknown.

    Warns:
        UserWarning: the vehicle's damping can feed energy in.
    """
    if faults := [*_solver_faults(model.opt)]:  # first, as MuJoCo ends a forward evaluation with some of them
        raise InputError(faults, "a vehicle can't be attached to the model")
    vehicle = Vehicle.from_model(model, body)
    for note in notes_on_damping(vehicle):
        warnings.warn(note, stacklevel=2)
    tables = tables_checked(effects, seed)
    seas: list[Any] = [table for name, _, table in each_table(tables) if name == "sea"]
    situation = Situation(
        *(seed, float(np.linalg.norm(model.opt.gravity))),
        timestep=model.opt.timestep,
        links=vehicle.arm.names,
        displaced_mass=vehicle.displaced_mass,
        r_b=vehicle.r_b,
        surface=(seas or [Sea()])[0].surface,
        tilted=bool(model.opt.gravity[:2].any()),
        surfaces="buoyancy" in tables,
    )
    faults = effect_faults(tables, situation) or [
        Fault(
            key,
            "moves from step to step of a run, which attach does not see; a fin without mixing_deg and a tether "
            "without elements do not",
        )
        for key in advancing(tables, situation)
    ]
    if faults:
        raise InputError(faults, "attach")
    return immerse(model, data, vehicle, tables=tables, situation=situation)


def immerse(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    vehicle: Vehicle,
    image: Image | None = None,
    code: int = 0,
    tables: Tables | None = None,
    situation: Situation = SITUATION,
) -> Attachment:
    """Attach a vehicle of the model that was read and checked already, in still water.

    ``image`` has the record ``run`` with the plant in it, and ``code`` is the address of its forward evaluation; by
    default, of a vehicle without a closed loop and with the effects of tables in a situation, without them in still
    water.
    """
    body_id, n = free_body_id(model, vehicle.body), len(vehicle.arm.links)
    refuse_unsound(model, body_id)
    effects, rows = effect_records(tables or STILL, situation, vehicle.products), effect_rows(tables or STILL)
    alone = image is None
    if image is None:
        rooms = water_rooms()
        rooms |= {key: max(rooms[key], table.size) for key, table in rows.items()}
        image, code = Image({"run": alone_dtype(n, effects.dtype)}, rooms), evaluation(n, effects.dtype)
    plant = image.record("run")["plant"]
    water = Water(image, plant, vehicle, model.opt.gravity)
    if alone:
        water.affect(effects, rows)
    _fill_border(plant[0], model, data, body_id, vehicle)
    return Attachment(vehicle, model, data, body_id, water, image, code)


def _register(attachment: Attachment) -> int:
    """Enter an attachment in the registry, and install the callback if it is the first."""
    with _lock:
        for other in _attached.values():
            if (other._address, other.body_id) == (attachment._address, attachment.body_id):
                raise InputError(f"body {attachment.vehicle.body!r}: is already attached; detach it first")
        row = next((i for i in range(1, CAPACITY) if i not in _attached), None)
        if row is None:
            raise InputError(f"{CAPACITY - 1} vehicles are attached; one process can't have more")
        if mujoco.get_mjcb_control() is None:
            mujoco.set_mjcb_control(mjcb_control())
        elif not _installed():
            raise InputError("another mjcb_control is installed; mujoco.set_mjcb_control(None) removes it")
        _attached[row] = attachment
        registry[row, 1:] = attachment.image.address, attachment.code
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
    """Whether mjcb_control is the callback of this package."""
    return mujoco.get_mjcb_control() is mjcb_control()


def _fill_border(plant: np.void, model: mujoco.MjModel, data: mujoco.MjData, body_id: int, vehicle: Vehicle) -> None:
    """Set the addresses that the callback works on. They stay valid for the lifetime of mjData."""
    qpos, dof = free_joint_addresses(model, body_id)
    time_at = data.energy.ctypes.data - 8  # mjData.time precedes mjData.energy
    before, data.time = data.time, 0.123456789
    found = ctypes.c_double.from_address(time_at).value
    data.time = before
    if found != 0.123456789:
        raise RuntimeError(f"uvms-mj does not support the layout of mjData in MuJoCo {mujoco.__version__}")
    first, n = int(model.M_rowadr[dof]), len(vehicle.arm.links)
    border = plant["mujoco"]
    border["time_at"] = time_at
    arrays = {"R_at": data.xmat[body_id], "qpos_at": data.qpos[qpos:], "qvel_at": data.qvel[dof:]}
    arrays |= {"qacc_at": data.qacc[dof:], "M_at": data.M[first:], "passive_at": data.qfrc_passive[dof:]}
    arrays |= {"ctrl_at": data.ctrl}
    if _factors_alone(model, data, body_id):
        arrays |= {"qLD_at": data.qLD[first:], "qLDiagInv_at": data.qLDiagInv[dof:]}
    for name, array in arrays.items():
        border[name] = array.ctypes.data
    border["controls"] = data.ctrl.size
    if n:
        depths = plant["frames"]["depth"][1:]
        numbers = [int(model.body_dofadr[link.body_id]) for link in vehicle.arm.links]
        full = model.M_rownnz[dof + 6 : dof + 6 + n] == 6 + depths
        if numbers != list(range(dof + 6, dof + 6 + n)) or not full.all():
            raise RuntimeError(f"uvms-mj does not support the layout of mjData.M in MuJoCo {mujoco.__version__}")
        plant["M_rows"][1:] = model.M_rowadr[dof + 6 : dof + 6 + n] - first


def _factors_alone(model: mujoco.MjModel, data: mujoco.MjData, body_id: int) -> bool:
    """Whether the vehicle's block of mjData.M can be factored separately, at a third of the cost of mj_factorM.

    This requires a vehicle without moving parts. The layout of MuJoCo's factor is verified on the model.
    """
    if model.body_dofnum[model.body_rootid == body_id].sum() != 6 or data.qLD.shape != data.M.shape:
        return False
    scratch, dof = mujoco.MjData(model), model.body_dofadr[body_id]
    mujoco.mj_forward(model, scratch)
    block = slice(model.M_rowadr[dof], model.M_rowadr[dof] + 21)
    rows, columns = np.tril_indices(6)
    M = np.zeros((6, 6))
    M[rows, columns] = M[columns, rows] = scratch.M[block]
    size = np.sqrt(np.diag(M))  # as an added mass has it: positive definite, whatever the units of the rows
    filled = M + np.outer(size, size) * (0.3 * np.eye(6) + np.outer(np.linspace(0.1, 0.2, 6), np.linspace(0.1, 0.2, 6)))
    scratch.M[block] = filled[rows, columns]
    mujoco.mj_factorM(model, scratch)
    L, D_inverse = np.zeros(21), np.zeros(6)
    factor(scratch.M[block], L, D_inverse)
    return bool(np.allclose(L, scratch.qLD[block]) and np.allclose(D_inverse, scratch.qLDiagInv[dof : dof + 6]))


def tables_checked(effects: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """The tables of the effects in arguments of :func:`attach`, in still water without them.

    Raises:
        InputError: an argument is unknown or of another kind.
    """
    tables = {name: given for name, given in effects.items() if given is not None}
    choices, faults = (*EFFECT_TABLES, "seed"), []
    for name, given in tables.items():
        if name not in EFFECT_TABLES:
            faults.append(Fault(name, f"is no effect of the water and no other argument; {suggestion(name, choices)}"))
            continue
        kind, several = EFFECT_TABLES[name], isinstance(given, list | tuple) and name not in TABLES
        wrong = [value for value in (given if several else (given,)) if not isinstance(value, kind)]
        faults += [Fault(name, f"{value!r} is not a uvms_mj.{kind.__name__}") for value in wrong]
    if not isinstance(seed, int) or not 0 <= seed < 2**63:
        faults.append(Fault("seed", f"{seed!r} is not an integer from 0 to 2^63 - 1"))
    if faults:
        raise InputError(faults, "attach")
    return {**STILL, **tables}


_INTEGRATORS = {getattr(mujoco.mjtIntegrator, f"mjINT_{name}") for name in ("EULER", "RK4", "IMPLICIT", "IMPLICITFAST")}
_SOLVERS = {mujoco.mjtSolver.mjSOL_NEWTON, mujoco.mjtSolver.mjSOL_CG}
_DISABLED = (
    *("constraint", "equality", "frictionloss", "limit", "contact", "spring", "damper", "clampctrl", "warmstart"),
    *("filterparent", "refsafe", "sensor", "midphase", "eulerdamp", "autoreset", "nativeccd", "island", "multiccd"),
)
"""Parts of MuJoCo that a model may disable: the hydrodynamics do not depend on them."""
_ENABLED = ("override", "energy", "invdiscrete", "multiccd")
"""Parts that a model may enable."""
_FLAGS: Mapping[str, str] = {
    "disable actuation": "skips mjcb_control, and with it the hydrodynamics; enable actuation",
    "disable gravity": "takes the weight of the vehicle and not its buoyancy, which is displaced_mass times the "
    "gravity of the model; enable it, and write gravity 0 0 0 for a world without weight",
    "enable sleep": "a sleeping vehicle keeps its inertia, so the added mass would be added twice; disable it",
    "enable diagexact": "computes contact softness from the inertia without the added mass; disable it",
    "enable fwdinv": "compares with mj_inverse, which does not know the hydrodynamics; disable it",
}


def _settings(option: mujoco.MjOption) -> tuple[bytes | float, ...]:
    """Gravity, and what :func:`_solver_faults` looks at."""
    numbers = (option.disableflags, option.enableflags, option.solver, option.integrator, option.noslip_iterations)
    return option.gravity.tobytes(), *numbers, option.density, option.viscosity


def refuse_unsound(model: mujoco.MjModel, body_id: int) -> None:
    """Refuse settings that would use a stale or doubled inertia, or skip the hydrodynamics of a body on a free joint.

    Raises:
        InputError: with every setting that is not sound.
    """
    faults = [*_solver_faults(model.opt), *_vehicle_faults(model, body_id)]
    if faults:
        raise InputError(faults, f"body {model.body(body_id).name!r} can't be attached")


def _solver_faults(option: mujoco.MjOption) -> Iterator[Fault]:
    without = "the inertia without the added mass"
    if option.solver not in _SOLVERS:
        known = mujoco.mjtSolver(option.solver).name.rpartition("_")[2]
        yield Fault(f"solver {known}", f"solves constraints with {without}; use Newton or CG")
    if option.noslip_iterations > 0:
        yield Fault("noslip_iterations", f"is {option.noslip_iterations}, but noslip uses {without}; set it to 0")
    if option.integrator not in _INTEGRATORS:
        reason = f"{option.integrator} may use {without}; use Euler, implicitfast, implicit or RK4"
        yield Fault("integrator", reason)
    yield from _flag_faults("disable", option.disableflags, mujoco.mjtDisableBit, _DISABLED)
    yield from _flag_faults("enable", option.enableflags, mujoco.mjtEnableBit, _ENABLED)
    if option.density > 0 or option.viscosity > 0:
        are = f"are {option.density:g} and {option.viscosity:g}"
        yield Fault("density, viscosity", f"{are}; MuJoCo's own fluid forces would act in addition; set both to 0")


def _flag_faults(word: str, flags: int, bits: Any, accepted: Sequence[str]) -> Iterator[Fault]:
    """Errors for the flags that are set and not known to leave the hydrodynamics as they are."""
    for name, bit in bits.__members__.items():
        flag = name.rpartition("_")[2].lower()
        if "_" in name and flags & int(bit) and flag not in accepted:  # the other member is their number
            key, other = f"{word} {flag}", "enable" if word == "disable" else "disable"
            yield Fault(key, _FLAGS.get(key, f"is not known to leave the hydrodynamics as they are; {other} it"))


def _vehicle_faults(model: mujoco.MjModel, body_id: int) -> Iterator[Fault]:
    joint, dof = model.body_jntadr[body_id], model.body_dofadr[body_id]
    damping = [model.dof_damping[dof : dof + 6], model.dof_dampingpoly[dof : dof + 6]]
    if any(each.any() for each in damping):
        reason = "on the free joint and would act in addition to the hydrodynamic damping; set it to 0"
        yield Fault("joint damping", f"is {max(each.max() for each in damping):g} {reason}")
    if model.dof_armature[dof : dof + 6].any():
        yield Fault("joint armature", "on the free joint would add to the vehicle's inertia; set it to 0")
    if model.dof_frictionloss[dof : dof + 6].any():
        greatest = model.dof_frictionloss[dof : dof + 6].max()
        reason = "on the free joint would hold the vehicle in the water like a dry bearing; set it to 0"
        yield Fault("joint frictionloss", f"is {greatest:g}: {reason}")
    if model.jnt_stiffness[joint] or model.jnt_stiffnesspoly[joint].any():
        reason = "on the free joint is a spring from the vehicle to the world; set it to 0, and use a tendon for a line"
        yield Fault("joint stiffness", reason)
    if model.body_gravcomp[model.body_rootid == body_id].any():
        reason = "would act in addition to buoyancy, which is displaced_mass times gravity; leave it out of the vehicle"
        yield Fault("gravcomp", reason)
    if not (model.M_rownnz[dof : dof + 6] == np.arange(1, 7)).all():
        yield Fault("body", 'has no off-diagonal entries in mjData.M for the added mass; write <body simple="false">')
