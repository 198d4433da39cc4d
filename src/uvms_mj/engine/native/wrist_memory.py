"""The wrist sensor in the record of a run, with the numbers of a scenario in it."""

import numpy as np

from ...plant.arm import Link
from ...plant.vehicle import Vehicle
from ...setup.base import Setup
from ...stages.joint_signals import WRIST_READING, WRIST_TRUE
from ...stages.signals import Signal
from .links import estimate_links, frame_records, link_records, water_links


def fill_wrist(record: np.ndarray, setup: Setup) -> None:
    """Set the true links of a wrist sensor (1,)."""
    rigid = link_records(setup.vehicle)
    bodies: tuple[Vehicle | Link, ...] = (setup.vehicle, *setup.vehicle.arm.links)
    for link, body in zip(rigid, bodies, strict=True):
        link["M"], link["mass"], link["r_g"] = body.M_RB, body.mass, body.r_g
    record["rigid"], record["wet"], record["model"] = rigid, water_links(setup.vehicle), link_records(setup.nominal)
    if record["frames"].size:
        record["frames"] = frame_records(setup.nominal)
    record["gravity_W"] = setup.gravity_W


def write_wrist(record: np.ndarray, setup: Setup) -> None:
    """Set the numbers of the scenario."""
    wrist, sensor = setup.scenario.wrist, record["sensor"]
    link, site = wrist.carried(setup)
    sensor["link"], sensor["p_LT"], sensor["R_LT"] = link + 1, 0.0, np.eye(3)
    if site is not None:
        sensor["p_LT"], sensor["R_LT"] = site.p, site.R
    estimate_links(record["model"][0], setup.nominal, setup.scenario.estimates)
    record["model"]["coriolis"] = 1.0  # of the inertia's factor
    record["weighs"], record["dynamic"] = wrist.compensation != "none", wrist.compensation == "dynamic"


def recorded_wrist(record: np.ndarray) -> list[tuple[Signal, np.ndarray]]:
    """The recorded signals, each with its memory."""
    return [(WRIST_TRUE, record["given"]["wrench_S"]), (WRIST_READING, record["reading"])]
