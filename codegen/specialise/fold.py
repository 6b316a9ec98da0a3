"""Expressions of the subset with what is known of them folded in.

Arithmetic of the subset is exact, so every rule here holds for all integers; a rule that would
drop an operand is applied only where dropping it drops no effect.
"""

import ast
from collections.abc import Callable, Iterable, Sequence

from codegen.operations.relations import RELATIONS
from codegen.operations.table import INTRINSICS, OPERATORS, Access, Operation
from codegen.subset.walk import walk

READERS = frozenset(
    name for name, row in INTRINSICS.items() if not (isinstance(row, Access) and row.writes)
)
"""Intrinsics without effect."""


def literal(number: int) -> ast.expr:
    """A constant as Python writes it."""
    if number < 0:
        return ast.UnaryOp(ast.USub(), ast.Constant(-number))
    return ast.Constant(number)


def known(node: ast.expr) -> int | None:
    """The value of a literal, or None."""
    if isinstance(node, ast.Constant) and type(node.value) is int:
        return node.value
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        inner = known(node.operand)
        return None if inner is None else -inner
    return None


def same(a: ast.expr, b: ast.expr) -> bool:
    """Whether both are written alike."""
    return ast.unparse(a) == ast.unparse(b)


def pure(node: ast.AST) -> bool:
    """Whether evaluating ``node`` calls nothing but intrinsics that read."""
    return not any(
        isinstance(inner, ast.Call)
        and not (isinstance(inner.func, ast.Name) and inner.func.id in READERS)
        for inner in walk(node)
    )


def negated(a: ast.expr) -> ast.expr:
    """-a."""
    value = known(a)
    if value is not None:
        return literal(-value)
    if isinstance(a, ast.UnaryOp) and isinstance(a.op, ast.USub):
        return a.operand
    return ast.UnaryOp(ast.USub(), a)


NEUTRAL = {ast.Add: 0, ast.Sub: 0, ast.Mult: 1, ast.BitOr: 0, ast.BitXor: 0}
NEUTRAL |= {ast.LShift: 0, ast.RShift: 0}
"""The right operand that leaves the left one as it is."""
COMMUTATIVE = (ast.Add, ast.Mult, ast.BitOr, ast.BitXor)


def operation(op: ast.operator, a: ast.expr, b: ast.expr) -> ast.expr:
    """``a op b``."""
    kind, x, y = type(op), known(a), known(b)
    if x is not None and y is not None:
        return literal(OPERATORS[kind].fold(x, y))
    if kind is ast.Mult and x is not None:
        a, b, x, y = b, a, y, x
    if y is not None and y == NEUTRAL.get(kind):
        return a
    if x is not None and kind in COMMUTATIVE and x == NEUTRAL[kind]:
        return b
    if kind in (ast.Mult, ast.BitAnd) and 0 in (x, y) and pure(a) and pure(b):
        return literal(0)
    if kind is ast.Mult and y == -1:
        return negated(a)
    if kind is ast.Sub and x == 0:
        return negated(b)
    if kind is ast.Add and isinstance(b, ast.UnaryOp) and isinstance(b.op, ast.USub):
        return ast.BinOp(a, ast.Sub(), b.operand)
    return ast.BinOp(a, op, b)


def mapped(node: ast.expr, change: Callable[[ast.expr], ast.expr]) -> ast.expr:
    """A number or a condition with ``change`` applied to its operands, folded again."""
    match node:
        case ast.Compare(left=a, ops=[relation], comparators=[b]):
            return comparison(relation, change(a), change(b))
        case ast.BoolOp(op=junction, values=parts):
            return joined(junction, (change(part) for part in parts))
        case ast.UnaryOp(op=ast.Not(), operand=a):
            return inverse(change(a))
        case ast.UnaryOp(operand=a):
            return negated(change(a))
        case ast.BinOp(left=a, op=op, right=b):
            return operation(op, change(a), change(b))
        case ast.Subscript(value=array, slice=index):
            return ast.Subscript(change(array), change(index))
        case ast.Attribute(value=owner, attr=name):
            return ast.Attribute(change(owner), name)
        case ast.Call(func=ast.Name(id=name) as func, args=arguments):
            given = [change(each) for each in arguments]
            if isinstance(INTRINSICS.get(name), Operation):
                return intrinsic(name, given)
            return ast.Call(func, given, [])
    return node


def intrinsic(name: str, arguments: Sequence[ast.expr]) -> ast.expr:
    """A call of an intrinsic that reads no memory."""
    values = [known(each) for each in arguments]
    row = INTRINSICS[name]
    assert isinstance(row, Operation)
    if None not in values:
        return literal(row.fold(*values))
    if name in ("scaled", "rsh") and values[1] is not None:
        return shifted(name, arguments[0], values[1])
    return ast.Call(ast.Name(name), list(arguments), [])


def shifted(name: str, total: ast.expr, count: int) -> ast.expr:
    """``scaled`` or ``rsh`` by ``count``; without the shift where all of the sum is a multiple."""
    if _power(total) >= count:
        rest = _divided(total, count)
        return intrinsic("sat31", [rest]) if name == "scaled" else rest
    return ast.Call(ast.Name(name), [total, ast.Constant(count)], [])


def _power(node: ast.expr) -> int:
    """How often two is seen to divide ``node``: 62 for 0."""
    value = known(node)
    if value is not None:
        return 62 if value == 0 else (value & -value).bit_length() - 1
    if isinstance(node, ast.UnaryOp):
        return _power(node.operand)
    if isinstance(node, ast.BinOp):
        if isinstance(node.op, ast.Mult):
            return _power(node.left) + _power(node.right)
        if isinstance(node.op, ast.Add | ast.Sub):
            return min(_power(node.left), _power(node.right))
    return 0


def _divided(node: ast.expr, count: int) -> ast.expr:
    """``node`` / 2**count, which two divides that often by :func:`_power`."""
    value = known(node)
    if value is not None:
        return literal(value >> count)
    if isinstance(node, ast.UnaryOp):
        return negated(_divided(node.operand, count))
    assert isinstance(node, ast.BinOp)
    if isinstance(node.op, ast.Mult):
        left = min(_power(node.left), count)
        a = _divided(node.left, left) if left else node.left
        b = _divided(node.right, count - left) if count - left else node.right
        return operation(ast.Mult(), a, b)
    return operation(node.op, _divided(node.left, count), _divided(node.right, count))


def comparison(op: ast.cmpop, a: ast.expr, b: ast.expr) -> ast.expr:
    """``a op b``; a literal True or False where both are known."""
    x, y = known(a), known(b)
    if x is not None and y is not None:
        return ast.Constant(RELATIONS[type(op)].holds(x, y))
    if x is not None:
        return ast.Compare(b, [RELATIONS[type(op)].swapped()], [a])
    return ast.Compare(a, [op], [b])


def truth(node: ast.expr) -> bool | None:
    """What a condition is, where that is known."""
    if isinstance(node, ast.Constant) and isinstance(node.value, bool):
        return node.value
    return None


def inverse(node: ast.expr) -> ast.expr:
    """A condition that holds where ``node`` doesn't."""
    told = truth(node)
    if told is not None:
        return ast.Constant(not told)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return node.operand
    if isinstance(node, ast.Compare):
        return ast.Compare(node.left, [RELATIONS[type(node.ops[0])].negated()], node.comparators)
    return ast.UnaryOp(ast.Not(), node)


def joined(op: ast.boolop, parts: Iterable[ast.expr]) -> ast.expr:
    """``and`` or ``or`` of conditions, evaluated from the left as far as needed."""
    deciding = isinstance(op, ast.Or)
    left: list[ast.expr] = []
    for part in parts:
        told = truth(part)
        if told is deciding:
            # what stands before it is still asked, unless that changes nothing
            left = [each for each in left if not pure(each)]
            left.append(part)
            break
        if told is None:
            left.append(part)
    if not left:
        return ast.Constant(not deciding)
    return left[0] if len(left) == 1 else ast.BoolOp(op, left)
