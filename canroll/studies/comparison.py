"""Comparison of several runs: laws, buses, speeds, on one page and in one table."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from canroll.arguments import checked
from canroll.cases.execution import IN_TURN, Cases
from canroll.errors import CanrollError
from canroll.runs import saved_run
from canroll.runs.experiment import drive, healthy, plan, simulate
from canroll.runs.result import Result, Settings
from canroll.runs.trace import Trace
from canroll.setup.choices import CHOICES, without_frozen
from canroll.setup.controller import PreparedController
from canroll.setup.words import described
from canroll.table import Table

MOST_NUMBERS = 1000
RANGE = "expected FROM:TO:STEP, e.g. 60:160:20"


@dataclass(frozen=True, slots=True)
class Named:
    """One run of a comparison: its description and result."""

    name: str
    result: Result


@dataclass(frozen=True, slots=True)
class Comparison:
    """Runs of one manoeuvre.

    Attributes:
        runs: names and results, in the order they were asked for.
    """

    runs: tuple[Named, ...]

    @property
    def results(self) -> dict[str, Result]:
        """The results by name."""
        return {run.name: run.result for run in self.runs}

    @property
    def table(self) -> Table:
        """One row for each run: what was driven, the verdict, and the metrics of both runs."""
        return Table([_row(run) for run in self.runs])


@checked
def compare(
    wanted: Sequence[str] | Mapping[str, Mapping[str, Any]],
    scenario: str = "double_lane_change",
    *,
    duration: float | None = None,
    cases: Cases = IN_TURN,
    **common: Any,  # noqa: ANN401
) -> Comparison:
    """Drive a manoeuvre with several laws, calibrations, buses or vehicles.

    Args:
        wanted: laws, calibration files, "law=lqr,bus=500k" or folders of saved runs; or keywords of
            :func:`canroll.run` by the name of the run.
        scenario: the manoeuvre.
        duration: s, if shorter than the manoeuvre.
        cases: what drives the runs.
        common: keywords of :func:`canroll.run` for all runs, unless ``wanted`` has others.

    Raises:
        CanrollError: nothing to compare, an invalid name or number, runs of several manoeuvres, or
            a run that cannot be driven; the message names the argument.
    """
    if not wanted:
        raise CanrollError(f"wanted={wanted!r}: must be a list of runs, or keywords by name")
    if isinstance(wanted, Mapping):
        of = cases.picked(list(wanted.items()))
        return Comparison(tuple(runs(scenario, of, common, duration=duration, cases=cases)))
    return Comparison(tuple(gather(wanted, scenario, common, duration=duration, cases=cases)))


@checked
def sweep(
    speeds_kmh: Sequence[float],
    laws: Sequence[str] = (CHOICES["law"].default,),
    scenario: str = "double_lane_change",
    *,
    cases: Cases = IN_TURN,
    **common: Any,  # noqa: ANN401
) -> Comparison:
    """Drive a manoeuvre at several speeds with one or several laws.

    Args:
        speeds_kmh: entry speeds, km/h.
        laws: laws, calibration files, or "law=lqr,bus=500k", as of :func:`compare`.
        scenario: the manoeuvre.
        cases: what drives the runs.
        common: keywords of :func:`canroll.run` for all runs.

    Raises:
        CanrollError: no speeds or laws, an invalid name or number, or a run that cannot be driven.
    """
    for name, values in (("speeds_kmh", speeds_kmh), ("laws", laws)):
        if len(values) == 0:
            raise CanrollError(f"{name}={values!r}: must be a list with at least one entry")
    wanted = {
        f"{label(law)} at {speed:g} km/h": {**describe(law), "speed_kmh": speed}
        for law in laws
        for speed in speeds_kmh
    }
    return compare(wanted, scenario, cases=cases, **common)


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
    alone: list[Settings] = []
    drivers: list[tuple[Settings, PreparedController]] = []
    places = []
    for settings, controller in planned:
        same = replace(settings, law="", observer="", trigger="")
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


def uncontrolled(
    settings: Settings, controller: PreparedController, duration: float | None
) -> Trace:
    """Drive the run without control."""
    return drive(healthy(settings), controller, enabled=False, duration=duration)


def simulated(
    settings: Settings, controller: PreparedController, duration: float | None, passive: Trace
) -> Result:
    """Drive the run with control, and return its figures."""
    return simulate(settings, controller, duration=duration, passive=passive)


def gather(
    texts: Sequence[str],
    scenario: str,
    common: Mapping[str, Any],
    *,
    duration: float | None = None,
    cases: Cases = IN_TURN,
) -> list[Named]:
    """Return the runs described by ``texts``, saved or driven now, in their order.

    Each is the folder of a saved run, or a description for :func:`describe`; ``common`` keywords
    and ``duration`` (s) are of the runs driven now.

    Raises:
        CanrollError: runs of different manoeuvres, or a run that cannot be read or driven.
    """
    texts = cases.picked(texts)
    read = {text: saved_run.load(Path(text)) for text in texts if is_folder(text)}
    labels = [text if text in read else label(text) for text in texts]
    if len(set(labels)) < len(labels):
        raise CanrollError(f"two runs have one name among {', '.join(labels)}: add name=…")
    wanted = [
        (name, describe(text)) for name, text in zip(labels, texts, strict=True) if text not in read
    ]
    driven = runs(scenario, wanted, common, duration=duration, cases=cases)
    named = {run.name: run for run in driven} | {t: Named(t, result) for t, result in read.items()}
    chosen = [named[name] for name in labels]
    for run in chosen:
        if run.result.settings.scenario != chosen[0].result.settings.scenario:
            raise CanrollError(
                f"{chosen[0].name} is a {chosen[0].result.settings.scenario}, {run.name} is a "
                f"{run.result.settings.scenario}: compare runs of one manoeuvre"
            )
    return chosen


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
