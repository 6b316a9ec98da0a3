"""The firmware on a Cortex-M emulated in this process by unicorn, built by zig (both from pip).

Its counts leave out the instructions of a conditional block whose condition failed.
"""

import struct
from typing import Any

import numpy as np
from elftools.elf.elffile import ELFFile
from numpy.typing import NDArray

from canroll.errors import optional
from codegen.run import memory_image
from codegen.run.bus_firmware import BusFirmware, built_in
from codegen.run.cortex import CPUS, Run, sent, zig_image
from codegen.run.ecu_traffic import Traffic, refused
from firmware.calibration import Calibration

ECU, CALIBRATION, PAYLOAD, STACK_TOP, STACK, RETURN = (
    0x20000000,
    0x20002000,
    0x20006000,
    0x20010000,
    0x4000,
    0x20007000,
)
PAINT = b"\xa5"


class CortexEcu:
    """The firmware on an emulated Cortex-M: one ECU behind the interface of all backends."""

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
        unicorn = optional("unicorn", "emulating a Cortex-M in this process", "target")
        self._firmware = firmware or built_in()
        image = zig_image(cpu, self._firmware)
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
        self._machine.mem_write(CALIBRATION, memory_image.image(calibration))
        self._machine.mem_write(STACK_TOP - STACK, PAINT * STACK)
        record = self._firmware.record
        self._kind = memory_image.dtype(record)
        self._room = memory_image.event_of(record)["payload"].shape[0]
        self._copy = record()
        self.instructions = 0
        if count:
            self._machine.hook_add(unicorn.UC_HOOK_CODE, self._counted)
        self.restart()

    def restart(self) -> None:
        """Start anew, as after a loss of power."""
        self._machine.mem_write(ECU, bytes(self._kind.itemsize))
        rule = self.call("canroll_init", ECU, CALIBRATION)
        if rule:
            raise refused(rule)

    def _counted(self, machine: Any, address: int, size: int, data: Any) -> None:  # noqa: ANN401
        self.instructions += 1

    def call(self, function: str, *arguments: int) -> int:
        """Call a function of the firmware by its name in C."""
        names = self._registers
        # the fifth argument and those after it are on the stack, which stays aligned to eight
        rest = arguments[4:]
        top = STACK_TOP - 8 * -(-len(rest) // 2)
        self._machine.mem_write(top, struct.pack(f"<{len(rest)}i", *rest))
        self._machine.reg_write(names.UC_ARM_REG_SP, top)
        self._machine.reg_write(names.UC_ARM_REG_LR, RETURN | 1)
        for i, argument in enumerate(arguments[:4]):
            self._machine.reg_write(names.UC_ARM_REG_R0 + i, argument & 0xFFFFFFFF)
        self.instructions = 0
        self._machine.emu_start(self._symbols[function] | 1, RETURN)
        return int(self._machine.reg_read(names.UC_ARM_REG_R0))

    def write(self, address: int, data: bytes) -> None:
        """Write to the memory."""
        self._machine.mem_write(address, data)

    def read(self, address: int, size: int) -> bytes:
        """Read from the memory."""
        return bytes(self._machine.mem_read(address, size))

    @property
    def state(self) -> Any:  # noqa: ANN401 - the record of the bus's firmware
        """A copy of the state record."""
        memory_image.fill(self._copy, self.image())
        return self._copy

    @property
    def stack(self) -> int:
        """Bytes of stack used so far at the deepest."""
        painted = bytes(self._machine.mem_read(STACK_TOP - STACK, STACK))
        return STACK - (len(painted) - len(painted.lstrip(PAINT)))

    def image(self) -> bytes:
        """The bytes of the state record."""
        return bytes(self._machine.mem_read(ECU, self._kind.itemsize))

    def receive(self, ident: int, payload: NDArray[np.uint8] | bytes, length: int) -> None:
        """Put a received frame in its mailbox; an unmapped identifier is ignored."""
        for slot in self._firmware.messages.get(ident, ()):
            self.put(slot, bytes(payload).ljust(self._room, b"\0"), length)

    def put(self, message: int, payload: bytes, length: int) -> None:
        """Store a frame in the mailbox of ``message``."""
        self._machine.mem_write(PAYLOAD, payload)
        self.call("canroll_receive", ECU, message, PAYLOAD, length)

    def advance(self, elapsed_ticks: int = 1) -> None:
        """Run one tick; the frames to send stay marked in the record."""
        self.call("canroll_tick", ECU, CALIBRATION, elapsed_ticks)

    def tick(self, elapsed_ticks: int = 1) -> list[tuple[int, bytes]]:
        """Run one tick and return the frames to send, in order."""
        self.advance(elapsed_ticks)
        return self.send()

    def send(self) -> list[tuple[int, bytes]]:
        """Return the frames marked for sending, and clear the marks as the bus driver does."""
        packed = np.frombuffer(self.image(), self._kind, 1)[0]
        pending = packed["tx_pending"]
        if not pending.any():
            return []
        offset = self._kind.fields["tx_pending"][1]  # type: ignore[index]
        self._machine.mem_write(ECU + offset, bytes(len(pending)))
        frames = []
        for slot in np.flatnonzero(pending).tolist():
            ident, length = self._firmware.sent[slot]
            if length:
                frames.append((ident, packed["tx_payload"][slot].tobytes()[:length]))
        return frames


def replay(
    calibration: Calibration, traffic: Traffic, name: str, firmware: BusFirmware | None = None
) -> Run:
    """Replay ``traffic`` on the emulator in this process, counting instructions and stack.

    ``firmware`` is the firmware for a bus, by default the built-in one.
    """
    firmware = firmware or built_in()
    kind = memory_image.dtype(firmware.record)
    ecu = CortexEcu(calibration, cpu=name, count=True, firmware=firmware)
    states = np.zeros(traffic.ticks, kind)
    counts = np.zeros(traffic.ticks, np.int64)
    bounds = np.searchsorted(traffic.frames["tick"], np.arange(traffic.ticks + 1))
    for t in range(traffic.ticks):
        for event in traffic.frames[bounds[t] : bounds[t + 1]]:
            ecu.put(int(event["message"]), event["payload"].tobytes(), int(event["length"]))
        ecu.advance(int(traffic.elapsed[t]))
        counts[t] = ecu.instructions
        states[t] = np.frombuffer(ecu.image(), kind, 1)[0]
        ecu.send()
    return Run(name, "unicorn", sent(states, firmware), states, counts, ecu.stack)
