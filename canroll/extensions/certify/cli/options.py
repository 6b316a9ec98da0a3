"""The options of ``canroll certify``."""

from canroll.cli.options import JSON, choices, path_named
from canroll.cli.parser import Parser, opt, related


def certify(parser: Parser) -> None:
    """Prove a calibration stable for every sequence of delays."""
    parser.take(
        "Prove the loop of a calibration's integers stable for every sequence of delays, bound "
        "what roundings do, and write a certificate that a checker of 420 lines can check alone.",
        opt("calibration", path_named, None, "calibration.toml of canroll design"),
        choices(("vehicle", "bus", "dbc", "map")),
        JSON,
        related("json", excludes={"check": "--check prints what the checker prints"}),
        opt("--check", path_named, "FILE", "check this certificate of the calibration, and compare "
            "its data with vehicle and bus"),
        opt("--out", path_named, "FILE", "certificate, or folder for it (default: certificate.json "
            "next to the calibration)", excludes={"check": "--check writes no certificate"}),
    )  # fmt: skip
