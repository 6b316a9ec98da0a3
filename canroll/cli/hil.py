"""``canroll hil``: ECU and plant as two programs, in real time or in lock step, and the report."""

import argparse
import json
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import can
from rich.table import Table

from canroll.cli import run_view, terminal
from canroll.cli.options import OF_A_RUN, choices_of, folder_of
from canroll.errors import CanrollError
from canroll.report import signal_files
from canroll.report.console import Console
from canroll.report.run_folder import write_files, write_text
from canroll.report.staging import check_parent, usable_folder
from canroll.runs import experiment
from canroll.runs.logs import check_suffix, write_log
from canroll.runs.virtual_time import Interrupted
from hil import hil_run, own_bus
from hil.check import measure
from hil.hardware.bus_options import has_bus, options_of, parsed_options
from hil.hardware.interfaces import INTERFACES, is_shared
from hil.timing_rows import QUANTILES

CHECKED = "double_lane_change"
"""The manoeuvre on whose frames ``--check`` times the firmware where none is named."""


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
    if args.scenario is None and not args.check:
        raise CanrollError("a manoeuvre is required, such as double_lane_change")
    if args.check and not args.prepare:
        return check_machine(args)

    if args.prepare:
        hil_run.prepare(
            args.scenario or CHECKED, duration=args.duration, **choices_of(args, OF_A_RUN)
        )
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
        seen = result.passive if result.controlled is None else result.controlled
        if args.log is not None:
            write_log(args.log, seen.frames)
        if args.signals is not None:
            signal_files.write_signals(args.signals, seen.signals)
        cores = timing.pop("jitterdebugger")
        if out is not None:
            result = write_files(result, out)
            path = write_text(out / "timing.json", json.dumps(cores, indent=1) + "\n")
            files = {**result.files, "timing": str(path), "ticks": str(out / "ticks.npz")}
            result = hil_run.with_files(result, files)
        report(result.to_json() | {"timing": timing}, args, result)
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


def check_machine(args: argparse.Namespace) -> int:
    """Measure the shortest sustainable tick; return 1 if it exceeds the requested one."""
    scenario = args.scenario or CHECKED
    settings, controller = experiment.plan(scenario, **choices_of(args, OF_A_RUN))
    options = bus_options(args) or (own_bus.fd_options() if settings.firmware.fd else [])
    bus = parsed_options(options) if options else None
    seen = measure.measure(
        settings,
        controller,
        bus,
        duration=measure.DURATION if args.duration is None else args.duration,
        announce=(lambda text: None) if args.json or not sys.stderr.isatty() else _announce,
    )
    answer = measure.report(seen, settings.tick * 1e3)
    if args.json:
        print(json.dumps(answer))
    else:
        show_check(answer)
    return 0 if answer["held"] else 1


def _announce(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def report(answer: dict[str, Any], args: argparse.Namespace, result: Any) -> None:  # noqa: ANN401
    """Print the result as JSON or as a table."""
    if args.json:
        print(json.dumps(answer))
        return
    run_view.show(result)
    run_view.show_bus(result)
    terminal.show_files(result.files)
    run_view.show_timing(answer["timing"])


def show_check(answer: Mapping[str, Any]) -> None:
    """Print a report of :func:`hil.check.measure.report`."""
    console = Console(highlight=False, soft_wrap=True)
    table = Table("µs", *QUANTILES, box=None, pad_edge=False, header_style="bold")
    for column in table.columns[1:]:
        column.justify = "right"
    rows = [
        (f"wake-up, {_place(loop)} ({loop['role']})", loop["late_us"]) for loop in answer["loops"]
    ]
    bus = answer["bus"]
    rows += [
        ("timer, beyond 50 µs", answer["timer"]["overshoot_us"]),
        ("tick of the firmware", answer["tick_us"]),
        (f"round trip, {bus['interface']}", bus["round_trip_us"]),
        (f"empty read, {bus['interface']}", bus["poll_us"]),
    ]
    for name, figures in rows:
        if figures is not None:
            table.add_row(name, *(f"{figures[quantile]:.0f}" for quantile in QUANTILES))
    console.print(table)
    if bus["missing"]:
        console.print(f"no round trip: {bus['missing']}")
    if bus["lost"]:
        console.print(f"{bus['lost']} frames did not come back")
    worst = max(answer["needed_us"].values())
    held = [f"{tick} ms {'yes' if ok else 'no'}" for tick, ok in answer["ticks"].items()]
    console.print(f"\nticks this machine can keep: {', '.join(held)}")
    colour, word = ("green", "can") if answer["held"] else ("red", "cannot")
    console.print(
        f"[{colour}]This machine {word} keep a tick of {answer['tick_ms']:g} ms:[/{colour}] "
        f"at worst {worst:.0f} µs of the {500 * answer['tick_ms']:.0f} µs allowed by the rule"
    )
    console.print(f"rule: {answer['rule']}")
    if answer["findings"]:
        console.print("\nfound, with remedies:")
    for finding in answer["findings"]:
        console.print(f"  {finding['what']}: {finding['remedy']}", markup=False)


def _place(loop: Mapping[str, Any]) -> str:
    return "not pinned" if loop["core"] is None else f"core {loop['core']}"
