"""``canroll watch``: what the roll controller does, told by its bus alone."""

import argparse
import json
import sys
import time
from collections.abc import Mapping
from typing import Any

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from hil.cli.ecu import nanoseconds
from hil.realtime import process
from hil.realtime.bus_link import CanLink, add_bus_arguments, open_link
from hil.realtime.observation import Observation

DEFAULT_BITRATE = 500_000
REFRESH = 0.1
MODE_STYLES = {"INIT": "yellow", "ACTIVE": "green", "DEGRADED": "yellow", "SAFE": "red"}


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "watch",
        help="watch the roll controller from the bus",
        description="Show mode, roll, moments, trigger rate, bus load and trouble codes.",
    )
    add_bus_arguments(parser)
    parser.add_argument("--duration", type=float, metavar="S", help="default: until Ctrl-C")
    parser.add_argument(
        "--json", action="store_true", help="show nothing, print one JSON object at the end"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Watch until stopped; 0 where the controller was seen, 1 where the bus was silent."""
    duration = nanoseconds(args.duration, "--duration")
    link = open_link(args)
    seen = Observation(getattr(args, "bitrate", DEFAULT_BITRATE))
    until = float("inf") if duration is None else time.monotonic() + duration * 1e-9
    show = sys.stdout.isatty() and not args.json
    try:
        with process.stop_on_signals() as stop, Live(auto_refresh=False, screen=show) as live:
            while not stop.requested and time.monotonic() < until:
                time.sleep(REFRESH)
                look(link, seen)
                if show:
                    live.update(view(seen.summary(), seen), refresh=True)
    finally:
        link.close()
    if args.json:
        print(json.dumps(seen.summary()))
    else:
        Console().print(view(seen.summary(), seen))
    return 0 if seen.frames else 1


def look(link: CanLink, seen: Observation) -> None:
    """Take in everything that waits on the bus."""
    now = time.monotonic()
    for frame in link.receive():
        seen.see(now, frame)
    seen.pass_time(now)


def view(summary: Mapping[str, Any], seen: Observation) -> Group:
    """Return what the terminal shows of an observation."""
    mode = summary["mode"] or "no controller"
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_row("mode", Text(mode, style=MODE_STYLES.get(mode, "dim")))
    front, rear = summary["moment_delivered_nm"]
    trigger = summary["commands_per_sample"]
    for name, value, form in (
        ("roll angle, estimated", summary["roll_estimate_deg"], "{:+.2f}°"),
        ("roll rate", summary["roll_rate_deg_s"], "{:+.2f} °/s"),
        ("lateral acceleration", summary["lateral_acceleration_m_s2"], "{:+.2f} m/s²"),
        ("speed", summary["speed_km_h"], "{:.1f} km/h"),
        ("moment asked for", summary["moment_command_nm"], "{:+.0f} N·m"),
        ("moment delivered, front", front, "{:+.0f} N·m"),
        ("moment delivered, rear", rear, "{:+.0f} N·m"),
        ("commands a sample", trigger, "{:.2f}"),
        ("bus load", summary["load"], "{:.1%}"),
    ):
        table.add_row(name, "–" if value is None else _form(form, value))
    table.add_row("troubles", ", ".join(summary["troubles"]) or "none")
    table.add_row("have occurred", ", ".join(summary["latched_troubles"]) or "none")
    rates = Table("message", "frames", "a second", box=None, pad_edge=False, header_style="bold")
    for name, count in summary["frames"].items():
        rates.add_row(name, str(count), f"{seen.rate(name):.0f}")
    return Group(table, Text(), rates)


def _form(form: str, value: Any) -> str:  # noqa: ANN401
    return value if isinstance(value, str) else form.format(value)
