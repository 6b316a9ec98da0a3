"""Result of an analysed network: response times by segment, and the delay over it.

A traffic set is a network of one segment; a log is one with recorded arrivals.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.errors import VerdictError
from canroll.plant_sim.can_bus.bounds.analysis import ResponseBound, worst_case_utilisation
from canroll.plant_sim.can_bus.bounds.delay_bounds import DelayBounds
from canroll.plant_sim.can_bus.traffic.inference import InferredMessage
from canroll.plant_sim.can_bus.traffic.messages import BusMessage

MS = 1e-6
"""One nanosecond in milliseconds."""


class Times(NamedTuple):
    """Least, mean, 99 % quantile and greatest of simulated times, ns; NaN without any."""

    least: float = math.nan
    mean: float = math.nan
    most: float = math.nan
    greatest: float = math.nan

    @classmethod
    def of(cls, times: NDArray[np.int64]) -> "Times":
        """Return the summary of ``times``, ns."""
        if not len(times):
            return cls()
        quantile = float(np.quantile(times, 0.99))
        return cls(float(times.min()), float(times.mean()), quantile, float(times.max()))


@dataclass(frozen=True, slots=True)
class MessageRow:
    """Response times of one message on one segment, nanoseconds.

    ``bound`` and ``response`` (simulated): on this segment; ``arrival_ns`` and ``arrival``: from
    the first sender, over the segments ``way``. Of a recorded message ``evidence`` in the log and
    ``before``, its bound without the added messages; ``assumes``: event-driven messages on whose
    recorded frequency the bound depends.
    """

    bound: ResponseBound
    response: Times
    way: tuple[str, ...]
    arrival_ns: int | None
    arrival: Times
    evidence: InferredMessage | None = None
    before: ResponseBound | None = None
    assumes: tuple[str, ...] = ()

    @property
    def message(self) -> BusMessage:
        """The message as it is queued on this segment."""
        return self.bound.message

    @property
    def bounds(self) -> tuple[ResponseBound, ...]:
        """All bounds on this segment."""
        return (self.bound,) if self.before is None else (self.before, self.bound)

    @property
    def is_late(self) -> bool:
        """Whether a stated deadline is missed; exceeding the period alone does not count."""
        limit = self.message.deadline_ns
        return bool(limit) and self.arrival_ns is not None and self.arrival_ns > limit

    @property
    def longest_ns(self) -> float:
        """Longest recorded or simulated response; NaN without any."""
        if self.evidence is None:
            return self.response.greatest
        return self.evidence.seen_ns or math.nan

    def limit_ns(self, bound: ResponseBound) -> int | None:
        """Return a bound as shown: from the nominal release, of events from their queueing."""
        on_events = self.evidence is not None and self.evidence.assumed
        return bound.queued_ns if on_events else bound.bound_ns


@dataclass(frozen=True, slots=True)
class SegmentAnswer:
    """One bus: its bit rates in bit/s, and its messages, the most urgent first.

    ``load``: simulated, 0 to 1, None if not simulated, in ``frames`` delivered frames.
    """

    name: str
    bitrate: int
    data_bitrate: int
    rows: Sequence[MessageRow]
    load: float | None
    frames: int

    @property
    def utilisation(self) -> float:
        """Load with the longest frames, 0 to 1 or more."""
        return self._utilisation(self.rows)

    @property
    def utilisation_before(self) -> float:
        """Load of the recorded messages with their longest frames."""
        return self._utilisation([row for row in self.rows if row.evidence is not None])

    @property
    def kilobits(self) -> str:
        """Bit rates in kbit/s."""
        data = f" and {self.data_bitrate / 1000:g}" if self.data_bitrate else ""
        return f"{self.bitrate / 1000:g}{data}"

    def _utilisation(self, rows: Sequence[MessageRow]) -> float:
        messages = [row.message for row in rows]
        return worst_case_utilisation(
            messages, bitrate=self.bitrate, data_bitrate=self.data_bitrate
        )


class LoopNames(NamedTuple):
    """Names of a control loop's messages, and its tick in ms."""

    sensor: str
    command: str
    tick_ms: float


@dataclass(frozen=True, slots=True)
class PathDelay:
    """Bounds of the total delay, and the simulated ages, ns.

    Without bounds ``reason`` gives the cause; ``failed``: the network has none, not only this
    analysis.
    """

    bounds: DelayBounds | None
    age: Times
    reason: str = ""
    failed: bool = False


@dataclass(frozen=True, slots=True)
class Answer:
    """Results of the network ``name``.

    ``added``: what came onto a recorded bus. ``notes``: lines on this network, ``facts``: keys of
    its JSON object, in addition to those of the analysis.
    """

    name: str
    segments: tuple[SegmentAnswer, ...]
    loop: LoopNames
    delay: PathDelay | None
    head: str = ""
    added: str = ""
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)

    def rows(self) -> Iterator[tuple[str, MessageRow]]:
        """Yield every row with a name for its message and, if there are several, the segment."""
        several = len(self.segments) > 1
        for segment in self.segments:
            for row in segment.rows:
                name = row.message.name if row.evidence is None else f"{row.message.ident:X}"
                yield f"{name} on {segment.name}" if several else name, row

    @property
    def failed(self) -> bool:
        """Whether a message has no bound for a reason of the network, or a deadline is missed."""
        rows = [row for _, row in self.rows()]
        unbounded = any(b.bound_ns is None and b.covered for row in rows for b in row.bounds)
        late = any(row.is_late for row in rows)
        no_delay = self.delay is not None and self.delay.failed
        return unbounded or late or no_delay

    def check(self) -> None:
        """Reject a bound that the simulation exceeds.

        Raises:
            VerdictError: it does.
        """
        for name, row in self.rows():
            if row.evidence is not None:
                continue
            for greatest, limit in (
                (row.response.greatest, row.bound.bound_ns),
                (row.arrival.greatest, row.arrival_ns),
            ):
                if limit is not None and greatest > limit:
                    raise VerdictError(
                        f"{name}: simulated response {greatest * MS:.3f} ms above its bound"
                        f" {limit * MS:.3f} ms"
                    )
        if self.delay is None or self.delay.bounds is None:
            return
        # simulated times are whole ns, the bound is a float of seconds: equal ones may differ there
        age, limit_s = self.delay.age.greatest, self.delay.bounds.age_max
        if age > round(limit_s * 1e9):
            raise VerdictError(
                f"simulated age {age * MS:.3f} ms above its bound {limit_s * 1e3:.3f} ms"
            )
