"""Relations of two integers: their opposites, and what one leaves of an interval."""

import ast

from codegen.proof.intervals import Value

NEGATED = {
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
"""The relation that holds where one does not."""
SWAPPED = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}
"""The relation of (b, a) that says what one of (a, b) does, where it is another."""


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
