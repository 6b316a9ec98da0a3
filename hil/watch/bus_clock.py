"""When frames were on the bus, by the interface's own stamps, on one time axis for an onlooker.

An onlooker looks many times less often than frames come, so differences between frames must be
those of their stamps. The clock behind the stamps may be the wall's, an adapter's or another
machine's; what it reads at present is told by the frame that was delayed least.
"""

from collections.abc import Sequence

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
