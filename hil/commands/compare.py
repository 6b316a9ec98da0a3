"""``canroll compare``: several runs or laws on one page and in one table."""

import argparse
import json
from pathlib import Path

from canroll.errors import CanrollError
from hil.commands.run import add_condition_options, add_run_options, run_keywords

DEFAULT_OUT = Path("out")


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "compare",
        help="hold several runs or laws against each other",
        description="Drive the same manoeuvre with several controllers and compare.",
    )
    parser.add_argument(
        "runs",
        nargs="+",
        metavar="RUN",
        help="a law, a calibration file, or settings as law=lqr,bus=gateway_20ms,tick=5",
    )
    parser.add_argument(
        "--scenario", default="double_lane_change", help="manoeuvre (default: %(default)s)"
    )
    add_run_options(parser)
    add_condition_options(parser)
    parser.add_argument("--duration", type=float, metavar="S", help="stop after so many seconds")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for the page (default: out)"
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object; files only with --out"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Drive all runs, print the table, write comparison.html and comparison.json."""
    from hil import comparison, terminal  # noqa: PLC0415 - loads compiled kernels
    from hil.files import usable_folder, write_text  # noqa: PLC0415
    from hil.report.comparison_page import (  # noqa: PLC0415
        comparison_json,
        comparison_page,
        summary_table,
    )

    if len(set(args.runs)) < len(args.runs):
        raise CanrollError("compare: the same run is named twice: name each once")
    wanted = [(text, comparison.describe(text)) for text in args.runs]
    out = args.out or (None if args.json else DEFAULT_OUT)
    if out is not None:
        usable_folder(out)
    with terminal.progress(quiet=args.json) as progress:
        named = list(
            comparison.runs(
                args.scenario,
                wanted,
                common=run_keywords(args),
                duration=args.duration,
                progress=progress,
            )
        )
    data = comparison_json(named)
    if out is not None:
        page = write_text(out / "comparison.html", comparison_page(named))
        numbers = write_text(out / "comparison.json", json.dumps(data, indent=2) + "\n")
        data["files"] = {"report": str(page), "result": str(numbers)}
    if args.json:
        print(json.dumps(data))
        return 0
    terminal.show_table(summary_table(named))
    terminal.show_warnings([f"{n.name}: {text}" for n in named for text in n.result.warnings])
    terminal.show_files(data.get("files", {}))
    return 0
