"""What noise and road alone make of a residual: the floor of its threshold."""

from collections.abc import Mapping, Sequence
from math import log, pi, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from canroll import dbc
from canroll.gain_gen.monitors.bank import (
    DERIVATIVE,
    DIRECT,
    INTEGRAL,
    STEP,
    ResidualPart,
    Term,
    ticks_of,
)
from canroll.gain_gen.monitors.uncertainty import Uncertainty
from canroll.vehicles import Vehicle
from canroll.vehicles.equipment import SensorChannel

OF_STEPS = sqrt(pi / 2.0)
"""Standard deviation of steps by their mean magnitude: a lost sample is wrong by a step."""
MEAN_STEP = 2.0 / sqrt(pi)
"""Mean magnitude of the steps of white noise by its standard deviation."""
FASTEST = 30.0
"""Speed at which yaw rate becomes lateral acceleration, m/s: the largest of the fault-free runs."""


def level(alarms_per_hour: float, memory: float, low_pass: float) -> float:
    """Return the level that a filtered noise exceeds at this rate, in standard deviations.

    By Rice's formula: white noise between a high-pass of time constant ``memory`` and a low-pass
    ``low_pass`` (s) crosses zero upwards 1 / (2π √(memory low_pass)) times a second, and a level of
    z standard deviations exp(−z²/2) as often, on each side.
    """
    crossings = 3600.0 / (2.0 * pi * sqrt(memory * low_pass))
    return sqrt(2.0 * log(max(2.0 * crossings / alarms_per_hour, 2.0)))


def deviations(vehicle: Vehicle, box: Uncertainty) -> dict[str, float]:
    """Return the standard deviation of one sample of each signal, with its frame's resolution."""
    sensors = vehicle.sensors

    def sample(channel: SensorChannel, message: str, signal: str, unit: float = 1.0) -> float:
        white = box.noise * channel.deviation
        return float(np.hypot(white, unit * _resolution(message, signal) / sqrt(12.0)))

    degree = pi / 180.0
    stroke = sqrt(2.0) * sample(sensors.suspension_rate, "SuspensionRate", "RateFrontLeft", 1e-3)
    yaw = sample(sensors.yaw_rate, "Imu", "YawRate", degree)
    return {
        **dict.fromkeys(("stroke_front", "stroke_rear", "heave_front", "heave_rear"), stroke),
        "lateral": sample(sensors.lateral_acceleration, "Imu", "LateralAcceleration"),
        "roll_rate": sample(sensors.roll_rate, "Imu", "RollRate", degree),
        "yaw_rate": yaw,
        "turning": FASTEST * yaw,
    }


def _resolution(message: str, signal: str) -> float:
    return float(dbc.message(message).get_signal_by_name(signal).scale)


def offsets(vehicle: Vehicle, box: Uncertainty) -> dict[str, float]:
    """Return the largest offset of each signal."""
    sensors = vehicle.sensors

    def largest(channel: SensorChannel) -> float:
        return box.bias * (channel.bias + channel.bias_per_kelvin * box.temperature)

    stroke = 2.0 * largest(sensors.suspension_rate)
    return {
        **dict.fromkeys(("stroke_front", "stroke_rear", "heave_front", "heave_rear"), stroke),
        "lateral": largest(sensors.lateral_acceleration),
        "roll_rate": largest(sensors.roll_rate),
        "turning": FASTEST * largest(sensors.yaw_rate),
    }


def response(part: ResidualPart, signal: NDArray[np.float64], tick: float) -> NDArray[np.float64]:
    """Return what a part makes of samples of its combined signal (N·m), from rest."""
    weight, share = tick / part.low_pass, 1.0 / part.memory(tick)
    slow = lfilter([weight], [1.0, weight - 1.0], signal)
    if part.kind == INTEGRAL:
        return np.asarray(lfilter([0.0, tick * (1.0 - share)], [1.0, share - 1.0], slow))
    kept = signal - slow if part.kind == DERIVATIVE else slow
    return np.asarray(lfilter([1.0, -1.0], [1.0, share - 1.0], kept) if share else kept)


def floor(
    parts: Mapping[str, ResidualPart],
    terms: Sequence[Term],
    *,
    vehicle: Vehicle,
    box: Uncertainty,
    tick: float,
    time: float,
) -> float:
    """Return what noise and offsets make of a residual for ``time`` s without a break, N·m.

    A residual that stays beyond a level so long has a mean beyond it: its standard deviation is
    that of the mean.
    """
    summed = [parts[term.part] for term in terms if term.sign]
    signs = {term.part: term.sign for term in terms}
    memory = max([part.memory(tick) * tick for part in summed if part.washout], default=1.0)
    length = max(200, min(20_000, round(5.0 * memory / tick)))
    window = ticks_of(time, tick)
    sigma, offset = deviations(vehicle, box), offsets(vehicle, box)
    variance = largest = 0.0
    impulse = np.zeros(length)
    impulse[0] = 1.0
    shapes = {part.name: response(part, impulse, tick) for part in summed}
    for signal in sorted({name for part in summed for name in part.gains}):
        of_signal = sum(
            (signs[p.name] * p.gains.get(signal, 0.0) * shapes[p.name] for p in summed),
            np.zeros(length),
        )
        mean = np.convolve(of_signal, np.full(window, 1.0 / window))
        variance += sigma.get(signal, 0.0) ** 2 * float(mean @ mean)
        if not all(part.washout and part.kind == DIRECT for part in summed if signal in part.gains):
            largest += offset.get(signal, 0.0) * abs(float(of_signal.sum()))
    passes = max(part.low_pass for part in summed)
    return level(box.alarms_per_hour, memory, passes) * sqrt(variance) + largest


def raised(
    parts: Mapping[str, ResidualPart],
    terms: Sequence[Term],
    *,
    vehicle: Vehicle,
    box: Uncertainty,
    tick: float,
    fading: float,
) -> float:
    """Return what noise alone adds to a threshold by its terms, N·m.

    A threshold that fades in ``fading`` s holds what noise exceeds once in that time.
    """
    sigma, total = deviations(vehicle, box), 0.0
    for term in terms:
        part = parts[term.part]
        size = sqrt(sum((gain * sigma.get(name, 0.0)) ** 2 for name, gain in part.gains.items()))
        if part.kind == STEP:
            total += term.weight * MEAN_STEP * size
            continue
        memory = part.memory(tick) * tick if part.washout else 1.0
        impulse = np.zeros(max(200, min(20_000, round(5.0 * memory / tick))))
        impulse[0] = size
        passed = float(np.linalg.norm(response(part, impulse, tick)))
        total += term.weight * passed * level(3600.0 / fading, memory, part.low_pass)
    return total


def late(box: Uncertainty, tick: float, washout: float) -> float:
    """Return how far an integral walks for samples that are lost, per mean step, s."""
    part = ResidualPart("", INTEGRAL, {}, washout)
    return walk(part, box, tick, OF_STEPS * sqrt(box.late))


def walk(part: ResidualPart, box: Uncertainty, tick: float, sigma: float) -> float:
    """Return how far an integral walks at random, N·m per N·m/s of the mean step of its integrand.

    ``sigma`` is the standard deviation of what wrongly counts in a tick, by that mean step. The
    walk is forgotten by the washout: of its variance a share of 2 ticks over its memory is lost and
    gained in a tick.
    """
    memory = part.memory(tick)
    height = level(box.alarms_per_hour, memory * tick, part.low_pass)
    return height * sigma * sqrt(memory / 2.0) * tick
