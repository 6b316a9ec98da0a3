"""The options of ``canroll certify``."""

from canroll.cli.options import (
    add_choices,
    add_json,
    path_named,
)
from canroll.cli.parser import Parser, Relations


def certify(parser: Parser) -> None:
    """Prove a calibration stable for every sequence of delays."""
    parser.description = (
        "Prove the loop of a calibration's integers stable for every sequence of delays, bound "
        "what roundings do, and write a certificate that a checker of 420 lines can check alone."
    )
    parser.add_argument("calibration", type=path_named, help="calibration.toml of canroll design")
    add_choices(parser, ("vehicle", "bus", "dbc", "map"))
    add_json(parser)
    compared = {"check": "--check writes no certificate"}
    parser.add_argument(
        "--check",
        type=path_named,
        metavar="FILE",
        help="check this certificate of the calibration, and compare its data with vehicle and bus",
    )
    plain = {"check": "--check prints what the checker prints"}
    parser.relate(Relations(excludes=plain), "json")
    parser.add_argument(
        "--out",
        excludes=compared,
        type=path_named,
        metavar="FILE",
        help="certificate, or folder for it (default: certificate.json next to the calibration)",
    )
