"""``canroll validate``: a verdict on a vehicle by measured drives."""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from canroll import vehicles
from canroll.cli import terminal
from canroll.cli.options import by_key, choices_of, folder_of
from canroll.cli.terminal import Part
from canroll.errors import CanrollError, UnknownNameError
from canroll.extensions.car.cli.fit import window_of
from canroll.extensions.car.identification.drive_log import OUTPUTS, choice_of, read
from canroll.extensions.car.identification.pieces import Window
from canroll.extensions.car.validation.manoeuvre import STEADY_CIRCLE
from canroll.extensions.car.validation.measurement import NONE, of_fit, zeroed
from canroll.extensions.car.validation.tolerances import with_choices
from canroll.extensions.car.validation.validate import (
    EXPLAINED,
    Validation,
    ValidationSettings,
    validate,
)
from canroll.extensions.car.validation.validation_page import (
    figure_table,
    headline,
    overview,
    signal_table,
    validation_page,
)
from canroll.report.run_folder import write_text
from canroll.report.staging import usable_folder

FIGURES = 13
"""Most figures in the terminal; of more, those that fail."""


def run(args: argparse.Namespace) -> int:
    """Validate, report and write; 1 if a log fails."""
    if args.vehicle is None:
        raise CanrollError("--vehicle is missing: the file that is judged, or a preset's name")
    vehicle = vehicles.load(choices_of(args, ("vehicle",))["vehicle"])
    out = folder_of(args)
    if out is not None:
        usable_folder(out)
    if not args.begin < args.end:
        raise CanrollError(f"--from {args.begin:g} --to {args.end:g}: nothing is between them")
    settings = ValidationSettings(
        imu=args.imu,
        window=Window(args.begin, args.end),
        manoeuvre=args.manoeuvre,
        rating=args.rating,
        explained=_explained(by_key("--explained", args.explained or ())),
        error=args.error,
        tolerances=with_choices(by_key("--tolerance", args.tolerance or ())),
    )
    measurement = NONE if args.measurement is None else of_fit(args.measurement)
    straight = None if args.zero is None else window_of("--zero", args.zero)
    choices = dict(map(choice_of, args.signal or ()))
    validations = []
    with terminal.progress(quiet=args.json) as progress:
        for number, name in enumerate(args.logs):
            progress("logs", number / len(args.logs))
            log = read(name, choices, dbc=args.dbc, map_file=args.map, rate=args.rate)
            own = measurement if straight is None else zeroed(log, straight)
            validations.append(validate(log, vehicle, settings, own))
        progress("logs", 1.0)
    result: dict[str, Any] = {
        "vehicle": vehicle.reference,
        "passed": all(one.passed for one in validations),
        "logs": [one.to_json() for one in validations],
    }
    files = {} if out is None else _write(validations, result, out)
    parts = [*_parts(validations), *terminal.files(files)]
    return terminal.emit(args, result | {"files": files}, parts, good=result["passed"])


def _explained(given: Mapping[str, str]) -> dict[str, float]:
    limits = dict(EXPLAINED)
    for name, text in given.items():
        if name not in OUTPUTS:
            raise UnknownNameError("signal of a log", name, OUTPUTS)
        try:
            limits[name] = float(text)
        except ValueError as error:
            raise CanrollError(f"--explained {name}={text}: expected a number") from error
        if not limits[name] <= 1.0:
            raise CanrollError(f"--explained {name}={text}: must be at most 1")
    return limits


def _parts(validations: Sequence[Validation]) -> Iterator[Part]:
    good = all(one.passed for one in validations)
    yield terminal.verdict(headline(validations), good=good)
    if len(validations) > 1:
        yield from ("", overview(validations))
        return
    (one,) = validations
    yield from terminal.warnings(one.drive.remarks)
    if one.manoeuvre != STEADY_CIRCLE:
        yield from ("", signal_table(one))
    if one.judged.criteria or one.judged.bands:
        table = figure_table(one, FIGURES)
        yield from ("", table) if table.rows else ()
        yield from filter(None, [table.note])


def _write(validations: Sequence[Validation], result: dict[str, Any], out: Path) -> dict[str, str]:
    """Write numbers and page; return their paths by what they are."""
    files = {"result": out / "validation.json", "report": out / "report.html"}
    written = {name: str(path) for name, path in files.items()}
    result = result | {"files": written}
    write_text(files["result"], json.dumps(result, indent=1))
    write_text(files["report"], validation_page(validations, result))
    return written
