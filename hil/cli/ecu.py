"""``canroll ecu``: the ECU alone, in real time, on any python-can bus."""

import argparse
from pathlib import Path

from canroll.errors import CanrollError, VerdictError
from codegen.run import BACKENDS
from codegen.run.backends import default_backend, open_backend
from gain_gen.calibration.calibration_file import load as load_calibration
from hil.realtime import ecu_loop, process, tick_trace
from hil.realtime.bus_link import add_bus_arguments, open_link
from hil.realtime.hardware import bus_record

MODES = ("INIT", "ACTIVE", "DEGRADED", "SAFE")
TRACE_SECONDS = 600
FRAMES_PER_SECOND = 700
"""What the contract's messages come to, with room."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "ecu",
        help="the ECU alone, on any python-can interface",
        description="Run the roll controller in real time against a vehicle on a CAN bus.",
    )
    add_bus_arguments(parser)
    parser.add_argument("--calibration", type=Path, metavar="FILE", help="of canroll design")
    parser.add_argument(
        "--backend", help=f"{', '.join(BACKENDS)} (default: native where a C compiler is)"
    )
    parser.add_argument("--duration", type=float, metavar="S", help="default: until stopped")
    add_loop_options(parser)
    parser.add_argument("--trace", type=Path, metavar="FILE", help="write the trace of all ticks")
    parser.add_argument(
        "--replay", type=Path, metavar="FILE", help="run a trace again instead and compare"
    )
    parser.set_defaults(run=run)


def add_loop_options(parser: argparse.ArgumentParser) -> None:
    """Add what ECU and plant both take about their loops."""
    parser.add_argument(
        "--peer-timeout",
        type=float,
        default=0.8,
        metavar="S",
        help="end when the other side falls silent, 0: stay and wait (default: %(default)g)",
    )
    parser.add_argument("--cpu", type=int, metavar="N", help="core to run on")


def add_prepare_option(parser: argparse.ArgumentParser) -> None:
    """Add the option of programs whose kernels may have to be compiled first."""
    parser.add_argument(
        "--prepare",
        action="store_true",
        help="only compile what the run needs, into the cache; no bus is opened",
    )


def nanoseconds(seconds: float | None, option: str) -> int | None:
    """Return a time of the command line in ns, 0 and None as None.

    Raises:
        CanrollError: it is negative.
    """
    if seconds is not None and not seconds >= 0:
        raise CanrollError(f"{option} {seconds:g}: not negative")
    return round(seconds * 1e9) if seconds else None


def run(args: argparse.Namespace) -> int:
    """Run until stopped, or replay a trace; 0 unless a replay differs."""
    backend = args.backend or default_backend()
    if args.replay is not None:
        return replay(args.replay, backend)
    if args.calibration is None:
        raise CanrollError("which controller? --calibration FILE, as 'canroll design' writes it")
    duration = nanoseconds(args.duration, "--duration")
    peer_timeout = nanoseconds(args.peer_timeout, "--peer-timeout")
    calibration = load_calibration(args.calibration).record
    ecu = open_backend(backend, calibration)
    link = open_link(args)
    seconds = args.duration + 1 if args.duration else TRACE_SECONDS
    recorder = tick_trace.Recorder(
        ticks=round(seconds * 1e6 / calibration.tick_us),
        frames=round(seconds * (FRAMES_PER_SECOND + 1e6 / calibration.tick_us)),
    )
    with process.stop_on_signals() as stop:
        notes = process.prepare(cpu=args.cpu, priority=process.ECU_PRIORITY)
        for note in notes:
            print(f"note: {note}", flush=True)
        print(f"ECU runs every {calibration.tick_us / 1000:g} ms", flush=True)
        try:
            outcome = ecu_loop.run(
                ecu,
                link,
                recorder,
                calibration,
                stop=stop,
                duration_ns=duration,
                peer_timeout_ns=peer_timeout,
            )
        finally:
            link.close()
        if args.trace is not None:
            about = {
                "reason": outcome.reason,
                "backend": backend,
                "notes": notes,
                "cpu": args.cpu,
                "sent": link.sent,
                "received": link.received,
                "failed": link.failed,
                "full": recorder.full,
                "bus": bus_record.about_of(link.record),
            }
            trace = tick_trace.TickTrace(
                calibration,
                recorder.ticks(),
                recorder.frames(),
                about,
                bus_record.entries_of(link.record),
            )
            tick_trace.save(args.trace, trace)
    print(
        f"ECU ends ({outcome.reason}) in {MODES[outcome.mode]}: {outcome.ticks} ticks, "
        f"{outcome.misses} missed",
        flush=True,
    )
    return 0


def replay(path: Path, backend: str) -> int:
    """Run a trace through a backend and compare every frame it sends.

    Raises:
        VerdictError: a frame differs.
    """
    trace = tick_trace.load(path)
    again = tick_trace.replay(trace, backend)
    if again.difference is not None:
        raise VerdictError(f"{path}: backend '{backend}' differs: {again.difference}")
    sent = int(trace.frames["sent"].sum())
    print(f"{backend}: {len(trace.ticks)} ticks, {sent} frames, the same byte for byte")
    return 0
