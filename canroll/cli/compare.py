"""``canroll compare`` and ``canroll sweep``: several runs, laws or speeds on one page."""

import argparse
import json
import sys
from collections.abc import Iterable
from typing import Any

from canroll.cli import terminal
from canroll.cli.cases import driven
from canroll.cli.options import DEFAULT_SCENARIO, VEHICLE_SET, choices_of, folder_of
from canroll.errors import CanrollError
from canroll.report.page import PageTable
from canroll.report.run_folder import write_page
from canroll.report.staging import page_folder
from canroll.setup.choices import CHOICES
from canroll.studies import comparison
from canroll.studies import severe as severe_manoeuvres
from canroll.studies.comparison_page import (
    apart,
    comparison_json,
    comparison_page,
    summary_table,
    sweep_json,
    sweep_page,
    sweep_table,
)
from plant_sim.driving import MANEUVERS


def refuse_vehicle_set(args: argparse.Namespace, texts: Iterable[str]) -> None:
    """Refuse numbers of the vehicle with runs that already have a vehicle."""
    for text in texts if args.vehicle_set else ():
        if {"vehicle", "calibration"} & comparison.describe(text).keys():
            raise CanrollError(
                f"{VEHICLE_SET}: {text} has its vehicle already: change it there, as a file, or "
                f"omit {VEHICLE_SET}"
            )


def run(args: argparse.Namespace) -> int:
    """Drive all runs, print the table, write comparison.html and comparison.json."""
    if len(set(args.runs)) < len(args.runs):
        raise CanrollError("compare: a run is given twice")
    refuse_vehicle_set(args, (text for text in args.runs if not comparison.is_folder(text)))
    out = page_folder(folder_of(args))
    common = choices_of(args)
    duration = common.pop("duration", None)
    with driven(args, out) as cases:
        named = comparison.gather(args.runs, args.scenario, common, duration=duration, cases=cases)
    texts = {"report": (".html", lambda: comparison_page(named))}
    data = write_page(out, "comparison", texts, comparison_json(named))
    if args.json:
        print(json.dumps(data))
        return 0
    terminal.show_table(summary_table(named))
    warnings = [f"{n.name}: {text}" for n in named for text in n.result.warnings]
    terminal.show_warnings([*warnings, *apart(named)])
    terminal.show_files(data.get("files", {}))
    return 0


def manoeuvre_and_runs(words: list[str]) -> tuple[str, list[str]]:
    """Return the manoeuvre among the words of ``canroll sweep``, and the runs to drive.

    Raises:
        CanrollError: two manoeuvres, or a run given twice.
    """
    scenarios = [word for word in words if word in MANEUVERS]
    if len(scenarios) > 1:
        raise CanrollError(f"sweep: give one manoeuvre, not {' and '.join(scenarios)}")
    texts = [word for word in words if word not in MANEUVERS]
    if len(set(texts)) < len(texts):
        raise CanrollError("sweep: a run is given twice")
    return (scenarios or [DEFAULT_SCENARIO])[0], texts


def sweep(args: argparse.Namespace) -> int:
    """Drive all speeds, print the table, write sweep.html and sweep.json."""
    common = choices_of(args)
    speeds = comparison.parse_range(args.speeds)
    scenario, texts = manoeuvre_and_runs(args.what)
    names = common.pop("law", [CHOICES["law"].default])
    laws: dict[str, dict[str, Any]] = {name: {"law": name} for name in names}
    if texts:
        refuse_vehicle_set(args, texts)
        for name in ("law", "calibration"):
            if getattr(args, name) is not None:
                raise CanrollError(f"--{name}: the runs {' '.join(texts)} have theirs: omit it")
        laws = {comparison.label(text): comparison.describe(text) for text in texts}
        if len(laws) < len(texts):
            raise CanrollError("sweep: two runs have one name: give each its own by name=…")
        for text, keywords in laws.items():
            if "speed_kmh" in keywords:
                raise CanrollError(f"{text}: --speed gives the speeds: omit speed")
    elif "calibration" in common:
        if args.law is not None:
            raise CanrollError("--calibration fixes the law: omit --law")
        laws = {"calibration": {}}
    wanted = [
        (name, (f"{name} at {speed:g} km/h", {**law, "speed_kmh": speed}))
        for name, law in laws.items()
        for speed in speeds
    ]
    out = page_folder(folder_of(args))
    with driven(args, out) as cases:
        wanted = list(cases.picked(wanted))
        results = comparison.runs(scenario, [run for _, run in wanted], common, cases=cases)
    named: dict[str, list[comparison.Named]] = {}
    for (law, _), run in zip(wanted, results, strict=True):
        named.setdefault(law, []).append(run)
    pages = {"report": (".html", lambda: sweep_page(named))}
    data = write_page(out, "sweep", pages, sweep_json(named))
    if args.json:
        print(json.dumps(data))
        return 0
    terminal.show_table(sweep_table(named))
    notes = {name: run.result.warnings for name, (run, *_) in named.items()}
    terminal.show_warnings([f"{name}: {text}" for name, texts in notes.items() for text in texts])
    terminal.show_files(data.get("files", {}))
    return 0


def severe(args: argparse.Namespace) -> int:
    """Drive the severe manoeuvres and print their table: Markdown where it is not a terminal."""
    out = page_folder(args.out)
    with driven(args, out) as cases:
        answer = severe_manoeuvres.study(
            runs=args.runs, spread=dict(args.spread), cases=cases, **choices_of(args)
        )
    data = write_page(out, "severe", {}, severe_manoeuvres.to_json(answer))
    if answer.note:
        print(f"note: {answer.note}", file=sys.stderr)
    if args.json:
        print(json.dumps(data))
    else:
        print(
            f"{answer.vehicles['vehicle']}, {answer.actuator}, bus {answer.bus}, {answer.runs} "
            f"vehicles, {answer.law} as designed, plain feedforward at its RMS moment of "
            f"{answer.effort:.0f} N·m, bar: {answer.bar:g} times the roll stiffness"
        )
        if sys.stdout.isatty():
            rows: list[tuple[str, ...]] = []
            for title, name, *figures in severe_manoeuvres.lines(answer):
                rows += [("",), (title,)] if title else []
                rows.append((name, *figures))
            terminal.show_table(PageTable("", ("", *severe_manoeuvres.HEAD[2:]), rows))
        else:
            print("\n".join(severe_manoeuvres.markdown(answer)))
    return 0
