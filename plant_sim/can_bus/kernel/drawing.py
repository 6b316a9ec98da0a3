"""Times that are drawn anew for every frame: latencies of gateways, jitter of nodes."""

from typing import Any

import numpy as np

from plant_sim.can_bus.kernel.layout import EXPONENTIAL, FIXED, SAMPLED, SEED, UNIFORM, State
from plant_sim.kernels.jit import njit
from plant_sim.kernels.random import uniform

Drawn = Any
"""Record of a gateway or a node, with the fields of a distribution."""


@njit
def draw(bus: State, of: Drawn, stream: int) -> int:
    """Return the next time (ns) of the distribution in a record; ``stream`` is its own."""
    time = of.low_ns
    if of.distribution == FIXED:
        return int(time)
    share = uniform(bus.clock[SEED], stream, of.drawn)
    of.drawn += 1
    spread = of.high_ns - of.low_ns
    if of.distribution == UNIFORM:
        time += np.int64(share * (spread + 1))
    elif of.distribution == EXPONENTIAL:
        # truncated at high_ns by inversion of the distribution function
        kept = -np.expm1(-spread / of.mean_ns)
        time += np.int64(-of.mean_ns * np.log1p(-share * kept))
    elif of.distribution == SAMPLED:
        time = bus.samples[of.first_sample + np.int64(share * of.samples)]
    return int(time)
