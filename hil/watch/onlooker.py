"""A passive monitor of a bus, and its observations."""

import time
from collections.abc import Iterable
from dataclasses import dataclass, field

import can

from hil.realtime.bus_link import CanLink
from hil.watch.bus_clock import BusClock
from hil.watch.observation import Observation, Seen
from plant_sim.can_bus.traffic.log_reader import flags_of


@dataclass(slots=True)
class Onlooker:
    """Takes in what comes over ``link``; ``seen`` is the sum of it."""

    link: CanLink
    seen: Observation
    _clock: BusClock = field(default_factory=lambda: BusClock(time.monotonic()))

    def look(self) -> list[Seen]:
        """Take in everything that waits on the bus."""
        return self.take(self.link.messages())

    def take(self, messages: Iterable[can.Message]) -> list[Seen]:
        """Take in messages that have just been received; error frames are only counted."""
        messages = list(messages)
        frames = [message for message in messages if not message.is_error_frame]
        self.seen.error_frames += len(messages) - len(frames)
        now = time.monotonic()
        times = self._clock.instants([frame.timestamp for frame in frames], now)
        seen = [
            self.seen.see(t, (frame.arbitration_id, bytes(frame.data)), flags_of(frame))
            for t, frame in zip(times, frames, strict=True)
        ]
        self.seen.pass_time(self._clock.now(now))
        return seen

    def now(self) -> float:
        """Return the time on the axis of what is seen, s."""
        return self._clock.now(time.monotonic())
