"""What commands that leave one page and its numbers share: their options, folder and files."""

import argparse
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hil.cli.run import path_named

DEFAULT_OUT = Path("out")


def add_page_options(parser: argparse.ArgumentParser) -> None:
    """Add where the page goes, and that the answer is wanted as JSON."""
    parser.add_argument(
        "--out", type=path_named, metavar="DIR", help="folder for the page (default: out)"
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object; files only with --out"
    )


def folder(args: argparse.Namespace) -> Path | None:
    """Return the folder that the page goes to, usable; None where none is asked for.

    Raises:
        CanrollError: it cannot be written to.
    """
    from hil.report.run_folder import usable_folder  # noqa: PLC0415 - loads compiled kernels

    out = args.out or (None if args.json else DEFAULT_OUT)
    return None if out is None else usable_folder(out)


def write(
    out: Path | None,
    stem: str,
    texts: Mapping[str, tuple[str, Callable[[], str]]],
    data: Mapping[str, Any],
) -> dict[str, Any]:
    """Write the texts and the numbers, and return the numbers with the files' names.

    Args:
        out: folder, or None for no files.
        stem: of every file's name.
        texts: suffix and what makes the text, by what the answer calls the file.
        data: the numbers, written as JSON.

    Raises:
        CanrollError: a file cannot be written.
    """
    from hil.report.run_folder import write_text  # noqa: PLC0415

    files = {}
    if out is not None:
        made = {**texts, "result": (".json", lambda: json.dumps(data, indent=2) + "\n")}
        files = {
            name: str(write_text((out / stem).with_suffix(suffix), text()))
            for name, (suffix, text) in made.items()
        }
    return {**data, **({"files": files} if files else {})}
