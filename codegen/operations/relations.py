"""Relations of two integers: their signs, their opposites, and what one leaves of an interval."""

import ast
import operator
from collections.abc import Callable
from dataclasses import dataclass

from canroll.codegen.operations.intervals import Value


@dataclass(frozen=True, slots=True)
class Relation:
    """A relation of two integers.

    Attributes:
        sign: as written, in C too.
        holds: whether two integers have it.
        negated: the relation that holds where this one does not.
        swapped: the relation of (b, a) that holds where this one holds of (a, b).
    """

    sign: str
    holds: Callable[[int, int], bool]
    negated: type[ast.cmpop]
    swapped: type[ast.cmpop]


RELATIONS: dict[type[ast.cmpop], Relation] = {
    ast.Lt: Relation("<", operator.lt, ast.GtE, ast.Gt),
    ast.LtE: Relation("<=", operator.le, ast.Gt, ast.GtE),
    ast.Gt: Relation(">", operator.gt, ast.LtE, ast.Lt),
    ast.GtE: Relation(">=", operator.ge, ast.Lt, ast.LtE),
    ast.Eq: Relation("==", operator.eq, ast.NotEq, ast.Eq),
    ast.NotEq: Relation("!=", operator.ne, ast.Eq, ast.NotEq),
}


def narrow(op: type[ast.cmpop], a: Value, b: Value) -> Value | None:
    """The part of ``a`` for which ``a op b`` can hold, or None."""
    lo, hi = a.lo, a.hi
    if op is ast.Lt:
        hi = min(hi, b.hi - 1)
    elif op is ast.LtE:
        hi = min(hi, b.hi)
    elif op is ast.Gt:
        lo = max(lo, b.lo + 1)
    elif op is ast.GtE:
        lo = max(lo, b.lo)
    elif op is ast.Eq:
        lo, hi = max(lo, b.lo), min(hi, b.hi)
    elif b.lo == b.hi:
        lo += lo == b.lo
        hi -= hi == b.lo
    return None if lo > hi else a.limited(lo, hi)
