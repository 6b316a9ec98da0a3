"""Interpreter of the firmware's source on intervals instead of integers.

Calls are followed, loops unrolled or run to a fixed point, each element of each record tracked;
every overflow, store, index and divisor is an obligation, and :attr:`Interpreter.findings` lists
those not met. Conditions narrow what they compare; where paths meet their values are joined. Two
records of one class are two places: nothing known of the one holds of the other.
"""

import ast
from collections.abc import Iterator, Mapping

from codegen.operations import intervals as iv
from codegen.operations.intervals import KINDS, Value
from codegen.operations.relations import RELATIONS, narrow
from codegen.operations.table import OPERATORS
from codegen.proof.abstract_memory import AbstractState, Element, Place, Way
from codegen.proof.expressions import Evaluation
from codegen.subset.program import (
    FieldReference,
    Function,
    Local,
    Parameter,
    Program,
    SubsetError,
)
from codegen.subset.walk import walk

UNROLLED = 64
"""Rounds of a loop that are followed one by one."""
NESTED = UNROLLED**2
"""Rounds of loops in each other that a bounded module may have."""
WIDENED = 2
"""Rounds to a fixed point after which what still grows is given up."""


class Interpreter(Evaluation):
    """Runs functions of a program on intervals.

    Args:
        program, calibration, any_calibration: as of the evaluation of expressions.
        bounded: name of a module whose loops in each other are limited.

    Attributes:
        turns: the most rounds of each loop.
    """

    def __init__(
        self,
        program: Program,
        *,
        calibration: Mapping[tuple[str, tuple[int, ...]], int] | None = None,
        any_calibration: bool = False,
        bounded: str = "",
    ) -> None:
        super().__init__(program, calibration=calibration, any_calibration=any_calibration)
        self.turns: dict[ast.For, int] = {}
        self.returns: list[tuple[Value | None, AbstractState]] = []
        self.bounded, self.rounds = bounded, 0

    def run(self, function: Function) -> Value | None:
        """Run ``function`` with parameters of any value of their type."""
        return self._body(function, self.memory.parameters(function), {})[0]

    # calls

    def _paths(
        self,
        function: Function,
        names: dict[str, Value | Place],
        known: dict[Element, Value],
    ) -> list[tuple[Value | None, AbstractState]]:
        """Run a function; return its result and final state for each path."""
        outer = self.function, self.returns
        self.function, self.returns = function, []
        end = self._block(function.node.body, AbstractState(names, dict(known)))
        paths = self.returns if end is None else [*self.returns, (None, end)]
        self.function, self.returns = outer
        return paths

    def _body(
        self,
        function: Function,
        names: dict[str, Value | Place],
        known: dict[Element, Value],
    ) -> tuple[Value | None, dict[Element, Value]]:
        """Run a function; return its result and what is known after it."""
        result: Value | None = None
        end: Way = None
        for value, state in self._paths(function, names, known):
            state.names = {}
            if value is not None:
                result = value if result is None else iv.hull(result, value)
            end = self.memory.joined(end, state)
        return result, known if end is None else end.known

    def _outcomes(
        self, call: ast.Call, state: AbstractState
    ) -> Iterator[tuple[Value, AbstractState]]:
        """Result and state for each path of a call, its arguments narrowed by that path."""
        function = self.refs[call]
        assert isinstance(function, Function)
        stale = self._writes(call)
        for value, end in self._paths(
            function, self._arguments(call, function, state), state.known
        ):
            assert value is not None
            after = AbstractState(dict(state.names), end.known)
            for argument, name in zip(call.args, function.parameters, strict=True):
                learnt = end.names.get(name)
                if isinstance(learnt, Value) and name not in function.assigned:
                    self._learn(argument, learnt, after, stale=stale)
            self._record(call, value)
            yield value, after

    def _writes(self, node: ast.expr) -> bool:
        """Whether a call in ``node`` may write, so that what was read before it may be stale."""
        called = (self.refs[n] for n in walk(node) if isinstance(n, ast.Call))
        return any(isinstance(f, Function) and f.key in self.program.writers for f in called)

    # conditions

    def branch(self, test: ast.expr, state: AbstractState) -> tuple[Way, Way]:
        """States in which ``test`` holds and in which it does not; None where impossible."""
        match test:
            case ast.UnaryOp():
                return self.branch(test.operand, state)[::-1]
            case ast.BoolOp():
                both = isinstance(test.op, ast.And)
                current: Way = state
                left: Way = None
                for part in test.values:
                    if current is None:
                        break
                    yes, no = self.branch(part, current)
                    out, current = (no, yes) if both else (yes, no)
                    left = self.memory.joined(left, out)
                return (current, left) if both else (left, current)
        assert isinstance(test, ast.Compare)
        op, other = type(test.ops[0]), test.comparators[0]
        each_way = op, RELATIONS[op].negated
        if isinstance(test.left, ast.Call) and isinstance(self.refs[test.left], Function):
            ways: list[Way] = [None, None]
            for value, after in self._outcomes(test.left, state):
                limit = self.value(other, after)
                for i, each in enumerate(each_way):
                    if narrow(each, value, limit) is not None:
                        ways[i] = self.memory.joined(ways[i], after) if ways[i] else after.copy()
            return ways[0], ways[1]
        a, b = self.value(test.left, state), self.value(other, state)
        yes, no = (self._narrowed(test, each, a, b, state) for each in each_way)
        return yes, no

    def _narrowed(
        self, test: ast.Compare, op: type[ast.cmpop], a: Value, b: Value, state: AbstractState
    ) -> Way:
        one, two = narrow(op, a, b), narrow(RELATIONS[op].swapped, b, a)
        if one is None or two is None:
            return None
        narrowed, stale = state.copy(), self._writes(test)
        self._learn(test.left, one, narrowed, stale=stale)
        self._learn(test.comparators[0], two, narrowed, stale=stale)
        return narrowed

    def _learn(self, node: ast.expr, value: Value, state: AbstractState, *, stale: bool) -> None:
        """Narrow what ``node`` reads; of places only where it is not ``stale``."""
        ref = self.refs.get(node)
        if isinstance(ref, Local) and isinstance(node, ast.Name):
            state.names[ref.name] = value
        elif isinstance(ref, FieldReference | Parameter) and not stale:
            self.memory.learn(self._place(node, state), value, state)

    # statements

    def _block(self, statements: list[ast.stmt], state: Way) -> Way:
        todo = list(reversed(statements))
        while todo and state is not None:
            statement = todo.pop()
            if todo and self._asks(statement, todo[-1]):
                state = self._by_path(statement, todo.pop(), state)
            else:
                state = self._statement(statement, state)
        return state

    def _asks(self, statement: ast.stmt, following: ast.stmt) -> bool:
        """Whether ``following`` is an ``if`` on the result that ``statement`` got from a call."""
        match statement, following:
            case ast.AnnAssign(value=ast.Call() as call), ast.If(test=ast.Compare(left=left)):
                asked = ast.unparse(left) == ast.unparse(statement.target)
                return isinstance(self.refs[call], Function) and asked
        return False

    def _by_path(self, statement: ast.stmt, following: ast.stmt, state: AbstractState) -> Way:
        """Run a call and the ``if`` on its result together, path by path."""
        assert isinstance(statement, ast.AnnAssign) and isinstance(statement.value, ast.Call)
        end: Way = None
        for value, after in self._outcomes(statement.value, state):
            self._store(statement, statement.target, value, after)
            end = self.memory.joined(end, self._statement(following, after))
        return end

    def _statement(self, node: ast.stmt, state: AbstractState) -> Way:
        match node:
            case ast.AnnAssign(value=ast.expr() as source):
                self._store(node, node.target, self.value(source, state), state)
            case ast.Assign():
                self._store(node, node.targets[0], self.value(node.value, state), state)
            case ast.AugAssign():
                sides = [self.value(node.target, state), self.value(node.value, state)]
                after = self._operate(node, OPERATORS[type(node.op)], sides)
                self._store(node, node.target, after, state)
            case ast.If():
                yes, no = self.branch(node.test, state)
                return self.memory.joined(self._block(node.body, yes), self._block(node.orelse, no))
            case ast.For():
                return self._loop(node, state)
            case ast.Return():
                value = None
                if node.value is not None:
                    kind = self.function.result or "i64"
                    value = self._stored(node, self.value(node.value, state), *KINDS[kind], kind)
                self.returns.append((value, state))
                return None
            case ast.Expr(value=ast.Call() as call):
                self.value(call, state)
        return state

    # loops

    def _loop(self, node: ast.For, state: AbstractState) -> Way:
        assert isinstance(node.iter, ast.Call) and isinstance(node.target, ast.Name)
        i32 = KINDS["i32"]
        bounds = [self._stored(a, self.value(a, state), *i32, "i32") for a in node.iter.args]
        start, stop = (Value(0, 0), bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
        step = bounds[2].lo if len(bounds) == 3 else 1
        trips = range(start.lo, stop.hi, step) if step > 0 else range(start.hi, stop.lo, step)
        self.turns[node] = max(self.turns.get(node, 0), len(trips))
        if not trips:
            return state
        known = start.lo == start.hi
        # from an unknown start any number before the end may come
        last = trips[-1] if known else trips.stop - (1 if step > 0 else -1)
        counter = Value(min(trips[0], last), max(trips[0], last))
        # where C's counter ends
        end = Value(last + step, last + step)
        self._oblige(node, end.within(*i32), "the counter does not fit i32", end)
        outer = self.rounds
        self._bound(node, len(trips))
        if known and len(trips) <= UNROLLED:
            after = self._unrolled(node, node.target.id, trips, stop, state)
        else:
            after = self._fixed_point(node, node.target.id, counter, state)
        self.rounds = outer
        return after

    def _bound(self, node: ast.For, trips: int) -> None:
        """Multiply the rounds of loops around each other in the bounded module, or refuse them."""
        inside = self.rounds > 0
        if inside or self.function.module == self.bounded:
            self.rounds = max(self.rounds, 1) * max(trips, 1)
            if inside and self.rounds > NESTED:
                path = self.program.modules[self.function.module].path
                rule = (
                    f"loops in each other make up to {self.rounds} rounds: limit them to {NESTED}"
                )
                raise SubsetError(path, node, rule)

    def _unrolled(self, node: ast.For, name: str, trips: range, stop: Value, state: Way) -> Way:
        for k in trips:
            if state is None:
                return None
            certain = k < stop.lo if trips.step > 0 else k > stop.hi
            skipped = None if certain else state.copy()
            state.names[name] = Value(k, k)
            state = self.memory.joined(skipped, self._block(node.body, state))
        if state is not None:
            state.names.pop(name, None)
        return state

    def _fixed_point(self, node: ast.For, name: str, counter: Value, state: AbstractState) -> Way:
        entry, attempt = state, 0
        while True:
            inside = entry.copy()
            inside.names[name] = counter
            after = self._block(node.body, inside)
            if after is None:
                return entry
            after.names.pop(name, None)
            merged = self.memory.joined(entry, after)
            assert merged is not None
            grown = [n for n, v in merged.names.items() if v != entry.names.get(n)]
            changed = [e for e, v in merged.known.items() if v != self.memory.element(e, entry)]
            if not grown and not changed:
                return merged
            if attempt >= WIDENED:
                for n in grown:
                    merged.names[n] = Value(*KINDS[self.function.kinds[n]])
                for element in changed:
                    del merged.known[element]
            entry, attempt = merged, attempt + 1
