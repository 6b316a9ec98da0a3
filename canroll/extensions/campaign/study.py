"""A campaign: run the missing chunks of a plan and summarise the results."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from canroll.arguments import checked
from canroll.cases.engine import LOCAL, Task, engine, results
from canroll.errors import CanrollError
from canroll.extensions.campaign import campaign_file
from canroll.extensions.campaign.plan import HELPS, CampaignPlan, Columns, drive_chunk
from canroll.extensions.campaign.space import RANDOM
from canroll.extensions.campaign.store import Chunks, chunk_name, opened, table_of
from canroll.extensions.campaign.summary import (
    REDUCTION,
    Summary,
    count_of,
    joined,
    plain,
    reduction,
)
from canroll.runs.conditions import fault_texts
from canroll.runs.experiment import simulate
from canroll.runs.result import Result
from canroll.setup.choice import several
from canroll.setup.choices import CHOICES, check
from canroll.studies.variation import spread_from
from canroll.table import Table

Watch = Callable[[Summary, int], None]
"""Called after each chunk with the summary so far, and how many draws were there already."""


@dataclass(frozen=True, slots=True)
class Until:
    """Stop as soon as the interval of an event's probability is at most ``width`` wide."""

    event: str
    width: float

    def reached(self, summary: Summary) -> bool:
        """Whether the width is reached; the interval is valid at every number of draws."""
        return summary.sequence(self.event).width <= self.width


@dataclass(frozen=True, slots=True, repr=False)
class Campaign:
    """What a campaign found.

    Attributes:
        plan: what was planned.
        nominal: the run of the nominal settings.
        summary: what is kept of the draws.
        until: the rule by which it stopped, or None.
        file: path of the whole table, or None.
        draws: the whole table, if it was kept in memory.
    """

    plan: CampaignPlan
    nominal: Result
    summary: Summary
    until: Until | None = None
    file: Path | None = None
    draws: Columns | None = None

    def __repr__(self) -> str:
        return f"<{self.plan.settings.title}: {self.verdict}>"

    @property
    def table(self) -> Table:
        """One row for each draw: what was drawn, the metrics of both runs, the verdict.

        Raises:
            CanrollError: it was not kept in memory; it is in :attr:`file`.
        """
        if self.draws is None:
            raise CanrollError(f"the table of this campaign is in {self.file}")
        draws = self.draws
        return Table([plain(draws, row) for row in range(count_of(draws))])

    @property
    def verdict(self) -> str:
        """The verdict in one line."""
        summary, draws = self.summary, self.summary.draws
        others = [f"{n} {word}" for word, n in summary.verdicts.items() if n and word != HELPS]
        text = f": {', '.join(others)}" if others else ""
        return f"Control is good in {draws - summary.fails} of {draws} runs{text}"

    @property
    def hardest(self) -> dict[str, Any]:
        """The hardest draw."""
        return plain(self.summary.worst, 0)

    def to_json(self) -> dict[str, Any]:
        """Return the object printed by ``canroll campaign --json``."""
        plan, summary = self.plan, self.summary
        return {
            "scenario": plan.settings.scenario,
            **plan.settings.vehicles,
            "law": plan.settings.law,
            "runs": summary.draws,
            "seed": plan.sampling.seed,
            "sampling": plan.sampling.method,
            "draw": plan.description["draw"],
            "correlations": plan.description["correlations"],
            "verdict": self.verdict,
            "failed": [int(draw) for draw in summary.failed.get("draw", ())],
            "hardest": self.hardest["draw"],
            "worst_by": summary.worst_by,
            "probabilities": probabilities(self),
            "quantiles": summary.quantiles(),
            "worst": [
                plain(summary.worst, row) | {"reduction": float(reduction(summary.worst)[row])}
                for row in range(count_of(summary.worst))
            ],
        }


def probabilities(campaign: Campaign) -> dict[str, dict[str, Any]]:
    """Return count, share and interval of every event, and by which method."""
    summary, until = campaign.summary, campaign.until
    independent = campaign.plan.sampling.method == RANDOM
    method = "exact" if independent else "as if independent"
    answer = {}
    for name, count in summary.events.items():
        interval = summary.interval(name) if until is None else summary.sequence(name)
        answer[name] = {
            "count": count,
            "share": count / summary.draws,
            "low": interval.low,
            "high": interval.high,
            "interval": method if until is None else "at any time",
        }
    return answer


@dataclass(frozen=True, slots=True)
class Means:
    """How the chunks are driven; it does not change the table.

    Attributes:
        store: folder that keeps the chunks; None: none is kept.
        scheduler: "local" or the address of a Dask scheduler.
        jobs: processes of the local scheduler.
        watch: called after each chunk.
        draws: takes the rows of each chunk, in order.
        worst_by: what the hardest draws go by, see :class:`.summary.Summary`.
    """

    store: Chunks | None = None
    scheduler: str = LOCAL
    jobs: int = 1
    watch: Watch | None = None
    draws: Callable[[Columns], None] | None = None
    worst_by: str = REDUCTION

    def drive(self, plan: CampaignPlan) -> Iterator[Summary]:
        """Drive the chunks that the store does not have; yield the summary after each, in order.

        Raises:
            CanrollError: a draw cannot be driven, or a chunk cannot be kept.
            KeyboardInterrupt: Ctrl-C; the chunks in work are finished and kept.
        """
        tasks: Iterable[Task[Columns]] = (
            (chunk_name(chunk), drive_chunk, (plan, chunk)) for chunk in range(plan.chunks)
        )
        summary, kept_draws = Summary(self.worst_by), 0
        with engine(self.scheduler, self.jobs) as where:
            for _, rows, kept in results(where, self.store, tasks):
                summary.add(rows)
                if self.draws is not None:
                    self.draws(rows)
                kept_draws += count_of(rows) if kept else 0
                if self.watch is not None:
                    self.watch(summary, kept_draws)
                yield summary


@checked
def campaign(
    what: str = "double_lane_change",
    *,
    runs: int | None = None,
    seed: int | None = None,
    spread: Mapping[str, float | str] | None = None,
    buses: Sequence[str] | str = (),
    jobs: int = 1,
    folder: str | Path | None = None,
    watch: Watch | None = None,
    **choices: Any,  # noqa: ANN401
) -> Campaign:
    """Drive a controller with many vehicles, buses, noises and faults.

    Args:
        what: the manoeuvre, or a campaign file (``.toml``), which says what is drawn.
        runs: number of draws; None: the file's, or 100.
        seed: of the draws; None: the file's, or that of a run.
        spread: half-widths by quantity as shares of the nominal values, such as
            ``{"sprung_mass": 0.3}``; those left out are the usual ones.
        buses: profiles to draw from evenly; a single one is that of every draw.
        jobs: processes.
        folder: keeps finished chunks; a campaign that was interrupted continues there. Needs
            pyarrow.
        watch: called after each chunk with the summary so far.
        choices: keywords of :func:`canroll.run`; of ``faults``, one or none is drawn.

    Raises:
        CanrollError: an invalid name or number, or a draw that cannot be driven; the message names
            the argument, or file and key.
        MissingExtraError: pyarrow is not installed.
    """
    for name, count in (("jobs", jobs), ("runs", runs)):
        if count is not None and count < 1:
            raise CanrollError(f"{name}={count}: must be at least 1")
    if seed is not None:
        CHOICES["seed"].check(seed)
    check(choices)
    profiles = several(buses)
    plan = request(what, choices, runs=runs, seed=seed, spread=spread or {}, buses=profiles).plan()
    store = None
    if folder is not None:
        store = opened(Path(folder), plan.digest, plan.description, resume=True)
    chunks: list[Columns] = []
    finished = run(plan, Means(store, jobs=jobs, watch=watch, draws=chunks.append))
    draws = chunks[0]
    for more in chunks[1:]:
        draws = joined(draws, more)
    return replace(finished, draws=draws)


def request(
    what: str,
    choices: Mapping[str, Any],
    *,
    runs: int | None,
    seed: int | None,
    spread: Mapping[str, float | str],
    buses: Sequence[str],
    words: Sequence[str] = ("spread", "faults", "buses"),
) -> campaign_file.CampaignRequest:
    """Return the campaign of a file or of arguments, which :func:`campaign` describes.

    Raises:
        CanrollError: an invalid name or number, or what a file says itself, by its name in
            ``words``.
    """
    faults = fault_texts(choices)
    fixed = {k: v for k, v in choices.items() if k not in ("seed", "faults", "fault_file")}
    if buses:
        fixed["bus"] = buses[0]
    if what.endswith(".toml"):
        for word, given in zip(words, (spread, faults, len(buses) > 1), strict=True):
            if given:
                raise CanrollError(f"{word}: write what is drawn into {what}")
        return campaign_file.load(Path(what), fixed, runs=runs, seed=seed)
    return campaign_file.of_options(
        what,
        fixed,
        runs=100 if runs is None else runs,
        seed=CHOICES["seed"].default if seed is None else seed,
        spread=spread_from(spread),
        stated=tuple(spread),
        buses=buses,
        faults=faults,
    )


def run(plan: CampaignPlan, means: Means, *, until: Until | None = None) -> Campaign:
    """Drive all draws of a plan.

    The table depends on the plan and ``until`` alone, not on the means or interruptions.

    Args:
        plan: the draws.
        means: how they are driven, and where they are kept.
        until: when to stop before all draws are driven.

    Raises:
        CanrollError: as of :meth:`Means.drive`, or draws that are not independent.
    """
    if until is not None and plan.sampling.method != RANDOM:
        raise CanrollError(
            f"--until needs independent draws, not sampling = {plan.sampling.method!r}"
        )
    nominal = simulate(plan.settings, plan.controller)
    used, summary = 0, Summary(means.worst_by)
    for used, summary in enumerate(means.drive(plan), 1):  # noqa: B007
        if until is not None and until.reached(summary):
            break
    table = None
    if means.store is not None:
        table = table_of(means.store.folder)
        means.store.join((chunk_name(chunk) for chunk in range(used)), table)
    return Campaign(plan, nominal, summary, until, table)
