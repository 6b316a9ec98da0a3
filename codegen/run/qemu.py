"""The firmware on a Cortex-M in QEMU, built by arm-none-eabi-gcc; a plugin counts."""

import struct
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from elftools.elf.elffile import ELFFile
from numpy.typing import NDArray

from canroll.codegen.run import memory_image
from canroll.codegen.run.bus_firmware import BusFirmware, built_in
from canroll.codegen.run.cortex import (
    BOARD,
    CortexRun,
    built,
    cpu,
    gcc_image,
    optimisation_of,
    sent,
)
from canroll.codegen.run.ecu_traffic import EcuTraffic
from canroll.codegen.run.secured import listening_ticks
from canroll.dbc.keys import DEVELOPMENT_KEY
from canroll.errors import CanrollError
from canroll.firmware.calibration import Calibration


@dataclass(frozen=True, slots=True)
class CycleCosts:
    """Cycles of the instructions at ``cycles``' addresses by a model of the processor.

    ``refill`` is added for each of the ``conditional`` branches that is taken.
    """

    cycles: Mapping[int, int]
    conditional: frozenset[int]
    refill: int

    def text(self) -> str:
        """The text that the plugin reads."""
        lines = (f"{a:x} {n:x} {a in self.conditional:x}" for a, n in self.cycles.items())
        return "\n".join(lines) + "\n"


def replay(
    calibration: Calibration,
    traffic: EcuTraffic,
    name: str,
    files: Mapping[str, str] | None = None,
    *,
    firmware: BusFirmware | None = None,
    costs: CycleCosts | None = None,
    key: bytes = DEVELOPMENT_KEY,
) -> CortexRun:
    """Replay ``traffic`` in QEMU, counting instructions with a plugin, and cycles by ``costs``.

    ``firmware`` is the firmware for a bus, by default the built-in one; ``files`` are the sources
    of another ECU with the same records, by default those of ``firmware``, built as those are.
    ``key`` is for a bus
    with authenticated frames, where a tick's counts are those of the loop and of the authentication
    of all frames received before it and sent by it.
    """
    firmware = firmware or built_in()
    flags = optimisation_of(firmware)
    image = gcc_image(name, files or firmware.files, optimisation=flags)
    plugin = built(
        ["cc", "-O2", "-shared", "-fPIC"],
        {"insncount.c": (BOARD / "insncount.c").read_text(encoding="utf-8")},
        "insncount.so",
    )
    with image.open("rb") as file:
        table = ELFFile(file).get_section_by_name(".symtab")
        start, end = (
            table.get_symbol_by_name(symbol)[0]["st_value"] & ~1
            for symbol in ("replay_begin", "replay_end")
        )
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        secret = _secret(key, calibration) if firmware.bus.secured else b""
        (folder / "replay.in").write_bytes(replay_file(calibration, traffic, secret))
        command = ["qemu-system-arm", "-M", cpu(name).machine, "-display", "none", "-monitor"]
        command += ["none", "-serial", "none", "-kernel", str(image), "-semihosting-config"]
        command += ["enable=on,target=native", "-d", "plugin", "-plugin"]
        options = f"{plugin},start={start:#x},end={end:#x},out=counts.txt"
        if costs is not None:
            (folder / "costs").write_text(costs.text(), encoding="ascii")
            options += f",costs=costs,refill={costs.refill}"
        command.append(options)
        result = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=False, timeout=1800
        )
        if result.returncode:
            raise CanrollError(
                f"the firmware ended with code {result.returncode} in QEMU {result.stderr.strip()}"
            )
        states = np.frombuffer(
            bytearray((folder / "replay.out").read_bytes()), memory_image.dtype(firmware.record)
        )
        counts = np.loadtxt(folder / "counts.txt", np.int64, ndmin=2)
        depth = struct.unpack("<I", (folder / "replay.stack").read_bytes())[0]
    authentication = None
    if firmware.bus.secured:
        counts, added = _of_ticks(counts, traffic, states, firmware)
        authentication = added[:, 0]
    cycles = counts[:, 1] if costs is not None else None
    frames = sent(states, firmware)
    return CortexRun(name, "qemu", frames, states, counts[:, 0], depth, cycles, authentication)


def _secret(key: bytes, calibration: Calibration) -> bytes:
    """What the replay program starts the authentication with."""
    return key + struct.pack("<i", listening_ticks(calibration.tick_us))


def _of_ticks(
    visits: NDArray[np.int64],
    traffic: EcuTraffic,
    states: NDArray[np.void],
    firmware: BusFirmware,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Each tick's counts, and the authentication's among them, from those of its parts in order.

    The parts are what is done once, each frame received, the loop, and each frame sent.
    """
    received = np.bincount(traffic.frames["tick"], minlength=traffic.ticks)
    lengths = np.array([length for _, length in firmware.sent])
    protected = ((states["tx_pending"] == 1) & (lengths > 0)).sum(axis=1)
    parts = 2 + received + protected
    first = np.cumsum(parts) - parts
    whole = np.add.reduceat(visits, first)
    return whole, whole - visits[first + 1 + received]


def replay_file(calibration: Calibration, traffic: EcuTraffic, secret: bytes) -> bytes:
    """Input of the replay program: ticks, calibration, ``secret``, each tick's elapsed and frames.

    ``secret`` is what the authentication starts with, empty where there is none.
    """
    parts = [struct.pack("<i", traffic.ticks), memory_image.image(calibration), secret]
    for elapsed, frames in traffic.by_tick():
        parts += [struct.pack("<ii", elapsed, len(frames)), frames.tobytes()]
    return b"".join(parts)
