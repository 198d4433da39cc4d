"""Time per step of both engines, per reset and per new run; cost of the elements of a real vehicle and of logs; gain of
two threads; memory; start-up time; time of an export.

    python scripts/benchmark.py                 print tables
    python scripts/benchmark.py --json FILE     also write the same figures as JSON
    python scripts/benchmark.py --no-start      without the starts of the command and exports
    python scripts/benchmark.py --hour          memory of a long run over one simulated hour, not ten minutes
    python scripts/benchmark.py --elements      only the elements of a real vehicle
    python scripts/benchmark.py --arm           only the vehicle with five joints
    python scripts/benchmark.py --effects       only the effects of the water, shipped ones and a user's

Bare is ``mj_step`` of the same model in the same contact state: free in the water, or at rest on the wall. MuJoCo's
timers stand still while a Simulation steps; without them bare has a row of its own. The closed loops record at 1 kHz.
The speed of a shared machine varies, so each round times all subjects in turn with one chunk size, and the ratios are
medians of the ratios of each round. The cost of a log is the difference between two complete runs of the paper's
scenario, with and without the log. An element of a real vehicle costs the 10 % quantile of its times less the quantile
of the ideal run with the same control rate, GSTA at a wall with the engine free_body. The times of the vehicle with
five joints are 10 % quantiles of rounds, and their ratios are ratios of these. The times of the effects of the water
are the shortest ones of the processor. A user's drag is the drag of ``[[drag]]`` in a file, with the same numbers.
"""

import functools
import inspect
import json
import math
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.util import resolve_name
from pathlib import Path
from typing import Any

import click
import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table

from elements import CONTROL_PERIODS, ELEMENTS, IDEAL
from five_joints import tool_at_wall
from numpy_arm_loop import NumpyArmLoop
from numpy_loop import NumpyLoop
from uvms_mj import McapLog, Scenario, Simulation, Trace, attach, simulate
from uvms_mj.analysis.metrics import AROUND_THE_END_S
from uvms_mj.control import BUILT_IN, Gsta
from uvms_mj.engine.native.callback import timers_stopped
from uvms_mj.engine.simulation import ENGINES
from uvms_mj.setup.base import set_up

CHUNK = 1000
WORK_S = 0.04
"""Time of a worker's part in one round, whatever its engine [s]: short, so that some rounds are undisturbed."""
AT_WALL = {"initial.position": [1.0, 0.0, 0.0], "reference.step_time": 0.0, "reference.bandwidth": 20.0}
NUMPY_CHUNK = 100
OWN_LAW = "gsta from a user's file"
OWN_DRAG = """
from dataclasses import dataclass
import numpy as np
from uvms_mj import Effect, setting

@dataclass(frozen=True)
class OwnDrag(Effect):
    forward: tuple[float, float, float] = setting((0.0, 0.0, 0.0), "N s^2/m^2", "coefficients along the axes")
    backward: tuple[float, float, float] = setting((0.0, 0.0, 0.0), "N s^2/m^2", "against them")
    position: tuple[float, float, float] = setting((0.0, 0.0, 0.0), "m", "place in B")

    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        r = settings.position
        v = given.nu_r[:3] + np.cross(given.nu_r[3:], r)
        f = -np.where(v > 0.0, settings.forward, settings.backward) * np.abs(v) * v
        tau[:3] = f
        tau[3:] = np.cross(r, f)
"""
DRAG: dict[str, Any] = {"forward": [30.0, 20.0, 10.0], "backward": [40.0, 20.0, 10.0], "position": [0.2, 0.1, -0.1]}
UNTIMED = "bare mj_step without MuJoCo's timers"


class Native:
    """A Simulation that records as ``simulate`` does, advanced chunk by chunk."""

    def __init__(self, scenario: Scenario, law: str, warm_up_s: float, engine: str = "mujoco") -> None:
        self.sim = Simulation(scenario.updated({}, controller=law), engine=engine)
        self.memory, self.steps = self.sim.record(row_steps=10), self.sim.chunk_steps
        for _ in range(round(warm_up_s / scenario.simulation.timestep / self.steps)):
            self.chunk()

    def chunk(self) -> float:
        start = time.perf_counter()
        self.sim.run(self.steps, np.inf)
        self.memory.taken().copy()
        self.memory.clear()
        return (time.perf_counter() - start) / self.steps


class BareModel:
    """A model that is stepped by MuJoCo alone, from the same state in each chunk, since it drifts."""

    steps = CHUNK
    model: mujoco.MjModel
    data: mujoco.MjData

    def check(self, in_contact: bool) -> None:
        """Keep the state, and check that a chunk keeps the contact."""
        self.start = self.data.qpos.copy(), self.data.qvel.copy()
        self.chunk()
        assert (self.data.ncon > 0) == in_contact

    def chunk(self) -> float:
        self.data.qpos[:], self.data.qvel[:] = self.start
        start = time.perf_counter()
        mujoco.mj_step(self.model, self.data, CHUNK)
        return (time.perf_counter() - start) / CHUNK

    def untimed(self) -> float:
        """A chunk without MuJoCo's timers."""
        with timers_stopped:
            return self.chunk()


class Bare(BareModel):
    """The same model without hydrodynamics, law and recording, held in the scenario's state by constant forces."""

    def __init__(self, scenario: Scenario, in_contact: bool) -> None:
        setup = set_up(scenario)
        plant = setup.plant
        self.model, self.data = plant.model, plant.initial_data(scenario.initial)
        weight = plant.vehicle.mass * -self.model.opt.gravity[2]
        self.data.xfrc_applied[plant.body_id, 2] = weight
        if in_contact:
            push = 1.5
            self.data.qpos[0] = scenario.wall.position + push / scenario.wall.stiffness
            self.data.xfrc_applied[plant.body_id, 0] = push
        self.check(in_contact)


class BareArm(BareModel):
    """The same model with joints, weightless and at rest, so that it stays where it is; ``wet``: in the water. In
    contact, constant forces balance the wall's force."""

    def __init__(self, scenario: Scenario, contact: bool, wet: bool) -> None:
        setup = set_up(scenario)
        self.model, self.data = setup.plant.model, setup.plant.initial_data(scenario.initial)
        self.model.opt.gravity[2] = 0.0
        if contact:
            self.data.qpos[0] += 1.5 / scenario.wall.stiffness
            mujoco.mj_forward(self.model, self.data)
            self.data.qfrc_applied[:] = -self.data.qfrc_constraint
        self.attachment = attach(self.model, self.data, setup.vehicle.body) if wet else None
        self.check(contact)


def own_law() -> str:
    """GSTA as a user's law: the same source in a separate file, so that it runs on copies, with checks."""
    path, package = Path(tempfile.mkdtemp(), "own.py"), Gsta.__module__.rpartition(".")[0]
    text = inspect.getsource(inspect.getmodule(Gsta) or Gsta)
    text = re.sub(r"\bfrom (\.+\w*)", lambda found: f"from {resolve_name(found[1], package)}", text)
    path.write_text(text.replace('name = "gsta"', ""))
    return f"{path}:Gsta"


def measure(rounds: int) -> list[dict]:
    """Rows of the table: name, state, microseconds per step, ratio to bare, real-time factor."""
    scenario = Scenario.load("push_wall")
    contact = scenario.updated(AT_WALL)
    free = contact.updated({"wall.position": 5.0})
    rows: list[dict] = []
    for state, here in (("free", free), ("contact", contact)):
        bare = Bare(here, state == "contact")
        subjects: dict[str, Callable[[], float]] = {"bare mj_step": bare.chunk, UNTIMED: bare.untimed}
        for law in BUILT_IN:
            # the impedance law reaches the paper's wall only with a target further inside
            target = [1.1, 0.0, 0.0] if law == "impedance" else [1.01, 0.0, 0.0]
            pressing = here.updated({"reference.target": target})
            subjects[law] = Native(pressing, law, warm_up_s=6.0).chunk
            subjects[f"{law}, free_body"] = Native(pressing, law, 6.0, "free_body").chunk
        subjects[OWN_LAW] = Native(here, own_law(), warm_up_s=6.0).chunk
        numpy_loop = NumpyLoop(here, warm_up_steps=5000)
        times: dict[str, list[float]] = {name: [] for name in (*subjects, "gsta in NumPy")}
        for _ in range(rounds):
            for name, chunk in subjects.items():
                times[name].append(chunk())
            times["gsta in NumPy"].append(numpy_loop.chunk(NUMPY_CHUNK))
        for name, samples in times.items():
            ratios = [s / b for s, b in zip(samples, times["bare mj_step"], strict=True)]
            over_gsta = [s / g for s, g in zip(samples, times["gsta"], strict=True)]
            median = statistics.median(samples)
            rows.append(
                {
                    "what": name,
                    "state": state,
                    "us_a_step": median * 1e6,
                    "ratio_to_bare": statistics.median(ratios),
                    "ratio_to_gsta": statistics.median(over_gsta),
                    "us_over_gsta": statistics.median(s - g for s, g in zip(samples, times["gsta"], strict=True)) * 1e6,
                    "real_time_factor": scenario.simulation.timestep / median,
                }
            )
    return rows


RESETS: dict[str, Callable[[float], dict]] = {
    "no override": lambda x: {},
    "simulation.seed": lambda x: {"simulation.seed": round(1e6 * x)},
    "initial.position": lambda x: {"initial.position": [x, 0.0, 0.0]},
    "current.speed": lambda x: {"current.speed": x},
    "disturbance.bias": lambda x: {"disturbance.bias": [x] * 6},
    "wall.stiffness": lambda x: {"wall.stiffness": 1e4 + x},
    "reference.target": lambda x: {"reference.target": [1.0 + x, 0.0, 0.0]},
    "reference.attitude_deg": lambda x: {"reference.attitude_deg": [x, 0.0, 0.0]},
    "controller.k_1": lambda x: {"controller.k_1": 5.0 + x},
    "task.F_1": lambda x: {"task.F_1": 1.0 + x},
    "estimates.damping": lambda x: {"estimates.damping": 1.0 + x},
    "estimates.inertia": lambda x: {"estimates.inertia": 1.0 + x},
    "impedance.K_d": lambda x: {"impedance.K_d": [100.0 + x] * 6},
    "impedance.D_d": lambda x: {"impedance.D_d": [100.0 + x] * 6},
    "impedance.M_d": lambda x: {"impedance.M_d": [20.0 + x] * 6},
    "impedance.F_d": lambda x: {"impedance.F_d": [x] * 6},
    "seed, initial state and current": lambda x: {
        "simulation.seed": round(1e6 * x),
        "initial.position": [x, 0.0, 0.0],
        "current.speed": x,
    },
}
"""Overrides of a reset from a number in [0, 1), so that each reset has new values."""


def elements(rounds: int) -> list[dict]:
    """Time of a step with each element of a real vehicle, and what it adds to the ideal run, for each control rate."""
    rows = []
    for rate, period in CONTROL_PERIODS.items():
        subjects = {}
        for name, keys in ELEMENTS.items():
            scenario = Scenario.load("push_wall", {**IDEAL, **keys, "controller.period": period})
            subjects[name] = Native(scenario, "gsta", 4.0, "free_body")
        times: dict[str, list[float]] = {name: [] for name in subjects}
        for _ in range(rounds):
            for name, subject in subjects.items():
                subject.chunk()  # into the cache
                times[name].append(subject.chunk())
        shortest = {name: 1e6 * float(np.quantile(samples, 0.1)) for name, samples in times.items()}
        for name, subject in subjects.items():
            assert not subject.sim.divergence, name
            over = shortest[name] - shortest["ideal"]
            rows.append({"what": name, "control": rate, "us_a_step": shortest[name], "us_over_ideal": over})
    return rows


def effects(rounds: int) -> list[dict]:
    """Time of a step with each effect of the water, and over that of a shipped drag."""
    own = Path(tempfile.mkdtemp(), "own_drag.py")
    own.write_text(OWN_DRAG)
    water = {
        "none": {},
        "drag": {"drag": [DRAG]},
        "a user's drag": {"effects": [{"name": f"{own}:OwnDrag", **DRAG}]},
        "tether": {"tether.length": 20.0, "tether.position": DRAG["position"]},
        "fin": {"fins": [{"area": 0.02, "position": [-0.3, 0.0, 0.0]}]},
    }
    rows = []
    for engine in ENGINES:
        scenario = Scenario.load("push_wall", {"simulation.duration": 1e4})
        sims = {name: Simulation(scenario.updated(keys), engine=engine) for name, keys in water.items()}
        for sim in sims.values():
            sim.step(10 * CHUNK)
        np.testing.assert_array_equal(sims["drag"].signals.p_WB, sims["a user's drag"].signals.p_WB)
        least = dict.fromkeys(sims, math.inf)
        for _ in range(rounds):
            for name, sim in sims.items():
                start = time.process_time()
                sim.step(10 * CHUNK)
                least[name] = min(least[name], time.process_time() - start)
        for name, seconds in least.items():
            over = {"us_a_step": 1e5 * seconds / CHUNK, "ratio_to_drag": seconds / least["drag"]}
            rows.append({"what": name, "engine": engine, **over})
    return rows


def arm(rounds: int) -> list[dict]:
    """Time of a step of a vehicle with five joints: bare, in the water, with GSTA at its tool, and that in NumPy."""
    rows = []
    for contact in (False, True):
        scenario, state = tool_at_wall(contact), "contact" if contact else "free"
        numpy_loop = NumpyArmLoop(scenario, warm_up_steps=100)
        bare = BareArm(scenario, contact, wet=False)
        subjects: dict[str, Callable[[], float]] = {
            "bare mj_step": bare.chunk,
            UNTIMED: bare.untimed,
            "in the water": BareArm(scenario, contact, wet=True).chunk,
            "gsta at the tool": Native(scenario, "gsta", 6.0).chunk,
            "gsta in NumPy": functools.partial(numpy_loop.chunk, NUMPY_CHUNK // 10),
        }
        times: dict[str, list[float]] = {name: [] for name in subjects}
        for _ in range(10 * rounds):
            for name, chunk in subjects.items():
                times[name].append(chunk())
        shortest = {name: 1e6 * float(np.quantile(samples, 0.1)) for name, samples in times.items()}
        for name, us in shortest.items():
            over = {"ratio_to_bare": us / shortest["bare mj_step"], "ratio_to_gsta": us / shortest["gsta at the tool"]}
            rows.append({"what": name, "state": state, "us_a_step": us, **over})
    return rows


def resets(rounds: int) -> list[dict]:
    """Time of a reset by kind of key, with a new value each time, and of a call of step [us]."""
    rows = []
    with Simulation(Scenario.load("push_wall")) as sim:
        times: dict[str, list[float]] = {name: [] for name in RESETS}
        for name, overrides_of in RESETS.items():
            for k in range(10 * rounds):
                overrides = overrides_of(k / (10 * rounds))
                times[name].append(_seconds(lambda given=overrides: sim.reset(overrides=given)))
        rows = [{"what": name, "us": statistics.median(samples) * 1e6} for name, samples in times.items()]
        sim.reset()
        one, many = [], []
        for _ in range(10 * rounds):
            start = time.perf_counter()
            sim.step(1)
            middle = time.perf_counter()
            sim.step(101)
            one.append(middle - start)
            many.append(time.perf_counter() - middle)
    beside = statistics.median(one) - (statistics.median(many) - statistics.median(one)) / 100.0
    rows.append({"what": "(a call of step, beside its time steps)", "us": beside * 1e6})
    return rows


def engines(rounds: int) -> list[dict]:
    """Of bare ``mj_step`` and of GSTA in contact with each engine: steps per second of one and of two threads, in turn,
    the gain of two over one, that gain over bare's, and the time of a new run: from a scenario to its first step."""
    contact = Scenario.load("push_wall").updated(AT_WALL)
    pairs: dict[str, list[Bare | Native]] = {"bare mj_step": [Bare(contact, True) for _ in range(2)]}
    for engine in ENGINES:
        pairs[engine] = [Native(contact, "gsta", 1.0, engine) for _ in range(2)]
    alone: dict[str, list[float]] = {name: [] for name in pairs}
    beside: dict[str, list[float]] = {name: [] for name in pairs}
    new: dict[str, list[float]] = {engine: [] for engine in ENGINES}

    chunks = {
        name: max(1, round(WORK_S / min(pair[0].chunk() * pair[0].steps for _ in range(20))))
        for name, pair in pairs.items()
    }

    def work(name: str, subject: Bare | Native) -> None:
        for _ in range(chunks[name]):
            subject.chunk()

    with ThreadPoolExecutor(2) as pool:
        for i in range(rounds):
            for name, pair in pairs.items():
                start = time.perf_counter()
                work(name, pair[0])
                work(name, pair[1])
                middle = time.perf_counter()
                list(pool.map(functools.partial(work, name), pair))
                alone[name].append((middle - start) / 2.0)
                beside[name].append(time.perf_counter() - middle)
            for engine, times in new.items():
                scenario = contact.updated({"current.speed": 0.5 + 1e-3 * i})
                start = time.perf_counter()
                with Simulation(scenario, engine=engine) as sim:
                    sim.step()
                times.append(time.perf_counter() - start)
    # the shortest times: another process on one core halves the gain of a round
    gains = {name: 2.0 * min(alone[name]) / min(beside[name]) for name in pairs}
    steps = {name: chunks[name] * pair[0].steps for name, pair in pairs.items()}
    return [
        {
            "what": name,
            "steps_a_second": steps[name] / min(alone[name]),
            "of_two_threads": 2.0 * steps[name] / min(beside[name]),
            "gain": gains[name],
            "gain_over_bare": gains[name] / gains["bare mj_step"],
            "new_run_ms": 1e3 * statistics.median(new[name]) if name in new else None,
        }
        for name in pairs
    ]


def environments(rounds: int) -> list[dict]:
    """Times of a reset and of a step of the environments at 50 Hz [us], and of the time steps alone in turn."""
    import gymnasium

    from uvms_mj import envs

    rows, action = [], np.full(6, 0.1)
    for timestep in (1e-4, 1e-3):
        overrides = {"simulation.timestep": timestep, "simulation.duration": 1e4}
        gym = gymnasium.make("uvms_mj/PushWall-v0", overrides=overrides, engine="mujoco")
        dm = envs.load("push_wall", overrides=overrides)
        subjects: dict[str, tuple[Callable, Callable]] = {
            "Gymnasium": (gym.reset, gym.step),
            "dm_control": (dm.reset, dm.step),
        }
        alone = Simulation(Scenario.load("push_wall", overrides, "external"))
        for name, (reset, step) in subjects.items():
            resets_s, steps_s, alone_s = [], [], []
            for _ in range(max(2, rounds // 4)):
                alone.reset()
                resets_s.append(_seconds(reset))
                for _ in range(50):
                    steps_s.append(_seconds(step, action))
                    alone_s.append(_seconds(alone.run, round(0.02 / timestep), np.inf))
            median, within = statistics.median(steps_s), statistics.median(alone_s)
            rows.append(
                {
                    "what": name,
                    "timestep": timestep,
                    "reset_us": statistics.median(resets_s) * 1e6,
                    "step_us": median * 1e6,
                    "beside_us": statistics.median(a - b for a, b in zip(steps_s, alone_s, strict=True)) * 1e6,
                    "in_mj_step": within / median,
                }
            )
    return rows


def many_environments(rounds: int) -> list[dict]:
    """Control steps a second of Gymnasium's environments at 50 Hz, all together: single ones, and n that are stepped
    together."""
    import gymnasium

    import uvms_mj.envs  # noqa: F401  # registers the environment

    rows = []
    for timestep in (1e-4, 1e-3):
        overrides = {"simulation.timestep": timestep, "simulation.duration": 1e4}
        kinds = [("one, mujoco", 0, "mujoco"), ("one, free_body", 0, "auto")]
        kinds += [(f"{n} together", n, "auto") for n in (4, 16, 64)]
        for what, n, engine in kinds:
            if n == 0:
                env: Any = gymnasium.make("uvms_mj/PushWall-v0", overrides=overrides, engine=engine)
            else:
                env = gymnasium.make_vec("uvms_mj/PushWall-v0", n, overrides=overrides, engine=engine)
            env.reset(seed=0)
            action = np.full(env.action_space.shape or (), 0.1)
            found = [_seconds(env.step, action) for _ in range(20 * max(2, rounds // 4))]
            env.close()
            rows.append({"what": what, "timestep": timestep, "a_second": max(1, n) / statistics.median(found)})
    return rows


def _seconds(call: Callable, *arguments: object) -> float:
    start = time.perf_counter()
    call(*arguments)
    return time.perf_counter() - start


def logs(rounds: int) -> list[dict]:
    """Cost of a log of the paper's run: additional time, time to load the log [s], and its size.

    The additional time is relative to a run that records at 1 kHz and writes no log.
    """
    scenario = Scenario.load("push_wall")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"

        def seconds(rate: str | None, sinks: list[McapLog]) -> float:
            log.unlink(missing_ok=True)
            start = time.perf_counter()
            simulate(scenario, log_rate=rate, sinks=sinks, keep_s=AROUND_THE_END_S)
            return time.perf_counter() - start

        times: dict[str, list[float]] = {"no log": [], "1 kHz": [], "full": []}
        loads: dict[str, list[float]] = {"1 kHz": [], "full": []}
        sizes = {}
        seconds(None, [])
        for _ in range(rounds):
            times["no log"].append(seconds(None, []))
            for name, rate in (("1 kHz", None), ("full", "full")):
                times[name].append(seconds(rate, [McapLog(log)]))
                sizes[name] = log.stat().st_size
                start = time.perf_counter()
                n = len(Trace.load(log))
                loads[name].append(time.perf_counter() - start)
        for name, loading in loads.items():
            added = [a - b for a, b in zip(times[name], times["no log"], strict=True)]
            rows.append(
                {
                    "what": name,
                    "run_s": statistics.median(times[name]),
                    "added_s": statistics.median(added),
                    "load_s": statistics.median(loading),
                    "MB": sizes[name] / 1e6,
                }
            )
    assert n == scenario.steps + 1
    return rows


def long_run(seconds: float) -> dict:
    """Peak memory of ``uvms-mj run`` at 100 Hz, for the paper's 20 s and for a longer run."""

    def peak_MB(duration: float) -> float:
        with tempfile.TemporaryDirectory() as folder:
            settings = [f"simulation.duration={duration:g}", "--log-rate", "100", "--quiet", "--out", folder]
            code = (
                "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True);"
                "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
            )
            command = [sys.executable, "-c", code, sys.executable, "-m", "uvms_mj", "run", *settings]
            done = subprocess.run(command, check=True, capture_output=True, text=True)
        return int(done.stdout) / (1e6 if sys.platform == "darwin" else 1e3)

    return {"simulated_s": seconds, "peak_MB": peak_MB(seconds), "peak_MB_of_20_s": peak_MB(20.0)}


def starts(rounds: int) -> list[dict]:
    """Process times of ``uvms-mj --help``, and of ``uvms-mj run --controller gsta`` with cold and warm cache [s]."""
    command = [sys.executable, "-m", "uvms_mj"]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"UVMS_MJ_CACHE_DIR": str(Path(folder) / "cache")}

        def seconds(*arguments: str) -> float:
            start = time.perf_counter()
            subprocess.run([*command, *arguments], env=environment, check=True, capture_output=True)
            return time.perf_counter() - start

        run = ("run", "--controller", "gsta", "--quiet", "--out")
        rows.append({"what": "run, cold cache", "seconds": seconds(*run, str(Path(folder) / "cold"))})
        for name, arguments in (("run, warm cache", run), ("--help", ("--help",))):
            samples = [
                seconds(*arguments, *([str(Path(folder) / f"{name}-{i}")] if name != "--help" else []))
                for i in range(rounds)
            ]
            rows.append({"what": name, "seconds": statistics.median(samples)})
    return rows


def exports() -> list[dict]:
    """Wall and processor times [s] of ``uvms-mj export law gsta`` for all four processors: the first one with empty
    caches, and again."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        caches = {"UVMS_MJ_CACHE_DIR": str(Path(folder) / "cache"), "ZIG_GLOBAL_CACHE_DIR": str(Path(folder) / "zig")}
        for what in ("first export of a law", "export again"):
            targets, out = "x86_64,aarch64,armv7,thumbv7em", str(Path(folder) / what)
            command = [sys.executable, "-m", "uvms_mj", "export", "law", "gsta", "--target", targets, "--out", out]
            start, before = time.perf_counter(), os.times()
            subprocess.run(command, env=os.environ | caches, check=True, capture_output=True)
            seconds, after = time.perf_counter() - start, os.times()
            used = sum(after[2:4]) - sum(before[2:4])
            rows.append({"what": what, "seconds": seconds, "processor_seconds": used})
    return rows


@click.command(help=__doc__)
@click.option("--rounds", default=40, show_default=True, help="Timed chunks of each subject.")
@click.option("--json", "json_file", type=click.Path(path_type=Path), help="Write the figures to a file.")
@click.option("--start/--no-start", default=True, help="Also time the cold and warm start of the command.")
@click.option("--hour", is_flag=True, help="Measure the memory of a long run over one simulated hour.")
@click.option("--elements", "only_elements", is_flag=True, help="Time only the elements of a real vehicle.")
@click.option("--arm", "only_arm", is_flag=True, help="Time only the vehicle with five joints.")
@click.option("--effects", "only_effects", is_flag=True, help="Time only the effects of the water.")
def main(
    rounds: int,
    json_file: Path | None,
    start: bool,
    hour: bool,
    only_elements: bool,
    only_arm: bool,
    only_effects: bool,
) -> None:
    water = [] if only_elements or only_arm else effects(rounds)
    if water:
        table = Table("effect of the water", "engine", "us per step", "x drag")
        for row in water:
            table.add_row(row["what"], row["engine"], f"{row['us_a_step']:.3f}", f"{row['ratio_to_drag']:.3f}")
        Console().print(table)
    if only_effects:
        if json_file:
            json_file.write_text(json.dumps({"effects": water}, indent=2) + "\n")
        return
    joints = [] if only_elements else arm(rounds)
    if joints:
        table = Table("five joints", "state", "us per step", "x bare", "x gsta")
        for row in joints:
            ratios = (f"{row[key]:.3g}" for key in ("ratio_to_bare", "ratio_to_gsta"))
            table.add_row(row["what"], row["state"], f"{row['us_a_step']:.2f}", *ratios)
        Console().print(table)
    if only_arm:
        if json_file:
            json_file.write_text(json.dumps({"arm": joints}, indent=2) + "\n")
        return
    real = elements(rounds)
    table = Table("element, gsta with free_body", "control", "us per step", "us over ideal")
    for row in real:
        table.add_row(row["what"], row["control"], f"{row['us_a_step']:.3f}", f"{row['us_over_ideal']:+.3f}")
    Console().print(table)
    if only_elements:
        if json_file:
            json_file.write_text(json.dumps({"elements": real}, indent=2) + "\n")
        return
    steps = measure(rounds)
    table = Table("subject", "state", "us per step", "x bare", "x gsta", "us over gsta", "real-time factor")
    for row in steps:
        table.add_row(
            row["what"],
            row["state"],
            f"{row['us_a_step']:.2f}",
            f"{row['ratio_to_bare']:.2f}",
            f"{row['ratio_to_gsta']:.2f}",
            f"{row['us_over_gsta']:+.2f}",
            f"{row['real_time_factor']:.1f}",
        )
    Console().print(table)
    resetting = resets(rounds)
    table = Table("reset with", "us")
    for row in resetting:
        table.add_row(row["what"], f"{row['us']:.1f}")
    Console().print(table)
    environment = environments(rounds)
    table = Table("environment", "time step s", "reset us", "step us", "beside mj_step us", "in mj_step")
    for row in environment:
        times = (f"{row[key]:.0f}" for key in ("reset_us", "step_us", "beside_us"))
        table.add_row(row["what"], f"{row['timestep']:g}", *times, f"{row['in_mj_step']:.0%}")
    Console().print(table)
    together = many_environments(rounds)
    table = Table("environments", "time step s", "control steps/s")
    for row in together:
        table.add_row(row["what"], f"{row['timestep']:g}", f"{row['a_second']:.3g}")
    Console().print(table)
    workers = engines(rounds)
    table = Table("engine, gsta in contact", "steps/s", "of two threads", "gain", "gain / bare's", "new run ms")
    for row in workers:
        numbers = [f"{row['steps_a_second']:.3g}", f"{row['of_two_threads']:.3g}"]
        numbers += [f"{row['gain']:.2f}", f"{row['gain_over_bare']:.3f}"]
        table.add_row(row["what"], *numbers, "" if row["new_run_ms"] is None else f"{row['new_run_ms']:.2f}")
    Console().print(table)
    logging = logs(max(1, rounds // 5))
    table = Table("log", "run s", "added s", "load s", "MB")
    for row in logging:
        table.add_row(row["what"], *(f"{row[key]:.2f}" for key in ("run_s", "added_s", "load_s")), f"{row['MB']:.1f}")
    Console().print(table)
    memory = long_run(3600.0 if hour else 600.0)
    Console().print(
        f"{memory['simulated_s']:g} s at 100 Hz: peak {memory['peak_MB']:.0f} MB; "
        f"20 s: {memory['peak_MB_of_20_s']:.0f} MB"
    )
    processes = starts(5) if start else []
    if processes:
        table = Table("command", "seconds")
        for row in processes:
            table.add_row(row["what"], f"{row['seconds']:.2f}")
        Console().print(table)
    exporting = exports() if start else []
    if exporting:
        table = Table("command", "seconds", "of processors")
        for row in exporting:
            table.add_row(row["what"], f"{row['seconds']:.2f}", f"{row['processor_seconds']:.2f}")
        Console().print(table)
    if json_file:
        figures = {
            "effects": water,
            "arm": joints,
            "elements": real,
            "steps": steps,
            "resets": resetting,
            "environments": environment,
            "many_environments": together,
            "engines": workers,
            "logs": logging,
            "long_run": memory,
            "starts": processes,
            "exports": exporting,
        }
        json_file.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
