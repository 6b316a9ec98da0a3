"""What a bundle's code needs on a Cortex-M4: memory, and proved bounds of stack and cycles."""

import importlib.util
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Mapping

from canroll.codegen.run import cortex, memory_image
from canroll.codegen.run.bus_firmware import AUTHENTICATION, BusFirmware
from canroll.codegen.run.service import SERVICES
from canroll.codegen.worst_case.footprint import footprint
from canroll.errors import CanrollError
from canroll.firmware.calibration import Calibration

PROCESSOR = "cortex-m4"
GCC = "arm-none-eabi-gcc"
UNKNOWN = """\
Not computed when this bundle was written: {missing}.
`canroll export-c` puts code size, stack and a proved bound of the cycles here; `canroll timing`
measures them, and `canroll timing --bound` has the bound for other processors and memories."""
SIZES = """\
For a Cortex-M4 by {compiler} with -O2. Stack and cycles were not computed when this bundle was
written: {missing}. `canroll timing --bound` has them, for other processors and memories too."""
KNOWN = """\
For a Cortex-M4 by {compiler} with the flags of `Makefile`; the cycles from flash without wait
states and without interrupts, for any state and any frames. `canroll timing --bound` has other
processors and memories, and compares the bound with the maximum seen."""
SECURED = "A tick verifies at most one of each frame received, and protects those sent."
SERVED = "Code and records are with the services, stack and cycles those of the loop alone."
TICK, RECEIVE = "cycles of `canroll_tick`, bound", "cycles of `canroll_receive`, bound"
AUTHENTICATED = {"secoc": "security.secoc_state.Secoc"}
"""The record of a bus with authenticated frames."""


def missing() -> str:
    """Return what lacks for the figures, by its package; "" where nothing does."""
    if not shutil.which(GCC):
        return f"{GCC} is not installed (package gcc-arm-none-eabi)"
    if not importlib.util.find_spec("capstone"):
        return "capstone is not installed (pip install 'canroll[target]')"
    return ""


def table(record: Calibration, loop: BusFirmware, served: BusFirmware) -> str:
    """Return the figures as Markdown, or what lacks for them.

    Args:
        record: the calibration, which the bound is for.
        loop: the firmware of the bundle.
        served: the same with its services, for their records.
    """
    lacking = missing()
    if lacking and not cortex.has_pip_tools():
        return UNKNOWN.format(missing=lacking)
    if lacking:
        image = cortex.zig_image(PROCESSOR, served)
        compiler, known = _version(sys.executable, "-m", "ziglang", "cc"), SIZES
    else:
        flags = cortex.optimisation_of(served)
        image = cortex.gcc_image(PROCESSOR, served.files, served.services, optimisation=flags)
        compiler, known = _version(GCC), KNOWN
    size = footprint(image, loop.record)
    rows: dict[str, object] = {
        "code, bytes of flash": size.text,
        "constant tables, bytes of flash": size.tables,
        "`calibration`, bytes of flash": size.calibration,
        "`ecu`, bytes of RAM": size.state,
        **_records(served),
        **({} if lacking else _bound(record, loop)),
    }
    sentences = [
        known.format(compiler=compiler, missing=lacking),
        SECURED if loop.bus.secured and not lacking else "",
        SERVED if len(served.services) > len(loop.services) and not lacking else "",
    ]
    lines = ["| | |", "| --- | --- |", *(f"| {name} | {value} |" for name, value in rows.items())]
    return "\n".join([*lines, "", textwrap.fill(" ".join(" ".join(sentences).split()), 100)])


def _records(served: BusFirmware) -> Mapping[str, object]:
    records: dict[str, str] = {}
    for name in served.services:
        records |= AUTHENTICATED if name == AUTHENTICATION else SERVICES[name].records
    sizes = ((name, place.rpartition(".")) for name, place in records.items())
    return {
        f"`{name}`, bytes of RAM": memory_image.dtype(getattr(served.module(module), kind)).itemsize
        for name, (module, _, kind) in sizes
    }


def _bound(record: Calibration, loop: BusFirmware) -> Mapping[str, str]:
    """The bounds, or why there are none, kept on disk: finding them takes seconds."""
    received = sum(1 for box in loop.bus.received if box.name) if loop.bus.secured else 0
    of = f"{memory_image.image(record).hex()} with {received} frames"
    what = f"bound on {PROCESSOR} by {_version(GCC)} of {of}"
    try:
        bound = loop.kept(what, lambda: _made(record, loop, received))
        return bound | _period(record, loop, bound)
    except CanrollError as error:
        return {"stack and cycles": f"no bound was found: {error}"}


def _period(record: Calibration, loop: BusFirmware, bound: Mapping[str, str]) -> dict[str, str]:
    """What receive interrupts and tick take of a period; jitter may bring one more of a frame."""
    period_ms, boxes = record.tick_us / 1000, [box for box in loop.bus.received if box.name]
    frames = sum(1 + int(period_ms // box.cycle_ms) if box.cycle_ms else 1 for box in boxes)
    cycles = int(bound[TICK]) + frames * int(bound[RECEIVE])
    return {
        "receive interrupts in a period, most": str(frames),
        "cycles of these and the tick, bound": str(cycles),
        "clock at which they take half a period, MHz": f"{2 * cycles / record.tick_us:.2f}",
    }


def _made(record: Calibration, loop: BusFirmware, received: int) -> dict[str, str]:
    from canroll.codegen.worst_case.cycles import Timing  # noqa: PLC0415 - needs the extra
    from canroll.codegen.worst_case.firmware_bound import firmware_bound  # noqa: PLC0415

    bound = firmware_bound(record, Timing(PROCESSOR), loop, received=received)
    return {
        "stack of `canroll_tick`, bytes, bound": str(bound.tick.stack),
        "stack of `canroll_receive`, bytes, bound": str(bound.receive.stack),
        TICK: str(bound.tick.cycles),
        RECEIVE: str(bound.receive.cycles),
    }


def _version(*compiler: str) -> str:
    """The first line that a compiler says of itself."""
    version = subprocess.run([*compiler, "--version"], capture_output=True, text=True, check=False)
    return version.stdout.splitlines()[0] if version.stdout else compiler[0]
