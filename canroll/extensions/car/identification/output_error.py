"""Output error: unknowns at which the simulated car moves as the measured one, given their priors.

Maximum a posteriori with unknown noise (Maine and Iliff, NASA RP-1168): least squares over the
signals, each weighted by the RMS of its own residual in the pass before, and over the priors.
Residuals that are correlated over τ samples count as if there were τ times fewer.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from canroll.cases.engine import HERE, Engine, results
from canroll.errors import CanrollError
from canroll.extensions.car.identification import replay, unknowns
from canroll.extensions.car.identification.colour import correlation_times
from canroll.extensions.car.identification.pieces import Piece, Window
from canroll.extensions.car.identification.unknowns import STEERING_OFFSET, Unknown
from canroll.typing import Vector
from canroll.vehicles import Vehicle
from canroll.vehicles.check import problems

DIFFERENCE = 1e-5
"""Step of the numerical derivatives, in standard deviations of the priors.

Far below the deviation that a log leaves, which of a car near its limit is 2e-3: over a step as
long the response bends, and numbers that are known together alone seem to be known apart.
Deviations are the same for steps from 5e-5 to 1e-6; a drive's rounding matters below 1e-8.
"""
IMPOSSIBLE = 1e3
"""Residual, in standard deviations, where no car can have the numbers, or it rolls over."""
FIRST_NOISE = 0.1
"""Residual of a signal in its own standard deviation that the first pass assumes."""
ROUNDING = 1e-12
"""Distance of points that are the same."""
EVALUATIONS = 30
SETTLED = 0.05
"""A search ends where a step lowers the cost by less: no number moves by a third of its deviation.
"""
ROUGH = 2.0
"""The same for a search that only tells which start is the best."""
WHITE_PASSES = 2

Slopes: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A vehicle, the pieces of a log, and what is unknown of both.

    ``frame`` is a key of ``replay.FRAMES``, ``window`` what is compared.
    """

    vehicle: Vehicle
    pieces: tuple[Piece, ...]
    frame: str
    window: Window
    unknowns: tuple[Unknown, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The measured signals."""
        return self.pieces[0].names

    @property
    def bounds(self) -> tuple[Vector, Vector]:
        """Bounds of the unknowns' coordinates."""
        least = np.array([unknown.coordinate(unknown.least) for unknown in self.unknowns])
        most = np.array([unknown.coordinate(unknown.most) for unknown in self.unknowns])
        return least, most

    @property
    def measured(self) -> NDArray[np.float64]:
        """Measured signals of all pieces, (n, m)."""
        return np.concatenate([piece.measured for piece in self.pieces])

    @property
    def compared(self) -> NDArray[np.bool_]:
        """Which of them count."""
        return np.concatenate([piece.compared(self.window) for piece in self.pieces])

    def values(self, x: Vector) -> dict[str, float]:
        """Return the numbers at the coordinates ``x``, by key."""
        return {u.key: u.value(at) for u, at in zip(self.unknowns, x.tolist(), strict=True)}

    def motions(self, x: Vector) -> list[NDArray[np.float64]] | None:
        """Return the records of all pieces; None where no car can have the numbers."""
        values = self.values(x)
        offset = values.get(STEERING_OFFSET, 0.0)
        try:
            vehicle = unknowns.applied(self.vehicle, values)
            if any(problems(vehicle)):
                return None
            records = [replay.motion(vehicle, piece, offset) for piece in self.pieces]
        except CanrollError:
            return None
        return records if all(np.isfinite(record).all() for record in records) else None

    def observed(self, x: Vector, records: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return what the sensors show of records, (n, m)."""
        values, columns = self.values(x), replay.FRAMES[self.frame]
        parts = []
        for piece, record in zip(self.pieces, records, strict=True):
            parts.append(
                np.column_stack(
                    [
                        replay.sampled(
                            record, columns[name], piece, values.get(unknowns.delay_key(name), 0.0)
                        )
                        + values.get(unknowns.offset_key(name), 0.0)
                        for name in piece.names
                    ]
                )
            )
        return np.concatenate(parts)

    def simulated(self, x: Vector) -> NDArray[np.float64] | None:
        """Return the simulated signals, (n, m); None where no car can have the numbers."""
        records = self.motions(x)
        return None if records is None else self.observed(x, records)


def _moved(x: Vector, i: int, step: float) -> Vector:
    moved = x.copy()
    moved[i] += step
    return moved


def simulated_at(model: Model, x: Vector) -> NDArray[np.float64] | None:
    """Return the simulated signals of a model at a point: a task of its own."""
    return model.simulated(x)


def simulated_with(
    model: Model, x: Vector, pieces: tuple[Piece, ...]
) -> NDArray[np.float64] | None:
    """Return those of the model with other pieces: a task of its own."""
    return replace(model, pieces=pieces).simulated(x)


class Simulator:
    """Simulated signals of a model and their derivatives; those at the last point are kept.

    Args:
        model: the model.
        where: what drives it at several points, or with several inputs.
        report: called after derivatives are formed.
    """

    def __init__(
        self, model: Model, where: Engine = HERE, report: Callable[[], None] = lambda: None
    ) -> None:
        self.model, self._where, self._report = model, where, report
        self._shared = where.common(model)
        self._at: tuple[Vector, list[NDArray[np.float64]] | None] | None = None
        self._slopes: tuple[Vector, NDArray[np.float64], Slopes] | None = None

    def signals(self, x: Vector) -> NDArray[np.float64] | None:
        """Return the signals at ``x``, (n, m); None where no car can have the numbers."""
        if self._slopes is not None and _same(self._slopes[0], x):
            return self._slopes[1]
        records = self._records(x)
        return None if records is None else self.model.observed(x, records)

    def _records(self, x: Vector) -> list[NDArray[np.float64]] | None:
        if self._at is None or not _same(self._at[0], x):
            self._at = x.copy(), self.model.motions(x)
        return self._at[1]

    def residuals(self, x: Vector) -> NDArray[np.float64]:
        """Return simulated minus measured, (n, m), 0 where nothing is compared."""
        simulated = self.signals(x)
        assert simulated is not None  # where a search has ended
        return residuals(self.model, simulated)

    def slopes(self, x: Vector) -> Slopes:
        """Return the derivatives of the signals, (n, m, p), by differences; 0 where not compared.

        A delay or offset of a signal needs no new drive.
        """
        if self._slopes is not None and _same(self._slopes[0], x):
            return self._slopes[2]
        model, records = self.model, self._records(x)
        assert records is not None  # the search stands nowhere else
        here = model.observed(x, records)
        result, drives = np.zeros((*here.shape, x.size)), []
        for i, unknown in enumerate(model.unknowns):
            if unknown.of_log and unknown.key != STEERING_OFFSET:
                there = model.observed(_moved(x, i, DIFFERENCE), records)
                result[:, :, i] = (there - here) / DIFFERENCE
            else:
                drives.append(i)
        moved = [_moved(x, i, DIFFERENCE) for i in drives]
        for i, ahead in zip(drives, self._drive(moved), strict=True):
            if ahead is not None:
                result[:, :, i] = (ahead - here) / DIFFERENCE
                continue
            behind = model.simulated(_moved(x, i, -DIFFERENCE))
            if behind is not None:
                result[:, :, i] = (here - behind) / DIFFERENCE
        result[~model.compared] = 0.0
        self._slopes = x.copy(), here, result
        self._report()
        return result

    def _drive(self, points: Iterable[Vector]) -> Iterator[NDArray[np.float64] | None]:
        tasks = ((f"{i}", simulated_at, (self._shared, x)) for i, x in enumerate(points))
        return (signals for _, signals, _ in results(self._where, None, tasks))

    def of_inputs(
        self, x: Vector, inputs: Iterable[tuple[Piece, ...]]
    ) -> Iterator[NDArray[np.float64] | None]:
        """Yield the signals at ``x``, (n, m), with other pieces; None where it cannot drive so."""
        tasks = (
            (f"{i}", simulated_with, (self._shared, x, pieces)) for i, pieces in enumerate(inputs)
        )
        return (signals for _, signals, _ in results(self._where, None, tasks))


def _same(x: Vector, other: Vector) -> bool:
    """Whether two points are one, but for rounding."""
    return bool(np.abs(x - other).max() < ROUNDING)


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """Where a search has ended.

    Attributes:
        x: coordinates of the unknowns.
        cost: half the sum of squares there.
        scale: residual of each signal that counts as one (m), √τ times its RMS.
    """

    x: Vector
    cost: float
    scale: Vector


def first_scale(model: Model) -> Vector:
    """Return the scale of the residuals for a first pass."""
    measured = np.where(model.compared, model.measured, np.nan)
    return np.asarray(FIRST_NOISE * np.maximum(np.nanstd(measured, axis=0), 1e-9))


def residuals(model: Model, simulated: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return simulated minus measured, (n, m), 0 where nothing is compared."""
    compared = model.compared
    return np.where(compared, simulated - np.where(compared, model.measured, 0.0), 0.0)


def search(
    simulator: Simulator, begin: Point, free: NDArray[np.bool_], least: float = SETTLED
) -> Point:
    """Search from a point, with its scale, for the ``free`` unknowns; the others stay there.

    It ends where a step lowers the cost by less than ``least``.
    """
    model, x, scale = simulator.model, begin.x, begin.scale
    count = model.compared.size

    # the first trust region is as large as the start: by this shift a deviation of each unknown
    def full(shifted: Vector) -> Vector:
        whole = x.copy()
        whole[free] = shifted - 1.0
        return whole

    def weighted(part: Vector) -> Vector:
        simulated = simulator.signals(full(part))
        if simulated is None:
            return np.concatenate((np.full(count, IMPOSSIBLE), part - 1.0))
        return np.concatenate(((residuals(model, simulated) / scale).ravel(), part - 1.0))

    def slopes(part: Vector) -> NDArray[np.float64]:
        derivatives = simulator.slopes(full(part))[:, :, free] / scale[:, None]
        return np.concatenate((derivatives.reshape(count, -1), np.eye(part.size)))

    low, high = model.bounds
    start = np.clip(x[free], low[free] + 1e-9, high[free] - 1e-9)
    solved = least_squares(
        weighted,
        start + 1.0,
        slopes,
        (low[free] + 1.0, high[free] + 1.0),
        ftol=least / (0.5 * model.compared.sum()),
        xtol=1e-4,
        max_nfev=EVALUATIONS,
    )
    return Point(full(solved.x), float(solved.cost), scale)


def refined(simulator: Simulator, point: Point) -> Point:
    """Search again from a point, with the weights of the residuals.

    At first they count as white. Correlation is judged by what the best fit leaves: residuals of a
    car far from the measured one would make the log worth little, and keep it far.
    """
    every = np.ones(point.x.size, bool)
    for _ in range(WHITE_PASSES):
        white, _ = weights(simulator, point.x)
        point = search(simulator, Point(point.x, inf, white), every)
    white, times = weights(simulator, point.x)
    return search(simulator, Point(point.x, inf, white * np.sqrt(times)), every)


def weights(simulator: Simulator, x: Vector) -> tuple[Vector, Vector]:
    """Return of each signal the RMS of its residuals at a point, and their correlation time.

    The time is in samples, at least 1.
    """
    errors, compared = simulator.residuals(x), simulator.model.compared
    rms = np.sqrt((errors**2).sum(axis=0) / np.maximum(compared.sum(axis=0), 1))
    return np.maximum(rms, 1e-12), correlation_times(errors, compared)


def starts(model: Model, count: int, seed: int) -> Iterator[Vector]:
    """Yield the prior mean, and ``count`` − 1 draws of the vehicle's numbers from the prior."""
    least, most = model.bounds
    of_log = np.array([unknown.of_log for unknown in model.unknowns])
    yield np.zeros(len(of_log))
    generator = np.random.default_rng(seed)
    for _ in range(count - 1):
        for _ in range(100):
            x = np.where(of_log, 0.0, generator.standard_normal(len(of_log)))
            x = np.clip(x, least, most)
            if model.motions(x) is not None:
                yield x
                break


def searched(simulator: Simulator, x: Vector) -> Point:
    """Search roughly from one start over all unknowns, with the weights of a first pass."""
    every = np.ones(x.size, bool)
    return search(simulator, Point(x, inf, first_scale(simulator.model)), every, ROUGH)
