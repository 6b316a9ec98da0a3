"""What a bundle's code needs on a Cortex-M4: memory, and proved bounds of stack and cycles."""

import importlib.util
import shutil
import subprocess
import textwrap
from collections.abc import Mapping

from canroll.errors import CanrollError
from codegen.run import cortex, memory_image
from codegen.run.bus_firmware import BusFirmware
from codegen.run.footprint import footprint
from firmware.calibration import Calibration

PROCESSOR = "cortex-m4"
GCC = "arm-none-eabi-gcc"
UNKNOWN = """\
Not computed when this bundle was written: {missing}.
`canroll export-c` puts code size, stack and a proved bound of the cycles here; `canroll timing`
measures them, and `canroll timing --bound` has the bound for other processors and memories."""
KNOWN = """\
For a Cortex-M4 by {compiler} with the flags of `Makefile`; the cycles from flash without wait
states and without interrupts, for any state and any frames. `canroll timing --bound` has other
processors and memories, and compares the bound with the maximum seen."""
SECURED = "A tick verifies at most one of each frame received, and protects those sent."
SERVED = "Code and records are with the services, stack and cycles those of the loop alone."
RECORDS = {"xcp": "services.xcp_state.Xcp", "uds": "services.uds_state.Uds"}
RECORDS |= {"nvm": "services.nvm_state.Nvm", "secoc": "security.secoc_state.Secoc"}
"""The records of the modules beside the loop."""


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
    if lacking:
        return UNKNOWN.format(missing=lacking)
    size = footprint(cortex.gcc_image(PROCESSOR, served.files, served.services), loop.record)
    rows: dict[str, object] = {
        "code, bytes of flash": size.text,
        "constant tables, bytes of flash": size.tables,
        "`calibration`, bytes of flash": size.calibration,
        "`ecu`, bytes of RAM": size.state,
        **_records(served),
        **_bound(record, loop),
    }
    sentences = [
        KNOWN.format(compiler=_compiler()),
        SECURED if loop.bus.secured else "",
        SERVED if len(served.services) > len(loop.services) else "",
    ]
    lines = ["| | |", "| --- | --- |", *(f"| {name} | {value} |" for name, value in rows.items())]
    return "\n".join([*lines, "", textwrap.fill(" ".join(" ".join(sentences).split()), 100)])


def _records(served: BusFirmware) -> Mapping[str, object]:
    sizes: dict[str, object] = {}
    for service in served.services:
        if service in RECORDS:
            module, _, name = RECORDS[service].rpartition(".")
            kind = getattr(served.module(module), name)
            sizes[f"`{service}`, bytes of RAM"] = memory_image.dtype(kind).itemsize
    if "xcp" in served.services:
        sizes["`working`, bytes of RAM"] = memory_image.dtype(Calibration).itemsize
    return sizes


def _bound(record: Calibration, loop: BusFirmware) -> Mapping[str, str]:
    """The bounds, or why there are none, kept on disk: finding them takes seconds."""
    received = sum(1 for box in loop.bus.received if box.name) if loop.bus.secured else 0
    of = f"{memory_image.image(record).hex()} with {received} frames"
    what = f"bound on {PROCESSOR} by {_compiler()} of {of}"
    try:
        return loop.kept(what, lambda: _made(record, loop, received))
    except CanrollError as error:
        return {"stack and cycles": f"no bound was found: {error}"}


def _made(record: Calibration, loop: BusFirmware, received: int) -> dict[str, str]:
    from codegen.worst_case.cycles import Timing  # noqa: PLC0415 - needs the extra
    from codegen.worst_case.firmware_bound import firmware_bound  # noqa: PLC0415

    bound = firmware_bound(record, Timing(PROCESSOR), loop, received=received)
    return {
        "stack of `canroll_tick`, bytes, bound": str(bound.tick.stack),
        "stack of `canroll_receive`, bytes, bound": str(bound.receive.stack),
        "cycles of `canroll_tick`, bound": str(bound.tick.cycles),
        "cycles of `canroll_receive`, bound": str(bound.receive.cycles),
    }


def _compiler() -> str:
    version = subprocess.run([GCC, "--version"], capture_output=True, text=True, check=False)
    return version.stdout.splitlines()[0] if version.stdout else GCC
