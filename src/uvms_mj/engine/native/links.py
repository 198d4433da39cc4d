"""The records of a vehicle's links, base first: for the water that acts on them, and for the model of a law."""

import numpy as np

from ...control.design import Estimates
from ...physics.tree import FRAME, LINK
from ...plant.arm import Link
from ...plant.vehicle import Vehicle

DAMPING = ("D_linear", "D_quadratic")


def frame_records(vehicle: Vehicle) -> np.ndarray:
    """FRAME records (1 + n,) of a vehicle and its arm."""
    frames = np.zeros(1 + len(vehicle.arm.links), FRAME)
    frames["R_BL"][0] = np.eye(3)
    for record, link in zip(frames[1:], vehicle.arm.links, strict=True):
        record["parent"], record["depth"] = link.parent + 1, frames["depth"][link.parent + 1] + 1
        record["axis"], record["p_0"], record["R_still"] = link.S, link.p_0, link.R_0
        if link.slide:
            record["slope"] = link.R_0 @ link.axis
        else:  # Rodrigues' formula
            along = link.R_0 @ np.outer(link.axis, link.axis)
            record["R_still"], record["R_cos"] = along, link.R_0 - along
            record["R_sin"] = link.R_0 @ np.cross(link.axis, np.eye(3)).T
            record["anchor"], record["p_0"] = link.anchor, link.p_0 + link.R_0 @ link.anchor
    return frames


def link_records(vehicle: Vehicle) -> np.ndarray:
    """LINK records (1 + n,) of a vehicle and its arm; the coefficients are zero."""
    links = np.zeros(1 + len(vehicle.arm.links), LINK)
    links["coriolis"] = 1.0
    return links


def find_diagonals(links: np.ndarray) -> None:
    """Note which matrices of LINK records (n,) are diagonals: their products take a sixth of the time."""
    for record in links:
        diagonal = [not (record[name] - np.diag(np.diag(record[name]))).any() for name in ("M", *DAMPING)]
        record["M_diagonal"], record["D_diagonal"] = diagonal[0], all(diagonal[1:])


def water_links(vehicle: Vehicle) -> np.ndarray:
    """LINK records (1 + n,) for the water: the inertia is the added mass, and only displaced water has weight."""
    links = link_records(vehicle)
    bodies: tuple[Vehicle | Link, ...] = (vehicle, *vehicle.arm.links)
    for record, body in zip(links, bodies, strict=True):
        record["M"] = body.M_A
        for name in (*DAMPING, "displaced_mass", "r_b"):
            record[name] = getattr(body, name)
    find_diagonals(links)
    return links


def estimate_links(links: np.ndarray, vehicle: Vehicle, estimates: Estimates) -> None:
    """Set the coefficients of LINK records (1 + n,) to those of a vehicle's file with the factors of the estimates."""
    bodies: list[tuple[Vehicle | Link, Estimates]] = [(vehicle, estimates)]
    bodies += [(link, estimates.of(link.name)) for link in vehicle.arm.links]
    for record, (body, factors) in zip(links, bodies, strict=True):
        record["M"] = factors.inertia * (body.M_RB + body.M_A)
        record["coriolis"] = factors.coriolis / factors.inertia
        record["D_linear"] = factors.damping * body.D_linear
        record["D_quadratic"] = factors.damping * body.D_quadratic
        record["mass"], record["r_g"] = factors.restoring * body.mass, body.r_g
        record["displaced_mass"], record["r_b"] = factors.restoring * body.displaced_mass, body.r_b
