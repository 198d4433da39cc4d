"""The memory of a wrist sensor, with the numbers of a scenario in it."""

from collections.abc import Callable

import numpy as np

from ...plant.arm import Link
from ...plant.vehicle import Vehicle
from ...setup.base import Setup
from ...stages.joint_signals import WRIST_READING, WRIST_TRUE, wrist_given
from ...stages.signals import CLOCK, MEASURED, Signal, record_dtype
from .entry import part
from .joints import Joints
from .layouts import WRIST
from .links import estimate_links, frame_records, link_records, water_links
from .wrist import Derived, Felt


class WristMemory:
    """The wrist sensor of a run.

    Attributes:
        record: the WRIST record (1,).
        given: the record that the sensor is given (1,).
        reading: (6,) its reading.
        state: the arrays that a reset restores.
    """

    def __init__(self, setup: Setup, joints: Joints, context: np.ndarray) -> None:
        self.wrist, n = setup.scenario.wrist, joints.n
        self.record, self.given, self.reading = (
            np.zeros(1, WRIST),
            np.zeros(1, record_dtype(wrist_given(n))),
            np.zeros(6),
        )
        rigid, self._model = link_records(setup.vehicle), link_records(setup.nominal)
        bodies: tuple[Vehicle | Link, ...] = (setup.vehicle, *setup.vehicle.arm.links)
        for record, body in zip(rigid, bodies, strict=True):
            record["M"], record["mass"], record["r_g"] = body.M_RB, body.mass, body.r_g
        self._trees = {"rigid": rigid, "wet": water_links(setup.vehicle), "model": self._model}
        for name, links in self._trees.items():
            tree = self.record[name]
            tree["links"], tree["links_at"], tree["frames_at"] = n + 1, links.ctypes.data, joints.frames_at
        self._frames, self.record["places"] = frame_records(setup.nominal), joints.encoded
        if joints.encoded:
            self.record["model"]["frames_at"] = self._frames.ctypes.data
        self.record["gravity_W"], self.record["n"] = setup.gravity_W, n
        self._reached = {
            "q_dot_at": joints.q_dot,
            "q_ddot_at": joints.q_ddot,
            "q_m_at": joints.q_m,
            "q_dot_m_at": joints.q_dot_m,
            "q_ddot_m_at": np.zeros(n),
            "q_dot_before_at": np.zeros(n),
            "reading_at": self.reading,
            "context_at": context,
        }
        for name, array in self._reached.items():
            self.record[name] = array.ctypes.data
        self.state = (self.record, self.given, self.reading, self._reached["q_dot_before_at"])
        self.write(setup)

    def write(self, setup: Setup) -> None:
        """Set the numbers of the scenario."""
        wrist = setup.scenario.wrist
        link, site = wrist.carried(setup)
        sensor = self.record["sensor"]
        sensor["link"], sensor["p_LT"], sensor["R_LT"] = link + 1, 0.0, np.eye(3)
        if site is not None:
            sensor["p_LT"], sensor["R_LT"] = site.p, site.R
        estimate_links(self._model, setup.nominal, setup.scenario.estimates)
        self._model["coriolis"] = 1.0  # of the inertia's factor
        self.record["weighs"], self.record["dynamic"] = wrist.compensation != "none", wrist.compensation == "dynamic"

    def add(self, add: Callable[..., None], true: np.ndarray, base: np.ndarray) -> None:
        """Add the stages of the sensor; ``base`` is the record with the measurements at B."""
        add("felt", Felt(), true, self.given["wrench_S"][0], self.record)
        add("wrist", self.wrist, self.given, self.reading)
        add("derived", Derived(), part(base, CLOCK + MEASURED[:4]), part(base, MEASURED[4:]), self.record)

    def recorded(self) -> list[tuple[Signal, np.ndarray]]:
        """The recorded signals, each with its memory."""
        return [(WRIST_TRUE, self.given["wrench_S"]), (WRIST_READING, self.reading)]
