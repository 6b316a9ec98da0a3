"""Bit rates of a recorded bus, from frames that follow each other without a pause.

The times of reception of two such frames differ by the exact transmission time of the second. At
the right rate this holds for many frames and none comes sooner; at a lower rate many come sooner;
at a higher rate no frame follows without a pause.
"""

from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from plant_sim.can_bus.kernel.network import check_rates
from plant_sim.can_bus.traffic.log_reader import Logged, transmission_times

_KBIT: Final = (10, 20, 33.333, 50, 83.333, 100, 125, 250, 500, 800, 1000)
RATES: Final = tuple(round(rate * 1000) for rate in _KBIT)
DATA_RATES: Final = (500_000, 1_000_000, 2_000_000, 4_000_000, 5_000_000, 8_000_000)
"""Candidate rates of arbitration and of FD data, bit/s."""
LEAST_EVIDENCE: Final = 10
"""Least number of frames without a pause as evidence for a rate."""
_TOLERANCE_NS: Final = 2_500
"""Of a difference of two time stamps of whole µs, and bits lost to resynchronisation."""
_TOO_CLOSE: Final = 0.7
"""Share of its length within which no frame can follow, even with inexact time stamps."""


@dataclass(frozen=True, slots=True)
class BitRate:
    """Bit rates of a log, bit/s; ``data`` is 0 without frames with bit-rate switch.

    ``pairs``: frames that followed without a pause, the evidence; 0: the rates were given.
    ``too_close``: share of frames that came sooner than the rates allow.
    """

    nominal: int
    data: int
    pairs: int
    too_close: float


def find_bit_rate(
    logged: Logged, *, bitrate: int | None = None, data_bitrate: int | None = None
) -> BitRate:
    """Return the rates of a channel: those given, the others inferred.

    Raises:
        CanrollError: a rate is neither given nor can be inferred, or is invalid.
    """
    gaps = np.diff(logged.received_ns)
    nominal, data = logged.nominal_bits[1:], logged.data_bits[1:]
    switched = bool((logged.data_bits > 0).any())
    data_rates = (data_bitrate,) if data_bitrate else DATA_RATES if switched else (0,)
    found: tuple[int, int] | None = None
    pairs = 0
    for pair in product((bitrate,) if bitrate else RATES, data_rates):
        count = _evidence(gaps, nominal, data, *pair)
        if count > pairs:
            found, pairs = pair, count
    given = bitrate is not None and (data_bitrate is not None or not switched)
    if bitrate is not None and given:
        found = (bitrate, data_rates[0])
    elif found is not None and switched and data_bitrate is None:
        fast = data > 0
        if _evidence(gaps[fast], nominal[fast], data[fast], *found) == 0:
            raise CanrollError(_missing(logged, "data bit rate", "--data-bitrate"))
    if found is None:
        raise CanrollError(_missing(logged, "bit rate", "--bitrate"))
    check_rates(*found)
    close = gaps < _TOO_CLOSE * transmission_times(nominal, data, *found)
    share = float(close.mean()) if len(close) else 0.0
    return BitRate(*found, 0 if given else pairs, share)


def _missing(logged: Logged, what: str, option: str) -> str:
    return (
        f"channel {logged.channel}: the {what} cannot be inferred, fewer than {LEAST_EVIDENCE}"
        f" frames follow another one without a pause: 'canroll bus' takes {option}"
    )


def _evidence(
    gaps: NDArray[np.int64],
    nominal: NDArray[np.int64],
    data: NDArray[np.int64],
    rate: int,
    data_rate: int,
) -> int:
    """Return the number of frames without a pause at these rates, 0 if they are no evidence."""
    if data_rate and data_rate < rate:
        return 0
    slack = gaps - transmission_times(nominal, data, rate, data_rate)
    sooner = int((slack < -_TOLERANCE_NS).sum())
    exact = int((np.abs(slack) <= _TOLERANCE_NS).sum())
    # as many more as chance brings into a window of that width
    later = int(((slack > _TOLERANCE_NS) & (slack <= 11 * _TOLERANCE_NS)).sum()) // 5
    if exact < LEAST_EVIDENCE + 3 * later or sooner > 0.001 * len(gaps):
        return 0
    return exact
