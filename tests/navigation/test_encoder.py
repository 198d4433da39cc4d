"""The encoders of the joints against closed forms."""

from types import SimpleNamespace

import numpy as np
import pytest

from uvms_mj.navigation.encoder import MOST_LATE, JointEncoder
from uvms_mj.stages.signals import encoder_given, encoder_signals, record_dtype

STEP = 1e-3
N = 2


def setup_of(step=STEP):
    arm = SimpleNamespace(links=(None,) * N, joints=("shoulder", "elbow"))
    simulation = SimpleNamespace(timestep=step)
    return SimpleNamespace(vehicle=SimpleNamespace(arm=arm), scenario=SimpleNamespace(simulation=simulation))


def readings(q, q_dot, key=7, **settings):
    """What an encoder of two joints reads (m, 2), positions and velocities, of true ones (m, 2)."""
    constants = JointEncoder(**settings).record(setup_of()).view(np.recarray)[0]
    state, state_dot = (JointEncoder.state_record(N).view(np.recarray)[0] for _ in range(2))
    given = np.zeros(1, record_dtype(encoder_given(N))).view(np.recarray)[0]
    out = np.zeros(1, record_dtype(encoder_signals(N))).view(np.recarray)[0]
    given.key, given.period, found = key, STEP, []
    for k in range(len(q)):
        given.instant, given.q[:], given.q_dot[:] = k, q[k], q_dot[k]
        JointEncoder.step(constants, state, given, state_dot, out)
        found.append((out.q_m.copy(), out.q_dot_m.copy()))
    positions, velocities = zip(*found, strict=True)
    return np.array(positions), np.array(velocities)


def sweep(m=400):
    t = STEP * np.arange(m)[:, None]
    return np.hstack([np.sin(t), 0.3 - 2.0 * t]), np.hstack([np.cos(t), -2.0 + 0.0 * t])


def test_an_encoder_without_errors_reads_the_truth_and_its_differences():
    q, q_dot = sweep()
    q_m, q_dot_m = readings(q, q_dot)
    assert np.array_equal(q_m, q)
    assert q_dot_m[0].tolist() == [0.0, 0.0]
    assert np.array_equal(q_dot_m[1:], np.diff(q, axis=0) / STEP)
    assert np.array_equal(readings(q, q_dot, velocity="measured")[1], q_dot)


def test_a_reading_is_within_half_a_quantum_and_a_multiple_of_it():
    """Each joint has its own."""
    q, q_dot = sweep()
    quantum = np.array([1e-3, 0.05])
    q_m, _ = readings(q, q_dot, resolution=tuple(quantum))
    assert (np.abs(q_m - q) <= 0.5 * quantum + 1e-15).all()
    assert np.abs(q_m / quantum - np.round(q_m / quantum)).max() < 1e-12
    assert np.abs(q_m - q).max(axis=0) == pytest.approx(0.5 * quantum, rel=0.1)


def test_a_reading_arrives_after_its_delay_and_the_first_at_once():
    q, q_dot = sweep(3 * MOST_LATE)
    for late in (0, 1, 20, MOST_LATE):
        q_m, q_dot_m = readings(q, q_dot, delay=late * STEP, velocity="measured")
        arrived = np.maximum(np.arange(len(q)) - late, 0)
        assert np.array_equal(q_m, q[arrived])
        assert np.array_equal(q_dot_m, q_dot[arrived])


def test_noise_has_its_deviation_and_differs_between_joints_and_between_position_and_velocity():
    still = np.zeros((4000, N))
    own = {"noise": 2e-3, "velocity_noise": 0.1, "velocity": "measured"}
    q_m, q_dot_m = readings(still, still, **own)
    drawn = np.hstack([q_m, q_dot_m])
    assert drawn.std(axis=0) == pytest.approx([2e-3, 2e-3, 0.1, 0.1], rel=0.05)
    assert np.abs(np.corrcoef(drawn.T) - np.eye(4)).max() < 0.06
    assert not np.array_equal(q_m, readings(still, still, key=8, **own)[0])


def test_a_bias_moves_the_position_and_not_the_velocity():
    q, q_dot = sweep()
    q_m, q_dot_m = readings(q, q_dot, bias=(0.1, -0.2))
    assert np.abs(q_m - q - [0.1, -0.2]).max() < 1e-15
    assert np.abs(q_dot_m[1:] - np.diff(q, axis=0) / STEP).max() < 1e-11


def test_the_filtered_velocity_follows_a_ramp_with_the_first_order_lag():
    """Of a constant acceleration it is late by the filter's time constant and half a period."""
    t = STEP * np.arange(2000)
    q = np.stack([0.5 * 3.0 * t**2] * N, axis=1)
    _, q_dot_m = readings(q, 0.0 * q, velocity_filter=0.05)
    assert q_dot_m[-1] == pytest.approx(3.0 * (t[-1] - 0.05 - 0.5 * STEP), rel=1e-9)


@pytest.mark.parametrize(
    ("settings", "key", "message"),
    [
        (
            {"bias": (0.1, 0.2, 0.3)},
            "encoder.bias",
            "has 3 values; give one for all, or 2 for the joints shoulder, elbow",
        ),
        ({"delay": 1.5e-3}, "encoder.delay", "0.0015 s is not a multiple of the encoder's period 0.001 s"),
        ({"delay": 1.0}, "encoder.delay", "at most 500 of them"),
        ({"velocity_noise": 0.1}, "encoder.velocity_noise", "set encoder.velocity = measured"),
    ],
)
def test_a_wrong_setting_is_one_message(settings, key, message):
    (fault,) = JointEncoder(**settings).faults(setup_of())
    assert fault.key == key
    assert message in fault.message
