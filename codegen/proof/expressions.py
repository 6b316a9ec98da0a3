"""Expressions on intervals: operators, intrinsics, calls."""

import ast
from abc import abstractmethod
from collections.abc import Sequence
from itertools import product

from codegen.operations import intervals as iv
from codegen.operations.intervals import KINDS, Value
from codegen.operations.table import OPERATORS, Access, Operation
from codegen.proof.abstract_memory import Memory
from codegen.proof.abstract_state import Element, Reference, State
from codegen.subset.program import Constant, Function, Local, Parameter, Record, is_scalar


class Expressions(Memory):
    """Values of expressions; subclasses define calls and branches on conditions."""

    @abstractmethod
    def _body(
        self,
        function: Function,
        names: dict[str, Value | Reference],
        known: dict[Element, Value],
    ) -> tuple[Value | None, dict[Element, Value]]:
        """Run a function; return its result and the state after it."""

    def value(self, node: ast.expr, state: State) -> Value:
        """The interval of an expression in ``state``; calls in it change ``state``."""
        result = self._value(node, state)
        self._record(node, result)
        return result

    def _value(self, node: ast.expr, state: State) -> Value:
        if isinstance(node, ast.Constant):
            return Value(int(node.value), int(node.value))  # type: ignore[arg-type]
        if isinstance(node, ast.Name | ast.Attribute | ast.Subscript):
            return self._read(node, state)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return self._checked(node, iv.negate(self.value(node.operand, state)))
        if isinstance(node, ast.BinOp):
            sides = [self.value(node.left, state), self.value(node.right, state)]
            return self._operate(node, OPERATORS[type(node.op)], sides)
        assert isinstance(node, ast.Call), ast.unparse(node)
        match self.refs[node]:
            case Access() as access:
                return self._access(node, access, state)
            case Operation() as operation:
                return self._operate(node, operation, [self.value(a, state) for a in node.args])
        return self._call(node, state)

    def _read(self, node: ast.expr, state: State) -> Value:
        """A constant, a local, a field or an element."""
        match self.refs[node]:
            case Constant(value=int(number)):
                return Value(number, number)
            case Local(name=name):
                value = state.names[name]
                assert isinstance(value, Value)
                return value
        return self._load(self._place(node, state), state)

    def _operate(self, node: ast.AST, operation: Operation, a: Sequence[Value]) -> Value:
        for met, what, shown in operation.obligations(*a):
            self._oblige(node, met, what, shown)
        result = operation.interval(*a)
        return self._checked(node, result) if operation.overflows else result

    def _call(self, node: ast.Call, state: State) -> Value:
        function, names = self._arguments(node, state)
        result = None
        if self.proof:
            result, state.known = self._body(function, names, state.known)
        elif function.key in self.program.writers:
            state.known = {}
        return Value(*KINDS[function.result or "i32"]) if result is None else result

    def _arguments(
        self, node: ast.Call, state: State
    ) -> tuple[Function, dict[str, Value | Reference]]:
        function = self.refs[node]
        assert isinstance(function, Function)
        names: dict[str, Value | Reference] = {}
        for argument, (name, its) in zip(node.args, function.parameters.items(), strict=True):
            if is_scalar(its):
                given = self.value(argument, state)
                names[name] = self._stored(argument, given, *KINDS[its.kind], its.kind)
            else:
                names[name] = self._place(argument, state)
        return function, names

    def _access(self, node: ast.Call, access: Access, state: State) -> Value:
        """A record read or written as memory: an element read is any value of its kind."""
        given = self.refs[node.args[0]]
        assert isinstance(given, Parameter)
        record = self.program.record(given.type.record)
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
        # part of a calibration that the loop does not run on: forget what was known of it
        state.known = {e: value for e, value in state.known.items() if e[0][0] != record.name}
        return Value(0, 0)

    def _clear(self, node: ast.Call, record: Record, state: State) -> Value:
        """Set every element of a record to zero."""
        zero = Value(0, 0)
        for name in record.fields:
            array = self.arrays[record.name, name]
            self._oblige(node, array.lo <= 0 <= array.hi, f"{name} can't be zero", zero)
            if self.proof and not array.volatile:
                for indices in product(*map(range, array.shape)):
                    state.known[(record.name, name), indices] = zero
        return zero
