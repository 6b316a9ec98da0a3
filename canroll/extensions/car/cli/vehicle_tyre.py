"""``canroll vehicle tyre``: a tyre property file from a measured table."""

import argparse
from pathlib import Path

from canroll.cli import terminal
from canroll.cli.terminal import Part
from canroll.documents import text
from canroll.errors import CanrollError
from canroll.extensions.car.tyres.measured import read
from canroll.extensions.car.tyres.tyre_fit import fit
from canroll.extensions.car.tyres.tyre_view import (
    coefficient_table,
    draw,
    error_line,
    file_text,
    summary,
    untold_lines,
)
from canroll.report.run_folder import write_text
from canroll.report.staging import check_parent
from canroll.vehicles.tyres import tir


def run(args: argparse.Namespace) -> int:
    """Fit, report and write."""
    if args.out is None:
        raise CanrollError("--out is missing: the tyre file to write, such as my_tyre.tir")
    data, out, start = Path(args.vehicle), Path(args.out), args.start
    if out.suffix != ".tir":
        raise CanrollError(f"--out {out}: the name of a tyre file ends in .tir")
    if start is not None and out.resolve() == Path(start).resolve():
        raise CanrollError(f"--out {out}: it is the file of --from: choose another name")
    if args.radius is not None and not 0.05 < args.radius < 2.0:
        raise CanrollError(f"--radius {args.radius:g}: must be that of a tyre, in m")
    for path in (out, out.with_suffix(".png")):
        check_parent(path)
    table = read(data, args.axes)
    known = None if start is None else tir.read(Path(start))
    with terminal.progress(quiet=args.json) as progress:
        result = fit(table, known, args.radius, progress)
    write_text(out, file_text(result, "" if start is None else text(Path(start))))
    files = {"tyre": str(out), "picture": str(draw(result, out.with_suffix(".png")))}
    parts: list[Part] = [
        terminal.verdict(summary(result), good=None),
        error_line(result),
        *terminal.warnings(result.remarks),
        *("", coefficient_table(result)),
        *untold_lines(result),
        *terminal.files(files),
    ]
    return terminal.emit(args, result.to_json() | {"files": files}, parts)
