"""``canroll report``: the page of a run that was saved, made anew from its folder."""

import argparse

from hil.cli.run import answer
from hil.report.run_folder import check_parent, write_text
from hil.report.run_page import run_page
from hil.runs import experiment, saved_run


def run(args: argparse.Namespace) -> int:
    """Write the page and print the table; 1 if the verdict is that control does not help."""
    result = saved_run.load(args.folder)
    page = check_parent(args.out or args.folder / "report.html", out=args.folder)
    result = experiment.with_files(result, {**result.files, "report": str(page)})
    write_text(page, run_page(result))
    return answer(result, None, as_json=args.json)
