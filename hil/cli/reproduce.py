"""``canroll reproduce``: every table of the four papers recomputed, with a verdict a number."""

import argparse
import json

from hil.cli.page_files import add_page_options, folder, write


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
    add_page_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Recompute, print the verdicts, write reproduction.html, .md and .json."""
    from hil.cli import terminal  # noqa: PLC0415 - loads compiled kernels
    from hil.papers import reproduce  # noqa: PLC0415
    from hil.papers.effort_section import RUNS  # noqa: PLC0415
    from hil.papers.reproduction_page import reproduction_page  # noqa: PLC0415
    from hil.report.page import Table  # noqa: PLC0415

    runs = RUNS if args.runs is None else args.runs
    out = folder(args)
    with terminal.progress(quiet=args.json) as progress:
        found = reproduce.reproduce(args.papers, progress, runs=runs)
    texts = {
        "report": (".html", lambda: reproduction_page(found)),
        "tables": (".md", lambda: reproduce.to_markdown(found)),
    }
    data = write(out, "reproduction", texts, reproduce.to_json(found))
    if args.json:
        print(json.dumps(data))
        return 0
    head = ("", *found[0].counts)
    rows = [[part.paper.name, *map(str, part.counts.values())] for part in found]
    terminal.show_table(Table("", head, rows))
    terminal.show_files(data.get("files", {}))
    return 0
