"""A measured drive beside the same one of a simulated car, filtered alike."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from canroll.errors import CanrollError, VerdictError
from canroll.extensions.car.identification import replay
from canroll.extensions.car.identification.drive_log import OUTPUTS, QUANTITIES, Log
from canroll.extensions.car.identification.log_checks import (
    LEAST_ACCELERATION,
    check_steering,
    excitation,
    slips,
)
from canroll.extensions.car.identification.output_error import Model
from canroll.extensions.car.identification.pieces import SAMPLE, Piece, Window, pieces
from canroll.extensions.car.validation.measurement import Measurement
from canroll.typing import Vector
from canroll.vehicles import Vehicle

CUTOFF = 6.0
"""Cut-off frequency (Hz) of the filter for measured and simulated signals."""
POLES = 12
"""Poles of that filter, half of them forwards and half backwards: FMVSS 126, S7.11."""
_SHOWN = tuple(name for name in OUTPUTS if not name.startswith("travel"))


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """A stretch of driving, sampled every 10 ms: all of shape (n,), SI units.

    Attributes:
        time: of the log's clock (s).
        steering: steering-wheel angle without its offset (rad).
        speed: m/s.
        measured: signals without their offsets, by name; NaN where there is no sample.
        simulated: the same signals, and those that were not measured.
        inside: which samples count: in the window, after the run-in.
    """

    time: Vector
    steering: Vector
    speed: Vector
    measured: Mapping[str, Vector]
    simulated: Mapping[str, Vector]
    inside: NDArray[np.bool_]

    @property
    def lateral(self) -> Vector:
        """Lateral acceleration (m/s²): as measured, else v r, else that of the simulated car."""
        if "lateral_acceleration" in self.measured:
            return self.measured["lateral_acceleration"]
        if "yaw_rate" in self.measured:
            return self.speed * self.measured["yaw_rate"]
        return self.simulated["lateral_acceleration"]

    def compared(self, name: str) -> NDArray[np.bool_]:
        """Return which samples of a signal count."""
        return self.inside & np.isfinite(self.measured[name])


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """A log with the simulated car beside it.

    ``names`` are the signals that were measured; ``remarks`` what was left out or is strange.
    """

    log: str
    vehicle: Vehicle
    names: tuple[str, ...]
    stretches: tuple[Stretch, ...]
    remarks: tuple[str, ...]

    def joined(self, name: str) -> tuple[Vector, Vector]:
        """Return all measured and simulated values of a signal that count."""
        there = [stretch.compared(name) for stretch in self.stretches]
        measured = [s.measured[name][i] for s, i in zip(self.stretches, there, strict=True)]
        simulated = [s.simulated[name][i] for s, i in zip(self.stretches, there, strict=True)]
        return np.concatenate(measured), np.concatenate(simulated)


def replayed(
    log: Log, vehicle: Vehicle, window: Window, imu: str, measurement: Measurement
) -> Drive:
    """Steer a car as measured, at the measured speed.

    Args:
        log: the measured drive.
        vehicle: the car; ``sensors.imu_position`` is where its inertial unit sits.
        window: part of the log that counts.
        imu: axes of the inertial unit, a key of ``replay.FRAMES``.
        measurement: offsets and delays of the log.

    Raises:
        CanrollError: the log cannot be used, or tells nothing of the car.
        VerdictError: the car cannot be driven so.
    """
    parts, remarks = pieces(log, window)
    model = Model(vehicle, parts, imu, window, ())
    # of a steady circle too, which has a mean alone
    size = float(np.sqrt(np.mean(excitation(log, model) ** 2)))
    if size < LEAST_ACCELERATION:
        raise CanrollError(
            f"{log.name}: lateral acceleration of {size:.2g} m/s² RMS says nothing of the car; "
            f"{LEAST_ACCELERATION:g} are needed: choose another part by --from and --to"
        )
    check_steering(log, model)
    stretches = []
    for part in parts:
        record = replay.motion(vehicle, part, measurement.steering_offset)
        if not np.isfinite(record).all() or record[:, replay.ROLLOVER].any():
            raise VerdictError(
                f"{log.name}: {vehicle.name} rolls over where the measured car does not"
            )
        inside = np.asarray(part.compared(window).any(axis=1))
        stretches.append(_stretch(part, record, replay.FRAMES[imu], measurement, inside))
    return Drive(
        Path(log.name).name,
        vehicle,
        parts[0].names,
        tuple(stretches),
        (*remarks, *slips(log, model)),
    )


def _stretch(
    part: Piece,
    record: NDArray[np.float64],
    columns: Mapping[str, int],
    measurement: Measurement,
    inside: NDArray[np.bool_],
) -> Stretch:
    measured = {
        name: filtered(part.measured[:, i] - measurement.offsets.get(name, 0.0))
        for i, name in enumerate(part.names)
    }
    simulated = {
        name: filtered(
            replay.sampled(record, columns[name], part, measurement.delays.get(name, 0.0))
        )
        for name in {*part.names, *_SHOWN}
    }
    return Stretch(
        part.time,
        part.steering - measurement.steering_offset,
        part.speed,
        measured,
        simulated,
        inside,
    )


def filtered(values: Vector) -> Vector:
    """Return values through the phaseless low-pass of FMVSS 126; NaN where there was none."""
    there = np.isfinite(values)
    if not there.any():
        return values
    at = np.arange(len(values))
    filled = np.interp(at, at[there], values[there])
    low = sosfiltfilt(butter(POLES // 2, CUTOFF, fs=1.0 / SAMPLE, output="sos"), filled)
    return np.where(there, low, np.nan)


def runs(there: NDArray[np.bool_]) -> Iterator[slice]:
    """Yield the runs of samples that are ``there``."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], there, [False])).astype(int)))
    for begin, end in edges.reshape(-1, 2).tolist():
        yield slice(begin, end)


def label(name: str) -> str:
    """Return what people call a signal."""
    return QUANTITIES[name].label
