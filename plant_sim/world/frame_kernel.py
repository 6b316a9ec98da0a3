"""What happens to our frames between sender and receiver: faults of the bus, and attackers.

A sender's frame may be handed over late, twice or out of order; a receiver's may be lost or
damaged. An attacker waits for a genuine frame and answers it with a forged one, with the right
checksum and the next counters, so that the next genuine frame looks repeated. It has no key: the
MAC is that of the genuine frame.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim import can_bus as bus
from canroll.plant_sim.kernels import schedule
from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.kernels.random import Stream, uniform
from canroll.plant_sim.kernels.records import fields
from canroll.plant_sim.nodes import authentication, codec, e2e
from canroll.plant_sim.nodes.authentication import NodeAuthentication
from canroll.plant_sim.nodes.codec import Codec

FRAME_FAULTS = (
    *("loss", "corruption", "delay", "duplicate", "reorder", "spoof", "replay", "wrong_length"),
)
LOSS, CORRUPTION, DELAY, DUPLICATE, REORDER, SPOOF, REPLAY, WRONG_LENGTH = range(8)
FAULTS = 16
EVERY_MESSAGE = (1 << 62) - 1
"""Places of a fault of all our messages; else the bit of its row of the codec's ``message``."""
LATER_NS = 1_000_000
"""Delay of a duplicate behind the original."""
CYCLES_LATE = 1.5
SHORTEST_CYCLE_NS = 10_000_000
"""Delay of a reordered frame, in its cycle times: the next one overtakes it."""
FRAME_STATE = np.dtype(
    [
        ("fault", schedule.FAULT, (FAULTS,)),
        *fields("i8", "signal", FAULTS, 2),
        *fields("i8", "drawn attacker_at_ecu attacker_at_actuator"),
    ]
)
"""Faults of frames, random numbers drawn, and the attackers' nodes, -1: none.

``signal``: rows of a spoofed signal and of the sample counter, -1: none.
"""


@njit
def _happens(frames: Any, kind: int, row: int, t_ns: int, seed: int) -> bool:  # noqa: ANN401
    share = schedule.most(frames.fault, kind, 1 << row, t_ns)
    if share <= 0.0:
        return False
    frames.drawn += 1
    return bool(uniform(seed, Stream.FRAME_FAULT + kind, frames.drawn) < share)


@njit
def send(  # noqa: PLR0917
    frames: Any,  # noqa: ANN401
    tables: Codec,
    network: bus.State,
    node: int,
    row: int,
    t_ns: int,
    ident: int,
    length: int,
    payload: NDArray[np.uint8],
    flags: int,
    seed: int,
) -> None:
    """Queue a frame of message ``row`` (-1: not ours) of ``t_ns`` as its faults have it."""
    late = 0
    if row >= 0 and frames.fault[0].places:
        late = int(1e9 * schedule.most(frames.fault, DELAY, 1 << row, t_ns))
        if _happens(frames, REORDER, row, t_ns, seed):
            cycle = max(int(tables.message[row].cycle_ns), SHORTEST_CYCLE_NS)
            late += int(CYCLES_LATE * cycle)
        if _happens(frames, DUPLICATE, row, t_ns, seed):
            again = late + LATER_NS
            bus.submit(network, node, t_ns + again, ident, length, payload, flags, 0, again)
    bus.submit(network, node, t_ns + late, ident, length, payload, flags, 0, late)


@njit
def lost(frames: Any, row: int, t_ns: int, seed: int) -> bool:  # noqa: ANN401
    """Whether the receiver of a frame received at ``t_ns`` loses it."""
    return bool(frames.fault[0].places) and _happens(frames, LOSS, row, t_ns, seed)


@njit
def damage(  # noqa: PLR0917
    frames: Any,  # noqa: ANN401
    row: int,
    t_ns: int,
    length: int,
    payload: NDArray[np.uint8],
    seed: int,
) -> None:
    """Invert one bit of a received payload where a fault does so."""
    if frames.fault[0].places and length > 0 and _happens(frames, CORRUPTION, row, t_ns, seed):
        draw = uniform(seed, Stream.FRAME_FAULT + FAULTS, frames.drawn)
        bit = int(draw * 8 * length)
        payload[bit // 8] = int(payload[bit // 8]) ^ (1 << (bit % 8))


@njit
def attack(  # noqa: PLR0917
    frames: Any,  # noqa: ANN401
    auth: NodeAuthentication,
    tables: Codec,
    network: bus.State,
    attacker: int,
    row: int,
    entry: Any,  # noqa: ANN401
    payload: NDArray[np.uint8],
) -> None:
    """Answer a genuine frame of message ``row`` at once; ``payload`` is room for the answer."""
    message = tables.message[row]
    for number in range(FAULTS):
        fault = frames.fault[number]
        if fault.places == 0:
            break
        kind = fault.kind
        if fault.places != 1 << row or kind < SPOOF:
            continue
        if schedule.severity(fault, entry.t_received) == 0.0:
            continue
        t_ns = network.clock[bus.NOW]
        length = message.length
        for byte in range(len(payload)):
            payload[byte] = entry.payload[byte] if byte < length else 0
        if kind == REPLAY:
            t_ns += int(1e9 * fault.value)
        else:
            signal, sample = frames.signal[number, 0], frames.signal[number, 1]
            if kind == SPOOF:
                raw = codec.raw_value(tables, signal, fault.value)
                codec.insert(tables, signal, payload, raw)
            else:
                length = int(fault.value)
            if sample >= 0:
                count = codec.extract(tables, sample, payload) + 1
                codec.insert(tables, sample, payload, count % 16)
            counter = e2e.counter_of(tables.protection[row], payload) + 1
            e2e.protect(tables.protection[row], counter, payload)
            authentication.pretend(auth, payload)
        flags = message.flags
        bus.submit(network, attacker, t_ns, message.ident, length, payload, flags)
