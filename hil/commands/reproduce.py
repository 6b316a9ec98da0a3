"""``canroll reproduce``: every table of the four papers recomputed, with a verdict a number."""

import argparse
import json
from pathlib import Path

DEFAULT_OUT = Path("out")


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "reproduce",
        help="recompute the tables of the four papers",
        description="Recompute every table of the papers through the whole chain and compare.",
    )
    parser.add_argument(
        "papers",
        nargs="*",
        metavar="PAPER",
        help="redondo2021, viadero2022, vu2020, yim2020 (default: all)",
    )
    parser.add_argument(
        "--runs",
        type=int,
        metavar="N",
        help="paired runs of each law beside ours (default: 20; 0: leave that out)",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder (default: out)")
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object; files only with --out"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Recompute, print the verdicts, write reproduction.html, .md and .json."""
    from hil import terminal  # noqa: PLC0415 - loads compiled kernels
    from hil.files import usable_folder, write_text  # noqa: PLC0415
    from hil.report.page import Table  # noqa: PLC0415
    from hil.report.reproduction_page import reproduction_page  # noqa: PLC0415
    from hil.reproduce import papers  # noqa: PLC0415
    from hil.reproduce.beside import RUNS  # noqa: PLC0415

    runs = RUNS if args.runs is None else args.runs
    out = args.out or (None if args.json else DEFAULT_OUT)
    if out is not None:
        usable_folder(out)
    with terminal.progress(quiet=args.json) as progress:
        found = papers.reproduce(args.papers, progress, runs=runs)
    data = papers.to_json(found)
    files = {}
    if out is not None:
        texts = {
            "report": ("reproduction.html", reproduction_page(found)),
            "tables": ("reproduction.md", papers.to_markdown(found)),
            "result": ("reproduction.json", json.dumps(data, indent=2) + "\n"),
        }
        files = {name: str(write_text(out / file, text)) for name, (file, text) in texts.items()}
    if args.json:
        print(json.dumps({**data, "files": files}))
        return 0
    head = ("", *found[0].counts)
    rows = [[part.paper.title, *map(str, part.counts.values())] for part in found]
    terminal.show_table(Table("", head, rows))
    terminal.show_files(files)
    return 0
