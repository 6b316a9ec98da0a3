"""The closed grammar of the subset: all that may stand in a module that is executed.

The rules refuse by name what users try; the grammar lists what there is and refuses all else,
wherever it stands. CPython executes decorators, annotations and whatever else is at the top of a
module as it is imported, and the texts in the annotations of a record.
"""

import ast
from collections.abc import Iterable
from pathlib import Path
from types import EllipsisType

from canroll.codegen.operations.intervals import KINDS
from canroll.codegen.operations.relations import RELATIONS
from canroll.codegen.operations.table import CONSTANT_OPERATORS, INTRINSICS, OPERATORS
from canroll.codegen.subset.program import LIMITS, MOST_BITS, PACKAGE, RUNTIME, SubsetError

WORDS = frozenset((*KINDS, *LIMITS, *INTRINSICS, "F", "record"))
"""What the subset itself offers to modules of the firmware."""
TAKEN = WORDS | {"Annotated", "list", "range", "tuple"}
"""Names that CPython calls or indexes as it imports a module, which may not be defined anew."""
MOST_DEPTH = 200
"""Levels of a syntax tree: the passes descend it by recursion."""


def parsed(path: Path, source: str) -> ast.Module:
    """Return the syntax tree of a module; ``path`` is for messages.

    Raises:
        SubsetError: it is not Python, nested too deeply, or has too long a number.
    """
    try:
        # as bytes, of which CPython makes the same where it imports them: no other encoding
        tree = ast.parse(source.encode("utf-8-sig"))
    except SyntaxError as error:
        raise SubsetError(path, error.lineno or 1, error.msg) from error
    except ValueError as error:
        raise SubsetError(path, 1, str(error)) from error
    except (RecursionError, MemoryError) as error:
        raise SubsetError(path, 1, "nested too deeply") from error
    level: list[ast.AST] = [tree]
    for _ in range(MOST_DEPTH):
        level = [below for node in level for below in ast.iter_child_nodes(node)]
        if not level:
            return tree
        for node in level:
            value = getattr(node, "value", None)
            if isinstance(value, int) and value.bit_length() > MOST_BITS:
                raise SubsetError(path, node, f"a number of more than {MOST_BITS} bits")
    raise SubsetError(path, level[0], "nested too deeply")


def check(path: Path, tree: ast.Module) -> None:
    """Raise SubsetError, with ``path`` and line, for the first construct not in the grammar."""
    _Grammar(path, tree).module(tree)
    try:
        compile(tree, str(path), "exec")
    except SyntaxError as error:
        raise SubsetError(path, error.lineno or 1, error.msg) from error


class _Grammar:
    """Descends a module; each pattern names every field that CPython executes."""

    def __init__(self, path: Path, tree: ast.Module) -> None:
        self.path = path
        self.functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        self.names = {node.name for node in tree.body if isinstance(node, ast.ClassDef)}
        self.locals: set[str] | None = None

    def refuse(self, node: ast.AST) -> SubsetError:
        text = ast.unparse(node).partition("\n")[0]
        return SubsetError(self.path, node, f"'{text}' is not in the subset here")

    def module(self, tree: ast.Module) -> None:
        # a body may name what comes after it
        for node in sorted(tree.body, key=lambda node: isinstance(node, ast.FunctionDef)):
            match node:
                case ast.Expr(value=ast.Constant(value=str())):
                    pass
                case ast.ImportFrom(module=str(source), names=names, level=0):
                    self.imported(node, source, names)
                case ast.Assign(
                    targets=[ast.Name(id="__all__")], value=ast.List(elts=elements)
                ) if all(_is_text(element) for element in elements):
                    pass
                case ast.Assign(targets=[target], value=value):
                    self.constant(target, value)
                case ast.AnnAssign(target=target, annotation=kind, value=ast.expr() as value):
                    self.annotation(kind)
                    self.constant(target, value)
                case ast.FunctionDef():
                    self.function(node)
                case ast.ClassDef():
                    self.record(node)
                case _:
                    raise self.refuse(node)

    def imported(self, node: ast.ImportFrom, source: str, names: Iterable[ast.alias]) -> None:
        for alias in names:
            name = alias.name
            of_runtime = source == f"{PACKAGE}.{RUNTIME}"
            of_firmware = f"{source}.".startswith(f"{PACKAGE}.") and not name.startswith(("_", "*"))
            known = name in WORDS if of_runtime else of_firmware and name != RUNTIME
            if alias.asname is not None or not (known or (source, name) == ("typing", "Annotated")):
                raise self.refuse(node)
            self.names.add(name)
            if name in INTRINSICS if of_runtime else of_firmware:
                self.functions.add(name)

    def defined(self, node: ast.AST, name: str) -> None:
        if name.startswith("__") or name in TAKEN:
            raise self.refuse(node)

    def constant(self, target: ast.expr, value: ast.expr) -> None:
        for each in target.elts if isinstance(target, ast.Tuple) else (target,):
            if not isinstance(each, ast.Name):
                raise self.refuse(each)
            self.defined(each, each.id)
            self.names.add(each.id)
        self.expression(value)

    def record(self, node: ast.ClassDef) -> None:
        match node:
            case ast.ClassDef(
                bases=bases, keywords=[], decorator_list=[ast.Name(id="record")], body=body
            ) if not getattr(node, "type_params", None):
                self.defined(node, node.name)
                for base in bases:
                    self.name(base)
            case _:
                raise self.refuse(node)
        for statement in body:
            match statement:
                case ast.Expr(value=ast.Constant(value=str())):
                    pass
                case ast.AnnAssign(target=ast.Name(id=name), annotation=kind, value=None) if (
                    not name.startswith("__")
                ):
                    self.annotation(kind, in_record=True)
                case _:
                    raise self.refuse(statement)

    def annotation(self, node: ast.expr, *, in_record: bool = False) -> None:
        """A type; that of a field ends in ``F(…)``."""
        match node:
            case ast.Subscript(
                value=ast.Name(id="Annotated"), slice=ast.Tuple(elts=[kind, *sizes])
            ):
                self.annotation(kind)
                if in_record and sizes:
                    self.described(sizes.pop())
                for size in sizes:
                    self.expression(size)
            case ast.Subscript(value=ast.Name(id="list"), slice=kind):
                self.annotation(kind)
            case ast.Subscript(
                value=ast.Name(id="tuple"),
                slice=ast.Tuple(elts=[kind, ast.Constant(value=EllipsisType())]),
            ):
                self.annotation(kind)
            case _:
                self.name(node)

    def described(self, node: ast.expr) -> None:
        match node:
            case ast.Call(
                func=ast.Name(id="F"), args=[least, largest, q, unit, meaning, *rest], keywords=[]
            ) if _is_text(unit) and _is_text(meaning):
                for bound in (least, largest, q):
                    self.expression(bound)
                match rest:
                    case [] | [ast.Constant(value=bool())]:
                        return
        raise self.refuse(node)

    def function(self, node: ast.FunctionDef) -> None:
        match node:
            case ast.FunctionDef(
                args=ast.arguments(
                    posonlyargs=[],
                    args=parameters,
                    vararg=None,
                    kwonlyargs=[],
                    kw_defaults=[],
                    kwarg=None,
                    defaults=[],
                ),
                decorator_list=[],
                returns=returned,
            ) if not getattr(node, "type_params", None):
                self.defined(node, node.name)
                kinds = [each.annotation for each in parameters]
            case _:
                raise self.refuse(node)
        if not (isinstance(returned, ast.Constant) and returned.value is None):
            kinds.append(returned)
        for kind in kinds:
            if kind is None:
                raise self.refuse(node)
            self.annotation(kind)
        stored = (n for n in ast.walk(node) if isinstance(n, ast.Name))
        self.locals = {n.id for n in stored if isinstance(n.ctx, ast.Store)}
        self.locals |= {each.arg for each in parameters}
        self.block(node.body)
        self.locals = None

    def block(self, body: Iterable[ast.stmt]) -> None:
        for node in body:
            match node:
                case ast.Expr(value=ast.Constant(value=str())) | ast.Return(value=None):
                    pass
                case ast.Expr(value=ast.Call() as value) | ast.Return(value=ast.expr() as value):
                    self.expression(value)
                case ast.Assign(targets=[target], value=value):
                    self.expression(target)
                    self.expression(value)
                case ast.AnnAssign(
                    target=ast.Name() as target, annotation=kind, value=ast.expr() as value
                ):
                    self.annotation(kind)
                    self.expression(target)
                    self.expression(value)
                case ast.AugAssign(target=target, op=op, value=value) if type(op) in OPERATORS:
                    self.expression(target)
                    self.expression(value)
                case ast.If(test=test, body=inside, orelse=other):
                    self.expression(test)
                    self.block(inside)
                    self.block(other)
                case ast.For(
                    target=ast.Name() as target,
                    iter=ast.Call(func=ast.Name(id="range"), args=bounds, keywords=[]),
                    body=inside,
                    orelse=[],
                ):
                    for each in (target, *bounds):
                        self.expression(each)
                    self.block(inside)
                case _:
                    raise self.refuse(node)

    def expression(self, node: ast.expr) -> None:
        parts: list[ast.expr] = []
        match node:
            case ast.Constant(value=int(value)) if type(value) is int:
                pass
            case ast.Name():
                self.name(node)
            case ast.Attribute(value=ast.Name() as owner, attr=attribute) if (
                not attribute.startswith("_")
            ):
                self.name(owner)
            case ast.Subscript(value=value, slice=index):
                parts = [value, index]
            case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
                parts = [operand]
            case ast.BinOp(left=left, op=op, right=right) if type(op) in CONSTANT_OPERATORS:
                parts = [left, right]
            case ast.Compare(left=left, ops=ops, comparators=rights) if all(
                type(op) in RELATIONS for op in ops
            ):
                parts = [left, *rights]
            case ast.BoolOp(values=parts) | ast.Tuple(elts=parts):
                pass
            case ast.Call(func=called, args=parts, keywords=[]) if self.locals is not None:
                self.called(called)
            case _:
                raise self.refuse(node)
        for part in parts:
            self.expression(part)

    def called(self, node: ast.expr) -> None:
        """A function of the firmware or of the subset: its name, or that of a module before it."""
        named = node.value if isinstance(node, ast.Attribute) else node
        if not isinstance(named, ast.Name) or named.id not in self.functions:
            raise self.refuse(node)
        self.expression(node)

    def name(self, node: ast.expr) -> None:
        known = self.names | self.functions | (self.locals or set())
        if not isinstance(node, ast.Name) or node.id not in known or node.id.startswith("__"):
            raise self.refuse(node)


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)
