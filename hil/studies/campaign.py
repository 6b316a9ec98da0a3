"""Monte Carlo: one calibration against many vehicles, buses, noises and faults."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from typing import Any

import numpy as np

from canroll.errors import CanrollError
from canroll.typing import Progress
from firmware.state import SAFE
from hil.runs.choices import PASSIVE
from hil.runs.experiment import plan, simulate
from hil.runs.frozen import Controller
from hil.runs.result import Result
from hil.studies import variation
from hil.studies.variation import Drawn
from plant_sim.can_bus import load_profile
from plant_sim.faults import parse_all

HARMLESS = 1.02
"""Largest roll angle over that without control, up to which a faulted run has done no harm."""
HELPS, STAYS_HARMLESS = "helps", "harmless"
NO_HELP, LIMIT_CYCLE, ROLLOVER = "does not help", "limit cycle", "rolls over"
GOOD = (HELPS, STAYS_HARMLESS)
QUANTILES = (5, 50, 95)
QUANTITIES = ("roll_max_deg", "roll_rms_deg", "nlt_front_max", "moment_rms_nm", "path_error_max_m")


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of one draw, without and with control.

    Attributes:
        index: number of the draw.
        bus: its profile.
        fault: its fault, or empty.
        factors: drawn factors by quantity.
        passive: figures without control.
        controlled: figures with control.
        safe: fraction of the ticks in SAFE.
        verdict: "helps", "harmless" (with a fault), "does not help", "limit cycle", "rolls over".
    """

    index: int
    bus: str
    fault: str
    factors: Mapping[str, float]
    passive: Mapping[str, float]
    controlled: Mapping[str, float]
    safe: float
    verdict: str

    @property
    def reduction(self) -> float:
        """Reduction of the largest roll angle by control, as a fraction."""
        return 1.0 - self.controlled["roll_max_deg"] / self.passive["roll_max_deg"]


@dataclass(frozen=True, slots=True)
class Campaign:
    """All outcomes in order of their index, with the nominal run."""

    nominal: Result
    outcomes: tuple[Outcome, ...]
    spread: Mapping[str, float]
    seed: int

    @property
    def hardest(self) -> list[Outcome]:
        """All outcomes: failures first, then by increasing reduction of the roll angle."""
        return sorted(self.outcomes, key=lambda o: (o.verdict in GOOD, o.reduction))

    @property
    def failed(self) -> list[Outcome]:
        """Outcomes in which control fails, the worst first."""
        return [outcome for outcome in self.hardest if outcome.verdict not in GOOD]

    @property
    def verdict(self) -> str:
        """The verdict in one line."""
        runs, good = len(self.outcomes), len(self.outcomes) - len(self.failed)
        counts = {
            word: count
            for word in (STAYS_HARMLESS, NO_HELP, LIMIT_CYCLE, ROLLOVER)
            if (count := sum(outcome.verdict == word for outcome in self.outcomes))
        }
        text = ", ".join(f"{count} {word}" for word, count in counts.items())
        return f"Control is good in {good} of {runs} runs" + (f": {text}" if text else "")

    def to_json(self) -> dict[str, Any]:
        """Return the object printed by ``canroll campaign --json``."""
        return {
            "scenario": self.nominal.settings.scenario,
            "vehicle": self.nominal.settings.vehicle.name,
            "law": self.nominal.settings.law,
            "runs": len(self.outcomes),
            "seed": self.seed,
            "spread": dict(self.spread),
            "verdict": self.verdict,
            "failed": [outcome.index for outcome in self.failed],
            "hardest": self.hardest[0].index,
            "quantiles": quantiles(self.outcomes),
            "outcomes": [asdict(outcome) for outcome in self.outcomes],
        }


def quantiles(outcomes: Sequence[Outcome]) -> dict[str, dict[str, dict[str, float]]]:
    """Return least, 5 %, 50 %, 95 % and largest of each figure, without and with control."""
    found: dict[str, dict[str, dict[str, float]]] = {}
    for name in QUANTITIES:
        found[name] = {}
        for side in ("passive", "controlled"):
            values = np.array([getattr(outcome, side)[name] for outcome in outcomes])
            found[name][side] = {
                "min": float(values.min()),
                **{f"p{q}": float(np.percentile(values, q)) for q in QUANTILES},
                "max": float(values.max()),
            }
    return found


def run(
    scenario: str,
    *,
    runs: int,
    spread: Mapping[str, float] = variation.DEFAULT_SPREAD,
    buses: Sequence[str] = (),
    faults: Sequence[str] = (),
    seed: int = 0,
    jobs: int = 1,
    progress: Progress | None = None,
    **choices: Any,  # noqa: ANN401
) -> Campaign:
    """Drive a manoeuvre with one calibration on many draws of the world.

    The calibration is made once, for the nominal vehicle and bus. The outcome depends only on the
    arguments, not on ``jobs``.

    Args:
        scenario: name of the manoeuvre.
        runs: number of draws.
        spread: half-widths, see :mod:`hil.studies.variation`.
        buses: profiles to draw from; none: the run's own.
        faults: texts of :mod:`plant_sim.faults`, of which one or none is drawn.
        seed: seed of the draws.
        jobs: number of processes.
        progress: called with the current activity and the fraction done.
        choices: as in :class:`hil.runs.choices.Choices`, except faults.

    Raises:
        CanrollError: an invalid name or number.
    """
    for option, number in (("runs", runs), ("jobs", jobs)):
        if number < 1:
            raise CanrollError(f"--{option} must be at least 1, got {number}")
    if choices.get("law") == PASSIVE:
        raise CanrollError("--law passive has no control to evaluate: choose another law")
    # what cannot be is refused before anything slow is done
    parse_all(faults)
    for bus in buses:
        load_profile(bus)
    settings, controller = plan(scenario, **choices)
    draws = (
        variation.draw(settings, index, spread=spread, seed=seed, buses=buses, faults=faults)
        for index in range(runs)
    )
    nominal = simulate(settings, controller)
    outcomes = []
    with mapping(controller, jobs) as mapped:
        for outcome in mapped(draws):
            outcomes.append(outcome)
            if progress is not None:
                progress("campaign", len(outcomes) / runs)
    return Campaign(nominal, tuple(outcomes), dict(spread), seed)


def outcome_of(controller: Controller, drawn: Drawn) -> Outcome:
    """Drive one draw, without and with control."""
    result = simulate(drawn.settings, controller)
    assert result.controlled is not None
    assert result.controlled_metrics is not None
    fault = "".join(drawn.settings.faults)
    passive, controlled = asdict(result.passive_metrics), asdict(result.controlled_metrics)
    harmless = controlled["roll_max_deg"] <= HARMLESS * passive["roll_max_deg"]
    if result.helps:
        verdict = HELPS
    elif controlled["rollover"] and not passive["rollover"]:
        verdict = ROLLOVER
    elif result.limit_cycle is not None:
        verdict = LIMIT_CYCLE
    else:
        verdict = STAYS_HARMLESS if fault and harmless else NO_HELP
    return Outcome(
        index=drawn.index,
        bus=drawn.settings.bus,
        fault=fault,
        factors=drawn.factors,
        passive=passive,
        controlled=controlled,
        safe=float(np.mean(result.controlled.ticks["mode"] == SAFE)),
        verdict=verdict,
    )


_controller: list[Controller] = []
"""Settings of a worker process, sent once."""


def _start(controller: Controller) -> None:
    _controller[:] = [controller]


def _drive(drawn: Drawn) -> Outcome:
    return outcome_of(_controller[0], drawn)


@contextmanager
def mapping(
    controller: Controller, jobs: int
) -> Iterator[Callable[[Iterable[Drawn]], Iterator[Outcome]]]:
    """Return the map from draws to outcomes, in their order, in ``jobs`` processes."""
    if jobs == 1:
        yield lambda draws: (outcome_of(controller, drawn) for drawn in draws)
        return
    pool = ProcessPoolExecutor(
        jobs,
        # a fork would take over the threads of progress bars and linear algebra
        mp_context=get_context("spawn"),
        initializer=_start,
        initargs=(controller,),
    )
    try:
        yield lambda draws: pool.map(_drive, draws)
    finally:
        pool.shutdown(cancel_futures=True)
