"""The memory of a law's model and of the true tool, with the numbers of a scenario in it."""

import numpy as np

from ...control.design import Estimates
from ...physics.frames import BODY
from ...plant.vehicle import Vehicle
from ...setup.base import Setup
from ...stages.signals import CLOCK, MANIPULABILITY, MEASURED, TOOL, Signal, record_dtype
from .joints import Joints
from .layouts import model_dtype
from .links import estimate_links, find_diagonals, frame_records, link_records
from .posture import PostureBelowTool, PostureBesideBase
from .task_frame import ModelAtBody, ModelAtTool, ResolveAtBody, ResolveAtTool


class ModelMemory:
    """A MODEL record (1,) of a vehicle, and the arrays whose addresses it has.

    Attributes:
        record: the MODEL record.
        links: its LINK records (1 + n,).
    """

    def __init__(self, setup: Setup, vehicle: Vehicle, joints: Joints) -> None:
        arm, frame = vehicle.arm, setup.scenario.task.frame
        n, N = len(arm.links), 6 + len(arm.links)
        self.record, self.links = np.zeros(1, model_dtype(n)), link_records(vehicle)
        tool = self.record["tool"]
        if frame != BODY:
            site = arm.sites[frame]
            tool["link"], tool["p_LT"], tool["R_LT"] = site.link + 1, site.p, site.R
        self.record["n"], self.record["gravity_W"] = n, setup.gravity_W
        self._frames, self.record["places"] = frame_records(vehicle), joints.encoded
        tree, own = self.record["tree"], joints.encoded or n == 0
        tree["links"], tree["links_at"] = n + 1, self.links.ctypes.data
        tree["frames_at"] = self._frames.ctypes.data if own else joints.frames_at
        sizes = {"M": N * N, "L": N * N, "J_T": 6 * N, "MJ_T": 6 * N, "J_bar": 6 * N, "C": N, "D": N, "g": N}
        sizes |= {"tau_posture": N, "armature": n, "gear": n}
        self.arrays = {name: np.zeros(size) for name, size in sizes.items()}
        self.arrays |= {"q": joints.q_m, "q_dot": joints.q_dot_m, "tau_q_cmd": joints.tau_q_cmd}
        for name, array in self.arrays.items():
            self.record[f"{name}_at"] = array.ctypes.data

    def estimate(self, vehicle: Vehicle, estimates: Estimates) -> None:
        """Set the coefficients to those of a vehicle's file with the factors of the estimates."""
        estimate_links(self.links, vehicle, estimates)
        find_diagonals(self.links)
        for k, link in enumerate(vehicle.arm.links):
            factors = estimates.of(link.name)
            self.arrays["armature"][k] = factors.inertia * link.armature
            self.arrays["gear"][k] = factors.damping * link.damping


class TaskFrame:
    """What a run has beside the stages of a rigid vehicle at B, if there are joints or a tool.

    Attributes:
        at_tool: whether the task's frame is a site.
        base: the clock and the measurements (1,) at B; the law's own record unless the law is at a tool.
        model: memory of the law's model, or None for a rigid vehicle at B.
        probe: the CARRIER record (1,) of the true tool; empty without one, or if it is B.
        quat: (1, 4) attitude of the true tool.
        estimation, resolution, posture: the stages of the model, of the command and of what the task leaves free.
    """

    def __init__(self, setup: Setup, signals: np.ndarray, joints: Joints, carriers: np.ndarray) -> None:
        self.at_tool = at_tool = setup.scenario.task.frame != BODY
        self.base = np.zeros(1, record_dtype(CLOCK + MEASURED)) if at_tool else signals
        self.probe, self.quat = carriers[: int(at_tool)], np.zeros((1, 4))
        self.model = ModelMemory(setup, setup.nominal, joints) if at_tool or joints.n else None
        self.estimation = ModelAtTool() if at_tool else ModelAtBody()
        self.resolution = ResolveAtTool() if at_tool else ResolveAtBody()
        self.posture = PostureBelowTool() if at_tool else PostureBesideBase()

    def recorded(self, true: np.ndarray) -> list[tuple[Signal, np.ndarray]]:
        """The recorded signals of a tool, each with its memory; ``true`` is the record (1,) given to navigation."""
        if self.model is None or not self.at_tool:
            return []
        motion = [true["p_WB"], true["quat_WB"], true["nu"]]
        if len(self.probe):
            motion = [self.probe["p_WC"], self.quat, self.probe["nu"]]
        return [*zip(TOOL, motion, strict=True), (MANIPULABILITY, self.model.record["manipulability"])]
