"""``canroll sweep``: a manoeuvre over a range of speeds, for one or several laws."""

import argparse
import json
from typing import Any

from hil.cli.page_files import add_page_options, folder, write
from hil.cli.run import add_condition_options, add_run_options, run_keywords

DEFAULT_SPEEDS = "60:120:20"


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "sweep",
        help="drive a manoeuvre over a range of speeds",
        description="Drive a manoeuvre at several speeds with one or several laws.",
    )
    parser.add_argument(
        "scenario", nargs="?", default="double_lane_change", help="default: %(default)s"
    )
    add_run_options(parser, speed_range=DEFAULT_SPEEDS)
    add_condition_options(parser)
    add_page_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Drive all speeds, print the table, write sweep.html and sweep.json."""
    from hil.cli import terminal  # noqa: PLC0415 - loads compiled kernels
    from hil.runs.frozen import DEFAULT_LAW  # noqa: PLC0415
    from hil.studies import comparison  # noqa: PLC0415 - loads compiled kernels
    from hil.studies.comparison_page import sweep_json, sweep_page, sweep_table  # noqa: PLC0415

    common = run_keywords(args)
    speeds = comparison.parse_range(str(common.pop("speed_kmh")))
    if "calibration" in common:
        laws: dict[str, dict[str, Any]] = {"calibration": {}}
    else:
        names = str(common.pop("law", DEFAULT_LAW)).split(",")
        laws = {name: comparison.describe(name) for name in names}
    wanted = [
        (f"{name} at {speed:g} km/h", {**law, "speed_kmh": speed})
        for name, law in laws.items()
        for speed in speeds
    ]
    out = folder(args)
    with terminal.progress(quiet=args.json) as progress:
        driven = list(comparison.runs(args.scenario, wanted, common=common, progress=progress))
    named = {
        law: driven[place * len(speeds) : (place + 1) * len(speeds)]
        for place, law in enumerate(laws)
    }
    data = write(out, "sweep", {"report": (".html", lambda: sweep_page(named))}, sweep_json(named))
    if args.json:
        print(json.dumps(data))
        return 0
    terminal.show_table(sweep_table(named))
    terminal.show_files(data.get("files", {}))
    return 0
