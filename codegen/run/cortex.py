"""Cortex-M builds of the firmware, and results of a run on an emulator.

*unicorn* (:mod:`canroll.codegen.run.unicorn`): built by the zig compiler, emulated in this process;
both come with pip (``canroll[target]``). *qemu* (:mod:`canroll.codegen.run.qemu`): built by
arm-none-eabi-gcc, run by QEMU, instructions counted by a plugin; where both are installed. A figure
always names its counter: the two count differently (unicorn's hooks skip the instructions whose
condition failed), and neither counts cycles.
"""

import hashlib
import importlib.util
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from canroll import build_cache
from canroll.codegen.c99 import emit
from canroll.codegen.run.bus_firmware import BusFirmware, built_in
from canroll.codegen.run.memory_image import event_of
from canroll.errors import CanrollError, MissingExtraError, UnknownNameError

BOARD = Path(__file__).parents[1] / "board"
OPTIMISATION = ("-Os", "-fno-move-loop-invariants", "-fno-schedule-insns2", "-fno-if-conversion2")
"""What makes this code both small and quick: fewer registers saved and spilled, and no conditional
instructions that a branch would skip. The exported bundle is built with the same flags."""
INLINED = ("-O2", "-fpeel-loops", "-fipa-cp-clone", "--param=max-inline-insns-auto=60")
"""What makes the code of one calibration quick: its numbers reach the functions that use them."""
GCC_FLAGS = ["-std=gnu99", "-mthumb", "-mfloat-abi=soft", "-ffreestanding", "-g"]
GCC_FLAGS += ["-ffunction-sections", "-fdata-sections", "-Wall", "-Wextra"]


@dataclass(frozen=True, slots=True)
class Cpu:
    """A processor, by its name in each tool."""

    name: str
    zig: str
    machine: str
    unicorn: str


CPUS = {
    "cortex-m0": Cpu("cortex-m0", "cortex_m0", "microbit", "UC_CPU_ARM_CORTEX_M0"),
    "cortex-m3": Cpu("cortex-m3", "cortex_m3", "mps2-an385", "UC_CPU_ARM_CORTEX_M3"),
    "cortex-m4": Cpu("cortex-m4", "cortex_m4", "mps2-an386", "UC_CPU_ARM_CORTEX_M4"),
}


@dataclass(frozen=True, slots=True)
class CortexRun:
    """Results of a Cortex-M run on given traffic.

    ``frames`` are the frames sent, ``states`` the records after each tick, ``instructions`` those
    of each tick as counted by ``counter``, ``stack`` the deepest use seen in bytes, ``cycles``
    those of each tick by a model of the processor, if one was given, ``authentication`` the
    instructions for the frames received before and sent by each tick, where they are authenticated,
    which ``instructions`` contain.
    """

    cpu: str
    counter: str
    frames: NDArray[np.void]
    states: NDArray[np.void]
    instructions: NDArray[np.int64]
    stack: int
    cycles: NDArray[np.int64] | None = None
    authentication: NDArray[np.int64] | None = None


def cpu(name: str) -> Cpu:
    """The processor called ``name``."""
    if name not in CPUS:
        raise UnknownNameError("processor", name, CPUS)
    return CPUS[name]


def has_pip_tools() -> bool:
    """Whether ``canroll[target]`` is installed."""
    return all(importlib.util.find_spec(name) for name in ("ziglang", "unicorn"))


def has_gcc_and_qemu() -> bool:
    """Whether arm-none-eabi-gcc, QEMU and a compiler for its plugin are installed."""
    return all(shutil.which(name) for name in ("arm-none-eabi-gcc", "qemu-system-arm", "cc"))


@cache
def zig_image(name: str, firmware: BusFirmware | None = None) -> Path:
    """The firmware linked at a fixed address by zig, from the cache if present.

    ``firmware`` is the firmware for a bus, by default the built-in one.
    """
    if not has_pip_tools():
        raise MissingExtraError("emulating a Cortex-M in this process", "target")
    firmware = firmware or built_in()
    files = dict(firmware.files)
    files["entry.c"] = (BOARD / "entry.c").read_text(encoding="utf-8")
    flags = ["-target", "thumb-freestanding-eabi", f"-mcpu={cpu(name).zig}", "-std=c99", "-O2"]
    flags += ["-ffreestanding", "-Wl,--image-base=0x10000", "-Wl,-e,canroll_idle"]
    flags += _kept(files, firmware.services)
    return built([sys.executable, "-m", "ziglang", "cc", *flags], files, f"zig_{name}.elf")


def _kept(files: Mapping[str, str], services: Sequence[str]) -> list[str]:
    """Flags that keep the functions of services, which the programs here do not call."""
    flags = []
    for service in services:
        header = files[f"canroll_{service}.h"]
        called = sorted(set(re.findall(rf"\b(canroll_{service}_\w+)\(", header)))
        flags += [f"-Wl,-u,{name}" for name in called]
    return flags


def optimisation_of(firmware: BusFirmware) -> tuple[str, ...]:
    """The flags by which the C of a firmware is built for a processor, in its bundle too."""
    return INLINED if firmware.calibration else OPTIMISATION


def gcc_image(
    name: str,
    firmware: Mapping[str, str] | None = None,
    services: Sequence[str] = (),
    *,
    optimisation: Sequence[str] = OPTIMISATION,
) -> Path:
    """The replay program for QEMU, built by arm-none-eabi-gcc.

    ``firmware`` are the sources of another ECU with the same records; the emitted ones by default.
    ``services`` among them are linked too; ``optimisation`` is that of :func:`optimisation_of`.
    """
    files = dict(firmware or emit.firmware())
    for file in ("startup.c", "replay.c", "link.ld"):
        files[file] = (BOARD / file).read_text(encoding="utf-8")
    flags = [f"-mcpu={name}", *GCC_FLAGS, *optimisation, *_kept(files, services)]
    flags += ["-nostdlib", "-T", "link.ld", "-Wl,--gc-sections"]
    return built(["arm-none-eabi-gcc", *flags], files, f"gcc_{name}.elf", last=["-lgcc"])


def built(
    command: Sequence[str], files: Mapping[str, str], name: str, last: Sequence[str] = ()
) -> Path:
    """Compile ``files`` by ``command`` into a cached file."""
    key = hashlib.sha256(repr((command, sorted(files.items()), last)).encode()).hexdigest()[:20]

    def make(folder: Path) -> Path:
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
        sources = sorted(file for file in files if file.endswith(".c"))
        full = [*command, "-o", name, *sources, *last]
        result = subprocess.run(
            full, cwd=folder, capture_output=True, text=True, check=False, timeout=600
        )
        if result.returncode:
            first = next((s for s in result.stderr.splitlines() if "error" in s), result.stderr)
            raise CanrollError(
                f"{Path(command[0]).name} cannot build the firmware: {first.strip()}"
            )
        return folder / name

    return build_cache.built("native", f"{key}_{name}", make)


def sent(states: NDArray[np.void], firmware: BusFirmware | None = None) -> NDArray[np.void]:
    """Yield the frames marked for sending, and clear the marks as the bus driver does."""
    firmware = firmware or built_in()
    ticks, slots = np.nonzero(states["tx_pending"])
    frames = np.zeros(len(ticks), event_of(firmware.record))
    frames["tick"], frames["message"] = ticks, slots
    frames["length"] = np.array([length for _, length in firmware.sent])[slots]
    payload = states["tx_payload"][ticks, slots]
    frames["payload"][:, : payload.shape[1]] = payload
    states["tx_pending"] = 0
    return frames
