"""Closed forms of the rest against runs: random scenarios with walls of all shapes, contact bodies and laws.

python scripts/sweep_rests.py                         800 rigid vehicles
python scripts/sweep_rests.py --tools --cases 200     tools of arms
python scripts/sweep_rests.py --seed 3 --case 17      one case with its command

A run counts as settled if the mean force of each of its last ten seconds is the same, also extrapolated. The share
with a closed form counts the settled runs only: a vehicle that chatters, tumbles or follows a circle has no rest. A
closed form is wrong if a settled run rests at another force, or if a run does not settle in 81 times its duration.
Exit status 1 if one is wrong.
"""

import collections
import json
import multiprocessing
import re
import sys
import tempfile
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from uvms_mj import InputError, Scenario, simulate
from uvms_mj.control.base import SteadyState
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.records.header import Status

_POSE = ("vehicle", "task", "initial")
_NUMBER = re.compile(r"\d[\d.e+-]*|: .*(?=needs).*")
"""What differs between two reasons of one kind: numbers, and the list of weak thrusters."""
WRONG = 1e-3
"""Relative error of a closed form that is wrong; of forces below 1 N the error in N."""
STEADY, BLOCK_S, BLOCKS = 1e-4, 1.0, 10
LONGER = (3.0, 9.0, 27.0, 81.0)
"""How much longer a run is tried that has a closed form and does not settle."""
LAWS = ("gsta", "sta", "fosm", "aismc", "ideal", "impedance", "admittance", "admittance", "parallel", "pid", "pid")
LAWS += ("dob_impedance",)
VEHICLES = ("bluerov1", "bluerov1", "bluerov2_heavy", "bluerov2_heavy_tuhh")


@dataclass(frozen=True)
class Result:
    """One case: its number, kind ("announced", "wrong", "no closed form", "not settled" or a status), the two forces
    [N], the reason why there is no closed form, and the CPU times of run and closed form [s]. A run that does not
    settle has no measured force."""

    case: int
    kind: str
    law: str
    measured: float | None
    announced: float | None
    reason: str
    run_s: float
    rest_s: float


def rigid_case(rng: np.random.Generator) -> dict[str, Any]:
    """Overrides of push_wall for a rigid vehicle among random walls."""
    law = str(rng.choice(LAWS))
    over: dict[str, Any] = {"controller.name": law, "simulation.timestep": 1e-3, "simulation.duration": 60.0}
    heavier = float(rng.choice((1.0, 10.0, 60.0, 175.0), p=(0.7, 0.1, 0.1, 0.1)))
    over["vehicle.model"] = str(rng.choice(VEHICLES)) if heavier == 1.0 else heavy(heavier)
    over["wall.present"] = bool(rng.random() < 0.25)
    if over["wall.present"]:
        over["wall.position"], over["wall.stiffness"] = rounded(rng.uniform(0.8, 1.6)), stiffness(rng)
    bodies = contact_bodies(rng)
    if bodies:
        over["vehicle.contact_bodies"] = bodies
    elif rng.random() < 0.2:
        over["bumper.stiffness"], over["bumper.damping"] = stiffness(rng), rounded(rng.uniform(0.0, 50.0))
    capsules = any("end" in body for body in bodies)
    reach = max((abs(body["position"][0]) for body in bodies), default=0.0)
    walls = [wall(rng, reach, capsules) for _ in range(int(rng.choice([1, 2, 3], p=(0.6, 0.3, 0.1))))]
    over["walls"] = walls
    over |= reference(rng, np.array(walls[0]["position"]) - [reach, 0.0, 0.0])
    over |= impedance(rng, heavier)
    over |= water(rng, heavier)
    if rng.random() < 0.15:
        over["initial.position"] = rounded(rng.uniform(-0.4, 0.4, 3))
        over["initial.attitude_deg"] = rounded(rng.uniform(-20.0, 20.0, 3))
    if rng.random() < 0.1:
        over |= {f"estimates.{key}": rounded(rng.uniform(0.8, 1.2)) for key in ("inertia", "damping", "restoring")}
    if rng.random() < 0.1:
        over["vehicle.added_mass"], over["vehicle.linear_damping"] = (rounded(rng.uniform(0.8, 1.3)) for _ in "ab")
    if rng.random() < 0.1:
        over["navigation.name"] = "sensors"
        over["navigation.force_bias"] = rounded(rng.uniform(-1.0, 1.0, 3))
        over["navigation.position_bias"] = rounded(rng.uniform(-0.005, 0.005, 3))
    if law not in ("admittance", "pid") and rng.random() < 0.15:
        over["task.integral"] = True
    return over


def heavy(times: float) -> str:
    """The file of a BlueROV2 Heavy of another size, with so many times its mass: lengths grow with the third root, and
    forces and moments in proportion to mass and to mass times length."""
    path = Path(tempfile.gettempdir()) / f"uvms_mj_heavy_{times:g}.xml"
    vehicle, length = Mjcf.find("bluerov2_heavy").vehicle, times ** (1.0 / 3.0)
    arms = np.repeat([1.0, length], 3)
    inertia = np.diag(vehicle.M_RB)[3:] * times * length**2
    numbers = {
        "M_A": np.diag(np.diag(vehicle.M_A) * times * arms**2),
        "D_linear": np.diag(np.diag(vehicle.D_linear) * times * arms**2 / np.sqrt(length)),
        "D_quadratic": np.diag(np.diag(vehicle.D_quadratic) * length**2 * np.repeat([1.0, length**3], 3)),
        "displaced_mass": [vehicle.displaced_mass * times],
        "center_of_buoyancy": (vehicle.r_b - vehicle.r_g) * length,
    }
    data = {name: " ".join(f"{x:.9g}" for x in np.ravel(values)) for name, values in numbers.items()}
    custom = "".join(f'<numeric name="{name}" data="{each}"/>' for name, each in data.items())
    gears = [" ".join(f"{x:.9g}" for x in column * arms) for column in vehicle.B.T]
    motors = "".join(f'<motor site="centre" gear="{gear}"/>' for gear in gears)
    path.write_text(
        f'<mujoco model="heavy"><compiler autolimits="true"/><option gravity="0 0 -9.81"/><custom>{custom}</custom>'
        f'<worldbody><body name="heavy" simple="false"><freejoint/><site name="centre"/><inertial pos="0 0 0" '
        f'mass="{vehicle.mass * times:.9g}" diaginertia="{" ".join(f"{x:.9g}" for x in inertia)}"/>'
        f'<geom type="box" size="{0.2 * length:.9g} {0.2 * length:.9g} {0.1 * length:.9g}" mass="0" contype="0" '
        f'conaffinity="0"/></body></worldbody><actuator>{motors}</actuator></mujoco>'
    )
    return str(path)


def tool_case(rng: np.random.Generator) -> dict[str, Any]:
    """Overrides of push_wall for the tool of a planar arm among random walls."""
    law = str(rng.choice(("gsta", "sta", "fosm", "impedance"), p=(0.4, 0.25, 0.2, 0.15)))
    over: dict[str, Any] = {"controller.name": law, "simulation.timestep": 5e-4, "simulation.duration": 40.0}
    arm = str(rng.choice(("planar_arm", "bluerov2_alpha5"), p=(0.75, 0.25)))
    over |= {"vehicle.model": arm, "task.frame": "tool"}
    if arm == "planar_arm":
        over["initial.joints"] = rounded([rng.uniform(-0.9, 0.9), rng.uniform(-1.3, 1.3)])
    else:
        over["vehicle.coulomb_friction"] = 0.0
    start, attitude = tool_start(over)
    over["wall.present"] = bool(rng.random() < 0.4)
    if over["wall.present"]:
        over["wall.position"], over["wall.stiffness"] = rounded(start[0] + rng.uniform(0.02, 0.15)), stiffness(rng)
    if rng.random() < 0.75 or not over["wall.present"]:
        shape = wall(rng, 0.0, False)
        size = shape.get("radius") or min(shape.get("edges", [0.0])) / 2.0
        away = [size + rng.uniform(0.03, 0.15), *(rng.uniform(-0.6, 0.6, 2) * size).tolist()]
        shape["position"] = rounded(start + np.array(away))
        over["walls"] = [shape]
        centre = np.array(shape["position"])
    else:
        centre = np.array([over["wall.position"], *start[1:]])
    over["reference.target"] = rounded(centre + rng.uniform(-0.04, 0.04, 3))
    over["reference.attitude_deg"] = rounded(attitude)
    over |= impedance(rng)
    over["current.speed"], over["current.direction_deg"] = rounded(rng.uniform(0.0, 0.5)), rounded(rng.uniform(0, 360))
    over["posture.order"] = [["attitude"], ["attitude", "joints"], ["joints"], ["station"], ["station", "joints"], []][
        int(rng.choice(6, p=(0.25, 0.25, 0.2, 0.1, 0.1, 0.1)))
    ]
    return over


def tool_start(over: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) and attitude (3,) [deg] of the tool at the start of a case."""
    from uvms_mj.setup.base import set_up

    given: dict[str, Any] = {key: value for key, value in over.items() if key.split(".")[0] in _POSE}
    initial = set_up(Scenario.load("push_wall", given)).initial
    return np.array(initial.position), np.array(initial.attitude_deg)


def wall(rng: np.random.Generator, reach: float, capsules: bool) -> dict[str, Any]:
    """One of [[walls]], in front of the vehicle."""
    shape = str(rng.choice(("sphere", "cylinder", "box", "plane"), p=(0.35, 0.3, 0.2, 0.15)))
    if capsules and shape == "box":
        shape = "cylinder"
    made: dict[str, Any] = {"shape": shape, "stiffness": stiffness(rng), "damping": rounded(rng.uniform(0.0, 200.0))}
    x = reach + rng.uniform(0.9, 1.7)
    made["position"] = rounded([x, *rng.uniform(-0.3, 0.3, 2)])
    if rng.random() < 0.2:
        made["position"] = rounded([x, 0.0, 0.0])
    if shape in ("sphere", "cylinder"):
        made["radius"] = rounded(rng.uniform(0.08, 0.4))
    if shape == "box":
        made["edges"] = rounded(rng.uniform(0.1, 0.8, 3))
    if shape != "sphere" and rng.random() < 0.6:
        made["attitude_deg"] = rounded(rng.uniform(-30.0, 30.0, 3))
    if rng.random() < 0.1:
        made["layer_depth"], made["layer_stiffness"] = rounded(rng.uniform(0.002, 0.02)), stiffness(rng)
    if rng.random() < 0.05:
        made["friction"] = rounded(rng.uniform(0.1, 0.5))
    return made


def contact_bodies(rng: np.random.Generator) -> list[dict[str, Any]]:
    """None, or one to three of the vehicle's contact bodies, in front of it."""
    if rng.random() < 0.5:
        return []
    made = []
    for _ in range(int(rng.integers(1, 4))):
        off = 0.2 if rng.random() < 0.7 else 0.5
        body: dict[str, Any] = {"position": rounded([rng.uniform(0.15, 0.35), *rng.uniform(-off, off, 2)])}
        body["radius"] = rounded(rng.uniform(0.02, 0.1))
        if rng.random() < 0.2:
            body["end"] = rounded(np.array(body["position"]) + rng.uniform(-0.2, 0.2, 3))
        if rng.random() < 0.4:
            body["stiffness"], body["damping"] = stiffness(rng), rounded(rng.uniform(0.0, 50.0))
        made.append(body)
    return made


def reference(rng: np.random.Generator, centre: np.ndarray) -> dict[str, Any]:
    """A target inside, in front of, beside or behind a wall, by one of several references."""
    where = rng.choice(("front", "inside", "beside", "behind"), p=(0.35, 0.3, 0.2, 0.15))
    offset = {
        "front": [rng.uniform(-0.4, -0.1), *rng.uniform(-0.1, 0.1, 2)],
        "inside": rng.uniform(-0.1, 0.1, 3),
        "beside": [rng.uniform(-0.1, 0.1), *(rng.choice([-1.0, 1.0], 2) * rng.uniform(0.1, 0.4, 2))],
        "behind": [rng.uniform(0.1, 0.4), *rng.uniform(-0.1, 0.1, 2)],
    }[str(where)]
    target = rounded(centre + np.array(offset))
    attitude = rounded(rng.uniform(-15.0, 15.0, 3)) if rng.random() < 0.3 else [0.0, 0.0, 0.0]
    kind = rng.random()
    if kind < 0.7:
        return {"reference.target": target, "reference.attitude_deg": attitude}
    if kind < 0.85:
        middle = rounded(0.5 * np.array(target) + rng.uniform(-0.3, 0.3, 3))
        steps = [{"time": 1.0, "position": middle}, {"time": 6.0, "position": target}]
        return {"reference.waypoints": steps, "reference.attitude_deg": attitude}
    if kind < 0.97:
        poses = [{"position": rounded(0.5 * np.array(target) + rng.uniform(-0.2, 0.2, 3))}, {"position": target}]
        poses[1]["attitude_deg"] = attitude
        return {"reference.name": "path", "reference.poses": poses}
    return {"reference.name": "circle"}


def impedance(rng: np.random.Generator, heavier: float = 1.0) -> dict[str, Any]:
    """Desired stiffness, in proportion to the mass, and sometimes a force."""
    made: dict[str, Any] = {}
    if rng.random() < 0.7 or heavier > 1.0:
        K_d = np.array([*10.0 ** rng.uniform(1.7, 3.2, 3), *rng.uniform(20.0, 100.0, 3)])
        made["impedance.K_d"] = rounded(K_d * np.repeat([heavier, heavier ** (5.0 / 3.0)], 3))
    if rng.random() < 0.25:
        made["impedance.F_d"] = rounded([-rng.uniform(0.5, 10.0), *rng.uniform(-2.0, 2.0, 2), 0.0, 0.0, 0.0])
    if rng.random() < 0.15:
        made["impedance.K_f"] = rounded([*rng.uniform(0.4, 1.0, 3), 1.0, 1.0, 1.0])
    return made


def water(rng: np.random.Generator, heavier: float = 1.0) -> dict[str, Any]:
    """A constant current and disturbance."""
    made: dict[str, Any] = {"current.speed": rounded(rng.uniform(0.0, 0.5)) if rng.random() < 0.7 else 0.0}
    made["current.direction_deg"] = rounded(rng.uniform(0.0, 360.0))
    if rng.random() < 0.2:
        bias = np.array([*rng.uniform(-5.0, 5.0, 3), *rng.uniform(-0.3, 0.3, 3)])
        made["disturbance.bias"] = rounded(bias * np.repeat([heavier, heavier ** (4.0 / 3.0)], 3))
    return made


def stiffness(rng: np.random.Generator) -> float:
    """1e3 to 1e5 N/m."""
    return rounded(10.0 ** rng.uniform(3.0, 5.0))


def rounded(values: Any) -> Any:
    """A number, or a list of numbers, of five digits."""
    array = np.array([float(f"{x:.5g}") for x in np.ravel(values)]).tolist()
    return array if np.ndim(values) else array[0]


def overrides(seed: int, case: int, tools: bool) -> dict[str, Any]:
    """The overrides of push_wall that are a case."""
    return (tool_case if tools else rigid_case)(np.random.default_rng([seed, case]))


def command(over: dict[str, Any], tools: bool) -> str:
    """The command line of a case."""
    keys = " ".join(f"'{key}={toml(value)}'" for key, value in over.items())
    return f"uvms-mj run push_wall {keys}" + ("" if tools else " --engine free_body")


def toml(value: Any) -> str:
    """A value as an override has it."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value)


def tried(job: tuple[int, int, bool]) -> Result:
    """Run one case: seed, number, and whether it is a tool's."""
    seed, case, tools = job
    over = overrides(seed, case, tools)
    law = over["controller.name"]
    warnings.simplefilter("ignore")
    try:
        start = time.process_time()
        trace = simulate(Scenario.load("push_wall", over), log_rate=10.0, engine="mujoco" if tools else "free_body")
        run_s = time.process_time() - start
    except InputError as error:
        return Result(case, "refused", law, None, None, str(error), 0.0, 0.0)
    if trace.status is not Status.completed:
        return Result(case, str(trace.status.name), law, None, None, trace.message, run_s, 0.0)
    start = time.process_time()
    rest = trace.analytic
    rest_s = time.process_time() - start
    measured, announced = settled(trace), rest.force if isinstance(rest, SteadyState) else None

    def again(key: str, factor: float) -> float | None:
        changed = over | {key: factor * over[key]}
        return settled(simulate(Scenario.load("push_wall", changed), log_rate=10.0, engine=trace.header.engine))

    if announced is None:
        kind = "not settled" if measured is None else "no closed form"
        return Result(case, kind, law, measured, None, getattr(rest, "reason", ""), run_s, rest_s)
    if measured is None:
        later = (again("simulation.duration", factor) for factor in LONGER)
        measured = next((force for force in later if force is not None), None)
    elif differs(measured, announced) and not tools:  # an error of the time step?
        measured = again("simulation.timestep", 0.2) or measured
    kind = "wrong" if measured is None or differs(measured, announced) else "announced"
    return Result(case, kind, law, measured, announced, "", run_s, rest_s)


def differs(measured: float, announced: float) -> bool:
    """Whether a closed form is wrong."""
    return abs(measured - announced) > WRONG * max(1.0, measured, announced)


def settled(trace: Any) -> float | None:
    """Mean force of the last second if the force rests, also extrapolated; otherwise None."""
    ends = np.searchsorted(trace.t, trace.t[-1] - BLOCK_S * np.arange(BLOCKS, -1, -1) + 1e-6) - 1
    means = np.diff(trace.impulse[ends]) / np.diff(trace.t[ends])
    size = STEADY * max(1.0, means[-1])
    if np.ptp(means) > size or np.abs(trace.nu[-1]).max() > 1e-3:
        return None
    half = BLOCKS // 2
    early, late = means[half] - means[0], means[-1] - means[half]
    ratio = late / early if abs(early) > 1e-2 * size else 0.0
    return None if ratio >= 1.0 or abs(late * ratio / (1.0 - ratio)) > size else float(means[-1])


@click.command()
@click.option("--cases", type=int, default=800, show_default=True, help="Number of scenarios.")
@click.option("--first", type=int, default=0, show_default=True, help="Number of the first one.")
@click.option("--seed", type=int, default=1, show_default=True, help="Seed of the scenarios.")
@click.option("--tools", is_flag=True, help="Tools of arms in place of rigid vehicles.")
@click.option("--workers", type=int, default=2, show_default=True, help="Number of parallel processes.")
@click.option("--case", type=int, help="Run only this case, and print its command.")
def sweep(cases: int, first: int, seed: int, tools: bool, workers: int, case: int | None) -> None:
    """Compare the closed forms of random scenarios with their runs. Exit status 1 if one is wrong."""
    if case is not None:
        click.echo(command(overrides(seed, case, tools), tools))
        click.echo(tried((seed, case, tools)))
        return
    jobs, found = [(seed, k, tools) for k in range(first, first + cases)], []
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        for result in pool.imap_unordered(tried, jobs):
            found.append(result)
            if result.kind == "wrong":
                found_N = "no rest" if result.measured is None else f"{result.measured:.6g} N"
                click.echo(f"case {result.case}: announced {result.announced:.6g} N, measured {found_N}")
                click.echo(f"  {command(overrides(seed, result.case, tools), tools)}")
    for line in report(found):
        click.echo(line)
    sys.exit(any(result.kind == "wrong" for result in found))


def report(found: list[Result]) -> list[str]:
    """The counts of a sweep, the reasons without a closed form, and the CPU times."""
    kinds = collections.Counter(result.kind for result in found)
    rests = kinds["announced"] + kinds["wrong"] + kinds["no closed form"]
    lines = [", ".join(f"{kind}: {n}" for kind, n in kinds.most_common())]
    lines.append(f"of {rests} that settle {(rests - kinds['no closed form']) / max(1, rests):.1%} have a closed form")
    for kind, title in (("no closed form", "settled, without a closed form"), ("not settled", "not settled")):
        lines.append(f"{title}:")
        reasons = collections.Counter(_NUMBER.sub("#", result.reason) for result in found if result.kind == kind)
        lines += [f"  {n}: {reason}" for reason, n in reasons.most_common()]
    rest_s, run_s = ([getattr(result, name) for result in found] for name in ("rest_s", "run_s"))
    lines.append(f"CPU: closed forms {np.median(rest_s):.3f} s (median), {max(rest_s):.2f} s (most), runs")
    lines[-1] += f" {np.median(run_s):.3f} s (median)"
    return lines


if __name__ == "__main__":
    sweep()
