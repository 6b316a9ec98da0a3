"""``canroll bus``: load, worst-case and simulated response times, a server for a traffic set."""

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from canroll.errors import CanrollError, UnknownNameError, VerdictError
from plant_sim.can_bus.analysis import (
    ErrorModel,
    ResponseBound,
    response_bounds,
    worst_case_utilisation,
)
from plant_sim.can_bus.delay_bounds import DelayBounds, total_delay
from plant_sim.can_bus.delay_bounds import Path as DelayPath
from plant_sim.can_bus.kernel.network import build_network
from plant_sim.can_bus.servers.socketcand import DEFAULT_PORT
from plant_sim.can_bus.servers.wall_clock import serve_network
from plant_sim.can_bus.simulation import Loop, Simulation, simulate, simulate_ages, traffic_spec
from plant_sim.can_bus.traffic.files import Traffic, load_traffic
from plant_sim.can_bus.traffic.log_playback import Recording, load_recording

_MS = 1e-6
_PHASES = 20
MAX_PORT = 65535
MAX_BITRATE, MAX_DATA_BITRATE = 1_000_000, 8_000_000
"""Of classic frames and arbitration (ISO 11898-1), and of the data of FD, bit/s."""
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
        help="replay a bus log (.asc .blf .log …) beside the set, identifiers of the set left out",
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
    for option in ("simulate", "tick", "error_interval"):
        value = getattr(args, option)
        least = 0.0 if option == "simulate" else 1e-3
        if value is not None and not (value >= least and math.isfinite(value)):
            raise CanrollError(f"--{option.replace('_', '-')} {value:g}: at least {least:g}")
    if args.serve is not None and not 0 <= args.serve <= MAX_PORT:
        raise CanrollError(f"--serve {args.serve}: a port is 0 to {MAX_PORT}")
    if args.bitrate is not None and args.bitrate > MAX_BITRATE:
        raise CanrollError(f"--bitrate {args.bitrate}: at most {MAX_BITRATE} bit/s")
    traffic = load_traffic(args.file, bitrate=args.bitrate)
    if traffic.bitrate > MAX_BITRATE or traffic.data_bitrate > MAX_DATA_BITRATE:
        raise CanrollError(
            f"{args.file}: at most {MAX_BITRATE} bit/s, and {MAX_DATA_BITRATE} for the data of FD"
        )
    known = [message.name for message in traffic.messages]
    for option, default in DELAY_PATH.items():
        name = getattr(args, option)
        if name != default and name not in known:
            raise UnknownNameError(f"--{option} message", name, known)
    if args.serve is not None:
        network = build_network(
            traffic_spec(
                traffic.messages,
                bitrate=traffic.bitrate,
                data_bitrate=traffic.data_bitrate,
                seed=args.seed,
            )
        )
        serve_network(network, host=args.host, port=args.serve, announce=_say)
        return 0
    errors = None if args.error_interval is None else ErrorModel(round(args.error_interval * 1e6))
    bounds = response_bounds(
        traffic.messages,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        errors=errors,
    )
    simulation = None
    if args.simulate > 0.0:
        simulation = simulate(
            traffic.messages,
            bitrate=traffic.bitrate,
            duration_s=args.simulate,
            data_bitrate=traffic.data_bitrate,
            seed=args.seed,
            worst_case_lengths=args.worst_case_lengths,
            recording=_recording(traffic, args.replay),
        )
    delay = _delay(traffic, bounds, args)
    if args.json:
        print(json.dumps(_as_json(traffic, bounds, simulation, delay), indent=2))
    else:
        _print(traffic, bounds, simulation, delay, args)
    return 0


def _say(text: str) -> None:
    print(text, flush=True)


def _recording(traffic: Traffic, path: Path | None) -> Recording | None:
    if path is None:
        return None
    return load_recording(
        path,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        leave_out={m.ident for m in traffic.messages},
    )


def _delay(
    traffic: Traffic, bounds: list[ResponseBound], args: argparse.Namespace
) -> tuple[DelayBounds, tuple[float, float]] | None:
    """Bounds of the total delay over the sensor and command, and the simulated extreme ages."""
    found = {b.message.name: b for b in bounds}
    if args.sensor not in found or args.command not in found:
        return None
    sensor, command = found[args.sensor], found[args.command]
    if sensor.bound_ns is None or command.bound_ns is None:
        return None
    total = total_delay(
        DelayPath(sensor.best_ns * 1e-9, sensor.bound_ns * 1e-9),
        DelayPath(command.best_ns * 1e-9, command.bound_ns * 1e-9),
        sensor_period_s=sensor.message.period_ns * 1e-9,
        tick_s=args.tick * 1e-3,
    )
    others = [m for m in traffic.messages if m.name not in {args.sensor, args.command}]
    if args.simulate <= 0.0 or not others:
        return total, (math.nan, math.nan)
    spec = traffic_spec(others, bitrate=traffic.bitrate, seed=args.seed)
    ecu = len(spec.nodes) - 1
    duration = round(args.simulate * 1e9 / _PHASES)
    tick = round(args.tick * 1e6)
    parts = [
        simulate_ages(
            build_network(spec),
            Loop(
                sensor_node=0,
                sensor_ident=sensor.message.ident,
                command_node=ecu,
                command_ident=command.message.ident,
                actuator_node=0,
                sensor_ns=int(sensor.message.period_ns),
                tick_ns=tick,
                tick_offset_ns=tick * phase // _PHASES,
            ),
            duration_ns=duration,
        )
        for phase in range(_PHASES)
    ]
    ages = np.concatenate(parts)
    if not len(ages):
        return total, (math.nan, math.nan)
    # simulated times are whole ns, the bound is a float of seconds: equal ones may differ there
    if ages.max() > round(total.age_max * 1e9):
        raise VerdictError(
            f"simulated age {ages.max() * _MS:.3f} ms above its bound {total.age_max * 1e3:.3f} ms"
        )
    return total, (float(ages.min()), float(ages.max()))


def _milliseconds(value: float | None) -> float | None:
    return None if value is None or math.isnan(value) else round(value * _MS, 6)


def _extremes(simulation: Simulation | None, name: str) -> tuple[float, float, float]:
    """Least, mean and greatest simulated response, ns; not a number where there is none."""
    if simulation is None or not len(simulation.responses[name].responses):
        return math.nan, math.nan, math.nan
    seen = simulation.responses[name].responses
    return float(seen.min()), float(seen.mean()), float(seen.max())


def _as_json(
    traffic: Traffic,
    bounds: list[ResponseBound],
    simulation: Simulation | None,
    delay: tuple[DelayBounds, tuple[float, float]] | None,
) -> dict[str, Any]:
    messages = {}
    for bound in bounds:
        name = bound.message.name
        least, mean, greatest = _extremes(simulation, name)
        messages[name] = {
            "response_bound_ms": _milliseconds(bound.bound_ns),
            "response_min_ms": _milliseconds(least),
            "response_mean_ms": _milliseconds(mean),
            "response_max_ms": _milliseconds(greatest),
        }
    result: dict[str, Any] = {
        "utilisation": worst_case_utilisation(
            traffic.messages, bitrate=traffic.bitrate, data_bitrate=traffic.data_bitrate
        ),
        "messages": messages,
    }
    if simulation:
        result["simulated_load"] = simulation.load
    if delay:
        total, (least, greatest) = delay
        result["delay"] = {
            "tau_min_ms": total.tau_min * 1e3,
            "tau_max_ms": total.tau_max * 1e3,
            "age_bound_ms": total.age_max * 1e3,
            "age_min_ms": _milliseconds(least),
            "age_max_ms": _milliseconds(greatest),
        }
    return result


def _print(
    traffic: Traffic,
    bounds: list[ResponseBound],
    simulation: Simulation | None,
    delay: tuple[DelayBounds, tuple[float, float]] | None,
    args: argparse.Namespace,
) -> None:
    console = Console()
    title = f"{args.file.name} at {traffic.bitrate / 1000:g} kbit/s: response times, ms"
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in ("message", "id", "period", "bound", "min", "mean", "99 %", "max"):
        table.add_column(heading, justify="left" if heading == "message" else "right")
    for bound in sorted(bounds, key=lambda b: b.message.ident):
        message = bound.message
        limit = "none" if bound.bound_ns is None else f"{bound.bound_ns * _MS:.3f}"
        cells = ["–"] * 4
        if simulation and len(simulation.responses[message.name].responses):
            least, mean, greatest = _extremes(simulation, message.name)
            values = (least, mean, simulation.responses[message.name].quantile(0.99), greatest)
            cells = [f"{value * _MS:.3f}" for value in values]
        period = f"{message.period_ns * _MS:g}"
        table.add_row(message.name, f"{message.ident:X}", period, limit, *cells)
    console.print(table)
    for reason in dict.fromkeys(b.reason for b in bounds if b.bound_ns is None):
        names = ", ".join(b.message.name for b in bounds if b.reason == reason)
        console.print(f"without a bound, {reason}: {names}")
    used = worst_case_utilisation(
        traffic.messages, bitrate=traffic.bitrate, data_bitrate=traffic.data_bitrate
    )
    line = f"load with the longest frames {used:.1%}"
    if simulation:
        line += f", simulated {simulation.load:.1%} ({simulation.frames} frames)"
    console.print(line)
    if traffic.left_out:
        console.print(f"without a cycle time, left out: {', '.join(traffic.left_out)}")
    if delay:
        total, (least, greatest) = delay
        console.print(
            f"{args.sensor} to {args.command} at a tick of {args.tick:g} ms: total delay"
            f" {total.tau_min * 1e3:.2f} to {total.tau_max * 1e3:.2f} ms,"
            f" sample-to-force age at most {total.age_max * 1e3:.2f} ms"
            + (
                ""
                if math.isnan(least)
                else f", simulated {least * _MS:.2f} to {greatest * _MS:.2f}"
            )
        )
