"""The arrays of a bus network, and the constants of their entries."""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.can_bus.kernel import log as records
from canroll.plant_sim.can_bus.kernel.log import log_dtype
from canroll.plant_sim.kernels.jit import njit

Records = NDArray[Any]

State = Any
"""The record of a network's state passed between kernels: ``network.state[0]``.

Unlike arrays it is not reference-counted, which would cost more than the simulation itself.
"""

DELIVERED: Final = 0
SUPERSEDED: Final = 1
ERROR: Final = 2
LOST_OVERFLOW: Final = 3
LOST_BUS_OFF: Final = 4
LOST_NODE_DOWN: Final = 5
LOST_PARTITION: Final = 6
LOST_ONE_SHOT: Final = 7
REFUSED: Final = 8
OUTCOMES: Final = (
    "delivered",
    "superseded",
    "error",
    "lost: queue full",
    "lost: bus-off",
    "lost: node down",
    "lost: partition",
    "lost: single shot",
    "refused",
)
"""Names of the outcomes. ``ERROR`` and ``REFUSED`` end an attempt, every other one ends a frame."""

PRIORITY: Final = 0
FIFO: Final = 1
REPLACE: Final = 2

ERROR_ACTIVE: Final = 0
ERROR_PASSIVE: Final = 1
BUS_OFF: Final = 2

# what disturbs an attempt
NO_ERROR: Final = 0
BIT_ERROR: Final = 1
COLLISION: Final = 2
ACKNOWLEDGE_ERROR: Final = 3
REFUSAL: Final = 4
ARBITRATION_LOST: Final = 5
"""A recessive bit of the arbitration field seen dominant, where no other node drives on."""
STUFF_ERROR: Final = 6
"""A recessive stuff bit of the arbitration field seen dominant."""

# kinds of faults
NODE_DOWN: Final = 0
NODE_DELAY: Final = 1
GATEWAY_DOWN: Final = 2
DISTURB: Final = 3
OVERLOAD: Final = 4
REFUSE: Final = 5
NODE_MUTE: Final = 6
BIT_ERRORS: Final = 7

# slots of Network.clock
NOW: Final = 0
SEQUENCE: Final = 1
LOGGED: Final = 2
FREE_FRAME: Final = 3
RELEASES: Final = 4
MESSAGES: Final = 5
DRAWS: Final = 6
SEED: Final = 7
SEGMENT_COUNT: Final = 8
NODE_COUNT: Final = 9
SOURCE_COUNT: Final = 10
GATEWAY_COUNT: Final = 11
FAULT_COUNT: Final = 12
LOG_PLACE: Final = 13
LOG_SIZE: Final = 14
SLOT: Final = 15
WAITING: Final = 16
DISTANT: Final = 17
SAMPLES: Final = 18


# room in every network; one layout for all, so that the kernels are compiled once
MAX_SEGMENTS: Final = 8
MAX_NODES: Final = 128
MAX_MESSAGES: Final = 8192
MAX_FRAMES: Final = 4096
MAX_SOURCES: Final = 1024
MAX_GATEWAYS: Final = 16
MAX_ROUTES: Final = 256
MAX_FAULTS: Final = 64
MAX_PAYLOAD: Final = 64
MAX_SAMPLES: Final = 1 << 14
"""Measured times of all gateways and nodes together."""
MAX_LOG: Final = 1 << 15
RING_SLOTS: Final = 1 << 12
"""Slots of time in the calendar of releases, a power of two."""

OFFERED: Final = len(OUTCOMES)
"""Column of ``Network.totals`` after the outcomes: number of queued frames."""

_QUEUES: Final = MAX_NODES + MAX_MESSAGES
_CALENDAR: Final = MAX_FRAMES + MAX_SOURCES
_STATE: Final = np.dtype(
    [
        ("clock", "i8", (24,)),
        ("totals", "i8", (MAX_SEGMENTS, OFFERED + 1)),
        ("segments", records.SEGMENT, (MAX_SEGMENTS,)),
        ("nodes", records.NODE, (MAX_NODES,)),
        ("messages", records.MESSAGE, (MAX_MESSAGES,)),
        ("message_table", "i8", (2 * MAX_MESSAGES,)),
        ("queues", records.QUEUE, (_QUEUES,)),
        ("frames", records.FRAME, (MAX_FRAMES,)),
        ("payloads", "u1", (MAX_FRAMES, MAX_PAYLOAD)),
        ("release_times", "i8", (_CALENDAR,)),
        ("release_ties", "i8", (_CALENDAR,)),
        ("releases", "i8", (_CALENDAR,)),
        ("ring", records.RELEASE, (_CALENDAR,)),
        ("ring_heads", "i8", (RING_SLOTS,)),
        ("ring_filled", "i8", (RING_SLOTS // 32,)),
        ("distant_times", "i8", (_CALENDAR,)),
        ("distant_ties", "i8", (_CALENDAR,)),
        ("distant", "i8", (_CALENDAR,)),
        ("pending_keys", "i8", (MAX_SEGMENTS, _QUEUES)),
        ("pending_ties", "i8", (MAX_SEGMENTS, _QUEUES)),
        ("pending", "i8", (MAX_SEGMENTS, _QUEUES)),
        ("sources", records.SOURCE, (MAX_SOURCES,)),
        ("source_payloads", "u1", (MAX_SOURCES, MAX_PAYLOAD)),
        ("gateways", records.GATEWAY, (MAX_GATEWAYS,)),
        ("routes", "i8", (MAX_GATEWAYS, MAX_ROUTES)),
        ("faults", records.FAULT, (MAX_FAULTS,)),
        ("samples", "i8", (MAX_SAMPLES,)),
        ("aside", "i8", (_QUEUES,)),
        ("scratch", "u1", (2, 1024)),
        ("log", log_dtype(), (MAX_LOG,)),
    ]
)


class Network(NamedTuple):
    """One or more bus segments and everything on them; kernels modify it in place.

    ``state`` holds one record with all parts, which are also available as properties.
    ``log`` is a view of the ring in it (see ``log_dtype``): entry number k sits at
    ``log[k % len(log)]``, and ``logged(network)`` counts the entries ever written. In a kernel:
    ``network.state[0]``.
    """

    state: Records
    log: Records

    @property
    def clock(self) -> NDArray[np.int64]:
        """Counters: ``NOW``, ``LOGGED`` and so on."""
        return self.part("clock")

    @property
    def totals(self) -> NDArray[np.int64]:
        """Frames by segment and outcome; the last column counts all that were queued."""
        return self.part("totals")

    @property
    def segments(self) -> Records:
        """Records of the segments."""
        return self.part("segments")[: self.clock[SEGMENT_COUNT]]

    @property
    def nodes(self) -> Records:
        """Records of the nodes: error counters, state and so on."""
        return self.part("nodes")[: self.clock[NODE_COUNT]]

    @property
    def messages(self) -> Records:
        """Records of the messages seen so far, one for each identifier and sender."""
        return self.part("messages")[: self.clock[MESSAGES]]

    def part(self, name: str) -> Records:
        """Return one part of the state at full capacity."""
        part: Records = self.state[name][0]
        return part


@njit
def logged(network: Network) -> int:
    """Return the number of entries ever written to the log."""
    count: int = network.state[0].clock[LOGGED]
    return count


def empty(*, log: int, seed: int) -> Network:
    """Return an empty network at time 0 with room for ``log`` log entries."""
    state = np.zeros(1, _STATE)
    network = Network(state, state["log"][0][:log])
    network.clock[LOG_SIZE] = log
    queues = network.part("queues")
    queues["head"] = queues["tail"] = -1
    network.part("frames")["next"] = np.append(np.arange(1, MAX_FRAMES), -1)
    network.part("message_table")[:] = -1
    network.part("ring_heads")[:] = -1
    segments = network.part("segments")
    segments["in_flight"] = segments["twin"] = segments["missed"] = -1
    network.clock[SEED] = seed
    return network
