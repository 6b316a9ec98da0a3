"""Functions of a linked image as basic blocks of decoded instructions."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import capstone
from capstone import arm
from elftools.elf.elffile import ELFFile

from canroll.errors import CanrollError

SWITCHES = {
    "__gnu_thumb1_case_uqi": (1, False),
    "__gnu_thumb1_case_sqi": (1, True),
    "__gnu_thumb1_case_uhi": (2, False),
    "__gnu_thumb1_case_shi": (2, True),
}
"""libgcc's switches for Thumb-1: bytes of an entry of the table behind the call, and its sign."""


@dataclass(frozen=True, slots=True)
class Section:
    """Bytes of the image at their address."""

    address: int
    data: bytes


class MachineImage:
    """A linked ELF image: its symbols, its constant bytes, its instructions.

    Raises:
        CanrollError: no symbol table.
    """

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            elf = ELFFile(file)
            table = elf.get_section_by_name(".symtab")
            if table is None:
                raise CanrollError(f"{path.name} has no symbol table: build it without -s")
            self.constant = [
                Section(section["sh_addr"], section.data())
                for section in elf.iter_sections()
                if section["sh_flags"] & 2
                and not section["sh_flags"] & 1
                and section["sh_type"] != "SHT_NOBITS"
            ]
            self.symbols: dict[str, tuple[int, int]] = {}
            self.functions: dict[int, str] = {}
            self._code_starts: list[int] = []
            for symbol in table.iter_symbols():
                if symbol.name.startswith("$t"):
                    self._code_starts.append(symbol["st_value"])
                kind = symbol["st_info"]["type"]
                if kind in ("STT_FUNC", "STT_OBJECT"):
                    address = symbol["st_value"] & ~1 if kind == "STT_FUNC" else symbol["st_value"]
                    self.symbols[symbol.name] = (address, symbol["st_size"])
                if kind == "STT_FUNC":
                    self.functions.setdefault(address, symbol.name)
        self._decoder = capstone.Cs(
            capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS
        )
        self._decoder.detail = True
        self._decoded: dict[int, capstone.CsInsn] = {}
        self._graphs: dict[int, MachineFunction] = {}

    def address(self, name: str) -> int:
        """The address of a function or object."""
        if name not in self.symbols:
            raise CanrollError(f"the image has no '{name}'")
        return self.symbols[name][0]

    def bytes_at(self, address: int, size: int) -> bytes | None:
        """Constant bytes; None where none are stored."""
        for section in self.constant:
            offset = address - section.address
            if 0 <= offset <= len(section.data) - size:
                return section.data[offset : offset + size]
        return None

    def instruction(self, address: int) -> capstone.CsInsn:
        """The instruction at ``address``.

        Raises:
            CanrollError: there is no instruction.
        """
        if address not in self._decoded:
            code = next(filter(None, (self.bytes_at(address, n) for n in (18, 4, 2))), b"")
            found = list(self._decoder.disasm(code, address, 5))
            if not found:
                raise CanrollError(f"no instruction at {address:#x} of the image")
            # the conditions of an IT block are known only to who decodes it from its beginning
            block = len(found[0].mnemonic) if found[0].id == arm.ARM_INS_IT else 1
            self._decoded |= {insn.address: insn for insn in found[:block]}
        return self._decoded[address]

    def data_end(self, address: int) -> int:
        """End of the literal data at ``address``, from the linker's mapping symbols."""
        return min((start for start in self._code_starts if start > address), default=address)

    def function(self, address: int) -> "MachineFunction":
        """The function that starts at ``address``, as basic blocks."""
        if address not in self._graphs:
            self._graphs[address] = MachineFunction(self, address)
        return self._graphs[address]


@dataclass(frozen=True, slots=True)
class Block:
    """Instructions of which only the last may branch; ``next`` are its successors in the function.

    ``calls`` is the address of the function that the last instruction calls, ``tail`` that of a
    tail call; ``returns``: it leaves the function. ``table`` lists a switch's targets by index.
    """

    start: int
    instructions: tuple[capstone.CsInsn, ...]
    next: tuple[int, ...]
    calls: int | None = None
    tail: int | None = None
    returns: bool = False
    table: tuple[int, ...] = ()

    @property
    def last(self) -> capstone.CsInsn:
        """The instruction that ends the block."""
        return self.instructions[-1]

    @property
    def end(self) -> int:
        """The address after the block."""
        return int(self.last.address + self.last.size)


class MachineFunction:
    """The control-flow graph of one function, found by following its branches."""

    def __init__(self, image: MachineImage, entry: int) -> None:
        self.image, self.entry = image, entry
        self.name = image.functions.get(entry, hex(entry))
        self.blocks: Mapping[int, Block] = self._build()

    @cached_property
    def _leaders(self) -> set[int]:
        leaders, todo, seen = {self.entry}, [self.entry], set()
        while todo:
            address = todo.pop()
            while address not in seen:
                seen.add(address)
                insn = self.image.instruction(address)
                ends = self._ends(insn)
                if ends is None:
                    address += insn.size
                    continue
                leaders.update(ends.next)
                todo.extend(ends.next)
                break
        return leaders

    def _build(self) -> Mapping[int, Block]:
        blocks = {}
        for start in self._leaders:
            instructions: list[capstone.CsInsn] = []
            address = start
            while True:
                insn = self.image.instruction(address)
                instructions.append(insn)
                ends = self._ends(insn)
                address += insn.size
                if ends is not None:
                    blocks[start] = Block(
                        start,
                        tuple(instructions),
                        ends.next,
                        ends.calls,
                        ends.tail,
                        ends.returns,
                        ends.table,
                    )
                    break
                if address in self._leaders:
                    blocks[start] = Block(start, tuple(instructions), (address,))
                    break
        return dict(sorted(blocks.items()))

    def _ends(self, insn: capstone.CsInsn) -> Block | None:
        """The one-instruction block of ``insn`` with its successors if it ends a block, or None."""
        name = insn.insn_name()
        at, after = insn.address, insn.address + insn.size
        own = (insn,)
        if name in ("cbz", "cbnz"):
            return Block(at, own, (insn.operands[1].imm, after))
        if name in ("tbb", "tbh"):
            targets = self._table(after, 1 if name == "tbb" else 2, after, signed=False)
            return Block(at, own, tuple(dict.fromkeys(targets)), table=targets)
        if name in ("bl", "blx"):
            if insn.operands[0].type != arm.ARM_OP_IMM:
                raise CanrollError(f"call through a pointer at {at:#x} of {self.name}")
            target = insn.operands[0].imm
            width = SWITCHES.get(self.image.functions.get(target, ""))
            if width is not None:
                targets = self._table(after, width[0], after, signed=width[1])
                return Block(at, own, tuple(dict.fromkeys(targets)), calls=target, table=targets)
            return Block(at, own, (after,), calls=target)
        if writes_pc(insn):
            if insn.id == arm.ARM_INS_B:
                return self._jump(insn)
            if conditional(insn):
                return Block(at, own, (after,), returns=True)
            return Block(at, own, (), returns=True)
        return None

    def _jump(self, insn: capstone.CsInsn) -> Block:
        at, after, target = insn.address, insn.address + insn.size, insn.operands[0].imm
        leaves = target in self.image.functions and target != self.entry
        if conditional(insn):
            if leaves:
                raise CanrollError(f"conditional jump out of {self.name} at {at:#x}")
            return Block(at, (insn,), (target, after))
        if leaves:
            return Block(at, (insn,), (), tail=target, returns=True)
        return Block(at, (insn,), (target,))

    def _table(self, at: int, width: int, base: int, *, signed: bool) -> tuple[int, ...]:
        """Targets of the offset table at ``at``."""
        targets: list[int] = []
        for place in range(at, self.image.data_end(at) - width + 1, width):
            data = self.image.bytes_at(place, width) or b""
            offset = int.from_bytes(data, "little", signed=signed)
            if offset == 0 and targets:
                break  # padding: no case begins inside the table
            if offset <= 0:
                raise CanrollError(f"the switch at {at:#x} of {self.name} jumps back")
            targets.append(base + 2 * offset)
        if not targets:
            raise CanrollError(f"the switch at {at:#x} of {self.name} has no table")
        return tuple(targets)


def conditional(insn: capstone.CsInsn) -> bool:
    """Whether the instruction is executed conditionally."""
    return insn.cc not in (arm.ARM_CC_AL, arm.ARM_CC_INVALID) and insn.id != arm.ARM_INS_IT


def writes_pc(insn: capstone.CsInsn) -> bool:
    """Whether the instruction branches, other than by a call."""
    if insn.id in (arm.ARM_INS_B, arm.ARM_INS_BX):
        return True
    return any(
        o.type == arm.ARM_OP_REG and o.reg == arm.ARM_REG_PC and o.access & capstone.CS_AC_WRITE
        for o in insn.operands
    )
