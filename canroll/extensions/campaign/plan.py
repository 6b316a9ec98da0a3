"""The plan of a campaign: which draws there are, and how one is driven."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.cases.identity import fingerprint, identity
from canroll.errors import CanrollError
from canroll.extensions.campaign import quantities
from canroll.extensions.campaign.figures import figures
from canroll.extensions.campaign.quantities import FAULTS
from canroll.extensions.campaign.space import Sampling, Space
from canroll.runs.metrics import METRICS, harm, helps
from canroll.runs.result import Run
from canroll.setup.controller import Controller

HELPS, STAYS_HARMLESS = "helps", "harmless"
NO_HELP, LIMIT_CYCLE, ROLLOVER = "does not help", "limit cycle", "rolls over"
VERDICTS = (HELPS, STAYS_HARMLESS, NO_HELP, LIMIT_CYCLE, ROLLOVER)
GOOD = (HELPS, STAYS_HARMLESS)
SIDES = ("passive", "controlled")
TRIES = 100
"""Points that are drawn instead of one that is not a vehicle, at most."""

Columns = dict[str, NDArray[Any]]
"""Columns of a table by name, all of the same length; text has the type U or object."""


@dataclass(frozen=True)
class CampaignPlan:
    """A campaign: all that decides its table, byte for byte.

    Attributes:
        settings: nominal settings.
        controller: the controller, designed once.
        space: the quantities that are drawn.
        sampling: how.
        runs: number of draws.
    """

    settings: Run
    controller: Controller
    space: Space
    sampling: Sampling
    runs: int

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.runs // self.sampling.chunk)

    @cached_property
    def description(self) -> dict[str, Any]:
        """Everything that decides the table, as plain data."""
        drawn = dict(zip(self.space.names, self.space.distributions, strict=True))
        values = [value for each in drawn.values() for value in each.extremes()]
        buses = drawn["bus"].extremes() if "bus" in drawn else ()
        return {
            **identity(self.settings, self.controller, buses=map(str, buses), others=values),
            "runs": self.runs,
            **asdict(self.sampling),
            "draw": {name: distribution.to_json() for name, distribution in drawn.items()},
            "correlations": [asdict(pair) for pair in self.space.correlations],
        }

    @cached_property
    def digest(self) -> str:
        """Fingerprint of the description."""
        return fingerprint(self.description)

    def numbers(self, chunk: int) -> range:
        """Return the numbers of the draws in a chunk."""
        first = chunk * self.sampling.chunk
        return range(first, min(first + self.sampling.chunk, self.runs))

    def draws(self, chunk: int) -> tuple[Columns, list[Run]]:
        """Return columns with the drawn quantities, and the settings, of a chunk's draws.

        ``redrawn`` says how many points were no vehicle before the one that is.

        Raises:
            CanrollError: no valid vehicle was drawn.
        """
        numbers = self.numbers(chunk)
        points = self.sampling.points(chunk, self.space.size)[: len(numbers)]
        valid = [self._valid(*each) for each in zip(points, numbers, strict=True)]
        columns: Columns = {
            "draw": np.array(numbers, dtype=np.int64),
            "redrawn": np.array([tries for _, _, tries in valid], dtype=np.int64),
            **self.columns([values for values, _, _ in valid]),
        }
        return columns, [settings for _, settings, _ in valid]

    def draw(self, number: int) -> Run:
        """Return the settings of one draw.

        Raises:
            CanrollError: no valid vehicle was drawn.
        """
        chunk, row = divmod(number, self.sampling.chunk)
        point = self.sampling.points(chunk, self.space.size)[row]
        return self._valid(point, number)[1]

    def _valid(self, point: NDArray[np.float64], number: int) -> tuple[dict[str, Any], Run, int]:
        """Return values and settings at the point, or at an independent one, and the tries."""
        others = self.sampling.again(number, self.space.size)
        for tries in range(TRIES + 1):
            values, settings = self.at(next(others) if tries else point, number)
            if quantities.is_vehicle(settings.vehicle):
                return values, settings, tries
        raise CanrollError(
            f"draw {number}: no valid vehicle in {TRIES} draws: reduce the spread (values of "
            f"vehicle.… are factors: {{ uniform = [0.9, 1.1] }})"
        )

    def at(self, point: NDArray[np.float64], seed: int) -> tuple[dict[str, Any], Run]:
        """Return values and settings at a unit point, with the seed of noise and background."""
        values = self.space.values(point)
        return values, quantities.drawn(self.settings, values, seed=seed)

    def columns(self, draws: Sequence[Mapping[str, Any]]) -> Columns:
        """Return the drawn values as columns of a table: numbers, or text."""
        return {name: _column(name, [draw[name] for draw in draws]) for name in self.space.names}


def _column(name: str, values: list[Any]) -> NDArray[Any]:
    if name == FAULTS:
        return np.array(["; ".join(faults) for faults in values], dtype=object)
    text = any(isinstance(value, str) for value in values)
    return np.array(values, dtype=object if text else np.float64)


def drive_chunk(plan: CampaignPlan, chunk: int) -> Columns:
    """Drive the draws of a chunk without and with control; return their rows of the table.

    Raises:
        CanrollError: a draw cannot be driven, or another version of canroll planned it.
    """
    planned = plan.description["canroll"]
    if planned != version("canroll"):
        raise CanrollError(
            f"this worker has canroll {version('canroll')}, the campaign {planned}: install the "
            "same version on every machine"
        )
    numbers = plan.numbers(chunk)
    try:
        columns, settings = plan.draws(chunk)
        return {**columns, **driven(plan.controller, settings)}
    except CanrollError as error:
        # of one argument, unlike its subclasses: it has to travel between processes
        raise CanrollError(f"draws {numbers[0]} to {numbers[-1]}: {error}") from None


def driven(controller: Controller, settings: list[Run]) -> Columns:
    """Return the columns of figures and verdicts of draws."""
    metrics = figures(controller, settings)
    columns: Columns = {
        f"{side}_{metric.key}": np.ascontiguousarray(metrics[side][metric.key])
        for side in SIDES
        for metric in METRICS
    }
    for name in ("safe", "cycle_hz", "cycle_nm"):
        columns[name] = np.ascontiguousarray(metrics[name])
    faulted = np.array([bool(each.faults) for each in settings])
    return {**columns, "verdict": verdicts(columns, faulted)}


def verdicts(columns: Mapping[str, NDArray[Any]], faulted: NDArray[np.bool_]) -> NDArray[Any]:
    """Return the verdict of each row; the rules are those of a run."""
    passive, controlled = (of_side(columns, side) for side in SIDES)
    over, under = controlled["rollover"], passive["rollover"]
    cycle = columns["cycle_nm"] > 0.0
    harmless = faulted & (harm(passive, controlled) < 1.0)
    return np.select(
        [helps(passive, controlled, cycle), over & ~under, cycle, harmless],
        [HELPS, ROLLOVER, LIMIT_CYCLE, STAYS_HARMLESS],
        NO_HELP,
    ).astype(object)


def of_side(columns: Mapping[str, NDArray[Any]], side: str) -> dict[str, NDArray[Any]]:
    """Return the metrics without or with control by their keys."""
    return {metric.key: columns[f"{side}_{metric.key}"] for metric in METRICS}
