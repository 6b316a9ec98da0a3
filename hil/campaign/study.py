"""A campaign: drive the chunks of a plan that are not there yet, and sum up the table."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from canroll.errors import CanrollError
from hil.campaign.engine import LOCAL, engine, results
from hil.campaign.plan import HELPS, Columns, Plan, drive_chunk
from hil.campaign.space import RANDOM
from hil.campaign.store import Store, chunk_name, table_of
from hil.campaign.summary import Summary, count_of, plain, reduction
from hil.runs.experiment import simulate
from hil.runs.result import Result

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


@dataclass(frozen=True, slots=True)
class Campaign:
    """What a campaign found.

    Attributes:
        plan: what was planned.
        nominal: the run of the nominal settings.
        summary: what is kept of the draws.
        until: the rule by which it stopped, or None.
        table: path of the whole table, or None.
    """

    plan: Plan
    nominal: Result
    summary: Summary
    until: Until | None = None
    table: Path | None = None

    @property
    def verdict(self) -> str:
        """The verdict in one line."""
        found, draws = self.summary, self.summary.draws
        others = [f"{n} {word}" for word, n in found.verdicts.items() if n and word != HELPS]
        text = f": {', '.join(others)}" if others else ""
        return f"Control is good in {draws - found.fails} of {draws} runs{text}"

    @property
    def hardest(self) -> dict[str, Any]:
        """The hardest draw."""
        return plain(self.summary.worst, 0)

    def to_json(self) -> dict[str, Any]:
        """Return the object printed by ``canroll campaign --json``."""
        plan, found = self.plan, self.summary
        return {
            "scenario": plan.settings.scenario,
            "vehicle": plan.settings.vehicle.name,
            "law": plan.settings.law,
            "runs": found.draws,
            "seed": plan.sampling.seed,
            "sampling": plan.sampling.method,
            "draw": plan.description["draw"],
            "correlations": plan.description["correlations"],
            "verdict": self.verdict,
            "failed": [int(draw) for draw in found.failed.get("draw", ())],
            "hardest": self.hardest["draw"],
            "probabilities": probabilities(self),
            "quantiles": found.quantiles(),
            "worst": [
                plain(found.worst, row) | {"reduction": float(reduction(found.worst)[row])}
                for row in range(count_of(found.worst))
            ],
        }


def probabilities(campaign: Campaign) -> dict[str, dict[str, Any]]:
    """Return count, share and interval of every event, and by which method."""
    found, until = campaign.summary, campaign.until
    independent = campaign.plan.sampling.method == RANDOM
    method = "exact" if independent else "as if independent"
    answer = {}
    for name, count in found.events.items():
        interval = found.interval(name) if until is None else found.sequence(name)
        answer[name] = {
            "count": count,
            "share": count / found.draws,
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
    """

    store: Store | None = None
    scheduler: str = LOCAL
    jobs: int = 1
    watch: Watch | None = None

    def drive(self, plan: Plan, chunks: Sequence[int]) -> Iterator[Summary]:
        """Drive chunks that the store does not have; yield the summary after each, in order.

        Raises:
            CanrollError: a draw cannot be driven, or a chunk cannot be kept.
            KeyboardInterrupt: Ctrl-C; the chunks in work are finished and kept.
        """
        tasks: Iterable[tuple[str, Callable[..., Columns], tuple[Any, ...]]] = (
            (chunk_name(chunk), drive_chunk, (plan, chunk)) for chunk in chunks
        )
        summary, kept_draws = Summary(), 0
        with engine(self.scheduler, self.jobs) as where:
            for _, rows, kept in results(where, self.store, tasks):
                summary.add(rows)
                kept_draws += count_of(rows) if kept else 0
                if self.watch is not None:
                    self.watch(summary, kept_draws)
                yield summary


def run(plan: Plan, means: Means, *, until: Until | None = None) -> Campaign:
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
    used, summary = 0, Summary()
    for used, summary in enumerate(means.drive(plan, range(plan.chunks)), 1):  # noqa: B007
        if until is not None and until.reached(summary):
            break
    table = None
    if means.store is not None:
        table = table_of(means.store.folder)
        means.store.join((chunk_name(chunk) for chunk in range(used)), table)
    return Campaign(plan, nominal, summary, until, table)


def run_shard(plan: Plan, means: Means, shard: tuple[int, int]) -> int:
    """Drive every ``shard[1]``-th chunk from the ``shard[0]``-th, counted from 1, on.

    Returns the number of its chunks.

    Raises:
        CanrollError: as of :meth:`Means.drive`.
    """
    first, of = shard
    chunks = range(first - 1, plan.chunks, of)
    for _ in means.drive(plan, chunks):
        pass
    return len(chunks)


def merge(folders: Sequence[Path], store: Store, plan: Plan) -> None:
    """Bring the chunks of the shards in ``folders`` to one store.

    Raises:
        CanrollError: a folder holds another campaign, or chunks are missing; the message says
            which.
    """
    missing = []
    for chunk in range(plan.chunks):
        name = chunk_name(chunk)
        others = (Store(folder, plan.digest) for folder in folders if folder != store.folder)
        found = None if store.has(name) else next((o for o in others if o.has(name)), None)
        if found is not None:
            store.take(found, name)
        elif not store.has(name):
            missing.append(chunk)
    if missing:
        shown = ", ".join(map(str, missing[:5])) + (" …" if len(missing) > 5 else "")
        raise CanrollError(
            f"merge: {len(missing)} of {plan.chunks} chunks are missing ({shown}): finish their "
            "shards first"
        )
