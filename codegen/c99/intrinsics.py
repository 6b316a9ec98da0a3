"""The intrinsics as C: each in the narrowest form that its operands' intervals allow."""

from dataclasses import replace

from codegen.c99.text import (
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
from codegen.proof.intervals import Value, shift_rounded
from codegen.subset.program import BITS_31, KINDS


def intrinsic(name: str, a: list[Expression], bounds: list[str], seen: Value) -> Expression:
    """The intrinsic ``name`` of ``a``; ``bounds`` are the texts of the operands after the first.

    ``seen`` is the interval of the result.
    """
    if name == "byte":
        return converted(a[0], "u8") if fits(a[0].value, "u8") else as_byte(a[0])
    if name == "to_u32":
        return replace(unsigned(a[0]), value=seen)
    if name == "to_i32":
        return Expression(f"canroll_to_i32({a[0].text})", PRIMARY, "i32", seen)
    a = [widened(e) if e.kind == "u32" else signed(e) for e in a]
    if name == "narrow":
        return converted(a[0], "i32")
    if name == "tdiv":
        return binary("/", a[0], a[1], seen)
    if name == "rsh":
        return _rounded(a, bounds[0], seen)
    if name == "scaled":
        return _scaled(a, bounds[0], seen)
    if name in ("sat32", "sat31"):
        return _saturated(name, a[0], seen)
    return _limited(a, bounds, seen)


def _rounded(a: list[Expression], count: str, seen: Value) -> Expression:
    half = 1 << (max(a[1].value.hi, 1) - 1)
    room = fits(Value(a[0].value.lo, a[0].value.hi + half), "i32")
    known = a[1].kind == "literal"
    if not a[0].wide and (room or a[1].value.within(2, 31)):
        text = f"canroll_rsh32{'' if room else '_by'}({a[0].text}, {count})"
        return Expression(text, PRIMARY, "i32", seen)
    text = f"canroll_rsh{'' if known else '_by'}({a[0].text}, {count})"
    return Expression(text, PRIMARY, "i64", seen)


def _scaled(a: list[Expression], count: str, seen: Value) -> Expression:
    """A rounding shift to 31 bits, limited where that is needed."""
    result = shift_rounded(a[0].value, a[1].value)
    if a[0].wide and not result.within(*BITS_31):
        return Expression(f"canroll_scaled({a[0].text}, {count})", PRIMARY, "i32", seen)
    return _saturated("sat31", _rounded(a, count, result), seen)


def _saturated(name: str, e: Expression, seen: Value) -> Expression:
    if e.value.within(*(BITS_31 if name == "sat31" else KINDS["i32"])):
        return converted(e, "i32")
    width = "" if e.wide or name == "sat32" else "_32"
    return Expression(f"canroll_{name}{width}({e.text})", PRIMARY, "i32", seen)


def _limited(a: list[Expression], bounds: list[str], seen: Value) -> Expression:
    """A clamp, with only those bounds that ``a[0]`` can exceed."""
    value, low, high = (e.value for e in a)
    above, below = value.hi > high.lo, value.lo < low.hi
    if not above and not below:
        return converted(a[0], "i32")
    width = "" if a[0].wide else "32"
    if above and below:
        text = f"canroll_clamp{width}({a[0].text}, {bounds[0]}, {bounds[1]})"
    elif above:
        text = f"canroll_at_most{width}({a[0].text}, {bounds[1]})"
    else:
        text = f"canroll_at_least{width}({a[0].text}, {bounds[0]})"
    return Expression(text, PRIMARY, "i32", seen)
