"""The options of the commands that design, verify, time and export a controller."""

from pathlib import Path
from typing import Any

from canroll.cli.options import (
    DEFAULT_SCENARIO,
    JSON,
    OF_A_RUN,
    RARE_OF_A_DESIGN,
    RARE_OF_A_RUN,
    choices,
    key_value,
    path_named,
    scenario,
    service_flags,
    services,
    verbose,
)
from canroll.cli.parser import Parser, flag, opt, related, repeated
from canroll.codegen.export.prefix import DEFAULT
from canroll.codegen.run import BACKENDS

DEFAULT_DELAY_MS = 20.0
OF_A_DESIGN = (
    *("vehicle", "law", "stage", "actuator", "observer", "tick_ms", "trigger", "heartbeat_ms"),
    *("gains", "matrices", "unverified", "moment_share", "feedforward", "identification"),
    *("offset_learning", "response_watch", "uncertainty", "bus"),
)
OF_AN_EXPORT = ("calibration", *OF_A_DESIGN)
BYTE_ORDERS = ("little", "big")
PROCESSORS = tuple(name for name in BACKENDS if name.startswith("cortex"))
OF_THE_BUS: dict[str, Any] = {
    "excludes": {name: "the bus has its delay" for name in ("bus", "dbc")}
}
ON_TARGET: dict[str, Any] = {"excludes": {"hil": "--hil runs on this machine, not the target"}}
OF_THE_BOUND: dict[str, Any] = {"needs": ("bound",), **ON_TARGET}


def design(parser: Parser) -> None:
    """Design a controller and write its calibration."""
    parser.take(
        "",
        choices((*OF_A_DESIGN, "dbc", "map"), defaults={"bus": None}),
        opt("--delay", float, "MS", "delay from sample to force, instead of --bus (default: "
            f"{DEFAULT_DELAY_MS:g})", **OF_THE_BUS),
        opt("--delay-min", float, "MS", "smallest delay, if it varies", **OF_THE_BUS),
        opt("--gamma", float, "LEVEL", "H-infinity level that the theorem of hinf_delay must "
            "certify (default: the smallest)", 0.0),
        flag("--compare", "design every law for the vehicle, write nothing"),
        JSON,
        verbose("the numbers without a limit and the least faults that can be found"),
        opt("--out", path_named, "DIR", "folder for the files (default: out)"),
        related("law", excludes={"compare": "--compare designs every law"}),
        related("stage", excludes={"compare": "--compare designs laws without a stage"}),
        related("verbose", "uncertainty", excludes={"compare": "--compare prints one line a law"}),
    )  # fmt: skip


def margins(parser: Parser) -> None:
    """Verify a calibration independently of its design."""
    parser.take(
        "",
        opt("calibration", path_named, None, "calibration.toml of canroll design"),
        JSON,
        verbose("the least faults that can be found"),
        repeated("--uncertainty", key_value, "KEY=WIDTH", "half-width that the table of detectable "
                 "faults allows for instead of the calibration's, such as mass=0.05, and print the "
                 "table", default=[]),
        opt("--out", Path, "DIR", "write margins.png there"),
    )  # fmt: skip


def timing(parser: Parser) -> None:
    """Instructions, stack and sizes on the target; budget verdict."""
    parser.take(
        "",
        choices([name for name in OF_A_RUN if name != "backend"], of_file=RARE_OF_A_RUN),
        opt("--scenario", scenario, None, "manoeuvre to replay", DEFAULT_SCENARIO),
        opt("--duration", float, None, "duration in s (default: 5)", 5.0),
        opt("--processor", PROCESSORS, None, "default: %(default)s", "cortex-m4", **ON_TARGET),
        opt("--counter", ("qemu", "unicorn"), None, "instruction counter (default: qemu if "
            "installed)", **ON_TARGET),
        related("counter", excludes={"bound": "--bound reads the code, and replays it by qemu"}),
        flag("--specialise", "the firmware specialised for the calibration, as export-c "
             "--specialise writes it", **ON_TARGET),
        flag("--hil", "run in real time; verdict on tick, latency and misses"),
        flag("--bound", "worst case of a tick in cycles from the machine code, with the maximum "
             "seen", **ON_TARGET),
        opt("--ticks", int, None, "with --bound: ticks replayed (default: 4000)", 4000,
            **OF_THE_BOUND),
        opt("--clock", float, "MHZ", "with --bound: clock, for the share of a tick",
            **OF_THE_BOUND),
        opt("--wait-states", int, "N", "with --bound: of the flash", 0, **OF_THE_BOUND),
        opt("--multiplier", int, "CYCLES", "with --bound: of a multiplication on a Cortex-M0, 1 or "
            "32 (default: 1)", 1, **OF_THE_BOUND),
        opt("--division", int, "CYCLES", "with --bound: of a division on M3 and M4 at most "
            "(default: 12)", 12, **OF_THE_BOUND),
        JSON,
    )  # fmt: skip


def prove(parser: Parser) -> None:
    """Prove the loop free of overflow for every accepted calibration."""
    parser.take(
        "",
        opt("calibration", path_named, None, "calibration.toml of a design (default: every "
            "calibration the ECU accepts)", nargs="?"),
        choices(("stage",)),
        JSON,
    )  # fmt: skip


def whole_number(text: str) -> int:
    """Read an integer in any notation of Python."""
    return int(text, 0)


def export_c(parser: Parser) -> None:
    """Export the controller as C99 with test vectors."""
    parser.take(
        "",
        opt("folder", Path, None, "folder of the bundle"),
        choices(OF_AN_EXPORT, of_file=RARE_OF_A_DESIGN),
        choices(("dbc", "map")),
        opt("--elf", Path, None, "only write the addresses of this image to the A2L in DIR; with "
            "--calibration also write the calibration at its address, as Intel HEX and S-record"),
        opt("--address", whole_number, "ADDRESS", "also write the calibration for this address, as "
            "Intel HEX and S-record"),
        opt("--byte-order", BYTE_ORDERS, None, "of the target's memory, for canroll.a2l and "
            "--address (default: little; an image says its own); the C code suits both"),
        flag("--specialise", "code for this calibration alone: fewer cycles, nothing to tune"),
        opt("--prefix", str, "NAME", "of all public symbols, macros and files, for several bundles "
            "in one image (default: %(default)s)", DEFAULT,
            excludes={"elf": "the bundle has its own"}),
        *service_flags(services(exported=True)),
        related("elf", "address", *services(exported=True),
                excludes={"specialise": "--specialise has the calibration compiled in"}),
        related("address", "byte_order", excludes={"elf": "the image says its own"}),
    )  # fmt: skip
