"""Phase lock of the ECU's ticks to the sensor's frames, with drifting clocks.

A frame can be late because the bus was busy, but never early: the earliest arrivals within the
sensor's cycle give its clock. The estimate follows an earlier arrival at once, within a limit, and
slowly follows later ones, so that it neither jumps for a delayed frame nor loses a slow clock. If
arrivals are irregular, as through a gateway with random delays, there is no clock to lock to.
"""

ACQUIRE = 12
"""Number of frames for the first estimate."""
REGULAR = 0.3
"""Fraction of the cycle within which they must arrive."""
CREEP_NS = 2_000
"""Shift of the estimate to later times per frame: 200 ppm at a frame every 10 ms."""
PULL_NS = 50_000
"""Largest shift of the estimate to earlier times per frame."""
SLEW_NS = 100_000
"""Largest shift of a deadline per tick, once the phase has been found."""


class PhaseLock:
    """Ticks at ``phase_ns`` after the earliest arrivals, modulo ``cycle_ns``.

    Attributes:
        locked: whether the phase has been found.
    """

    def __init__(self, *, phase_ns: int, cycle_ns: int) -> None:
        self.locked = False
        self._phase, self._cycle = phase_ns, cycle_ns
        self._first: list[int] = []
        self._earliest = 0
        self._jump = False

    def arrived(self, t_ns: int) -> None:
        """Process the arrival time of a sensor's frame."""
        if self.locked:
            late = self._wrapped(t_ns - self._earliest)
            self._earliest += max(min(late, CREEP_NS), -PULL_NS)
            return
        self._first.append(t_ns)
        if len(self._first) == ACQUIRE:
            late_by = [self._wrapped(arrival - t_ns) for arrival in self._first]
            if max(late_by) - min(late_by) <= REGULAR * self._cycle:
                self._earliest = t_ns + min(late_by)
                self.locked = self._jump = True
            self._first = []

    def correction(self, deadline_ns: int) -> int:
        """Return the shift of the next deadline, ns: at first the whole error, then small steps."""
        if not self.locked:
            return 0
        wanted = self._wrapped(self._earliest + self._phase - deadline_ns)
        if self._jump:
            self._jump = False
            return wanted % self._cycle
        return max(-SLEW_NS, min(wanted, SLEW_NS))

    def _wrapped(self, difference: int) -> int:
        half = self._cycle // 2
        return (difference + half) % self._cycle - half
