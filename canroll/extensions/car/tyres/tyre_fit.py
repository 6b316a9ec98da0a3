"""Lateral coefficients of the Magic Formula fitted to a measured table, and how sure they are.

Maximum a posteriori: squares of the differences of force, over their own RMS at the fit, and of
the distances from the priors. Forces are those of the plant's kernel.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import atan, copysign, degrees, radians, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from canroll.errors import CanrollError
from canroll.extensions.car.identification.colour import score_covariance
from canroll.extensions.car.identification.information import (
    Information,
    at_least,
    felt,
    numbers_at,
    together,
)
from canroll.extensions.car.identification.unknowns import FittedNumber, Unknown
from canroll.extensions.car.tyres.coefficients import GUESSED, UNSCALED, unknowns
from canroll.extensions.car.tyres.measured import MeasuredTyre
from canroll.plant_sim.bodies.tyre import forces_over
from canroll.typing import Progress, Vector
from canroll.vehicles.tyres.magic_formula import LIMITS, NEEDED, Coefficients, MagicFormula

ROUGH = 0.05
"""Share of the largest force that is the noise of the first search."""
FINEST = 1e-4
"""Share of it that the noise is at least: what a table's digits tell."""
ROUNDS = 3
"""Searches with the noise of the one before."""
SHAPES = (1.4, 1.15, 1.7)
"""Shape factors from which is searched."""
STEP = 1e-3
"""Deviations of the priors over which derivatives are formed."""
CLOSE, COARSE = 1e-8, 1e-5
"""Relative changes of the cost at which a search ends, and at which it does from a rough start."""
INSIDE = 1e-3
"""Deviations by which a search starts within its bounds."""
ONE_SIDED = 0.5
"""Share of the other side's largest angle below which a table is taken for one of one side."""
SAME_ANGLE = radians(0.25)
"""Range of angles (rad) that counts as one."""
SAME_LOAD = 0.05
"""Range of loads that counts as one, over the largest."""
RADIUS = 0.32
"""Unloaded radius (m) where nobody says it."""


@dataclass(frozen=True, slots=True)
class TyreFit:
    """A tyre fitted to a table.

    Attributes:
        table: the measured one.
        tyre: the file's coefficients, with limits of validity.
        numbers: all that was unknown.
        covariance: of the numbers (p, p).
        pairs: keys identifiable only together, and their correlation.
        errors: fitted less measured force (N), (n).
        guessed: keys of the file that no one measured or gave.
        remarks: what was left out, or is strange, a line each.
    """

    table: MeasuredTyre
    tyre: Coefficients
    numbers: tuple[FittedNumber, ...]
    covariance: NDArray[np.float64]
    pairs: tuple[tuple[str, str, float], ...]
    errors: Vector
    guessed: tuple[str, ...]
    remarks: tuple[str, ...]

    @property
    def rms(self) -> float:
        """RMS of the errors (N)."""
        return float(np.sqrt(np.mean(self.errors**2)))

    @property
    def largest(self) -> int:
        """Point of the largest error."""
        return int(np.argmax(np.abs(self.errors)))

    def of_state(self, state: str) -> tuple[FittedNumber, ...]:
        """Return the numbers of a state."""
        return tuple(number for number in self.numbers if number.state == state)

    def to_json(self) -> dict[str, Any]:
        """Return the fit as plain data; ``covariance`` is in the order of ``coefficients``."""
        at = self.largest
        return {
            "table": self.table.name,
            "points": len(self.table),
            "rms": self.rms,
            "largest": {
                "error": float(self.errors[at]),
                "slip_angle": float(self.table.slip_angle[at]),
                "load": float(self.table.load[at]),
                "camber": float(self.table.camber[at]),
            },
            "coefficients": [
                {
                    "key": number.unknown.key,
                    "label": number.unknown.label,
                    "value": number.value,
                    "deviation": number.deviation,
                    "state": number.state,
                    "prior": number.unknown.mean,
                    "prior_deviation": number.unknown.deviation,
                }
                for number in self.numbers
            ],
            "covariance": self.covariance.tolist(),
            "identifiable_together": [list(pair) for pair in self.pairs],
            "guessed": list(self.guessed),
            "remarks": list(self.remarks),
        }


def lateral_forces(tyre: Coefficients, slip: Vector, load: Vector, camber: Vector) -> Vector:
    """Lateral force (N) in the axes of the file, at slip angles and cambers (rad), loads (N)."""
    model, side = MagicFormula.of(tyre), tyre["TYRESIDE"]
    points = np.zeros((len(slip), 6))
    points[:, 0], points[:, 2], points[:, 3] = load, -np.tan(slip), np.sin(camber)
    points[:, 4], points[:, 5] = 1.0, side
    return forces_over(model, points)[:, 1]


def fit(
    table: MeasuredTyre,
    start: Coefficients | None = None,
    radius: float | None = None,
    progress: Progress = lambda stage, share: None,
) -> TyreFit:
    """Fit the lateral coefficients to a table.

    Args:
        table: the measured one.
        start: file whose coefficients are the means of the priors, and whose others stay.
        radius: unloaded radius (m); None: of ``start``, else a guess.
        progress: called with the activity and the share of it that is done.

    Raises:
        CanrollError: ``start`` scales the lateral force, or the table has too few points.
    """
    base, guessed = _base(table, start, radius)
    limits, remarks = _limits(table)
    base = Coefficients({**base.values, **limits})
    problem = _Problem(table, base, unknowns(base, given=start is not None))
    x, noise = _searched(problem, progress, rough=start is None)
    fisher = problem.fisher(x, noise)
    free = felt(fisher)
    x = problem.search(np.where(free, x, 0.0), noise, free)
    slopes, errors = problem.slopes(x) / noise, problem.errors(x)
    white = slopes.T @ slopes
    ones = np.ones((len(errors), 1), dtype=bool)
    scores = score_covariance((slopes / noise)[:, None, :], errors[:, None], ones)
    information = Information(white, at_least(scores, white))
    covariance = information.covariance(free)
    numbers = numbers_at(problem.sought, x, covariance, free)
    deviations = np.array([one.deviation for one in problem.sought])
    tyre = Coefficients({**base.values, **problem.values(x)})
    if start is None:
        tyre = Coefficients({**tyre.values, "PDX1": tyre["PDY1"], "PDX2": tyre["PDY2"]})
    kept = free.nonzero()[0]
    names = [problem.sought[i].key for i in kept]
    return TyreFit(
        table=table,
        tyre=tyre,
        numbers=numbers,
        covariance=covariance * np.outer(deviations, deviations),
        pairs=tuple(together(covariance[np.ix_(kept, kept)], names)),
        errors=errors,
        guessed=guessed,
        remarks=(*table.remarks, *remarks, *_strange(tyre, numbers)),
    )


def _base(
    table: MeasuredTyre, start: Coefficients | None, radius: float | None
) -> tuple[Coefficients, tuple[str, ...]]:
    """Coefficients that are not fitted, and which of them are guesses."""
    if start is None:
        middle = 0.5 * float(table.load.min() + table.load.max())
        values = {"FITTYP": 61.0, "TYRESIDE": 1.0, "FNOMIN": float(f"{middle:.4g}"), **GUESSED}
        values |= {**dict.fromkeys(NEEDED, 1.0), **values}
        values["UNLOADED_RADIUS"] = RADIUS if radius is None else radius
        guessed = (*GUESSED, "PDX1", "PDX2", *(("UNLOADED_RADIUS",) if radius is None else ()))
        return Coefficients(values), guessed
    for key in UNSCALED:
        if start[key] != 1.0:
            raise CanrollError(
                f"--from: {key} = {start[key]:g} scales the lateral force, but the table is of the "
                "tyre as it is: set it to 1 there, and scale the fitted file"
            )
    own = {} if radius is None else {"UNLOADED_RADIUS": radius}
    return Coefficients({**start.values, **own}), ()


def _limits(table: MeasuredTyre) -> tuple[Mapping[str, float], list[str]]:
    """Limits of validity of a table; one of a single side is mirrored, and said so."""
    limits = {"FZMIN": float(table.load.min()), "FZMAX": float(table.load.max())}
    remarks = []
    if limits["FZMAX"] - limits["FZMIN"] < SAME_LOAD * limits["FZMAX"]:
        remarks.append(
            f"loads of {limits['FZMAX']:.0f} N only: other ones are by the coefficients before"
        )
    for name, label, angles in (
        ("ALP", "slip angles", table.slip_angle),
        ("CAM", "cambers", table.camber),
    ):
        low, high = float(angles.min()), float(angles.max())
        if high - low < SAME_ANGLE:
            # nothing is said of others: limits of the start stay
            remarks.append(
                f"{label} of {degrees(high):.1f}° only: other ones are by the coefficients before"
            )
            continue
        most = max(abs(low), abs(high))
        if min(-low, high) < ONE_SIDED * most:
            low, high = -most, most
            remarks.append(
                f"{label} up to {degrees(most):.1f}° on one side only: the other is by the formula"
            )
        limits |= {f"{name}MIN": low, f"{name}MAX": high}
    return limits, remarks


class _Problem:
    """Residuals of a table at coordinates of the unknowns, and their derivatives."""

    def __init__(
        self, table: MeasuredTyre, base: Coefficients, sought: tuple[Unknown, ...]
    ) -> None:
        self.table, self.base, self.sought = table, base, sought
        bounds = [(one.coordinate(one.least), one.coordinate(one.most)) for one in sought]
        self.low, self.high = np.array(bounds).T
        # without its limits, no force is held at one
        self.unlimited = {key: n for key, n in base.values.items() if key not in LIMITS}

    def values(self, x: Vector) -> dict[str, float]:
        """Coefficients at coordinates."""
        return {one.key: one.value(float(z)) for one, z in zip(self.sought, x, strict=True)}

    def errors(self, x: Vector) -> Vector:
        """Computed less measured forces (N)."""
        tyre = Coefficients({**self.unlimited, **self.values(x)})
        table = self.table
        computed = lateral_forces(tyre, table.slip_angle, table.load, table.camber)
        return computed - table.force

    def slopes(self, x: Vector) -> NDArray[np.float64]:
        """Derivatives of the forces by the coordinates (N), (n, p)."""
        result = np.empty((len(self.table), len(x)))
        for i in range(len(x)):
            step = np.zeros(len(x))
            step[i] = STEP
            result[:, i] = (self.errors(x + step) - self.errors(x - step)) / (2.0 * STEP)
        return result

    def fisher(self, x: Vector, noise: float) -> NDArray[np.float64]:
        """Information (p, p) of the table alone."""
        slopes = self.slopes(x) / noise
        return np.asarray(slopes.T @ slopes)

    def search(
        self, begin: Vector, noise: float, free: NDArray[np.bool_], change: float = CLOSE
    ) -> Vector:
        """Coordinates of the least cost, of which only the ``free`` ones change."""
        place = free.nonzero()[0]
        low, high = self.low[place], self.high[place]
        inside = np.clip(begin[place], low + INSIDE, high - INSIDE)

        def residuals(part: Vector) -> Vector:
            x = begin.copy()
            x[place] = part
            return np.concatenate([self.errors(x) / noise, part])

        found = least_squares(residuals, inside, bounds=(low, high), x_scale="jac", ftol=change)
        x = begin.copy()
        x[place] = found.x
        return x

    def cost(self, x: Vector, noise: float) -> float:
        """Sum of squares that a search makes least."""
        return float(np.sum((self.errors(x) / noise) ** 2) + np.sum(x**2))

    def noise(self, x: Vector) -> float:
        """Standard deviation of the forces (N), by what is left over."""
        spare = max(len(self.table) - len(x), 1)
        left = float(np.sqrt(np.sum(self.errors(x) ** 2) / spare))
        return max(left, FINEST * float(np.abs(self.table.force).max()))


def _searched(problem: _Problem, progress: Progress, *, rough: bool) -> tuple[Vector, float]:
    """Return the best of the searches, and the noise there."""
    begins = list(_begins(problem)) if rough else [np.zeros(len(problem.sought))]
    shown = np.abs(problem.slopes(begins[0])).max(axis=0) > 0.0
    if len(problem.table) <= shown.sum():
        raise CanrollError(
            f"{problem.table.name}: {len(problem.table)} points, but {shown.sum()} coefficients "
            "depend on them: more points are needed"
        )
    noise = ROUGH * float(np.abs(problem.table.force).max())
    points, rounds = [], len(begins) + ROUNDS
    for begin in begins:
        points.append(problem.search(begin, noise, shown, COARSE))
        progress("searches", len(points) / rounds)
    x = min(points, key=lambda point: problem.cost(point, noise))
    for done in range(len(points) + 1, rounds + 1):
        noise = problem.noise(x)
        x = problem.search(x, noise, shown)
        progress("searches", done / rounds)
    return x, problem.noise(x)


def _begins(problem: _Problem) -> Iterator[Vector]:
    """Coordinates with the table's grip and slope at the origin, and several shapes."""
    table, base = problem.table, problem.base
    slope = float(table.linear()[0][1])
    by_key = {one.key: one for one in problem.sought}
    nominal = sin(2.0 * atan(1.0 / by_key["PKY2"].mean))
    known = {"PDY1": table.grip, "PKY1": copysign(slope / nominal, base["PKY1"] - 2.0)}
    for shape in SHAPES:
        at = {**known, "PCY1": shape}
        yield np.array(
            [
                one.coordinate(min(max(at[one.key], one.least), one.most)) if one.key in at else 0.0
                for one in problem.sought
            ]
        )


def _strange(tyre: Coefficients, numbers: tuple[FittedNumber, ...]) -> Iterator[str]:
    """Yield what no tyre does within the limits, and coefficients at their bounds."""
    for number in numbers:
        one = number.unknown
        # PKY4 has its usual value at its bound
        away = [abs(number.value - end) for end in (one.least, one.most) if end != one.mean]
        if number.state != "kept" and min(away) < INSIDE * one.deviation:
            yield f"{one.key} ({one.label}): it stands at its bound, {number.value:.3g}"
    loads = np.linspace(tyre["FZMIN"], tyre["FZMAX"], 50)
    falls = np.diff([tyre.grip(float(load)) for load in loads]) < 0.0
    if falls.any():
        first = loads[int(np.argmax(falls))]
        yield f"the largest lateral force falls over load from {first:.0f} N on: is it that tyre?"
