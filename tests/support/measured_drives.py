"""Logs of drives of a known car, at 100 Hz and without noise, as the product reads them."""

import numpy as np

from canroll.extensions.car.identification import replay
from canroll.extensions.car.identification.drive_log import QUANTITIES, Channel, Log, SignalChoice
from canroll.extensions.car.identification.pieces import SAMPLE, Piece
from canroll.typing import Vector
from canroll.vehicles import Vehicle

NAMES = ("yaw_rate", "lateral_acceleration", "roll_rate", "roll", "sideslip")


def log_of(columns: dict[str, Vector], name: str = "drive.csv") -> Log:
    """Return a log of columns by quantity, sampled every 10 ms."""
    assert columns.keys() <= QUANTITIES.keys()
    count = len(columns["steering"])
    time = time_of(SAMPLE * count)
    return Log(
        name, {key: Channel(SignalChoice(key), time, values) for key, values in columns.items()}
    )


def driven(vehicle: Vehicle, steering: Vector, speed: "float | Vector") -> dict[str, Vector]:
    """Return the columns of a drive: steering at the wheel (rad), speed (m/s)."""
    speeds = np.broadcast_to(np.asarray(speed, float), steering.shape).copy()
    piece = Piece(0.0, steering, speeds, NAMES, np.zeros((len(steering), len(NAMES))))
    record = replay.motion(vehicle, piece, 0.0)
    columns = replay.FRAMES["body"]
    signals = {name: replay.sampled(record, columns[name], piece, 0.0) for name in NAMES}
    return {"steering": steering, "speed": speeds, **signals}


def time_of(seconds: float) -> Vector:
    """Return the times of the samples of a drive (s)."""
    return np.asarray(SAMPLE * np.arange(round(seconds / SAMPLE)), float)


def step(angle: float, *, rate: float = 5.0, seconds: float = 6.0) -> Vector:
    """Return a step of the steering wheel at 2 s, at ``rate`` (rad/s)."""
    return np.clip(rate * (time_of(seconds) - 2.0), 0.0, angle)


def sweep(angle: float, *, seconds: float = 24.0, low: float = 0.2, high: float = 2.5) -> Vector:
    """Return a sine of rising frequency (Hz) from 1.5 s on."""
    time = np.maximum(time_of(seconds) - 1.5, 0.0)
    whole = seconds - 1.5
    phase = low * time + 0.5 * (high - low) * time**2 / whole
    return np.asarray(angle * np.sin(2 * np.pi * phase))


def dwell(angle: float) -> Vector:
    """Return the steering of FMVSS 126 from 1.5 s on."""
    time = time_of(7.0) - 1.5
    peak, end = 0.75 / 0.7, 1 / 0.7 + 0.5
    phase = np.where(time < peak, time, np.maximum(time - 0.5, peak))
    return np.asarray(
        np.where((time < 0) | (time > end), 0.0, angle * np.sin(2 * np.pi * 0.7 * phase))
    )


def ramp(angle: float, *, seconds: float = 45.0) -> Vector:
    """Return a slowly increasing steering."""
    return np.asarray(angle * time_of(seconds) / seconds)


def free(seconds: float = 12.0) -> Vector:
    """Return the steering of a winding road."""
    time = time_of(seconds)
    return np.asarray(
        0.5 * np.sin(2 * np.pi * 0.25 * time) + 0.4 * np.sin(2 * np.pi * 0.43 * time + 1.0)
    )
