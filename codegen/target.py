"""Cortex-M builds of the firmware, and two ways to run them without a board.

*unicorn*: built by the zig compiler, emulated in this process; both come with pip
(``canroll[target]``). *qemu*: built by arm-none-eabi-gcc, run by QEMU, instructions counted by a
plugin; where both are installed. A figure always names its counter: the two count differently
(unicorn's hooks skip the instructions whose condition failed), and neither counts cycles.
"""

import hashlib
import importlib.util
import os
import shutil
import struct
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError, UnknownNameError
from codegen import emit_c, layout
from codegen.native import cache_folder
from codegen.vectors import EVENT, Traffic
from firmware.calibration import Calibration
from firmware.signals import RX_IDS, TX_IDS, TX_LENGTHS
from firmware.state import Ecu

BOARD = Path(__file__).with_name("board")
ECU, CALIBRATION, PAYLOAD, STACK_TOP, STACK, RETURN = (
    0x20000000,
    0x20002000,
    0x20006000,
    0x20010000,
    0x4000,
    0x20007000,
)
PAINT = b"\xa5"
SLOT = {ident: slot for slot, ident in enumerate(RX_IDS) if ident}
GCC_FLAGS = ["-std=gnu99", "-mthumb", "-mfloat-abi=soft", "-ffreestanding", "-O2", "-fpeel-loops"]
GCC_FLAGS += ["-g", "-ffunction-sections", "-fdata-sections", "-Wall", "-Wextra"]


@dataclass(frozen=True, slots=True)
class Cpu:
    """A processor, as the tools call it."""

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
class Run:
    """What a Cortex-M did with some traffic.

    ``frames`` were sent, ``states`` are the records after each tick; ``instructions`` of each
    tick, as ``counter`` counts them; ``stack`` is the deepest use seen, in bytes.
    """

    cpu: str
    counter: str
    frames: NDArray[np.void]
    states: NDArray[np.void]
    instructions: NDArray[np.int64]
    stack: int


def cpu(name: str) -> Cpu:
    """The processor called ``name``."""
    if name not in CPUS:
        raise UnknownNameError("processor", name, CPUS)
    return CPUS[name]


def has_pip_tools() -> bool:
    """Whether ``canroll[target]`` is installed."""
    names = ("ziglang", "unicorn", "elftools")
    return all(importlib.util.find_spec(name) for name in names)


def has_gcc_and_qemu() -> bool:
    """Whether arm-none-eabi-gcc, QEMU and a compiler for its plugin are installed."""
    return all(shutil.which(name) for name in ("arm-none-eabi-gcc", "qemu-system-arm", "cc"))


@cache
def zig_image(name: str) -> Path:
    """The firmware linked at a fixed address by zig, from the cache where it is there."""
    if not has_pip_tools():
        raise CanrollError(
            "the Cortex-M backends need more packages: pip install 'canroll[target]'"
        )
    files = {**emit_c.firmware(), "entry.c": (BOARD / "entry.c").read_text(encoding="utf-8")}
    flags = ["-target", "thumb-freestanding-eabi", f"-mcpu={cpu(name).zig}", "-std=c99", "-O2"]
    flags += ["-ffreestanding", "-Wl,--image-base=0x10000", "-Wl,-e,canroll_idle"]
    return _built([sys.executable, "-m", "ziglang", "cc", *flags], files, f"zig_{name}.elf")


@cache
def gcc_image(name: str) -> Path:
    """The replay program for QEMU, built by arm-none-eabi-gcc."""
    files = dict(emit_c.firmware())
    for file in ("startup.c", "replay.c", "link.ld"):
        files[file] = (BOARD / file).read_text(encoding="utf-8")
    flags = [f"-mcpu={name}", *GCC_FLAGS, "-nostdlib", "-T", "link.ld", "-Wl,--gc-sections"]
    return _built(["arm-none-eabi-gcc", *flags], files, f"gcc_{name}.elf", last=["-lgcc"])


def _built(
    command: Sequence[str], files: Mapping[str, str], name: str, last: Sequence[str] = ()
) -> Path:
    """Compile ``files`` by ``command`` into a cached file."""
    key = hashlib.sha256(repr((command, sorted(files.items()), last)).encode()).hexdigest()[:20]
    target = cache_folder() / f"{key}_{name}"
    if target.exists():
        return target
    with tempfile.TemporaryDirectory(dir=target.parent) as temporary:
        folder = Path(temporary)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
        sources = sorted(file for file in files if file.endswith(".c"))
        full = [*command, "-o", name, *sources, *last]
        result = subprocess.run(
            full, cwd=folder, capture_output=True, text=True, check=False, timeout=600
        )
        if result.returncode:
            first = next((s for s in result.stderr.splitlines() if "error" in s), result.stderr)
            raise CanrollError(f"{Path(command[0]).name} can't build the firmware: {first.strip()}")
        os.replace(folder / name, target)
    return target


class CortexEcu:
    """The firmware on an emulated Cortex-M: one ECU behind the interface of all backends."""

    def __init__(self, calibration: Calibration, *, cpu: str, count: bool = False) -> None:
        """Start the ECU; with ``count`` its instructions are counted, which is slower."""
        import unicorn  # noqa: PLC0415
        from elftools.elf.elffile import ELFFile  # noqa: PLC0415

        image = zig_image(cpu)
        self._machine: Any = unicorn.Uc(
            unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS
        )
        self._registers: Any = unicorn.arm_const
        self._machine.ctl_set_cpu_model(getattr(unicorn.arm_const, CPUS[cpu].unicorn))
        self._machine.mem_map(0, 1 << 20)
        self._machine.mem_map(0x20000000, 1 << 17)
        with image.open("rb") as file:
            elf = ELFFile(file)
            self._symbols = {
                symbol.name: symbol["st_value"]
                for symbol in elf.get_section_by_name(".symtab").iter_symbols()
            }
            for segment in elf.iter_segments():
                if segment["p_type"] == "PT_LOAD":
                    self._machine.mem_write(segment["p_vaddr"], segment.data())
        self._machine.mem_write(RETURN, b"\xfe\xe7")
        self._machine.mem_write(CALIBRATION, layout.image(calibration))
        self._machine.mem_write(STACK_TOP - STACK, PAINT * STACK)
        self._size = layout.dtype(Ecu).itemsize
        self._copy = Ecu()
        self.instructions = 0
        if count:
            self._machine.hook_add(unicorn.UC_HOOK_CODE, self._counted)
        rule = self._call("canroll_init", ECU, CALIBRATION)
        if rule:
            from codegen.backends import refuse  # noqa: PLC0415

            raise refuse(rule)

    def _counted(self, machine: Any, address: int, size: int, data: Any) -> None:  # noqa: ANN401
        self.instructions += 1

    def _call(self, function: str, *arguments: int) -> int:
        names = self._registers
        self._machine.reg_write(names.UC_ARM_REG_SP, STACK_TOP)
        self._machine.reg_write(names.UC_ARM_REG_LR, RETURN | 1)
        for i, argument in enumerate(arguments):
            self._machine.reg_write(names.UC_ARM_REG_R0 + i, argument & 0xFFFFFFFF)
        self.instructions = 0
        self._machine.emu_start(self._symbols[function] | 1, RETURN)
        return int(self._machine.reg_read(names.UC_ARM_REG_R0))

    @property
    def state(self) -> Ecu:
        """A copy of the state record."""
        layout.fill(self._copy, self.image())
        return self._copy

    @property
    def stack(self) -> int:
        """Bytes of stack used so far at the deepest."""
        painted = bytes(self._machine.mem_read(STACK_TOP - STACK, STACK))
        return STACK - (len(painted) - len(painted.lstrip(PAINT)))

    def image(self) -> bytes:
        """The bytes of the state record."""
        return bytes(self._machine.mem_read(ECU, self._size))

    def receive(self, ident: int, payload: NDArray[np.uint8] | bytes, length: int) -> None:
        """Put a received frame in its mailbox; an identifier that nobody waits for is ignored."""
        if ident in SLOT:
            self.put(SLOT[ident], bytes(payload).ljust(8, b"\0"), length)

    def put(self, message: int, payload: bytes, length: int) -> None:
        """Put a frame in the mailbox of ``message``."""
        self._machine.mem_write(PAYLOAD, payload)
        self._call("canroll_receive", ECU, message, PAYLOAD, length)

    def advance(self, elapsed_ticks: int = 1) -> None:
        """Run one tick and leave what it wants sent in the record."""
        self._call("canroll_tick", ECU, CALIBRATION, elapsed_ticks)

    def tick(self, elapsed_ticks: int = 1) -> list[tuple[int, bytes]]:
        """Run one tick and return the frames to send, in order."""
        self.advance(elapsed_ticks)
        return self.send()

    def send(self) -> list[tuple[int, bytes]]:
        """Take the frames that are to be sent, as the bus driver does."""
        packed = np.frombuffer(self.image(), layout.dtype(Ecu), 1)[0]
        pending = packed["tx_pending"]
        if not pending.any():
            return []
        offset = layout.dtype(Ecu).fields["tx_pending"][1]  # type: ignore[index]
        self._machine.mem_write(ECU + offset, bytes(len(pending)))
        return [
            (TX_IDS[slot], packed["tx_payload"][slot].tobytes()[: TX_LENGTHS[slot]])
            for slot in np.flatnonzero(pending).tolist()
        ]


def run_unicorn(calibration: Calibration, traffic: Traffic, name: str) -> Run:
    """Replay ``traffic`` on the emulator in this process, counting instructions and stack."""
    ecu = CortexEcu(calibration, cpu=name, count=True)
    states = np.zeros(traffic.ticks, layout.dtype(Ecu))
    counts = np.zeros(traffic.ticks, np.int64)
    bounds = np.searchsorted(traffic.frames["tick"], np.arange(traffic.ticks + 1))
    for t in range(traffic.ticks):
        for event in traffic.frames[bounds[t] : bounds[t + 1]]:
            ecu.put(int(event["message"]), event["payload"].tobytes(), int(event["length"]))
        ecu.advance(int(traffic.elapsed[t]))
        counts[t] = ecu.instructions
        states[t] = np.frombuffer(ecu.image(), layout.dtype(Ecu), 1)[0]
        ecu.send()
    return Run(name, "unicorn", _sent(states), states, counts, ecu.stack)


def run_qemu(calibration: Calibration, traffic: Traffic, name: str) -> Run:
    """Replay ``traffic`` in QEMU, counting instructions with a plugin."""
    from elftools.elf.elffile import ELFFile  # noqa: PLC0415

    image = gcc_image(name)
    plugin = _built(
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
        (folder / "replay.in").write_bytes(replay_file(calibration, traffic))
        command = ["qemu-system-arm", "-M", cpu(name).machine, "-display", "none", "-monitor"]
        command += ["none", "-serial", "none", "-kernel", str(image), "-semihosting-config"]
        command += ["enable=on,target=native", "-d", "plugin", "-plugin"]
        command += [f"{plugin},start={start:#x},end={end:#x},out=counts.txt"]
        result = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=False, timeout=1800
        )
        if result.returncode:
            raise CanrollError(
                f"the firmware ended with code {result.returncode} in QEMU {result.stderr.strip()}"
            )
        states = np.frombuffer(bytearray((folder / "replay.out").read_bytes()), layout.dtype(Ecu))
        counts = np.loadtxt(folder / "counts.txt", np.int64, ndmin=1)
        depth = struct.unpack("<I", (folder / "replay.stack").read_bytes())[0]
    return Run(name, "qemu", _sent(states), states, counts, depth)


def _sent(states: NDArray[np.void]) -> NDArray[np.void]:
    """The frames that ticks want sent; takes them, as the bus driver does."""
    ticks, slots = np.nonzero(states["tx_pending"])
    frames = np.zeros(len(ticks), EVENT)
    frames["tick"], frames["message"] = ticks, slots
    frames["length"] = np.array(TX_LENGTHS)[slots]
    frames["payload"] = states["tx_payload"][ticks, slots]
    states["tx_pending"] = 0
    return frames


def replay_file(calibration: Calibration, traffic: Traffic) -> bytes:
    """What the replay program reads: ticks, calibration, then each tick's elapsed and frames."""
    parts = [struct.pack("<i", traffic.ticks), layout.image(calibration)]
    bounds = np.searchsorted(traffic.frames["tick"], np.arange(traffic.ticks + 1))
    for t in range(traffic.ticks):
        frames = traffic.frames[bounds[t] : bounds[t + 1]]
        parts += [struct.pack("<ii", int(traffic.elapsed[t]), len(frames)), frames.tobytes()]
    return b"".join(parts)
