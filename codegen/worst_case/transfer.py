"""Effect of one Thumb instruction on the abstract state (Armv6-M and Armv7-M manuals, A6/A7).

Instructions that are not modelled soundly make their targets unknown; all stores are modelled.
"""

from collections.abc import Callable

from capstone import CS_AC_WRITE, CsInsn, arm

from canroll.errors import CanrollError
from codegen.proof.intervals import Value, add, bitwise, hull, multiply, negate
from codegen.worst_case.conditions import OPPOSITE, ZERO, where
from codegen.worst_case.machine_code import Image, conditional
from codegen.worst_case.machine_state import (
    I32,
    PC,
    SP,
    Flags,
    Promises,
    State,
    joined,
    wrapped,
)

LOADS = {
    "ldr": (4, True),
    "ldrb": (1, False),
    "ldrh": (2, False),
    "ldrsb": (1, True),
    "ldrsh": (2, True),
}
STORES = {"str": 4, "strb": 1, "strh": 2}
NUMBER = {
    **{getattr(arm, f"ARM_REG_R{k}"): k for k in range(13)},
    arm.ARM_REG_SP: 13,
    arm.ARM_REG_LR: 14,
    arm.ARM_REG_PC: 15,
}
WORD = 1 << 32
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

    def __init__(self, image: Image, promises: Promises, writable: tuple[int, int]) -> None:
        self.image, self.promises, self.writable = image, promises, writable
        self._taken: int | None = None

    def run(self, state: State, insn: CsInsn) -> None:
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

    def _run(self, state: State, insn: CsInsn) -> None:
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

    def _note_address(self, state: State, insn: CsInsn) -> None:
        """Note that the address of a local variable is copied to another register."""
        reads_stack_pointer = any(
            o.type == arm.ARM_OP_REG and o.reg == arm.ARM_REG_SP for o in insn.operands[1:]
        )
        if reads_stack_pointer and insn.operands[0].reg != arm.ARM_REG_SP:
            low = state.registers[SP].lo
            self._taken = low if self._taken is None else min(low, self._taken)

    def _address(self, state: State, insn: CsInsn) -> tuple[Value, Value | None]:
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

    def _load(self, state: State, insn: CsInsn, size: int, signed: bool) -> None:
        target = NUMBER[insn.operands[0].reg]
        operand = next(o for o in insn.operands if o.type == arm.ARM_OP_MEM)
        address, moved = self._address(state, insn)
        if moved is not None:
            state.set(NUMBER[operand.mem.base], moved)
        self.read(state, target, address, size, signed)

    def read(self, state: State, target: int, address: Value, size: int, signed: bool) -> None:
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
        value = _any(size, signed)
        if address.hi - address.lo <= 4096:
            cells = [
                self._cell(state, a, size, signed)[0]
                for a in range(address.lo, address.hi + 1, size)
            ]
            value = cells[0]
            for cell in cells[1:]:
                value = hull(value, cell)
            if (address.hi - address.lo) % size:
                value = _any(size, signed)
        state.set(target, value)

    def cell(self, state: State, address: int, size: int) -> Value:
        """The value of the cell of ``size`` bytes at ``address``, unsigned below a word."""
        return self._cell(state, address, size, signed=False)[0]

    def _cell(self, state: State, address: int, size: int, signed: bool) -> tuple[Value, bool]:
        """A cell's value, and whether it is a writable cell read with the size it was written."""
        data = self.image.bytes_at(address, size)
        if data is not None:
            number = int.from_bytes(data, "little", signed=signed or size == 4)
            return Value(number, number), False
        known, promise = state.memory.get(address), self.promises.at(address, size)
        if promise is not None and promise.volatile:
            return promise.value, False
        full = _any(size, signed)
        value = promise.value if promise is not None else full
        if known is not None and known[0] == size:
            value = known[1]
        if value.lo < full.lo or value.hi > full.hi:
            return full, False
        return value, True

    def _store(self, state: State, insn: CsInsn, size: int) -> None:
        operand = next(o for o in insn.operands if o.type == arm.ARM_OP_MEM)
        value = state.registers[NUMBER[insn.operands[0].reg]]
        address, moved = self._address(state, insn)
        self.write(state, address, size, value)
        if moved is not None:
            state.set(NUMBER[operand.mem.base], moved)

    def write(self, state: State, address: Value, size: int, value: Value) -> None:
        """Store into a cell, or into any cell in an interval of addresses."""
        if address.lo == address.hi:
            low = _any(size, signed=False)
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

    def _double(self, state: State, insn: CsInsn, *, load: bool) -> None:
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

    def _several(self, state: State, insn: CsInsn, name: str) -> None:
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


def _any(size: int, signed: bool) -> Value:
    if size == 4:
        return I32
    if signed:
        return Value(-(1 << (8 * size - 1)), (1 << (8 * size - 1)) - 1)
    return Value(0, (1 << (8 * size)) - 1)


def operand_value(state: State, insn: CsInsn, k: int) -> Value:
    """The value of a register or immediate operand, after its shift."""
    operand = insn.operands[k]
    if operand.type == arm.ARM_OP_IMM:
        return wrapped(Value(operand.imm, operand.imm))
    if operand.reg == arm.ARM_REG_PC:
        return Value(insn.address + 4, insn.address + 4)
    value = state.registers[NUMBER[operand.reg]]
    if operand.shift.type == arm.ARM_SFT_INVALID:
        return value
    if operand.shift.type in SHIFTS:
        return SHIFTS[operand.shift.type](value, operand.shift.value)
    return I32


def left(v: Value, n: int) -> Value:
    """v << n in 32 bits."""
    return wrapped(Value(v.lo << n, v.hi << n))


def right(v: Value, n: int) -> Value:
    """v >> n, arithmetic."""
    return Value(v.lo >> n, v.hi >> n)


def logical_right(v: Value, n: int) -> Value:
    """v >> n of the unsigned number."""
    if n == 0:
        return v
    if v.lo >= 0 or v.hi < 0:
        return Value((v.lo % WORD) >> n, (v.hi % WORD) >> n)
    return Value(0, (WORD - 1) >> n)


SHIFTS: dict[int, Callable[[Value, int], Value]] = {
    arm.ARM_SFT_LSL: left,
    arm.ARM_SFT_ASR: right,
    arm.ARM_SFT_LSR: logical_right,
}
SHIFT_NAMES = {"lsl": left, "asr": right, "lsr": logical_right}


def compute(state: State, insn: CsInsn, name: str) -> None:
    """Execute an instruction that changes only registers and flags."""
    if name in ("cmp", "cmn", "tst"):
        _compare(state, insn, name)
        return
    targets = [
        NUMBER[o.reg]
        for o in insn.operands
        if o.type == arm.ARM_OP_REG and o.access & CS_AC_WRITE and o.reg in NUMBER
    ]
    value, flags = _result(state, insn, name)
    if not targets:
        return
    for register in targets:
        state.set(register, I32 if len(targets) > 1 else value)
    # capstone says so of adc.w and sbc.w as well, which is sound
    if insn.update_flags:
        state.flags = flags
        if flags is not None and len(targets) == 1:
            a, b = flags.a_register, flags.b_register
            state.flags = Flags(
                flags.a,
                flags.b,
                -1 if a == targets[0] else a,
                -1 if b == targets[0] else b,
                targets[0],
                flags.borrow,
            )


def _compare(state: State, insn: CsInsn, name: str) -> None:
    a, b = operand_value(state, insn, 0), operand_value(state, insn, 1)
    if name == "tst":
        state.flags = Flags(_and(a, b), ZERO, borrow=False)
        return
    if name == "cmn":
        state.flags = None if b.lo <= I32.lo else Flags(a, negate(b), _register(insn, 0))
        if state.flags is not None and b.lo != b.hi:
            state.flags = None
        return
    state.flags = Flags(a, b, _register(insn, 0), _register(insn, 1))


def _register(insn: CsInsn, k: int) -> int:
    operand = insn.operands[k]
    plain = operand.type == arm.ARM_OP_REG and operand.shift.type == arm.ARM_SFT_INVALID
    return NUMBER.get(operand.reg, -1) if plain else -1


def _and(a: Value, b: Value) -> Value:
    if a.lo == a.hi and b.lo == b.hi:
        return Value(a.lo & b.lo, a.lo & b.lo)
    return wrapped(bitwise("&", a, b))


def _result(state: State, insn: CsInsn, name: str) -> tuple[Value, Flags | None]:
    """The value written, and the flags if they are set."""
    count = len(insn.operands)

    def get(k: int) -> Value:
        return operand_value(state, insn, k)

    if name in ("mov", "movs", "movw"):
        value = get(1)
        return value, Flags(value, ZERO, borrow=False)
    if name == "mvn":
        value = wrapped(add(negate(get(1)), Value(-1, -1)))
        return value, Flags(value, ZERO, borrow=False)
    if name in ("uxtb", "uxth", "sxtb", "sxth"):
        full = _any(1 if name.endswith("b") else 2, name[0] == "s")
        value = get(1)
        return (value if full.lo <= value.lo and value.hi <= full.hi else full), None
    if name == "ubfx":
        low, width = insn.operands[2].imm, insn.operands[3].imm
        value = logical_right(get(1), low)
        return (value if value.hi < 1 << width else Value(0, (1 << width) - 1)), None
    if name == "sbfx":
        half = 1 << (insn.operands[3].imm - 1)
        return Value(-half, half - 1), None
    if name in ("ssat", "usat"):
        bits = insn.operands[1].imm
        low, high = (
            (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if name[0] == "s" else (0, (1 << bits) - 1)
        )
        return get(2).limited(low, high), None
    if name == "clz":
        return Value(0, 32), None
    if name == "adr":
        return I32, None
    if count < 2 or insn.operands[0].type != arm.ARM_OP_REG:
        return I32, None
    first, second = (1, 2) if count > 2 else (0, 1)
    a, b = get(first), get(second)
    registers = (_register(insn, first), _register(insn, second))
    if name in ("add", "addw"):
        value = wrapped(add(a, b))
        return value, _sum_flags(value, add(a, b))
    if name in ("sub", "subw"):
        return wrapped(add(a, negate(b))), Flags(a, b, *registers)
    if name in ("rsb", "neg"):
        if name == "neg" or count == 2:
            return wrapped(negate(get(count - 1))), Flags(
                ZERO, get(count - 1), -1, _register(insn, count - 1)
            )
        return wrapped(add(b, negate(a))), Flags(b, a, registers[1], registers[0])
    if name in SHIFT_NAMES:
        value = I32
        if b.lo == b.hi and 0 <= b.lo < 32:
            value = SHIFT_NAMES[name](a, b.lo)
        elif name != "lsl" and a.lo >= 0 and b.lo >= 0:
            value = Value(0, a.hi)
        return value, Flags(value, ZERO, borrow=False)
    if name in ("and", "orr", "eor", "bic"):
        if name == "bic":
            b = add(negate(b), Value(-1, -1))
        if a.lo == a.hi and b.lo == b.hi:
            number = {
                "and": a.lo & b.lo,
                "bic": a.lo & b.lo,
                "orr": a.lo | b.lo,
                "eor": a.lo ^ b.lo,
            }[name]
            value = Value(number, number)
        else:
            operator = {"and": "&", "bic": "&", "orr": "|", "eor": "^"}[name]
            value = wrapped(bitwise(operator, a, b))
        return value, Flags(value, ZERO, borrow=False)
    if name == "mul":
        value = wrapped(multiply(a, b))
        return value, Flags(value, ZERO, borrow=False)
    return I32, None


def _sum_flags(value: Value, exact: Value) -> Flags | None:
    """Flags after an addition: Z and N follow the result; nothing on the order if it overflows."""
    if I32.lo <= exact.lo and exact.hi <= I32.hi:
        return Flags(value, ZERO, borrow=False)
    return None if value == I32 else Flags(value, ZERO, borrow=False)
