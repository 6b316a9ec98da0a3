"""Counter-based random numbers: the same seed, stream and counter always give the same number.

The mixing function is the finaliser of SplitMix64 (Steele, Lea, Flood 2014).
"""

from enum import IntEnum
from typing import Final

import numpy as np

from canroll.plant_sim.kernels.jit import njit

_GAMMA: Final = np.uint64(0x9E3779B97F4A7C15)
_STREAM: Final = np.uint64(0xD1B54A32D192ED03)
_FIRST: Final = np.uint64(0xBF58476D1CE4E5B9)
_SECOND: Final = np.uint64(0x94D049BB133111EB)
_S30: Final = np.uint64(30)
_S27: Final = np.uint64(27)
_S31: Final = np.uint64(31)
_S11: Final = np.uint64(11)


class Stream(IntEnum):
    """First stream of each purpose, to which the number of a node, message or kind is added.

    The ages of a network's messages are drawn in a simulation without a vehicle, whose frames
    have no faults: the two have one stream.
    """

    BIT_ERROR = 1 << 40
    SOURCE_JITTER = 1 << 41
    SOURCE_PAYLOAD = 1 << 42
    GATEWAY_LATENCY = 1 << 43
    FRAME_FAULT = 1 << 44
    AGE_JITTER = 1 << 44
    AGE_PAYLOAD = 1 << 45
    LOG_PHASE = 1 << 46
    QUEUE_JITTER = 1 << 47


@njit
def random_bits(seed: int, stream: int, counter: int) -> np.uint64:
    """Return 64 random bits, a pure function of its arguments."""
    z = np.uint64(seed) * _STREAM + np.uint64(stream)
    z = (z ^ (z >> _S30)) * _FIRST
    z = (z ^ (z >> _S27)) * _SECOND
    z = (z ^ (z >> _S31)) + np.uint64(counter) * _GAMMA
    z = (z ^ (z >> _S30)) * _FIRST
    z = (z ^ (z >> _S27)) * _SECOND
    return z ^ (z >> _S31)


@njit
def uniform(seed: int, stream: int, counter: int) -> float:
    """Return a random number in [0, 1) with 53 bits."""
    return np.float64(random_bits(seed, stream, counter) >> _S11) * 2.0**-53
