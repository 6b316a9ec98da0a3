"""Expressions and conditions on intervals; each branch is restricted by its condition."""

import ast
from abc import abstractmethod
from collections.abc import Sequence
from itertools import product

from codegen.operations import intervals as iv
from codegen.operations.intervals import KINDS, Value
from codegen.operations.relations import RELATIONS, narrow
from codegen.operations.table import OPERATORS, Access, Operation
from codegen.proof.abstract_memory import Memory
from codegen.proof.abstract_state import AbstractState, Element, Reference
from codegen.subset.program import (
    Constant,
    FieldReference,
    Function,
    Local,
    Parameter,
    Record,
    is_scalar,
)
from codegen.subset.walk import walk


class ExpressionProof(Memory):
    """Values of expressions, states by conditions; a subclass runs the functions called."""

    def value(self, node: ast.expr, state: AbstractState) -> Value:
        """The interval of an expression in ``state``; calls in it change ``state``."""
        result = self._value(node, state)
        self._record(node, result)
        return result

    def _value(self, node: ast.expr, state: AbstractState) -> Value:
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

    def _read(self, node: ast.expr, state: AbstractState) -> Value:
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

    def _call(self, node: ast.Call, state: AbstractState) -> Value:
        function, names = self._arguments(node, state)
        result = None
        if self.proof:
            result, state.known = self._body(function, names, state.known)
        elif function.key in self.program.writers:
            state.known = {}
        return Value(*KINDS[function.result or "i32"]) if result is None else result

    def _body(
        self,
        function: Function,
        names: dict[str, Value | Reference],
        known: dict[Element, Value],
    ) -> tuple[Value | None, dict[Element, Value]]:
        """Run a function; return its result and the state after it."""
        result: Value | None = None
        joined: AbstractState | None = None
        for value, state in self._paths(function, names, known):
            state.names = {}
            if value is not None:
                result = value if result is None else iv.hull(result, value)
            joined = state if joined is None else self._join(joined, state)
        return result, joined.known if joined is not None else known

    def _arguments(
        self, node: ast.Call, state: AbstractState
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

    def _access(self, node: ast.Call, access: Access, state: AbstractState) -> Value:
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

    def _clear(self, node: ast.Call, record: Record, state: AbstractState) -> Value:
        """Set every element of a record to zero."""
        zero = Value(0, 0)
        for name in record.fields:
            array = self.arrays[record.name, name]
            self._oblige(node, array.lo <= 0 <= array.hi, f"{name} can't be zero", zero)
            if self.proof and not array.volatile:
                for indices in product(*map(range, array.shape)):
                    state.known[(record.name, name), indices] = zero
        return zero

    # conditions

    @abstractmethod
    def _paths(
        self,
        function: Function,
        names: dict[str, Value | Reference],
        known: dict[Element, Value],
    ) -> list[tuple[Value | None, AbstractState]]:
        """Run a function; return its result and final state for each path."""

    def branch(
        self, test: ast.expr, state: AbstractState
    ) -> tuple[AbstractState | None, AbstractState | None]:
        """States in which ``test`` holds and in which it does not; None where impossible."""
        if isinstance(test, ast.UnaryOp):
            yes, no = self.branch(test.operand, state)
            return no, yes
        if isinstance(test, ast.BoolOp):
            both = isinstance(test.op, ast.And)
            current: AbstractState | None = state
            left: AbstractState | None = None
            for part in test.values:
                if current is None:
                    break
                yes, no = self.branch(part, current)
                out, current = (no, yes) if both else (yes, no)
                if out is not None:
                    left = out if left is None else self._join(left, out)
            return (current, left) if both else (left, current)
        assert isinstance(test, ast.Compare)
        call = test.left if self.proof and isinstance(test.left, ast.Call) else None
        if call is not None and isinstance(self.refs[call], Function):
            return self._branch_on_call(test, call, state)
        a = self.value(test.left, state)
        b = self.value(test.comparators[0], state)
        op = type(test.ops[0])
        return (
            self._narrowed(test, op, a, b, state),
            self._narrowed(test, RELATIONS[op].negated, a, b, state),
        )

    def _branch_on_call(
        self, test: ast.Compare, call: ast.Call, state: AbstractState
    ) -> tuple[AbstractState | None, AbstractState | None]:
        """Branch on each path of the call separately, narrowing the call's arguments by it."""
        function, names = self._arguments(call, state)
        op = type(test.ops[0])
        results: list[AbstractState | None] = [None, None]
        for value, end in self._paths(function, names, state.known):
            after = AbstractState(dict(state.names), end.known)
            self._learn_arguments(call, function, end, after)
            assert value is not None
            self._record(call, value)
            limit = self.value(test.comparators[0], after)
            for i, each in enumerate((op, RELATIONS[op].negated)):
                if narrow(each, value, limit) is not None:
                    earlier = results[i]
                    # both ways may be open: each goes on with a state of its own
                    results[i] = after.copy() if earlier is None else self._join(earlier, after)
        return results[0], results[1]

    def _learn_arguments(
        self, call: ast.Call, function: Function, end: AbstractState, after: AbstractState
    ) -> None:
        """Narrow the arguments of ``call`` to the parameter intervals of one path."""
        stale = self._writes(call)
        for argument, name in zip(call.args, function.parameters, strict=True):
            learnt = end.names.get(name)
            if isinstance(learnt, Value) and name not in function.assigned:
                self._learn(argument, learnt, after, stale=stale)

    def _narrowed(
        self, test: ast.Compare, op: type[ast.cmpop], a: Value, b: Value, state: AbstractState
    ) -> AbstractState | None:
        one = narrow(op, a, b)
        two = narrow(RELATIONS[op].swapped, b, a)
        if one is None or two is None:
            return None
        narrowed = state.copy()
        stale = self._writes(test)
        self._learn(test.left, one, narrowed, stale=stale)
        self._learn(test.comparators[0], two, narrowed, stale=stale)
        return narrowed

    def _writes(self, node: ast.expr) -> bool:
        """Whether a call in ``node`` may write, so that what was read before it may be stale."""
        called = (self.refs[n] for n in walk(node) if isinstance(n, ast.Call))
        return any(isinstance(f, Function) and f.key in self.program.writers for f in called)

    def _learn(self, node: ast.expr, value: Value, state: AbstractState, *, stale: bool) -> None:
        """Narrow what ``node`` reads; of places only where it is not ``stale``."""
        ref = self.refs.get(node)
        if isinstance(ref, Local) and isinstance(node, ast.Name):
            state.names[ref.name] = value
        elif isinstance(ref, FieldReference | Parameter) and not stale:
            reference = self._place(node, state)
            assert reference.key is not None
            array = self.arrays[reference.key]
            fixed = all(index.lo == index.hi for index in reference.prefix)
            fixed = fixed and (self.proof or not reference.prefix)
            if fixed and not array.volatile and array.exact is None:
                indices = tuple(index.lo for index in reference.prefix)
                state.known[reference.key, indices] = value
