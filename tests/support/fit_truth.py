"""Logs whose truth is known: of a car drawn from the priors, with noise, offsets and delays."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.extensions.car.identification import drive_log, replay, unknowns
from canroll.extensions.car.identification.fit import Fit, FitSettings, fit
from canroll.extensions.car.identification.pieces import SAMPLE, Piece
from canroll.extensions.car.identification.unknowns import STEERING_OFFSET, delay_key, offset_key
from canroll.extensions.car.sizing.estimate import estimated
from canroll.typing import Vector
from canroll.vehicles import Vehicle
from canroll.vehicles.check import problems

NAMES = ("yaw_rate", "lateral_acceleration", "roll_rate", "roll")
NOISE = {"yaw_rate": 0.003, "lateral_acceleration": 0.06, "roll_rate": 0.004, "roll": 0.001}
"""Standard deviation of the sensors' white noise, SI units; of steering (rad) and speed (m/s):"""
STEERING_NOISE, SPEED_NOISE = 1e-3, 0.01
DURATION = 8.0
SPUN = 0.2
"""Sideslip (rad) beyond which a car is lost."""
VAN = {"mass": 2720.0, "wheelbase": 3.66, "track": 1.735, "height": 2.5, "cg_height": 0.385}


@dataclass(frozen=True, slots=True)
class Truth:
    """A synthetic log: where its fit starts, the true numbers, and the file's content."""

    start: Vehicle
    numbers: dict[str, float]
    columns: dict[str, Vector]

    def write(self, path: Path) -> None:
        """Write the log as a CSV."""
        rows = np.column_stack(list(self.columns.values()))
        head = ",".join(self.columns)
        np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=head, comments="")


def steering(generator: np.random.Generator, time: Vector) -> Vector:
    """A free drive: steps of random size every second or so, rounded by the arms, and a sweep."""
    wheel, at = np.zeros(time.size), 0.5
    while at < time[-1]:
        wheel[time >= at] = generator.uniform(-1.0, 1.0)
        at += generator.uniform(0.5, 1.5)
    lag = np.exp(-SAMPLE / 0.12)
    for _ in range(2):
        for k in range(1, wheel.size):
            wheel[k] = lag * wheel[k - 1] + (1.0 - lag) * wheel[k]
    return np.asarray(wheel + 0.15 * np.sin(2 * np.pi * (0.3 + 0.08 * time) * time))


def truth(
    seed: int,
    start: Vehicle | None = None,
    *,
    duration: float = DURATION,
    held: Collection[str] = (),
    noise: Mapping[str, float] = NOISE,
) -> Truth:
    """Draw a car and its log.

    Args:
        seed: of all that is drawn.
        start: where the fit starts; by default a van estimated from its size.
        duration: of the log (s).
        held: keys of numbers that are as at the start.
        noise: standard deviation of the sensors' noise.
    """
    generator = np.random.default_rng(seed)
    start = start or estimated("van", VAN, name="van")
    sought = unknowns.unknowns(start, NAMES, held=held)
    time = np.asarray(SAMPLE * np.arange(round(duration / SAMPLE)), float)
    wheel, speed = steering(generator, time), 22.0 + 1.5 * np.sin(0.4 * time)
    piece = Piece(0.0, wheel, speed, NAMES, np.zeros((time.size, len(NAMES))))
    for numbers, car in cars(generator, start, sought):
        record = replay.motion(car, piece, 0.0)
        if measurable(record):
            return Truth(start, numbers, sensed(generator, piece, record, numbers, noise=noise))
    raise AssertionError  # the cars never end


def cars(
    generator: np.random.Generator, start: Vehicle, sought: Collection[unknowns.Unknown]
) -> Iterator[tuple[dict[str, float], Vehicle]]:
    """Yield the numbers of draws from the priors of ``start``, without end, and cars with them."""
    while True:
        numbers = {u.key: float(_drawn(generator, u)) for u in sought}
        try:
            car = unknowns.applied(start, numbers)
        except CanrollError:
            continue
        if not any(problems(car)):
            yield numbers, car


def measurable(record: NDArray[np.float64]) -> bool:
    """Whether a car neither spins nor rolls over: else its drive would not have been measured."""
    spun = np.abs(record[:, replay.SIDESLIP]).max() >= SPUN
    return not (spun or record[:, replay.ROLLOVER].any())


def sensed(
    generator: np.random.Generator,
    piece: Piece,
    record: NDArray[np.float64],
    numbers: Mapping[str, float],
    *,
    frame: str = "body",
    noise: Mapping[str, float] = NOISE,
) -> dict[str, Vector]:
    """Return the columns of a log: what sensors with noise, offsets and delays show of a drive.

    Args:
        generator: of the noise.
        piece: what was steered, and how fast.
        record: of the drive, as of :func:`canroll.extensions.car.identification.replay.motion`.
        numbers: offsets and delays by the keys of their unknowns.
        frame: axes of the inertial unit.
        noise: standard deviation of the sensors' noise.
    """
    time = piece.time
    shown = (
        piece.steering
        + numbers.get(STEERING_OFFSET, 0.0)
        + STEERING_NOISE * generator.standard_normal(time.size)
    )
    columns = {
        "time": time,
        "steering_wheel_rad": shown,
        "speed_m_s": piece.speed + SPEED_NOISE * generator.standard_normal(time.size),
    }
    for name in NAMES:
        column = replay.FRAMES[frame][name]
        signal = replay.sampled(record, column, piece, numbers.get(delay_key(name), 0.0))
        signal = signal + numbers.get(offset_key(name), 0.0)
        columns[name] = signal + noise[name] * generator.standard_normal(time.size)
    return columns


def _drawn(generator: np.random.Generator, unknown: unknowns.Unknown) -> float:
    while True:
        value = unknown.value(generator.standard_normal())
        if unknown.least < value < unknown.most:
            return value


def log_of(case: Truth) -> drive_log.Log:
    """Return the log of a truth, as read from its file."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "drive.csv")
        case.write(path)
        return drive_log.read(str(path), {})


def fitted(case: Truth, settings: FitSettings) -> Fit:
    """Fit the log of a truth."""
    return fit(log_of(case), case.start, settings)
