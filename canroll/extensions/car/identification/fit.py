"""A vehicle fitted to a measured drive: its numbers, how sure they are, and what stays a guess."""

from collections.abc import Collection, Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from canroll.cases.engine import LOCAL, engine
from canroll.errors import CanrollError
from canroll.extensions.car.identification import unknowns
from canroll.extensions.car.identification.actuator_fit import Actuator
from canroll.extensions.car.identification.agreement import Agreement, agreement
from canroll.extensions.car.identification.drive_log import QUANTITIES, Log
from canroll.extensions.car.identification.information import (
    Information,
    felt,
    fisher_at,
    information,
    numbers_at,
    together,
)
from canroll.extensions.car.identification.log_checks import check
from canroll.extensions.car.identification.moments import moments
from canroll.extensions.car.identification.output_error import (
    Model,
    Point,
    Simulator,
    refined,
    search,
    searched,
    starts,
)
from canroll.extensions.car.identification.pieces import EVERYTHING, SAMPLE, Piece, Window, pieces
from canroll.extensions.car.identification.unknowns import FittedNumber
from canroll.table import Table
from canroll.typing import Progress, Vector
from canroll.vehicles import Vehicle
from canroll.vehicles.fit_spread import SECTION, section_of, value_of
from canroll.vehicles.load import from_table
from canroll.vehicles.plausible import implausible

SURPRISING = 3.0
"""Deviations of its prior by which a number contradicts it."""
SAME = 0.02
"""Costs that differ by less, relative, are of one minimum."""
ROUNDS = 4
"""So many times the starts are searched at most, if no minimum is confirmed."""


@dataclass(frozen=True, slots=True)
class FitSettings:
    """How a log is fitted.

    Attributes:
        imu: axes of the inertial unit, a key of ``replay.FRAMES``.
        window: part that is fitted.
        checked: part that is predicted only, of the same log; None: none.
        free: keys to fit though their sources say that they are known.
        held: keys to hold.
        starts: searches from the prior and from draws of it; more where none is confirmed.
        seed: of these draws.
        jobs: processes.
        actuator: whose moments the log has, one of ``moments.KINDS``;
            "": that of the commands.
    """

    imu: str = "body"
    window: Window = EVERYTHING
    checked: Window | None = None
    free: Collection[str] = ()
    held: Collection[str] = ()
    starts: int = 3
    seed: int = 1
    jobs: int = 1
    actuator: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """A piece of the log with the fitted car: ``simulated`` has the shape of its measured."""

    piece: Piece
    simulated: NDArray[np.float64]


def explained(agreements: tuple[Agreement, ...]) -> str:
    """Return in words how much of each signal's variance is explained."""
    return ", ".join(
        f"{QUANTITIES[one.name].label} {100 * one.explained:.2f} %" for one in agreements
    )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Fit:
    """A fitted vehicle.

    Attributes:
        log: its name.
        start: the vehicle at the start.
        vehicle: with the fitted numbers, checked; its sources say how sure they are.
        numbers: all that was unknown.
        covariance: of the numbers, in products of their units (p, p).
        information: of the log.
        pairs: labels of numbers identifiable only together, and their correlation.
        seconds: of the log that were compared.
        agreements: of the part that was fitted.
        predictions: of the part that was predicted only; empty without one.
        minima: cost of every search from the first start on.
        curves: measured and simulated.
        remarks: what was left out, and what is strange, a line each.
        actuators: fitted to the moments of the log.
    """

    log: str
    start: Vehicle
    vehicle: Vehicle
    numbers: tuple[FittedNumber, ...]
    covariance: NDArray[np.float64]
    information: Information
    pairs: tuple[tuple[str, str, float], ...]
    seconds: float
    agreements: tuple[Agreement, ...]
    predictions: tuple[Agreement, ...]
    minima: tuple[float, ...]
    curves: tuple[Curves, ...]
    remarks: tuple[str, ...]
    actuators: tuple[Actuator, ...] = ()

    @property
    def coloured(self) -> tuple[str, ...]:
        """Labels of the signals whose residuals are no noise: another car would leave less."""
        return tuple(QUANTITIES[one.name].label for one in self.agreements if not one.white)

    @property
    def verdict(self) -> str:
        """The answer in a line."""
        states = [number.state for number in self.numbers if not number.unknown.of_log]
        bound = f", {states.count('bound')} at its bound" if "bound" in states else ""
        doubt = ""
        if self.coloured:
            noisy = ", ".join(self.coloured)
            doubt = f"parameters not to be trusted (residuals no noise: {noisy}); "
        return (
            f"{self.start.name} fitted to {self.seconds:.1f} s of {self.log}: {doubt}"
            f"{states.count('identified')} of {len(states)} parameters identified{bound}"
        )

    @property
    def table(self) -> Table:
        """One row for each number: value, deviation, state, and what was known before."""
        return Table([number.to_json() for number in self.numbers])

    def __repr__(self) -> str:
        return f"<{self.verdict}; variance explained: {explained(self.agreements)}>"

    def of_state(self, state: str) -> tuple[FittedNumber, ...]:
        """Return the numbers of a state."""
        return tuple(number for number in self.numbers if number.state == state)

    def to_json(self) -> dict[str, Any]:
        """Return the fit as plain data; ``covariance`` is in the order of ``numbers``."""
        return {
            "log": self.log,
            "vehicle": self.start.reference,
            "seconds": self.seconds,
            "trusted": not self.coloured,
            "agreement": [asdict(one) for one in self.agreements],
            "prediction": [asdict(one) for one in self.predictions],
            "numbers": [number.to_json() for number in self.numbers],
            "covariance": self.covariance.tolist(),
            "identifiable_together": [list(pair) for pair in self.pairs],
            "directions": self.information.directions,
            "minima": list(self.minima),
            "remarks": list(self.remarks),
            **({"actuators": [one.to_json() for one in self.actuators]} if self.actuators else {}),
        }


def fit(
    log: Log,
    vehicle: Vehicle,
    settings: FitSettings,
    progress: Progress = lambda stage, share: None,
) -> Fit:
    """Fit a vehicle to a log.

    Args:
        log: the measured drive.
        vehicle: where the search starts: its numbers are the means of the priors.
        settings: how.
        progress: called with the activity and the share of it that is done.

    Raises:
        CanrollError: the log cannot be used, or no vehicle can have the fitted numbers.
    """
    moved = moments(
        log,
        vehicle,
        settings.actuator,
        settings.window,
        free=settings.free,
        held=settings.held,
    )
    log = moved.log
    parts, remarks = pieces(log, settings.window)
    names = parts[0].names
    free, held = moved.others(settings.free), moved.others(settings.held)
    sought = unknowns.unknowns(vehicle, names, free=free, held=held)
    of_car = np.array([not unknown.of_log for unknown in sought])
    model = Model(vehicle, parts, settings.imu, settings.window, sought)
    check(log, model)
    rounds = 0

    def report() -> None:
        nonlocal rounds
        rounds += 1
        progress("searching", rounds / (rounds + 10))

    with engine(LOCAL, settings.jobs) as where:
        simulator = Simulator(model, where, report)
        point, minima = _best(simulator, settings)
        identifiable = felt(fisher_at(simulator, point))
        if not (of_car & identifiable).any():
            raise CanrollError(
                f"{log.name}: it says nothing of the car beyond what {vehicle.name} has: drive "
                "with more steering"
            )
        point = replace(point, x=_held(model, point.x, identifiable))
        point = search(simulator, point, identifiable)
        progress("searching", 1.0)
        content = information(simulator, point, partial(progress, "drives with other inputs"))
    covariance = content.covariance(identifiable)
    numbers = numbers_at(sought, point.x, covariance, identifiable)
    name = Path(log.name).name
    slopes = np.array([number.unknown.slope(number.value) for number in numbers])
    scaled = covariance * np.outer(slopes, slopes)
    if moved.lag is not None:
        numbers = (*numbers, moved.lag)
        scaled = np.asarray(block_diag(scaled, np.array([[moved.lag.deviation**2]])))
    car = fitted(vehicle, numbers, scaled, name)
    labels = [unknown.label for unknown in sought if not unknown.of_log]
    curves, agreements, predictions = _compared(model, log, settings, point.x)
    unusual = (text.partition(";")[0] for text in implausible(car))
    remarks += (*moved.remarks, *_strange(numbers), *unusual)
    remarks += (*_missed(content), *_searched(minima, agreements))
    return Fit(
        log=name,
        start=vehicle,
        vehicle=car,
        numbers=numbers,
        covariance=scaled,
        information=content,
        pairs=tuple(together(covariance[np.ix_(of_car, of_car)], labels)),
        seconds=float(model.compared.any(axis=1).sum() * SAMPLE),
        agreements=agreements,
        predictions=predictions,
        minima=minima,
        curves=curves,
        remarks=remarks,
        actuators=moved.actuators,
    )


def _best(simulator: Simulator, settings: FitSettings) -> tuple[Point, tuple[float, ...]]:
    """Return the best minimum, refined, and the cost of every search.

    While it is doubtful, as many further starts are searched, up to :data:`ROUNDS` times as many.
    """
    model = simulator.model
    begins = starts(model, ROUNDS * settings.starts, settings.seed)
    points: list[Point] = []
    best = None
    for _ in range(ROUNDS):
        points += [searched(simulator, x) for x in islice(begins, settings.starts)]
        lowest = min(points, key=lambda point: point.cost)
        if lowest is not best:
            best, point = lowest, refined(simulator, lowest)
        minima = tuple(each.cost for each in points)
        if not _doubtful(minima, white=all(one.white for one in _agreements(model, point.x))):
            break
    return point, minima


def _held(model: Model, x: Vector, free: NDArray[np.bool_]) -> Vector:
    """Return where a search with the numbers that are not felt at their priors can begin.

    That is as near to ``x`` as a car can have the numbers, at least the car of the start.
    """
    for share in np.linspace(1.0, 0.0, 11):
        begin = np.where(free, share * x, 0.0)
        if model.motions(begin) is not None:
            return np.asarray(begin)
    raise CanrollError(f"{model.vehicle.name}: cannot be driven as in the log")


def _strange(numbers: tuple[FittedNumber, ...]) -> list[str]:
    remarks = []
    for number in numbers:
        unknown = number.unknown
        away = unknown.coordinate(number.value)
        if abs(away) > SURPRISING and not unknown.of_log:
            remarks.append(
                f"{unknown.label}: {number.value:.3g} {unknown.unit} is {abs(away):.1f} deviations "
                f"of the prior from {unknown.mean:.3g}: check its source, or the log's units"
            )
        if number.state == "bound":
            remarks.append(f"{unknown.label}: at its bound, {number.value:.3g}: not fitted")
    return remarks


def _missed(content: Information) -> Iterator[str]:
    """Yield what the deviations do not allow for."""
    if not content.of_inputs:
        yield (
            "the noise of the measured steering and speed is not in the deviations: the fitted car "
            "could not be driven with any other draw of it"
        )


def _searched(minima: tuple[float, ...], agreements: tuple[Agreement, ...]) -> Iterator[str]:
    """Yield what the searches' minima say of the best, which may be none of the whole range.

    Noise that is left over confirms it, another search that ended there too.
    """
    other = _worse(minima)
    if _doubtful(minima, white=all(one.white for one in agreements)):
        yield (
            "the fit did not converge to the noise: the residuals are correlated, and only one of "
            f"{len(minima)} searches ended in the best minimum, which may be none of the car's: "
            f"give --starts {len(minima)}"
        )
    elif other:
        yield f"{other} of {len(minima)} searches ended in a worse minimum: the best is taken"


def _worse(minima: tuple[float, ...]) -> int:
    """Return how many searches ended in another minimum than the best."""
    return sum(cost > (1.0 + SAME) * min(minima) for cost in minima)


def _doubtful(minima: tuple[float, ...], *, white: bool) -> bool:
    """Whether neither noise that is left over nor another search confirms the best minimum."""
    return _worse(minima) == len(minima) - 1 and not white


def _compared(
    model: Model, log: Log, settings: FitSettings, x: Vector
) -> tuple[tuple[Curves, ...], tuple[Agreement, ...], tuple[Agreement, ...]]:
    """Return the curves, and the agreement of what was fitted and of what was predicted."""
    own = _agreements(model, x)
    shown, predicted = model, own[:0]
    if settings.checked is not None:
        wide = Window(
            min(settings.window.begin, settings.checked.begin),
            max(settings.window.end, settings.checked.end),
        )
        parts, _ = pieces(log, wide)
        shown = Model(model.vehicle, parts, model.frame, settings.checked, model.unknowns)
        if not shown.compared.any():
            raise CanrollError(f"{log.name}: nothing of it to check in the window of --check")
        predicted = _agreements(shown, x)
    simulated = shown.simulated(x)
    assert simulated is not None  # the search has ended there
    ends = np.cumsum([len(piece.speed) for piece in shown.pieces])[:-1]
    parts_of = np.split(simulated, ends)
    curves = tuple(Curves(p, s) for p, s in zip(shown.pieces, parts_of, strict=True))
    return curves, own, predicted


def _agreements(model: Model, x: Vector) -> tuple[Agreement, ...]:
    simulated = model.simulated(x)
    assert simulated is not None  # the search has ended there
    steering = np.concatenate([piece.steering for piece in model.pieces])
    measured, compared = model.measured, model.compared
    filled = np.where(np.isfinite(measured), measured, 0.0)
    return tuple(
        agreement(name, filled[:, i], simulated[:, i], steering, compared[:, i])
        for i, name in enumerate(model.names)
    )


def fitted(
    vehicle: Vehicle,
    numbers: tuple[FittedNumber, ...],
    covariance: NDArray[np.float64],
    log: str,
) -> Vehicle:
    """Return the vehicle with fitted numbers, whose sources have their standard deviations.

    Numbers that the log does not tell keep theirs. A body without load that the vehicle's file
    has would contradict the fitted one, and is left out.

    Args:
        vehicle: where the fit started.
        numbers: all that was unknown.
        covariance: of the numbers (p, p), in products of their units; the spread of those that the
            log does not tell is their prior's.
        log: its name.

    Raises:
        CanrollError: no vehicle can have the numbers.
    """
    own = [n for n in numbers if not n.unknown.of_log and n.state != "kept"]
    changed = unknowns.applied(vehicle, {n.unknown.key: n.value for n in own})
    table = changed.document
    sources = table["sources"]
    spreads: dict[str, list[str]] = {}
    for number in own:
        key, _, place = number.unknown.key.partition(".imu_position.")
        spread = f"±{number.deviation:.2g}"
        if number.unknown.least > 0.0:
            spread = f"±{100 * number.deviation / number.value:.2g} %"
        key = f"{key}.imu_position" if place else key
        condition = " (only in combination)" if number.state == "together" else ""
        word = "at its bound" if number.state == "bound" else "fitted"
        spreads.setdefault(key, []).append(
            f"{word} {spread}{condition}, {number.unknown.mean:.4g} before"
            + (f" [{place}]" if place else "")
        )
    for key, texts in spreads.items():
        sources[key] = f"{'; '.join(texts)}; on {log}"
    for key, before in (
        ("suspension.spring_rate_front", vehicle.suspension.spring_rate_front),
        ("suspension.spring_rate_rear", vehicle.suspension.spring_rate_rear),
        ("mass.pitch_inertia", vehicle.mass.pitch_inertia),
    ):
        if value_of(changed, key) != before:
            sources[key] = f"follows from the numbers fitted on {log}: {before:.4g} before"
    plant = any(n.unknown.key.startswith("plant.") for n in own)
    if plant and "empty" in table:
        del table["empty"]
        for key in [key for key in sources if key.partition(".")[0] == "empty"]:
            del sources[key]
    if plant and vehicle.design == vehicle.plant:
        for key in [key for key in sources if key.partition(".")[0] == "design"]:
            del sources[key]
        sources["design"] = "equal to the plant"
    table["title"] = f"{vehicle.title}, fitted"
    table["basis"] = f"fitted on {log}; before: {vehicle.basis}"
    of_car = [i for i, number in enumerate(numbers) if not number.unknown.of_log]
    keys = [numbers[i].unknown.key for i in of_car]
    table[SECTION] = section_of(log, keys, covariance[np.ix_(of_car, of_car)])
    return from_table(table, name=vehicle.name, where=f"fitted {vehicle.name}", unusual=None)
