"""Effect of one Thumb instruction on the abstract state (Armv6-M and Armv7-M manuals, A6/A7).

Instructions that are not modelled soundly make their targets unknown; all stores are modelled.
"""

from capstone import CsInsn, arm

from canroll.codegen.operations.intervals import Value, add, hull, multiply, negate
from canroll.codegen.worst_case.arithmetic import NUMBER, any_value, compute
from canroll.codegen.worst_case.conditions import OPPOSITE, where
from canroll.codegen.worst_case.machine_code import MachineImage, conditional
from canroll.codegen.worst_case.machine_state import (
    I32,
    PC,
    SP,
    MachineState,
    Promises,
    joined,
    wrapped,
)
from canroll.errors import CanrollError

LOADS = {
    "ldr": (4, True),
    "ldrb": (1, False),
    "ldrh": (2, False),
    "ldrsb": (1, True),
    "ldrsh": (2, True),
}
STORES = {"str": 4, "strb": 1, "strh": 2}
STACK_TOP = 0x4000_0000
"""Above all RAM of these processors."""


class Transfer:
    """Executes instructions on abstract states of one image.

    Args:
        image: the machine code with its constant bytes.
        promises: ranges of its memory.
        writable: addresses [low, high) that a store through an unknown pointer may change: all
            memory but the stack below the lowest local variable whose address was taken.
    """

    def __init__(self, image: MachineImage, promises: Promises, writable: tuple[int, int]) -> None:
        self.image, self.promises, self.writable = image, promises, writable
        self._taken: int | None = None

    def run(self, state: MachineState, insn: CsInsn) -> None:
        """Apply an instruction to ``state``; a branch has no effect here."""
        if conditional(insn) and insn.id not in (arm.ARM_INS_B, arm.ARM_INS_BX):
            skipped = where(state.copy(), OPPOSITE.get(insn.cc, 0))
            done = where(state.copy(), insn.cc)
            if done is not None:
                self._run(done, insn)
            if skipped is not None:
                done = skipped if done is None else joined(skipped, done)
            if done is None:
                raise CanrollError(f"neither outcome possible at {insn.address:#x}")
            state.registers, state.flags = done.registers, done.flags
            state.memory, state.origin = done.memory, done.origin
            return
        self._run(state, insn)

    def _run(self, state: MachineState, insn: CsInsn) -> None:
        # capstone writes a condition and a width into the mnemonic
        name = insn.insn_name()
        if name in LOADS:
            self._load(state, insn, *LOADS[name])
        elif name in STORES:
            self._store(state, insn, STORES[name])
        elif name == "ldrd":
            self._double(state, insn, load=True)
        elif name == "strd":
            self._double(state, insn, load=False)
        elif name in ("push", "pop", "ldm", "stm", "ldmdb", "stmdb"):
            self._several(state, insn, name)
        elif name.startswith(("str", "stm", "vst", "push")):
            raise CanrollError(f"'{insn.mnemonic}' at {insn.address:#x} is a store not modelled")
        elif insn.id not in BRANCHES:
            self._note_address(state, insn)
            compute(state, insn, name)

    def _note_address(self, state: MachineState, insn: CsInsn) -> None:
        """Note that the address of a local variable is copied to another register."""
        reads_stack_pointer = any(
            o.type == arm.ARM_OP_REG and o.reg == arm.ARM_REG_SP for o in insn.operands[1:]
        )
        if reads_stack_pointer and insn.operands[0].reg != arm.ARM_REG_SP:
            low = state.registers[SP].lo
            self._taken = low if self._taken is None else min(low, self._taken)

    def _address(self, state: MachineState, insn: CsInsn) -> tuple[Value, Value | None]:
        """The address accessed, and the new value of the base register."""
        operand = next(o for o in insn.operands if o.type == arm.ARM_OP_MEM)
        base = operand.mem.base
        if base == arm.ARM_REG_PC:
            start = (insn.address + 4) & ~3
            return Value(start + operand.mem.disp, start + operand.mem.disp), None
        value = state.registers[NUMBER[base]]
        if insn.post_index:
            step = insn.operands[-1]
            moved = (
                I32
                if step.type != arm.ARM_OP_IMM
                else wrapped(
                    add(
                        value,
                        Value(step.imm, step.imm)
                        if not step.subtracted
                        else Value(-step.imm, -step.imm),
                    )
                )
            )
            return value, moved
        address = add(value, Value(operand.mem.disp, operand.mem.disp))
        if operand.mem.index:
            index = state.registers[NUMBER[operand.mem.index]]
            shift = operand.shift.value if operand.shift.type == arm.ARM_SFT_LSL else 0
            address = add(address, multiply(index, Value(1 << shift, 1 << shift)))
        address = wrapped(address)
        return address, address if insn.writeback else None

    def _load(self, state: MachineState, insn: CsInsn, size: int, signed: bool) -> None:
        target = NUMBER[insn.operands[0].reg]
        operand = next(o for o in insn.operands if o.type == arm.ARM_OP_MEM)
        address, moved = self._address(state, insn)
        if moved is not None:
            state.set(NUMBER[operand.mem.base], moved)
        self.read(state, target, address, size, signed)

    def read(
        self, state: MachineState, target: int, address: Value, size: int, signed: bool
    ) -> None:
        """Load a cell into a register, or the hull of all cells in a short address interval."""
        if target == PC:
            return
        if address.lo == address.hi:
            value, plain = self._cell(state, address.lo, size, signed)
            if plain:
                state.loaded(target, address.lo, size, value)
            else:
                state.set(target, value)
            return
        value = any_value(size, signed)
        if address.hi - address.lo <= 4096:
            cells = [
                self._cell(state, a, size, signed)[0]
                for a in range(address.lo, address.hi + 1, size)
            ]
            value = cells[0]
            for cell in cells[1:]:
                value = hull(value, cell)
            if (address.hi - address.lo) % size:
                value = any_value(size, signed)
        state.set(target, value)

    def cell(self, state: MachineState, address: int, size: int) -> Value:
        """The value of the cell of ``size`` bytes at ``address``, unsigned below a word."""
        return self._cell(state, address, size, signed=False)[0]

    def _cell(
        self, state: MachineState, address: int, size: int, signed: bool
    ) -> tuple[Value, bool]:
        """A cell's value, and whether it is a writable cell read with the size it was written."""
        data = self.image.bytes_at(address, size)
        if data is not None:
            number = int.from_bytes(data, "little", signed=signed or size == 4)
            return Value(number, number), False
        known, promise = state.memory.get(address), self.promises.at(address, size)
        if promise is not None and promise.volatile:
            return promise.value, False
        full = any_value(size, signed)
        value = promise.value if promise is not None else full
        if known is not None and known[0] == size:
            value = known[1]
        if value.lo < full.lo or value.hi > full.hi:
            return full, False
        return value, True

    def _store(self, state: MachineState, insn: CsInsn, size: int) -> None:
        operand = next(o for o in insn.operands if o.type == arm.ARM_OP_MEM)
        value = state.registers[NUMBER[insn.operands[0].reg]]
        address, moved = self._address(state, insn)
        self.write(state, address, size, value)
        if moved is not None:
            state.set(NUMBER[operand.mem.base], moved)

    def write(self, state: MachineState, address: Value, size: int, value: Value) -> None:
        """Store into a cell, or into any cell in an interval of addresses."""
        if address.lo == address.hi:
            low = any_value(size, signed=False)
            if size < 4 and not (low.lo <= value.lo and value.hi <= low.hi):
                value = low
            area = self.promises.at(address.lo, size)
            if area is not None:
                # the proof shows that what is stored keeps the promise
                promise = area.value
                value = Value(max(value.lo, promise.lo), min(value.hi, promise.hi))
                if value.lo > value.hi:
                    value = promise
            state.store(address.lo, size, value)
        elif self.writable[0] <= address.lo and address.hi < self.writable[1]:
            state.forget(address.lo, address.hi + size)
        else:
            state.forget(*self.writable)
            if self._taken is not None:
                state.forget(self._taken, STACK_TOP)

    def _double(self, state: MachineState, insn: CsInsn, *, load: bool) -> None:
        first, second = (NUMBER[o.reg] for o in insn.operands[:2])
        operand = next(o for o in insn.operands if o.type == arm.ARM_OP_MEM)
        address, moved = self._address(state, insn)
        high = add(address, Value(4, 4))
        if load:
            self.read(state, first, address, 4, True)
            self.read(state, second, high, 4, True)
        else:
            self.write(state, address, 4, state.registers[first])
            self.write(state, high, 4, state.registers[second])
        if moved is not None:
            state.set(NUMBER[operand.mem.base], moved)

    def _several(self, state: MachineState, insn: CsInsn, name: str) -> None:
        load = name in ("pop", "ldm", "ldmdb")
        if name in ("push", "pop"):
            base, listed, back = SP, list(insn.operands), True
        else:
            base, listed = NUMBER[insn.operands[0].reg], list(insn.operands[1:])
            back = bool(insn.writeback)
        down = name in ("push", "stmdb", "ldmdb")
        size = Value(4 * len(listed), 4 * len(listed))
        start = state.registers[base]
        moved = wrapped(add(start, negate(size) if down else size))
        address = moved if down else start
        registers = [NUMBER[o.reg] for o in listed]
        values = [state.registers[r] for r in registers]
        for register, value in zip(registers, values, strict=True):
            if load:
                self.read(state, register, address, 4, True)
            else:
                self.write(state, address, 4, value)
            address = add(address, Value(4, 4))
        if back and not (load and base in registers):
            state.set(base, moved)


BRANCHES = {
    arm.ARM_INS_B,
    arm.ARM_INS_BX,
    arm.ARM_INS_BL,
    arm.ARM_INS_CBZ,
    arm.ARM_INS_CBNZ,
    arm.ARM_INS_TBB,
    arm.ARM_INS_TBH,
    arm.ARM_INS_IT,
    arm.ARM_INS_NOP,
}
