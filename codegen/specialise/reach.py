"""What the proof shows of a program, put to use in its text.

Branches that are never taken go, as do limits that nothing exceeds; a value that is always one
number is written as that. What is never reached has no ranges either, so it could not be emitted
with a proof of its own.
"""

import ast
from collections.abc import Mapping
from typing import Any

from codegen.proof.abstract_state import State
from codegen.proof.interpreter import Interpreter
from codegen.proof.intervals import Value
from codegen.proof.prove import entry_points
from codegen.specialise import fold
from codegen.specialise.places import STATE_RECORD
from codegen.specialise.tidy import tidied
from codegen.subset.program import BITS_31, KINDS, MEMORY, Program
from codegen.subset.walk import walk

Ways = Mapping[int, tuple[bool, bool]]
"""By a condition's node: whether it is ever true, ever false."""


class Reached(Interpreter):
    """Runs a program and notes which way its conditions go."""

    def __init__(self, program: Program) -> None:
        super().__init__(program, proof=True)
        self.ways: dict[int, tuple[bool, bool]] = {}
        # what is known of a node goes by its id, which another one would take over
        self.kept = [node for f in program.functions() for node in walk(f.node)]

    def branch(self, test: ast.expr, state: State) -> tuple[State | None, State | None]:
        """As of the interpreter."""
        yes, no = super().branch(test, state)
        ever_yes, ever_no = self.ways.get(id(test), (False, False))
        self.ways[id(test)] = (ever_yes or yes is not None, ever_no or no is not None)
        return yes, no


def cut(program: Program, module: str) -> list[ast.FunctionDef]:
    """The functions of ``module`` that are called, without the branches that are never taken."""
    run = Reached(program)
    for function in entry_points(program):
        run.run(function)
    functions = program.modules[module].functions
    needed: dict[str, ast.FunctionDef] = {}
    todo = [function.name for function in entry_points(program)]
    while todo:
        name = todo.pop()
        if name in functions and name not in needed:
            needed[name] = node = _without(functions[name].node, run, program)
            todo += [n.id for n in walk(node) if isinstance(n, ast.Name)]
    return [needed[name] for name in functions if name in needed]


def _without(node: ast.FunctionDef, run: Reached, program: Program) -> ast.FunctionDef:
    doc = node.body[:1] if ast.get_docstring(node) is not None else []
    seen = Seen(run.seen)
    body = [seen.visit(each) for each in _block(node.body[len(doc) :], run.ways)]
    body = tidied(_changing(body, program))
    return ast.FunctionDef(node.name, node.args, [*doc, *body], [], node.returns, lineno=0)


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
        elif isinstance(node, ast.For):
            inner = _block(node.body, ways)
            kept.append(ast.For(node.target, node.iter, inner, [], lineno=0))
        else:
            kept.append(node)
    return kept


class Seen(ast.NodeTransformer):
    """Writes down values that are seen to be one number, drops limits that are seen to be kept."""

    def __init__(self, seen: Mapping[int, Value]) -> None:
        self.seen = seen

    def visit(self, node: ast.AST) -> Any:  # noqa: ANN401 - as the transformer's
        """As of the transformer."""
        its = self.seen.get(id(node))
        if isinstance(node, ast.expr) and its is not None and fold.pure(node):
            if its.lo == its.hi:
                return fold.literal(its.lo)
            if isinstance(node, ast.Call):
                bounds, inner = _bounds(node), self.seen.get(id(node.args[0]))
                if bounds is not None and inner is not None and inner.within(*bounds):
                    return self.visit(node.args[0])
        found = super().visit(node)
        if isinstance(found, ast.BinOp):
            return fold.operation(found.op, found.left, found.right)
        if isinstance(found, ast.Call) and ast.unparse(found.func) in fold.READERS - MEMORY.keys():
            return fold.intrinsic(ast.unparse(found.func), found.args)
        return found

    def visit_Assign(self, node: ast.Assign) -> ast.Assign:
        """What is written is a place, not its value."""
        place = node.targets[0]
        while isinstance(place, ast.Subscript):
            place.slice = self.visit(place.slice)
            place = place.value
        node.value = self.visit(node.value)
        return node


def _bounds(node: ast.Call) -> tuple[int, int] | None:
    """What an intrinsic limits its first argument to."""
    name = ast.unparse(node.func)
    if name == "clamp":
        low, high = (fold.known(bound) for bound in node.args[1:])
        return None if low is None or high is None or low > high else (low, high)
    return {"sat31": BITS_31, "sat32": KINDS["i32"], "byte": KINDS["u8"]}.get(name)


def _changing(body: list[ast.stmt], program: Program) -> list[ast.stmt]:
    """``body`` without stores of a field in itself, but those an interrupt could come between."""
    fields = program.record(STATE_RECORD).fields
    kept: list[ast.stmt] = []
    for node in body:
        if isinstance(node, ast.If):
            yes, no = _changing(node.body, program), _changing(node.orelse, program)
            kept.append(ast.If(node.test, yes, no))
        elif isinstance(node, ast.For):
            inner = _changing(node.body, program)
            kept.append(ast.For(node.target, node.iter, inner, [], lineno=0))
        elif isinstance(node, ast.Assign) and fold.same(node.targets[0], node.value):
            names = {n.attr for n in walk(node) if isinstance(n, ast.Attribute)}
            if any(fields[name].volatile for name in names):
                kept.append(node)
        else:
            kept.append(node)
    return kept


def _test(node: ast.expr, ways: Ways) -> ast.expr:
    """A condition without what is always so; True or False where it always goes one way."""
    ever = ways.get(id(node))
    if ever is not None and ever[0] != ever[1] and fold.pure(node):
        return ast.Constant(ever[0])
    if isinstance(node, ast.BoolOp):
        return fold.joined(node.op, [_test(each, ways) for each in node.values])
    if isinstance(node, ast.UnaryOp):
        return fold.inverse(_test(node.operand, ways))
    return node
