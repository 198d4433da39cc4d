"""The true vehicle: the coefficients of a vehicle's file with the factors and offsets of a scenario's ``[vehicle]``.

They change what moves in the water. The laws' estimates, the default M_d and the allocation keep the numbers of the
file, as those of a control system keep the numbers of a data sheet.

A payload is a point mass on the base or on a link that the laws do not know. It adds its mass to the rigid body, and
the water that it displaces to the buoyancy. Added mass and drag stay those of the file.
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import TypeVar

import mujoco
import numpy as np

from ..errors import Fault, InputError, suggestion
from ..physics.frames import rotation_matrix
from .body import Body, skew
from .settings import Payload, VehicleChoice
from .vehicle import Vehicle

_Body = TypeVar("_Body", bound=Body)


@functools.lru_cache(maxsize=8)
def perturbed(nominal: Vehicle, choice: VehicleChoice) -> Vehicle:
    """The true vehicle, from the vehicle of a file.

    Raises:
        InputError: ``thruster_offset`` does not have one offset a thruster, or would move a pure moment, or a payload
            is on a link that the vehicle does not have.
    """
    if choice == VehicleChoice(choice.model, contact_bodies=choice.contact_bodies):
        return nominal
    B = nominal.B.copy()
    if choice.thruster_offset is not None:
        _refuse(nominal, choice.thruster_offset)
        B[3:] += np.cross(np.array(choice.thruster_offset), nominal.B[:3].T).T
    names = [nominal.body, *(link.name for link in nominal.arm.links)]
    if faults := payload_faults(choice.payloads, names):
        raise InputError(faults, "scenario")
    B.setflags(write=False)
    links = tuple(
        dataclasses.replace(_perturbed(link, link.name, choice), friction=choice.coulomb_friction * link.friction)
        for link in nominal.arm.links
    )
    base = _perturbed(nominal, nominal.body, choice)
    return dataclasses.replace(base, B=B, arm=dataclasses.replace(nominal.arm, links=links))


def _perturbed(body: _Body, name: str, choice: VehicleChoice) -> _Body:
    """The base or a link with the factors and payloads of the vehicle."""
    true = dataclasses.replace(
        body,
        M_RB=choice.mass * body.M_RB,
        M_A=choice.added_mass * body.M_A,
        D_linear=choice.linear_damping * body.D_linear,
        D_quadratic=choice.quadratic_damping * body.D_quadratic,
        displaced_mass=choice.displaced_mass * body.displaced_mass,
    )
    for array in (true.M_RB, true.M_A, true.D_linear, true.D_quadratic):
        array.setflags(write=False)
    return loaded(true, [each for each in choice.payloads if each.link == name])


def _refuse(nominal: Vehicle, offsets: tuple[tuple[float, ...], ...]) -> None:
    n = len(nominal.thrusters)
    if len(offsets) != n:
        thrusters = ", ".join(nominal.thrusters)
        wrong = f"has {len(offsets)} offsets; {n} are needed, of {thrusters}"
        raise InputError([Fault("vehicle.thruster_offset", wrong)], "scenario")
    faults = [
        Fault(f"vehicle.thruster_offset[{i}]", f"{nominal.thrusters[i]} is a pure moment: an offset has no effect")
        for i, offset in enumerate(offsets)
        if any(offset) and not nominal.B[:3, i].any()
    ]
    if faults:
        raise InputError(faults, "scenario")


def apply_to_model(model: mujoco.MjModel, body_id: int, actuator_ids: tuple[int, ...], choice: VehicleChoice) -> None:
    """Give a compiled model the masses, the gears and the thrusters of the true vehicle.

    A motor acts at its site with a force and a moment in the site's frame. An offset of the thruster is the moment of
    its force about the site, so that a site may have several motors.
    """
    if choice.mass != 1.0:
        bodies = model.body_rootid == body_id
        model.body_mass[bodies] *= choice.mass
        model.body_inertia[bodies] *= choice.mass
        mujoco.mj_setConst(model, mujoco.MjData(model))  # body_invweight0, which the wall's spring needs
    model.dof_frictionloss[:] *= choice.coulomb_friction
    if choice.thruster_offset is not None:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        R_WB = rotation_matrix(data.xquat[body_id])
        for i, offset in zip(actuator_ids, choice.thruster_offset, strict=True):
            if any(offset):
                R_WS = data.site_xmat[model.actuator_trnid[i, 0]].reshape(3, 3)
                model.actuator_gear[i, 3:] += np.cross(R_WS.T @ R_WB @ np.array(offset), model.actuator_gear[i, :3])


def payload_faults(payloads: Sequence[Payload], names: Sequence[str]) -> list[Fault]:
    """Errors for payloads on bodies that the vehicle, with these names of its base and links, does not have."""
    return [
        Fault(f"vehicle.payloads[{i}].link", f"{each.link!r} is not a link or the base; {suggestion(each.link, names)}")
        for i, each in enumerate(payloads)
        if each.link not in names
    ]


def loaded(body: _Body, payloads: Sequence[Payload]) -> _Body:
    """The base or a link with payloads."""
    for payload in payloads:
        m, p, displaced = payload.mass, np.array(payload.position), payload.displaced_mass
        S = skew(p)
        M_RB = body.M_RB + m * np.block([[np.eye(3), -S], [S, -S @ S]])
        total = body.displaced_mass + displaced
        r_b = (body.displaced_mass * body.r_b + displaced * p) / total if total > 0.0 else body.r_b
        for array in (M_RB, r_b):
            array.setflags(write=False)
        body = dataclasses.replace(body, M_RB=M_RB, displaced_mass=total, r_b=r_b)
    return body


def load(spec: mujoco.MjSpec, model: mujoco.MjModel, payloads: Sequence[Payload], factor: float) -> None:
    """Add payloads to the bodies of a spec before it is compiled. ``model`` is the compiled model of the file, and
    ``factor`` is what all masses of the compiled model are multiplied by afterwards."""
    for name in dict.fromkeys(payload.link for payload in payloads):
        found = model.body(name)
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, found.iquat)
        R = turn.reshape(3, 3)
        masses = [float(found.mass[0]), *(each.mass / factor for each in payloads if each.link == name)]
        places = [found.ipos.copy(), *(np.array(each.position) for each in payloads if each.link == name)]
        m = sum(masses)
        centre = sum(mass * place for mass, place in zip(masses, places, strict=True)) / m
        inertia = R @ np.diag(found.inertia) @ R.T
        for mass, place in zip(masses, places, strict=True):
            S = skew(place - centre)
            inertia = inertia - mass * S @ S
        body = spec.body(name)
        principal, axes = np.linalg.eigh(inertia)
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, (axes * np.sign(np.linalg.det(axes))).ravel())
        body.explicitinertial, body.mass, body.ipos = True, m, centre
        body.inertia, body.iquat, body.fullinertia = principal, quat, [np.nan] * 6
