r"""Random numbers from a counter: key and counter alone decide them, whatever is drawn before, after or beside them.

A block of ten rounds of multiplication and exchange (Philox-4x32-10; Salmon, Moraes, Dror and Shaw, "Parallel random
numbers: as easy as 1, 2, 3", SC11, 2011) turns a key of 64 bits and a counter of 128 bits into 128 random bits. A
product of two words of 32 bits wraps around in machine code and does not in plain Python. Its lower 64 bits are the
same, and only they are used.
"""

import hashlib
import math

from .kernels import kernel

_LOW = 0xFFFFFFFF
_M_0, _M_1 = 0xD2511F53, 0xCD9E8D57  # multipliers of a round
_W_0, _W_1 = 0x9E3779B9, 0xBB67AE85  # increments of the key
_UNIT = 2.0**-53


@kernel
def random_bits(key, instant, index, block) -> int:
    """53 random bits, an integer in [0, 2^53), from a key in [0, 2^63) and a counter: instant in [0, 2^63), index and
    block in [0, 2^32)."""
    c_0, c_1, c_2, c_3 = int(instant & _LOW), int(instant >> 32), int(index), int(block)
    k_0, k_1 = int(key & _LOW), int(key >> 32)
    for _ in range(10):
        product_0, product_1 = c_0 * _M_0, c_2 * _M_1
        c_0, c_1 = ((product_1 >> 32) & _LOW) ^ c_1 ^ k_0, product_1 & _LOW
        c_2, c_3 = ((product_0 >> 32) & _LOW) ^ c_3 ^ k_1, product_0 & _LOW
        k_0, k_1 = (k_0 + _W_0) & _LOW, (k_1 + _W_1) & _LOW
    return (c_0 << 21) + (c_1 >> 11)


@kernel
def standard_normal(key, instant, index) -> float:
    """A random number with the standard normal distribution, by Box and Muller's method.

    Args:
        key: key of the stage's random numbers, ``given.key``; an integer in [0, 2^63).
        instant: number of the stage's instant, ``given.instant``; an integer in [0, 2^63).
        index: number of the random number in this instant: 0, 1, 2, ...
    """
    x = (random_bits(key, instant, index, 0) + 1) * _UNIT  # in (0, 1]: its logarithm is finite
    y = random_bits(key, instant, index, 1) * _UNIT
    return math.sqrt(-2.0 * math.log(x)) * math.cos(2.0 * math.pi * y)


def owned(name: str, vehicle: str) -> str:
    """The name of what a vehicle among others has for itself: its random numbers are no other vehicle's."""
    return f"{vehicle} {name}".lstrip()


def key_of(seed: int, name: str) -> int:
    """The key of the random numbers of a named thing, an integer in [0, 2^62), from the seed of a run."""
    return int.from_bytes(hashlib.sha256(f"{seed} {name}".encode()).digest()[:8]) >> 2
