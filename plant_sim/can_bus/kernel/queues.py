# ruff: noqa: PLR0917
"""Transmit queues of the nodes, and the store of the frames in them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.can_bus.kernel.calendar import push, schedule
from canroll.plant_sim.can_bus.kernel.layout import (
    BUS_OFF,
    FAULT_COUNT,
    FIFO,
    FREE_FRAME,
    GATEWAY_COUNT,
    GATEWAY_DOWN,
    LOST_BUS_OFF,
    LOST_NODE_DOWN,
    LOST_OVERFLOW,
    LOST_PARTITION,
    MAX_MESSAGES,
    MAX_NODES,
    MAX_PAYLOAD,
    MESSAGES,
    NODE_DELAY,
    NODE_DOWN,
    NODE_MUTE,
    NOW,
    OFFERED,
    REPLACE,
    SEED,
    SUPERSEDED,
    Network,
    State,
)
from canroll.plant_sim.can_bus.kernel.ledger import finish
from canroll.plant_sim.can_bus.wire.frame import REMOTE, arbitration_key
from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.kernels.random import Stream, uniform

Drawn = Any
"""Record of a gateway or a node, with the fields of a distribution."""


@njit
def enqueue(
    network: Network,
    node: int,
    t_ns: int,
    ident: int,
    length: int,
    payload: NDArray[np.uint8],
    flags: int = 0,
    bits: int = 0,
) -> bool:
    """Put a frame into the transmit queue of ``node`` at ``t_ns``.

    Args:
        network: of ``make_network`` or ``build_network``.
        node: index of the sending node.
        t_ns: when the frame is queued; at or after the time of the last ``advance``.
        ident: identifier, 29-bit with the flag ``EXTENDED``.
        length: payload bytes.
        payload: one-dimensional array of at least ``length`` bytes; copied.
        flags: ``EXTENDED``, ``REMOTE``, ``FD``, ``BIT_RATE_SWITCH`` or 0.
        bits: if above 0, its length on the wire, interframe space included.

    Returns:
        False if the network's store of frames is full: the frame is counted as lost.

    Raises:
        ValueError: ``t_ns`` lies before the last ``advance``, ``payload`` is shorter than
            ``length``, or the network has seen as many different identifiers as it has room for
            (``MAX_MESSAGES``).
    """
    return submit(network.state[0], node, t_ns, ident, length, payload, flags, bits)


@njit
def submit(
    bus: State,
    node: int,
    t_ns: int,
    ident: int,
    length: int,
    payload: NDArray[np.uint8],
    flags: int,
    bits: int = 0,
    late_ns: int = 0,
) -> bool:
    """``enqueue`` for kernels, with the network's record; ``late_ns`` after its origin."""
    if t_ns < bus.clock[NOW]:
        raise ValueError("frame queued before the time the bus has been advanced to")
    held = 0 if flags & REMOTE else length
    if length < 0 or length > MAX_PAYLOAD or held > len(payload):
        raise ValueError("frame with more bytes than its payload holds")
    message = message_of(bus, node, ident, flags)
    slot = store(bus, message, t_ns, t_ns - late_ns, length, payload, flags)
    if slot < 0:
        return False
    bus.frames[slot].bits = bits
    schedule(bus, t_ns, slot)
    return True


@njit
def store(
    bus: State,
    number: int,
    t_ns: int,
    t_origin: int,
    length: int,
    payload: NDArray[np.uint8],
    flags: int,
) -> int:
    """Copy a frame of message ``number`` into the store; return its slot, −1 if it is full."""
    clock = bus.clock
    message = bus.messages[number]
    slot = clock[FREE_FRAME]
    if slot < 0:
        segment = bus.nodes[message.node].segment
        bus.totals[segment, OFFERED] += 1
        bus.totals[segment, LOST_OVERFLOW] += 1
        message.offered += 1
        message.lost += 1
        return -1
    frame = bus.frames[slot]
    clock[FREE_FRAME] = frame.next
    frame.next = -1
    frame.message = number
    frame.node = message.node
    frame.ident = message.ident
    frame.flags = flags
    frame.length = length
    frame.bits = 0
    frame.attempts = 0
    frame.held = 0
    frame.t_origin = t_origin
    frame.t_queued = t_ns
    stored = bus.payloads[slot]
    for index in range(length if flags & REMOTE == 0 else 0):
        stored[index] = payload[index]
    taken: int = slot
    return taken


@njit
def message_of(bus: State, node: int, ident: int, flags: int) -> int:
    """Return the number of message ``ident`` of ``node``; register it when first seen."""
    key = arbitration_key(ident, flags)
    table = bus.message_table
    mask = len(table) - 1
    place = (key * 0x9E3779B1 + node * 0x85EBCA6B) >> 7 & mask
    while table[place] >= 0:
        known = bus.messages[table[place]]
        if known.key == key and known.node == node:
            registered: int = table[place]
            return registered
        place = place + 1 & mask
    number: int = bus.clock[MESSAGES]
    if number >= MAX_MESSAGES:
        raise ValueError("more different messages than the network was made for")
    bus.clock[MESSAGES] = number + 1
    table[place] = number
    message = bus.messages[number]
    message.key = key
    message.ident = ident
    message.flags = flags
    message.node = node
    message.response_min = np.int64(2**62)
    gateways = 0
    for index in range(bus.clock[GATEWAY_COUNT]):
        gateway = bus.gateways[index]
        same = bus.nodes[gateway.from_node].segment == bus.nodes[node].segment
        if same and node != gateway.from_node and key >= 0:
            routed = gateway.routes < 0
            for route in range(gateway.routes):
                routed = routed or bus.routes[index, route] == key
            if routed:
                gateways |= 1 << index
    message.gateways = gateways
    return number


@njit
def fault_active(bus: State, kind: int, target: int, t_ns: int) -> int:
    """Return the number of the fault of ``kind`` active for ``target`` at ``t_ns``, or −1."""
    for index in range(bus.clock[FAULT_COUNT]):
        fault = bus.faults[index]
        if fault.kind == kind and fault.target == target and fault.from_ns <= t_ns < fault.until_ns:
            return index
    return -1


@njit
def hears(bus: State, number: int, t_ns: int) -> bool:
    """Return whether node ``number`` could receive a frame at ``t_ns``: neither down nor bus-off.

    ``t_ns`` is not so long ago that the node has left the bus again since.
    """
    node = bus.nodes[number]
    off: int = node.off_ns
    if t_ns >= off and (node.state == BUS_OFF or t_ns < node.on_ns):
        return False
    return bus.clock[FAULT_COUNT] == 0 or fault_active(bus, NODE_DOWN, number, t_ns) < 0


@njit
def release(bus: State, slot: int, now: int) -> None:
    """Put the frame in ``slot`` into the transmit queue of its node."""
    frame = bus.frames[slot]
    node = bus.nodes[frame.node]
    late = node.high_ns > 0
    if frame.held == 0 and (bus.clock[FAULT_COUNT] > 0 or late):
        index = fault_active(bus, NODE_DELAY, frame.node, now)
        if index >= 0 or late or now <= node.delayed_ns:
            queued = now + draw(bus, node, Stream.QUEUE_JITTER + frame.node) if late else now
            if index >= 0:
                queued += bus.faults[index].value
            node.delayed_ns = max(node.delayed_ns, queued)
            # where it is due at once, it goes behind those that are due at this instant
            frame.held = 1
            frame.t_queued = node.delayed_ns
            schedule(bus, node.delayed_ns, slot)
            return
    bus.totals[node.segment, OFFERED] += 1
    bus.messages[frame.message].offered += 1
    if node.state == BUS_OFF:
        finish(bus, slot, LOST_BUS_OFF, -1, now, now)
        return
    if bus.clock[FAULT_COUNT] > 0:
        down = fault_active(bus, NODE_DOWN, frame.node, now)
        if down >= 0 or fault_active(bus, NODE_MUTE, frame.node, now) >= 0:
            finish(bus, slot, LOST_NODE_DOWN, -1, now, now)
            return
        for index in range(bus.clock[GATEWAY_COUNT]):
            through = bus.gateways[index].to_node == frame.node
            if through and fault_active(bus, GATEWAY_DOWN, index, now) >= 0:
                finish(bus, slot, LOST_PARTITION, -1, now, now)
                return
    number = frame.node if node.policy == FIFO else MAX_NODES + frame.message
    queue = bus.queues[number]
    if node.policy == REPLACE and queue.head >= 0:
        stale = queue.head
        frame.next = bus.frames[stale].next
        queue.head = slot
        if queue.tail == stale:
            queue.tail = slot
        finish(bus, stale, SUPERSEDED, -1, now, now)
        return
    if node.pending >= node.capacity:
        finish(bus, slot, LOST_OVERFLOW, -1, now, now)
        return
    node.pending += 1
    if queue.head < 0:
        queue.head = slot
    else:
        bus.frames[queue.tail].next = slot
    queue.tail = slot
    offer(bus, number)


@njit
def offer(bus: State, number: int) -> None:
    """Enter the head of a queue into arbitration."""
    queue = bus.queues[number]
    if queue.head < 0 or queue.waiting:
        return
    queue.waiting = 1
    frame = bus.frames[queue.head]
    which = bus.nodes[frame.node].segment
    segment = bus.segments[which]
    key = bus.messages[frame.message].key
    push(
        bus.pending_keys[which],
        bus.pending_ties[which],
        bus.pending[which],
        segment.pending,
        key,
        number,
        number,
    )
    segment.pending += 1
    segment.wake_ns = 0


@njit
def draw(bus: State, of: Drawn, stream: int) -> int:
    """Return the next time (ns) of the spread in a record; ``stream`` is its own."""
    spread = of.high_ns - of.low_ns
    if spread == 0:
        return int(of.low_ns)
    share = uniform(bus.clock[SEED], stream, of.drawn)
    of.drawn += 1
    if of.samples > 0:
        return int(bus.samples[of.first_sample + np.int64(share * of.samples)])
    return int(of.low_ns + np.int64(share * (spread + 1)))
