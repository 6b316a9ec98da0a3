"""C text: precedence, literals, comments, line breaks, the runtime header."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from codegen.proof.intervals import Value
from codegen.subset.program import KINDS

WIDTH = 100
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

RUNTIME = """\
/* What the firmware needs of the machine: fixed-width integers and operations on them. */
#ifndef CANROLL_RUNTIME_H
#define CANROLL_RUNTIME_H

#include <stdint.h>

/* The code relies on a right shift that keeps the sign, as every target's compiler has it. */
#if (-1 >> 1) != -1
#error "the right shift of a negative number must keep its sign"
#endif

/* v, limited to [lo, hi]. */
static inline int32_t canroll_clamp(int64_t v, int32_t lo, int32_t hi)
{
    return (v > hi) ? hi : ((v < lo) ? lo : (int32_t)v);
}

/* v, limited to [lo, hi], where v has 32 bits. */
static inline int32_t canroll_clamp32(int32_t v, int32_t lo, int32_t hi)
{
    return (v > hi) ? hi : ((v < lo) ? lo : v);
}

/* v, which is known not to be below the range of int32_t, limited to at most hi. */
static inline int32_t canroll_at_most(int64_t v, int32_t hi)
{
    return (v > hi) ? hi : (int32_t)v;
}

/* v, which is known not to be above the range of int32_t, limited to at least lo. */
static inline int32_t canroll_at_least(int64_t v, int32_t lo)
{
    return (v < lo) ? lo : (int32_t)v;
}

/* The same where v has 32 bits. */
static inline int32_t canroll_at_most32(int32_t v, int32_t hi)
{
    return (v > hi) ? hi : v;
}

static inline int32_t canroll_at_least32(int32_t v, int32_t lo)
{
    return (v < lo) ? lo : v;
}

/* v, limited to the range of int32_t. */
static inline int32_t canroll_sat32(int64_t v)
{
    int32_t low = (int32_t)v;
    return (low == v) ? low : ((v < 0) ? INT32_MIN : INT32_MAX);
}

/* v, limited to 31 bits: -2^30 to 2^30 - 1. An ARM has an instruction for it. */
static inline int32_t canroll_sat31_32(int32_t v)
{
    return (v > 0x3FFFFFFF) ? 0x3FFFFFFF : ((v < -0x40000000) ? -0x40000000 : v);
}

/* The same where v has 64 bits. */
static inline int32_t canroll_sat31(int64_t v)
{
    return canroll_sat31_32(canroll_sat32(v));
}

/* v / 2^n rounded to nearest, halves upwards, for a constant n; 1 <= n <= 62. */
static inline int64_t canroll_rsh(int64_t v, int32_t n)
{
    return (v + ((int64_t)1 << (n - 1))) >> n;
}

/* The same for an n that the compiler doesn't know: one long shift instead of two. */
static inline int64_t canroll_rsh_by(int64_t v, int32_t n)
{
    return ((v >> (n - 1)) + 1) >> 1;
}

/* v / 2^n rounded to nearest, halves upwards, where v has 32 bits and room for the rounding. */
static inline int32_t canroll_rsh32(int32_t v, int32_t n)
{
    return (v + ((int32_t)1 << (n - 1))) >> n;
}

/* The same for any v; 2 <= n <= 31. */
static inline int32_t canroll_rsh32_by(int32_t v, int32_t n)
{
    return ((v >> (n - 1)) + 1) >> 1;
}

/* v / 2^n rounded to nearest, halves upwards, and limited to 31 bits; 1 <= n <= 62. */
static inline int32_t canroll_scaled(int64_t v, int32_t n)
{
    return canroll_sat32((v >> (n - 1)) + 1) >> 1;
}

/* A word of a record, whatever fields lie in it. */
#if defined(__GNUC__)
typedef int32_t canroll_any_word __attribute__((may_alias));
#else
typedef int32_t canroll_any_word;
#endif

/* The low eight bits of v. */
static inline uint8_t canroll_byte(int32_t v)
{
    return (uint8_t)((uint32_t)v & 255u);
}

/* The same where v has 64 bits. */
static inline uint8_t canroll_byte64(int64_t v)
{
    return (uint8_t)((uint64_t)v & 255u);
}

/* v in 64 bits. */
static inline int64_t canroll_wide(int32_t v)
{
    return v;
}

/* The same where v has no sign. */
static inline int64_t canroll_wide_u32(uint32_t v)
{
    return v;
}

/* v, which is known not to be negative, or its 32 bits. */
static inline uint32_t canroll_to_u32(int32_t v)
{
    return (uint32_t)v;
}

/* The number that has the 32 bits of v. */
static inline int32_t canroll_to_i32(uint32_t v)
{
    const uint32_t low = v & 0x7FFFFFFFu;
    return (low == v) ? (int32_t)v : ((int32_t)low + INT32_MIN);
}

/* Make a record of so many bytes, whole words, zero. */
static inline void canroll_clear(void *record, uint32_t bytes)
{
    volatile canroll_any_word *word = (volatile canroll_any_word *)record;
    for (uint32_t k = 0u; k < (bytes / 4u); k++) {
        word[k] = 0;
    }
}

/* Element k of a record read as an array of words. */
static inline int32_t canroll_word(const void *record, int32_t k)
{
    return ((const canroll_any_word *)record)[k];
}

/* Element k of a record read as an array of bytes. */
static inline uint8_t canroll_octet(const void *record, int32_t k)
{
    return ((const uint8_t *)record)[k];
}

/* The same of a record that an interrupt may write. */
static inline int32_t canroll_shared_word(const volatile void *record, int32_t k)
{
    return ((const volatile canroll_any_word *)record)[k];
}

static inline uint8_t canroll_shared_octet(const volatile void *record, int32_t k)
{
    return ((const volatile uint8_t *)record)[k];
}

/* Byte k of a record becomes v. */
static inline void canroll_set_octet(void *record, int32_t k, uint8_t v)
{
    ((uint8_t *)record)[k] = v;
}

/* Word k of a record becomes v. */
static inline void canroll_set_word(void *record, int32_t k, int32_t v)
{
    ((canroll_any_word *)record)[k] = v;
}

#endif
"""

OPEN_C = ["", "#ifdef __cplusplus", 'extern "C" {', "#endif"]
CLOSE_C = ["", "#ifdef __cplusplus", "}", "#endif"]
"""What makes declarations those of C where C++ reads them."""

_ASCII = str.maketrans(
    {
        "·": ".",
        "…": "...",
        "²": "^2",
        "³": "^3",
        "°": "deg",
        "−": "-",
        "–": "-",
        "±": "+-",
        "≤": "<=",
        "≥": ">=",
        "×": "x",
        "φ": "phi",
        "ε": "epsilon",
        "Ω": "Omega",
        "Σ": "Sum",
        "ξ": "xi",
        "’": "'",
    }
)


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


def declaration(kind: str, name: str, shape: Sequence[int | str]) -> str:
    """A variable, parameter or field with its type and sizes; a size may be left out, ""."""
    return f"{C_TYPES[kind]} {name}{''.join(f'[{length}]' for length in shape)}"


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


def plain(text: str) -> str:
    """Text for a C comment: ASCII, no markup, nothing that would end the comment."""
    text = text.replace("``", "").replace(":func:", "").replace("`", "'")
    text = text.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/")
    return text.translate(_ASCII).encode("ascii", "replace").decode()


def comment(text: str, indent: str = "") -> list[str]:
    """A block comment."""
    lines = plain(text).splitlines()
    if len(lines) == 1 and len(indent) + len(lines[0]) + 6 <= WIDTH:
        return [f"{indent}/* {lines[0].strip()} */"]
    body = [f"{indent} * {line.strip()}".rstrip() for line in lines]
    return [f"{indent}/*", *body, f"{indent} */"]


def filled(words: Iterable[str], width: int = WIDTH) -> list[str]:
    """Lines of ``words``, indented by four; a word is never broken."""
    lines: list[str] = []
    line, length = ["   "], 3
    for word in words:
        length += 1 + len(word)
        if length > width:
            lines.append(" ".join(line))
            line, length = ["   "], 4 + len(word)
        line.append(word)
    return [*lines, " ".join(line)]


OPERATORS = ("+", "-", "*", "/", "|", "||", "&&")


def broken(line: str) -> list[str]:
    """A line broken where too long: at the outermost comma or operator, else an opening bracket."""
    if len(line) <= WIDTH:
        return [line]
    indent = " " * (len(line) - len(line.lstrip()) + 4)
    depth, best, best_depth, bracket = 0, 0, 99, 0
    for i, letter in enumerate(line[:WIDTH]):
        depth += {"(": 1, ")": -1}.get(letter, 0)
        if i <= len(indent):
            continue
        after_comma = line[i - 1 : i + 1] == ", "
        before_operator = letter == " " and line[i + 1 : i + 3].strip() in OPERATORS
        if (after_comma or before_operator) and depth <= best_depth:
            best, best_depth = i, depth
        if letter == "(":
            bracket = i + 1
    best = best or bracket
    if not best:
        return [line]
    return [line[:best].rstrip(), *broken(indent + line[best:].lstrip())]
