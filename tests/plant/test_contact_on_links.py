"""Contact bodies on the links of an arm."""

from dataclasses import dataclass

import numpy as np
import pytest

from tool_arm import arm_file
from uvms_mj import Controller, InputError, Scenario, Trace, simulate
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.physics.statics import Statics
from uvms_mj.setup.base import set_up

BODIES = [
    {"position": [0.045, 0.0, 0.0], "radius": 0.02, "body": "hand"},
    {"position": [0.0, 0.0, 0.0], "end": [0.1, 0.0, 0.0], "radius": 0.03, "body": "forearm"},
    {"position": [0.2, 0.1, 0.0], "radius": 0.03},
]
TILTED = {"shape": "plane", "position": [0.55, 0.0, 0.0], "attitude_deg": [0.0, 25.0, 10.0], "stiffness": 2e3}
POST = {"shape": "cylinder", "position": [0.75, 0.35, 0.0], "radius": 0.25, "stiffness": 3e3}


@dataclass(frozen=True)
class Coast(Controller):
    """A law without thrust."""

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = 0.0


@pytest.fixture(scope="module")
def loose(tmp_path_factory) -> str:
    return str(arm_file(tmp_path_factory.mktemp("vehicle"), loose=True))


def thrown(model: str, timestep: float, **overrides) -> Trace:
    """A vehicle that flies into a post with its arm ahead and its thrusters off."""
    base = {
        "vehicle.model": model,
        "vehicle.contact_bodies": BODIES,
        "current.speed": 0.0,
        "wall.present": False,
        "walls": [POST],
        "initial.position": [-0.35, 0.05, 0.0],
        "initial.attitude_deg": [10.0, -5.0, 15.0],
        "initial.velocity": [0.8, 0.0, 0.1, 0.2, 0.1, -0.1],
        "initial.joints": [0.1, -0.5, 0.8, 0.2, 0.1],
        "simulation.timestep": timestep,
        "simulation.duration": 1.2,
    }
    return simulate(Scenario.load("push_wall", base | overrides), Coast(), log_rate="full")


def energy(trace: Trace, k: int) -> float:
    """Kinetic and potential energy of a row, that of the water's acceleration included [J]."""
    setup = set_up(trace.scenario)
    statics, R_WB = Statics(setup.vehicle, trace.q[k]), rotation_matrix(trace.quat_WB[k])
    zeta = np.concatenate([trace.nu[k], trace.q_dot[k]])
    total = 0.5 * zeta @ statics.inertia() @ zeta
    for body, R, p in zip(statics.bodies, statics.R, statics.p, strict=True):
        heavy = body.mass * (p + R @ body.r_g) - body.displaced_mass * (p + R @ body.r_b)
        lifted = (body.mass - body.displaced_mass) * trace.p_WB[k] + R_WB @ heavy
        total -= setup.gravity_W @ lifted
    return float(total)


@pytest.mark.slow
def test_walls_store_and_return_the_energy_of_all_links(loose):
    """Energy plus the work on the walls stays the same, but for the error of first order of the time step."""
    errors = []
    for timestep in (2e-4, 1e-4):
        trace = thrown(loose, timestep)
        rows = np.linspace(0, len(trace) - 1, 25).astype(int)
        total = np.array([energy(trace, k) for k in rows]) + trace.wall_work[rows]
        errors.append(np.abs(total - total[0]).max())
        touched = (np.abs(trace.f_contacts_W).max(axis=(0, 2)) > 1.0).sum()
        assert touched >= 3
        assert trace.wall_work.max() > 0.5
    assert errors[1] < 5e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.15)


def test_friction_on_a_link_is_that_of_coulomb(loose):
    """A contact that slips has F_t = mu F_n, and no contact has more."""
    trace = thrown(loose, 1e-4, walls=[TILTED | {"friction": 0.2}])
    normal_W = set_up(trace.scenario).contacts.walls[0][1].R_WS @ [-1.0, 0.0, 0.0]
    f_n = trace.f_contacts_W @ normal_W
    f_t = np.linalg.norm(trace.f_contacts_W - f_n[..., None] * normal_W, axis=2)
    pressed = f_n > 1e-3
    assert pressed.any()
    assert (f_t[pressed] <= 0.2 * f_n[pressed] * (1.0 + 1e-9)).all()
    assert np.max(f_t[pressed] / f_n[pressed]) == pytest.approx(0.2, rel=1e-9)
    np.testing.assert_allclose(trace.f_contacts_W.sum(axis=1), trace.f_contact_W, atol=1e-12)


def test_a_link_that_does_not_exist_is_named(loose):
    wrong = {"vehicle.model": loose, "vehicle.contact_bodies": [BODIES[0] | {"body": "hands"}]}
    with pytest.raises(InputError, match=r"vehicle\.contact_bodies\[0\]\.body: no link 'hands'; did you mean 'hand'\?"):
        simulate(Scenario.load("push_wall", wrong), Coast())
