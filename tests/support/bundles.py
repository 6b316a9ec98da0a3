"""Exported bundles: what they are made of, their own build, and their comparison with cantools."""

import subprocess
import sys
from pathlib import Path
from typing import Any

from canroll.codegen.export import bundle
from canroll.codegen.export.header import gains_header
from canroll.codegen.generated import bus_map, signals
from canroll.codegen.run import ecu_traffic
from canroll.firmware.calibration import Calibration


def export(record: Calibration | None = None, **options: Any) -> bundle.Export:
    """A random calibration on the built-in frames, with random vectors, or what options say."""
    record = record or ecu_traffic.random_calibration(3)
    made: dict[str, Any] = {
        "dbc": signals.DBC,
        "map_file": signals.MAP,
        "title": "A sample.",
    } | options
    if "traffic" not in made:
        bus = bus_map.load(made["dbc"], made["map_file"])
        made["traffic"] = ecu_traffic.random_traffic(2, 60, bus=bus)
    gains = gains_header(record, title=["sample"])
    return bundle.Export(record=record, gains=gains, origin="Random vectors.", **made)


def make(folder: Path, *goals: str) -> "subprocess.CompletedProcess[str]":
    """Run ``make`` in the folder of a bundle; goals may be variables as well."""
    return _run(["make", "-C", str(folder), *goals])


def compared(folder: Path, frames: int) -> "subprocess.CompletedProcess[str]":
    """Build the comparison of a bundle's codec with cantools, and run it on random frames."""
    built = make(folder, "build/codec", "CFLAGS=-std=c99 -O1 -Wall -Wextra -Wpedantic -Werror")
    assert built.returncode == 0, built.stdout + built.stderr
    return _run([sys.executable, str(folder / "test" / "test_codec.py"), "--frames", str(frames)])


def _run(command: list[str]) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(command, capture_output=True, text=True, timeout=1800, check=False)
