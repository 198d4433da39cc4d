"""The law's model and the true tool in the record of a run, with the numbers of a scenario in them."""

import numpy as np

from ...control.design import Estimates
from ...physics.frames import BODY
from ...plant.vehicle import Vehicle
from ...setup.base import Setup
from ...stages.signals import MANIPULABILITY, TOOL, Signal
from .links import estimate_links, find_diagonals, frame_records, link_records


def fill_model(model: np.ndarray, setup: Setup) -> None:
    """Set the tool and the links of a law's model (1,) without their coefficients."""
    arm, frame, tool = setup.nominal.arm, setup.scenario.task.frame, model["tool"]
    if frame != BODY:
        site = arm.sites[frame]
        tool["link"], tool["p_LT"], tool["R_LT"] = site.link + 1, site.p, site.R
    model["gravity_W"], model["links"] = setup.gravity_W, link_records(setup.nominal)
    if model["frames"].size:
        model["frames"] = frame_records(setup.nominal)


def estimate(model: np.ndarray, vehicle: Vehicle, estimates: Estimates) -> None:
    """Set the coefficients of a law's model (1,) to those of a vehicle's file with the factors of the estimates."""
    links = model["links"][0]
    estimate_links(links, vehicle, estimates)
    find_diagonals(links)
    for k, link in enumerate(vehicle.arm.links):
        factors = estimates.of(link.name)
        model["armature"][0, k] = factors.inertia * link.armature
        model["gear"][0, k] = factors.damping * link.damping


def recorded_tool(run: np.ndarray, setup: Setup) -> list[tuple[Signal, np.ndarray]]:
    """The recorded signals of a tool, each with its memory."""
    if not setup.at_tool:
        return []
    true, probe = run["true"], run["carriers"][0][:1]
    motion = [true["p_WB"], true["quat_WB"], true["nu"]]
    if not setup.contacts.carriers[0].is_B:
        motion = [probe["p_WC"], run["quat_WT"], probe["nu"]]
    return [*zip(TOOL, motion, strict=True), (MANIPULABILITY, run["model"]["manipulability"])]
