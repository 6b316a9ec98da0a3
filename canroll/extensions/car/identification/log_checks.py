"""Slips of a log that a fit would hide in its numbers: reversed signs, wrong units, no excitation.

Steering, speed, yaw rate and lateral acceleration check each other by kinematics: a_y ≈ v r, and
r ≈ v δ / (l + K v²) of the car where the fit starts. Other signals are compared with that car's,
and without yaw rate all.
"""

from collections.abc import Iterator, Mapping
from math import degrees, inf
from math import log as natural
from typing import NamedTuple

import numpy as np

from canroll.errors import CanrollError
from canroll.extensions.car.identification.drive_log import QUANTITIES, Log
from canroll.extensions.car.identification.output_error import Model
from canroll.extensions.car.identification.pieces import SAMPLE
from canroll.typing import Vector
from canroll.vehicles import GRAVITY, Vehicle

LEAST_ACCELERATION = 0.3
"""RMS of the lateral acceleration (m/s²) below which road and sensors bring as much as steering."""
NEAR = natural(2.5)
"""A slip changes a ratio by more; another car than the one at the start by less."""
SAME = natural(1.6)
"""The same for signals of one motion, whatever the car."""
ALIKE = 1e-6
"""Distances that differ by less are one: rounding."""
RELATED = 0.5
"""Correlation below which two signals have nothing to do with each other."""
LAG = 0.1
"""Largest delay between signals (s) of which a sign is told."""
RADIAN = degrees(1.0)
UNITS = {
    "rate": ("deg/s", "rad/s", RADIAN),
    "angle": ("deg", "rad", RADIAN),
    "length": ("mm", "m", 1e3),
    "acceleration": ("m/s2", "g", GRAVITY),
}
"""By the kind of a signal the unit of larger numbers, that of smaller ones, and their ratio."""


class _Slip(NamedTuple):
    """One signal times ``factor``, in words, and the unit that it then has."""

    signal: str
    factor: float
    words: str
    unit: str = ""


def _slips(ratio: float) -> Iterator[_Slip]:
    for signal in ("yaw_rate", "lateral_acceleration", "steering"):
        yield _Slip(signal, -1.0, "its sign is reversed")
    for signal, factor, large, small in (
        ("yaw_rate", RADIAN, "deg/s", "rad/s"),
        ("steering", RADIAN, "deg", "rad"),
        ("lateral_acceleration", GRAVITY, "m/s2", "g"),
        ("speed", 3.6, "km/h", "m/s"),
    ):
        yield _Slip(signal, factor, f"{factor:.2g} times too large", large)
        yield _Slip(signal, 1.0 / factor, f"{factor:.2g} times too small", small)
    words = f"{ratio:.3g} times too small: it is the angle at the road wheels, not at the wheel"
    yield _Slip("steering", 1.0 / ratio, words)


def check(log: Log, model: Model) -> None:
    """Refuse a log whose signals cannot be those of a driven car.

    Raises:
        CanrollError: no excitation, or slips: one line with the remedy of each.
    """
    lateral = np.std(excitation(log, model))
    # before the excitation, which a slip may hide
    if named := slips(log, model):
        raise CanrollError(f"{log.name}: {'; '.join(named)}")
    check_steering(log, model)
    if lateral < LEAST_ACCELERATION:
        raise CanrollError(
            f"{log.name}: no excitation: lateral acceleration of {lateral:.2g} m/s² RMS "
            f"tells nothing of the car; {LEAST_ACCELERATION:g} are needed: steer, or choose "
            "another part by --from and --to"
        )


def excitation(log: Log, model: Model) -> Vector:
    """Return the lateral acceleration (m/s²) where all signals are compared.

    Raises:
        CanrollError: they are for less than a second.
    """
    signals = _signals(model)
    if signals["speed"].size * SAMPLE < 1.0:
        raise CanrollError(f"{log.name}: less than 1 s that has all signals and counts")
    return _accelerations(model.vehicle, signals)[0]


def check_steering(log: Log, model: Model) -> None:
    """Check that a car with a table of its steering has it wherever the log steers.

    Raises:
        CanrollError: the log steers beyond the table.
    """
    tables = model.vehicle.axles
    if tables is None or tables.front.steering is None:
        return
    right, left = tables.front.steering.x[0], tables.front.steering.x[-1]
    angles = np.concatenate([piece.steering for piece in model.pieces])
    if angles.min() < right or angles.max() > left:
        raise CanrollError(
            f"{log.name}: the steering wheel is turned from {degrees(angles.min()):.0f} to "
            f"{degrees(angles.max()):.0f}°, but axles.front.steering of {model.vehicle.name} has "
            f"{degrees(right):.0f} to {degrees(left):.0f}°: give more of the table, or choose "
            "another part by --from and --to"
        )


def slips(log: Log, model: Model) -> tuple[str, ...]:
    """Return the slips in words, each with its remedy; none if the log is right.

    Of a log in which neither lateral acceleration nor yaw rate varies, as on a circle, nothing can
    be said. Without yaw rate, signals are compared with those of the car at the start.

    Raises:
        CanrollError: the car of the start cannot be driven as in the log.
    """
    signals = _signals(model)
    accelerations = _accelerations(model.vehicle, signals)
    if not signals["speed"].size or max(map(np.std, accelerations)) < LEAST_ACCELERATION:
        return ()
    kinematic = _kinematic(log, model.vehicle, signals)
    return tuple(_unlike(log, model)) if kinematic is None else (kinematic,)


def _signals(model: Model) -> dict[str, Vector]:
    """Return inputs and signals where all are compared."""
    there = model.compared.all(axis=1)
    signals = {name: model.measured[:, i] for i, name in enumerate(model.names)}
    for name in ("steering", "speed"):
        signals[name] = np.concatenate([getattr(piece, name) for piece in model.pieces])
    return {name: values[there] for name, values in signals.items()}


def _turning(vehicle: Vehicle, signals: Mapping[str, Vector]) -> Vector:
    """Return the yaw rate that the steering gives."""
    speed = signals["speed"]
    length = vehicle.geometry.wheelbase + vehicle.understeer * speed**2
    return np.asarray(speed * signals["steering"] / vehicle.steering.ratio / length)


def _accelerations(vehicle: Vehicle, signals: Mapping[str, Vector]) -> list[Vector]:
    """Return the lateral acceleration as measured and by the yaw rate, else by the steering."""
    measured = [signals[name] for name in ("lateral_acceleration",) if name in signals]
    turns = signals.get("yaw_rate")
    if turns is None and not measured:
        turns = _turning(vehicle, signals)
    return measured if turns is None else [*measured, signals["speed"] * turns]


def _remedy(log: Log, slip: _Slip) -> str:
    label = QUANTITIES[slip.signal].label
    option = option_of(log, slip.signal, slip.unit, turned=slip.factor < 0.0)
    if slip.factor > 0.0 and not slip.unit:
        # a ratio of 1 is implausible, and only a file can say that it is meant
        option = "steering.ratio = 1 and unusual = ['steering.ratio'] in the vehicle file"
    return f"{label}: {slip.words}: give {option}"


def option_of(log: Log, signal: str, unit: str, *, turned: bool) -> str:
    """Return the option that reads a signal in another unit ("": the same) or sign."""
    choice = log.channels[signal].choice
    own = choice.unit if abs(choice.factor) == 1.0 else ""  # else it is that of a map
    unit = unit and choice.unit[: choice.unit.rfind("*") + 1] + unit
    sign = "-" if turned != (choice.factor < 0.0) else ""
    return f"--signal {signal}={sign}{choice.name}" + (f":{unit or own}" if unit or own else "")


def _gain(y: Vector, x: Vector) -> tuple[float, float]:
    """Return the slope of y over x, and their correlation; means do not count."""
    x, y = x - x.mean(), y - y.mean()
    xx, yy, xy = x @ x, y @ y, x @ y
    if not xx * yy > 0.0:
        return 0.0, 0.0
    # both may be noisy: the geometric mean of the two regressions, with their sign
    return float(np.sign(xy) * np.sqrt(yy / xx)), float(xy / np.sqrt(xx * yy))


class _Relation(NamedTuple):
    """Two signals of one motion: slope of the first over the second, and their correlation."""

    one: str
    other: str
    slope: float
    correlation: float


def _relations(vehicle: Vehicle, signals: Mapping[str, Vector]) -> list[_Relation]:
    """Return a_y over v r, and r over what the steering gives; none without yaw rate."""
    if "yaw_rate" not in signals:
        return []
    yaw_rate = signals["yaw_rate"]
    gain = _gain(yaw_rate, _turning(vehicle, signals))
    result = [_Relation("yaw rate", "what the steering gives", *gain)]
    if "lateral_acceleration" in signals:
        gain = _gain(signals["lateral_acceleration"], signals["speed"] * yaw_rate)
        result.insert(0, _Relation("lateral acceleration", "speed × yaw rate", *gain))
    return result


def _far(relations: list[_Relation]) -> float:
    """Distance of the slopes from 1, infinite where a sign is wrong."""
    if min((one.slope for one in relations), default=1.0) <= 0.0:
        return inf
    return sum(abs(natural(one.slope)) for one in relations)


def _kinematic(log: Log, vehicle: Vehicle, signals: Mapping[str, Vector]) -> str | None:
    """Return in words the slip that explains the signals best; None if they agree.

    Of slips that explain them alike, each is named.
    """
    relations = _relations(vehicle, signals)
    for one in relations:
        if abs(one.correlation) < RELATED:
            return (
                f"{one.one} and {one.other} have a correlation of {one.correlation:.2f}: they are "
                "not of one drive, or one of their names is wrong"
            )
    if _far(relations) < NEAR:
        return None
    best: dict[str, float] = {}
    for slip in _slips(vehicle.steering.ratio):
        if slip.signal in signals:
            corrected = {**signals, slip.signal: signals[slip.signal] / slip.factor}
            best[_remedy(log, slip)] = _far(_relations(vehicle, corrected))
    least = min(best.values())
    if least < NEAR:
        return ", or ".join(text for text, far in best.items() if far < least + ALIKE)
    kinematic = relations[0].slope if len(relations) > 1 else 0.0
    if kinematic > 0.0 and abs(natural(kinematic)) < SAME and _far(relations) < 2 * NEAR:
        return None  # a car that is unlike the one at the start
    slopes = (f"{one.one} is {one.slope:.3g} times {one.other}" for one in relations)
    return f"{', and '.join(slopes)}: check units and signs by --signal"


def _unlike(log: Log, model: Model) -> Iterator[str]:
    """Yield the slips of signals that kinematics do not check, against the car at the start."""
    simulated = model.simulated(np.zeros(len(model.unknowns)))
    if simulated is None:
        raise CanrollError(f"{model.vehicle.name}: cannot be driven as in the log")
    compared, shifts = model.compared, range(-round(LAG / SAMPLE), round(LAG / SAMPLE) + 1)
    for i, name in enumerate(model.names):
        if name in ("yaw_rate", "lateral_acceleration") and "yaw_rate" in model.names:
            continue
        there, measured = compared[:, i], model.measured[:, i]
        gains = [_gain(np.roll(measured, s)[there], simulated[there, i]) for s in shifts]
        gains = [g for g in gains if np.isfinite(g).all()]
        gain, correlation = max(gains, key=lambda g: abs(g[1]), default=(0.0, 0.0))
        if abs(correlation) < RELATED:
            continue
        size = abs(gain)  # > 0, as they are correlated
        large, small, factor = UNITS[QUANTITIES[name].kind]
        times = f"{factor:.0f}" if factor > 10.0 else f"{factor:.2g}"
        unit, words = "", []
        if correlation < 0.0:
            words.append(f"its sign is reversed (correlation {correlation:.2f} with the car's)")
        # nearer to the wrong unit than to the right one
        units_away = natural(size) / natural(factor)
        if units_away > 0.5:
            unit = large
            words.append(f"{times} times too large")
        elif units_away < -0.5:
            unit = small
            words.append(f"{times} times too small")
        if words:
            option = option_of(log, name, unit, turned=correlation < 0.0)
            yield f"{QUANTITIES[name].label}: {', '.join(words)}: give {option}"
