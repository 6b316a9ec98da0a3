"""Binary formats of the expressions of a program, as far as its records tell them.

A field has the format of its ``F``; those of format 0 without a unit are counts, flags or rows with
a shift of their own, of which nothing is known. A local or parameter has a format where all that is
given to it has the same. A shift divides the value or changes the format: it is taken for the
latter where it undoes a product of two formats, or where the field that is written is declared so.
"""

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from canroll.codegen.operations.table import Operation
from canroll.codegen.subset.program import (
    Constant,
    FieldReference,
    Function,
    Local,
    Parameter,
    Program,
    statements,
)
from canroll.codegen.subset.walk import walk

KEPT = frozenset({"absolute", "clamp", "narrow", "sat31", "sat32"})
"""Intrinsics whose result has the format of their first operand."""
SHIFTED = frozenset({"rsh", "scaled"})
"""Intrinsics that divide their first operand by a power of two."""
ROUNDS = 6
"""Passes over the program, in each of which what is known reaches one function further."""
DEPTH = 3
"""Most calls inside one another that are looked into for a result."""
MULTIPLE = 1 << 8
"""Largest constant that multiplies a value and not its format."""

Slot = tuple[tuple[str, str], str]
"""A local or parameter: its function and its name."""


@dataclass(frozen=True, slots=True)
class Format:
    """A known format.

    Attributes:
        places: number of binary places.
        steps: how it came about, "" for a plain value.
        factors: places of the two factors of a product.
        certain: whether it holds without a declared target.
    """

    places: int
    steps: str = ""
    factors: tuple[int, ...] = ()
    certain: bool = True

    @property
    def text(self) -> str:
        """The steps in brackets, or the format of a plain value."""
        return f"({self.steps})" if self.steps else f"Q{self.places}"


@dataclass
class Formats:
    """The formats of a program.

    Attributes:
        program: the program.
        known: places of locals and parameters; None where they differ or are not known.
    """

    program: Program
    known: dict[Slot, int | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        given = [
            (slot, its, node) for its in self.program.functions() for slot, node in self._given(its)
        ]
        for _ in range(ROUNDS):
            found: dict[Slot, int | None] = {}
            for slot, function, node in given:
                value = self._of(node, Scope(function, self.known))
                places = value.places if value is not None and value.certain else None
                found[slot] = places if found.setdefault(slot, places) == places else None
            self.known = found

    def note(self, function: Function, node: ast.stmt) -> str:
        """Return the formats of a statement that changes one; "" where not all are known."""
        if not isinstance(node, ast.Assign | ast.AnnAssign | ast.AugAssign | ast.Return):
            return ""
        scope = Scope(function, self.known)
        value = None if node.value is None else self._of(node.value, scope)
        if value is None or not value.steps or not value.places or self._notes_itself(node.value):
            return ""
        target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
        field_ = (
            self._of(target, scope) if isinstance(target, ast.Attribute | ast.Subscript) else None
        )
        if value.places != field_.places if field_ is not None else not value.certain:
            return ""
        return f"{value.steps} -> Q{value.places}"

    def _notes_itself(self, node: ast.expr | None) -> bool:
        """Whether a call is of a function whose own statement has the formats."""
        called = self.program.refs.get(node) if isinstance(node, ast.Call) else None
        if not isinstance(called, Function):
            return False
        return any(self.note(called, statement) for statement in statements(called.node))

    def _given(self, function: Function) -> Iterator[tuple[Slot, ast.expr]]:
        """What is given to the locals of a function, and to the parameters of what it calls."""
        for node in walk(function.node):
            if isinstance(node, ast.Assign | ast.AnnAssign | ast.AugAssign) and node.value:
                target = node.targets[0] if isinstance(node, ast.Assign) else node.target
                if isinstance(target, ast.Name):
                    yield (function.key, target.id), node.value
            called = self.program.refs.get(node) if isinstance(node, ast.Call) else None
            if isinstance(node, ast.Call) and isinstance(called, Function):
                for name, argument in zip(called.parameters, node.args, strict=True):
                    yield (called.key, name), argument

    def _of(self, node: ast.expr, scope: "Scope") -> Format | None:
        match node, self.program.refs.get(node):
            case ast.Name(id=name), Local() | Parameter():
                return scope.of(name)
            case ast.Subscript(value=base), _:
                return self._of(base, scope)
            case ast.Attribute(), FieldReference(field=its):
                return Format(its.q) if its.q or its.unit else None
            case ast.UnaryOp(operand=operand), _:
                return self._of(operand, scope)
            case ast.BinOp(left=left, op=ast.Mult(), right=right), _:
                return self._product(left, right, scope)
            case ast.BinOp(left=left, op=ast.RShift(), right=right), _:
                return _shifted(self._of(left, scope), self._number(right, scope))
            case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right), _:
                one, other = self._of(left, scope), self._of(right, scope)
                same = one is not None and other is not None and one.places == other.places
                return _summed(one, other) if same else None
            case ast.Call(args=[first, *_]), Operation(name=name) if name in KEPT:
                return self._of(first, scope)
            case ast.Call(args=[first, count]), Operation(name=name) if name in SHIFTED:
                return _shifted(self._of(first, scope), self._number(count, scope))
            case ast.Call(args=arguments), Function() as called if scope.depth < DEPTH:
                return self._result(called, arguments, scope)
        return None

    def _result(self, called: Function, arguments: list[ast.expr], scope: "Scope") -> Format | None:
        """The format of a function that is one expression, for its arguments."""
        body = list(statements(called.node))
        if len(body) != 1 or not isinstance(body[0], ast.Return) or body[0].value is None:
            return None
        names = list(called.parameters)
        values = {n: self._of(a, scope) for n, a in zip(names, arguments, strict=True)}
        numbers = {n: self._number(a, scope) for n, a in zip(names, arguments, strict=True)}
        inner = Scope(called, self.known, values, numbers, scope.depth + 1)
        return self._of(body[0].value, inner)

    def _product(self, left: ast.expr, right: ast.expr, scope: "Scope") -> Format | None:
        one, other = self._of(left, scope), self._of(right, scope)
        if one is not None and other is not None:
            places, certain = (one.places, other.places), one.certain and other.certain
            return Format(sum(places), f"{one.text} x {other.text}", places, certain)
        value, number = (one, right) if one is not None else (other, left)
        count = self._number(number, scope)
        if value is None or count is None:
            return None
        if count > MULTIPLE and count & (count - 1) == 0:
            bits = count.bit_length() - 1
            return Format(value.places + bits, f"{value.text} << {bits}", certain=False)
        return value if abs(count) <= MULTIPLE else None

    def _number(self, node: ast.expr, scope: "Scope") -> int | None:
        """A constant, or a parameter that was given one."""
        match node, self.program.refs.get(node):
            case (ast.Constant(value=int(number)), _) | (_, Constant(value=int(number))):
                return number
            case ast.Name(id=name), Parameter():
                return scope.numbers.get(name)
            case ast.BinOp(left=left, op=ast.LShift(), right=right), _:
                base, shift = self._number(left, scope), self._number(right, scope)
                return None if base is None or shift is None else base << shift
        return None


@dataclass(frozen=True, slots=True)
class Scope:
    """What is known in a function: of all its calls, or with the arguments of one."""

    function: Function
    known: Mapping[Slot, int | None]
    values: Mapping[str, Format | None] | None = None
    numbers: Mapping[str, int | None] = field(default_factory=dict)
    depth: int = 0

    def of(self, name: str) -> Format | None:
        """The format of a local or parameter."""
        if self.values is not None and name in self.values:
            return self.values[name]
        places = self.known.get((self.function.key, name))
        return None if places is None else Format(places)


def _summed(one: Format | None, other: Format | None) -> Format | None:
    assert one is not None and other is not None
    certain = one.certain and other.certain
    if one.steps == other.steps:
        return Format(one.places, one.steps, one.factors, certain)
    return Format(one.places, f"{one.text} + {other.text}", one.factors or other.factors, certain)


def _shifted(one: Format | None, count: int | None) -> Format | None:
    if one is None or count is None:
        return None
    steps = one.text if " + " in one.steps else one.steps or one.text
    return Format(
        one.places - count,
        f"{steps} >> {count}",
        certain=one.certain and count in one.factors,
    )
