"""``canroll run``: a manoeuvre in virtual time, without and with control, and what came of it."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from canroll.errors import CanrollError

if TYPE_CHECKING:
    from hil.runs.result import Result

DEFAULT_OUT = Path("out")


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "run",
        help="drive a manoeuvre in virtual time, without and with control",
        description="Drive a manoeuvre in virtual time, without and with control, and report.",
    )
    parser.add_argument("scenario", help="double_lane_change, roundabout, …")
    add_run_options(parser)
    add_condition_options(parser)
    parser.add_argument("--duration", type=float, metavar="S", help="stop after so many seconds")
    parser.add_argument(
        "--log", type=path_named, metavar="FILE", help="bus log: .asc .blf .log .mf4 .pcap .pcapng"
    )
    parser.add_argument("--signals", type=path_named, metavar="FILE", help="signals: .csv .mf4")
    parser.add_argument(
        "--out",
        type=path_named,
        metavar="DIR",
        help="folder for report, log, header (default: out)",
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object; files only with --out"
    )
    parser.set_defaults(run=run)


def not_empty(text: str) -> str:
    """Return ``text`` as an option's value; "" is refused."""
    if not text:
        raise argparse.ArgumentTypeError("must not be empty")
    return text


def path_named(text: str) -> Path:
    """Return the path that an option names; "" would silently be the current folder."""
    return Path(not_empty(text))


def add_run_options(
    parser: argparse.ArgumentParser,
    *,
    speed_range: str = "",
    plant: str = "roll1",
    speed_help: str = "default: the vehicle's own",
) -> None:
    """Add what says which controller drives which vehicle over which bus.

    ``speed_range``: speeds and laws are lists, this being the default of the speeds; ``plant``:
    what the command takes by default.
    """
    parser.add_argument("--vehicle", type=not_empty, help="preset or TOML file (default: van_real)")
    several = ", several with commas" if speed_range else ", or passive"
    parser.add_argument("--law", help=f"control law{several} (default: lqg_delay)")
    parser.add_argument(
        "--calibration", type=path_named, metavar="FILE", help="of canroll design; instead of a law"
    )
    parser.add_argument("--actuator", help="suspension, bars, dampers, valves")
    parser.add_argument("--observer", help="two_sensors, one_sensor, propagated, reference")
    parser.add_argument("--plant", help=f"vehicle model that is simulated (default: {plant})")
    if speed_range:
        parser.add_argument(
            "--speed", metavar="FROM:TO:STEP", default=speed_range, help="default: %(default)s"
        )
    else:
        parser.add_argument("--speed", type=float, metavar="KMH", help=speed_help)
    parser.add_argument("--bus", help="500k, 125k_busy, gateway_20ms, gateway_50ms")
    parser.add_argument("--tick", type=float, metavar="MS", help="period of the loop (default: 10)")
    parser.add_argument(
        "--phase",
        type=float,
        metavar="MS",
        help="start ticks so long after the Imu frames (default: as the seed has it)",
    )
    parser.add_argument("--trigger", help="event or every (default: event)")
    parser.add_argument("--gains", help="computed, or as_printed in the law's paper")
    parser.add_argument(
        "--no-feedforward",
        dest="feedforward",
        action="store_false",
        default=None,
        help="without the disturbance feedforward",
    )
    parser.add_argument(
        "--identification",
        action="store_true",
        default=None,
        help="identify roll stiffness and damping at run time",
    )
    parser.add_argument(
        "--heartbeat", type=float, metavar="MS", help="a command at the latest after (default: 50)"
    )
    parser.add_argument("--backend", help="python, native, cortex-m4, … (default: native)")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="option of the manoeuvre, such as friction=0.6; may be repeated",
    )
    parser.add_argument("--seed", type=int, default=0, help="default: 0")


def add_condition_options(parser: argparse.ArgumentParser) -> None:
    """Add what says how sensors and actuators are: faults, temperature, supply."""
    group = parser.add_argument_group("sensors and actuators")
    group.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="WHERE=KIND[:VALUE][@START[:END]]",
        help="a fault from START to END (s); WHERE is a signal of a sensor's message "
        "(Imu.RollRate=stuck@3:5; stuck, dropout, invalid, offset:VALUE, burst:VALUE in SI units) "
        "or an actuator's corner (front_left=weak:0.3@2; stuck, floating, weak:SHARE); "
        "may be repeated",
    )
    group.add_argument(
        "--condition",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="sensors: noise, bias (1: as the vehicle file says), temperature (K above "
        "calibration), drift, filtered, delayed, synchronous (on, off), phases.MESSAGE (s), "
        "lsb.MESSAGE.SIGNAL (SI units); actuators: supply (V), oil_temperature (°C), "
        "estimate_error, estimate_lag (s); may be repeated",
    )


def run_keywords(args: argparse.Namespace) -> dict[str, object]:
    """Return the keywords of :func:`canroll.run` that the options ask for."""
    given = {
        "vehicle": args.vehicle,
        "law": args.law,
        "calibration": args.calibration,
        "actuator": args.actuator,
        "observer": args.observer,
        "plant": args.plant,
        "speed_kmh": args.speed,
        "bus": args.bus,
        "tick_ms": args.tick,
        "phase_ms": args.phase,
        "trigger": args.trigger,
        "gains": args.gains,
        "feedforward": args.feedforward,
        "identification": args.identification,
        "heartbeat_ms": args.heartbeat,
        "backend": args.backend,
        "seed": args.seed,
        "options": maneuver_options(args.set),
        "faults": getattr(args, "fault", None) or None,
        "conditions": key_values("--condition", getattr(args, "condition", [])),
    }
    return {name: value for name, value in given.items() if value is not None}


def maneuver_options(texts: list[str]) -> dict[str, str] | None:
    """Return the options of the manoeuvre from "key=value" each; None of nothing."""
    return key_values("--set", texts)


def key_values(option: str, texts: list[str]) -> dict[str, str] | None:
    """Return what ``option`` was given as "key=value" each; None of nothing.

    Raises:
        CanrollError: there is no "=" in one of them.
    """
    for text in texts:
        if "=" not in text:
            raise CanrollError(f"{option} {text}: write key=value")
    return dict(text.split("=", 1) for text in texts) or None


def run(args: argparse.Namespace) -> int:
    """Run, report and write; 1 if the verdict is that control does not help."""
    from hil.cli import terminal  # noqa: PLC0415 - loads compiled kernels
    from hil.report.run_folder import check_parent, usable_folder  # noqa: PLC0415
    from hil.runs import experiment, signal_files  # noqa: PLC0415 - loads compiled kernels
    from hil.runs.logs import check_suffix, write_log  # noqa: PLC0415
    from hil.runs.virtual_time import Interrupted  # noqa: PLC0415

    out = args.out or (None if args.json else DEFAULT_OUT)
    for path, check in ((args.log, check_suffix), (args.signals, signal_files.check_suffix)):
        if path is not None:
            check_parent(check(path), out=out)
    if out is not None:
        usable_folder(out)
    try:
        with terminal.progress(quiet=args.json) as progress:
            result = experiment.run(
                args.scenario,
                duration=args.duration,
                progress=progress,
                **run_keywords(args),  # type: ignore[arg-type]
            )
    except Interrupted as stopped:
        if args.log is not None:
            write_log(args.log, stopped.trace.frames)
        if out is not None:
            write_log(out / "bus.asc", stopped.trace.frames)
        raise
    seen = result.passive if result.controlled is None else result.controlled
    files = {}
    if args.log is not None:
        files["bus log"] = str(write_log(args.log, seen.frames))
    if args.signals is not None:
        files["signals"] = str(signal_files.write_signals(args.signals, seen.signals))
    result = experiment.with_files(result, files)
    return answer(result, out, as_json=args.json)


def answer(result: "Result", out: Path | None, *, as_json: bool) -> int:
    """Write the files of a run where there is a folder, print it, and return the exit code."""
    from hil.cli import terminal  # noqa: PLC0415 - loads compiled kernels
    from hil.report.run_folder import write_files  # noqa: PLC0415

    if out is not None:
        result = write_files(result, out)
    if as_json:
        print(json.dumps(result.to_json()))
    else:
        terminal.show(result)
    return result.exit_code
