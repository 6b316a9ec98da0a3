"""Comparison of several runs: laws, buses, speeds, on one page and in one table."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from canroll.arguments import checked
from canroll.errors import CanrollError
from canroll.table import Table
from canroll.typing import Progress
from hil.runs import saved_run
from hil.runs.choices import CHOICES, described, without_frozen
from hil.runs.experiment import plan, simulate
from hil.runs.result import Result, Settings
from hil.runs.trace import Trace

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
    progress: Progress | None = None,
    **common: Any,  # noqa: ANN401
) -> Comparison:
    """Drive a manoeuvre with several laws, calibrations, buses or vehicles.

    Args:
        wanted: laws, calibration files, "law=lqr,bus=500k" or folders of saved runs; or keywords of
            :func:`canroll.run` by the name of the run.
        scenario: the manoeuvre.
        duration: s, if shorter than the manoeuvre.
        progress: called with the name of the run and the fraction done.
        common: keywords of :func:`canroll.run` for all runs, unless ``wanted`` has others.

    Raises:
        CanrollError: nothing to compare, an invalid name or number, runs of several manoeuvres, or
            a run that cannot be driven; the message names the argument.
    """
    if not wanted:
        raise CanrollError(f"wanted={wanted!r}: must be a list of runs, or keywords by name")
    if isinstance(wanted, Mapping):
        driven = runs(
            scenario, list(wanted.items()), common=common, duration=duration, progress=progress
        )
        return Comparison(tuple(driven))
    named = gather(wanted, scenario, common=common, duration=duration, progress=progress)
    return Comparison(tuple(named))


@checked
def sweep(
    speeds_kmh: Sequence[float],
    laws: Sequence[str] = (CHOICES["law"].default,),
    scenario: str = "double_lane_change",
    *,
    progress: Progress | None = None,
    **common: Any,  # noqa: ANN401
) -> Comparison:
    """Drive a manoeuvre at several speeds with one or several laws.

    Args:
        speeds_kmh: entry speeds, km/h.
        laws: laws, calibration files, or "law=lqr,bus=500k", as of :func:`compare`.
        scenario: the manoeuvre.
        progress: called with the name of the run and the fraction done.
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
    return compare(wanted, scenario, progress=progress, **common)


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
    *,
    common: Mapping[str, Any] | None = None,
    duration: float | None = None,
    progress: Progress | None = None,
) -> Iterator[Named]:
    """Drive ``scenario`` once for every description, and once more without control.

    Runs that differ only in their controller share the run without control.

    Args:
        scenario: name of the manoeuvre.
        wanted: name and keywords of :func:`canroll.run` for each run.
        common: keywords of all runs, unless a description overrides them.
        duration: s, if shorter than the manoeuvre.
        progress: called with the name of the run and the fraction done.
    """
    driven: list[tuple[Settings, Trace]] = []
    # names are refused before anything slow is done
    planned = [
        (name, *plan(scenario, **_merged(common or {}, keywords), duration=duration))
        for name, keywords in wanted
    ]
    for name, settings, controller in planned:
        same = replace(settings, law="", observer="", trigger="")
        result = simulate(
            settings,
            controller,
            duration=duration,
            passive=next((trace for other, trace in driven if other == same), None),
            progress=None if progress is None else _named(progress, name),
        )
        driven.append((same, result.passive))
        yield Named(name, result)


def gather(
    texts: Sequence[str],
    scenario: str,
    *,
    common: Mapping[str, Any] | None = None,
    duration: float | None = None,
    progress: Progress | None = None,
) -> list[Named]:
    """Return the runs described by ``texts``, saved or driven now, in their order.

    Args:
        texts: for each run the folder of a saved run, or a description for :func:`describe`.
        scenario: manoeuvre of the runs driven now.
        common: keywords of all of these, unless a text overrides them.
        duration: duration of each of these, s, if shorter than the manoeuvre.
        progress: called with the name of the run and the fraction done.

    Raises:
        CanrollError: runs of different manoeuvres, or a run that cannot be read or driven.
    """
    read = {text: saved_run.load(Path(text)) for text in texts if is_folder(text)}
    labels = [text if text in read else label(text) for text in texts]
    if len(set(labels)) < len(labels):
        raise CanrollError(f"two runs have one name among {', '.join(labels)}: add name=…")
    wanted = [
        (name, describe(text)) for name, text in zip(labels, texts, strict=True) if text not in read
    ]
    driven = runs(scenario, wanted, common=common, duration=duration, progress=progress)
    named = {run.name: run for run in driven} | {t: Named(t, result) for t, result in read.items()}
    found = [named[name] for name in labels]
    for run in found:
        if run.result.settings.scenario != found[0].result.settings.scenario:
            raise CanrollError(
                f"{found[0].name} is a {found[0].result.settings.scenario}, {run.name} is a "
                f"{run.result.settings.scenario}: compare runs of one manoeuvre"
            )
    return found


def is_folder(text: str) -> bool:
    """Whether a text is the folder of a saved run rather than a law."""
    return text not in CHOICES["law"].values() and Path(text).is_dir()


def _merged(common: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keywords of one run; its calibration replaces the common choices it fixes."""
    if "calibration" in own:
        common = without_frozen(common)
    return {**common, **own}


def _named(progress: Progress, name: str) -> Progress:
    return lambda stage, share: progress(f"{name}, {stage}", share)


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
