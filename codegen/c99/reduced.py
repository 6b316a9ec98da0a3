"""A program for one calibration: what the proof has seen to be one number, or never to run.

Functions are changed in place, their nodes keep references and intervals. An expression seen as one
number becomes that, a branch never taken goes, and so does a local that nothing reads any more.
What is left of the calibration is read of tables.
"""

import ast
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace

from canroll.codegen.operations.table import INTRINSICS, Access
from canroll.codegen.proof.one_calibration import Outcome
from canroll.codegen.subset.program import (
    CONST_RECORD,
    Const,
    Constant,
    FieldReference,
    Function,
    Local,
    Program,
    statements,
)
from canroll.codegen.subset.resolve import stored
from canroll.codegen.subset.walk import walk

CLAMP = INTRINSICS["clamp"]
NEUTRAL = (ast.Add, ast.Sub, ast.BitOr, ast.BitXor, ast.LShift, ast.RShift)
"""Operators that leave their left operand where the right one is zero."""


class Reducer:
    """Reduces the functions of a program, callees before their callers.

    Args:
        program: is changed.
        outcome: what its runs have seen.
        calibration: every stored integer of it, by field and indices.
    """

    def __init__(
        self,
        program: Program,
        outcome: Outcome,
        calibration: Mapping[tuple[str, tuple[int, ...]], int],
    ) -> None:
        self.program, self.refs = program, program.refs
        self.seen, self.ways, self.served = outcome.seen, outcome.ways, outcome.served
        self.calibration = calibration
        self.function: Function = next(program.functions())
        self.declared: Counter[str] = Counter()

    def reduce(self, function: Function) -> None:
        """Reduce one function."""
        self.function, node = function, function.node
        self.declared = Counter(_declared(node))
        body = statements(node)
        doc = node.body[: len(node.body) - len(body)]
        node.body = [*doc, *self._tidied(self._block(body))]
        written = stored(self.program, walk(node))
        if all(isinstance(self.refs.get(each), Local) for each in written):
            self.program.writers.pop(function.key, None)

    # what is known

    def _pure(self, node: ast.AST) -> bool:
        """Whether evaluating ``node`` changes nothing."""
        for inner in walk(node):
            match self.refs.get(inner):
                case Function(key=key) if key in self.program.writers:
                    return False
                case Access(writes=True):
                    return False
        return True

    def _way(self, test: ast.expr) -> bool | None:
        """The only way that a condition without effect goes, or None."""
        ever = self.ways.get(test, (True, True))
        return ever[0] if ever[0] != ever[1] and self._pure(test) else None

    def _reached(self, node: ast.stmt) -> bool:
        match node:
            case ast.If(test=test):
                return test in self.ways
            case ast.For(iter=ast.Call(args=bounds)):
                return bounds[0] in self.seen
            case ast.Return(value=None):
                return True
            case ast.Return(value=value) | ast.Expr(value=value):
                return value in self.seen
        return node in self.seen

    # expressions

    def _value(self, node: ast.expr) -> ast.expr:
        """An expression with what is known of it."""
        seen = self.seen.get(node)
        if seen is not None and seen.lo == seen.hi and self._pure(node):
            return ast.Constant(seen.lo)
        match node:
            case ast.UnaryOp():
                node.operand = self._value(node.operand)
            case ast.BinOp():
                node.left, node.right = self._value(node.left), self._value(node.right)
                if isinstance(node.op, NEUTRAL) and _is_zero(node.right):
                    return node.left
            case ast.Call():
                if self.refs[node] is CLAMP:
                    self._unbound(node)
                node.args = [self._value(argument) for argument in node.args]
            case _:
                self._place(node)
        return node

    def _unbound(self, node: ast.Call) -> None:
        """Make a bound that is never exceeded, which C leaves out, one number: it reads nothing."""
        value, low, high = (self.seen[argument] for argument in node.args)
        if value.lo >= low.hi:
            node.args[1] = ast.Constant(low.lo)
        if value.hi <= high.lo:
            node.args[2] = ast.Constant(high.hi)

    def _place(self, node: ast.expr) -> None:
        """A field, an element or an array: its indices, and the calibration as a table."""
        while isinstance(node, ast.Subscript):
            node.slice = self._value(node.slice)
            node = node.value
        match self.refs.get(node):
            case FieldReference(record=record) as ref if record == CONST_RECORD:
                if isinstance(node, ast.Attribute) and node not in self.served:
                    self.refs[node] = self._table(ref)
                    node.value = ast.Name(self.function.module, ast.Load())

    def _table(self, ref: FieldReference) -> Constant:
        name, home = f"CALIBRATED_{ref.field.name.upper()}", self.function.module
        its = ref.field.type
        table = Constant(home, name, self._nested(ref.field.name, its.shape), its, 0, 0)
        return self.program.modules[home].constants.setdefault(name, table)

    def _nested(self, field: str, shape: tuple[int, ...], indices: tuple[int, ...] = ()) -> Const:
        if len(indices) == len(shape):
            return self.calibration[field, indices]
        inner = range(shape[len(indices)])
        return tuple(self._nested(field, shape, (*indices, k)) for k in inner)

    def _test(self, node: ast.expr) -> ast.expr:
        """A condition without those terms that are always so."""
        match node:
            case ast.BoolOp():
                both = isinstance(node.op, ast.And)
                terms = [t for t in node.values if t in self.ways and self._way(t) is not both]
                node.values = [self._test(term) for term in terms]
                return node.values[0] if len(terms) == 1 else node
            case ast.UnaryOp():
                node.operand = self._test(node.operand)
            case ast.Compare():
                node.left = self._value(node.left)
                node.comparators = [self._value(each) for each in node.comparators]
        return node

    # statements

    def _block(self, body: list[ast.stmt]) -> list[ast.stmt]:
        kept: list[ast.stmt] = []
        for node in body:
            if not self._reached(node):
                self._forget(node)
            elif isinstance(node, ast.If) and (way := self._way(node.test)) is not None:
                for gone in node.orelse if way else node.body:
                    self._forget(gone)
                kept += self._spliced(self._block(node.body if way else node.orelse))
            else:
                self._statement(node)
                kept.append(node)
        return kept

    def _statement(self, node: ast.stmt) -> None:
        match node:
            case ast.If():
                node.test = self._test(node.test)
                node.body, node.orelse = self._block(node.body), self._block(node.orelse)
            case ast.For(iter=ast.Call() as call):
                call.args = [self._value(bound) for bound in call.args]
                node.body = self._block(node.body)
            case ast.Assign(targets=[target]) | ast.AugAssign(target=target):
                self._place(target)
                node.value = self._value(node.value)
            case ast.AnnAssign(value=ast.expr() as value) | ast.Return(value=ast.expr() as value):
                node.value = self._value(value)
            case ast.Expr(value=ast.Call() as call):
                call.args = [self._value(argument) for argument in call.args]

    def _forget(self, node: ast.stmt) -> None:
        """Drop the comments of a statement that is never reached."""
        comments = self.program.modules[self.function.module].comments
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1):
            comments.pop(line, None)

    def _spliced(self, body: list[ast.stmt]) -> list[ast.stmt]:
        """The block of a branch for the block around it, in which another local may be so named."""
        for statement in body:
            if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
                name = statement.target.id
                if self.declared[name] > 1:
                    fresh = f"{name}_{self.declared[name]}"
                    self.declared[name] += 1
                    for node in (n for each in body for n in walk(each)):
                        if isinstance(node, ast.Name) and node.id == name:
                            node.id = fresh
                            ref = self.refs.get(node)
                            if isinstance(ref, Local):
                                self.refs[node] = replace(ref, name=fresh)
        return body

    # what nothing needs

    def _tidied(self, body: list[ast.stmt]) -> list[ast.stmt]:
        """``body`` without what nobody reads, as often as that leaves something else unread."""
        while True:
            read = {
                node.id
                for statement in body
                for node in walk(statement)
                if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)
            }
            size = _size(body)
            body = list(self._needed(body, read))
            if _size(body) == size:
                return body

    def _needed(self, body: list[ast.stmt], read: set[str]) -> Iterator[ast.stmt]:
        for node in body:
            match node:
                case ast.If():
                    node.body = list(self._needed(node.body, read))
                    node.orelse = list(self._needed(node.orelse, read))
                    if not node.body and node.orelse:
                        node.test = ast.UnaryOp(ast.Not(), node.test)
                        node.body, node.orelse = node.orelse, []
                    if node.body or not self._pure(node.test):
                        yield node
                case ast.For():
                    node.body = list(self._needed(node.body, read))
                    if node.body or not self._pure(node.iter):
                        yield node
                case ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value):
                    yield from self._stored(node, name, value, read)
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    yield from self._stored(node, name, value, read)
                case ast.AugAssign(target=ast.Name(id=name), value=value):
                    if not (isinstance(node.op, NEUTRAL) and _is_zero(value)):
                        yield from self._stored(node, name, value, read)
                case ast.Expr(value=ast.Call() as call):
                    if not self._pure(call):
                        yield node
                case _:
                    yield node

    def _stored(
        self, node: ast.stmt, name: str, value: ast.expr, read: set[str]
    ) -> Iterator[ast.stmt]:
        """The store of a local, or only the call whose result nobody reads."""
        if name in read:
            yield node
        elif not self._pure(value) and isinstance(value, ast.Call):
            yield ast.copy_location(ast.Expr(value), node)
        elif not self._pure(value):
            yield node


def _declared(node: ast.FunctionDef) -> Iterator[str]:
    for inner in walk(node):
        if isinstance(inner, ast.AnnAssign | ast.For) and isinstance(inner.target, ast.Name):
            yield inner.target.id


def _is_zero(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value == 0


def _size(body: list[ast.stmt]) -> int:
    return sum(1 for statement in body for _ in walk(statement))
