"""Random numbers from a counter: their words, moments and independence, and machine code against plain Python."""

import numpy as np
import pytest

from plain_noise import with_own_functions
from uvms_mj import Gsta
from uvms_mj.engine.native.compilation import native_function
from uvms_mj.guidance import FilteredSteps
from uvms_mj.physics.random import random_bits, standard_normal
from uvms_mj.stages.base import random_key

KEY = 0x299F31D0_03707344  # below 2^63


@pytest.fixture(autouse=True)
def own_functions(monkeypatch):
    with_own_functions(monkeypatch)


def philox(counter, key):
    """Philox-4x32-10 as its paper writes it, with Python's unbounded integers."""
    c, k = list(counter), list(key)
    for _ in range(10):
        p_0, p_1 = 0xD2511F53 * c[0], 0xCD9E8D57 * c[2]
        c = [(p_1 >> 32) ^ c[1] ^ k[0], p_1 % 2**32, (p_0 >> 32) ^ c[3] ^ k[1], p_0 % 2**32]
        k = [(k[0] + 0x9E3779B9) % 2**32, (k[1] + 0xBB67AE85) % 2**32]
    return c


def test_the_words_are_those_of_the_published_generator():
    """The authors' known answer for a counter and a key of zeros, and the definition with unbounded integers."""
    assert philox([0] * 4, [0] * 2) == [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]
    rng = np.random.default_rng(1)
    for _ in range(200):
        key, instant, index, block = (int(rng.integers(0, top)) for top in (2**63, 2**63, 2**32, 2))
        words = philox([instant % 2**32, instant >> 32, index, block], [key % 2**32, key >> 32])
        assert random_bits(key, instant, index, block) == (words[0] << 21) + (words[1] >> 11)


def test_plain_python_and_machine_code_agree_to_the_last_bit():
    """np.int64 is the type of key and instant in a record: no product may overflow."""
    compiled = compiled_normal()
    rng = np.random.default_rng(2)
    with np.errstate(over="raise"):
        for _ in range(2000):
            key, instant, index = rng.integers(0, 2**63), rng.integers(0, 2**63), int(rng.integers(0, 2**32))
            plain = standard_normal(key, instant, index)
            assert plain == standard_normal(int(key), int(instant), index) == compiled(key, instant, index)
            assert np.isfinite(plain)


def compiled_normal():
    """The kernel as machine code, with its helpers."""
    code = native_function(_normal, ["i8", "i8", "i8", ("f8", (1,))]).ctypes
    out = np.zeros(1)

    def normal(key, instant, index):
        code(int(key), int(instant), index, out.ctypes.data)
        return out[0]

    return normal


def _normal(key, instant, index, out):
    out[0] = standard_normal(key, instant, index)


@pytest.fixture(scope="module")
def sample():
    """(2000, 50) numbers: instants and indices."""
    normal = compiled_normal()
    return np.array([[normal(KEY, instant, index) for index in range(50)] for instant in range(2000)])


def test_the_moments_are_those_of_the_standard_normal_distribution(sample):
    """Each moment within five standard errors: var(x^k) = E x^2k - (E x^k)^2."""
    x, n = sample.ravel(), sample.size
    for k, mean, square in ((1, 0.0, 1.0), (2, 1.0, 3.0), (3, 0.0, 15.0), (4, 3.0, 105.0)):
        assert abs((x**k).mean() - mean) < 5.0 * np.sqrt((square - mean**2) / n), k
    assert abs((x > 1.959963985).mean() - 0.025) < 5.0 * np.sqrt(0.025 * 0.975 / n)


def test_instants_indices_keys_and_seeds_are_uncorrelated(sample):
    other = np.array([[standard_normal(KEY + 1, i, j) for j in range(50)] for i in range(200)])
    pairs = {
        "instants": (sample[1:], sample[:-1]),
        "indices": (sample[:, 1:], sample[:, :-1]),
        "keys": (sample[:200], other),
    }
    for name, (a, b) in pairs.items():
        assert abs((a * b).mean()) < 5.0 / np.sqrt(a.size), name
    keys = {random_key(seed, stage) for seed in range(100) for stage in (Gsta(), FilteredSteps())}
    assert len(keys) == 200
    assert all(0 <= key < 2**63 for key in keys)


def test_the_order_of_the_draws_does_not_matter(sample):
    """A number depends on its key, instant and index only."""
    rng = np.random.default_rng(3)
    for i, j in zip(rng.integers(0, 2000, 50).tolist(), rng.integers(0, 50, 50).tolist(), strict=True):
        assert standard_normal(KEY, i, j) == sample[i, j]
