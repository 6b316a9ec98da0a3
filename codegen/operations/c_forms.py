"""Operations as C: each in the narrowest form that the intervals of its operands allow.

Each function takes the interval of the result and the operands.
"""

from dataclasses import replace

from canroll.codegen.operations.c_expression import (
    PRIMARY,
    Expression,
    as_byte,
    binary,
    converted,
    fits,
    signed,
    unsigned,
    widened,
)
from canroll.codegen.operations.intervals import BITS_31, KINDS, Value, shift_rounded


def right_shift(seen: Value, a: Expression, b: Expression) -> Expression:
    """``a >> b``; C leaves open what a shift by the width of its operand does."""
    return binary(">>", widened(a) if b.value.hi >= 32 and not a.wide else a, b, seen)


def left_shift(seen: Value, a: Expression, b: Expression) -> Expression:
    """``a << b``; that of a possibly negative value becomes a product."""
    far = b.value.hi >= 32 and not a.wide
    narrow = a.value.lo >= 0 and fits(seen, "i32")
    if not far and (narrow or (a.kind == "u32" and fits(seen, "u32"))):
        return binary("<<", a, b, seen)
    count = f"((int64_t)1 << {b.inside(PRIMARY)})"
    if a.kind == "literal" and a.value == Value(1, 1):
        return Expression(count, PRIMARY, "i64", seen)
    factor = Expression(count, PRIMARY, "i64", Value(1 << b.value.lo, 1 << b.value.hi))
    return binary("*", a, factor, seen)


def byte(seen: Value, a: Expression) -> Expression:
    """The low eight bits."""
    return converted(a, "u8") if fits(a.value, "u8") else as_byte(a)


def to_u32(seen: Value, a: Expression) -> Expression:
    """The 32 bits without a sign."""
    return replace(unsigned(a), value=seen)


def to_i32(seen: Value, a: Expression) -> Expression:
    """The 32 bits with a sign."""
    return Expression(f"canroll_to_i32({a.text})", PRIMARY, "i32", seen)


def narrow(seen: Value, a: Expression) -> Expression:
    """A cast."""
    return converted(_signed(a), "i32")


def quotient(seen: Value, a: Expression, b: Expression) -> Expression:
    """A division, which C rounds towards zero."""
    return binary("/", _signed(a), _signed(b), seen)


def absolute(seen: Value, a: Expression) -> Expression:
    """A magnitude, in 32 bits where it fits them."""
    a = _signed(a)
    if a.value.lo >= 0:
        return a
    if a.wide or not fits(seen, "i32"):
        return Expression(f"canroll_abs({a.text})", PRIMARY, "i64", seen)
    return Expression(f"canroll_abs32({a.text})", PRIMARY, "i32", seen)


def rounded(seen: Value, a: Expression, count: Expression) -> Expression:
    """A rounding shift."""
    a = _signed(a)
    half = 1 << (max(count.value.hi, 1) - 1)
    room = fits(Value(a.value.lo, a.value.hi + half), "i32")
    if not a.wide and count.value.hi <= 31 and (room or count.value.lo >= 2):
        text = f"canroll_rsh32{'' if room else '_by'}({a.text}, {count.text})"
        return Expression(text, PRIMARY, "i32", seen)
    known = count.kind == "literal"
    text = f"canroll_rsh{'' if known else '_by'}({a.text}, {count.text})"
    return Expression(text, PRIMARY, "i64", seen)


def scaled(seen: Value, a: Expression, count: Expression) -> Expression:
    """A rounding shift to 31 bits, limited where that is needed."""
    a = _signed(a)
    result = shift_rounded(a.value, count.value)
    if a.wide and not result.within(*BITS_31):
        return Expression(f"canroll_scaled({a.text}, {count.text})", PRIMARY, "i32", seen)
    return sat31(seen, rounded(result, a, count))


def sat31(seen: Value, a: Expression) -> Expression:
    """Limited to 31 bits, where it can exceed them."""
    a = _signed(a)
    if a.value.within(*BITS_31):
        return converted(a, "i32")
    return Expression(f"canroll_sat31{'' if a.wide else '_32'}({a.text})", PRIMARY, "i32", seen)


def sat32(seen: Value, a: Expression) -> Expression:
    """Limited to 32 bits, where it can exceed them."""
    a = _signed(a)
    if a.value.within(*KINDS["i32"]):
        return converted(a, "i32")
    return Expression(f"canroll_sat32({a.text})", PRIMARY, "i32", seen)


def clamp(seen: Value, a: Expression, low: Expression, high: Expression) -> Expression:
    """Limited, with only those bounds that ``a`` can exceed.

    One that is a local stays where the other does: else nothing might read the local.
    """
    a = _signed(a)
    above, below = a.value.hi > high.value.lo, a.value.lo < low.value.hi
    if not above and not below:
        return converted(a, "i32")
    above |= _is_local(high)
    below |= _is_local(low)
    width = "" if a.wide else "32"
    if above and below:
        text = f"canroll_clamp{width}({a.text}, {low.text}, {high.text})"
    elif above:
        text = f"canroll_at_most{width}({a.text}, {high.text})"
    else:
        text = f"canroll_at_least{width}({a.text}, {low.text})"
    return Expression(text, PRIMARY, "i32", seen)


def _is_local(e: Expression) -> bool:
    return e.text.isidentifier() and e.text.islower()


def _signed(e: Expression) -> Expression:
    return widened(e) if e.kind == "u32" else signed(e)
