"""C expressions: text, precedence, C type and interval; conversions between C types."""

from dataclasses import dataclass

from canroll.codegen.operations.intervals import KINDS, Value

C_TYPES = {
    "i32": "int32_t",
    "i64": "int64_t",
    "u8": "uint8_t",
    "u16": "uint16_t",
    "u32": "uint32_t",
}
HELD = {
    "literal": C_TYPES.keys() - {"u16", "u32"},
    "u8": C_TYPES.keys(),
    "u16": {"u16", "u32", "i32", "i64"},
    "u32": {"u32", "i64"},
    "i32": {"i32", "i64"},
    "i64": {"i64"},
}
"""Types that hold a type's values without a cast."""
PRIMARY, UNARY, PRODUCT, SUM, SHIFT, RELATION, EQUALITY, AND, XOR, OR, BOTH, EITHER = range(12)
PRECEDENCE = {
    "*": PRODUCT,
    "/": PRODUCT,
    "+": SUM,
    "-": SUM,
    "<<": SHIFT,
    ">>": SHIFT,
    "<": RELATION,
    "<=": RELATION,
    ">": RELATION,
    ">=": RELATION,
    "==": EQUALITY,
    "!=": EQUALITY,
    "&": AND,
    "^": XOR,
    "|": OR,
    "&&": BOTH,
    "||": EITHER,
}


@dataclass(frozen=True, slots=True)
class Expression:
    """C text, how tightly it binds, its C type ("literal" for a constant) and its interval."""

    text: str
    level: int
    kind: str
    value: Value

    @property
    def wide(self) -> bool:
        """Whether C computes it in 64 bits."""
        return self.kind == "i64"

    def inside(self, level: int) -> str:
        """The text as an operand of something that binds at ``level``."""
        return self.text if self.level <= level else f"({self.text})"


def fits(value: Value, kind: str) -> bool:
    """Whether all of ``value`` can be stored in ``kind``."""
    return value.within(*KINDS[kind])


def literal(number: int) -> Expression:
    """An integer constant."""
    value = Value(number, number)
    if number == KINDS["i32"][0]:
        return Expression("INT32_MIN", PRIMARY, "literal", value)
    if fits(value, "i32"):
        return Expression(str(number), PRIMARY if number >= 0 else UNARY, "literal", value)
    return Expression(f"INT64_C({number})", PRIMARY, "i64", value)


def widened(e: Expression) -> Expression:
    """``e`` in 64 bits."""
    if e.wide:
        return e
    if e.kind == "u32" and e.level > UNARY:
        return Expression(f"canroll_wide_u32({e.text})", PRIMARY, "i64", e.value)
    if e.level > UNARY:
        return Expression(f"canroll_wide({e.text})", PRIMARY, "i64", e.value)
    return Expression(f"(int64_t){e.text}", UNARY, "i64", e.value)


def converted(e: Expression, kind: str) -> Expression:
    """``e``, known to fit ``kind``, with a cast where C would narrow it."""
    if kind == "u32":
        return unsigned(e)
    # a result of operators is not stored in a wider type as it is (MISRA 10.6)
    if kind == "i64" and e.level > UNARY:
        return widened(e)
    if kind in HELD[e.kind]:
        return e
    if kind == "u8" and e.level > UNARY:
        return as_byte(e)
    if e.kind == "u32" and kind == "i32" and e.level > UNARY:
        return Expression(f"canroll_to_i32({e.text})", PRIMARY, "i32", e.value)
    if kind == "u16" and e.level > UNARY:
        e = unsigned(e)
    return Expression(f"({C_TYPES[kind]}){e.inside(UNARY)}", UNARY, kind, e.value)


def as_byte(e: Expression) -> Expression:
    """The low eight bits of ``e``."""
    value = e.value if fits(e.value, "u8") else Value(0, 255)
    if e.kind == "u32":
        return Expression(f"(uint8_t)({e.inside(UNARY)} & 255u)", UNARY, "u8", value)
    return Expression(f"canroll_byte{'64' if e.wide else ''}({e.text})", PRIMARY, "u8", value)


def binary(operator: str, a: Expression, b: Expression, value: Value) -> Expression:
    """``a operator b`` computed in 32 bits where its value fits, else in 64."""
    level = PRECEDENCE[operator]
    if "u32" in (a.kind, b.kind):
        if all(fits(each, "u32") for each in (a.value, b.value, value)):
            return _joined(operator, unsigned(a), unsigned(b), "u32", value)
        a, b = widened(a), widened(b)
    if not (a.wide or b.wide) and not fits(value, "i32"):
        a = widened(a)
    if {a.kind, b.kind} != {"u8"} or level not in (RELATION, EQUALITY):
        a, b = signed(a), signed(b)
    kind = "i64" if a.wide or b.wide else "i32"
    if kind == "i64":
        a, b = (widened(e) if e.level > UNARY else e for e in (a, b))
    return _joined(operator, a, b, kind, value)


def _joined(operator: str, a: Expression, b: Expression, kind: str, value: Value) -> Expression:
    """``a operator b`` as ``kind``, with brackets round operands that have operators too."""
    level = PRECEDENCE[operator]
    chain = a.level == level and level not in (SHIFT, RELATION, EQUALITY)
    left = a.text if chain else a.inside(UNARY)
    return Expression(f"{left} {operator} {b.inside(UNARY)}", level, kind, value)


def unsigned(e: Expression) -> Expression:
    """``e``, known to fit an unsigned 32-bit integer, as one."""
    if e.kind == "u32":
        return e
    if e.kind in ("literal", "i64") and e.text.removeprefix("INT64_C(").rstrip(")").isdigit():
        return Expression(f"{e.value.lo}u", PRIMARY, "u32", e.value)
    if e.level > UNARY and not e.wide:
        return Expression(f"canroll_to_u32({e.text})", PRIMARY, "u32", e.value)
    return Expression(f"(uint32_t){e.inside(UNARY)}", UNARY, "u32", e.value)


def signed(e: Expression) -> Expression:
    """``e`` as an operand of signed arithmetic."""
    if e.kind not in ("u8", "u16"):
        return e
    return Expression(f"(int32_t){e.inside(UNARY)}", UNARY, "i32", e.value)
