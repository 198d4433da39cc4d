r"""A REMUS 100 from files, against the turns of another simulator and against its equations written anew.

The vehicle is that of PythonVehicleSimulator's ``remus100.py`` (commit c717e073d7a839dcb5956cf20c595132f1fa249a, MIT;
Fossen 2021, sec. 8.4.2): a spheroid of 1.6 m by 0.19 m with Lamb's added mass. Its model takes the Munk moment out of
C_A, with the other terms of the same four pairs of entries. What it has goes into files as a user would write them:

- the MJCF has mass, added mass and linear damping, and as *products* what its model takes out of C_A;
- the cross-flow drag, a sum over 21 strips, is 21 tables ``[[drag]]``;
- what no table has is an effect of 20 lines: damping that fades with exp(-3 U), lift and drag of the hull by the whole
  speed, a rudder whose lift does not know the direction of the flow, and the propeller.

``TURNS`` are its printed results. Without the Munk moment all of them are reached, to the last digit. With it none of
the turns is: the hull alone is unstable about a straight course, as its rudder does not see the drift. ``[[fins]]`` of
published area and slope see it, and bring it back to its course; the turns are then those of another vehicle. Both are
compared with the equations, written anew with z down and Euler angles.
"""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from twin import TwinParameters
from uvms_mj import Scenario, Simulation
from vehicles import vehicle_xml

TURNS = {
    (1525, 0): (2.55365, 0.0, 0.0),
    (1525, 2): (2.5509, 1.8384, -2.898),
    (1525, 5): (2.5443, 3.6116, -4.167),
    (1525, 10): (2.5283, 5.8998, -5.460),
    (1525, 15): (2.5067, 7.7788, -6.386),
    (750, 0): (1.2542, 0.0, 0.0),
    (1000, 0): (1.6741, 0.0, 0.0),
    (1250, 0): (2.0930, 0.0, 0.0),
}
"""Speed [m/s], rate of the heading [deg/s] and drift [deg], z down, by the propeller [rpm] and the rudder [deg]."""

RHO, LENGTH, DIAMETER = 1026.0, 1.6, 0.19
A, B = LENGTH / 2.0, DIAMETER / 2.0
MASS, Z_G = 4.0 / 3.0 * math.pi * RHO * A * B**2, 0.02
SURFACE = 0.7 * LENGTH * DIAMETER
CD_0 = 0.42 * math.pi * B**2 / SURFACE
I_X, I_Y = 0.4 * MASS * B**2, 0.2 * MASS * (A**2 + B**2)
CROSS = 0.5 * RHO * DIAMETER * np.interp(0.5, (0.4933, 0.5585), (1.2108, 1.0836)) * LENGTH / 20.0  # Hoerner's curve
STRIPS = np.linspace(-A, A, 21)
RUDDER = 0.5 * RHO * 2.0 * 0.00665 * 0.5  # N s^2/m^2 by rad


def lamb() -> np.ndarray:
    """(6,) the diagonal of M_A of the spheroid, with 0.3 of its inertia in roll (Fossen 2021, sec. 8.4.2)."""
    e = math.sqrt(1.0 - (B / A) ** 2)
    logarithm = math.log((1.0 + e) / (1.0 - e))
    alpha = 2.0 * (1.0 - e**2) / e**3 * (0.5 * logarithm - e)
    beta = 1.0 / e**2 - (1.0 - e**2) / (2.0 * e**3) * logarithm
    k_1, k_2 = alpha / (2.0 - alpha), beta / (2.0 - beta)
    turning = e**4 * (beta - alpha) / ((2.0 - e**2) * (2.0 * e**2 - (2.0 - e**2) * (beta - alpha)))
    return np.array([k_1 * MASS, k_2 * MASS, k_2 * MASS, 0.3 * I_X, turning * I_Y, turning * I_Y])


M_A = lamb()
INERTIA = np.array([I_X, I_Y, I_Y]) + MASS * Z_G**2 * np.array([1.0, 1.0, 0.0])  # about the origin
WEIGHT = MASS * 9.81
M = np.concatenate([[MASS] * 3, INERTIA]) + M_A
LINEAR = np.array([
    *(M[:3] / 20.0),
    M[3] * 0.6 * math.sqrt(WEIGHT * Z_G / M[3]),
    M[4] * 1.6 * math.sqrt(WEIGHT * Z_G / M[4]),
    M[5],
])  # fmt: skip
"""Linear damping at rest; in surge and sway it fades with the speed."""

OF_MUNK = {
    "Xwq": M_A[2], "Xvr": -M_A[1], "Yur": M_A[0], "Zuq": -M_A[0], "Muw": M_A[0] - M_A[2], "Nuv": M_A[1] - M_A[0],
}  # fmt: skip
"""Products that take out of C_A what the other simulator takes out."""

STERN = f'''
import math
from dataclasses import dataclass
import numpy as np
from uvms_mj import Effect, setting

@dataclass(frozen=True)
class Remus(Effect):
    """What no table has of the other simulator's REMUS 100."""
    rpm: float = setting(1525.0, "1/min", "propeller")
    rudder_deg: float = setting(0.0, "deg", "rudder, positive to starboard")

    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        u, v, w = given.nu_r[0], given.nu_r[1], given.nu_r[2]
        speed, alpha, n = math.sqrt(u * u + v * v + w * w), math.atan2(w, u), settings.rpm / 60.0
        delta = settings.rudder_deg * math.pi / 180.0
        tau[:] = 0.0
        fading = math.exp(-3.0 * speed) / 20.0
        tau[0], tau[1] = -{float(M[0])!r} * fading * u, -{float(M[1])!r} * fading * v
        ratio = {DIAMETER**2 / SURFACE!r}
        C_L = math.pi * ratio / (1.0 + math.sqrt(1.0 + ratio * ratio / 4.0)) * alpha
        q = {0.5 * RHO * SURFACE!r} * speed * speed
        drag, lift = q * ({CD_0!r} + C_L * C_L / (math.pi * 0.7 * ratio)), q * C_L
        tau[0] += -drag * math.cos(alpha) + lift * math.sin(alpha)
        tau[2] += -drag * math.sin(alpha) - lift * math.cos(alpha)
        side = {RUDDER!r} * (u * u + v * v) * delta
        tau[0] -= side * delta
        tau[1] += side
        tau[5] -= {A!r} * side
        advance = 0.944 * speed / 0.14
        tau[0] += 0.9 * {RHO * 0.14**4!r} * (0.4566 * n * n + (0.1798 - 0.4566) / 0.6632 * advance * n)
        tau[3] += 0.1 * {RHO * 0.14**5!r} * (0.07 * n * n + (0.0312 - 0.07) / 0.6632 * advance * n)
'''


def scenario_of(folder, munk: bool, rpm: float, rudder_deg: float, **others) -> Scenario:
    """The vehicle at 1 m/s in still water without a wall."""
    parameters = TwinParameters(
        mass=MASS,
        inertia=np.diag(INERTIA),
        r_g=(0.0, 0.0, -Z_G),
        M_A=np.diag(M_A),
        D_linear=np.diag([0.0, 0.0, *LINEAR[2:]]),
        D_quadratic=np.zeros((6, 6)),
    )
    products = "" if munk else " ".join(f"{name} {float(value)!r}" for name, value in OF_MUNK.items())
    (folder / "remus.xml").write_text(vehicle_xml(parameters, products=products))
    (folder / "stern.py").write_text(STERN)
    return Scenario.load(
        "push_wall",
        {
            "vehicle.model": str(folder / "remus.xml"),
            "simulation.timestep": 0.01,
            "simulation.duration": 200.0,
            "initial.velocity": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            "initial.position": [0.0, 0.0, 0.0],
            "current.speed": 0.0,
            "wall.present": False,
            "controller.name": "external",
            "drag": [{"forward": [0.0, float(CROSS), 0.0], "position": [float(x), 0.0, 0.0]} for x in STRIPS],
            "effects": [{"name": f"{folder / 'stern.py'}:Remus", "rpm": float(rpm), "rudder_deg": float(rudder_deg)}],
        }
        | others,
    )


def turn(scenario: Scenario, duration: float = 200.0) -> tuple[float, float, float]:
    """Speed [m/s], rate of the heading [deg/s] and drift [deg] at the end, in axes with z down."""
    with Simulation(scenario, engine="free_body") as sim:
        sim.step(round(duration / scenario.simulation.timestep))
        nu, R = sim.signals.nu, sim.signals.R_WB
        omega_W = R @ nu[3:]
        ahead = R[:, 0]
        heading = np.cross([0.0, 0.0, 1.0], ahead) @ np.cross(omega_W, ahead) / (ahead[:2] @ ahead[:2])
        return float(np.linalg.norm(nu[:3])), -math.degrees(heading), -math.degrees(math.atan2(nu[1], nu[0]))


def extrapolated(scenario: Scenario) -> np.ndarray:
    """(3,) :func:`turn` without the error of first order of its time step."""
    coarse, fine = (np.array(turn(scenario.updated({"simulation.timestep": h}))) for h in (0.01, 0.005))
    return 2.0 * fine - coarse


@pytest.mark.parametrize(("rpm", "rudder_deg"), TURNS)
def test_without_the_munk_moment_it_turns_as_in_the_other_simulator(tmp_path, rpm, rudder_deg):
    found = extrapolated(scenario_of(tmp_path, False, rpm, rudder_deg))
    assert (np.abs(found - TURNS[rpm, rudder_deg]) <= (6e-5, 6e-5, 6e-4)).all(), found


def crossed(a: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def coriolis(inertia: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """C (6, 6) from the momenta (Fossen 2021, eq. 3.46)."""
    p, h = np.split(inertia @ nu, 2)
    return np.block([[np.zeros((3, 3)), -crossed(p)], [-crossed(p), -crossed(h)]])


FORM = np.block([[np.eye(3), -crossed(np.array([0.0, 0.0, Z_G]))], [np.zeros((3, 3)), np.eye(3)]])
M_RB = FORM.T @ np.diag([MASS, MASS, MASS, I_X, I_Y, I_Y]) @ FORM
WITHOUT = ((4, 0), (0, 4), (4, 2), (2, 4), (5, 0), (0, 5), (5, 1), (1, 5))
"""Entries of C_A that the other simulator sets to zero."""
PLACES = ((-A, 0.0, 0.07), (-A, 0.0, -0.07), (-A, 0.07, 0.0), (-A, -0.07, 0.0))
FIN = {"area": 0.00665, "lift_slope": 3.12, "drag_coefficient": 0.01, "induced_drag": 0.1}
"""Prestero 2001: area and slope of the lift of one fin of a REMUS 100; its drag is an assumption."""


def fins(rudder_deg: float) -> list[dict]:
    upright = [FIN | {"position": place, "deflection_deg": rudder_deg} for place in PLACES[:2]]
    return upright + [FIN | {"position": place, "attitude_deg": [90.0, 0.0, 0.0]} for place in PLACES[2:]]


def of_fins(nu: np.ndarray, rudder_deg: float) -> np.ndarray:
    """(6,) wrench of the fins below their stall, z down: lift across the flow, drag along it."""
    total = np.zeros(6)
    for k, place in enumerate(PLACES):
        r = np.array(place)
        across, delta = (1, math.radians(rudder_deg)) if k < 2 else (2, 0.0)
        v = nu[:3] + np.cross(nu[3:], r)
        flow = np.array([v[0], v[across]])
        alpha = math.atan2(flow[1], flow[0]) + delta  # a rudder to starboard, where a drift to starboard goes too
        assert abs(alpha) < math.radians(17.0)
        C_L = FIN["lift_slope"] * alpha
        C_D = FIN["drag_coefficient"] + FIN["induced_drag"] * C_L**2
        plane = -500.0 * FIN["area"] * np.linalg.norm(flow) * (C_L * np.array([-flow[1], flow[0]]) + C_D * flow)
        force = np.zeros(3)
        force[0], force[across] = plane
        total += np.r_[force, np.cross(r, force)]
    return total


def rates(y: np.ndarray, munk: bool, rpm: float, rudder_deg: float, finned: bool) -> np.ndarray:
    """Rates of nu, roll and pitch (8,), z down, by the equations of the other simulator with CG and Euler angles."""
    nu, roll, pitch = y[:6], y[6], y[7]
    u, v, w, p, q, r = nu
    speed, alpha, n = math.sqrt(u * u + v * v + w * w), math.atan2(w, u), rpm / 60.0
    C_A = coriolis(np.diag(M_A), nu)
    if not munk:
        for place in WITHOUT:
            C_A[place] = 0.0
    fading = np.array([math.exp(-3.0 * speed)] * 2 + [1.0] * 4)
    aspect = DIAMETER**2 / SURFACE
    C_L = math.pi * aspect / (1.0 + math.sqrt(1.0 + (aspect / 2.0) ** 2)) * alpha
    drag, lift = 0.5 * RHO * speed**2 * SURFACE * np.array([CD_0 + C_L**2 / (math.pi * 0.7 * aspect), C_L])
    tau = np.zeros(6)
    tau[[0, 2]] = -drag * math.cos(alpha) + lift * math.sin(alpha), -drag * math.sin(alpha) - lift * math.cos(alpha)
    strips = -CROSS * np.abs(v + STRIPS * r) * (v + STRIPS * r)
    tau[[1, 5]] += strips.sum(), STRIPS @ strips
    delta = 0.0 if finned else math.radians(rudder_deg)
    side = RUDDER * (u * u + v * v) * delta
    tau += np.array([-side * delta, -side, 0.0, 0.0, 0.0, A * side])
    J = 0.944 * speed / (0.14 * n)
    tau[0] += 0.9 * RHO * n**2 * 0.14**4 * (0.4566 - 0.2768 * J / 0.6632)
    tau[3] += 0.1 * RHO * n**2 * 0.14**5 * (0.07 - 0.0388 * J / 0.6632)
    tau += of_fins(nu, rudder_deg) if finned else 0.0
    righting = WEIGHT * Z_G * np.array([0.0, 0.0, 0.0, math.cos(pitch) * math.sin(roll), math.sin(pitch), 0.0])
    nu_dot = np.linalg.solve(
        M_RB + np.diag(M_A), tau - righting - (coriolis(M_RB, nu) + C_A) @ nu - LINEAR * fading * nu
    )
    turning = math.sin(roll) * q + math.cos(roll) * r
    return np.r_[nu_dot, p + math.tan(pitch) * turning, math.cos(roll) * q - math.sin(roll) * r]


def by_equations(duration: float, *model) -> np.ndarray:
    """nu (6,), z down, after a duration [s] from 1 m/s."""
    y_0 = np.r_[1.0, np.zeros(7)]
    found = solve_ivp(lambda _, y: rates(y, *model), (0.0, duration), y_0, method="LSODA", rtol=1e-9, atol=1e-11)
    return found.y[:6, -1]


@pytest.mark.parametrize(
    ("munk", "rudder_deg", "finned", "duration"),
    [(False, 15.0, False, 10.0), (True, 0.5, False, 1.5), (True, 15.0, True, 10.0), (False, 5.0, True, 10.0)],
    ids=["as the other", "with Munk's moment", "with Munk's moment and fins", "with fins"],
)
def test_it_moves_as_by_the_equations_with_and_without_munk_moment_and_fins(
    tmp_path, munk, rudder_deg, finned, duration
):
    expected, errors = by_equations(duration, munk, 1525.0, rudder_deg, finned), []
    others = {"fins": fins(rudder_deg)} if finned else {}
    scenario = scenario_of(tmp_path, munk, 1525.0, 0.0 if finned else rudder_deg, **others)
    for h in (5e-3, 2.5e-3):
        with Simulation(scenario.updated({"simulation.timestep": h}), engine="free_body") as sim:
            sim.step(round(duration / h))
            errors.append(np.abs(np.kron([1, 1], [1, -1, -1]) * sim.signals.nu - expected).max())
    assert errors[1] < 0.01
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.03)  # semi-implicit Euler


def test_with_the_munk_moment_the_hull_alone_leaves_its_course_and_fins_bring_it_back(tmp_path):
    """A nudge in sway of 1 mm/s at full speed, as large as the growth of drift is small."""
    nudged = {"initial.velocity": [2.5, 1e-3, 0.0, 0.0, 0.0, 0.0]}
    for munk, finned, stays in ((False, False, True), (True, False, False), (True, True, True)):
        others = {"fins": fins(0.0)} if finned else {}
        found = turn(scenario_of(tmp_path, munk, 1525.0, 0.0, **nudged, **others), 20.0)
        assert (abs(found[1]) < 0.05) == stays, (munk, finned, found)


def test_the_page_has_the_turns_of_the_runs(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "physics" / "water.md").read_text()
    for rudder_deg in (0, 5, 10, 15):
        cells = [f"{rudder_deg}"]
        for munk, finned in ((False, False), (False, True), (True, True)):
            others = {"fins": fins(rudder_deg)} if finned else {}
            scenario = scenario_of(tmp_path, munk, 1525.0, 0.0 if finned else rudder_deg, **others)
            speed, rate, drift = extrapolated(scenario)
            cells.append(f"{speed:.3f}, {abs(rate):.2f}, {abs(drift):.2f}")
        assert f"| {' | '.join(cells)} |" in page, cells
