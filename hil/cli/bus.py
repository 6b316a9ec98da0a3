"""``canroll bus``: load, worst-case and simulated response times, a server for a traffic set."""

import argparse
import json
import math
from dataclasses import replace
from pathlib import Path

from canroll.errors import CanrollError, UnknownNameError
from hil.report.bus_answer import Answer, Delay, as_json, check_simulation, show
from plant_sim.can_bus.ages import simulate_ages_of_set
from plant_sim.can_bus.analysis import (
    ErrorModel,
    ResponseBound,
    response_bounds,
)
from plant_sim.can_bus.delay_bounds import DelayBounds, delay_bounds_of_set
from plant_sim.can_bus.kernel.network import build_network
from plant_sim.can_bus.servers.socketcand import DEFAULT_PORT
from plant_sim.can_bus.servers.wall_clock import serve_network
from plant_sim.can_bus.simulation import Simulation, simulate, traffic_spec
from plant_sim.can_bus.traffic.files import Traffic, load_traffic
from plant_sim.can_bus.traffic.log_playback import Recording, load_recording
from plant_sim.can_bus.wire.frame import EXTENDED, FD

MAX_PORT = 65535
DELAY_PATH = {"sensor": "Imu", "command": "SuspensionForceCommand"}
"""Messages whose delay is shown where the set has them."""
BESIDE_RECORDING = "no bound: the periods of a recording are unknown"
"""Why there is no bound."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "bus",
        help="bus load, response times and a bus server",
        description="Compare worst-case and simulated response times of a traffic set.",
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="traffic set, .dbc or .toml")
    parser.add_argument(
        "-b", "--bitrate", type=int, metavar="B", help="bit rate, bit/s; default: that of the file"
    )
    parser.add_argument(
        "--data-bitrate",
        type=int,
        metavar="B",
        help="data bit rate of FD frames, bit/s; default: that of the file",
    )
    parser.add_argument(
        "--simulate",
        type=float,
        default=10.0,
        metavar="S",
        help="simulated time in s, 0: no simulation (default: %(default)g)",
    )
    parser.add_argument("--seed", type=int, default=0, help="of payloads and jitter (default: 0)")
    parser.add_argument(
        "--worst-case-lengths",
        action="store_true",
        help="simulate every frame with the maximum number of stuff bits",
    )
    parser.add_argument(
        "--error-interval",
        type=float,
        metavar="MS",
        help="include one disturbed frame every MS milliseconds in the bounds",
    )
    parser.add_argument(
        "--replay",
        type=Path,
        metavar="LOG",
        help="replay a bus log (.asc .blf .log …) with the set, except for identifiers of the set;"
        " bounds are then not valid",
    )
    parser.add_argument(
        "--channel", help="channel of the replayed log, as named by python-can, if it has several"
    )
    parser.add_argument(
        "--sensor", default=DELAY_PATH["sensor"], help="sensor message (default: %(default)s)"
    )
    parser.add_argument(
        "--command",
        default=DELAY_PATH["command"],
        help="command message (default: %(default)s)",
    )
    parser.add_argument(
        "--tick", type=float, default=10.0, metavar="MS", help="control tick (default: 10)"
    )
    parser.add_argument(
        "--serve",
        nargs="?",
        type=int,
        const=DEFAULT_PORT,
        metavar="PORT",
        help="run the traffic in real time, for python-can with interface=socketcand"
        f" (default port: {DEFAULT_PORT})",
    )
    parser.add_argument("--host", default="127.0.0.1", help="with --serve (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Analyse, simulate and print; or serve until interrupted."""
    _check(args)
    traffic = load_traffic(args.file, bitrate=args.bitrate, data_bitrate=args.data_bitrate)
    known = [message.name for message in traffic.messages]
    for option, default in DELAY_PATH.items():
        name = getattr(args, option)
        if name != default and name not in known:
            raise UnknownNameError(f"--{option} message", name, known)
    if args.serve is not None:
        _serve(traffic, args)
        return 0
    recording = _recording(traffic, args)
    answer = Answer(
        args.file.name,
        args.simulate,
        args.sensor,
        args.command,
        args.tick,
        None if args.replay is None else args.replay.name,
        traffic,
        _bounds(traffic, recording, args),
        _simulation(traffic, recording, args),
        _delay(traffic, recording, args),
        recording,
    )
    check_simulation(answer)
    if args.json:
        print(json.dumps(as_json(answer), indent=2))
    else:
        show(answer)
    failed = any(b.bound_ns is None and b.covered for b in answer.bounds)
    return int(failed or (answer.delay is not None and answer.delay.failed))


def _check(args: argparse.Namespace) -> None:
    for option in ("simulate", "tick", "error_interval"):
        value = getattr(args, option)
        least = 0.0 if option == "simulate" else 1e-3
        if value is not None and not (value >= least and math.isfinite(value)):
            raise CanrollError(
                f"--{option.replace('_', '-')} must be at least {least:g}, got {value:g}"
            )
    if args.serve is not None and not 0 <= args.serve <= MAX_PORT:
        raise CanrollError(f"--serve {args.serve}: the port must be 0 to {MAX_PORT}")
    if args.serve is not None and args.replay is not None:
        raise CanrollError(
            "--serve and --replay exclude each other: the served bus carries only the set"
        )
    if args.replay is not None and args.simulate <= 0.0:
        raise CanrollError("--replay needs --simulate above 0")
    if args.channel is not None and args.replay is None:
        raise CanrollError("--channel selects a channel of a log: --replay is required")


def _serve(traffic: Traffic, args: argparse.Namespace) -> None:
    spec = traffic_spec(
        traffic.messages,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        seed=args.seed,
    )
    hidden = ", ".join(m.name for m in traffic.messages if m.flags & FD)
    if hidden:
        _say(f"socketcand does not support FD frames: clients do not receive {hidden}")
    serve_network(build_network(spec), host=args.host, port=args.serve, announce=_say)


def _say(text: str) -> None:
    print(text, flush=True)


def _recording(traffic: Traffic, args: argparse.Namespace) -> Recording | None:
    if args.replay is None:
        return None
    return load_recording(
        args.replay,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        leave_out={(m.ident, bool(m.flags & EXTENDED)) for m in traffic.messages},
        channel=args.channel,
    )


def _bounds(
    traffic: Traffic, recording: Recording | None, args: argparse.Namespace
) -> list[ResponseBound]:
    bounds = response_bounds(
        traffic.messages,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        errors=_errors(args),
    )
    if recording is None:
        return bounds
    return [
        b
        if b.bound_ns is None
        else replace(b, bound_ns=None, reason=BESIDE_RECORDING, covered=False)
        for b in bounds
    ]


def _errors(args: argparse.Namespace) -> ErrorModel | None:
    interval_ms: float | None = args.error_interval
    return None if interval_ms is None else ErrorModel(round(interval_ms * 1e6))


def _simulation(
    traffic: Traffic, recording: Recording | None, args: argparse.Namespace
) -> Simulation | None:
    if args.simulate <= 0.0:
        return None
    return simulate(
        traffic.messages,
        bitrate=traffic.bitrate,
        duration_s=args.simulate,
        data_bitrate=traffic.data_bitrate,
        seed=args.seed,
        worst_case_lengths=args.worst_case_lengths,
        recording=recording,
    )


def _delay(traffic: Traffic, recording: Recording | None, args: argparse.Namespace) -> Delay | None:
    """Bounds of the total delay from sensor to command, and simulated ages; None without both."""
    path = args.sensor, args.command
    if not {*path} <= {message.name for message in traffic.messages}:
        return None
    bounds = delay_bounds_of_set(
        traffic.messages,
        *path,
        tick_ms=args.tick,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        errors=_errors(args),
    )
    reason, failed = "", False
    if isinstance(bounds, ResponseBound):
        reason, failed = f"{bounds.message.name}: {bounds.reason}", bounds.covered
    elif recording is not None:
        reason = BESIDE_RECORDING
    limits = bounds if isinstance(bounds, DelayBounds) and not reason else None
    ages = simulate_ages_of_set(
        traffic.messages,
        *path,
        tick_ms=args.tick,
        duration_s=args.simulate,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        seed=args.seed,
        worst_case_lengths=args.worst_case_lengths,
        recording=recording,
    )
    if not len(ages):
        return Delay(limits, reason, failed, math.nan, math.nan)
    return Delay(limits, reason, failed, float(ages.min()), float(ages.max()))
