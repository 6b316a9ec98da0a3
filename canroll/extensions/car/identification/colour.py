"""The colour of residuals: correlation over time, within a signal and between signals.

Autocovariances up to :data:`LONGEST`, tapered by Bartlett's window, by which every spectrum that
they make is positive (Klein and Morelli, Aircraft System Identification, 5.4: covariance of output
error estimates with coloured residuals).
"""

import numpy as np
from numpy.typing import NDArray

from canroll.extensions.car.identification.agreement import autocorrelation
from canroll.extensions.car.identification.pieces import SAMPLE
from canroll.typing import Vector

LONGEST = 1.0
"""Longest lag (s): a period of the slowest mode of a car."""


def _lags(count: int) -> int:
    return min(round(LONGEST / SAMPLE), max(count // 4, 1))


def covariances(errors: NDArray[np.float64], compared: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return tapered covariances between signals, (2 k + 1, m, m), from lag −k to k samples.

    Args:
        errors: residuals (n, m), 0 where nothing is compared.
        compared: which count, (n, m).
    """
    most = _lags(len(errors))
    counts = np.sqrt(np.maximum(compared.sum(axis=0), 1))
    scaled = errors / counts
    result = np.empty((2 * most + 1, errors.shape[1], errors.shape[1]))
    for lag in range(most + 1):
        taper = 1.0 - lag / (most + 1)
        product = scaled[lag:].T @ scaled[: len(scaled) - lag]
        result[most + lag] = taper * product
        result[most - lag] = taper * product.T
    return result


def correlation_times(errors: NDArray[np.float64], compared: NDArray[np.bool_]) -> Vector:
    """Return for each signal how many samples count as one independent one, at least 1."""
    tapered = np.diagonal(covariances(errors, compared), axis1=1, axis2=2)
    middle = len(tapered) // 2
    variance = np.maximum(tapered[middle], 1e-300)
    return np.asarray(np.maximum(tapered.sum(axis=0) / variance, 1.0))


def misfit_covariance(
    weighted: NDArray[np.float64], errors: NDArray[np.float64], compared: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return what a misfit m of the model in the residuals adds to the covariance of the scores.

    Unlike noise it comes with the manoeuvre and does not average out: of Σ weightedᵀ m no more is
    known than the bound of Cauchy and Schwarz, |weighted| |m|, in every direction. The misfit is
    what residuals that are not white have in common from a sample to the next, as noise has not.

    Args:
        weighted: derivatives over the squared scale, (n, m, p), 0 where nothing is compared.
        errors: residuals (n, m).
        compared: which count.
    """
    result = np.zeros((weighted.shape[2],) * 2)
    for signal, of_signal in enumerate(errors.T):
        own, white = autocorrelation(of_signal, compared[:, signal])
        if not white:
            squares = max(own[1], 0.0) * float(of_signal @ of_signal)
            result += squares * weighted[:, signal].T @ weighted[:, signal]
    return result


def score_covariance(
    weighted: NDArray[np.float64], errors: NDArray[np.float64], compared: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return the covariance of Σ weightedᵀ · noise for noise as coloured as the residuals.

    Args:
        weighted: derivatives over the squared scale, (n, m, p), 0 where nothing is compared.
        errors: residuals (n, m).
        compared: which count.
    """
    tapered = covariances(errors, compared)
    count, signals, size = weighted.shape
    most = len(tapered) // 2
    length = 1 << int(np.ceil(np.log2(count + most)))
    spectra = np.fft.rfft(weighted, length, axis=0)
    wrapped = np.zeros((length, signals, signals))
    wrapped[: most + 1] = tapered[most:]
    if most:
        wrapped[-most:] = tapered[:most]
    noise = np.fft.rfft(wrapped, axis=0)
    filtered = np.einsum("fab,fbp->fap", noise, spectra)
    result = np.zeros((size, size))
    back = np.fft.irfft(filtered, length, axis=0)[:count]
    for signal in range(signals):
        result += weighted[:, signal].T @ back[:, signal]
    return 0.5 * (result + result.T)
