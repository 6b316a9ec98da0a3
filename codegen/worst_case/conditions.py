"""Condition codes: whether one can hold, and how it restricts the compared registers."""

import ast

from capstone import arm

from canroll.codegen.operations.intervals import Value, add, negate
from canroll.codegen.operations.relations import narrow
from canroll.codegen.worst_case.machine_state import I32, Flags, MachineState

EQ, NE, HS, LO, MI, PL = (
    arm.ARM_CC_EQ,
    arm.ARM_CC_NE,
    arm.ARM_CC_HS,
    arm.ARM_CC_LO,
    arm.ARM_CC_MI,
    arm.ARM_CC_PL,
)
HI, LS, GE, LT, GT, LE = (
    arm.ARM_CC_HI,
    arm.ARM_CC_LS,
    arm.ARM_CC_GE,
    arm.ARM_CC_LT,
    arm.ARM_CC_GT,
    arm.ARM_CC_LE,
)
OPPOSITE = {EQ: NE, HS: LO, MI: PL, HI: LS, GE: LT, GT: LE}
OPPOSITE |= {b: a for a, b in OPPOSITE.items()}
FLIPPED = {GE: LE, LE: GE, GT: LT, LT: GT, EQ: EQ, NE: NE}
"""The condition on (b, a) that says what one on (a, b) does."""
RELATIONS: dict[int, type[ast.cmpop]] = {
    EQ: ast.Eq,
    NE: ast.NotEq,
    GE: ast.GtE,
    LT: ast.Lt,
    GT: ast.Gt,
    LE: ast.LtE,
}
ZERO = Value(0, 0)


def where(state: MachineState, condition: int) -> MachineState | None:
    """Return ``state`` restricted to ``condition``; None if it cannot hold.

    The state is restricted in place: pass a copy if the other branch is still to be followed.
    """
    flags = state.flags
    if flags is None or condition not in OPPOSITE:
        return state
    if condition in (MI, PL):
        return _sign(state, flags, condition)
    if condition in (HS, LO, HI, LS):
        return _unsigned(state, flags, condition) if flags.borrow else state
    if condition in (EQ, NE) or flags.borrow:
        return _signed(state, flags, condition)
    return state


def _signed(state: MachineState, flags: Flags, condition: int) -> MachineState | None:
    a, b = flags.a, flags.b
    if narrow(RELATIONS[condition], a, b) is None:
        return None
    if not _restrict(state, flags.a_register, a, b, condition):
        return None
    if not _restrict(state, flags.b_register, b, a, FLIPPED[condition]):
        return None
    if flags.result >= 0 and condition in (EQ, NE):
        value = state.registers[flags.result]
        if not _restrict(state, flags.result, value, ZERO, condition):
            return None
    return state


def _restrict(state: MachineState, register: int, a: Value, b: Value, condition: int) -> bool:
    """Restrict the register that holds a to ``a condition b``; return False if that is empty."""
    if register < 0:
        return True
    limits = narrow(RELATIONS[condition], a if condition == NE else I32, b)
    return limits is not None and state.narrow(register, limits.lo, limits.hi)


def _sign(state: MachineState, flags: Flags, condition: int) -> MachineState | None:
    """N is the sign of a - b in 32 bits."""
    difference = add(flags.a, negate(flags.b))
    if difference.lo < I32.lo or difference.hi > I32.hi:
        return state
    # without overflow the sign of the difference is the order of the two
    return _signed(state, flags, LT if condition == MI else GE)


def _unsigned(state: MachineState, flags: Flags, condition: int) -> MachineState | None:
    a, b = _as_unsigned(flags.a), _as_unsigned(flags.b)
    signed = {HS: GE, LO: LT, HI: GT, LS: LE}[condition]
    if narrow(RELATIONS[signed], a, b) is None:
        return None
    # below a bound that is no sign bit, a value is the same signed and unsigned
    if signed in (LT, LE) and b.hi <= I32.hi and flags.a_register >= 0:
        if not state.narrow(flags.a_register, 0, b.hi - (signed == LT)):
            return None
    elif signed in (GE, GT) and flags.a.lo >= 0 and flags.a_register >= 0:
        return state if state.narrow(flags.a_register, b.lo + (signed == GT), I32.hi) else None
    return state


def _as_unsigned(v: Value) -> Value:
    if v.lo >= 0:
        return v
    if v.hi < 0:
        return Value(v.lo + (1 << 32), v.hi + (1 << 32))
    return Value(0, (1 << 32) - 1)
