"""What the proof shows of a program, put to use in its text.

Branches that are never taken go, as do limits that nothing exceeds; a value that is always one
number is written as that. What is never reached has no ranges either, so it could not be emitted
with a proof of its own.
"""

import ast
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

from codegen.operations.table import Operation
from codegen.proof.interpreter import Interpreter
from codegen.proof.prove import entry_points
from codegen.specialise import fold
from codegen.specialise.places import STATE_RECORD
from codegen.specialise.tidy import rebuilt, tidied
from codegen.subset.program import Program, RecordField, names, statements
from codegen.subset.walk import walk

Ways = Mapping[ast.expr, tuple[bool, bool]]
"""By a condition's node: whether it is ever true, ever false."""


def cut(program: Program, module: str) -> list[ast.FunctionDef]:
    """The functions of ``module`` that are called, without the branches that are never taken."""
    run = Interpreter(program)
    for function in entry_points(program):
        run.run(function)
    functions = {
        name: _without(function.node, run, program)
        for name, function in program.modules[module].functions.items()
    }
    called = needed(functions, [function.name for function in entry_points(program)])
    return [node for name, node in functions.items() if name in called]


def needed(functions: Mapping[str, ast.FunctionDef], entries: Iterable[str]) -> set[str]:
    """The names of the functions that ``entries`` call, and their own."""
    found: set[str] = set()
    todo = list(entries)
    while todo:
        name = todo.pop()
        if name in functions and name not in found:
            found.add(name)
            todo += names([functions[name]])
    return found


def _without(node: ast.FunctionDef, run: Interpreter, program: Program) -> ast.FunctionDef:
    body = statements(node)
    doc = node.body[: len(node.body) - len(body)]
    seen = Seen(run)
    written = [seen.visit(each) for each in _block(body, run.ways)]
    kept = tidied(_changing(program.record(STATE_RECORD).fields, written))
    return ast.FunctionDef(node.name, node.args, [*doc, *kept], [], node.returns, lineno=0)


def _block(body: list[ast.stmt], ways: Ways) -> list[ast.stmt]:
    kept: list[ast.stmt] = []
    for node in body:
        if isinstance(node, ast.If):
            test = _test(node.test, ways)
            told = fold.truth(test)
            if told is not None:
                kept += _block(node.body if told else node.orelse, ways)
                # a branch that is taken and returns ends all
                if kept and isinstance(kept[-1], ast.Return):
                    break
                continue
            kept.append(ast.If(test, _block(node.body, ways), _block(node.orelse, ways)))
        else:
            kept.append(rebuilt(node, partial(_block, ways=ways)))
    return kept


class Seen(ast.NodeTransformer):
    """Writes down values that are seen to be one number, drops limits that are seen to be kept."""

    def __init__(self, run: Interpreter) -> None:
        self.seen = run.seen
        self.refs = run.refs

    def visit(self, node: ast.AST) -> Any:  # noqa: ANN401 - as the transformer's
        """As of the transformer."""
        its = self.seen.get(node)
        if isinstance(node, ast.expr) and its is not None and fold.pure(node):
            if its.lo == its.hi:
                return fold.literal(its.lo)
            if isinstance(node, ast.Call) and self._kept_anyway(node):
                return self.visit(node.args[0])
        if isinstance(node, ast.BinOp | ast.Call):
            return fold.mapped(node, self.visit)
        return super().visit(node)

    def _kept_anyway(self, node: ast.Call) -> bool:
        """Whether the first argument keeps the limits that an intrinsic would set it."""
        row, inner = self.refs[node], self.seen.get(node.args[0])
        if not isinstance(row, Operation) or row.limits is None or inner is None:
            return False
        low, high = row.limits(*map(fold.known, node.args))
        return low is not None and high is not None and low <= high and inner.within(low, high)

    def visit_Assign(self, node: ast.Assign) -> ast.Assign:
        """What is written is a place, not its value."""
        place = node.targets[0]
        while isinstance(place, ast.Subscript):
            place.slice = self.visit(place.slice)
            place = place.value
        node.value = self.visit(node.value)
        return node


def _changing(fields: Mapping[str, RecordField], body: list[ast.stmt]) -> list[ast.stmt]:
    """``body`` without stores of a field in itself, but those an interrupt could come between."""
    return [rebuilt(n, partial(_changing, fields)) for n in body if not _is_idle(fields, n)]


def _is_idle(fields: Mapping[str, RecordField], node: ast.stmt) -> bool:
    if not isinstance(node, ast.Assign) or not fold.same(node.targets[0], node.value):
        return False
    stored = (n.attr for n in walk(node) if isinstance(n, ast.Attribute))
    return not any(fields[name].volatile for name in stored)


def _test(node: ast.expr, ways: Ways) -> ast.expr:
    """A condition without what is always so; True or False where it always goes one way."""
    ever = ways.get(node)
    if ever is not None and ever[0] != ever[1] and fold.pure(node):
        return ast.Constant(ever[0])
    if isinstance(node, ast.BoolOp | ast.UnaryOp):
        return fold.mapped(node, lambda each: _test(each, ways))
    return node
