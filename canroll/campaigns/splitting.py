"""Subset simulation over the draws of a campaign: where its samples are driven and kept."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.campaigns import quantities
from canroll.campaigns.events import EVENTS, LEVELLED
from canroll.campaigns.plan import CampaignPlan, Columns, driven
from canroll.campaigns.rare import SHARE, Estimate, Matrix, Vector, estimate, pieces
from canroll.campaigns.space import RANDOM
from canroll.campaigns.store import Chunks, table_of
from canroll.campaigns.study import Means
from canroll.cases.engine import engine, results
from canroll.cases.identity import fingerprint
from canroll.errors import CanrollError, UnknownNameError
from canroll.runs.result import Settings

PIECE = 16
"""Samples driven and written at once."""
UNIT = "unit_"
LEAST_SAMPLES = 100


@dataclass(frozen=True)
class Splitting:
    """An estimate of the probability of a rare event.

    Attributes:
        plan: the campaign whose draws it is about.
        event: name of the event.
        samples: on each level, a multiple of 10.
    """

    plan: CampaignPlan
    event: str
    samples: int

    def check(self) -> None:
        """Reject an event without levels, draws that are not independent, and too few samples.

        Raises:
            CanrollError: the message names the option.
        """
        if self.event not in LEVELLED:
            raise UnknownNameError("event of --rare", self.event, LEVELLED)
        if self.plan.sampling.method != RANDOM:
            raise CanrollError(
                f"--rare needs independent draws, not sampling = {self.plan.sampling.method!r}"
            )
        if self.samples < LEAST_SAMPLES or self.samples % round(1 / SHARE):
            raise CanrollError(
                f"--samples must be at least {LEAST_SAMPLES} and a multiple of 10, "
                f"got {self.samples}"
            )

    @property
    def description(self) -> dict[str, Any]:
        """Everything that decides the estimate, as plain data; the number of draws does not."""
        own = {"event": self.event, "samples": self.samples, "runs": None, "chunk": PIECE}
        return {**self.plan.description, **own}

    @property
    def digest(self) -> str:
        """Fingerprint of the description."""
        return fingerprint(self.description)

    def run(self, means: Means, progress: Callable[[int, float], None]) -> Estimate:
        """Estimate the probability; samples that the store has are not driven again.

        Args:
            means: how samples are driven, and where they are kept.
            progress: called with the number of samples so far and the last ones' largest level.

        Raises:
            CanrollError: a sample cannot be driven or kept.
            KeyboardInterrupt: Ctrl-C; the pieces in work are finished and kept.
        """
        self.check()
        names: list[str] = []

        with engine(means.scheduler, means.jobs) as where:

            def evaluate(batch: str, points: Matrix, seeds: NDArray[np.int64]) -> Vector:
                tasks = []
                for number, piece in enumerate(pieces(len(seeds), PIECE)):
                    first = PIECE * len(names)
                    names.append(f"{batch}-{number:03d}")
                    work = partial(drive_samples, self.plan, self.event, first)
                    tasks.append((names[-1], work, (points[piece], seeds[piece])))
                levels = []
                for _, rows, _ in results(where, means.store, tasks):
                    levels.append(rows["level"])
                    progress(len(names) * PIECE, float(rows["level"].max()))
                return np.concatenate(levels)

            result = estimate(
                evaluate, self.plan.space.size, samples=self.samples, seed=self.plan.sampling.seed
            )
        if means.store is not None:
            means.store.join(names, table_of(means.store.folder))
        return result

    def first_event(self, folder: Path) -> int:
        """Return the number of the first sample of a finished estimate with the event."""
        rows = Chunks(folder, self.digest).columns(table_of(folder))
        return int(rows["draw"][np.argmax(rows["level"] >= 1.0)])

    def sample(self, folder: Path, number: int) -> Settings:
        """Return the settings of one sample of a finished estimate.

        Raises:
            CanrollError: there is no such sample, or no finished estimate of this event.
        """
        path = table_of(folder)
        if not path.is_file():
            raise CanrollError(f"{path}: no finished estimate: drive it first, with the same --out")
        rows = Chunks(folder, self.digest).columns(path)
        places = np.flatnonzero(rows["draw"] == number)
        if not len(places):
            raise CanrollError(f"--only {number}: {path} has no such sample")
        units = [rows[f"{UNIT}{i}"][places[0]] for i in range(self.plan.space.size)]
        return self.plan.at(np.array(units), int(rows["seed"][places[0]]))[1]


def drive_samples(
    plan: CampaignPlan, event: str, first: int, points: Matrix, seeds: NDArray[np.int64]
) -> Columns:
    """Drive samples at unit points; return their rows, numbered from ``first``.

    A sample whose numbers are no vehicle has the level −inf.

    Raises:
        CanrollError: a sample cannot be driven.
    """
    values, settings = [], []
    for point, seed in zip(points, seeds, strict=True):
        drawn, each = plan.at(point, int(seed))
        values.append(drawn)
        settings.append(each)
    valid = np.array([quantities.is_vehicle(each.vehicle) for each in settings])
    rows: Columns = {
        "draw": np.arange(first, first + len(seeds)),
        "seed": seeds,
        **plan.columns(values),
        **{f"{UNIT}{i}": np.ascontiguousarray(column) for i, column in enumerate(points.T)},
    }
    level = np.full(len(seeds), -np.inf)
    if valid.any():
        try:
            columns = driven(plan.controller, [settings[i] for i in np.flatnonzero(valid)])
        except CanrollError as error:
            raise CanrollError(f"samples from {first} on: {error}") from None
        level_of = EVENTS[event].level
        assert level_of is not None
        level[valid] = level_of(columns)
    return {**rows, "level": level}
