"""The posture at rest against the kernel of the loop."""

from types import SimpleNamespace

import numpy as np
import pytest

from uvms_mj.control.theory.free_motion import PostureAtRest
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.physics.operational import posture
from uvms_mj.physics.tree import MOST_JOINTS

N, JOINTS = 11, 5


@pytest.mark.parametrize("seed", range(12))
def test_it_demands_what_the_kernel_demands(seed):
    rng = np.random.default_rng(seed)
    root, J = rng.normal(size=(N, N)), rng.normal(size=(6, N))
    M = root @ root.T + np.eye(N)
    M_inv = np.linalg.inv(M)
    P = M_inv - M_inv @ J.T @ np.linalg.solve(J @ M_inv @ J.T, J @ M_inv)
    levels = rng.permutation(3)[: rng.integers(1, 4)].tolist()
    quat, quat_d = (each / np.linalg.norm(each) for each in rng.normal(size=(2, 4)))
    settings = {
        "levels": np.array([*levels, *[-1] * (3 - len(levels))], float),
        "frequency": rng.uniform(0.5, 3.0, 3),
        "damping": np.ones(3),
        "yaw": bool(seed % 2),
        "quat_d": quat_d,
        "up_d": rotation_matrix(quat_d)[2],
        "p_d": rng.normal(size=3),
        "joints": np.concatenate([rng.normal(size=JOINTS), np.zeros(MOST_JOINTS - JOINTS)]),
        "free_damping": 0.7,
    }
    p_WB, R_WB, q, a = rng.normal(size=3), rotation_matrix(quat), rng.normal(size=JOINTS), np.zeros(N)
    known = SimpleNamespace(p_WB=p_WB, quat_WB=quat, R_WB=R_WB)
    posture(SimpleNamespace(**settings), known, np.zeros(N), q, M, M_inv, P.copy(), a)
    at_rest = PostureAtRest.__new__(PostureAtRest)
    at_rest.settings, at_rest.n = settings, JOINTS
    demanded = at_rest(p_WB, R_WB, q, M_inv, P)
    assert np.abs(demanded).max() > 0.1
    np.testing.assert_allclose(demanded, a, atol=1e-9 * np.abs(demanded).max())
