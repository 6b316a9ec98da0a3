"""A recording repeated in a loop within the arrival curve of every message."""

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from canroll.plant_sim.can_bus.kernel.layout import Network
from canroll.plant_sim.can_bus.traffic.inference import InferredBus
from canroll.plant_sim.can_bus.traffic.log_playback import RecordedFrames, feed
from canroll.plant_sim.can_bus.wire.frame import arbitration_key
from canroll.plant_sim.kernels.random import Stream, random_bits


class LoopedFrames(NamedTuple):
    """Frames of the first pass and of all later ones, and the duration of a pass, ns."""

    first: RecordedFrames
    again: RecordedFrames
    span_ns: int


def loop_of(bus: InferredBus, leave_out: Collection[int] = ()) -> LoopedFrames:
    """Return a recording as a loop, without the arbitration keys of ``leave_out``.

    Where the end meets the start, frames of a message may come too close: frames at the start that
    violate its arrival curve are left out of all passes but the first.
    """
    frames = bus.recording.frames
    pairs = zip(frames.ident.tolist(), frames.flags.tolist(), strict=True)
    keys = np.array([arbitration_key(ident, flags) for ident, flags in pairs], np.int64)
    span = bus.span_ns
    kept = ~np.isin(keys, list(leave_out))
    again = kept.copy()
    for inferred in bus.messages:
        message = inferred.message
        own = np.flatnonzero(keys == message.arbitration_key)
        since = frames.t_ns[own] + span - frames.t_ns[own[-1]]
        again[own[since < message.period_ns + message.jitter_ns]] = False
    return LoopedFrames(_only(frames, kept), _only(frames, again), span)


def _only(frames: RecordedFrames, mask: np.ndarray) -> RecordedFrames:
    return RecordedFrames(*(column[mask] for column in frames))


class LoopedTraffic:
    """Sends a loop from one node of a network, with a phase drawn from the seed.

    Args:
        network: at time 0.
        node: number of the sending node.
        loop: the frames.
        seed: of the phase.
    """

    def __init__(self, network: Network, node: int, loop: LoopedFrames, *, seed: int) -> None:
        self._network, self._node, self._loop = network, node, loop
        phase = int(random_bits(seed, int(Stream.LOG_PHASE), 0)) % loop.span_ns
        self._frames = loop.first.piece(phase, loop.span_ns)
        self._next_ns = loop.span_ns - phase
        self._cursor = 0

    def feed(self, until_ns: int) -> None:
        """Queue all frames up to ``until_ns``; call it before the network advances to then."""
        while True:
            self._cursor = feed(self._network, self._frames, self._node, self._cursor, until_ns)
            if self._cursor < len(self._frames.t_ns) or self._next_ns > until_ns:
                return
            again = self._loop.again
            self._frames = again._replace(t_ns=again.t_ns + self._next_ns)
            self._next_ns += self._loop.span_ns
            self._cursor = 0
