"""``canroll compare``: several runs or laws on one page and in one table."""

import argparse
import json

from canroll.errors import CanrollError
from hil.cli.page_files import add_page_options, folder, write
from hil.cli.run import add_condition_options, add_run_options, run_keywords


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "compare",
        help="hold several runs or laws against each other",
        description="Drive the same manoeuvre with several controllers and compare; runs that were "
        "saved are read from their folders. Options hold for what is driven.",
    )
    parser.add_argument(
        "runs",
        nargs="+",
        metavar="RUN",
        help="a law, a calibration file, settings as law=lqr,bus=gateway_20ms,tick=5, or the "
        "folder of a saved run",
    )
    parser.add_argument(
        "--scenario", default="double_lane_change", help="manoeuvre (default: %(default)s)"
    )
    add_run_options(parser)
    add_condition_options(parser)
    parser.add_argument("--duration", type=float, metavar="S", help="stop after so many seconds")
    add_page_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Drive all runs, print the table, write comparison.html and comparison.json."""
    from hil.cli import terminal  # noqa: PLC0415 - loads compiled kernels
    from hil.studies import comparison  # noqa: PLC0415 - loads compiled kernels
    from hil.studies.comparison_page import (  # noqa: PLC0415
        apart,
        comparison_json,
        comparison_page,
        summary_table,
    )

    if len(set(args.runs)) < len(args.runs):
        raise CanrollError("compare: a run is given twice: give each once")
    out = folder(args)
    with terminal.progress(quiet=args.json) as progress:
        named = list(
            comparison.gather(
                args.runs,
                args.scenario,
                common=run_keywords(args),
                duration=args.duration,
                progress=progress,
            )
        )
    texts = {"report": (".html", lambda: comparison_page(named))}
    data = write(out, "comparison", texts, comparison_json(named))
    if args.json:
        print(json.dumps(data))
        return 0
    terminal.show_table(summary_table(named))
    told = [f"{n.name}: {text}" for n in named for text in n.result.warnings]
    terminal.show_warnings([*told, *apart(named)])
    terminal.show_files(data.get("files", {}))
    return 0
