"""A residual and its threshold on signals."""

from collections.abc import Iterator, Mapping
from itertools import accumulate
from math import exp

import numpy as np
from numpy.typing import NDArray

from canroll.gain_gen.monitors.bank import STEP, Bank, Residual, ResidualPart, Term
from canroll.gain_gen.monitors.noise import response

Signals = Mapping[str, NDArray[np.float64]]
"""Samples of :data:`canroll.gain_gen.monitors.bank.SIGNALS`, one a tick; missing ones are zero."""


def moved(bank: Bank, residual: Residual, signals: Signals) -> NDArray[np.float64]:
    """Return what signals, or errors of signals, make of a residual from rest, N·m."""
    total = np.zeros(_count(signals))
    for term, part, signal in _parts(bank, residual, signals):
        if term.sign and part.kind != STEP:
            total += term.sign * response(part, signal, bank.tick)
    return total


def room(bank: Bank, residual: Residual, signals: Signals) -> NDArray[np.float64]:
    """Return the threshold above its floor, N·m: it rises at once and fades."""
    size = np.zeros(_count(signals))
    for term, part, signal in _parts(bank, residual, signals):
        if part.kind == STEP:
            size += term.weight * np.abs(np.diff(signal, prepend=signal[:1])).mean()
        else:
            size += term.weight * np.abs(response(part, signal, bank.tick))
    return fading(size, exp(-bank.tick / residual.fading))


def fading(values: NDArray[np.float64], kept: float) -> NDArray[np.float64]:
    """Return the largest of ``values`` so far, of each a share ``kept`` a sample later."""
    return np.array(list(accumulate(values, lambda before, now: max(now, kept * before))))


def _parts(
    bank: Bank, residual: Residual, signals: Signals
) -> Iterator[tuple[Term, ResidualPart, NDArray[np.float64]]]:
    """Yield the terms that the signals are in, with their parts and combined signals."""
    for term in residual.terms:
        part = bank.parts[term.part]
        known = [gain * signals[name] for name, gain in part.gains.items() if name in signals]
        if known:
            yield term, part, np.sum(known, axis=0)


def _count(signals: Signals) -> int:
    return len(next(iter(signals.values())))
