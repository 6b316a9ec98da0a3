"""The options of ``canroll reproduce``."""

from canroll.cli.options import answer, execution
from canroll.cli.parser import Parser, opt


def reproduce(parser: Parser) -> None:
    """Recompute the tables of the four papers."""
    parser.take(
        "Recompute every table of the papers with the complete tool chain and compare.",
        opt("papers", str, "PAPER", "redondo2021, viadero2022, vu2020, yim2020 (default: all)",
            nargs="*"),
        execution("", "only", "resume", "scheduler"),
        *answer("the page"),
    )  # fmt: skip
