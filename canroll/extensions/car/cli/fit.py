"""``canroll fit``: a vehicle's numbers from a measured drive."""

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import tomli_w

from canroll import vehicles
from canroll.cli import terminal
from canroll.cli.options import choices_of, folder_of
from canroll.cli.terminal import Part
from canroll.documents import with_short_lists
from canroll.errors import CanrollError
from canroll.extensions.car.identification.drive_log import choice_of, read
from canroll.extensions.car.identification.fit import Fit, FitSettings, fit
from canroll.extensions.car.identification.fit_page import (
    actuator_lines,
    actuator_table,
    explained_lines,
    fit_page,
    fitted_table,
    left_line,
    measurement_line,
    not_of_log,
)
from canroll.extensions.car.identification.pieces import Window
from canroll.report.run_folder import write_text
from canroll.report.staging import usable_folder
from canroll.vehicles.plausible import outside


def run(args: argparse.Namespace) -> int:
    """Fit, report and write."""
    if args.vehicle is None:
        raise CanrollError(
            "--vehicle is missing: the file where the fit starts, such as 'canroll vehicle new' "
            "writes"
        )
    start = vehicles.load(choices_of(args, ("vehicle",))["vehicle"])
    # with --vehicle-set it is called after its changes, which is no name of a file
    start = replace(start, name=Path(args.vehicle).stem)
    out = folder_of(args)
    if out is not None:
        usable_folder(out)
    choices = dict(map(choice_of, args.signal or ()))
    log = read(args.log, choices, dbc=args.dbc, map_file=args.map, rate=args.rate)
    if not args.begin < args.end:
        raise CanrollError(f"--from {args.begin:g} --to {args.end:g}: nothing is between them")
    settings = FitSettings(
        imu=args.imu,
        window=Window(args.begin, args.end),
        checked=None if args.check is None else window_of("--check", args.check),
        free=tuple(args.free or ()),
        held=tuple(args.hold or ()),
        starts=args.starts,
        jobs=args.jobs,
        actuator=args.actuator,
    )
    with terminal.progress(quiet=args.json) as progress:
        result = fit(log, start, settings, progress)
    files = {} if out is None else _write(result, out)
    parts = [*_parts(result), *terminal.files(files)]
    return terminal.emit(args, result.to_json() | {"files": files}, parts)


def window_of(option: str, text: str) -> Window:
    """Return the window of "FROM:TO", the value of an option.

    Raises:
        CanrollError: it is none.
    """
    begin, _, end = text.partition(":")
    try:
        window = Window(float(begin), float(end))
    except ValueError as error:
        raise CanrollError(f"{option} {text}: expected FROM:TO in s, such as 12:15.5") from error
    if not window.begin < window.end:
        raise CanrollError(f"{option} {text}: nothing is between them")
    return window


def _parts(result: Fit) -> Iterator[Part]:
    yield terminal.verdict(result.verdict, good=None)
    yield from explained_lines(result)
    yield from terminal.warnings(result.remarks)
    yield from ("", fitted_table(result))
    if result.actuators:
        yield from ("", actuator_table(result))
        yield from actuator_lines(result)
    yield measurement_line(result)
    if kept := not_of_log(result):
        yield f"from the vehicle file, not from the log: {', '.join(kept)}"
    if result.pairs:
        pairs = [f"{first} with {second} ({r:+.2f})" for first, second, r in result.pairs]
        yield f"strongly correlated: {', '.join(pairs)}"
    yield left_line(result)


def _write(result: Fit, out: Path) -> dict[str, str]:
    """Write vehicle, numbers and page; return their paths by what they are."""
    table = result.vehicle.document
    if result.vehicle.design == result.vehicle.plant:
        del table["design"]
        table["sources"].pop("design", None)
    if unusual := sorted(outside(result.vehicle)):
        # what a log says is meant, and told as a remark
        table["unusual"] = unusual
    files = {
        "vehicle": out / f"{result.start.name}.toml",
        "result": out / "fit.json",
        "report": out / "report.html",
    }
    written = {name: str(path) for name, path in files.items()}
    write_text(files["vehicle"], with_short_lists(tomli_w.dumps(table)))
    write_text(files["result"], json.dumps(result.to_json() | {"files": written}, indent=1))
    write_text(files["report"], fit_page(result))
    return written
