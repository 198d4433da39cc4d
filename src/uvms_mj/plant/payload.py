"""Payloads: point masses that the true vehicle carries and the laws do not know.

A payload is fixed to the base or to a link. It adds its mass to the rigid body, and the water that it displaces to the
buoyancy. Added mass and drag stay those of the file.
"""

import dataclasses
from collections.abc import Sequence
from typing import TypeVar

import mujoco
import numpy as np

from ..errors import Fault, suggestion
from .body import Body, skew
from .settings import Payload

_Body = TypeVar("_Body", bound=Body)


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
