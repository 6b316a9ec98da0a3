"""A traffic set simulated on a bus with nothing else."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.can_bus.network.routing import RoutedNetwork
from canroll.plant_sim.can_bus.simulation.response_times import simulate_network
from canroll.plant_sim.can_bus.traffic.messages import BusMessage


def simulated_responses(
    messages: Sequence[BusMessage], *, bitrate: int, data_bitrate: int = 0, **options: Any
) -> dict[str, NDArray[np.int64]]:
    """Return the response times of each message by name, ns, when every frame is accounted for."""
    network = RoutedNetwork.one_bus(messages, bitrate=bitrate, data_bitrate=data_bitrate)
    simulation = simulate_network(network, **options)
    assert simulation.balanced == [True]
    return {
        message.name: times[0].here
        for message, times in zip(messages, simulation.arrivals, strict=True)
    }
