"""The bus kernel: frames a second, cost over the number of messages, and memory over many frames;
and what a frame costs a python-can program on ``simbus`` beside python-can's own ``virtual``.

Every frame has random payload, exact stuffing, arbitration and an account. Rates are also given as
multiples of a yardstick measured in the same run (one step of a compiled shift register), so
that numbers of different machines compare.
"""

import argparse
import resource
import time

import can
import numpy as np
from numba import njit

from canroll.plant_sim.can_bus import (
    NetworkSpec,
    Node,
    Segment,
    Source,
    account,
    advance,
    build_network,
)
from canroll.plant_sim.can_bus.wire.frame import frame_bits

MS = 1_000_000


@njit
def yardstick(count):
    state = 88172645463325252
    for _ in range(count):
        state ^= state << 13
        state ^= state >> 7
        state ^= state << 17
    return state


@njit
def lengths(payload, count):
    total = 0
    for i in range(count):
        payload[i & 7] += 1
        total += frame_bits(0x123, 0, 8, payload)[0]
    return total


def network_of(messages, *, load=0.6, nodes=6):
    period = messages * 0.25e6 / load
    rng = np.random.default_rng(messages)
    return build_network(
        NetworkSpec(
            (Segment(500_000),),
            tuple(Node(f"n{i}") for i in range(nodes)),
            tuple(
                Source(f"n{i % nodes}", 0x100 + i, 8, period, offset_ns=int(rng.integers(period)))
                for i in range(messages)
            ),
        )
    )


def rate(messages, *, frames, runs):
    """Frames a second over ``frames`` frames, best of ``runs``."""
    best = 0.0
    for _ in range(runs):
        network = network_of(messages)
        advance(network, 10 * MS)
        before = int(network.segments["transmissions"][0])
        span = int(frames * 0.25e6 / 0.6)
        start = time.process_time()
        advance(network, 10 * MS + span)
        best = max(
            best,
            (int(network.segments["transmissions"][0]) - before) / (time.process_time() - start),
        )
        assert account(network, 0).balanced
    return best


def cost_of_a_frame(interface, *, frames, runs, **options):
    """Seconds to send a frame and to receive it, by turns, best of ``runs``."""
    best = float("inf")
    with (
        can.Bus("bench", interface=interface, **options) as one,
        can.Bus("bench", interface=interface) as two,
    ):
        message = can.Message(arbitration_id=0x123, is_extended_id=False, data=bytes(8))
        for _ in range(runs):
            start = time.process_time()
            for _ in range(frames):
                one.send(message)
                two.recv(1.0)
            best = min(best, (time.process_time() - start) / frames)
    return best


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=300_000)
    parser.add_argument("--long", type=int, default=10_000_000)
    parser.add_argument("--runs", type=int, default=5)
    options = parser.parse_args()
    yardstick(10)
    start = time.process_time()
    yardstick(100_000_000)
    unit = (time.process_time() - start) / 100_000_000
    lengths(np.zeros(8, np.uint8), 10)
    start = time.process_time()
    lengths(np.zeros(8, np.uint8), 1_000_000)
    each = (time.process_time() - start) / 1_000_000
    print(f"exact length of an 8-byte frame: {each * 1e9:.0f} ns, {each / unit:.0f} yardsticks")
    rates = {}
    for messages in (10, 12, 20, 50, 100, 200, 500, 1000):
        rates[messages] = rate(messages, frames=options.frames, runs=options.runs)
        print(
            f"{messages:4} messages: {rates[messages] / 1e6:5.2f} M frames/s,"
            f" {1.0 / rates[messages] / unit:5.0f} yardsticks a frame"
        )
        print(f"ratio messages_{messages} {100.0 * rates[messages] * unit:.3f}")
    print(f"cost of a frame, 1000 messages to 10: {rates[10] / rates[1000]:.2f}")
    costs = {
        name: cost_of_a_frame(name, frames=5_000, runs=options.runs, **more)
        for name, more in (("virtual", {}), ("simbus", {"virtual_time": True}))
    }
    ratio = costs["simbus"] / costs["virtual"]
    told = ", ".join(f"{name} {cost * 1e6:.1f} µs" for name, cost in costs.items())
    print(f"to send and receive a frame with python-can: {told}, {ratio:.2f} times")
    print(f"ratio simbus {1.0 / ratio:.3f}")
    network = network_of(12)
    advance(network, 1000 * MS)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.process_time()
    advance(network, 1000 * MS + int(options.long * 0.25e6 / 0.6))
    taken = time.process_time() - start
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    sent = int(network.segments["transmissions"][0])
    print(
        f"{sent / 1e6:.1f} M frames in one go: {sent / taken / 1e6:.2f} M frames/s,"
        f" memory grew by {after - before} KiB, account balanced: {account(network, 0).balanced}"
    )


if __name__ == "__main__":
    main()
