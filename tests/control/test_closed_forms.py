"""Settled runs rest at the closed forms, in the paper's scenario and others; invalid closed forms are not given."""

import dataclasses

import numpy as np
import pytest

from twin import TwinParameters
from uvms_mj import Scenario, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.control.base import NoClosedForm, SteadyState
from uvms_mj.control.theory.predictions import steady_state
from uvms_mj.setup.base import set_up
from vehicles import vehicle_xml

OTHER_WORLD = {
    "current.speed": 0.7,
    "current.direction_deg": 30.0,
    "disturbance.bias": [5.0, -2.0, 0.5, 0.1, -0.1, 0.2],
    "wall.stiffness": 2e4,
    "wall.position": 0.7,
    "reference.target": [0.75, 0.2, 0.3],
}
WRONG = {"estimates.inertia": 0.8, "estimates.coriolis": 0.0, "estimates.damping": 0.5, "estimates.restoring": 1.5}
FREE = {"engine": "free_body"}
CASES = {
    "paper": ("gsta", {}),
    "gsta alone": ("gsta", {"controller.nominal": False}),
    "gsta, other world": ("gsta", OTHER_WORLD),
    "gsta, wrong": ("gsta", WRONG),
    "gsta alone, wrong": ("gsta", {"controller.nominal": False, "estimates.inertia": 0.7, "current.speed": 0.3}),
    "gsta, stiff": ("gsta", {"wall.stiffness": 1e6, "simulation.timestep": 5e-5}),
    "gsta, soft": ("gsta", {"wall.stiffness": 1e3, "impedance.K_d": [400.0, 500.0, 500.0, 20.0, 20.0, 20.0]}),
    "gsta, other M_d": ("gsta", {"impedance.M_d": [10.0, 20.0, 20.0, 0.3, 0.3, 0.3], "wall.damping": 200.0}),
    "gsta, turned": ("gsta", {"reference.attitude_deg": [5.0, -10.0, 20.0]}),
    "gsta, waves": ("gsta", {"disturbance.amplitude": [5.0] * 3 + [0.2] * 3, "disturbance.frequency_hz": [0.5] * 6}),
    "gsta, waypoints": (
        "gsta",
        {
            "reference.waypoints": [
                {"time": 1.0, "position": [0.5, 0.1, 0.0]},
                {"time": 5.0, "position": [1.02, 0.0, 0.0]},
            ]
        },
    ),
    "fosm": ("fosm", {}),
    "fosm, other world": ("fosm", OTHER_WORLD),
    "fosm, wrong": ("fosm", WRONG | {"controller.K_s": 10.0, "task.A": -50.0}),
    "fosm, turned": (
        "fosm",
        {"reference.attitude_deg": [5.0, -10.0, 20.0], "controller.epsilon": 5e-2, "controller.K_s": 8.0},
    ),
    "sta": ("sta", {}),
    "sta, other world": ("sta", OTHER_WORLD),
    "sta, wrong": ("sta", WRONG),
    "sta, soft": ("sta", {"wall.stiffness": 1e4, "reference.target": [1.05, 0.1, 0.0]}),
    "ideal": ("ideal", {}),
    "ideal, other world": ("ideal", OTHER_WORLD),
    "ideal, wrong": ("ideal", WRONG | {"current.direction_deg": 200.0}),
    "ideal, turned": ("ideal", {"reference.attitude_deg": [5.0, -10.0, 20.0], "reference.target": [1.1, 0.0, 0.0]}),
    "integral, fosm, other world": ("fosm", OTHER_WORLD | {"task.integral": True}),
    "integral, gsta, wrong": ("gsta", WRONG | {"task.integral": True}),
    "force reference, other world": ("gsta", OTHER_WORLD | {"impedance.F_d": [-4.0, 1.0, 0.0, 0.0, 0.0, 0.1]}),
    "force reference, fosm": ("fosm", {"impedance.F_d": [-4.0] + [0.0] * 5, "impedance.K_f": [0.7] + [1.0] * 5}),
    "force reference, impedance": ("impedance", OTHER_WORLD | {"impedance.F_d": [-4.0] + [0.0] * 5}),
    "inertia shaping, gsta": ("gsta", OTHER_WORLD | {"impedance.M_d": [6.0, 12.0, 15.0, 0.2, 0.2, 0.2]}),
    "inertia shaping, impedance": (
        "impedance",
        OTHER_WORLD | {"impedance.M_d": [6.0, 12.0, 15.0, 0.2, 0.2, 0.2], "reference.target": [0.9, 0.1, 0.0]},
    ),
    "impedance": ("impedance", {}),
    "impedance, pushing": ("impedance", {"reference.target": [1.2, 0.0, 0.0]}),
    "impedance, other world": ("impedance", OTHER_WORLD),
    "impedance, wrong": (
        "impedance",
        WRONG | {"reference.target": [1.3, 0.1, -0.1], "reference.attitude_deg": [5.0, -10.0, 20.0]},
    ),
}


OF_MUJOCO = ("paper", "fosm, other world", "sta, wrong", "ideal, turned", "impedance, pushing")
"""Cases that MuJoCo runs, too: its wall has an inerter, which must not matter at rest."""


@pytest.mark.parametrize(
    ("case", "engine"), [*((case, "free_body") for case in CASES), *((case, "mujoco") for case in OF_MUJOCO)]
)
def test_a_settled_run_rests_where_the_closed_form_says(case, engine):
    law, overrides = CASES[case]
    base = {"simulation.duration": 15.0, "simulation.timestep": 1e-4 if law == "fosm" else 2e-4}  # fosm chatters
    trace = simulate(Scenario.load("push_wall", base | overrides, law), engine=engine)
    analytic, (force, settled) = trace.analytic, final_force(trace)
    assert isinstance(analytic, SteadyState), analytic
    assert settled
    assert abs(force - analytic.force) <= 1e-4 * max(1.0, analytic.force)
    assert np.abs(trace.p_WB[-1] - analytic.position).max() < 1e-5
    assert np.abs(trace.s[-1] - analytic.s).max() < 1e-5


@pytest.mark.parametrize("law", ["fosm", "impedance"])
def test_cross_damping_is_in_the_balance_at_rest(law, tmp_path):
    """The current from the side and from below turns a vehicle with N_v, N_vv and M_w."""
    vehicle = TwinParameters()
    vehicle.D_linear[5, 1], vehicle.D_linear[4, 2], vehicle.D_quadratic[5, 1] = -0.8, 0.8, -1.5
    (tmp_path / "cross.xml").write_text(vehicle_xml(vehicle))
    overrides = {"vehicle.model": str(tmp_path / "cross.xml"), "reference.attitude_deg": [20.0, 0.0, 0.0]}
    trace = simulate(Scenario.load("push_wall", overrides, law), **FREE)
    without = simulate(Scenario.load("push_wall", overrides | {"vehicle.model": "bluerov1"}, law), **FREE).analytic
    assert np.abs(trace.quat_WB[-1] - trace.analytic.quat).max() < 1e-6
    assert np.abs(trace.s[-1] - trace.analytic.s).max() < 1e-6
    assert np.abs(trace.p_WB[-1] - trace.analytic.position).max() < 1e-6
    assert np.abs(trace.tau[-1] - trace.analytic.tau).max() < 1e-3
    assert np.abs(trace.analytic.tau - without.tau)[4:].min() > 0.1


@pytest.mark.parametrize("law", ["gsta", "sta", "fosm", "impedance", "ideal"])
@pytest.mark.parametrize("K_f", [1.0, 0.5])
def test_generalised_impedance_tracks_a_force_where_the_position_error_is_zero(law, K_f):
    """Eq. (7) at rest is K_x (x - x_d) = K_f (F_c - F_d), so F_c = F_d at x = x_d.

    Laws without an integral term balance the current as well, so they run in still water.
    """
    F_d, k_c = 5.0, 1e5
    overrides = {
        "current.speed": 0.0 if law in ("impedance", "fosm") else 0.4,
        "impedance.F_d": [-F_d, 0.0, 0.0, 0.0, 0.0, 0.0],
        "impedance.K_f": [K_f] + [1.0] * 5,
        "reference.target": [1.0 + F_d / k_c, 0.0, 0.0],
        "simulation.duration": 16.0,
    }
    trace = simulate(Scenario.load("push_wall", overrides, law), **FREE)
    force, settled = final_force(trace)
    assert settled
    assert abs(force - F_d) < 1e-4 * F_d
    assert abs(trace.analytic.force - F_d) < 1e-6 * F_d


def test_without_stiffness_the_force_is_the_desired_one_wherever_the_reference_is():
    overrides = {
        "impedance.K_d": [0.0, 1500.0, 1500.0, 50.0, 50.0, 50.0],
        "impedance.D_d": [88.0, 280.0, 280.0, 10.0, 8.0, 8.0],
        "impedance.F_d": [-3.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        "initial.position": [0.98, 0.0, 0.0],
    }
    trace = simulate(Scenario.load("push_wall", overrides), **FREE)
    assert np.isclose(final_force(trace)[0], 3.0, rtol=1e-4)
    assert np.isclose(trace.analytic.force, 3.0, rtol=1e-6)


@pytest.mark.parametrize("law", ["gsta", "sta", "fosm"])
@pytest.mark.parametrize(
    "overrides", [{}, {"wall.stiffness": 2e4}, {"current.speed": 0.3, "reference.target": [1.05, 0, 0]}]
)
def test_the_integral_sliding_variable_leaves_no_force_error(law, overrides):
    """The integral of eq. (6) rests only if the desired impedance holds.

    Even the first-order law then reaches F = K_x (x_d - x_c)/(1 + K_x/k_c).
    """
    trace = simulate(Scenario.load("push_wall", {**overrides, "task.integral": True}, law), **FREE)
    k_c, target = trace.scenario.wall.stiffness, trace.scenario.reference.target[0]
    expected = 150.0 * (target - 1.0) / (1.0 + 150.0 / k_c)
    assert abs(final_force(trace)[0] - expected) < 1e-4 * expected
    assert np.isclose(trace.analytic.force, expected, rtol=1e-9)
    assert np.abs(trace.s[0]).max() == 0.0


def test_the_integral_sliding_variable_is_the_integral_of_the_impedances_residual():
    """s = M_d^-1 sigma of eq. (6) is summed here from recorded signals, under a law that leaves a residual."""
    D, M = 88.0, 7.31 + 5.5
    overrides = {
        "task.integral": True,
        "simulation.duration": 3.0,
        "impedance.D_d": [D, 280.0, 280.0, 10.0, 8.0, 8.0],
    }
    trace = simulate(Scenario.load("push_wall", overrides, "impedance"), log_rate="full", **FREE)
    rest = D * trace.nu_e[:, 0] + 150.0 * trace.eta_e[:, 0] - trace.f_contact_W[:, 0]
    integral = trace.nu_e[:, 0] + np.concatenate([[0.0], np.cumsum(1e-4 * rest[:-1])]) / M
    assert np.abs(trace.s[:, 0]).max() > 0.1
    assert np.abs(trace.s[:, 0] - integral).max() < 1e-3 * np.abs(trace.s[:, 0]).max()


def test_the_ideal_law_has_the_desired_impedance_at_every_instant():
    """Eq. (13) makes eq. (12) hold under any current, disturbance and estimates.

    The remaining residual comes from sampling and is proportional to the step.
    """
    residuals = {}
    for law, h in (("ideal", 1e-4), ("ideal", 5e-5), ("impedance", 1e-4)):
        overrides = {
            "simulation.timestep": h,
            "simulation.duration": 4.0,
            "disturbance.amplitude": [4.0, 3.0, 2.0, 0.1, 0.1, 0.1],
            "disturbance.frequency_hz": [1.0, 0.7, 0.4, 1.0, 0.5, 0.3],
            "estimates.damping": 0.5,
        }
        trace = simulate(Scenario.load("push_wall", overrides, law), **FREE)
        a = np.gradient(trace.nu_e[:, 0], trace.t)
        D = 2.0 * np.sqrt(150.0 * (7.31 + 5.5))
        # only the attitude couples the axes, and it stays within a degree
        residual = (7.31 + 5.5) * a + D * trace.nu_e[:, 0] + 150.0 * trace.eta_e[:, 0]
        residuals[law, h] = np.sqrt(np.mean(residual[100:] ** 2))
    assert residuals["ideal", 1e-4] < 1e-3 * residuals["impedance", 1e-4]
    assert 1.9 < residuals["ideal", 1e-4] / residuals["ideal", 5e-5] < 2.1


@pytest.mark.parametrize("stiffness", [1e3, 1e5, 1e6])
@pytest.mark.parametrize("target", [1.01, 1.3])
def test_for_gsta_it_is_two_springs_in_a_row(stiffness, target):
    """The closed form is F = K_x (x_d - x_c) / (1 + K_x / k_c)."""
    overrides = {
        "wall.stiffness": stiffness,
        "reference.target": [target, 0.0, 0.0],
        "simulation.duration": 0.01,
        "simulation.timestep": 5e-5,
    }
    analytic = simulate(Scenario.load("push_wall", overrides)).analytic
    assert np.isclose(analytic.force, 150.0 * (target - 1.0) / (1.0 + 150.0 / stiffness), rtol=1e-12)
    assert np.allclose(analytic.s, 0.0)


def test_for_the_first_order_law_it_is_the_scalar_balance():
    """s = phi/(K_s/epsilon - a) and F = (K_x (x_d - x_c) - a M_x s)/(1 + K_x/k_c); M_x phi is the current's force."""
    a, K, M_x = -100.0, 19.0 / 1e-3, 7.31 + 5.5
    u = 0.5 * np.cos(np.deg2rad(120.0))
    phi = (4.03 + 18.18 * abs(u)) * u / M_x
    s = phi / (K - a)
    F = (1.5 - a * M_x * s) / (1.0 + 150.0 / 1e5)
    analytic = simulate(Scenario.load("push_wall", {"simulation.duration": 0.01}, "fosm")).analytic
    assert np.isclose(analytic.s[0], s, rtol=1e-6)
    assert np.isclose(analytic.force, F, rtol=1e-5)  # the scalar balance neglects the small yaw
    assert np.isclose(F, 1.48655, atol=1e-5)


def test_the_impedance_law_rests_short_of_the_papers_wall(paper_run):
    trace = paper_run("impedance")
    assert abs(trace.p_WB[-1, 0] - 0.9967) < 1e-4
    assert trace.touches[-1] == 0
    assert trace.analytic.force == 0.0


def test_without_nominal_control_the_thrust_is_nearly_the_same(paper_run):
    """The paper, sec. 5.2, states virtually identical actuation and a larger integral term."""
    full, alone = paper_run("gsta"), paper_run("gsta", nominal=False)
    assert np.sqrt(np.mean((full.tau[:, 0] - alone.tau[:, 0]) ** 2)) < 0.05
    assert np.abs(alone.z[:, 0]).max() > 2.0 * np.abs(full.z[:, 0]).max()


@pytest.mark.parametrize(
    ("law", "overrides", "reason"),
    [
        ("fosm", {"controller.epsilon": 9e-4}, "chatters"),
        ("fosm", {"estimates.inertia": 1.1}, "chatters"),
        ("fosm", {"disturbance.bias": [300.0, 0, 0, 0, 0, 0]}, "outside its boundary layer"),
        ("fosm", {"disturbance.amplitude": [1.0] * 6, "disturbance.frequency_hz": [0.1] * 6}, "is not constant"),
        ("gsta", {"disturbance.amplitude": [12.0, 0, 0, 0, 0, 0], "disturbance.frequency_hz": [1.0] * 6}, "faster"),
        ("gsta", {"wall.stiffness": 1e6, "controller.period": 1e-3}, "limit-cycles"),
        ("gsta", {"wall.friction": 0.3}, "friction"),
        ("gsta", {"controller.k_2": 0.0}, "k_2"),
    ],
)
@pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")
def test_where_no_closed_form_holds_none_is_given(law, overrides, reason):
    analytic = simulate(Scenario.load("push_wall", {**overrides, "simulation.duration": 0.01}, law), **FREE).analytic
    assert isinstance(analytic, NoClosedForm)
    assert reason in analytic.reason


@pytest.mark.parametrize("name", ["cable", "products", "anything"])
def test_a_table_that_the_balance_does_not_know_has_no_closed_form(name):
    """Whatever its name: a cable is a record of a known effect, and no table."""
    setup = set_up(Scenario.load("push_wall"))
    scenario = dataclasses.make_dataclass("Wider", [(name, float, 0.0)], bases=(Scenario,), frozen=True)
    tables = {field.name: getattr(setup.scenario, field.name) for field in dataclasses.fields(Scenario)}
    known, unknown = (dataclasses.replace(setup, scenario=scenario(**tables, **{name: x})) for x in (0.0, 1.0))
    assert steady_state(known).force == steady_state(setup).force
    assert steady_state(unknown).reason == f"closed forms do not know {name}"
