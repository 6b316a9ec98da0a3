"""Expressions on intervals: values, places, and what must hold of them."""

import ast
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from codegen.operations import intervals as iv
from codegen.operations.intervals import KINDS, Value
from codegen.operations.table import OPERATORS, Access, Operation
from codegen.proof.abstract_memory import AbstractState, Element, Memory, Place
from codegen.subset.program import (
    Constant,
    FieldReference,
    Function,
    Local,
    Program,
    Record,
    is_scalar,
)


@dataclass(frozen=True, slots=True)
class Finding:
    """An obligation not met: its location, its kind, and the range that violates it."""

    path: str
    line: int
    what: str
    lo: int
    hi: int

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.what}: [{self.lo}, {self.hi}]"


class Evaluation(ABC):
    """Evaluates expressions of a program; a subclass runs the functions that they call.

    Args:
        program: whose functions are run.
        calibration: the numbers of the one calibration that it runs on, if it is known.
        any_calibration: whether a calibration may lie outside its declared ranges.

    Attributes:
        seen: the interval of each syntax node over all ways to reach it.
        obligations: path, line, column and kind of all that was to be shown.
    """

    def __init__(
        self,
        program: Program,
        *,
        calibration: Mapping[tuple[str, tuple[int, ...]], int] | None = None,
        any_calibration: bool = False,
    ) -> None:
        self.program, self.refs = program, program.refs
        self.memory = Memory(program, calibration, any_calibration=any_calibration)
        self.seen: dict[ast.AST, Value] = {}
        self.failed: dict[tuple[str, int, str], Finding] = {}
        self.obligations: set[tuple[str, int, int, str]] = set()
        self.function: Function = next(program.functions())

    @property
    def findings(self) -> list[Finding]:
        """Obligations not met, by place."""
        return sorted(self.failed.values(), key=lambda f: (f.path, f.line, f.what))

    @abstractmethod
    def _body(
        self,
        function: Function,
        names: dict[str, Value | Place],
        known: dict[Element, Value],
    ) -> tuple[Value | None, dict[Element, Value]]:
        """Run a function; return its result and what is known after it."""

    # obligations

    def _oblige(self, node: ast.AST, met: bool, what: str, value: Value) -> None:
        path = str(self.program.modules[self.function.module].path)
        line = getattr(node, "lineno", 0)
        self.obligations.add((path, line, getattr(node, "col_offset", 0), what))
        if not met:
            before = self.failed.get((path, line, what))
            worst = value if before is None else iv.hull(value, Value(before.lo, before.hi))
            self.failed[path, line, what] = Finding(path, line, what, worst.lo, worst.hi)

    def _record(self, node: ast.AST, value: Value) -> None:
        before = self.seen.get(node)
        if before is None or not value.within(before.lo, before.hi):
            self.seen[node] = value if before is None else iv.hull(before, value)

    def _stored(self, node: ast.AST, value: Value, lo: int, hi: int, what: str) -> Value:
        self._record(node, value)
        self._oblige(node, value.within(lo, hi), f"does not fit {what}", value)
        return value.limited(lo, hi)

    # places

    def _place(self, node: ast.expr, state: AbstractState) -> Place:
        if isinstance(node, ast.Subscript):
            base = self._place(node.value, state)
            index = self.value(node.slice, state)
            size = self.memory.array(base).shape[len(base.indices)]
            self._oblige(node, index.within(0, size - 1), f"index of {size} elements", index)
            indices = (*base.indices, index.limited(0, size - 1))
            return Place(base.owner, base.kind, base.name, indices)
        match self.refs[node]:
            case Constant(module=module, name=name):
                return Place(f"module {module}", f"module {module}", name)
            case FieldReference(owner=owner, field=row):
                record = state.names[owner]
                assert isinstance(record, Place)
                return Place(record.owner, record.kind, row.name)
        assert isinstance(node, ast.Name)
        place = state.names[node.id]
        assert isinstance(place, Place)
        return place

    def _store(self, node: ast.stmt, target: ast.expr, value: Value, state: AbstractState) -> None:
        ref = self.refs[target]
        if isinstance(ref, Local):
            state.names[ref.name] = self._stored(node, value, *KINDS[ref.kind], ref.kind)
            return
        place = self._place(target, state)
        array = self.memory.array(place)
        label = f"{place.name} is declared in [{array.lo}, {array.hi}]"
        value = self._stored(node, value, array.lo, array.hi, label)
        self.memory.store(place, value, state)

    # expressions

    def value(self, node: ast.expr, state: AbstractState) -> Value:
        """The interval of an expression in ``state``; calls in it change ``state``."""
        result = self._value(node, state)
        self._record(node, result)
        return result

    def _value(self, node: ast.expr, state: AbstractState) -> Value:
        match node:
            case ast.Constant(value=int(number)):
                return Value(number, number)
            case ast.UnaryOp():
                return self._checked(node, iv.negate(self.value(node.operand, state)))
            case ast.BinOp():
                sides = [self.value(node.left, state), self.value(node.right, state)]
                return self._operate(node, OPERATORS[type(node.op)], sides)
        if isinstance(node, ast.Call):
            return self._call(node, state)
        match self.refs[node]:
            case Constant(value=int(number)):
                return Value(number, number)
            case Local(name=name):
                local = state.names[name]
                assert isinstance(local, Value)
                return local
        return self.memory.load(self._place(node, state), state)

    def _call(self, node: ast.Call, state: AbstractState) -> Value:
        match self.refs[node]:
            case Access() as access:
                return self._access(node, access, state)
            case Operation() as operation:
                return self._operate(node, operation, [self.value(a, state) for a in node.args])
            case Function() as function:
                names = self._arguments(node, function, state)
                result, state.known = self._body(function, names, state.known)
                return Value(*KINDS[function.result or "i32"]) if result is None else result
        raise AssertionError(ast.unparse(node))

    def _arguments(
        self, node: ast.Call, function: Function, state: AbstractState
    ) -> dict[str, Value | Place]:
        names: dict[str, Value | Place] = {}
        for argument, (name, kind) in zip(node.args, function.parameters.items(), strict=True):
            if is_scalar(kind):
                given = self.value(argument, state)
                names[name] = self._stored(argument, given, *KINDS[kind.kind], kind.kind)
            else:
                names[name] = self._place(argument, state)
        return names

    def _checked(self, node: ast.AST, value: Value) -> Value:
        self._oblige(node, value.within(*KINDS["i64"]), "overflows 64 bits", value)
        self._record(node, value)
        return value.limited(*KINDS["i64"])

    def _operate(self, node: ast.AST, operation: Operation, operands: Sequence[Value]) -> Value:
        for met, what, shown in operation.obligations(*operands):
            self._oblige(node, met, what, shown)
        result = operation.interval(*operands)
        return self._checked(node, result) if operation.overflows else result

    def _access(self, node: ast.Call, access: Access, state: AbstractState) -> Value:
        """A record read or written as memory: an element read is any value of its kind."""
        place = self._place(node.args[0], state)
        record = self.program.record(place.kind)
        if access.effect == "clear":
            return self._clear(node, record, state)
        if access.effect == "size":
            return Value(record.size, record.size)
        size = record.size // (4 if access.element == "i32" else 1)
        index = self.value(node.args[1], state)
        self._oblige(node, index.within(0, size - 1), f"index of {size} elements", index)
        if access.effect == "read":
            return Value(*KINDS[access.element])
        value = self.value(node.args[2], state)
        self._stored(node, value, *KINDS[access.element], access.element)
        # part of a calibration that the loop does not run on
        self.memory.forget(place, state)
        return Value(0, 0)

    def _clear(self, node: ast.Call, record: Record, state: AbstractState) -> Value:
        """Set every element of a record to zero."""
        zero = Value(0, 0)
        for name, row in record.fields.items():
            self._oblige(node, row.lo <= 0 <= row.hi, f"{name} can't be zero", zero)
        self.memory.clear(self._place(node.args[0], state), record, state)
        return zero
