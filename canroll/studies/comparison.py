"""Comparison of several runs: laws, buses, speeds, on one page and in one table."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from canroll.arguments import checked
from canroll.cases.execution import IN_TURN, Cases
from canroll.errors import CanrollError
from canroll.runs import saved_run
from canroll.runs.experiment import drive, healthy, plan, simulate
from canroll.runs.result import Result, Run
from canroll.runs.trace import Trace
from canroll.setup.choices import CHOICES, without_frozen
from canroll.setup.controller import Controller
from canroll.setup.words import described
from canroll.table import Table

MOST_NUMBERS = 1000
RANGE = "expected FROM:TO:STEP, e.g. 60:160:20"


@dataclass(frozen=True, slots=True)
class Named:
    """One run of a comparison: its description and result; ``of``: that without its speed."""

    name: str
    result: Result
    of: str = ""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Runs of one manoeuvre.

    Attributes:
        runs: names and results, in the order they were asked for.
    """

    runs: tuple[Named, ...]

    def __repr__(self) -> str:
        return f"<{'; '.join(f'{run.name}: {run.result.verdict}' for run in self.runs)}>"

    @property
    def results(self) -> dict[str, Result]:
        """The results by name."""
        return {run.name: run.result for run in self.runs}

    @property
    def over_speed(self) -> dict[str, list[Named]]:
        """The runs over several speeds, by what was driven; empty of others."""
        laws: dict[str, list[Named]] = {}
        for run in self.runs:
            if run.of:
                laws.setdefault(run.of, []).append(run)
        return laws

    @property
    def table(self) -> Table:
        """One row for each run: what was driven, the verdict, and the metrics of both runs."""
        return Table([_row(run) for run in self.runs])


@checked
def compare(
    wanted: Sequence[str] | Mapping[str, Mapping[str, Any]],
    scenario: str = "double_lane_change",
    *,
    speeds_kmh: Sequence[float] | None = None,
    duration: float | None = None,
    cases: Cases = IN_TURN,
    **common: Any,  # noqa: ANN401
) -> Comparison:
    """Drive a manoeuvre with several laws, calibrations, buses or vehicles.

    Args:
        wanted: laws, calibration files, "law=lqr,bus=500k" or folders of saved runs; or keywords of
            :func:`canroll.run` by the name of the run.
        scenario: the manoeuvre.
        speeds_kmh: entry speeds of each, km/h; None: one, that of the manoeuvre or of the keywords.
        duration: s, if shorter than the manoeuvre.
        cases: what drives the runs.
        common: keywords of :func:`canroll.run` for all runs, unless ``wanted`` has others.

    Raises:
        CanrollError: nothing to compare, an invalid name or number, runs of several manoeuvres, or
            a run that cannot be read or driven; the message names the argument.
    """
    if not wanted:
        raise CanrollError(f"wanted={wanted!r}: must be a list of runs, or keywords by name")
    if speeds_kmh is not None and len(speeds_kmh) == 0:
        raise CanrollError(f"speeds_kmh={speeds_kmh!r}: must be a list with at least one entry")
    chosen = dict(wanted) if isinstance(wanted, Mapping) else described_runs(wanted)
    each: Sequence[tuple[str, str, Path | Mapping[str, Any]]]
    each = [(name, "", run) for name, run in chosen.items()]
    if speeds_kmh is not None:
        each = list(_at_speeds(chosen, speeds_kmh))
    each = cases.picked(each)
    new = [(name, run) for name, _, run in each if not isinstance(run, Path)]
    read = {name: saved_run.load(run) for name, _, run in each if isinstance(run, Path)}
    driven = runs(scenario, new, common, duration=duration, cases=cases)
    results = {run.name: run.result for run in driven} | read
    named = tuple(Named(name, results[name], of) for name, of, _ in each)
    first = named[0]
    for run in named:
        if run.result.settings.scenario != first.result.settings.scenario:
            raise CanrollError(
                f"{first.name} is a {first.result.settings.scenario}, {run.name} is a "
                f"{run.result.settings.scenario}: compare runs of one manoeuvre"
            )
    return Comparison(named)


def described_runs(texts: Sequence[str]) -> dict[str, Path | Mapping[str, Any]]:
    """Return folders of saved runs, and the keywords of others, by the names of the runs.

    Raises:
        CanrollError: an unknown key or name, or two runs of one name.
    """
    named = [
        (text, Path(text)) if is_folder(text) else (label(text), describe(text)) for text in texts
    ]
    labels = [name for name, _ in named]
    if len(set(labels)) < len(labels):
        raise CanrollError(f"two runs have one name among {', '.join(labels)}: add name=…")
    return dict(named)


def _at_speeds(
    chosen: Mapping[str, Path | Mapping[str, Any]], speeds_kmh: Sequence[float]
) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Yield each run at each speed: its name, that without the speed, its keywords."""
    for of, keywords in chosen.items():
        if isinstance(keywords, Path) or "speed_kmh" in keywords:
            raise CanrollError(f"{of}: it has its speed: omit it, or drive all at one speed")
        for speed in speeds_kmh:
            yield f"{of} at {speed:g} km/h", of, {**keywords, "speed_kmh": speed}


def _row(run: Named) -> dict[str, Any]:
    result = run.result
    metrics: dict[str, Any] = {}
    for name, of in (
        ("passive", result.passive_metrics),
        ("controlled", result.controlled_metrics),
    ):
        values = asdict(result.passive_metrics if of is None else of)
        metrics |= {f"{name}_{key}": None if of is None else value for key, value in values.items()}
    settings = result.settings
    return {
        "name": run.name,
        "scenario": settings.scenario,
        **settings.vehicles,
        "law": settings.law,
        "bus": settings.bus,
        "speed_kmh": round(3.6 * settings.speed, 9),
        "verdict": result.verdict,
        "good": result.good,
        "reduction": result.reduction,
        "transmission_rate": result.trigger.transmission_rate,
        **metrics,
    }


LABEL = "name="
"""Begins the part of a description that is the run's name."""


def label(text: str) -> str:
    """Return the name of a run: that of "name=mine,law=lqr", else the description itself."""
    names = [part for part in text.split(",") if part.startswith(LABEL)]
    return names[0].removeprefix(LABEL) if names else text


def describe(text: str) -> dict[str, Any]:
    """Return the keywords of a run described as "lqr", "file.toml" or "law=lqr,bus=125k_busy".

    A part "name=…" is left out: see :func:`label`.

    Raises:
        CanrollError: an unknown key or a value that is not a number.
        UnknownNameError: an unknown law or key.
    """
    text = ",".join(part for part in text.split(",") if not part.startswith(LABEL))
    if "=" in text:
        return described(text)
    if text.endswith(".toml"):
        return {"calibration": text}
    return {"law": CHOICES["law"].read(text)}


def runs(
    scenario: str,
    wanted: Sequence[tuple[str, Mapping[str, Any]]],
    common: Mapping[str, Any],
    *,
    duration: float | None = None,
    cases: Cases = IN_TURN,
) -> list[Named]:
    """Drive ``scenario`` once for each name and its keywords, and once more without control.

    Runs that differ only in their controller share the run without control. Their own keywords go
    before the ``common`` ones.
    """
    # names are refused before anything slow is done
    planned = [
        plan(scenario, **_merged(common, keywords), duration=duration) for _, keywords in wanted
    ]
    alone: list[Run] = []
    drivers: list[tuple[Run, Controller]] = []
    places = []
    for settings, controller in planned:
        same = replace(settings, law="", observer="")
        if same not in alone:
            alone.append(same)
            drivers.append((settings, controller))
        places.append(alone.index(same))
    passive = list(cases.rows("without control", uncontrolled, [(*d, duration) for d in drivers]))
    arguments = [
        (*pair, duration, passive[place]) for pair, place in zip(planned, places, strict=True)
    ]
    results = cases.rows("runs", simulated, arguments)
    return [
        # the trace itself, not its copy from another process
        Named(name, replace(result, passive=passive[place]))
        for (name, _), place, result in zip(wanted, places, results, strict=True)
    ]


def uncontrolled(settings: Run, controller: Controller, duration: float | None) -> Trace:
    """Drive the run without control."""
    return drive(healthy(settings), controller, enabled=False, duration=duration)


def simulated(
    settings: Run, controller: Controller, duration: float | None, passive: Trace
) -> Result:
    """Drive the run with control, and return its figures."""
    return simulate(settings, controller, duration=duration, passive=passive)


def is_folder(text: str) -> bool:
    """Whether a text is the folder of a saved run rather than a law."""
    return text not in CHOICES["law"].values() and Path(text).is_dir()


def _merged(common: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keywords of one run; its calibration replaces the common choices it fixes."""
    if "calibration" in own:
        common = without_frozen(common)
    return {**common, **own}


def parse_range(text: str) -> list[float]:
    """Return the numbers of "60:160:20" (from, to, step; end included) or of "60,80,100".

    Raises:
        CanrollError: not a range of up to :data:`MOST_NUMBERS` numbers.
    """
    try:
        if ":" not in text:
            return [float(part) for part in text.split(",")]
        first, last, *rest = (float(part) for part in text.split(":"))
        (step,) = rest or (10.0,)
        count = round((last - first) / step * 1e9) // 10**9
    except (ValueError, ZeroDivisionError, OverflowError) as error:
        raise CanrollError(f"invalid range '{text}' ({RANGE})") from error
    if count < 0:
        raise CanrollError(f"invalid range '{text}': the step leads away from the end ({RANGE})")
    if count >= MOST_NUMBERS:
        raise CanrollError(f"invalid range '{text}': at most {MOST_NUMBERS} numbers ({RANGE})")
    return [first + step * k for k in range(int(count) + 1)]
