"""A passive monitor of a bus, and the time axis of its observations.

It looks many times less often than frames come, so differences between frames must be those of
their stamps. The clock behind the stamps may be the wall's, an adapter's or another machine's; its
present reading is told by the frame that was delayed least.
"""

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import can

from hil.realtime.bus_link import CanLink
from hil.watch.observation import Observation, Seen
from plant_sim.can_bus.traffic.log_reader import flags_of

LEAP = 5.0
"""A stamp so far ahead of the present, or behind the last one, is of another clock, s."""
DRIFT = 1e-3
"""A clock may run slower than ours by this share."""


class BusClock:
    """Time since the first look, s, as the stamps of frames count it.

    Args:
        now: the monotonic clock at the first look, s.
    """

    def __init__(self, now: float) -> None:
        self._began = self._looked = now
        self._shift: float | None = None
        self._lead = 0.0
        self._last = 0.0

    def now(self, now: float) -> float:
        """Return the time at ``now`` of the monotonic clock; never before a frame's."""
        return now - self._began + self._lead

    def instants(self, stamps: Sequence[float], now: float) -> list[float]:
        """Return the times of frames taken at ``now``, in order; a stamp of 0 is none."""
        known = [stamp for stamp in stamps if stamp]
        if known:
            newest, here = max(known), self.now(now)
            if self._shift is None or self._is_other_clock(newest + self._shift, here):
                self._shift = here - newest
            self._last = newest + self._shift
            self._lead -= DRIFT * min(now - self._looked, 1.0)
            self._lead = max(self._lead, self._last - (now - self._began))
            self._looked = now
        here = self.now(now)
        return [stamp + (self._shift or 0.0) if stamp else here for stamp in stamps]

    def _is_other_clock(self, newest: float, here: float) -> bool:
        return newest > here + LEAP or newest < self._last - LEAP


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
