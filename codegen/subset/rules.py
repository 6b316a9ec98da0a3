"""The rules of the integer subset for function bodies, each with the message of its refusal.

C and Python differ in scope, in when an operand is read and in the value of a condition. A
construct where they could differ is refused; the remaining ones mean the same in both.
"""

import ast
import re
from collections.abc import Callable

from canroll.codegen.operations.intervals import KINDS
from canroll.codegen.operations.table import INTRINSICS, OPERATORS
from canroll.codegen.subset import grammar
from canroll.codegen.subset.expression_rules import ExpressionRules, words
from canroll.codegen.subset.program import (
    CONST_RECORD,
    Constant,
    FieldReference,
    Function,
    Parameter,
    Program,
    assigned,
    evaluate,
    is_scalar,
)
from canroll.codegen.subset.walk import walk

C_WORDS = frozenset(
    re.findall(
        r"\w+",
        "auto break case char const continue default do double else enum extern float for goto if "
        "inline int long register restrict return short signed sizeof static struct switch "
        "typedef union unsigned void volatile while asm main",
    )
)


def check(program: Program) -> None:
    """Raise SubsetError for the first construct of any module that is outside the subset."""
    for function in program.functions():
        _Checker(program, function).run()
    for module in program.modules.values():
        grammar.check(module.path, grammar.parsed(module.path, module.source))


class _Checker(ExpressionRules):
    """Checks the statements of one function."""

    def __init__(self, program: Program, function: Function) -> None:
        super().__init__(program, function)
        self.loops: list[str] = []

    def run(self) -> None:
        for name, its in self.function.parameters.items():
            self.name(self.function.node, name)
            if is_scalar(its):
                self.scope[0].add(name)
        self.block(self.function.node.body, documented=True)
        if self.function.result is not None and not _returns(self.function.node.body):
            raise self.refuse(self.function.node, f"{self.function.name} must end in a return")

    def name(self, node: ast.AST, name: str) -> None:
        if name in C_WORDS or name.startswith("__") or name.endswith("_t"):
            raise self.refuse(node, f"'{name}' has another meaning in C")
        if name in KINDS or name in INTRINSICS:
            raise self.refuse(node, f"'{name}' is a word of the subset")

    def block(self, statements: list[ast.stmt], *, documented: bool = False) -> None:
        self.scope.append(set())
        for i, statement in enumerate(statements):
            text = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
            if text and documented and i == 0:
                continue
            self.statement(statement)
        self.scope.pop()

    def statement(self, node: ast.stmt) -> None:
        handler: dict[type[ast.stmt], Callable[..., None]] = {
            ast.AnnAssign: self.declaration,
            ast.Assign: self.assignment,
            ast.AugAssign: self.augmented,
            ast.If: self.condition,
            ast.For: self.loop,
            ast.Return: self.end,
            ast.Expr: self.call,
        }
        if type(node) not in handler:
            raise self.refuse(node, f"{words(node)} is not in the subset")
        handler[type(node)](node)

    def declaration(self, node: ast.AnnAssign) -> None:
        if not isinstance(node.target, ast.Name) or ast.unparse(node.annotation) not in KINDS:
            raise self.refuse(node, "a local is declared as name: i32 (i64, u8, u16, u32) = value")
        if node.value is None:
            raise self.refuse(node, f"{node.target.id} needs a value where it is declared")
        name = node.target.id
        self.name(node, name)
        self.declare(node, name, ast.unparse(node.annotation))
        self.number(node.value)
        self.order(node.value, ())
        self.scope[-1].add(name)

    def assignment(self, node: ast.Assign) -> None:
        if len(node.targets) != 1:
            raise self.refuse(node, "one assignment at a time")
        self.target(node.targets[0])
        self.number(node.value)
        self.order(node.value, (node.targets[0],))

    def augmented(self, node: ast.AugAssign) -> None:
        if type(node.op) not in OPERATORS:
            raise self.refuse(node, f"operator {words(node.op)} is not in the subset: use tdiv")
        self.target(node.target)
        self.number(node.value)
        self.count(node.op, node.value)
        self.order(node.value, (node.target,), augmented=True)

    def target(self, node: ast.expr) -> None:
        if isinstance(node, ast.Name):
            if node.id in self.loops:
                raise self.refuse(node, f"the loop counter {node.id} belongs to its loop")
            if node.id in self.function.parameters and not self.visible(node.id):
                raise self.refuse(node, f"{node.id} is not a scalar")
            if not self.visible(node.id):
                raise self.refuse(node, f"{node.id} is not declared here: name: type = value")
            return
        if not isinstance(node, ast.Attribute | ast.Subscript):
            raise self.refuse(node, f"{words(node)} cannot be assigned")
        self.place(node)
        target = self.program.refs[node]
        if isinstance(target, Constant):
            raise self.refuse(node, f"{target.name} is constant")
        if isinstance(target, FieldReference) and target.record == CONST_RECORD:
            raise self.refuse(node, "the calibration is constant")

    def condition(self, node: ast.If) -> None:
        self.truth(node.test)
        self.block(node.body)
        if node.orelse:
            self.block(node.orelse)

    def loop(self, node: ast.For) -> None:
        call = node.iter
        if not isinstance(call, ast.Call) or ast.unparse(call.func) != "range" or call.keywords:
            raise self.refuse(node, "a loop is: for name in range(…)")
        if not isinstance(node.target, ast.Name) or node.orelse:
            raise self.refuse(node, "a loop has one counter and no else")
        if not 1 <= len(call.args) <= 3:
            raise self.refuse(node, "range takes one to three bounds")
        if len(call.args) == 3:
            step = evaluate(self.program, self.module, call.args[2])
            if step == 0:
                raise self.refuse(node, "a loop's step must not be 0")
        for bound in call.args:
            self.number(bound)
            self.steady(bound, node)
        name = node.target.id
        if name != "_":
            self.name(node, name)
            self.declare(node, name, "i32")
        self.scope.append({name})
        self.loops.append(name)
        self.block(node.body)
        self.loops.pop()
        self.scope.pop()

    def steady(self, bound: ast.expr, loop: ast.For) -> None:
        """Refuse a bound that changes in its loop: Python reads it once, C in every iteration."""
        inside = {name for statement in loop.body for name in assigned(statement)}
        written = self.program.writers.get(self.function.key, frozenset())
        for node in walk(bound):
            if isinstance(node, ast.Name) and node.id in inside:
                raise self.refuse(bound, f"the loop changes its bound {node.id}")
            match self.program.refs.get(node):
                case FieldReference(owner=owner, record=record):
                    steady = record == CONST_RECORD and owner not in written
                case Parameter(type=kind):
                    steady = not kind.shape
                case _:
                    steady = True
            if not steady:
                rule = "a loop's bound must be a constant, a local or a calibration value"
                raise self.refuse(bound, rule)
            if isinstance(node, ast.Call):
                raise self.refuse(bound, "a loop's bound must not call a function")

    def end(self, node: ast.Return) -> None:
        if (node.value is None) != (self.function.result is None):
            raise self.refuse(node, f"{self.function.name} returns a different type than declared")
        if node.value is not None:
            self.number(node.value)
            self.order(node.value, ())

    def call(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Call):
            raise self.refuse(node, "an expression without effect")
        self.arguments(node.value)
        self.order(node.value, ())


def _returns(statements: list[ast.stmt]) -> bool:
    last = statements[-1]
    if isinstance(last, ast.If):
        return bool(last.orelse) and _returns(last.body) and _returns(last.orelse)
    return isinstance(last, ast.Return)
