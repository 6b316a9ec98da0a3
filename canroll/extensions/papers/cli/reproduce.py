"""``canroll reproduce``: every table of the four papers recomputed, with a verdict per number."""

import argparse

from canroll.cli import terminal
from canroll.cli.cases import driven
from canroll.cli.options import folder_of
from canroll.extensions.papers import reproduce
from canroll.extensions.papers.reproduction_page import reproduction_page
from canroll.report.page import PageTable
from canroll.report.run_folder import write_page
from canroll.report.staging import page_folder


def run(args: argparse.Namespace) -> int:
    """Recompute, print the verdicts, write reproduction.html, .md and .json."""
    out = page_folder(folder_of(args))
    with driven(args, out) as cases:
        parts = reproduce.reproduce(args.papers, cases)
    texts = {
        "report": (".html", lambda: reproduction_page(parts)),
        "tables": (".md", lambda: reproduce.to_markdown(parts)),
    }
    data = write_page(out, "reproduction", texts, reproduce.to_json(parts))
    head = ("", *parts[0].counts)
    rows = [[part.paper.name, *map(str, part.counts.values())] for part in parts]
    files = terminal.files(data.get("files", {}))
    return terminal.emit(args, data, [PageTable("", head, rows), *files])
