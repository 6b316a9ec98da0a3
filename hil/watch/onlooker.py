"""A passive monitor of a bus, and the time axis of its observations.

It polls far less often than frames arrive, so differences between frames must come from their time
stamps. The clock of the stamps may be the wall clock, an adapter's or another machine's; its
present reading is derived from the frame with the least delay.
"""

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import can

from canroll.hil.bus_link import CanLink
from canroll.hil.watch.observation import Observation
from canroll.plant_sim.can_bus.traffic.log_reader import flags_of

LEAP = 5.0
"""Distance ahead of the present, or behind the last stamp, that indicates another clock, s."""
DRIFT = 1e-3
"""Largest relative slowness of a clock."""


class BusClock:
    """Time since the first poll, s, on the clock of the frames' time stamps.

    Args:
        now: the monotonic clock at the first poll, s.
    """

    def __init__(self, now: float) -> None:
        self._began = self._looked = now
        self._shift: float | None = None
        self._lead = 0.0
        self._last = 0.0

    def now(self, now: float) -> float:
        """Return the time at ``now`` of the monotonic clock; never before the last frame's."""
        return now - self._began + self._lead

    def instants(self, stamps: Sequence[float], now: float) -> list[float]:
        """Return the times of frames read at ``now``, in order; a stamp of 0 means none."""
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
    """Reads frames from ``link`` into the observation ``seen``."""

    link: CanLink
    seen: Observation
    _clock: BusClock = field(default_factory=lambda: BusClock(time.monotonic()))

    def look(self) -> None:
        """Process all frames waiting on the bus."""
        self.take(self.link.messages())

    def take(self, messages: Iterable[can.Message]) -> None:
        """Process messages just received; error frames are only counted."""
        messages = list(messages)
        frames = [message for message in messages if not message.is_error_frame]
        self.seen.error_frames += len(messages) - len(frames)
        now = time.monotonic()
        times = self._clock.instants([frame.timestamp for frame in frames], now)
        for t, frame in zip(times, frames, strict=True):
            self.seen.see(t, (frame.arbitration_id, bytes(frame.data)), flags_of(frame))
        self.seen.pass_time(self._clock.now(now))
