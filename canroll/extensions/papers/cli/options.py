"""The options of ``canroll reproduce``."""

from canroll.cli.options import (
    add_answer,
    add_execution,
)
from canroll.cli.parser import Parser


def reproduce(parser: Parser) -> None:
    """Recompute the tables of the four papers."""
    parser.description = (
        "Recompute every table of the papers with the complete tool chain and compare."
    )
    parser.add_argument(
        "papers",
        nargs="*",
        metavar="PAPER",
        help="redondo2021, viadero2022, vu2020, yim2020 (default: all)",
    )
    add_execution(parser, "", "only", "resume", "scheduler")
    add_answer(parser, "the page")
