"""Condition codes: whether one can hold, and how it restricts the compared registers."""

from capstone import arm

from codegen.proof.intervals import Value, add, negate
from codegen.worst_case.machine_state import I32, Flags, State

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
ZERO = Value(0, 0)


def where(state: State, condition: int) -> State | None:
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


def _signed(state: State, flags: Flags, condition: int) -> State | None:
    a, b = flags.a, flags.b
    if not _possible(a, b, condition):
        return None
    low, high = _limits(a, b, condition)
    if flags.a_register >= 0 and not state.narrow(flags.a_register, low, high):
        return None
    low, high = _limits(b, a, FLIPPED[condition])
    if flags.b_register >= 0 and not state.narrow(flags.b_register, low, high):
        return None
    if flags.result >= 0 and condition in (EQ, NE):
        low, high = _limits(state.registers[flags.result], ZERO, condition)
        if not state.narrow(flags.result, low, high):
            return None
    return state


def _possible(a: Value, b: Value, condition: int) -> bool:
    if condition == EQ:
        return a.lo <= b.hi and b.lo <= a.hi
    if condition == NE:
        return not a.lo == a.hi == b.lo == b.hi
    if condition == GE:
        return a.hi >= b.lo
    if condition == GT:
        return a.hi > b.lo
    if condition == LE:
        return a.lo <= b.hi
    return a.lo < b.hi


def _limits(a: Value, b: Value, condition: int) -> tuple[int, int]:
    """The limits of a for which ``a condition b`` can hold."""
    if condition == EQ:
        return b.lo, b.hi
    if condition == NE:
        if b.lo != b.hi:
            return a.lo, a.hi
        return a.lo + (a.lo == b.lo), a.hi - (a.hi == b.lo)
    if condition == GE:
        return b.lo, I32.hi
    if condition == GT:
        return b.lo + 1, I32.hi
    if condition == LE:
        return I32.lo, b.hi
    return I32.lo, b.hi - 1


def _sign(state: State, flags: Flags, condition: int) -> State | None:
    """N is the sign of a - b in 32 bits."""
    difference = add(flags.a, negate(flags.b))
    if difference.lo < I32.lo or difference.hi > I32.hi:
        return state
    # without overflow the sign of the difference is the order of the two
    return _signed(state, flags, LT if condition == MI else GE)


def _unsigned(state: State, flags: Flags, condition: int) -> State | None:
    a, b = _as_unsigned(flags.a), _as_unsigned(flags.b)
    signed = {HS: GE, LO: LT, HI: GT, LS: LE}[condition]
    if not _possible(a, b, signed):
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
