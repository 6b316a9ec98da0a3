"""Effect of Thumb instructions on registers and flags (Armv6-M and Armv7-M manuals, A6/A7).

An instruction that is not modelled leaves any value in its targets.
"""

from collections.abc import Callable
from dataclasses import dataclass

from capstone import CS_AC_WRITE, CsInsn, arm

from canroll.codegen.operations.intervals import Value, add, bitwise, multiply, negate
from canroll.codegen.worst_case.conditions import ZERO
from canroll.codegen.worst_case.machine_state import I32, Flags, MachineState, wrapped

NUMBER = {
    **{getattr(arm, f"ARM_REG_R{k}"): k for k in range(13)},
    arm.ARM_REG_SP: 13,
    arm.ARM_REG_LR: 14,
    arm.ARM_REG_PC: 15,
}
WORD = 1 << 32


def any_value(size: int, signed: bool) -> Value:
    """What a cell of ``size`` bytes can hold."""
    if size == 4:
        return I32
    if signed:
        return Value(-(1 << (8 * size - 1)), (1 << (8 * size - 1)) - 1)
    return Value(0, (1 << (8 * size)) - 1)


def operand_value(state: MachineState, insn: CsInsn, k: int) -> Value:
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


def compute(state: MachineState, insn: CsInsn, name: str) -> None:
    """Execute an instruction that changes only registers and flags."""
    if name in ("cmp", "cmn", "tst"):
        _compare(state, insn, name)
        return
    # capstone says of a product's factor that is its target too that it is written twice
    targets = list(
        dict.fromkeys(
            NUMBER[o.reg]
            for o in insn.operands
            if o.type == arm.ARM_OP_REG and o.access & CS_AC_WRITE and o.reg in NUMBER
        )
    )
    value, flags = _result(state, insn, name)
    if not targets:
        # such as teq, which is not modelled
        state.flags = None
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


def _compare(state: MachineState, insn: CsInsn, name: str) -> None:
    a, b = operand_value(state, insn, 0), operand_value(state, insn, 1)
    if name == "tst":
        state.flags = Flags(_and(a, b), ZERO, borrow=False)
        return
    if name == "cmn":
        # not of 0: the carry of a + 0 is not that of a - 0
        known = b.lo == b.hi and b.lo not in (0, I32.lo)
        state.flags = Flags(a, negate(b), _register(insn, 0)) if known else None
        return
    state.flags = Flags(a, b, _register(insn, 0), _register(insn, 1))


def _register(insn: CsInsn, k: int) -> int:
    operand = insn.operands[k]
    plain = operand.type == arm.ARM_OP_REG and operand.shift.type == arm.ARM_SFT_INVALID
    return NUMBER.get(operand.reg, -1) if plain else -1


def _and(a: Value, b: Value) -> Value:
    return _bits("&", a, b)


def _bits(operator: str, a: Value, b: Value) -> Value:
    """a operator b in 32 bits."""
    if a.lo == a.hi and b.lo == b.hi:
        number = {"&": a.lo & b.lo, "|": a.lo | b.lo, "^": a.lo ^ b.lo}[operator]
        return Value(number, number)
    return wrapped(bitwise(operator, a, b))


Effect = tuple[Value, Flags | None]
"""The value written, and the flags if they are set."""


@dataclass(frozen=True, slots=True)
class Operands:
    """The operands of an instruction in a state; ``a`` and ``b`` are its two sources."""

    state: MachineState
    insn: CsInsn

    def value(self, k: int) -> Value:
        """Operand ``k``."""
        return operand_value(self.state, self.insn, k)

    def immediate(self, k: int) -> int:
        """Operand ``k``, a number in the instruction."""
        return int(self.insn.operands[k].imm)

    @property
    def first(self) -> int:
        """The number of the first source: the target where no other is named."""
        return 1 if len(self.insn.operands) > 2 else 0

    @property
    def a(self) -> Value:
        """The first source."""
        return self.value(self.first)

    @property
    def b(self) -> Value:
        """The second source."""
        return self.value(self.first + 1)

    @property
    def registers(self) -> tuple[int, int]:
        """Registers of the two sources, -1 where one is none."""
        return _register(self.insn, self.first), _register(self.insn, self.first + 1)


def _signs(value: Value) -> Effect:
    """A result that sets only N and Z."""
    return value, Flags(value, ZERO, borrow=False)


def _complement(v: Value) -> Value:
    return add(negate(v), Value(-1, -1))


def _extended(operands: Operands, size: int, signed: bool) -> Effect:
    full, value = any_value(size, signed), operands.value(1)
    return (value if full.lo <= value.lo and value.hi <= full.hi else full), None


def _unsigned_field(operands: Operands) -> Effect:
    low, width = operands.immediate(2), operands.immediate(3)
    value = logical_right(operands.value(1), low)
    field = Value(0, (1 << width) - 1)
    return (value if value.within(field.lo, field.hi) else wrapped(field)), None


def _signed_field(operands: Operands) -> Effect:
    half = 1 << (operands.immediate(3) - 1)
    return Value(-half, half - 1), None


def _saturated(operands: Operands, signed: bool) -> Effect:
    top = (1 << (operands.immediate(1) - signed)) - 1
    return operands.value(2).limited(-top - 1 if signed else 0, top), None


def _sum(operands: Operands) -> Effect:
    exact = add(operands.a, operands.b)
    value = wrapped(exact)
    return value, _sum_flags(value, exact)


def _difference(operands: Operands) -> Effect:
    a, b = operands.a, operands.b
    return wrapped(add(a, negate(b))), Flags(a, b, *operands.registers)


def _reversed(operands: Operands) -> Effect:
    a, b = operands.a, operands.b
    one, other = operands.registers
    return wrapped(add(b, negate(a))), Flags(b, a, other, one)


def _negated(operands: Operands) -> Effect:
    last = len(operands.insn.operands) - 1
    value = operands.value(last)
    return wrapped(negate(value)), Flags(ZERO, value, -1, _register(operands.insn, last))


def _reverse_subtraction(operands: Operands) -> Effect:
    return (_negated if len(operands.insn.operands) == 2 else _reversed)(operands)


def _shifted(operands: Operands, name: str) -> Effect:
    a, b = operands.a, operands.b
    value = I32
    if b.lo == b.hi and 0 <= b.lo < 32:
        value = SHIFT_NAMES[name](a, b.lo)
    elif name != "lsl" and a.lo >= 0 and b.lo >= 0:
        value = Value(0, a.hi)
    return _signs(value)


SINGLE: dict[str, Callable[[Operands], Effect]] = {
    **dict.fromkeys(("mov", "movs", "movw"), lambda o: _signs(o.value(1))),
    "mvn": lambda o: _signs(wrapped(_complement(o.value(1)))),
    "uxtb": lambda o: _extended(o, 1, signed=False),
    "uxth": lambda o: _extended(o, 2, signed=False),
    "sxtb": lambda o: _extended(o, 1, signed=True),
    "sxth": lambda o: _extended(o, 2, signed=True),
    "ubfx": _unsigned_field,
    "sbfx": _signed_field,
    "ssat": lambda o: _saturated(o, signed=True),
    "usat": lambda o: _saturated(o, signed=False),
    "clz": lambda o: (Value(0, 32), None),
}
"""Effects of instructions with one source."""
DOUBLE: dict[str, Callable[[Operands], Effect]] = {
    **dict.fromkeys(("add", "addw"), _sum),
    **dict.fromkeys(("sub", "subw"), _difference),
    "rsb": _reverse_subtraction,
    "neg": _negated,
    "lsl": lambda o: _shifted(o, "lsl"),
    "asr": lambda o: _shifted(o, "asr"),
    "lsr": lambda o: _shifted(o, "lsr"),
    "and": lambda o: _signs(_bits("&", o.a, o.b)),
    "orr": lambda o: _signs(_bits("|", o.a, o.b)),
    "eor": lambda o: _signs(_bits("^", o.a, o.b)),
    "bic": lambda o: _signs(_bits("&", o.a, _complement(o.b))),
    "mul": lambda o: _signs(wrapped(multiply(o.a, o.b))),
    "mla": lambda o: (wrapped(add(multiply(o.a, o.b), o.value(3))), None),
}
"""Effects of instructions with two sources, or with one that is the target too."""


def _result(state: MachineState, insn: CsInsn, name: str) -> Effect:
    """The effect of an instruction; nothing is known of one that is not modelled."""
    operands = Operands(state, insn)
    if name in SINGLE:
        return SINGLE[name](operands)
    if name in DOUBLE and len(insn.operands) >= 2 and insn.operands[0].type == arm.ARM_OP_REG:
        return DOUBLE[name](operands)
    return I32, None


def _sum_flags(value: Value, exact: Value) -> Flags | None:
    """Flags after an addition: Z and N follow the result; nothing on the order if it overflows."""
    if I32.lo <= exact.lo and exact.hi <= I32.hi:
        return Flags(value, ZERO, borrow=False)
    return None if value == I32 else Flags(value, ZERO, borrow=False)
