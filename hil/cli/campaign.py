"""``canroll campaign``: one calibration against many vehicles, buses, noises and faults."""

import argparse
import json
from pathlib import Path
from typing import Any

from canroll.errors import CanrollError
from hil.cli import terminal
from hil.cli.options import choices_of, folder_of
from hil.cli.run import answer
from hil.report.run_folder import page_folder, write_page
from hil.runs import conditions, experiment
from hil.runs.choices import CHOICES
from hil.studies import campaign, variation
from hil.studies import severe as severe_manoeuvres
from hil.studies.campaign_page import campaign_page, quantile_table


def run(args: argparse.Namespace) -> int:
    """Drive all draws, print the table, write campaign.html and .json; 1 if one of them fails."""
    choices = choices_of(args)
    draws = {
        "spread": variation.spread_from(dict(args.spread)),
        "seed": choices.pop("seed", CHOICES["seed"].default),
        "faults": conditions.fault_texts(choices),
    }
    for name in ("faults", "fault_file"):
        choices.pop(name, None)
    if "bus" in choices:
        draws["buses"] = choices["bus"]
        choices["bus"] = choices["bus"][0]
    out = page_folder(folder_of(args))
    if args.only is not None:
        return _one(args, choices, draws, out)
    with terminal.progress(quiet=args.json) as progress:
        found = campaign.run(
            args.scenario, runs=args.runs, jobs=args.jobs, progress=progress, **draws, **choices
        )
    texts = {"report": (".html", lambda: campaign_page(found))}
    data = {"files": {}, **write_page(out, "campaign", texts, found.to_json())}
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
    if args.only < 0:
        raise CanrollError(f"--only must be at least 0, got {args.only}")
    settings, controller = experiment.plan(args.scenario, **choices)
    drawn = variation.draw(settings, args.only, **draws)
    with terminal.progress(quiet=args.json) as progress:
        result = experiment.simulate(drawn.settings, controller, progress=progress)
    return answer(result, out, as_json=args.json)


def severe(args: argparse.Namespace) -> int:
    """Drive the severe manoeuvres and print their table."""
    with terminal.progress(quiet=args.json) as progress:
        found = severe_manoeuvres.study(
            runs=args.runs,
            spread=variation.spread_from(dict(args.spread)),
            progress=progress,
            **choices_of(args),
        )
    if args.json:
        print(json.dumps(severe_manoeuvres.to_json(found)))
    else:
        print(
            f"{found.vehicle}, {found.actuator}, bus {found.bus}, {found.runs} vehicles, "
            f"{found.law} as designed, plain feedforward at its RMS moment of {found.effort:.0f} "
            f"N·m, bar: {found.bar:g} times the roll stiffness"
        )
        print("\n".join(severe_manoeuvres.table(found)))
    return 0
