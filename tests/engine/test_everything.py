"""With every element of a real vehicle switched on, a run is a function of its scenario and seed alone."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from everything import EVERYTHING, everything
from recorded import same
from uvms_mj import McapLog, Simulation, Trace, simulate
from uvms_mj.stages.signals import BAND

DURATION = 0.3
pytestmark = pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")


def run_of(name, seed=1, **options):
    scenario = everything(name, simulation__duration=DURATION, simulation__seed=seed)
    return simulate(scenario, engine="free_body", **options)


@pytest.fixture(scope="module", params=EVERYTHING)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def original(name):
    return run_of(name, log_rate="full")


def test_every_element_acts(name, original):
    """Otherwise the other tests would prove little: contact, dropped and late samples, gusts, limits, lag, schedule."""
    assert (np.abs(original["f_contacts_W"]).max(axis=(0, 2)) > 0.1).sum() == 2  # at the wall and at the cylinder
    for signal in ("v_c_W", "v_c_dot_W", "tau_dist"):
        assert np.ptp(original[signal], axis=0).min() > 0.0, signal
    for late, early in (("u", "u_cmd"), ("tau_cmd_delayed", "tau_cmd"), ("p_WB_m", "p_WB"), ("nu_m", "nu")):
        assert not np.array_equal(original[late], original[early]), signal
    assert np.ptp(original["K_f"], axis=0).max() == 0.5
    assert not np.array_equal(original["f_contact_m_W"], original["f_contact_W"])
    assert np.abs(original["tau_lost"]).max() > 0.0


def test_the_log_rate_changes_nothing(name, original):
    for rate, every in (("1000", 10), ("400", 25)):
        trace = run_of(name, log_rate=rate)
        bands = {edge for band in BAND.values() for edge in band}  # of the steps between rows
        for signal in {*trace} - bands:
            assert np.array_equal(trace[signal], original[signal][::every]), (signal, rate)


def test_the_chunks_of_steps_change_nothing(name, original):
    scenario = everything(name, simulation__duration=DURATION, simulation__seed=1)
    with Simulation(scenario, engine="free_body") as sim:
        for n in (1, 1, 7, 92, 399, 1000, 500, 1, 999):
            sim.step(n)
            for signal in ("p_WB", "quat_WB", "nu", "p_WB_m", "f_contact_m_W", "v_c_W", "u_cmd"):
                assert np.array_equal(sim.signals[signal], original[signal][sim.steps]), (signal, sim.steps)


def test_a_thread_beside_another_seed_changes_nothing(name, original):
    with ThreadPoolExecutor(2) as pool:
        mine, other = pool.map(lambda seed: run_of(name, seed, log_rate="full"), (1, 2))
    same(original, mine)
    for signal in ("v_c_W", "tau_dist", "p_WB_m", "f_contact_m_W", "p_WB", "u"):
        assert not np.array_equal(other[signal], original[signal]), signal


def test_a_reset_with_a_seed_is_a_new_simulation(name):
    scenario = everything(name, simulation__seed=1)
    with Simulation(scenario, engine="free_body") as used:
        used.step(500)
        used.reset(seed=2)
        used.step(1500)
        with Simulation(scenario.updated({"simulation.seed": 2}), engine="free_body") as new:
            new.step(1500)
            assert list(used.signals) == list(new.signals)
            for signal in new.signals:
                assert np.array_equal(used.signals[signal], new.signals[signal]), signal


def test_a_log_is_read_back_and_repeats(name, original, tmp_path):
    log = tmp_path / "run.mcap"
    logged = run_of(name, log_rate="full", sinks=[McapLog(log)])
    same(original, logged)
    read = Trace.load(log)
    same(original, read)
    same(original, simulate(read.scenario, log_rate="full", engine="free_body"))


def test_both_engines_agree(name):
    """Their equations differ in the order of rounding only."""
    scenario = everything(name, simulation__duration=1.0)
    ours, theirs = (simulate(scenario, engine=engine) for engine in ("free_body", "mujoco"))
    assert np.linalg.norm(ours.f_contact_W[-500:], axis=1).max() > 1.0
    assert np.abs(ours.p_WB - theirs.p_WB).max() < 1e-6
    assert np.abs(ours.quat_WB - theirs.quat_WB).max() < 1e-6
