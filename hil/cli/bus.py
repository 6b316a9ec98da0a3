"""``canroll bus``: load, worst-case and simulated response times, a server for a traffic set."""

import argparse
import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from canroll.errors import CanrollError, UnknownNameError, VerdictError
from plant_sim.can_bus.ages import simulate_ages_of_set
from plant_sim.can_bus.analysis import (
    ErrorModel,
    ResponseBound,
    response_bounds,
    worst_case_utilisation,
)
from plant_sim.can_bus.delay_bounds import DelayBounds, delay_bounds_of_set
from plant_sim.can_bus.kernel.network import build_network
from plant_sim.can_bus.servers.socketcand import DEFAULT_PORT
from plant_sim.can_bus.servers.wall_clock import serve_network
from plant_sim.can_bus.simulation import Simulation, simulate, traffic_spec
from plant_sim.can_bus.traffic.files import Traffic, load_traffic
from plant_sim.can_bus.traffic.log_playback import Recording, load_recording
from plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD

_MS = 1e-6
MAX_PORT = 65535
DELAY_PATH = {"sensor": "Imu", "command": "SuspensionForceCommand"}
"""Messages whose delay is shown where the set has them."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "bus",
        help="bus load, response times and a bus server",
        description="Worst-case response times of a traffic set beside simulated ones.",
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="traffic set, .dbc or .toml")
    parser.add_argument("-b", "--bitrate", type=int, metavar="B", help="bit/s; default: the file's")
    parser.add_argument(
        "--data-bitrate",
        type=int,
        metavar="B",
        help="of FD frames with bit-rate switch, bit/s; default: the file's",
    )
    parser.add_argument(
        "--simulate",
        type=float,
        default=10.0,
        metavar="S",
        help="simulated seconds, 0: none (default: %(default)g)",
    )
    parser.add_argument("--seed", type=int, default=0, help="of payloads and jitter (default: 0)")
    parser.add_argument(
        "--worst-case-lengths",
        action="store_true",
        help="simulate every frame with the most stuff bits it can have",
    )
    parser.add_argument(
        "--error-interval",
        type=float,
        metavar="MS",
        help="the bounds allow for one disturbed frame in every MS milliseconds",
    )
    parser.add_argument(
        "--replay",
        type=Path,
        metavar="LOG",
        help="replay a bus log (.asc .blf .log …) beside the set, identifiers of the set left out;"
        " no bound holds then",
    )
    parser.add_argument(
        "--channel", help="of the log to replay, as python-can names it, where it has several"
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
        help="run the traffic in real time and let python-can connect with interface=socketcand"
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
    answer = _Answer(
        args,
        traffic,
        _bounds(traffic, recording, args),
        _simulation(traffic, recording, args),
        _delay(traffic, recording, args),
        recording,
    )
    _check_simulation(answer)
    if args.json:
        print(json.dumps(_as_json(answer), indent=2))
    else:
        _print(answer)
    return int(any(b.bound_ns is None and b.covered for b in answer.bounds))


def _check(args: argparse.Namespace) -> None:
    for option in ("simulate", "tick", "error_interval"):
        value = getattr(args, option)
        least = 0.0 if option == "simulate" else 1e-3
        if value is not None and not (value >= least and math.isfinite(value)):
            raise CanrollError(f"--{option.replace('_', '-')} {value:g}: at least {least:g}")
    if args.serve is not None and not 0 <= args.serve <= MAX_PORT:
        raise CanrollError(f"--serve {args.serve}: a port is 0 to {MAX_PORT}")
    if args.serve is not None and args.replay is not None:
        raise CanrollError("--serve takes no --replay: the served bus carries the set alone")
    if args.replay is not None and args.simulate <= 0.0:
        raise CanrollError("--replay needs --simulate above 0")
    if args.channel is not None and args.replay is None:
        raise CanrollError("--channel is one of a log: give --replay as well")


@dataclass(frozen=True, slots=True)
class _Delay:
    """Bounds of the total delay, None where there is none, and the simulated extreme ages, ns."""

    bounds: DelayBounds | None
    least: float
    greatest: float


@dataclass(frozen=True, slots=True)
class _Answer:
    """All that is printed."""

    args: argparse.Namespace
    traffic: Traffic
    bounds: list[ResponseBound]
    simulation: Simulation | None
    delay: _Delay | None
    recording: Recording | None


def _serve(traffic: Traffic, args: argparse.Namespace) -> None:
    spec = traffic_spec(
        traffic.messages,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        seed=args.seed,
    )
    hidden = ", ".join(m.name for m in traffic.messages if m.flags & FD)
    if hidden:
        _say(f"socketcand has no FD frames: on the bus, but not seen by clients: {hidden}")
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
    reason = "beside a recording, whose periods nobody knows"
    return [
        b if b.bound_ns is None else replace(b, bound_ns=None, reason=reason, covered=False)
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


def _delay(
    traffic: Traffic, recording: Recording | None, args: argparse.Namespace
) -> _Delay | None:
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
    if recording is not None:
        bounds = None
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
        return _Delay(bounds, math.nan, math.nan)
    return _Delay(bounds, float(ages.min()), float(ages.max()))


def _check_simulation(answer: _Answer) -> None:
    """Refuse to print a bound that the simulation beside it exceeds."""
    for bound in answer.bounds:
        _, _, seen = _extremes(answer.simulation, bound.message.name)
        if bound.bound_ns is not None and seen > bound.bound_ns:
            raise VerdictError(
                f"{bound.message.name}: simulated response {seen * _MS:.3f} ms above its bound"
                f" {bound.bound_ns * _MS:.3f} ms"
            )
    if answer.delay is None or answer.delay.bounds is None:
        return
    # simulated times are whole ns, the bound is a float of seconds: equal ones may differ there
    most, limit = answer.delay.greatest, answer.delay.bounds.age_max
    if most > round(limit * 1e9):
        raise VerdictError(
            f"simulated age {most * _MS:.3f} ms above its bound {limit * 1e3:.3f} ms"
        )


def _milliseconds(value: float | None) -> float | None:
    return None if value is None or math.isnan(value) else round(value * _MS, 6)


def _extremes(simulation: Simulation | None, name: str) -> tuple[float, float, float]:
    """Least, mean and greatest simulated response, ns; not a number where there is none."""
    if simulation is None or not len(simulation.responses[name].responses):
        return math.nan, math.nan, math.nan
    seen = simulation.responses[name].responses
    return float(seen.min()), float(seen.mean()), float(seen.max())


def _as_json(answer: _Answer) -> dict[str, Any]:
    traffic, simulation, recording = answer.traffic, answer.simulation, answer.recording
    messages = {}
    for bound in answer.bounds:
        name = bound.message.name
        least, mean, greatest = _extremes(simulation, name)
        messages[name] = {
            "response_bound_ms": _milliseconds(bound.bound_ns),
            "response_min_ms": _milliseconds(least),
            "response_mean_ms": _milliseconds(mean),
            "response_max_ms": _milliseconds(greatest),
        }
    result: dict[str, Any] = {
        "utilisation": _utilisation(traffic),
        "messages": messages,
        "recording": None,
    }
    if simulation:
        result["simulated_load"] = simulation.load
    if recording:
        result["recording"] = {
            "frames": len(recording.frames.t_ns),
            "duration_s": recording.duration_s,
            "channel": recording.channel,
        }
    if answer.delay:
        total = answer.delay.bounds
        result["delay"] = {
            "tau_min_ms": total and total.tau_min * 1e3,
            "tau_max_ms": total and total.tau_max * 1e3,
            "age_bound_ms": total and total.age_max * 1e3,
            "age_min_ms": _milliseconds(answer.delay.least),
            "age_max_ms": _milliseconds(answer.delay.greatest),
        }
    return result


def _utilisation(traffic: Traffic) -> float:
    return worst_case_utilisation(
        traffic.messages, bitrate=traffic.bitrate, data_bitrate=traffic.data_bitrate
    )


def _print(answer: _Answer) -> None:
    console = Console()
    console.print(_table(answer))
    traffic, simulation, bounds = answer.traffic, answer.simulation, answer.bounds
    for reason in dict.fromkeys(b.reason for b in bounds if b.bound_ns is None):
        names = ", ".join(b.message.name for b in bounds if b.reason == reason)
        console.print(f"without a bound, {reason}: {names}")
    line = f"load with the longest frames {_utilisation(traffic):.1%}"
    if simulation:
        line += f", simulated {simulation.load:.1%} ({simulation.frames} frames)"
    console.print(line)
    if traffic.left_out:
        console.print(f"without a cycle time, left out: {', '.join(traffic.left_out)}")
    if not traffic.data_bitrate and any(m.flags & BIT_RATE_SWITCH for m in traffic.messages):
        console.print(
            "no data bit rate in the set: the data of FD frames at the nominal one"
            " (--data-bitrate B)"
        )
    recording, duration = answer.recording, answer.args.simulate
    if recording and recording.duration_s < duration:
        console.print(
            f"{answer.args.replay.name} ends after {recording.duration_s:g} s of {duration:g} s"
        )
    if answer.delay:
        console.print(_delay_line(answer.delay, answer.args))


def _table(answer: _Answer) -> Table:
    traffic = answer.traffic
    rate = f"{traffic.bitrate / 1000:g}"
    if traffic.data_bitrate:
        rate += f" and {traffic.data_bitrate / 1000:g}"
    title = f"{answer.args.file.name} at {rate} kbit/s: response times, ms"
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in ("message", "id", "period", "bound", "min", "mean", "99 %", "max"):
        table.add_column(heading, justify="left" if heading == "message" else "right")
    for bound in sorted(answer.bounds, key=lambda b: b.message.ident):
        message = bound.message
        limit = "none" if bound.bound_ns is None else f"{bound.bound_ns * _MS:.3f}"
        cells = ["–"] * 4
        if answer.simulation and len(answer.simulation.responses[message.name].responses):
            least, mean, greatest = _extremes(answer.simulation, message.name)
            most = answer.simulation.responses[message.name].quantile(0.99)
            cells = [f"{value * _MS:.3f}" for value in (least, mean, most, greatest)]
        period = f"{message.period_ns * _MS:g}"
        table.add_row(message.name, f"{message.ident:X}", period, limit, *cells)
    return table


def _delay_line(delay: _Delay, args: argparse.Namespace) -> str:
    line = f"{args.sensor} to {args.command} at a tick of {args.tick:g} ms: "
    if delay.bounds is None:
        line += "no bound of the delay, sample-to-force age"
    else:
        total = delay.bounds
        line += (
            f"total delay {total.tau_min * 1e3:.2f} to {total.tau_max * 1e3:.2f} ms,"
            f" sample-to-force age at most {total.age_max * 1e3:.2f} ms"
        )
    if math.isnan(delay.least):
        return line if delay.bounds else f"{line} not simulated"
    separator = "," if delay.bounds else ""
    return f"{line}{separator} simulated {delay.least * _MS:.2f} to {delay.greatest * _MS:.2f}"
