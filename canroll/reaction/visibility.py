"""How visible a fault is: what it makes of the residuals of the car, over their thresholds.

A residual r of sound signals stays within its threshold b, so that an error that moves it by more
than 2 b for the residual's time raises it for certain, whatever car of the box it is; what is less
may be found or not. The errors are those of what was received in a run; no monitor has a part.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from canroll.gain_gen.monitors.bank import TRUST, Bank, Residual, ticks_of, weight
from canroll.gain_gen.monitors.evaluation import Signals, fading, moved, room
from canroll.plant_sim.nodes import codec, codec_tables, e2e
from canroll.plant_sim.nodes.sensors import PER_UNIT
from canroll.plant_sim.world.received import received_by_ecu
from canroll.plant_sim.world.spool import Table
from canroll.reaction.reaction import ObservedTrace
from canroll.typing import Vector
from canroll.vehicles import GRAVITY, Vehicle

FORGOTTEN = 5.0
"""Time constants of a residual after which it holds again: less than a hundredth is left."""
MESSAGES = {
    "Imu": ("RollRate", "LateralAcceleration", "YawRate"),
    "VehicleMotion": ("VehicleSpeed", "SteeringWheelAngle"),
    "SuspensionRate": ("RateFrontLeft", "RateFrontRight", "RateRearLeft", "RateRearRight"),
    "ActuatorState": ("DeliveredMomentFront", "DeliveredMomentRear"),
}
"""What residuals are made of, by message."""
WOULD_FIND = {
    "moment_front": "wheel loads or a roll angle",
    "moment_rear": "wheel loads or a roll angle",
    "lateral": "a second accelerometer or a measured load",
    "roll_rate": "a second gyro",
    "turning": "a second yaw rate",
    "yaw_rate": "a second yaw rate",
    "steered": "a second steering angle",
    **dict.fromkeys(("stroke_front", "stroke_rear", "heave_front", "heave_rear"), "a roll angle"),
}
"""What would find an error of a signal that no residual is sure to find."""


class LoggedTrace(ObservedTrace, Protocol):
    """A record of a run with its bus log."""

    @property
    def frames(self) -> Table:
        """The bus log, one entry per frame and segment."""


@dataclass(frozen=True, slots=True)
class Visibility:
    """How visible the errors of what a run received are.

    Attributes:
        share: of what is sure to be found; 1 and more: it is.
        residual: the one that they are most visible in; empty: in none.
        signal: that is most wrong; empty: none is by more than twice what sound sensors are.
    """

    share: float = 0.0
    residual: str = ""
    signal: str = ""

    @property
    def sure(self) -> bool:
        """Whether the residuals must show it."""
        return self.share >= 1.0

    @property
    def excused(self) -> bool:
        """Whether what was received is wrong, but by less than is sure to be found."""
        return bool(self.signal) and not self.sure

    @property
    def text(self) -> str:
        """It in a few words, with what would find it."""
        if not self.signal:
            return "all that is received is right"
        text = "no residual holds while it lasts"
        if self.residual:
            percent = math.floor(100.0 * self.share)
            text = f"{percent} % of what is sure to be found ({self.residual})"
        return text if self.sure else f"{text}: {WOULD_FIND[self.signal]} would find it"


def visibility(
    trace: LoggedTrace, healthy: LoggedTrace, bank: Bank, vehicle: Vehicle, start: float
) -> Visibility:
    """Return how visible what was received wrongly from ``start`` (s) on is to a bank.

    Args:
        trace: of a run on the product's own frames; it counts until the vehicle rolls over.
        healthy: of it without faults: what its sensors are wrong by is no fault.
        bank: of the controller, of the tick that the run had.
        vehicle: that was driven.
        start: when the first fault begins.
    """
    measured, errors = measured_and_errors(trace, vehicle, start)
    _, usual = measured_and_errors(healthy, vehicle, start)
    rolls = trace.signals["time"][np.asarray(trace.signals["rollover"]) > 0]
    ticks = np.asarray(trace.ticks["t"])
    counts = (ticks >= start) & (ticks < min(rolls, default=np.inf))
    wrong, size = {}, {}
    for name, values in errors.items():
        sound = float(np.abs(usual[name]).max())
        beyond = np.where(counts, np.abs(values) - sound, 0.0).clip(0.0)
        wrong[name] = np.sign(values) * beyond
        size[name] = float(beyond.max()) / max(sound, 1e-9)
    signal = max(size, key=lambda name: size[name])
    if size[signal] < 1.0:
        return Visibility()
    share, residual = max((_share(bank, of, measured, wrong), of.name) for of in bank.residuals)
    return Visibility(share, residual if share else "", signal)


def _share(bank: Bank, residual: Residual, measured: Signals, wrong: Signals) -> float:
    """Return the largest share that lasts for the residual's time, to one side, where it holds."""
    motion = np.maximum(np.abs(measured["turning"]), np.abs(measured["steered"]))
    held = fading(motion, 1.0 - weight(TRUST, bank.tick))
    memory = max(
        part.memory(bank.tick) * bank.tick if part.washout else part.low_pass
        for part in (bank.parts[term.part] for term in residual.terms if term.sign)
    )
    since = min(len(held), 1 + round(FORGOTTEN * memory / bank.tick))
    held = np.max(sliding_window_view(np.pad(held, (since - 1, 0)), since), axis=1)
    most = 2.0 * (residual.floor + room(bank, residual, measured))
    share = moved(bank, residual, wrong) / most
    within = np.where(held <= residual.limit, share, 0.0)
    window = min(ticks_of(residual.time, bank.tick), len(share))
    lasting = (sliding_window_view(side * within, window).min(axis=1).max() for side in (1, -1))
    return max(0.0, *map(float, lasting))


def signals_of(values: Signals, vehicle: Vehicle) -> dict[str, Vector]:
    """Return :data:`canroll.gain_gen.monitors.bank.SIGNALS` from measured ones."""
    left, right = values["RateFrontLeft"], values["RateFrontRight"]
    rear_left, rear_right = values["RateRearLeft"], values["RateRearRight"]
    speed = values["VehicleSpeed"]
    angle = values["SteeringWheelAngle"] / vehicle.steering.ratio
    return {
        "stroke_front": left - right,
        "stroke_rear": rear_left - rear_right,
        "heave_front": left + right,
        "heave_rear": rear_left + rear_right,
        "moment_front": values["DeliveredMomentFront"],
        "moment_rear": values["DeliveredMomentRear"],
        "lateral": values["LateralAcceleration"],
        "turning": values["YawRate"] * speed,
        "steered": np.array([vehicle.lateral_gain(v) for v in speed]) * angle,
        "roll_rate": values["RollRate"],
        "yaw_rate": values["YawRate"],
    }


def truth(signals: Signals, vehicle: Vehicle) -> dict[str, Vector]:
    """Return what sound sensors would measure of the recorded motion, and the moments made."""
    x, _, z = vehicle.sensors.imu_position
    roll = signals["roll"]
    across = signals["sprung_ay"] + GRAVITY * np.sin(signals["bank"])
    across = across + signals["yaw_acc"] * x - signals["roll_acc"] * z
    rates = {
        f"Rate{wheel.title().replace('_', '')}": signals[f"travel_rate_{wheel}"]
        for wheel in ("front_left", "front_right", "rear_left", "rear_right")
    }
    return rates | {
        "LateralAcceleration": np.cos(roll) * across + GRAVITY * np.sin(roll),
        "RollRate": signals["roll_rate"],
        "YawRate": signals["yaw_rate"],
        "VehicleSpeed": signals["vx"],
        "SteeringWheelAngle": signals["steer"] * vehicle.steering.ratio,
        "DeliveredMomentFront": signals["moment_front"],
        "DeliveredMomentRear": signals["moment_rear"],
    }


def measured_and_errors(
    trace: LoggedTrace, vehicle: Vehicle, start: float
) -> tuple[dict[str, Vector], dict[str, Vector]]:
    """Return the signals of a bank as received by each tick, and by what they are wrong.

    What is right is as old as it was before ``start``: a message that comes late from then on is
    wrong by what has changed.
    """
    ticks = np.asarray(trace.ticks["t"])
    received, right = {}, {}
    motion = truth(trace.signals, vehicle)
    for name, names in MESSAGES.items():
        frames, values = accepted(trace.frames, name)
        newest = np.searchsorted(frames["t_received"] * 1e-9, ticks + 1e-12, side="right")
        before = (newest > 0) & (ticks < start)
        age = 0.0
        if np.any(before):
            age = float(np.median(ticks[before] - frames["t_origin"][newest[before] - 1] * 1e-9))
        for signal in names:
            known = np.concatenate([[0.0], values[signal]])
            received[signal] = known[newest]
            right[signal] = np.interp(ticks - age, trace.signals["time"], motion[signal])
    measured, true = signals_of(received, vehicle), signals_of(right, vehicle)
    return measured, {name: values - true[name] for name, values in measured.items()}


def accepted(frames: Table, name: str) -> tuple[NDArray[np.void], dict[str, Vector]]:
    """Return the frames of a message that the ECU takes, and their signals in SI units.

    One of another length or with a wrong checksum is refused; an invalid value is the last one.
    """
    tables, row = codec_tables.load(), codec_tables.message_index(name)
    length = tables.message[row]["length"]
    protection = tables.protection[row]
    heard = received_by_ecu(frames, int(tables.message[row]["ident"]))
    taken = [
        frame["length"] == length and e2e.intact(protection, frame["payload"]) for frame in heard
    ]
    heard = heard[np.array(taken, bool)]
    values = {}
    for signal in MESSAGES[name]:
        of = codec_tables.signal_index(name, signal)
        scale, last, known = PER_UNIT[codec_tables.unit(name, signal)], 0.0, []
        for frame in heard:
            raw = codec.extract(tables, of, frame["payload"])
            last = codec.physical(tables, of, raw) / scale if codec.valid(tables, of, raw) else last
            known.append(last)
        values[signal] = np.array(known)
    return heard, values
