"""``canroll report``: the page of a run that was saved, made anew from its folder."""

import argparse
from pathlib import Path

from hil.cli.run import answer


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "report",
        help="judge a saved run again and write its page",
        description="Read a run from the folder that 'canroll run' or 'canroll hil' left, judge "
        "it again and write its page. Several runs on one page: 'canroll compare FOLDER FOLDER'.",
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="of a saved run")
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="the page (default: report.html in the folder)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the page and print the table; 1 if the verdict is that control does not help."""
    from hil.report.run_folder import check_parent, write_text  # noqa: PLC0415
    from hil.report.run_page import run_page  # noqa: PLC0415
    from hil.runs import experiment, saved_run  # noqa: PLC0415 - loads compiled kernels

    result = saved_run.load(args.folder)
    page = check_parent(args.out or args.folder / "report.html", out=args.folder)
    result = experiment.with_files(result, {**result.files, "report": str(page)})
    write_text(page, run_page(result))
    return answer(result, None, as_json=args.json)
