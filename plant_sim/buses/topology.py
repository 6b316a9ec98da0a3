"""Topology of a network: segments, the gateways between them, and the nodes on them.

A gateway stores and forwards: it takes a frame when it is received on the one segment and queues it
on the other after its latency, frames in the order in which they came.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Final

from canroll.errors import CanrollError

BITRATES: Final = (10_000, 1_000_000)
"""Least and greatest rate of classic CAN, bit/s."""
DATA_BITRATE_MAX: Final = 8_000_000
LATENCY_MAX_NS: Final = 1_000_000_000
NODES: Final = ("RollControl", "Imu", "Chassis", "Suspension", "Actuator", "Reference")
"""Nodes of the bus contract, in the order of their numbers on every network."""


@dataclass(frozen=True, slots=True)
class TimeSpread:
    """A time that differs from frame to frame, ns: uniform in its range, or one of ``samples_ns``.

    Samples are drawn with equal probability; the range is then theirs.
    """

    low_ns: int = 0
    high_ns: int = 0
    samples_ns: tuple[int, ...] = ()

    @classmethod
    def of_samples(cls, samples_ns: tuple[int, ...]) -> "TimeSpread":
        """Return the spread of measured times, of which there is at least one."""
        return cls(min(samples_ns), max(samples_ns), samples_ns)


PUNCTUAL: Final = TimeSpread()
"""No time at all, in every frame."""


@dataclass(frozen=True, slots=True)
class BusSegment:
    """One bus: its rates (bit/s), errors and background.

    ``load`` is the total, our own messages at their cycle times included; background messages fill
    the rest, ``above`` of it with identifiers of higher priority than all of ours. ``traffic``: the
    periodic messages of that file are the background instead. ``data_bitrate`` 0: as ``bitrate``.
    """

    name: str
    bitrate: int
    load: float = 0.5
    above: float = 0.5
    data_bitrate: int = 0
    bit_error_rate: float = 0.0
    traffic: Path | None = None


@dataclass(frozen=True, slots=True)
class BusGateway:
    """Joins two segments, by their numbers, both ways.

    ``messages``: names and identifiers of those that it passes on; None: those of ours whose way to
    a receiver is over it.
    """

    name: str
    segments: tuple[int, int]
    latency: TimeSpread
    messages: tuple[str | int, ...] | None = None


@dataclass(frozen=True, slots=True)
class Topology:
    """Segments, gateways, and our nodes.

    ``places``: number of the segment that a node of ``NODES`` is on, by default the first;
    ``jitter``: time from the nominal instant of a node's frame to its queueing, by default none.
    """

    segments: tuple[BusSegment, ...]
    gateways: tuple[BusGateway, ...] = ()
    places: Mapping[str, int] = field(default_factory=dict)
    jitter: Mapping[str, TimeSpread] = field(default_factory=dict)

    def place(self, node: str) -> int:
        """Return the number of the segment that a node is on."""
        return self.places.get(node, 0)

    def least_jitter_ns(self, node: str) -> int:
        """Return the least time from the nominal instant of a node's frame to its queueing."""
        return self.jitter[node].low_ns if node in self.jitter else 0


def check_segment(what: str, segment: BusSegment) -> None:
    """Refuse an invalid segment; ``what`` names it.

    Raises:
        CanrollError: a figure of it is out of its range.
    """
    low, high = BITRATES
    _check(
        what,
        {
            f"bitrate {segment.bitrate}: it must be {low} to {high} bit/s": isinstance(
                segment.bitrate, int
            )
            and low <= segment.bitrate <= high,
            f"load {segment.load}: it must be above 0 and below 1": 0.0 < segment.load < 1.0,
            f"above {segment.above}: it must be 0 to 1": 0.0 <= segment.above <= 1.0,
            f"data_bitrate {segment.data_bitrate}: it must be 0, or bitrate to "
            f"{DATA_BITRATE_MAX} bit/s": isinstance(segment.data_bitrate, int)
            and (
                not segment.data_bitrate
                or segment.bitrate <= segment.data_bitrate <= DATA_BITRATE_MAX
            ),
            f"bit_error_rate {segment.bit_error_rate}: it must be 0 to below 1": 0.0
            <= segment.bit_error_rate
            < 1.0,
        },
    )


def check_times(what: str, low_ms: float, high_ms: float) -> None:
    """Refuse an invalid range of times; ``what`` names it.

    Raises:
        CanrollError: not in order, or not 0 to 1 s.
    """
    most = LATENCY_MAX_NS * 1e-6
    in_range = isfinite(low_ms) and isfinite(high_ms) and 0.0 <= low_ms <= high_ms <= most
    if not in_range:
        raise CanrollError(f"{what} ({low_ms}, {high_ms}): two times in order, 0 to {most:g} ms")


def _check(what: str, rules: Mapping[str, bool]) -> None:
    for rule, holds in rules.items():
        if not holds:
            raise CanrollError(f"{what}: {rule}")
