"""Frames generated within the network, by periodic sources and gateways."""

import numpy as np

from canroll.plant_sim.can_bus.kernel.calendar import schedule
from canroll.plant_sim.can_bus.kernel.layout import GATEWAY_COUNT, NOW, SEED, Network, State
from canroll.plant_sim.can_bus.kernel.queues import draw, hears, message_of, release, store
from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.kernels.random import Stream, random_bits, uniform


@njit
def start_source(network: Network, number: int) -> None:
    """Register the message of a periodic source and schedule its first release."""
    bus = network.state[0]
    source = bus.sources[number]
    source.message = message_of(bus, source.node, source.ident, source.flags)
    schedule_source(bus, number, bus.clock[NOW])


@njit
def schedule_source(bus: State, number: int, now: int) -> None:
    """Schedule the next release of a periodic source."""
    source = bus.sources[number]
    drift = bus.nodes[source.node].drift
    nominal = source.offset_ns + np.int64(np.rint(source.sent * source.period_ns * (1.0 + drift)))
    if nominal >= source.until_ns:
        return
    if source.jitter_ns > 0:
        draw = uniform(bus.clock[SEED], Stream.SOURCE_JITTER + number, source.sent)
        nominal += np.int64(draw * (source.jitter_ns + 1))
    schedule(bus, max(nominal, now), -1 - number)


@njit
def generate(bus: State, number: int, now: int) -> None:
    """Queue the frame of a periodic source and schedule the next release."""
    source = bus.sources[number]
    payload = bus.source_payloads[number]
    if source.random_payload:
        # one place for all: thousands of sources would push each other's out of the cache
        payload = bus.scratch[0]
        bits = np.uint64(0)
        for index in range(source.length):
            if index & 7 == 0:
                counter = source.sent * 8 + (index >> 3)
                bits = random_bits(bus.clock[SEED], Stream.SOURCE_PAYLOAD + number, counter)
            payload[index] = np.uint8(bits & np.uint64(0xFF))
            bits >>= np.uint64(8)
    slot = store(bus, source.message, now, now, source.length, payload, source.flags)
    source.sent += 1
    schedule_source(bus, number, now)
    if slot >= 0:
        bus.frames[slot].bits = source.bits
        release(bus, slot, now)


@njit
def forward(bus: State, slot: int, now: int, missed: int) -> None:
    """Forward a received frame through the gateways that route it.

    ``missed``: the one node that has not received it, or −1.
    """
    frame = bus.frames[slot]
    mask = bus.messages[frame.message].gateways
    for index in range(bus.clock[GATEWAY_COUNT]):
        if not mask >> index & 1:
            continue
        gateway = bus.gateways[index]
        if gateway.from_node == missed or not hears(bus, gateway.from_node, now):
            continue
        gateway.last_ns = max(
            gateway.last_ns, now + draw(bus, gateway, Stream.GATEWAY_LATENCY + index)
        )
        stored = store(
            bus,
            message_of(bus, gateway.to_node, frame.ident, frame.flags),
            gateway.last_ns,
            frame.t_origin,
            frame.length,
            bus.payloads[slot],
            frame.flags,
        )
        if stored >= 0:
            # only what a node sends itself waits in it before it is queued
            bus.frames[stored].held = 1
            bus.frames[stored].bits = frame.bits
            schedule(bus, gateway.last_ns, stored)
