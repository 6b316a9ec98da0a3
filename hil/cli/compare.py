"""``canroll compare`` and ``canroll sweep``: several runs, laws or speeds on one page."""

import argparse
import json
from typing import Any

from canroll.errors import CanrollError
from hil.cli import terminal
from hil.cli.options import choices_of, folder_of
from hil.report.run_folder import write_page
from hil.report.staging import page_folder
from hil.runs.choices import CHOICES
from hil.studies import comparison
from hil.studies.comparison_page import (
    apart,
    comparison_json,
    comparison_page,
    summary_table,
    sweep_json,
    sweep_page,
    sweep_table,
)


def run(args: argparse.Namespace) -> int:
    """Drive all runs, print the table, write comparison.html and comparison.json."""
    if len(set(args.runs)) < len(args.runs):
        raise CanrollError("compare: a run is given twice")
    out = page_folder(folder_of(args))
    common = choices_of(args)
    duration = common.pop("duration", None)
    with terminal.progress(quiet=args.json) as progress:
        named = comparison.gather(
            args.runs, args.scenario, common=common, duration=duration, progress=progress
        )
    texts = {"report": (".html", lambda: comparison_page(named))}
    data = write_page(out, "comparison", texts, comparison_json(named))
    if args.json:
        print(json.dumps(data))
        return 0
    terminal.show_table(summary_table(named))
    told = [f"{n.name}: {text}" for n in named for text in n.result.warnings]
    terminal.show_warnings([*told, *apart(named)])
    terminal.show_files(data.get("files", {}))
    return 0


def sweep(args: argparse.Namespace) -> int:
    """Drive all speeds, print the table, write sweep.html and sweep.json."""
    common = choices_of(args)
    speeds = comparison.parse_range(args.speeds)
    names = common.pop("law", [CHOICES["law"].default])
    laws: dict[str, dict[str, Any]] = {name: {"law": name} for name in names}
    if "calibration" in common:
        if args.law is not None:
            raise CanrollError("--calibration fixes the law: omit --law")
        laws = {"calibration": {}}
    wanted = [
        (f"{name} at {speed:g} km/h", {**law, "speed_kmh": speed})
        for name, law in laws.items()
        for speed in speeds
    ]
    out = page_folder(folder_of(args))
    with terminal.progress(quiet=args.json) as progress:
        driven = list(comparison.runs(args.scenario, wanted, common=common, progress=progress))
    named = {
        law: driven[place * len(speeds) : (place + 1) * len(speeds)]
        for place, law in enumerate(laws)
    }
    texts = {"report": (".html", lambda: sweep_page(named))}
    data = write_page(out, "sweep", texts, sweep_json(named))
    if args.json:
        print(json.dumps(data))
        return 0
    terminal.show_table(sweep_table(named))
    terminal.show_files(data.get("files", {}))
    return 0
