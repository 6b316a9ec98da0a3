"""Conditions on intervals: each branch is restricted by its condition."""

import ast
from abc import abstractmethod

from codegen.operations.intervals import Value
from codegen.operations.relations import RELATIONS, narrow
from codegen.proof.abstract_state import Element, Reference, State
from codegen.proof.expressions import Expressions
from codegen.subset.program import Function, Local, Member, Parameter


class Conditions(Expressions):
    """Splits states on comparisons and on results of called functions."""

    @abstractmethod
    def _paths(
        self,
        function: Function,
        names: dict[str, Value | Reference],
        known: dict[Element, Value],
    ) -> list[tuple[Value | None, State]]:
        """Run a function; return its result and final state for each path."""

    def branch(self, test: ast.expr, state: State) -> tuple[State | None, State | None]:
        """States in which ``test`` holds and in which it does not; None where impossible."""
        if isinstance(test, ast.UnaryOp):
            yes, no = self.branch(test.operand, state)
            return no, yes
        if isinstance(test, ast.BoolOp):
            both = isinstance(test.op, ast.And)
            current: State | None = state
            left: State | None = None
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
        self, test: ast.Compare, call: ast.Call, state: State
    ) -> tuple[State | None, State | None]:
        """Branch on each path of the call separately, narrowing the call's arguments by it."""
        function, names = self._arguments(call, state)
        op = type(test.ops[0])
        results: list[State | None] = [None, None]
        for value, end in self._paths(function, names, state.known):
            after = State(dict(state.names), end.known)
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
        self, call: ast.Call, function: Function, end: State, after: State
    ) -> None:
        """Narrow the arguments of ``call`` to the parameter intervals of one path."""
        stale = self._writes(call)
        for argument, name in zip(call.args, function.parameters, strict=True):
            learnt = end.names.get(name)
            if isinstance(learnt, Value) and name not in function.assigned:
                self._learn(argument, learnt, after, stale=stale)

    def _narrowed(
        self, test: ast.Compare, op: type[ast.cmpop], a: Value, b: Value, state: State
    ) -> State | None:
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
        called = (self.refs[n] for n in ast.walk(node) if isinstance(n, ast.Call))
        return any(isinstance(f, Function) and f.key in self.program.writers for f in called)

    def _learn(self, node: ast.expr, value: Value, state: State, *, stale: bool) -> None:
        """Narrow what ``node`` reads; of places only where it is not ``stale``."""
        ref = self.refs.get(node)
        if isinstance(ref, Local) and isinstance(node, ast.Name):
            state.names[ref.name] = value
        elif isinstance(ref, Member | Parameter) and not stale:
            reference = self._place(node, state)
            assert reference.key is not None
            array = self.arrays[reference.key]
            fixed = all(index.lo == index.hi for index in reference.prefix)
            fixed = fixed and (self.proof or not reference.prefix)
            if fixed and not array.volatile and array.exact is None:
                indices = tuple(index.lo for index in reference.prefix)
                state.known[reference.key, indices] = value
