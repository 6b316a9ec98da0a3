"""The operators and intrinsics of the subset: one row says all that any pass needs to know of one.

A row holds how an operation is computed, what interval its result has, what must be proved of its
operands, and its C. The rules, the prover, the emitter and the reducer read these tables and
name no operation. A new intrinsic is a row here and its function in ``firmware/subset.py``, which
CPython runs; if C has no operator for it, also a helper in ``codegen/c99/canroll_runtime.h``.
"""

import ast
import operator
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from canroll.codegen.operations import c_forms
from canroll.codegen.operations import intervals as iv
from canroll.codegen.operations.c_expression import Expression, binary
from canroll.codegen.operations.intervals import BITS_31, KINDS, Value
from canroll.firmware import subset

Obligation = tuple[bool, str, Value]
"""Whether it is met, what is wrong where not, and the interval that shows it."""


@dataclass(frozen=True, slots=True)
class Operation:
    """An operator or an intrinsic that computes a number from numbers.

    Attributes:
        name: as written.
        operands: kinds; all but the first are converted in C, unless they may have 64 bits.
        fold: the exact result.
        interval: of the result, for the intervals of the operands.
        c: C, for the interval of the result and the operands.
        obligations: what must hold of the operands' intervals.
        overflows: whether it must be proved that the result fits 64 bits.
    """

    name: str
    operands: tuple[str, ...]
    fold: Callable[..., int]
    interval: Callable[..., Value]
    c: Callable[..., Expression]
    obligations: Callable[..., Iterable[Obligation]] = lambda *_: ()
    overflows: bool = False


@dataclass(frozen=True, slots=True)
class Access:
    """An intrinsic on the memory of a record, which is its first argument.

    Attributes:
        name: as written.
        effect: reads or writes one element, clears all, or returns the size in bytes.
        element: kind of the elements as which the record is accessed.
        operands: kinds of the arguments after the record: an index, a value.
    """

    name: str
    effect: Literal["read", "write", "clear", "size"]
    element: str = "i32"
    operands: tuple[str, ...] = ()

    @property
    def writes(self) -> bool:
        """Whether it changes the record; it then returns nothing."""
        return self.effect in ("write", "clear")


Intrinsic = Operation | Access


def _operator(
    sign: str,
    fold: Callable[[int, int], int],
    interval: Callable[[Value, Value], Value],
    c: Callable[[Value, Expression, Expression], Expression] | None = None,
) -> Operation:
    plain = c or (lambda seen, a, b: binary(sign, a, b, seen))
    return Operation(sign, ("i64", "i64"), fold, interval, plain, overflows=True)


def _shifted_right(a: Value, b: Value) -> Value:
    return Value(a.lo >> b.lo, a.hi >> b.lo)


def _shifted_left(a: Value, b: Value) -> Value:
    return iv.multiply(a, Value(1 << b.lo, 1 << b.lo))


OPERATORS: dict[type[ast.operator], Operation] = {
    ast.Add: _operator("+", operator.add, iv.add),
    ast.Sub: _operator("-", operator.sub, lambda a, b: iv.add(a, iv.negate(b))),
    ast.Mult: _operator("*", operator.mul, iv.multiply),
    ast.BitAnd: _operator("&", operator.and_, lambda a, b: iv.bitwise("&", a, b)),
    ast.BitOr: _operator("|", operator.or_, lambda a, b: iv.bitwise("|", a, b)),
    ast.BitXor: _operator("^", operator.xor, lambda a, b: iv.bitwise("^", a, b)),
    ast.LShift: _operator("<<", operator.lshift, _shifted_left, c_forms.left_shift),
    ast.RShift: _operator(">>", operator.rshift, _shifted_right, c_forms.right_shift),
}
CONSTANT_OPERATORS: dict[type[ast.operator], Callable[[int, int], int]] = {
    **{kind: row.fold for kind, row in OPERATORS.items()},
    ast.FloorDiv: operator.floordiv,
    ast.Pow: operator.pow,
}
"""Operators in constants of modules."""


def _count(v: Value, n: Value) -> list[Obligation]:
    return [(n.within(1, 62), "shift count outside 1 … 62", n)]


def _rounding(v: Value, n: Value) -> list[Obligation]:
    half = 1 << (min(max(n.hi, 1), 62) - 1)
    total = Value(v.lo, v.hi + half)
    return [*_count(v, n), (total.within(*KINDS["i64"]), "rounding overflows 64 bits", total)]


def _scaling(v: Value, n: Value) -> list[Obligation]:
    last = Value(v.lo, v.hi + 1)
    return [*_count(v, n), (last.within(*KINDS["i64"]), "rounding overflows 64 bits", last)]


def _fits(kind: str) -> Callable[[Value], list[Obligation]]:
    return lambda v: [(v.within(*KINDS[kind]), f"does not fit {kind}", v)]


def _division(a: Value, b: Value) -> list[Obligation]:
    return [(not b.lo <= 0 <= b.hi, "divides by zero", b)]


def _within(lo: int, hi: int) -> Callable[[Value], Value]:
    return lambda v: v if v.within(lo, hi) else Value(lo, hi)


def _limited(lo: int, hi: int) -> Callable[[Value], Value]:
    return lambda v: v.limited(lo, hi)


INTRINSICS: dict[str, Intrinsic] = {
    row.name: row
    for row in (
        Operation(
            "sat32", ("i64",), subset.sat32, _limited(*KINDS["i32"]), c_forms.sat32,
        ),
        Operation(
            "sat31", ("i64",), subset.sat31, _limited(*BITS_31), c_forms.sat31,
        ),
        Operation(
            "scaled", ("i64", "i32"), subset.scaled,
            lambda v, n: iv.shift_rounded(v, n).limited(*BITS_31), c_forms.scaled, _scaling,
        ),
        Operation(
            "clamp", ("i64", "i32", "i32"), subset.clamp, iv.clamp, c_forms.clamp,
        ),
        Operation(
            "rsh", ("i64", "i32"), subset.rsh, iv.shift_rounded, c_forms.rounded, _rounding
        ),
        Operation(
            "absolute", ("i64",), subset.absolute, iv.absolute, c_forms.absolute, overflows=True
        ),
        Operation(
            "tdiv", ("i64", "i64"), subset.tdiv, iv.divide, c_forms.quotient, _division,
            overflows=True,
        ),
        Operation(
            "byte", ("i64",), subset.byte, _within(*KINDS["u8"]), c_forms.byte,
        ),
        Operation(
            "narrow", ("i64",), subset.narrow, _limited(*KINDS["i32"]), c_forms.narrow,
            _fits("i32"),
        ),
        Operation(
            "to_i32", ("u32",), subset.to_i32, _within(*KINDS["i32"]), c_forms.to_i32,
            _fits("u32"),
        ),
        Operation(
            "to_u32", ("i32",), subset.to_u32,
            lambda v: v if v.lo >= 0 else Value(*KINDS["u32"]), c_forms.to_u32, _fits("i32"),
        ),
        Access("word", "read", "i32", ("i32",)),
        Access("octet", "read", "u8", ("i32",)),
        Access("set_word", "write", "i32", ("i32", "i32")),
        Access("set_octet", "write", "u8", ("i32", "u8")),
        Access("clear", "clear"),
        Access("bytes_of", "size"),
    )
}  # fmt: skip
