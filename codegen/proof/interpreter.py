"""Interpreter of the firmware's source on intervals instead of integers.

Two ways of running it share this interpreter. **Modular*: each function separately, with
parameters of any value and loops to a fixed point; the emitter chooses C types by these intervals.
*Proof*: calls followed, loops unrolled, each element of each record tracked; every overflow, store,
index and divisor is an obligation, and :attr:`Interpreter.findings` lists those not met.
Conditions narrow what they compare; where paths meet their values are joined.
"""

import ast

from codegen.operations.intervals import KINDS, Value
from codegen.operations.table import OPERATORS
from codegen.proof.abstract_state import AbstractState, Array, Element, Reference, same
from codegen.proof.expressions import ExpressionProof
from codegen.subset.program import Function, SubsetError, Type

UNROLLED = 64
"""Rounds of a loop that are followed one by one."""
NESTED = UNROLLED**2
"""Rounds of loops in each other that a bounded module may have."""


class Interpreter(ExpressionProof):
    """Runs functions of a program on intervals; the module's docstring describes the two modes."""

    def run(self, function: Function, state: AbstractState | None = None) -> Value | None:
        """Run ``function`` with parameters of any value of their type."""
        names: dict[str, Value | Reference] = {}
        for name, its in function.parameters.items():
            names[name] = self._any(function, name, its)
        known = state.known if state is not None else {}
        return self._body(function, names, known)[0]

    def _any(self, function: Function, name: str, its: Type) -> Value | Reference:
        if its.kind == "record":
            return Reference(its.record)
        lo, hi = KINDS[its.kind]
        if not its.shape:
            return Value(lo, hi)
        key = (f"parameter {function.module}.{function.name}", name)
        self.arrays[key] = Array(its.shape, lo, hi)
        return Reference("", key)

    def _paths(
        self,
        function: Function,
        names: dict[str, Value | Reference],
        known: dict[Element, Value],
    ) -> list[tuple[Value | None, AbstractState]]:
        """Run a function; return its result and final state for each path."""
        outer = (self.module, self.function, self.returns)
        self.module, self.function = self.program.modules[function.module], function
        self.returns = []
        end = self._block(function.node.body, AbstractState(names, dict(known)))
        if end is not None:
            self.returns.append((None, end))
        paths = self.returns
        self.module, self.function, self.returns = outer
        return paths

    def _block(
        self, statements: list[ast.stmt], state: AbstractState | None
    ) -> AbstractState | None:
        for i, statement in enumerate(statements):
            if state is None:
                return None
            if i and self._asks(statements[i - 1], statement):
                continue
            following = statements[i + 1] if i + 1 < len(statements) else None
            if following is not None and self._asks(statement, following):
                state = self._by_path(statement, following, state)
            else:
                state = self._statement(statement, state)
        return state

    def _asks(self, statement: ast.stmt, following: ast.stmt) -> bool:
        """Whether ``following`` is an ``if`` on the result that ``statement`` got from a call."""
        if not (self.proof and isinstance(statement, ast.AnnAssign)):
            return False
        if not (isinstance(following, ast.If) and isinstance(following.test, ast.Compare)):
            return False
        call = statement.value
        if not isinstance(call, ast.Call) or not isinstance(self.refs[call], Function):
            return False
        return ast.unparse(following.test.left) == ast.unparse(statement.target)

    def _by_path(
        self, statement: ast.stmt, following: ast.stmt, state: AbstractState
    ) -> AbstractState | None:
        """Run a call and the ``if`` on its result together, path by path."""
        assert isinstance(statement, ast.AnnAssign) and isinstance(statement.value, ast.Call)
        assert isinstance(statement.target, ast.Name)
        function, names = self._arguments(statement.value, state)
        joined: AbstractState | None = None
        for value, end in self._paths(function, names, state.known):
            assert value is not None
            self._record(statement.value, value)
            after = AbstractState(dict(state.names), end.known)
            self._store(statement, statement.target, value, after)
            self._learn_arguments(statement.value, function, end, after)
            outcome = self._statement(following, after)
            if outcome is not None:
                joined = outcome if joined is None else self._join(joined, outcome)
        return joined

    def _statement(self, node: ast.stmt, state: AbstractState) -> AbstractState | None:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            assert node.value is not None
            self._store(node, node.target, self.value(node.value, state), state)
        elif isinstance(node, ast.Assign):
            self._store(node, node.targets[0], self.value(node.value, state), state)
        elif isinstance(node, ast.AugAssign):
            sides = [self.value(node.target, state), self.value(node.value, state)]
            after = self._operate(node, OPERATORS[type(node.op)], sides)
            self._store(node, node.target, after, state)
        elif isinstance(node, ast.If):
            yes, no = self.branch(node.test, state)
            yes = self._block(node.body, yes)
            no = self._block(node.orelse, no)
            if yes is None or no is None:
                return yes or no
            return self._join(yes, no)
        elif isinstance(node, ast.For):
            return self._loop(node, state)
        elif isinstance(node, ast.Return):
            value = None
            if node.value is not None:
                value = self.value(node.value, state)
                kind = self.function.result or "i64"
                value = self._stored(node, value, *KINDS[kind], kind)
            self.returns.append((value, state))
            return None
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            self.value(node.value, state)
        return state

    def _loop(self, node: ast.For, state: AbstractState) -> AbstractState | None:
        assert isinstance(node.iter, ast.Call) and isinstance(node.target, ast.Name)
        start, stop, step = self._range(node.iter, state)
        first, last = (start.lo, stop.hi) if step > 0 else (start.hi, stop.lo)
        known_start = start.lo == start.hi
        trips = range(first, last, step)
        self.turns[node] = max(self.turns.get(node, 0), len(trips))
        outer = self.rounds
        self._bound(node, len(trips))
        end = self._rounds(node, state, trips, stop, unrolled=known_start)
        self.rounds = outer
        return end

    def _bound(self, node: ast.For, trips: int) -> None:
        """Multiply the rounds of loops around each other in the bounded module, or refuse them."""
        inside = self.rounds > 0
        if not (self.proof and (inside or self.module.name == self.bounded)):
            return
        self.rounds = max(self.rounds, 1) * max(trips, 1)
        if inside and self.rounds > NESTED:
            raise SubsetError(
                self.module.path,
                node,
                f"loops in each other make up to {self.rounds} rounds: limit them to {NESTED}",
            )

    def _rounds(
        self, node: ast.For, state: AbstractState, trips: range, stop: Value, *, unrolled: bool
    ) -> AbstractState | None:
        assert isinstance(node.target, ast.Name)
        name, rising = node.target.id, trips.step > 0
        if self.proof and unrolled and len(trips) <= UNROLLED:
            current: AbstractState | None = state
            for k in trips:
                if current is None:
                    return None
                certain = k < stop.lo if rising else k > stop.hi
                skipped = None if certain else current.copy()
                current.names[name] = Value(k, k)
                current = self._block(node.body, current)
                if skipped is not None:
                    current = skipped if current is None else self._join(skipped, current)
            if current is not None:
                current.names.pop(name, None)
            return current
        return self._fixed_point(node, name, trips, state)

    def _range(self, call: ast.Call, state: AbstractState) -> tuple[Value, Value, int]:
        bounds = [self.value(argument, state) for argument in call.args]
        if len(bounds) == 1:
            return Value(0, 0), bounds[0], 1
        return bounds[0], bounds[1], bounds[2].lo if len(bounds) == 3 else 1

    def _fixed_point(
        self, node: ast.For, name: str, trips: range, state: AbstractState
    ) -> AbstractState | None:
        if not trips:
            return state
        entry = state
        for attempt in range(6):
            inside = entry.copy()
            inside.names[name] = Value(min(trips[0], trips[-1]), max(trips[0], trips[-1]))
            after = self._block(node.body, inside)
            if after is None:
                return state
            after.names.pop(name, None)
            merged = self._join(entry, after)
            grown = [
                n
                for n, value in merged.names.items()
                if isinstance(value, Value) and not same(value, entry.names.get(n))
            ]
            changed = [e for e in merged.known if not same(merged.known[e], entry.known.get(e))]
            if not grown and not changed:
                return merged
            if attempt >= 2:
                for n in grown:
                    merged.names[n] = Value(*KINDS[self.function.kinds[n]])
                for element in changed:
                    del merged.known[element]
            entry = merged
        return entry
