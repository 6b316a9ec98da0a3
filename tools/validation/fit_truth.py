"""Fits of logs whose truth is known: how often it lies in the interval that a fit states.

``python -m tools.validation.fit_truth COUNT [JOBS [FOLDER]]`` prints a table: for each number how
often the log tells it, how often the truth lies within 1.96 standard deviations, and the deviation
over the Cramér–Rao bound. The car of a log is drawn from the priors of the one where its fit
starts; its sensors have noise, offsets and delays. Outcomes in FOLDER are taken from there.
"""

import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from canroll.cases.engine import LOCAL, engine, results
from canroll.cases.store import JsonRows, Store
from canroll.errors import CanrollError
from canroll.extensions.car.identification import drive_log, replay, unknowns
from canroll.extensions.car.identification.fit import Fit, FitSettings, fit
from canroll.extensions.car.identification.pieces import SAMPLE, Piece
from canroll.extensions.car.identification.unknowns import STEERING_OFFSET, delay_key, offset_key
from canroll.extensions.car.sizing.estimate import estimated
from canroll.typing import Vector
from vehicles import Vehicle
from vehicles.check import problems

NAMES = ("yaw_rate", "lateral_acceleration", "roll_rate", "roll")
NOISE = {"yaw_rate": 0.003, "lateral_acceleration": 0.06, "roll_rate": 0.004, "roll": 0.001}
"""Standard deviation of the sensors' white noise, SI units; of steering (rad) and speed (m/s):"""
STEERING_NOISE, SPEED_NOISE = 1e-3, 0.01
DURATION = 8.0
SPUN = 0.2
"""Sideslip (rad) beyond which a car is lost."""
VAN = {"mass": 2720.0, "wheelbase": 3.66, "track": 1.735, "height": 2.5, "cg_height": 0.385}
COVERED = 1.96
STATES = tuple(unknowns.STATES)


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


@dataclass(frozen=True, slots=True)
class Row:
    """One number of one fit: error, its deviation and the least one, and the state.

    All in deviations of the prior, of a positive number those of its logarithm.
    """

    key: str
    error: float
    deviation: float
    least: float
    state: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """All numbers of one fit, and the mean square of their errors in its covariance."""

    rows: tuple[Row, ...]
    distance: float


def log_of(case: Truth) -> drive_log.Log:
    """Return the log of a truth, as read from its file."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "drive.csv")
        case.write(path)
        return drive_log.read(str(path), {})


def fitted(case: Truth, settings: FitSettings) -> Fit:
    """Fit the log of a truth."""
    return fit(log_of(case), case.start, settings)


def outcome(seed: int) -> Outcome:
    """Fit one log and compare with its truth."""
    return compared(truth(seed), FitSettings())


def compared(case: Truth, settings: FitSettings) -> Outcome:
    """Fit the log of a truth and compare with it."""
    result = fitted(case, settings)
    felt = np.array([number.state != "kept" for number in result.numbers])
    least = result.information.least(felt)
    slopes = np.array([number.unknown.slope(number.value) for number in result.numbers])
    covariance = result.covariance / np.outer(slopes, slopes)
    errors = np.array(
        [
            number.unknown.coordinate(number.value)
            - number.unknown.coordinate(case.numbers[number.unknown.key])
            for number in result.numbers
        ]
    )
    named = [(number.unknown.key, number.state) for number in result.numbers]
    return outcome_of(named, errors, covariance, least)


def outcome_of(
    named: Sequence[tuple[str, str]],
    errors: Vector,
    covariance: NDArray[np.float64],
    least: Vector,
) -> Outcome:
    """Return the outcome of keys with their states (p), in deviations of the priors."""
    deviations = np.sqrt(np.diag(covariance))
    numbers = zip(named, errors.tolist(), deviations.tolist(), least.tolist(), strict=True)
    rows = tuple(Row(key, e, deviation, bound, s) for (key, s), e, deviation, bound in numbers)
    return Outcome(rows, float(errors @ np.linalg.solve(covariance, errors)) / len(rows))


def table(outcomes: list[Outcome]) -> Iterator[str]:
    """Lines of the table, and in how many of the logs' covariances the truth is no surprise."""
    yield (
        "| number | identified | with others | at bound | kept | within 95 % "
        "| deviation over the least |"
    )
    yield "| --- | ---: | ---: | ---: | ---: | ---: | ---: |"
    inside: list[bool] = []
    identified: list[bool] = []
    for number in zip(*(one.rows for one in outcomes), strict=True):
        good = [abs(row.error) < COVERED * row.deviation for row in number]
        states = [sum(row.state == state for row in number) for state in STATES]
        inside += good
        identified += [g for g, row in zip(good, number, strict=True) if row.state == "identified"]
        wide = np.median([row.deviation / row.least for row in number])
        counts = " | ".join(map(str, states))
        yield f"| `{number[0].key}` | {counts} | {np.mean(good):.0%} | {wide:.2f} |"
    yield f"| all {len(inside)} | | | | | {np.mean(inside):.1%} | |"
    yield f"| identified {len(identified)} | | | | | {np.mean(identified):.1%} | |"
    distances = sorted(one.distance for one in outcomes)
    yield ""
    yield f"mean square error in the covariance: {', '.join(f'{d:.2f}' for d in distances)}"
    far = [(abs(r.error) / r.deviation, r.key) for one in outcomes for r in one.rows]
    yield "farthest: " + ", ".join(f"{key} {d:.1f}" for d, key in sorted(far, reverse=True)[:5])


def batch(
    count: int, jobs: int, folder: Path | None, one: Callable[[int], Outcome] = outcome
) -> list[Outcome]:
    """Return the outcome of ``one`` for ``count`` seeds; those in ``folder`` are read there."""
    tasks = [(f"log_{seed}", one, (seed,)) for seed in range(1, count + 1)]
    store: Store[Outcome] | None = None
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        store = JsonRows(folder, "", Outcome)
    outcomes = []
    with engine(LOCAL, jobs) as where:
        for name, result, _ in results(where, store, tasks):
            outcomes.append(result)
            print(name, file=sys.stderr, flush=True)
    return outcomes


def main(arguments: list[str]) -> int:
    """Run the command; return the exit code."""
    match arguments:
        case [count, *more] if len(more) < 3 and all(map(str.isdecimal, (count, *more[:1]))):
            folder = Path(more[1]) if more[1:] else None
            print("\n".join(table(batch(int(count), int(more[0]) if more else 1, folder))))
            return 0
    print(__doc__, file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
