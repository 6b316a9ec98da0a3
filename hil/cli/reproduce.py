"""``canroll reproduce``: every table of the four papers recomputed, with a verdict per number."""

import argparse
import json

from hil.cli import terminal
from hil.cli.cases import driven
from hil.cli.options import folder_of
from hil.papers import reproduce
from hil.papers.reproduction_page import reproduction_page
from hil.report.page import Table
from hil.report.run_folder import write_page
from hil.report.staging import page_folder


def run(args: argparse.Namespace) -> int:
    """Recompute, print the verdicts, write reproduction.html, .md and .json."""
    out = page_folder(folder_of(args))
    with driven(args, out) as cases:
        found = reproduce.reproduce(args.papers, cases)
    texts = {
        "report": (".html", lambda: reproduction_page(found)),
        "tables": (".md", lambda: reproduce.to_markdown(found)),
    }
    data = write_page(out, "reproduction", texts, reproduce.to_json(found))
    if args.json:
        print(json.dumps(data))
        return 0
    head = ("", *found[0].counts)
    rows = [[part.paper.name, *map(str, part.counts.values())] for part in found]
    terminal.show_table(Table("", head, rows))
    terminal.show_files(data.get("files", {}))
    return 0
