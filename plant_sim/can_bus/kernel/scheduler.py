"""Events on the bus: releases, arbitration, transmissions and their ends, in time order.

Events at one instant are taken in this order: ends of transmissions, releases into queues,
arbitrations; so a frame queued at the very instant of a start of frame still takes part. A
transmission is never preempted. Identifiers decide bit by bit: the lowest of all frames that are
queued when the bus is free wins.
"""

from canroll.plant_sim.can_bus.kernel.calendar import pop, take
from canroll.plant_sim.can_bus.kernel.error_confinement import (
    acknowledged,
    bit_error,
    count_error,
    count_error_flag,
    count_idle,
    count_recessive,
    count_refusal,
    count_success,
    error_rate,
    error_times,
    first_difference,
    purge,
    random_error,
    refusing_receiver,
    scripted_error,
)
from canroll.plant_sim.can_bus.kernel.layout import (
    ACKNOWLEDGE_ERROR,
    ARBITRATION_LOST,
    BIT_ERROR,
    BUS_OFF,
    COLLISION,
    DELIVERED,
    ERROR,
    ERROR_PASSIVE,
    FAULT_COUNT,
    FIFO,
    LOGGED,
    LOST_BUS_OFF,
    LOST_NODE_DOWN,
    LOST_ONE_SHOT,
    MAX_NODES,
    NO_ERROR,
    NODE_DOWN,
    NOW,
    OVERLOAD,
    REFUSAL,
    REFUSED,
    RELEASES,
    REPLACE,
    SEGMENT_COUNT,
    SUPERSEDED,
    Network,
    State,
)
from canroll.plant_sim.can_bus.kernel.ledger import finish, write_log
from canroll.plant_sim.can_bus.kernel.queues import fault_active, offer, release
from canroll.plant_sim.can_bus.kernel.sources import forward, generate
from canroll.plant_sim.can_bus.wire.frame import (
    ERROR_FLAG,
    ERROR_STATE,
    FD,
    INTERFRAME_BITS,
    OVERLOAD_BITS,
    RECEPTION_BITS_BEFORE_END,
    RECESSIVE_INDICATOR,
    REFUSAL_BITS,
    SUSPEND_BITS,
    duration_ns,
    frame_bits,
)
from canroll.plant_sim.kernels.instants import NEVER
from canroll.plant_sim.kernels.jit import njit

_END, _RELEASE, _ARBITRATION = 0, 1, 2


@njit
def _next(bus: State) -> tuple[int, int, int]:
    """Return time, kind and segment of the next event; time 2⁶² if there is none."""
    clock = bus.clock
    best: int = NEVER
    kind = _END
    which = 0
    for index in range(clock[SEGMENT_COUNT]):
        segment = bus.segments[index]
        if segment.in_flight >= 0 and segment.done_ns < best:
            best, which = segment.done_ns, index
    if clock[RELEASES] > 0 and bus.release_times[0] < best:
        best, kind = bus.release_times[0], _RELEASE
    for index in range(clock[SEGMENT_COUNT]):
        segment = bus.segments[index]
        if segment.in_flight < 0 and segment.pending > 0:
            start = max(segment.free_ns, segment.wake_ns, clock[NOW])
            if start < best:
                best, kind, which = start, _ARBITRATION, index
    return best, kind, which


@njit
def next_event_ns(network: Network) -> int:
    """Return the time of the next event on any segment, ns; 2⁶² if there is none."""
    return _next(network.state[0])[0]


@njit
def advance(network: Network, until_ns: int) -> None:
    """Process all events on all segments up to and including ``until_ns``.

    Ends of frames are appended to ``network.log``; see ``Network``.
    """
    run(network.state[0], until_ns)


@njit
def advance_to_entry(network: Network, until_ns: int) -> bool:
    """``advance``, but only to the next log entry; return whether there was one.

    If no event is left up to 2⁶², time does not advance.
    """
    bus = network.state[0]
    before = bus.clock[LOGGED]
    while bus.clock[LOGGED] == before:
        best = _next(bus)[0]
        if best > until_ns or best == NEVER:
            if until_ns < NEVER:
                run(bus, until_ns)
            return False
        run(bus, best)
    return True


@njit
def run(bus: State, until_ns: int) -> None:
    """``advance`` for kernels, which pass the network's record."""
    while True:
        best, kind, which = _next(bus)
        if best > until_ns:
            break
        _happen(bus, best, kind, which)
    let_pass(bus, until_ns)


@njit
def step(bus: State, until_ns: int) -> bool:
    """Process the next event if it lies before ``until_ns``; return whether there was one.

    Ends of frames at that very instant count, releases and arbitrations do not: more frames may be
    queued then.
    """
    best, kind, which = _next(bus)
    if best > until_ns or (best == until_ns and kind != _END):
        return False
    _happen(bus, best, kind, which)
    return True


@njit
def next_end_ns(bus: State) -> int:
    """Return when the next frame ends, or an event before that has to be processed to know it."""
    end: int = NEVER
    for index in range(bus.clock[SEGMENT_COUNT]):
        segment = bus.segments[index]
        if segment.in_flight < 0:
            return _next(bus)[0]
        end = min(end, segment.done_ns)
    return end


@njit
def let_pass(bus: State, until_ns: int) -> None:
    """Advance the time to ``until_ns``; no event is due before."""
    clock = bus.clock
    clock[NOW] = max(clock[NOW], until_ns)
    for index in range(clock[SEGMENT_COUNT]):
        count_idle(bus, index, clock[NOW])


@njit
def _happen(bus: State, best: int, kind: int, which: int) -> None:
    """Process an event of ``_next``."""
    bus.clock[NOW] = best
    if kind == _END:
        _end(bus, which, best)
    elif kind == _ARBITRATION:
        _arbitrate(bus, which, best)
    else:
        value = take(bus)
        if value < 0:
            which = bus.nodes[bus.sources[-1 - value].node].segment
            count_idle(bus, which, best)
            generate(bus, -1 - value, best)
        else:
            which = bus.nodes[bus.frames[value].node].segment
            count_idle(bus, which, best)
            release(bus, value, best)


@njit
def _take(bus: State, which: int) -> int:
    segment = bus.segments[which]
    number = pop(
        bus.pending_keys[which],
        bus.pending_ties[which],
        bus.pending[which],
        segment.pending,
    )
    segment.pending -= 1
    return number


@njit
def _detach(bus: State, number: int) -> int:
    """Remove the head of a queue, which stays marked as waiting during transmission."""
    queue = bus.queues[number]
    slot: int = queue.head
    queue.head = bus.frames[slot].next
    if queue.head < 0:
        queue.tail = -1
    bus.frames[slot].next = -1
    return slot


@njit
def _arbitrate(bus: State, which: int, now: int) -> None:
    segment = bus.segments[which]
    count_idle(bus, which, now)
    aside, winner, wake = 0, -1, NEVER
    while segment.pending > 0:
        number = _take(bus, which)
        sender = bus.frames[bus.queues[number].head].node
        node = bus.nodes[sender]
        if bus.clock[FAULT_COUNT] > 0 and fault_active(bus, NODE_DOWN, sender, now) >= 0:
            slot = _detach(bus, number)
            node.pending -= 1
            finish(bus, slot, LOST_NODE_DOWN, -1, now, now)
            bus.queues[number].waiting = 0
            offer(bus, number)
        elif node.suspended_ns > now:
            bus.aside[aside] = number
            aside += 1
            wake = min(wake, node.suspended_ns)
        else:
            winner = number
            break
    for index in range(aside):
        bus.queues[bus.aside[index]].waiting = 0
        offer(bus, bus.aside[index])
    if winner < 0:
        segment.wake_ns = wake
        return
    slot = _detach(bus, winner)
    twin = -1
    key = bus.messages[bus.frames[slot].message].key
    if segment.pending > 0 and bus.pending_keys[which, 0] == key:
        rival = bus.queues[bus.pending[which, 0]].head
        other = bus.frames[rival].node
        awake = bus.nodes[other].suspended_ns <= now
        if awake and fault_active(bus, NODE_DOWN, other, now) < 0:
            twin = _detach(bus, _take(bus, which))
    _start(bus, which, slot, twin, now)


@njit
def _start(bus: State, which: int, slot: int, twin: int, now: int) -> None:
    segment = bus.segments[which]
    frame = bus.frames[slot]
    if frame.flags & FD:
        passive = bus.nodes[frame.node].state == ERROR_PASSIVE
        recessive = passive or frame.flags & RECESSIVE_INDICATOR
        frame.flags = frame.flags & ~ERROR_STATE | (ERROR_STATE if recessive else 0)
    nominal: int = frame.bits
    data = 0
    if nominal == 0:
        nominal, data = frame_bits(frame.ident, frame.flags, frame.length, bus.payloads[slot])
    rate = segment.data_bitrate if segment.data_bitrate else segment.bitrate
    fast = duration_ns(data, rate) if data else 0
    # a division costs as much as stuffing the frame: most bit times are whole nanoseconds
    if segment.bit_ns > 0:
        taken = (nominal - RECEPTION_BITS_BEFORE_END) * segment.bit_ns
        nominal_ns = nominal * segment.bit_ns
    else:
        taken = duration_ns(nominal - RECEPTION_BITS_BEFORE_END, segment.bitrate)
        nominal_ns = duration_ns(nominal, segment.bitrate)
    segment.in_flight = slot
    segment.twin = twin
    segment.start_ns = now
    segment.done_ns = now + fast + taken + segment.propagation_ns
    segment.end_ns = now + fast + nominal_ns
    segment.disturbance = NO_ERROR
    segment.missed = -1
    segment.transmissions += 1
    frame.attempts += 1
    if frame.flags & ERROR_FLAG:
        return
    bits = nominal + data - INTERFRAME_BITS
    position, kind = -1, NO_ERROR
    if twin >= 0:
        bus.frames[twin].attempts += 1
        position, kind = first_difference(bus, slot, twin), COLLISION
    errors = error_rate(bus, which, now)
    if position < 0 and errors > 0.0:
        position, kind = random_error(bus, which, bits, errors), BIT_ERROR
    if position < 0 and bus.clock[FAULT_COUNT] > 0:
        position, kind = scripted_error(bus, slot, bits, now), BIT_ERROR
    if position < 0 and twin < 0 and not acknowledged(bus, which, frame.node, now):
        position, kind = bits - 9, ACKNOWLEDGE_ERROR
    if position >= 0:
        if kind == BIT_ERROR:
            kind = bit_error(bus, slot, position)
        segment.disturbance = kind
        segment.done_ns, segment.end_ns = error_times(bus, which, slot, position, kind, now)
    elif bus.clock[FAULT_COUNT] > 0:
        if twin < 0:
            segment.missed = refusing_receiver(bus, which, slot, now)
        if segment.missed >= 0 and bus.nodes[segment.missed].state != ERROR_PASSIVE:
            segment.disturbance = REFUSAL
            segment.end_ns += duration_ns(REFUSAL_BITS, segment.bitrate)
            return
        index = fault_active(bus, OVERLOAD, which, now)
        if index >= 0 and bus.faults[index].left != 0:
            bus.faults[index].left -= 1
            segment.overloads += 1
            segment.end_ns += duration_ns(OVERLOAD_BITS, segment.bitrate)


@njit
def _end(bus: State, which: int, now: int) -> None:
    segment = bus.segments[which]
    slot, twin, kind = segment.in_flight, segment.twin, segment.disturbance
    segment.busy_ns += segment.end_ns - segment.start_ns
    segment.free_ns = segment.idle_from_ns = segment.end_ns
    segment.in_flight = segment.twin = -1
    sender = bus.frames[slot].node
    other = bus.frames[twin].node if twin >= 0 else -1
    if segment.bus_off > 0:
        count_recessive(bus, which, 1)
    if segment.missed >= 0:
        count_refusal(bus, which, sender, segment.missed)
    elif bus.frames[slot].flags & ERROR_FLAG:
        count_error_flag(bus, which)
    elif kind == NO_ERROR:
        count_success(bus, which, sender)
    else:
        count_error(bus, which, sender, other, kind)
    _settle(bus, which, slot, kind, now)
    if twin >= 0:
        _settle(bus, which, twin, kind, now)
    if kind != NO_ERROR:
        for index in (sender, other):
            if index >= 0 and bus.nodes[index].state == BUS_OFF:
                purge(bus, which, index, now)


@njit
def _settle(bus: State, which: int, slot: int, kind: int, now: int) -> None:
    """Decide the outcome of a transmission attempt: done, retransmitted, or lost."""
    segment = bus.segments[which]
    frame = bus.frames[slot]
    sender = frame.node
    node = bus.nodes[sender]
    number = sender if node.policy == FIFO else MAX_NODES + frame.message
    queue = bus.queues[number]
    queue.waiting = 0
    if node.state == ERROR_PASSIVE and kind != ARBITRATION_LOST:
        node.suspended_ns = segment.end_ns + duration_ns(SUSPEND_BITS, segment.bitrate)
    missed = segment.missed
    if kind in (NO_ERROR, REFUSAL) and bus.messages[frame.message].gateways:
        forward(bus, slot, now, missed)
    outcome = DELIVERED
    if kind != NO_ERROR:
        broken = REFUSED if kind == REFUSAL else ERROR
        write_log(bus, slot, broken, segment.start_ns, now, segment.end_ns, missed)
        if node.state == BUS_OFF:
            outcome = LOST_BUS_OFF
        elif node.single_shot:
            outcome = LOST_ONE_SHOT
        elif node.policy == REPLACE and queue.head >= 0:
            outcome = SUPERSEDED
        else:
            frame.next = queue.head
            queue.head = slot
            if queue.tail < 0:
                queue.tail = slot
            offer(bus, number)
            return
    node.pending -= 1
    finish(bus, slot, outcome, segment.start_ns, now, segment.end_ns, missed)
    offer(bus, number)
