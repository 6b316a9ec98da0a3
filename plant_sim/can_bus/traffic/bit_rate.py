"""Bit rates of a recorded bus, from frames that follow each other without a pause.

The times of reception of two such frames differ by the exact transmission time of the second. At
the right rate this holds for many frames and none comes sooner; at a lower rate many come sooner;
at a higher rate no frame follows without a pause.

On a bus that says little no frame follows so, or too few. Then a usual rate is assumed at which no
frame comes sooner than it can. Coarse time stamps are no evidence, whatever they say.
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
USUAL_RATES: Final = (500_000, 250_000, 1_000_000, 125_000)
USUAL_DATA_RATES: Final = (2_000_000, 5_000_000, 4_000_000, 8_000_000)
"""What is assumed without evidence, the first that can be: the rates of SAE J2284-3 to -5 for
passenger cars (500 kbit/s, FD data 2 and 5 Mbit/s), then those of other buses."""
LEAST_EVIDENCE: Final = 10
"""Least number of frames without a pause as evidence for a rate."""
_TOLERANCE_NS: Final = 2_500
"""Of a difference of two time stamps of whole µs, and bits lost to resynchronisation."""
_FINE_NS: Final = 50_000
"""Coarsest resolution of time stamps that are evidence: less than the shortest frame lasts."""
_COARSEST_NS: Final = 1_000_000
"""Coarsest resolution of time stamps, that of a .trc of version 1.0."""
_SLOWEST: Final = 0.995
"""By which share of its length a frame can be shorter: the clocks of ISO 11898-1."""
_SOONER: Final = 0.001
"""Share of frames that may come sooner than a rate allows."""
_TOO_CLOSE: Final = 0.7
"""Share of its length within which no frame can follow, even with inexact time stamps."""


@dataclass(frozen=True, slots=True)
class BitRate:
    """Bit rates of a log, bit/s; ``data`` is 0 without frames with bit-rate switch.

    ``pairs``: frames that followed without a pause, the evidence; 0: given or assumed.
    ``too_close``: share of frames that came sooner than the rates allow. ``assumed``: which rates
    are usual ones without evidence, of "bitrate" and "data_bitrate"; ``other``: further usual
    bit rates that the log does not contradict.
    """

    nominal: int
    data: int
    pairs: int
    too_close: float
    assumed: tuple[str, ...] = ()
    other: tuple[int, ...] = ()

    @property
    def assumption(self) -> str:
        """What is assumed, in a line; empty if nothing is."""
        rates = {
            "bitrate": f"{self.nominal / 1000:g} kbit/s",
            "data_bitrate": f"{self.data / 1000:g} kbit/s for the data of FD frames",
        }
        if not self.assumed:
            return ""
        text = " and ".join(rates[name] for name in self.assumed)
        other = ", ".join(f"{rate / 1000:g}" for rate in sorted(self.other))
        return (
            f"{text} assumed, too few frames follow another without a pause"
            + (f" (as possible: {other} kbit/s)" if other else "")
            + f": to state the true rate add it to the file's name, as {_name_end(self)}"
        )


def find_bit_rate(
    logged: Logged, *, bitrate: int | None = None, data_bitrate: int | None = None
) -> BitRate:
    """Return the rates of a channel: those given, the others inferred or assumed.

    Raises:
        CanrollError: a rate is neither given nor can be inferred or assumed, or is invalid.
    """
    gaps = np.diff(logged.received_ns)
    nominal, data = logged.nominal_bits[1:], logged.data_bits[1:]
    switched = bool((logged.data_bits > 0).any())
    given = (bitrate or 0, (data_bitrate or 0) if switched else 0)
    stamp = int(np.gcd.reduce(logged.received_ns)) if len(gaps) else 0
    pairs = 0
    rates: tuple[int, int] | None = None
    if bitrate is not None and (data_bitrate is not None or not switched):
        rates = given
    elif stamp <= _FINE_NS:
        rates, pairs = _inferred(gaps, nominal, data, given, switched=switched)
    assumed: tuple[str, ...] = ()
    other: tuple[int, ...] = ()
    if rates is None or (switched and not rates[1]):
        known = (given[0] or (rates[0] if rates else 0), given[1])
        assumed = tuple(
            name
            for name, rate, needed in (
                ("bitrate", known[0], True),
                ("data_bitrate", known[1], switched),
            )
            if needed and not rate
        )
        tolerance = min(max(stamp, _TOLERANCE_NS), _COARSEST_NS)
        fits = [
            pair
            for pair in product(
                (known[0],) if known[0] else USUAL_RATES,
                (known[1],) if known[1] or not switched else USUAL_DATA_RATES,
            )
            if not 0 < pair[1] < pair[0]
            and _sooner(gaps, nominal, data, pair, tolerance) <= _SOONER * len(gaps)
        ]
        if not fits:
            raise CanrollError(_missing(logged.channel, assumed, known))
        rates = fits[0]
        other = tuple(dict.fromkeys(rate for rate, _ in fits if rate != rates[0]))
    check_rates(*rates)
    close = gaps < _TOO_CLOSE * transmission_times(nominal, data, *rates)
    share = float(close.mean()) if len(close) else 0.0
    return BitRate(*rates, pairs, share, assumed, other)


def _inferred(
    gaps: NDArray[np.int64],
    nominal: NDArray[np.int64],
    data: NDArray[np.int64],
    given: tuple[int, int],
    *,
    switched: bool,
) -> tuple[tuple[int, int] | None, int]:
    """Return the rates with most evidence, of data 0 if it is not of FD frames, and how much."""
    data_rates = (given[1],) if given[1] else DATA_RATES if switched else (0,)
    best: tuple[int, int] | None = None
    pairs = 0
    for pair in product((given[0],) if given[0] else RATES, data_rates):
        count = _evidence(gaps, nominal, data, *pair)
        if count > pairs:
            best, pairs = pair, count
    if best is not None and switched and not given[1]:
        fast = data > 0
        if _evidence(gaps[fast], nominal[fast], data[fast], *best) == 0:
            return (best[0], 0), pairs
    return best, pairs


def _missing(channel: str, names: tuple[str, ...], known: tuple[int, int]) -> str:
    words = {"bitrate": "bit rate", "data_bitrate": "data bit rate"}
    what = " and the ".join(words[name] for name in names)
    rates = BitRate(
        known[0] or USUAL_RATES[0],
        known[1] or (USUAL_DATA_RATES[0] if "data_bitrate" in names else 0),
        0,
        0.0,
    )
    values = {"bitrate": rates.nominal, "data_bitrate": rates.data}
    options = " ".join(f"--{name.replace('_', '-')} {values[name]}" for name in names)
    return (
        f"channel {channel}: the {what} cannot be inferred, frames come sooner than any usual rate"
        f" allows (times of a driver?): add {options} to 'canroll bus', or {_name_end(rates)} to"
        " the file's name, with the rate of that bus"
    )


def _name_end(rates: BitRate) -> str:
    return f"@{rates.nominal}" + (f"/{rates.data}" if rates.data else "")


def _sooner(
    gaps: NDArray[np.int64],
    nominal: NDArray[np.int64],
    data: NDArray[np.int64],
    rates: tuple[int, int],
    tolerance: int,
) -> int:
    """Return the number of frames that come sooner than they can after all those before them."""
    excess = np.cumsum(_SLOWEST * transmission_times(nominal, data, *rates) - gaps)
    since = np.minimum.accumulate(np.r_[0.0, excess])[:-1]
    return int((excess - since > tolerance).sum())


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
    if exact < LEAST_EVIDENCE + 3 * later or sooner > _SOONER * len(gaps):
        return 0
    return exact
