"""``canroll hil``: ECU and plant as two programs, in real time or in lock step, and the report."""

import argparse
import json
import sys
import tempfile
from pathlib import Path

import can

from canroll.cli import run_view, terminal
from canroll.cli.options import OF_A_RUN, choices_of, folder_of
from canroll.errors import CanrollError
from canroll.hil import hil_run
from canroll.hil.hardware.bus_options import has_bus, options_of
from canroll.hil.hardware.interfaces import INTERFACES, is_shared
from canroll.report import signal_files
from canroll.report.run_folder import write_files, write_text
from canroll.report.staging import check_parent, usable_folder
from canroll.runs.logs import check_suffix, write_log
from canroll.runs.virtual_time import Interrupted


def bus_options(args: argparse.Namespace) -> list[str]:
    """Return python-can's options for the programs that open the bus; empty: the plant's own bus.

    Missing options come from python-can's configuration (can.rc, environment).

    Raises:
        CanrollError: an interface visible to one process only, an interface with ``--serve``, or
            options of one program only.
    """
    if not has_bus(args):
        return []
    if "timing" in args:
        raise CanrollError("--timing applies to one program: give it to 'canroll plant' and 'ecu'")
    if args.serve is not None:
        raise CanrollError(f"--serve {args.serve} applies to the plant's own bus: omit -i")
    configured = {} if "interface" in args else can.util.load_config()
    options = []
    for name in ("interface", "channel", "bitrate", "data_bitrate"):
        value = getattr(args, name, configured.get(name))
        if value == "virtual":
            raise CanrollError(
                "-i virtual works only within one process: omit -i for the plant's bus"
            )
        if value is not None:
            options += [f"--{name.replace('_', '-')}", str(value)]
    if getattr(args, "fd", False):
        options.append("--fd")
    if "bus_kwargs" in args:
        options += ["--bus-kwargs", *(f"{key}={value}" for key, value in args.bus_kwargs.items())]
    return options


def run(args: argparse.Namespace) -> int:
    """Drive, report and write; 1 if control does not help, or the run is not valid."""
    if args.prepare:
        hil_run.prepare(args.scenario, duration=args.duration, **choices_of(args, OF_A_RUN))
        return 0
    refuse_one_adapter(args)
    out = folder_of(args)
    for path, check in ((args.log, check_suffix), (args.signals, signal_files.check_suffix)):
        if path is not None:
            check_parent(check(path), out=out)
    with tempfile.TemporaryDirectory(prefix="canroll-") as scratch:
        folder = Path(scratch) if out is None else usable_folder(out)
        try:
            result, timing = hil_run.run(
                args.scenario,
                bus_options=bus_options(args),
                folder=folder,
                passive_by_programs=args.passive == "hil",
                duration=args.duration,
                pace=args.pace,
                announce=(lambda text: None) if args.json else _announce,
                serve=args.serve,
                **choices_of(args, OF_A_RUN),
            )
        except Interrupted as stopped:
            if out is None:
                raise
            path = write_log(out / "bus.asc", stopped.trace.frames)
            raise KeyboardInterrupt(f"{stopped}: {path} has the frames up to then") from None
        shown = result.passive if result.controlled is None else result.controlled
        if args.log is not None:
            write_log(args.log, shown.frames)
        if args.signals is not None:
            signal_files.write_signals(args.signals, shown.signals)
        cores = timing.pop("jitterdebugger")
        if out is not None:
            result = write_files(result, out)
            path = write_text(out / "timing.json", json.dumps(cores, indent=1) + "\n")
            files = {**result.files, "timing": str(path), "ticks": str(out / "ticks.npz")}
            result = hil_run.with_files(result, files)
        seen = [*run_view.parts(result, verbose=True), *run_view.timing(timing)]
        data = result.to_json() | {"timing": timing}
        terminal.emit(args, data, seen, style=run_view.style(result))
    return result.exit_code


def refuse_one_adapter(args: argparse.Namespace) -> None:
    """Raise CanrollError if two programs cannot open the bus at the same time."""
    if not has_bus(args):
        return
    name, channel, _, _ = options_of(args)
    if name in INTERFACES and not is_shared(name):
        raise CanrollError(
            f"-i {name}: only one program can open {channel}: give 'canroll plant' and "
            "'canroll ecu' an adapter each"
        )


def _announce(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
