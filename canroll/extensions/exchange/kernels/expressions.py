"""Expressions of kernels: their kind and their C."""

import ast
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from canroll.extensions.exchange.kernels.kinds import (
    BOOL,
    FLOAT,
    INT,
    UNSIGNED,
    ArrayKind,
    KernelError,
    Kind,
    NumberKind,
    RecordKind,
    Several,
    floating,
    integer,
    number_of,
    unified,
)

OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.BitAnd: "&",
    ast.BitOr: "|",
    ast.BitXor: "^",
    ast.LShift: "<<",
    ast.RShift: ">>",
}
COMPARISONS: dict[type[ast.AST], str] = {
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
}
OF_FLOATS: dict[Any, str] = {
    math.sin: "sin",
    math.cos: "cos",
    math.tan: "tan",
    math.atan: "atan",
    math.atan2: "atan2",
    math.tanh: "tanh",
    math.exp: "exp",
    math.log: "log",
    math.sqrt: "sqrt",
    math.hypot: "hypot",
    math.copysign: "copysign",
    np.expm1: "expm1",
    np.log1p: "log1p",
    np.rint: "rint",
    np.exp: "exp",
    np.sqrt: "sqrt",
}
CASTS: dict[Any, tuple[str, NumberKind]] = {
    int: ("(int64_t)", INT),
    np.int64: ("(int64_t)", INT),
    float: ("(double)", FLOAT),
    np.float64: ("(double)", FLOAT),
    np.uint64: ("(uint64_t)", UNSIGNED),
    np.uint8: ("(int64_t)(uint8_t)", INT),
}


@dataclass(frozen=True, slots=True)
class KernelValue:
    """An expression: its kind and C text."""

    kind: Kind
    c: str


class Static:
    """Wrapper of what an expression means where it is no value of the kernel."""

    def __init__(self, value: Any) -> None:  # noqa: ANN401
        self.value = value


@dataclass
class KernelScope:
    """What names mean in one function: variables with their kinds, and everything around it.

    ``call`` translates a call of another kernel, ``table`` names a constant array, ``make`` one
    that np.empty makes.
    """

    variables: dict[str, Kind]
    names: Mapping[str, Any]
    where: Callable[[ast.AST], str]
    call: Callable[[Any, list[KernelValue], dict[str, KernelValue]], KernelValue]
    table: Callable[[np.ndarray], KernelValue]
    make: Callable[[ast.Call], KernelValue]
    calls: int = 0

    @contextmanager
    def twice(self, node: ast.AST) -> Iterator[None]:
        """Refuse a kernel's call in what is translated here: C has the text of ``node`` twice."""
        before = self.calls
        yield
        if self.calls > before:
            raise self.refuse(node, "C would call this twice: assign its result to a name first")

    def refuse(self, node: ast.AST, why: str) -> KernelError:
        """The error for a construct outside the subset."""
        return KernelError(f"{self.where(node)}: {why}: {ast.unparse(node)}")

    def static(self, node: ast.AST) -> Static | None:
        """The constant, module or function that a node means; None for a value of the kernel."""
        if isinstance(node, ast.Constant):
            return Static(node.value)
        if isinstance(node, ast.Name):
            if node.id in self.variables or node.id not in self.names:
                return None
            return Static(self.names[node.id])
        if isinstance(node, ast.Attribute):
            inner = self.static(node.value)
            if inner is not None and isinstance(inner.value, ModuleType | type):
                return Static(getattr(inner.value, node.attr))
            return None
        if isinstance(node, ast.UnaryOp | ast.BinOp):
            parts = [n for n in ast.iter_child_nodes(node) if isinstance(n, ast.expr)]
            found = [self.static(part) for part in parts]
            if all(its is not None and isinstance(its.value, int | float) for its in found):
                values = {f"v{k}": its.value for k, its in enumerate(found) if its is not None}
                return Static(_folded(node, values))
        return None

    def value(self, node: ast.AST) -> KernelValue:
        """Translate an expression."""
        static = self.static(node)
        if static is not None:
            return self._constant(node, static.value)
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise self.refuse(node, "not in the kernels' subset")
        found: KernelValue = method(node)
        return found

    def number(self, node: ast.AST) -> KernelValue:
        """Translate an expression that is a number."""
        found = self.value(node)
        if not isinstance(found.kind, NumberKind):
            raise self.refuse(node, "a number is needed")
        return found

    def _constant(self, node: ast.AST, value: object) -> KernelValue:
        if isinstance(value, bool | np.bool_):
            return KernelValue(BOOL, str(int(value)))
        if isinstance(value, np.uint64):
            return KernelValue(UNSIGNED, f"UINT64_C({int(value)})")
        if isinstance(value, int | np.integer):
            text = integer(int(value))
            return KernelValue(INT, f"({text})" if int(value) < 0 else text)
        if isinstance(value, float):
            text = floating(value)
            return KernelValue(FLOAT, f"({text})" if text.startswith("-") else text)
        if isinstance(value, np.ndarray):
            return self.table(value)
        raise self.refuse(node, "no constant of the kernels' subset")

    def _name(self, node: ast.Name) -> KernelValue:
        if node.id not in self.variables:
            raise self.refuse(node, "unknown name")
        return KernelValue(self.variables[node.id], f"{node.id}_")

    def _attribute(self, node: ast.Attribute) -> KernelValue:
        owner = self.value(node.value)
        if isinstance(owner.kind, ArrayKind) and node.attr == "size":
            count = owner.kind.inner
            return KernelValue(INT, str(self._length(node, owner.kind) * count))
        if not isinstance(owner.kind, RecordKind):
            raise self.refuse(node, "an attribute of something else than a record")
        fields: Mapping[str, Any] = owner.kind.dtype.fields or {}
        if node.attr not in fields:
            raise self.refuse(node, "no such field")
        its = fields[node.attr][0]
        place = f"{owner.c}->{node.attr}"
        if its.shape:
            return KernelValue(ArrayKind(its.base, its.shape), place)
        if its.names:
            return KernelValue(RecordKind(its), f"(&{place})")
        return KernelValue(number_of(its), place)

    def _length(self, node: ast.AST, kind: ArrayKind) -> int:
        if kind.shape[0] is None:
            raise self.refuse(node, "the length is not known")
        return kind.shape[0]

    def place(self, node: ast.Subscript) -> KernelValue:
        """Translate an indexed element, row or slice."""
        owner = self.value(node.value)
        if isinstance(owner.kind, Several):
            static = self.static(node.slice)
            assert static is not None and isinstance(static.value, int)
            return KernelValue(owner.kind.items[static.value], f"{owner.c}.v{static.value}")
        if not isinstance(owner.kind, ArrayKind):
            raise self.refuse(node, "an index into something else than an array")
        kind, indices = owner.kind, [node.slice]
        if isinstance(node.slice, ast.Tuple):
            indices = list(node.slice.elts)
        if isinstance(node.slice, ast.Slice):
            return self._part(node.slice, owner, kind)
        parts = []
        for depth, index in enumerate(indices):
            step = ArrayKind(kind.dtype, kind.shape[depth:]).inner
            text = self.number(index).c
            parts.append(text if step == 1 else f"({text}) * {step}")
        at, rest = " + ".join(parts), kind.shape[len(indices) :]
        if rest:
            return KernelValue(ArrayKind(kind.dtype, rest), f"({owner.c} + {at})")
        if kind.dtype.names:
            return KernelValue(RecordKind(kind.dtype), f"(&{owner.c}[{at}])")
        return KernelValue(number_of(kind.dtype), f"{owner.c}[{at}]")

    def _part(self, node: ast.Slice, owner: KernelValue, kind: ArrayKind) -> KernelValue:
        low = self.static(node.lower) if node.lower else Static(0)
        high = self.static(node.upper) if node.upper else Static(kind.shape[0])
        size = None
        if low is not None and high is not None and high.value is not None:
            assert isinstance(low.value, int) and isinstance(high.value, int)
            size = high.value - low.value
        elif isinstance(node.upper, ast.BinOp) and isinstance(node.upper.op, ast.Add):
            more = self.static(node.upper.right)
            if more is not None and node.lower is not None and _same(node.upper.left, node.lower):
                size = int(more.value)
        start = self.number(node.lower).c if node.lower else "0"
        step = "" if kind.inner == 1 else f" * {kind.inner}"
        text = owner.c if start == "0" else f"({owner.c} + ({start}){step})"
        return KernelValue(ArrayKind(kind.dtype, (size, *kind.shape[1:])), text)

    def _subscript(self, node: ast.Subscript) -> KernelValue:
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            owner, index = self.value(node.value.value), self.static(node.slice)
            assert isinstance(owner.kind, ArrayKind) and index is not None
            size = owner.kind.shape[int(str(index.value))]
            if size is None:
                raise self.refuse(node, "the length is not known")
            return KernelValue(INT, str(size))
        return self.place(node)

    def _binop(self, node: ast.BinOp) -> KernelValue:
        left, right = self.number(node.left), self.number(node.right)
        kind = unified(left.kind, right.kind)
        assert isinstance(kind, NumberKind)
        if isinstance(node.op, ast.Div):
            return KernelValue(FLOAT, f"((double){left.c} / (double){right.c})")
        if isinstance(node.op, ast.Pow):
            power = self.static(node.right)
            if power is not None and power.value == 2:
                with self.twice(node.left):
                    self.number(node.left)
                return KernelValue(kind, f"({left.c} * {left.c})")
            return KernelValue(FLOAT, f"pow({left.c}, {right.c})")
        if isinstance(node.op, ast.FloorDiv | ast.Mod):
            if kind == FLOAT:
                raise self.refuse(node, "a remainder of floats")
            name = "floor_quotient" if isinstance(node.op, ast.FloorDiv) else "floor_remainder"
            return KernelValue(INT, f"{name}({left.c}, {right.c})")
        if type(node.op) not in OPERATORS:
            raise self.refuse(node, "no operator of the kernels' subset")
        kind = INT if kind == BOOL else kind
        return KernelValue(kind, f"({left.c} {OPERATORS[type(node.op)]} {right.c})")

    def _unaryop(self, node: ast.UnaryOp) -> KernelValue:
        inner = self.number(node.operand)
        if isinstance(node.op, ast.Not):
            return KernelValue(BOOL, f"(!{inner.c})")
        sign = {ast.USub: "-", ast.Invert: "~", ast.UAdd: "+"}[type(node.op)]
        return KernelValue(INT if inner.kind == BOOL else inner.kind, f"({sign}{inner.c})")

    def _boolop(self, node: ast.BoolOp) -> KernelValue:
        word = " && " if isinstance(node.op, ast.And) else " || "
        return KernelValue(BOOL, f"({word.join(self.number(v).c for v in node.values)})")

    def _compare(self, node: ast.Compare) -> KernelValue:
        parts, left = [], node.left
        for operator, right in zip(node.ops, node.comparators, strict=True):
            if left is not node.left or isinstance(operator, ast.In | ast.NotIn):
                with self.twice(left):
                    self.number(left)
            if isinstance(operator, ast.In | ast.NotIn):
                assert isinstance(right, ast.Tuple)
                found = " || ".join(
                    f"{self.number(left).c} == {self.number(its).c}" for its in right.elts
                )
                parts.append(f"{'' if isinstance(operator, ast.In) else '!'}({found})")
            else:
                sign = COMPARISONS[type(operator)]
                parts.append(f"{self.number(left).c} {sign} {self.number(right).c}")
            left = right
        return KernelValue(BOOL, f"({' && '.join(parts)})")

    def _ifexp(self, node: ast.IfExp) -> KernelValue:
        yes, no = self.value(node.body), self.value(node.orelse)
        kind = unified(yes.kind, no.kind)
        cast = "(double)" if kind == FLOAT else ""
        return KernelValue(kind, f"({self.number(node.test).c} ? {cast}{yes.c} : {cast}{no.c})")

    def _call(self, node: ast.Call) -> KernelValue:
        if isinstance(node.func, ast.Name) and node.func.id in ("min", "max", "abs", "len", "bool"):
            return self._built_in(node, node.func.id)
        if isinstance(node.func, ast.Attribute) and node.func.attr == "reshape":
            return self._reshaped(node, node.func)
        static = self.static(node.func)
        if isinstance(node.func, ast.Name) and static is None:
            static = Static({"int": int, "float": float}.get(node.func.id))
        if static is None or static.value is None:
            raise self.refuse(node, "a call of something that is no kernel")
        kernel = getattr(static.value, "in_c", static.value)
        if kernel is np.empty or hasattr(kernel, "elements") or hasattr(kernel, "record"):
            return self.make(node)
        arguments = [self.value(argument) for argument in node.args]
        if hasattr(kernel, "same"):
            return arguments[0]
        if kernel in (math.floor, np.floor):
            return KernelValue(INT, f"((int64_t)floor({arguments[0].c}))")
        if kernel in (math.isnan, np.isnan):
            return KernelValue(BOOL, f"(isnan({arguments[0].c}) != 0)")
        if _hashable(kernel) and kernel in OF_FLOATS:
            text = ", ".join(f"(double){argument.c}" for argument in arguments)
            return KernelValue(FLOAT, f"{OF_FLOATS[kernel]}({text})")
        if _hashable(kernel) and kernel in CASTS:
            cast, kind = CASTS[kernel]
            return KernelValue(kind, f"({cast}({arguments[0].c}))")
        given = {word.arg: self.value(word.value) for word in node.keywords if word.arg}
        self.calls += 1
        return self.call(kernel, arguments, given)

    def _reshaped(self, node: ast.Call, method: ast.Attribute) -> KernelValue:
        owner = self.value(method.value)
        if not isinstance(owner.kind, ArrayKind) or not isinstance(node.args[0], ast.Tuple):
            raise self.refuse(node, "no shape of an array")
        sizes = [self.static(size) for size in node.args[0].elts]
        shape = tuple(size.value for size in sizes if size is not None)
        return KernelValue(ArrayKind(owner.kind.dtype, shape), owner.c)

    def _built_in(self, node: ast.Call, name: str) -> KernelValue:
        values = [self.value(argument) for argument in node.args]
        if name == "len":
            assert isinstance(values[0].kind, ArrayKind)
            return KernelValue(INT, str(self._length(node, values[0].kind)))
        if name == "bool":
            return KernelValue(BOOL, f"({values[0].c} != 0)")
        kind: Kind = values[0].kind
        for value in values[1:]:
            kind = unified(kind, value.kind)
        kind = INT if kind == BOOL else kind
        if name == "abs":
            text = f"fabs({values[0].c})" if kind == FLOAT else f"llabs({values[0].c})"
            return KernelValue(kind, text)
        text = values[0].c
        for value in values[1:]:
            word = {FLOAT: "float", INT: "int"}.get(kind) if isinstance(kind, NumberKind) else None
            if word is None:
                raise self.refuse(node, "the extreme of unsigned numbers")
            text = f"{name}_{word}({text}, {value.c})"
        return KernelValue(kind, text)


def _same(one: ast.AST, other: ast.AST) -> bool:
    return ast.dump(one) == ast.dump(other)


def _hashable(its: object) -> bool:
    try:
        hash(its)
    except TypeError:
        return False
    return True


def _folded(node: ast.UnaryOp | ast.BinOp, values: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """The value of an operation on constants."""
    names = [ast.Name(id=name, ctx=ast.Load()) for name in values]
    if isinstance(node, ast.UnaryOp):
        copy: ast.expr = ast.UnaryOp(op=node.op, operand=names[0])
    else:
        copy = ast.BinOp(left=names[0], op=node.op, right=names[1])
    expression = ast.fix_missing_locations(ast.Expression(copy))
    return eval(compile(expression, "constants", "eval"), {}, dict(values))
