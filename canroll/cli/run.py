"""``canroll run``: a manoeuvre in virtual time, or a saved run evaluated again."""

import argparse
from collections.abc import Collection
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from canroll import dbc
from canroll.cli import run_view, terminal
from canroll.cli.options import choices_of, folder_of
from canroll.cli.parser import check_mode
from canroll.cli.run_parsers import SAVED
from canroll.dbc.reader import each
from canroll.report.run_folder import write_files, write_text
from canroll.report.run_page import run_page
from canroll.report.staging import check_parent, usable_folder
from canroll.runs import experiment, saved_run
from canroll.runs.logs import check_suffix, write_log
from canroll.runs.result import Result
from canroll.runs.trace import Trace
from canroll.runs.virtual_time import Interrupted

if TYPE_CHECKING:
    from canroll.report.signal_files import About


def run(args: argparse.Namespace) -> int:
    """Run, report and write; 1 if the verdict is that control does not help."""
    if isinstance(args.scenario, Path):
        return again(args)
    out = folder_of(args)
    if args.log is not None:
        check_parent(check_suffix(args.log), out=out)
    if args.signals is not None:
        check_parent(_signal_files().check_suffix(args.signals), out=out)
    if out is not None:
        usable_folder(out)
    try:
        with terminal.progress(quiet=args.json) as progress:
            result = experiment.run(args.scenario, progress=progress, **choices_of(args))
    except Interrupted as stopped:
        # the frames of a long run take longer to write than anyone waits who did not ask for them
        kept = "no files are written"
        if args.log is not None:
            kept = f"its frames are in {write_log(args.log, stopped.trace.frames)}"
        raise KeyboardInterrupt(f"{stopped} of the run: {kept}") from None
    seen = result.passive if result.controlled is None else result.controlled
    files = {}
    if args.log is not None:
        files["bus log"] = str(write_log(args.log, seen.frames))
    if args.signals is not None:
        files["signals"] = str(
            _signal_files().write_signals(args.signals, seen.signals, about(result, seen))
        )
    result = experiment.with_files(result, files)
    without = () if args.trace else ("trace",)
    code = answer(result, out, args, without=without)
    if without and out is not None:
        terminal.note(f"{out}: no trace: 'canroll run' and 'canroll compare' cannot read the run")
    return code


def _signal_files() -> ModuleType:
    # formats of other tools, where one is asked for
    from canroll.report import signal_files  # noqa: PLC0415

    return signal_files


def about(result: Result, seen: Trace) -> "About":
    """Return what goes with the signals of a run: its settings, ids and frames."""
    settings = result.settings
    texts = {
        "scenario": settings.scenario,
        "law": settings.law_name,
        "vehicle": settings.vehicle_name,
        "speed": f"{settings.speed * 3.6:g} km/h",
        "bus": settings.bus_name,
        "seed": str(settings.seed),
        "calibration id": f"0x{result.record.id:08X}",
        "calibration CRC": f"0x{result.record.crc & 0xFFFFFFFF:08X}",
        "canroll": version("canroll"),
        "verdict": result.verdict,
    }
    described: About = _signal_files().About(
        texts, seen.frames, each(settings.profile.dbc or dbc.PATH)
    )
    return described


def answer(
    result: Result,
    out: Path | None,
    args: argparse.Namespace,
    *,
    without: Collection[str] = (),
) -> int:
    """Write the files of a run where there is a folder, print it, and return the exit code."""
    if out is not None:
        result = write_files(result, out, without=without)
    terminal.emit(
        args,
        result.to_json(),
        run_view.parts(result, verbose=args.verbose),
        style=run_view.style(result),
    )
    return result.exit_code


def again(args: argparse.Namespace) -> int:
    """Evaluate a saved run again and write its page; 1 if control does not help."""
    check_mode(args, SAVED, why="a saved run is evaluated as it was driven")
    folder = args.scenario if args.out is None else usable_folder(args.out)
    result = saved_run.load(args.scenario)
    page = check_parent(folder / "report.html")
    result = experiment.with_files(result, {**result.files, "report": str(page)})
    write_text(page, run_page(result))
    return answer(result, None, args)
