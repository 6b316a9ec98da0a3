"""``canroll compare``: runs, laws or speeds on one page; a population of vehicles in one table."""

import argparse
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from canroll.cli import terminal
from canroll.cli.cases import driven
from canroll.cli.options import VEHICLE_SET, choices_of, folder_of
from canroll.cli.parser import refuse
from canroll.cli.run_parsers import OF_RUNS, SEVERE, VEHICLES
from canroll.errors import CanrollError
from canroll.report.page import PageTable
from canroll.report.run_folder import write_page
from canroll.report.staging import page_folder
from canroll.setup.choices import CHOICES, OF_ONE_MANOEUVRE, chosen
from canroll.studies import comparison, equal_effort, severe, variation
from canroll.studies.comparison import Comparison
from canroll.studies.comparison_page import (
    apart,
    comparison_json,
    comparison_page,
    summary_table,
    sweep_json,
    sweep_page,
    sweep_table,
)

STEM = "comparison"
LARGEST_EFFORT = 20_000.0
"""N·m; no actuator's message carries more."""


def run(args: argparse.Namespace) -> int:
    """Drive runs or a population of vehicles, and compare them."""
    if args.scenario == SEVERE:
        return severe_manoeuvres(args)
    return of_runs(args) if args.runs is None else at_equal_effort(args)


def refuse_vehicle_set(args: argparse.Namespace, texts: Iterable[str]) -> None:
    """Refuse numbers of the vehicle with runs that already have a vehicle."""
    for text in texts if args.vehicle_set else ():
        if {"vehicle", "calibration"} & comparison.describe(text).keys():
            raise CanrollError(
                f"{VEHICLE_SET}: {text} has its vehicle already: change it there, as a file, or "
                f"omit {VEHICLE_SET}"
            )


def of_runs(args: argparse.Namespace) -> int:
    """Drive all runs, print the table, write comparison.html and comparison.json."""
    refuse_vehicle_set(args, (text for text in args.what if not comparison.is_folder(text)))
    common = choices_of(args)
    speeds = None if args.speeds is None else comparison.parse_range(args.speeds)
    if speeds is not None and len(speeds) == 1 and ":" not in args.speeds:
        common["speed_kmh"], speeds = speeds[0], None
    wanted: list[str] | Mapping[str, Mapping[str, Any]] = args.what
    if not wanted and speeds is None:
        raise CanrollError(
            "compare: name the runs to compare, or several speeds: --speed FROM:TO:STEP"
        )
    if not wanted:
        name = "calibration" if "calibration" in common else str(chosen(common, "law"))
        wanted = {name: {}}
    out = page_folder(folder_of(args))
    duration = common.pop("duration", None)
    with driven(args, out) as cases:
        answer = comparison.compare(
            wanted, args.scenario, speeds_kmh=speeds, duration=duration, cases=cases, **common
        )
    page, numbers, table = _view(answer)
    data = write_page(out, STEM, {"report": (".html", page)}, numbers)
    return terminal.emit(
        args,
        data,
        [table, *terminal.warnings(_warnings(answer)), *terminal.files(data.get("files", {}))],
    )


def _view(answer: Comparison) -> tuple[Any, dict[str, Any], PageTable]:
    """Return what makes the page, the numbers and the table."""
    laws, named = answer.over_speed, answer.runs
    if laws:
        return lambda: sweep_page(laws), sweep_json(laws), sweep_table(laws)
    return lambda: comparison_page(named), comparison_json(named), summary_table(named)


def _warnings(answer: Comparison) -> list[str]:
    firsts = {law: runs[0] for law, runs in answer.over_speed.items()}
    shown = firsts or {run.name: run for run in answer.runs}
    warnings = [f"{name}: {text}" for name, run in shown.items() for text in run.result.warnings]
    return warnings if firsts else [*warnings, *apart(answer.runs)]


def at_equal_effort(args: argparse.Namespace) -> int:
    """Drive every law over the simulated bus at equal effort, with a population of vehicles."""
    choices = _of_a_population(args, OF_RUNS, "--runs drives every law, with seeds of its own")
    if args.speeds is not None:
        choices["speed_kmh"] = CHOICES["speed_kmh"].read(args.speeds)
    if args.effort is not None and not 1.0 <= args.effort <= LARGEST_EFFORT:
        raise CanrollError(
            f"--effort {args.effort:g}: must be 1 to {LARGEST_EFFORT:g} N·m of RMS moment"
        )
    out = page_folder(args.out)
    with driven(args, out) as cases:
        answer = equal_effort.compare(
            args.scenario,
            vehicle=chosen(choices, "vehicle"),
            bus=chosen(choices, "bus"),
            runs=args.runs,
            effort=args.effort or equal_effort.half_upright(args.scenario, **choices),
            spread=variation.spread_from(dict(args.spread)),
            conditions={k: v for k, v in choices.items() if k not in ("vehicle", "bus")},
            cases=cases,
        )
    title = (
        f"{answer.scenario}, {answer.vehicle}, {chosen(choices, 'actuator')}, plant "
        f"{chosen(choices, 'plant')}, bus {answer.bus}, {answer.runs} vehicles, "
        f"RMS moment {answer.budget:.0f} N·m for all, reference {answer.reference}"
    )
    data = write_page(out, STEM, {}, equal_effort.to_json(answer))
    return terminal.emit(args, data, [title, *terminal.plain(equal_effort.table(answer))])


def severe_manoeuvres(args: argparse.Namespace) -> int:
    """Drive the severe manoeuvres with a population of vehicles."""
    refuse(args, "effort", "the severe manoeuvres are driven at the effort of the law")
    why = "it does not apply to several manoeuvres and vehicles"
    choices = _of_a_population(args, ("speeds", *OF_ONE_MANOEUVRE), why)
    out = page_folder(args.out)
    runs = VEHICLES if args.runs is None else args.runs
    with driven(args, out) as cases:
        answer = severe.study(runs=runs, spread=dict(args.spread), cases=cases, **choices)
    about = answer.about
    data = write_page(out, STEM, {}, answer.to_json())
    if "note" in about:
        terminal.note(f"note: {about['note']}")
    title = (
        f"{about['vehicle']}, {about['actuator']}, bus {about['bus']}, {about['runs']} "
        f"vehicles, {about['law']} as designed, plain feedforward at its RMS moment of "
        f"{about['effort_nm']:.0f} N·m, bar: {about['bar_factor']:g} times the roll stiffness"
    )
    return terminal.emit(args, data, [title, *terminal.plain(answer.shown())])


def _of_a_population(
    args: argparse.Namespace, without: Collection[str], why: str
) -> dict[str, Any]:
    """Return the choices of runs with a population of vehicles, ``without`` those of single runs.

    Raises:
        CanrollError: one of these is on the command line, or a run.
    """
    if args.what:
        raise CanrollError(f"{args.what[0]}: --runs drives laws of its own: omit it")
    for name in without:
        refuse(args, name, why)
    return {name: value for name, value in choices_of(args).items() if name not in without}
