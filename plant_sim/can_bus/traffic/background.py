# ruff: noqa: PLR0917
"""Background traffic: periodic messages that bring a bus to a given total load."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from canroll.errors import CanrollError
from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.wire.frame import duration_ns, frame_bits
from plant_sim.kernels.random import random_bits

MS: Final = 1_000_000
PERIODS_ABOVE_MS: Final = (10, 10, 20)
PERIODS_BELOW_MS: Final = (20, 50, 100)
"""Periods the generated messages take in turn: the urgent ones are the frequent ones."""
_SAMPLES: Final = 32
_SMALLEST_SHARE: Final = 0.02


def mean_frame_ns(ident: int, length: int, bitrate: int, *, seed: int = 0) -> float:
    """Return the mean time of a frame with random payload, interframe space included (ns)."""
    payload = np.zeros(8, np.uint8)
    total = 0
    for sample in range(_SAMPLES):
        bits = int(random_bits(seed, ident, sample))
        payload[:] = np.frombuffer(bits.to_bytes(8, "little"), np.uint8)
        total += frame_bits(ident, 0, length, payload)[0]
    return float(duration_ns(total, bitrate)) / _SAMPLES


def utilisation(messages: Sequence[BusMessage], bitrate: int) -> float:
    """Return the mean share of time that periodic messages keep the bus busy."""
    return sum(mean_frame_ns(m.ident, m.length, bitrate) / m.period_ns for m in messages)


def background_messages(
    own: Sequence[BusMessage],
    *,
    node: str,
    bitrate: int,
    load: float,
    above: float = 0.5,
    seed: int = 0,
) -> list[BusMessage]:
    """Return periodic messages that fill a bus up to ``load``.

    Args:
        own: messages that are on the bus anyway; their mean load counts towards ``load``.
        node: name of the sending node.
        bitrate: of the bus, bit/s.
        load: wanted total, 0 to 1.
        above: share of the background with identifiers below all of ``own`` (higher priority).
        seed: of the offsets.

    Raises:
        CanrollError: ``load`` is above 1 or less than what ``own`` takes.
    """
    taken = utilisation(own, bitrate)
    if not 0.0 < load < 1.0 or not 0.0 <= above <= 1.0:
        raise CanrollError(f"bus load {load}, share above {above}: both must be from 0 to 1")
    if taken > load:
        raise CanrollError(
            f"the controller's messages take {taken:.0%} of {bitrate} bit/s, above the requested "
            f"load of {load:.0%}: raise the bit rate or the load"
        )
    used = {message.ident for message in own}
    highest = [i for i in range(0x10, min(used, default=0x400)) if i not in used]
    lowest = [i for i in range(max(used, default=0x400) + 1, 0x700) if i not in used]
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
    chosen = np.linspace(0, len(idents) - 1, len(periods) + 2)[1:-1].astype(int)
    order = np.argsort(periods, kind="stable")
    messages = []
    for place, index in zip(chosen, order, strict=True):
        ident = idents[int(place)]
        # the period makes up for this identifier's own stuff bits
        period = periods[int(index)] * mean_frame_ns(ident, 8, bitrate) / frame
        offset = int(random_bits(seed, ident, 1 << 20)) % int(period)
        messages.append(
            BusMessage(f"Background{ident:03X}", ident, 8, period, node, offset_ns=offset)
        )
    return messages
