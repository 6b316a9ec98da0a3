# ruff: noqa: PLR0917
"""Error frames, error counters, error-passive and bus-off nodes (ISO 11898-1, 12.1).

A disturbed bit destroys the attempt for all nodes: the transmitter counts +8 (an error-passive one
without acknowledgement nothing), every other node +1; a success counts −1 on both sides. A
recessive bit of the arbitration field seen dominant is no error: the transmitter has lost, nobody
drives on, and after six recessive bits all count +1 as receivers. If that is a stuff bit, it is an
error that the transmitter does not count (exception 2). Above 127
a node is error-passive and waits 8 more bits after each of its transmissions; above 255 the
transmitter leaves the bus, loses its queued frames, and rejoins after 128 times 11 recessive bits.
An error seen by a single receiver in the last but one bit of EOF makes the nodes inconsistent: the
others have accepted the frame and receive it twice, or the one never receives it (Rufino et al.,
"Fault-tolerant broadcasts in CAN", 1998).
"""

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.can_bus.kernel.layout import (
    ACKNOWLEDGE_ERROR,
    ARBITRATION_LOST,
    BIT_ERROR,
    BIT_ERRORS,
    BUS_OFF,
    DISTURB,
    DRAWS,
    ERROR_ACTIVE,
    ERROR_PASSIVE,
    FAULT_COUNT,
    LOST_BUS_OFF,
    MAX_NODES,
    MESSAGES,
    NODE_COUNT,
    NODE_DOWN,
    NOW,
    REFUSE,
    SEED,
    STUFF_ERROR,
    State,
)
from canroll.plant_sim.can_bus.kernel.ledger import finish
from canroll.plant_sim.can_bus.kernel.queues import fault_active, offer
from canroll.plant_sim.can_bus.wire.bits import wire_bits
from canroll.plant_sim.can_bus.wire.frame import (
    ERROR_DELIMITER_BITS,
    ERROR_FLAG_BITS,
    EXTENDED,
    INTERFRAME_BITS,
    TRAILER_BITS,
    duration_ns,
)
from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.kernels.random import Stream, uniform

_EQUAL_BITS = 6
"""So many equal bits in a row break the stuffing rule."""
_RECESSIVE_SEQUENCE_BITS = 11
_RECOVERY_SEQUENCES = 128


@njit
def encode_frame(bus: State, slot: int, out: NDArray[np.uint8]) -> tuple[int, int, int]:
    """Write the wire bits of the frame in ``slot``; see ``wire_bits``."""
    frame = bus.frames[slot]
    return wire_bits(frame.ident, frame.flags, frame.length, bus.payloads[slot], out)


@njit
def first_difference(bus: State, slot: int, twin: int) -> int:
    """Return the first wire bit in which two frames differ, −1 if they are identical."""
    bits, _, _ = encode_frame(bus, slot, bus.scratch[0])
    others, _, _ = encode_frame(bus, twin, bus.scratch[1])
    for index in range(min(bits, others)):
        if bus.scratch[0, index] != bus.scratch[1, index]:
            return index
    return -1


@njit
def error_rate(bus: State, which: int, now: int) -> float:
    """Return the probability that a bit on a segment is disturbed at ``now``."""
    rate: float = bus.segments[which].bit_error_rate
    for index in range(bus.clock[FAULT_COUNT]):
        fault = bus.faults[index]
        there = fault.target < 0 or fault.target == which
        if fault.kind == BIT_ERRORS and there and fault.from_ns <= now < fault.until_ns:
            rate += fault.rate
    return rate


@njit
def random_error(bus: State, which: int, bits: int, rate: float) -> int:
    """Draw the first disturbed bit of an attempt of ``bits`` bits, −1 for none."""
    bus.clock[DRAWS] += 1
    draw = uniform(bus.clock[SEED], Stream.BIT_ERROR + which, bus.clock[DRAWS])
    if draw >= -np.expm1((bits - 1) * np.log1p(-rate)):
        return -1
    position = int(np.log1p(-draw) / np.log1p(-rate))
    return min(position, bits - 2)


@njit
def _due(bus: State, index: int, kind: int, slot: int, now: int) -> bool:
    """Return whether a fault of ``kind`` hits the attempt that starts now."""
    fault = bus.faults[index]
    timely: bool = fault.kind == kind and fault.left != 0 and fault.from_ns <= now < fault.until_ns
    chosen: bool = fault.ident < 0 or fault.ident == bus.frames[slot].ident
    return timely and chosen


@njit
def scripted_error(bus: State, slot: int, bits: int, now: int) -> int:
    """Return the bit disturbed by a fault in this attempt, −1 for none; consumes the fault."""
    for index in range(bus.clock[FAULT_COUNT]):
        fault = bus.faults[index]
        hit = fault.target < 0 or fault.target == bus.frames[slot].node
        if hit and _due(bus, index, DISTURB, slot, now):
            fault.left -= 1
            position: int = fault.value
            return min(position, bits - 2)
    return -1


@njit
def refusing_receiver(bus: State, which: int, slot: int, now: int) -> int:
    """Return the only node that sees an error in this attempt, −1 for none.

    The fault disturbs the last but one bit of EOF for that receiver, and is consumed.
    """
    for index in range(bus.clock[FAULT_COUNT]):
        if _due(bus, index, REFUSE, slot, now):
            target: int = bus.faults[index].target
            node = bus.nodes[target]
            there = node.segment == which and target != bus.frames[slot].node
            there = there and node.state != BUS_OFF
            if there and fault_active(bus, NODE_DOWN, target, now) < 0:
                bus.faults[index].left -= 1
                return target
    return -1


@njit
def acknowledged(bus: State, which: int, sender: int, now: int) -> bool:
    """Return whether another node of the segment acknowledges the frame."""
    for index in range(bus.clock[NODE_COUNT]):
        node = bus.nodes[index]
        there = node.segment == which and index != sender and node.state != BUS_OFF
        if there and fault_active(bus, NODE_DOWN, index, now) < 0:
            return True
    return False


@njit
def bit_error(bus: State, slot: int, position: int) -> int:
    """Return what it is that wire bit ``position`` is disturbed: a bit error, or of arbitration."""
    bits = bus.scratch[0]
    encode_frame(bus, slot, bits)
    # identifier and RTR, with SRR and IDE of an extended frame
    left = 32 if bus.frames[slot].flags & EXTENDED else 12
    place, run = 1, 1
    while left > 0 and place <= position:
        stuffed = run == _EQUAL_BITS - 1
        if place == position and bits[place] == 1:
            return STUFF_ERROR if stuffed else ARBITRATION_LOST
        run = run + 1 if bits[place] == bits[place - 1] else 1
        left -= 0 if stuffed else 1
        place += 1
    return BIT_ERROR


@njit
def error_times(
    bus: State, which: int, slot: int, position: int, kind: int, now: int
) -> tuple[int, int]:
    """Return when an error in wire bit ``position`` is seen, and when the bus is free again.

    The error flag is 6 bits; nodes that did not see the error see the flag break the stuffing
    rule and answer with 6 more: 6 to 12 in all, by the equal bits that came before.
    """
    segment = bus.segments[which]
    bits = bus.scratch[0]
    total, data_from, data_to = encode_frame(bus, slot, bits)
    fast = max(0, min(position + 1, data_to) - data_from)
    rate = segment.data_bitrate if segment.data_bitrate else segment.bitrate
    seen = now + duration_ns(position + 1 - fast, segment.bitrate) + duration_ns(fast, rate)
    flag = ERROR_FLAG_BITS + 1
    if kind == ARBITRATION_LOST:
        seen += duration_ns(_EQUAL_BITS, segment.bitrate)
        flag = ERROR_FLAG_BITS
    elif kind != ACKNOWLEDGE_ERROR and position < total - TRAILER_BITS:
        passive = bus.nodes[bus.frames[slot].node].state == ERROR_PASSIVE
        polarity = 1 if passive else 0
        value = 1 - bits[position]
        run = 1
        while run < _EQUAL_BITS and position >= run and bits[position - run] == value:
            run += 1
        if run == _EQUAL_BITS:
            flag = ERROR_FLAG_BITS
        else:
            flag = 2 * ERROR_FLAG_BITS - (run if value == polarity else 0)
    after = flag + ERROR_DELIMITER_BITS + INTERFRAME_BITS
    return seen, seen + duration_ns(after, segment.bitrate)


@njit
def _classify(bus: State, index: int) -> None:
    node = bus.nodes[index]
    if node.state != BUS_OFF:
        passive = node.transmit_errors > 127 or node.receive_errors > 127
        node.state = ERROR_PASSIVE if passive else ERROR_ACTIVE


@njit
def count_success(bus: State, which: int, sender: int) -> None:
    """Decrement the error counters of the segment's nodes after a good frame."""
    segment = bus.segments[which]
    if not segment.disturbed:
        return
    left = 0
    for index in range(bus.clock[NODE_COUNT]):
        node = bus.nodes[index]
        if node.segment != which or node.state == BUS_OFF:
            continue
        if index == sender:
            node.transmit_errors = max(0, node.transmit_errors - 1)
        elif node.receive_errors > 127:
            node.receive_errors = 120
        else:
            node.receive_errors = max(0, node.receive_errors - 1)
        _classify(bus, index)
        left += node.transmit_errors + node.receive_errors
    segment.disturbed = 1 if left > 0 else 0


@njit
def count_error(bus: State, which: int, sender: int, twin: int, kind: int) -> None:
    """Raise the error counters after a destroyed attempt of ``sender`` (and of ``twin``)."""
    bus.segments[which].disturbed = 1
    for index in range(bus.clock[NODE_COUNT]):
        node = bus.nodes[index]
        if node.segment != which or node.state == BUS_OFF:
            continue
        if index in (sender, twin) and kind != ARBITRATION_LOST:
            if kind == STUFF_ERROR:
                continue
            if kind != ACKNOWLEDGE_ERROR or node.state != ERROR_PASSIVE:
                _count_transmit_error(bus, which, index)
        elif kind != ACKNOWLEDGE_ERROR:
            node.receive_errors = min(node.receive_errors + 1, 255)
            _classify(bus, index)


@njit
def count_refusal(bus: State, which: int, sender: int, receiver: int) -> None:
    """Raise the error counters after a receiver refused a frame in its last bit.

    The sender counts a transmit error. After its own flag the receiver sees a dominant bit of the
    other nodes' flags, which counts 8 more; for them the frame was valid and followed by an
    overload. The flag of an error-passive receiver is invisible to others.
    """
    node = bus.nodes[receiver]
    seen = node.state != ERROR_PASSIVE
    received, sent = node.receive_errors, bus.nodes[sender].transmit_errors
    count_success(bus, which, sender)
    bus.segments[which].disturbed = 1
    node.receive_errors = min(received + (9 if seen else 1), 255)
    _classify(bus, receiver)
    if seen:
        bus.nodes[sender].transmit_errors = sent
        _count_transmit_error(bus, which, sender)


@njit
def _count_transmit_error(bus: State, which: int, index: int) -> None:
    node = bus.nodes[index]
    node.transmit_errors += 8
    _classify(bus, index)
    if node.transmit_errors > 255:
        node.state = BUS_OFF
        node.off_ns = bus.clock[NOW]
        node.bus_offs += 1
        node.recovery_left = _RECOVERY_SEQUENCES
        bus.segments[which].bus_off += 1


@njit
def count_error_flag(bus: State, which: int) -> None:
    """Raise the receive error counters of all nodes after an error flag on the idle bus."""
    bus.segments[which].disturbed = 1
    for index in range(bus.clock[NODE_COUNT]):
        node = bus.nodes[index]
        if node.segment == which and node.state != BUS_OFF:
            node.receive_errors = min(node.receive_errors + 1, 255)
            _classify(bus, index)


@njit
def purge(bus: State, which: int, sender: int, now: int) -> None:
    """Discard the queued frames of a node that has left the bus."""
    segment = bus.segments[which]
    segment.pending = 0
    for number in range(MAX_NODES + bus.clock[MESSAGES]):
        queue = bus.queues[number]
        if queue.head < 0:
            continue
        node = bus.frames[queue.head].node
        if bus.nodes[node].segment != which:
            continue
        queue.waiting = 0
        while node == sender and queue.head >= 0:
            slot = queue.head
            queue.head = bus.frames[slot].next
            bus.nodes[node].pending -= 1
            finish(bus, slot, LOST_BUS_OFF, -1, now, now)
        if queue.head < 0:
            queue.tail = -1
        offer(bus, number)


@njit
def count_recessive(bus: State, which: int, sequences: int) -> None:
    """Count ``sequences`` further runs of 11 recessive bits for bus-off nodes."""
    segment = bus.segments[which]
    for index in range(bus.clock[NODE_COUNT]):
        node = bus.nodes[index]
        if node.segment == which and node.state == BUS_OFF and node.recovers:
            node.recovery_left -= sequences
            if node.recovery_left <= 0:
                node.state = ERROR_ACTIVE
                node.on_ns = bus.clock[NOW]
                node.transmit_errors = node.receive_errors = 0
                segment.bus_off -= 1


@njit
def count_idle(bus: State, which: int, now: int) -> None:
    """Account for the recessive bits of an idle bus up to ``now``."""
    segment = bus.segments[which]
    if segment.bus_off == 0 or segment.in_flight >= 0 or now <= segment.idle_from_ns:
        return
    step = duration_ns(_RECESSIVE_SEQUENCE_BITS, segment.bitrate)
    sequences = (now - segment.idle_from_ns) // step
    segment.idle_from_ns += sequences * step
    count_recessive(bus, which, sequences)
