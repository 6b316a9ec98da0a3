# ruff: noqa: PLR0917
"""Background traffic: periodic messages that bring a bus to a given total load."""

from collections.abc import Sequence
from functools import cache
from typing import Final

import numpy as np

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.plant_sim.can_bus.wire.frame import EXTENDED, frame_bits, transmission_ns
from canroll.plant_sim.kernels.instants import MS
from canroll.plant_sim.kernels.jit import interpreted
from canroll.plant_sim.kernels.random import random_bits

PERIODS_ABOVE_MS: Final = (10, 10, 20)
PERIODS_BELOW_MS: Final = (20, 50, 100)
"""Periods of the generated messages, in turn: urgent messages are the frequent ones."""
_SAMPLES: Final = 32
_random_bits, _frame_bits = interpreted(random_bits), interpreted(frame_bits)
_SMALLEST_SHARE: Final = 0.02


def _random(seed: int, ident: int, counter: int) -> int:
    with np.errstate(over="ignore"):
        return int(_random_bits(seed, ident, counter))


def mean_frame_ns(ident: int, length: int, bitrate: int, *, seed: int = 0) -> float:
    """Return the mean time of a classic frame with random payload and interframe space (ns)."""
    return _mean_ns(ident, 0, length, bitrate, 0, seed)


@cache
def _mean_ns(
    ident: int, flags: int, length: int, bitrate: int, data_bitrate: int, seed: int
) -> float:
    words = max(-(-length // 8), 1)
    nominal = data = 0
    for sample in range(_SAMPLES):
        drawn = [_random(seed, ident, sample * words + k) for k in range(words)]
        payload = np.array(drawn, np.uint64).view(np.uint8)
        slow, fast = _frame_bits(ident, flags, length, payload)
        nominal, data = nominal + int(slow), data + int(fast)
    time = transmission_ns((nominal, data), bitrate=bitrate, data_bitrate=data_bitrate)
    return float(time) / _SAMPLES


def utilisation(messages: Sequence[BusMessage], bitrate: int, data_bitrate: int = 0) -> float:
    """Return the mean bus load of periodic messages, 0 to 1 or more."""
    return sum(
        _mean_ns(m.ident, m.flags, m.length, bitrate, data_bitrate, 0) / m.period_ns
        for m in messages
    )


def _priority(message: BusMessage) -> int:
    """The identifier of 11 bits that wins and loses against the same ones, but for its equal."""
    return message.ident >> 18 if message.flags & EXTENDED else message.ident


def background_messages(
    own: Sequence[BusMessage],
    *,
    node: str,
    bitrate: int,
    load: float,
    above: float = 0.5,
    seed: int = 0,
    data_bitrate: int = 0,
) -> list[BusMessage]:
    """Return periodic messages that bring a bus to the total ``load``.

    Args:
        own: messages already on the bus; their mean load is part of ``load``.
        node: name of the sending node.
        bitrate: of the bus, bit/s.
        load: total load, 0 to 1.
        above: share of the background with identifiers below all of ``own`` (higher priority).
        seed: of the offsets.
        data_bitrate: of FD frames among ``own``, bit/s.

    Raises:
        CanrollError: ``load`` is above 1 or less than what ``own`` takes.
    """
    taken = utilisation(own, bitrate, data_bitrate)
    if not 0.0 < load < 1.0 or not 0.0 <= above <= 1.0:
        raise CanrollError(f"bus load {load}, share above {above}: both must be from 0 to 1")
    if taken > load:
        raise CanrollError(
            f"the controller's messages take {taken:.0%} of {bitrate} bit/s, above the requested "
            f"load of {load:.0%}: raise the bit rate or the load"
        )
    used = {_priority(message) for message in own}
    highest = [i for i in range(0x10, min(used, default=0x400)) if i not in used]
    lowest = [i for i in range(max(used, default=0x400) + 1, 0x700) if i not in used]
    if not highest or not lowest:
        # identifiers of our own at one end leave the other end alone for all others
        above = 0.0 if lowest else 1.0
    messages: list[BusMessage] = []
    for share, idents, periods_ms in (
        (above, highest, PERIODS_ABOVE_MS),
        (1.0 - above, lowest, PERIODS_BELOW_MS),
    ):
        messages += _fill((load - taken) * share, idents, periods_ms, node, bitrate, seed)
    return messages


def _fill(
    load: float,
    idents: list[int],
    periods_ms: tuple[int, ...],
    node: str,
    bitrate: int,
    seed: int,
) -> list[BusMessage]:
    """Spread messages of 8 bytes over ``idents`` that together take ``load``."""
    if load <= 0.0:
        return []
    frame = mean_frame_ns(idents[len(idents) // 2], 8, bitrate)
    periods: list[float] = []
    left = load
    while left > 1e-9:
        period = float(periods_ms[len(periods) % len(periods_ms)] * MS)
        share = frame / period
        if share > left or left - share < _SMALLEST_SHARE * load:
            # the last message takes what is left, exactly
            period = frame / left
        periods.append(period)
        left -= frame / period
    if len(periods) > len(idents):
        raise CanrollError(
            f"no {len(periods)} identifiers are free for the background traffic: lower the load"
        )
    chosen = np.linspace(0, len(idents) - 1, len(periods) + 2)[1:-1].astype(int)
    order = np.argsort(periods, kind="stable")
    messages = []
    for place, index in zip(chosen, order, strict=True):
        ident = idents[int(place)]
        # the period makes up for this identifier's own stuff bits
        period = periods[int(index)] * mean_frame_ns(ident, 8, bitrate) / frame
        offset = _random(seed, ident, 1 << 20) % int(period)
        messages.append(
            BusMessage(f"Background{ident:03X}", ident, 8, period, node, offset_ns=offset)
        )
    return messages
