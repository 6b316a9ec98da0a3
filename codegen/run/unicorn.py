"""The firmware on a Cortex-M emulated in this process by unicorn, built by zig (both from pip).

Its counts leave out the instructions of a conditional block whose condition failed.
"""

import struct
from typing import Any

import numpy as np
from elftools.elf.elffile import ELFFile

from canroll.codegen.run import memory_image
from canroll.codegen.run.bus_firmware import BusFirmware, built_in
from canroll.codegen.run.cortex import CPUS, CortexRun, sent, zig_image
from canroll.codegen.run.ecu import EcuBackend
from canroll.codegen.run.ecu_traffic import EcuTraffic
from canroll.codegen.run.machine import c_name
from canroll.codegen.run.secured import SecocModule, listening_ticks
from canroll.errors import optional
from canroll.firmware.calibration import Calibration

RECORDS, ARRAYS, RETURN, STACK_TOP = 0x20010000, 0x20006000, 0x20007000, 0x20010000
"""Addresses of the records, one after the other, of arrays that are arguments of a call, of what a
call returns to, and of the end of the stack."""
STACK = 0x4000
ROOM = 0x100
"""Records begin at multiples of it, and an array has as many bytes."""
PAINT = b"\xa5"


class CortexRecord:
    """A record in the memory of an emulated processor."""

    def __init__(self, value: Any, memory: Any, address: int) -> None:  # noqa: ANN401
        self.address = address
        self._kind: type = value.__class__
        self._memory = memory
        self._dtype = memory_image.dtype(self._kind)
        self.fill(memory_image.image(value))

    @property
    def size(self) -> int:
        """Bytes of the record."""
        return self._dtype.itemsize

    def __getitem__(self, field: str) -> Any:  # noqa: ANN401
        """Return the value of a field."""
        kind, offset = self._place(field)
        data = self._memory.mem_read(self.address + offset, kind.itemsize)
        return np.frombuffer(data, kind, 1)[0]

    def __setitem__(self, field: str, value: Any) -> None:  # noqa: ANN401
        """Set a field."""
        kind, offset = self._place(field)
        data = np.array(value, kind.base).tobytes()
        self._memory.mem_write(self.address + offset, data)

    def _place(self, field: str) -> tuple[np.dtype[Any], int]:
        assert self._dtype.fields is not None
        kind, offset = self._dtype.fields[field][:2]
        return kind, int(offset)

    def image(self) -> bytes:
        """The bytes of the record."""
        return bytes(self._memory.mem_read(self.address, self.size))

    def fill(self, data: bytes) -> None:
        """Set the record from its bytes."""
        self._memory.mem_write(self.address, data)

    @property
    def value(self) -> Any:  # noqa: ANN401
        """A copy of the record."""
        copy = self._kind()
        memory_image.fill(copy, self.image())
        return copy


class CortexMachine:
    """An emulated Cortex-M; ``instructions`` are those of the last call, if they are counted."""

    def __init__(self, firmware: BusFirmware, *, cpu: str, count: bool = False) -> None:
        unicorn = optional("unicorn", "emulating a Cortex-M in this process", "target")
        image = zig_image(cpu, firmware)
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
        self._machine.mem_write(STACK_TOP - STACK, PAINT * STACK)
        self._free = RECORDS
        self.instructions = 0
        if count:
            self._machine.hook_add(unicorn.UC_HOOK_CODE, self._counted)

    def _counted(self, machine: Any, address: int, size: int, data: Any) -> None:  # noqa: ANN401
        self.instructions += 1

    def record(self, value: Any) -> CortexRecord:  # noqa: ANN401
        """Put a record in the memory, behind those before it."""
        record = CortexRecord(value, self._machine, self._free)
        self._free += -(-record.size // ROOM) * ROOM
        return record

    def call(self, function: str, *arguments: Any) -> int:  # noqa: ANN401
        """Call a function; see :meth:`canroll.codegen.run.machine.Machine.call`."""
        words = [self._passed(place, argument) for place, argument in enumerate(arguments)]
        names = self._registers
        # the fifth argument and those after it are on the stack, which stays aligned to eight
        rest = words[4:]
        top = STACK_TOP - 8 * -(-len(rest) // 2)
        self._machine.mem_write(top, struct.pack(f"<{len(rest)}i", *rest))
        self._machine.reg_write(names.UC_ARM_REG_SP, top)
        self._machine.reg_write(names.UC_ARM_REG_LR, RETURN | 1)
        for number, word in enumerate(words[:4]):
            self._machine.reg_write(names.UC_ARM_REG_R0 + number, word & 0xFFFFFFFF)
        self.instructions = 0
        self._machine.emu_start(self._symbols[c_name(function)] | 1, RETURN)
        for word, argument in zip(words, arguments, strict=True):
            if isinstance(argument, bytearray):
                argument[:] = self._machine.mem_read(word, len(argument))
        return int(self._machine.reg_read(names.UC_ARM_REG_R0))

    def _passed(self, place: int, argument: Any) -> int:  # noqa: ANN401
        """An argument as a register has it: a number, or an address."""
        if isinstance(argument, CortexRecord):
            return argument.address
        if isinstance(argument, bytes | bytearray):
            address = ARRAYS + ROOM * place
            self._machine.mem_write(address, bytes(argument))
            return address
        return int(argument)

    @property
    def stack(self) -> int:
        """Bytes of stack used so far at the deepest."""
        painted = bytes(self._machine.mem_read(STACK_TOP - STACK, STACK))
        return STACK - (len(painted) - len(painted.lstrip(PAINT)))


class CortexEcu(EcuBackend):
    """An ECU on an emulated Cortex-M."""

    machine: CortexMachine

    def __init__(
        self,
        calibration: Calibration,
        *,
        cpu: str,
        count: bool = False,
        firmware: BusFirmware | None = None,
    ) -> None:
        """Start the ECU with the firmware of a bus, by default the built-in one.

        With ``count`` its instructions are counted, which is slower.
        """
        firmware = firmware or built_in()
        super().__init__(CortexMachine(firmware, cpu=cpu, count=count), calibration, firmware)


def replay(
    calibration: Calibration, traffic: EcuTraffic, name: str, firmware: BusFirmware | None = None
) -> CortexRun:
    """Replay ``traffic`` on the emulator in this process, counting instructions and stack.

    ``firmware`` is the firmware for a bus, by default the built-in one.
    """
    firmware = firmware or built_in()
    kind = memory_image.dtype(firmware.record)
    ecu = CortexEcu(calibration, cpu=name, count=True, firmware=firmware)
    states = np.zeros(traffic.ticks, kind)
    counts = np.zeros(traffic.ticks, np.int64)
    for t, (elapsed, frames) in enumerate(traffic.by_tick()):
        for event in frames:
            ecu.put(int(event["message"]), event["payload"].tobytes(), int(event["length"]))
        ecu.advance(elapsed)
        counts[t] = ecu.machine.instructions
        states[t] = np.frombuffer(ecu.image(), kind, 1)[0]
        ecu.send()
    return CortexRun(name, "unicorn", sent(states, firmware), states, counts, ecu.machine.stack)


def replay_secured(
    calibration: Calibration, traffic: EcuTraffic, name: str, firmware: BusFirmware, *, key: bytes
) -> CortexRun:
    """Replay authenticated ``traffic`` on an emulated processor, counting instructions and stack.

    A tick's instructions are those of the loop, and of the authentication of all frames received
    before it and sent by it.
    """
    kind = memory_image.dtype(firmware.record)
    ecu = CortexEcu(calibration, cpu=name, count=True, firmware=firmware)
    machine = ecu.machine
    secoc = SecocModule(machine, firmware)
    secoc.start(key, 1, listening_ticks(calibration.tick_us))
    slot_of = {ident: slot for slot, (ident, _) in enumerate(firmware.sent)}
    states = np.zeros(traffic.ticks, kind)
    counts = np.zeros(traffic.ticks, np.int64)
    added = np.zeros(traffic.ticks, np.int64)
    for t, (elapsed, received) in enumerate(traffic.by_tick()):
        secoc.elapse(elapsed)
        added[t] += machine.instructions
        for event in received:
            message, length = int(event["message"]), int(event["length"])
            frame = event["payload"].tobytes()
            taken = secoc.verify(message, frame, length)
            added[t] += machine.instructions
            if taken or message >= len(firmware.bus.received):
                ecu.put(message, frame, length)
        ecu.advance(elapsed)
        counts[t] = machine.instructions
        states[t] = np.frombuffer(ecu.image(), kind, 1)[0]
        for ident, payload in ecu.send():
            secoc.protect(slot_of[ident], payload)
            added[t] += machine.instructions
    frames = sent(states, firmware)
    return CortexRun(
        name, "unicorn", frames, states, counts + added, machine.stack, authentication=added
    )
