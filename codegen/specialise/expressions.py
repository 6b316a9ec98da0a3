"""Expressions with what is known folded in; calls, each to the copy for its arguments."""

import ast
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

from codegen.operations.table import Access, Operation
from codegen.specialise import fold
from codegen.specialise.places import Places, Scope, fixed
from codegen.subset.program import Function
from codegen.subset.walk import walk


@dataclass(slots=True)
class Copy:
    """A specialised function.

    Attributes:
        name: of the copy.
        node: its definition.
        records: records that it takes, before all else.
        parameters: numbers of the parameters that it still takes.
        expression: what it returns where it does nothing else.
    """

    name: str
    node: ast.FunctionDef
    records: tuple[str, ...]
    parameters: tuple[int, ...]
    expression: ast.expr | None


class ExpressionFolder(Places):
    """Evaluates the expressions of functions as far as they are known."""

    @abstractmethod
    def copy(self, function: Function, arguments: list[ast.expr], *, entry: bool = False) -> Copy:
        """The copy of ``function`` for what is known of its arguments."""

    def value(self, node: ast.expr, scope: Scope) -> ast.expr:
        """An expression or a condition with what is known folded in."""
        if isinstance(node, ast.Name) and node.id in scope.values:
            number = scope.constants.get(node.id)
            return scope.values[node.id] if number is None else fold.literal(number)
        if isinstance(node, ast.Name | ast.Attribute | ast.Subscript):
            return self._read(node, scope)
        if isinstance(node, ast.Call):
            return self._result(node, scope)
        return fold.mapped(node, lambda inner: self.value(inner, scope))

    def _result(self, node: ast.Call, scope: Scope) -> ast.expr:
        function = self.program.refs[node]
        if isinstance(function, Access):
            record = scope.values[ast.unparse(node.args[0])]
            rest = [self.value(argument, scope) for argument in node.args[1:]]
            return ast.Call(ast.Name(function.name), [record, *rest], [])
        if isinstance(function, Operation):
            return fold.intrinsic(function.name, [self.value(each, scope) for each in node.args])
        assert isinstance(function, Function)
        if function.key in self.results:
            return fold.literal(self.results[function.key])
        copy, arguments = self._call(function, node, scope)
        if copy.expression is not None:
            placed = self._in_place(function, copy, arguments)
            if placed is not None:
                return placed
        return ast.Call(ast.Name(copy.name), arguments, [])

    def _call(
        self, function: Function, node: ast.Call, scope: Scope
    ) -> tuple[Copy, list[ast.expr]]:
        """The copy for a call, and the arguments it still takes."""
        arguments: list[ast.expr] = []
        for argument, its in zip(node.args, function.parameters.values(), strict=True):
            if its.kind == "record":
                arguments.append(scope.values[ast.unparse(argument)])
            elif its.shape:
                arguments.append(self._place(argument, scope))
            else:
                arguments.append(self.value(argument, scope))
        copy = self.copy(function, arguments)
        written = self.program.writers.get(function.key, frozenset())
        kept: list[ast.expr] = [ast.Name(name) for name in copy.records]
        for i, name in enumerate(function.parameters):
            argument = arguments[i]
            if function.parameters[name].shape and i in copy.parameters:
                if name in written:
                    self._store(argument, None)
                argument = self._table(argument, whole=True) or argument
            if i in copy.parameters:
                kept.append(argument)
        return copy, kept

    def _in_place(
        self, function: Function, copy: Copy, arguments: list[ast.expr]
    ) -> ast.expr | None:
        """The one expression that a function returns, with its arguments; None to call it."""
        assert copy.expression is not None
        names = [list(function.parameters)[i] for i in copy.parameters]
        given = dict(zip(names, arguments[len(copy.records) :], strict=True))
        uses = [n.id for n in walk(copy.expression) if isinstance(n, ast.Name)]
        for name, argument in given.items():
            simple = isinstance(argument, ast.Name) or fixed(argument)
            if not simple and (uses.count(name) > 1 or not fold.pure(argument)):
                return None
            if not simple and not fold.pure(copy.expression):
                return None
        return substituted(copy.expression, given)


def substituted(node: ast.expr, given: Mapping[str, ast.expr]) -> ast.expr:
    """``node`` with ``given`` in place of names, folded again."""

    def inside(n: ast.expr) -> ast.expr:
        return given.get(n.id, n) if isinstance(n, ast.Name) else fold.mapped(n, inside)

    return inside(node)
