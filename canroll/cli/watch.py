"""``canroll watch``: the state of the roll controller, from its bus frames only."""

import argparse
import sys
import time
from collections.abc import Mapping
from typing import Any

from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from canroll.cli import terminal
from canroll.cli.ecu import nanoseconds
from canroll.hil import process
from canroll.hil.bus_link import open_link
from canroll.hil.watch.observation import Observation
from canroll.hil.watch.onlooker import Onlooker

DEFAULT_BITRATE = 500_000
REFRESH = 0.1
MODE_STYLES = {"INIT": "yellow", "ACTIVE": "green", "DEGRADED": "yellow", "SAFE": "red"}


def run(args: argparse.Namespace) -> int:
    """Watch until stopped; 0 if frames were seen, 1 if the bus was silent."""
    duration = nanoseconds(args.duration, "--duration")
    seen = Observation(getattr(args, "bitrate", DEFAULT_BITRATE))
    until = float("inf") if duration is None else time.monotonic() + duration * 1e-9
    watch_in_terminal(args, seen, until)
    summary = seen.summary()
    return terminal.emit(args, summary, [view(summary, seen)], good=bool(seen.frames))


def watch_in_terminal(args: argparse.Namespace, seen: Observation, until: float) -> None:
    """Fill ``seen``, and show it on a terminal, until the monotonic clock reaches ``until``."""
    link = open_link(args)
    onlooker = Onlooker(link, seen)
    show = sys.stdout.isatty() and not args.json
    try:
        with process.stop_on_signals() as stop, Live(auto_refresh=False, screen=show) as live:
            while not stop.requested and time.monotonic() < until:
                time.sleep(REFRESH)
                onlooker.look()
                if show:
                    live.update(view(seen.summary(), seen), refresh=True)
    finally:
        link.close()


def view(summary: Mapping[str, Any], seen: Observation) -> Group:
    """Return the terminal view of an observation."""
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
        ("moment commanded", summary["moment_command_nm"], "{:+.0f} N·m"),
        ("moment delivered, front", front, "{:+.0f} N·m"),
        ("moment delivered, rear", rear, "{:+.0f} N·m"),
        ("commands per sample", trigger, "{:.2f}"),
        ("bus load", summary["load"], "{:.1%}"),
    ):
        table.add_row(name, "–" if value is None else _form(form, value))
    table.add_row("fault codes", ", ".join(summary["fault_codes"]) or "none")
    table.add_row("have occurred", ", ".join(summary["latched_fault_codes"]) or "none")
    rates = Table("message", "frames", "a second", box=None, pad_edge=False, header_style="bold")
    for name, count in summary["frames"].items():
        rates.add_row(name, str(count), f"{seen.rate(name):.0f}")
    return Group(table, Text(), rates)


def _form(form: str, value: Any) -> str:  # noqa: ANN401
    return value if isinstance(value, str) else form.format(value)
