"""``canroll campaign``: one calibration against many vehicles, buses, noises and faults."""

import argparse
import json
import os
from pathlib import Path
from typing import Any

from canroll.errors import CanrollError
from hil.cli.page_files import add_page_options, folder, write
from hil.cli.run import add_condition_options, add_run_options, answer, key_values, run_keywords

DEFAULT_RUNS = 100


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "campaign",
        help="Monte Carlo over parameters, noise, delays and faults",
        description="Drive a manoeuvre with one calibration on many draws of vehicle, noise, bus "
        "and fault. --bus takes several profiles with commas, the controller being designed for "
        "the first; of the --fault given one, or none, is drawn; --seed is that of the draws.",
    )
    parser.add_argument(
        "scenario", nargs="?", default="double_lane_change", help="default: %(default)s"
    )
    parser.add_argument(
        "--runs", type=int, default=DEFAULT_RUNS, metavar="N", help="draws (default: %(default)s)"
    )
    parser.add_argument(
        "--spread",
        action="append",
        default=[],
        metavar="QUANTITY=SHARE",
        help="half-width that a quantity is drawn from, as roll_stiffness=0.3; 0 keeps it. "
        "Default: 0.2 of roll_inertia, roll_damping, roll_stiffness, sprung_mass, "
        "cg_height_above_roll_axis and estimate_error, 0.1 of cornering_stiffness and friction, "
        "0 of speed; may be repeated",
    )
    parser.add_argument("--only", type=int, metavar="DRAW", help="report one draw as a run")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="processes (default: all cores)"
    )
    add_run_options(parser)
    add_condition_options(parser)
    add_page_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Drive all draws, print the table, write campaign.html and .json; 1 if one of them fails."""
    from hil.cli import terminal  # noqa: PLC0415 - loads compiled kernels
    from hil.studies import campaign, variation  # noqa: PLC0415 - loads compiled kernels
    from hil.studies.campaign_page import campaign_page, quantile_table  # noqa: PLC0415

    choices: dict[str, Any] = run_keywords(args)
    draws = {
        "spread": variation.spread_from(key_values("--spread", args.spread) or {}),
        "seed": choices.pop("seed"),
        "faults": choices.pop("faults", ()),
    }
    buses = str(choices.pop("bus", "")).split(",")
    if buses[0]:
        choices["bus"] = buses[0]
        draws["buses"] = buses
    out = folder(args)
    if args.only is not None:
        return _one(args, choices, draws, out)
    with terminal.progress(quiet=args.json) as progress:
        found = campaign.run(
            args.scenario, runs=args.runs, jobs=args.jobs, progress=progress, **draws, **choices
        )
    texts = {"report": (".html", lambda: campaign_page(found))}
    data = {"files": {}, **write(out, "campaign", texts, found.to_json())}
    if args.json:
        print(json.dumps(data))
    else:
        terminal.show_verdict(found.verdict, good=not found.failed)
        terminal.show_warnings(found.nominal.warnings)
        terminal.show_table(quantile_table(found))
        worst = found.hardest[0]
        print(
            f"\nhardest: draw {worst.index}, {worst.verdict}, largest roll angle "
            f"{worst.controlled['roll_max_deg']:.2f}° instead of "
            f"{worst.passive['roll_max_deg']:.2f}°; see it with --only {worst.index}"
        )
        terminal.show_files(data["files"])
    return 1 if found.failed else 0


def _one(
    args: argparse.Namespace, choices: dict[str, Any], draws: dict[str, Any], out: Path | None
) -> int:
    """Drive one draw again and report it as a run."""
    from hil.cli import terminal  # noqa: PLC0415
    from hil.runs import experiment  # noqa: PLC0415
    from hil.studies import variation  # noqa: PLC0415

    if args.only < 0:
        raise CanrollError(f"--only {args.only}: draws count from 0")
    settings, controller = experiment.plan(args.scenario, **choices)
    drawn = variation.draw(settings, args.only, **draws)
    with terminal.progress(quiet=args.json) as progress:
        result = experiment.simulate(drawn.settings, controller, progress=progress)
    return answer(result, out, as_json=args.json)
