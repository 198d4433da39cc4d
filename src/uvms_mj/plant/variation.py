"""The true vehicle: the coefficients of a vehicle's file with the factors and offsets of a scenario's ``[vehicle]``.

They change what moves in the water. The laws' estimates, the default M_d and the allocation keep the numbers of the
file, as those of a control system keep the numbers of a data sheet.
"""

import dataclasses
from typing import Any

import mujoco
import numpy as np

from ..errors import Fault, InputError
from ..physics.frames import rotation_matrix
from .arm import Link
from .payload import Body, loaded, payload_faults
from .settings import VehicleChoice
from .vehicle import Vehicle


def varied(nominal: Vehicle, choice: VehicleChoice) -> Vehicle:
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
    links = nominal.arm.links
    names = [nominal.body, *(link.name for link in links)]
    if faults := payload_faults(choice.payloads, names):
        raise InputError(faults)
    B.setflags(write=False)
    true = [_varied(link, link.name, choice, friction=choice.coulomb_friction * link.friction) for link in links]
    return _varied(nominal, nominal.body, choice, B=B, arm=dataclasses.replace(nominal.arm, links=tuple(true)))


def _varied(body: Body, name: str, choice: VehicleChoice, **more: Any) -> Body:
    """The base or a link of this name with the factors of the vehicle, with ``more``, and with its payloads."""
    given: Link = body  # type: ignore[assignment]  # the fields of both that are used have the same names
    arrays = {
        "M_RB": choice.mass * given.M_RB,
        "M_A": choice.added_mass * given.M_A,
        "D_linear": choice.linear_damping * given.D_linear,
        "D_quadratic": choice.quadratic_damping * given.D_quadratic,
    }
    for array in arrays.values():
        array.setflags(write=False)
    displaced_mass = choice.displaced_mass * given.displaced_mass
    true = dataclasses.replace(body, **arrays, displaced_mass=displaced_mass, **more)  # type: ignore[type-var]
    return loaded(true, [each for each in choice.payloads if each.link == name])


def _refuse(nominal: Vehicle, offsets: tuple[tuple[float, ...], ...]) -> None:
    n = len(nominal.thrusters)
    if len(offsets) != n:
        thrusters = ", ".join(nominal.thrusters)
        raise InputError(
            [Fault("vehicle.thruster_offset", f"has {len(offsets)} offsets; {n} are needed, of {thrusters}")]
        )
    faults = [
        Fault(f"vehicle.thruster_offset[{i}]", f"{nominal.thrusters[i]} is a pure moment: an offset has no effect")
        for i, offset in enumerate(offsets)
        if any(offset) and not nominal.B[:3, i].any()
    ]
    if faults:
        raise InputError(faults)


def vary(model: mujoco.MjModel, body_id: int, actuator_ids: tuple[int, ...], choice: VehicleChoice) -> None:
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
