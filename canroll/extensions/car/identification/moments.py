"""Moments of actuators in a log: what acts on the car, and what the log tells of the actuators.

The simulated car has the delivered moments as inputs; where a log has only the command of an axle,
it is the command through an actuator: that of the other axle, if it was fitted, else the file's.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from math import radians, sqrt

import numpy as np

from canroll.errors import CanrollError
from canroll.extensions.car.identification import actuator_fit
from canroll.extensions.car.identification.actuator_fit import (
    Actuator,
    Moved,
    first_guess,
    unknowns_of,
)
from canroll.extensions.car.identification.drive_log import (
    COMMANDED,
    DELIVERED,
    FORCES,
    QUANTITIES,
    Channel,
    Log,
    SignalChoice,
)
from canroll.extensions.car.identification.log_checks import RELATED, option_of
from canroll.extensions.car.identification.pieces import EVERYTHING, RUN_IN, Window, newer
from canroll.extensions.car.identification.unknowns import (
    FittedNumber,
    Number,
    Unknown,
    is_known,
    of_key,
)
from canroll.plant_sim.bodies.ports import AXLES
from canroll.typing import Vector
from canroll.vehicles import Vehicle
from canroll.vehicles.axles import axles

KINDS = ("bars", "suspension")
"""Actuators whose lag a vehicle file has and moments tell."""
LAG = Number("actuator lag", "s", 1.0)
LEAST_ROLL = radians(0.01)
"""Roll (rad) of the standing car that the standard deviation of moments which move exceeds."""
WRONG_UNIT = 30.0
"""Gain beyond which, or below whose inverse, moments are in another unit."""
STEP = 0.01
"""Interval (s) of moments that follow from commands."""
DIFFERENT = 3.0
"""Deviations of their difference by which the lags of two axles are not one."""
TURNING = ("lateral_acceleration", "yaw_rate")
"""Signals of which each is > 0 in a left curve, where the body rolls to the right."""
SHORTEST = 1.0
"""Time (s) with both moments of an axle that its actuator is fitted to, at least."""


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """What the moments of a log say.

    Attributes:
        log: with the moments that act on the car as delivered ones.
        actuators: that were fitted, by axle.
        lag: that of all actuators, for the vehicle file; None where the log does not tell it, or
            it is held.
        remarks: what is strange, a line each.
        own: key of the lag, where an actuator was fitted.
    """

    log: Log
    actuators: tuple[Actuator, ...] = ()
    lag: FittedNumber | None = None
    remarks: tuple[str, ...] = ()
    own: str = ""

    def others(self, keys: Collection[str]) -> tuple[str, ...]:
        """Return keys without that of the lag, which the car's motion does not tell."""
        return tuple(key for key in keys if key != self.own)


def lag_key(log: Log, kind: str) -> str:
    """Return the key of the lag of a vehicle file that is that of a log's actuators.

    ``kind`` is one of :data:`KINDS`, "" by default that of the commands: forces are a suspension's.
    """
    forces = any(name in log.channels for name in FORCES)
    if kind == "bars" and forces:
        raise CanrollError(
            f"{log.name}: --actuator bars, but it has commanded corner forces, which are those of "
            "a suspension: omit --actuator"
        )
    return f"actuators.{kind or ('suspension' if forces else 'bars')}.lag"


def moments(
    log: Log,
    vehicle: Vehicle,
    kind: str = "",
    window: Window = EVERYTHING,
    *,
    free: Collection[str] = (),
    held: Collection[str] = (),
) -> Moments:
    """Return the moments of a log, with the actuators fitted to them.

    Args:
        log: the measured drive.
        vehicle: whose actuators they are.
        kind: one of :data:`KINDS`, or "": that of the commands.
        window: part of the log that the actuators are fitted to.
        free: keys to fit though their sources say that they are known.
        held: keys to hold.

    Raises:
        CanrollError: commands and delivered moments cannot be those of one actuator.
    """
    key = lag_key(log, kind)
    prior = of_key(vehicle, key, LAG)
    commands = _commands(log, vehicle)
    fits: dict[str, Actuator] = {}
    remarks: list[str] = []
    for axle, name in zip(AXLES, DELIVERED, strict=True):
        if axle in commands and name in log.channels:
            moved = _moved(commands[axle], log.channels[name], window)
            if reason := _untold(log, axle, moved, vehicle):
                remarks.append(f"actuator {axle}: {reason}: the log tells nothing of it")
            else:
                fits[axle] = _fitted(log, axle, moved, prior)
    if kind and not fits:
        raise CanrollError(
            f"{log.name}: --actuator {kind}: no axle has commanded and delivered moments that tell "
            "of it: name them by --signal, or omit --actuator"
        )
    channels = dict(log.channels)
    for axle, name in zip(AXLES, DELIVERED, strict=True):
        if name not in channels and axle in commands:
            channels[name], remark = _through(commands[axle], axle, fits, prior.mean)
            remarks.append(remark)
    there = [name for name in DELIVERED if name in channels]
    if len(there) == 1:
        (other,) = {*DELIVERED} - {*there}
        remarks.append(f"{QUANTITIES[other].label}: not in the log, taken as 0")
    remarks += _outward(log)
    lag = None
    if lags := _identified_lags(fits):
        lag = _common(lags, replace(prior, least=actuator_fit.FASTEST))
        if key in held or (is_known(vehicle, key) and key not in free):
            remarks.append(
                f"{key}: held at {prior.mean:.4g} s; the log has {lag.value:.4g} ± "
                f"{lag.deviation:.2g} s"
            )
            lag = None
        elif len(lags) > 1 and _apart(lags) > DIFFERENT:
            remarks.append(
                f"{key}: the file has one lag for both axles, which differ: their mean is written"
            )
    return Moments(
        replace(log, channels=channels),
        tuple(fits.values()),
        lag,
        tuple(remarks),
        key if fits else "",
    )


def _identified_lags(fits: Mapping[str, Actuator]) -> list[FittedNumber]:
    """Return the lags that the log tells apart from their delays."""
    return [fit.numbers[0] for fit in fits.values() if fit.numbers[0].state == "identified"]


def _apart(lags: list[FittedNumber]) -> float:
    first, second = lags
    return abs(first.value - second.value) / sqrt(first.deviation**2 + second.deviation**2)


def _common(lags: list[FittedNumber], unknown: Unknown) -> FittedNumber:
    """Return the weighted mean of lags, its deviation widened by what they differ (Birge, 1932)."""
    weights = np.array([1.0 / lag.deviation**2 for lag in lags])
    values = np.array([lag.value for lag in lags])
    mean = float(weights @ values / weights.sum())
    ratio = 1.0
    if len(lags) > 1:
        ratio = max(sqrt(float(weights @ (values - mean) ** 2) / (len(lags) - 1)), 1.0)
    return FittedNumber(unknown, mean, ratio / sqrt(float(weights.sum())), "identified")


def _commands(log: Log, vehicle: Vehicle) -> dict[str, Channel]:
    """Return the commanded moments by axle; of corner forces, half the track times (left − right).

    Raises:
        CanrollError: an axle has forces and a moment, or the force of one corner alone.
    """
    result = {}
    for k, (axle, name) in enumerate(zip(AXLES, COMMANDED, strict=True)):
        pair = [force for force in FORCES[2 * k : 2 * k + 2] if force in log.channels]
        if name in log.channels:
            result[axle] = log.channels[name]
        if pair and name in log.channels:
            raise CanrollError(
                f"{log.name}: {axle} axle: both a commanded moment and commanded forces: name one "
                "of them by --signal, under another column"
            )
        if len(pair) == 1:
            raise CanrollError(
                f"{log.name}: {QUANTITIES[pair[0]].label}: the force of the other side is missing: "
                "name it by --signal"
            )
        if pair:
            left, right = (log.channels[force] for force in pair)
            other = right.values[np.searchsorted(right.times, left.times, "right") - 1]
            arm = axles(vehicle)[k].half_track
            result[axle] = Channel(left.choice, left.times, arm * (left.values - other))
    return result


def _moved(command: Channel, delivered: Channel, window: Window) -> Moved:
    """Return commands and what became of them, where both are known, after the run-in."""
    new = newer(command.times)
    times, values = command.times[new], command.values[new]
    begin, at = max(times[0] + RUN_IN, window.begin), delivered.times
    inside = newer(at) & (at >= begin) & (at < window.end) & (at <= times[-1])
    return Moved(times, values, at[inside], delivered.values[inside])


def _untold(log: Log, axle: str, moved: Moved, vehicle: Vehicle) -> str:
    """Return why the log tells nothing of an axle's actuator, "" if it tells of it.

    Raises:
        CanrollError: the delivered moment moves while its command is constant.
    """
    if moved.at.size < 2 or moved.at[-1] - moved.at[0] < SHORTEST:
        return f"less than {SHORTEST:g} s with commanded and delivered moment"
    least = LEAST_ROLL * vehicle.plant.roll_stiffness
    inside = (moved.times >= moved.at[0] - RUN_IN) & (moved.times <= moved.at[-1])
    moves = np.std(moved.command[inside]) >= least
    if np.std(moved.delivered) < least:
        if not moves:
            return "its command never moves"
        # what follows the command is small by its unit
        if abs(first_guess(moved)[-1]) < RELATED:
            return "it delivers nothing of its command, as if switched off"
    if not moves:
        raise CanrollError(
            f"{log.name}: {QUANTITIES[f'delivered_{axle}'].label}: it moves, but its command is "
            "constant: they are not of one actuator, or a name is wrong"
        )
    return ""


def _fitted(log: Log, axle: str, moved: Moved, prior: Unknown) -> Actuator:
    """Fit an axle's actuator to moments that can be its own."""
    name = f"delivered_{axle}"
    label = QUANTITIES[name].label
    *_, gain, correlation = first_guess(moved)
    if abs(correlation) < RELATED:
        raise CanrollError(
            f"{log.name}: {label}: it has nothing to do with its command (correlation "
            f"{correlation:.2f}): they are not of one actuator, or a name is wrong"
        )
    if correlation < 0.0:
        raise CanrollError(
            f"{log.name}: {label}: its sign is reversed (correlation {correlation:.2f} with its "
            f"command): give {option_of(log, name, '', turned=True)}"
        )
    if not 1.0 / WRONG_UNIT < gain < WRONG_UNIT:
        unit = "kNm" if gain < 1.0 else "Nm"
        raise CanrollError(
            f"{log.name}: {label}: {gain:.3g} times its command: check both units; if its own is "
            f"wrong, give {option_of(log, name, unit, turned=False)}"
        )
    return actuator_fit.fitted(moved, unknowns_of(prior, axle, float(np.std(moved.command))), axle)


def _through(
    command: Channel, axle: str, fits: Mapping[str, Actuator], lag: float
) -> tuple[Channel, str]:
    """Return the moment that an actuator makes of a command, every 10 ms, and a remark on it."""
    label = QUANTITIES[f"delivered_{axle}"].label
    moved = _moved(command, command, EVERYTHING)
    at = np.arange(moved.times[0], moved.times[-1], STEP)
    if fits:
        fit = next(iter(fits.values()))
        values = fit.delivered(moved.times, moved.command, at)
        words = f"the command through the actuator {fit.axle}"
    else:
        values = actuator_fit.response(moved.times, moved.command, at, lag, 0.0)
        words = f"the command with the file's lag of {lag:.4g} s"
    choice = SignalChoice(command.choice.name)
    return Channel(choice, at, values), f"{label}: not in the log: {words}"


def _outward(log: Log) -> Iterator[str]:
    """Yield which delivered moments push the body out of the curve, as control does not."""
    turning = next((name for name in TURNING if name in log.channels), None)
    for name in DELIVERED:
        if name not in log.channels or turning is None:
            continue
        lateral = log.channels[turning]
        channel = log.channels[name]
        moment = _centred(channel.values)
        outward = _centred(np.interp(channel.times, lateral.times, lateral.values))
        size = float(np.linalg.norm(moment) * np.linalg.norm(outward))
        if size > 0.0 and (correlation := float(moment @ outward) / size) > RELATED:
            yield (
                f"{QUANTITIES[name].label}: it rolls the body out of the curve (correlation "
                f"{correlation:.2f} with the {QUANTITIES[turning].label}): if its sign is "
                f"reversed, give {option_of(log, name, '', turned=True)}"
            )


def _centred(values: Vector) -> Vector:
    return np.asarray(values - values.mean())
