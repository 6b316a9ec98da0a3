"""Interpreter of the firmware's source on intervals instead of integers.

Calls are followed, loops unrolled or run to a fixed point, each element of each record tracked;
every overflow, store, index and divisor is an obligation, and :attr:`Interpreter.findings` lists
those not met. Conditions narrow what they compare; where paths meet their values are joined. Two
records of one class are two places: nothing known of the one holds of the other.
"""

import ast
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from itertools import product

from canroll.codegen.operations import intervals as iv
from canroll.codegen.operations.intervals import KINDS, Value
from canroll.codegen.operations.relations import RELATIONS, narrow
from canroll.codegen.operations.table import OPERATORS, Access, Operation
from canroll.codegen.subset.program import (
    CONST_RECORD,
    Constant,
    FieldReference,
    Function,
    Local,
    Parameter,
    Program,
    Record,
    SubsetError,
    elements,
    is_scalar,
)
from canroll.codegen.subset.walk import walk

UNROLLED = 64
"""Rounds of a loop that are followed one by one."""
NESTED = UNROLLED**2
"""Rounds of loops in each other that a bounded module may have."""
WIDENED = 2
"""Rounds to a fixed point after which what still grows is given up."""

Element = tuple[str, str, str, tuple[int, ...]]
"""Owner, kind and name of an array as of :class:`Place`, and the indices of one element."""
FieldElement = tuple[str, str, tuple[int, ...]]
"""The same of any owner."""


@dataclass(frozen=True, slots=True)
class Place:
    """A record, or an array, row or element in it.

    ``owner`` tells records of one class apart: the entry point's parameter; ``kind`` and ``name``
    say where its declaration is.
    """

    owner: str
    kind: str
    name: str = ""
    indices: tuple[Value, ...] = ()


@dataclass(frozen=True, slots=True)
class Array:
    """What is declared of an array, field or table."""

    shape: tuple[int, ...]
    lo: int
    hi: int
    volatile: bool = False
    exact: Mapping[tuple[int, ...], int] | None = None


@dataclass(slots=True)
class AbstractState:
    """Locals of the current function, and elements known more closely than their declared range."""

    names: dict[str, Value | Place]
    known: dict[Element, Value] = field(default_factory=dict)

    def copy(self) -> "AbstractState":
        """Return an independent copy."""
        return AbstractState(dict(self.names), dict(self.known))


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


Way = AbstractState | None
"""The state in which a way through a function goes on; None where it does not."""
Paths = list[tuple[Value | None, AbstractState]]
"""Result and final state of each path through a function."""


class Interpreter:
    """Runs functions of a program on intervals.

    Args:
        program: whose functions are run.
        calibration: the numbers of the one calibration that it runs on, if it is known.
        any_calibration: whether a calibration may lie outside its declared ranges.
        bounded: name of a module whose loops in each other are limited.

    Attributes:
        ranges: elements of records, without their owner, known more closely than declared.
        seen: the interval of each syntax node over all ways to reach it.
        turns: the most rounds of each loop.
        ways: whether each condition is ever true, ever false.
        stored: what is stored in each element that no interrupt writes.
        obligations: path, line, column and kind of all that was to be shown.
    """

    def __init__(
        self,
        program: Program,
        *,
        calibration: Mapping[tuple[str, tuple[int, ...]], int] | None = None,
        any_calibration: bool = False,
        bounded: str = "",
    ) -> None:
        self.program, self.refs, self.bounded = program, program.refs, bounded
        # with one calibration many operands are one number each
        self.exact = calibration is not None
        self.seen: dict[ast.AST, Value] = {}
        self.turns: dict[ast.For, int] = {}
        self.ways: dict[ast.expr, tuple[bool, bool]] = {}
        self.stored: dict[FieldElement, Value] = {}
        self.ranges: Mapping[FieldElement, Value] = {}
        self.obligations: set[tuple[str, int, int, str]] = set()
        self.failed: dict[tuple[str, int, str], Finding] = {}
        self.arrays: dict[tuple[str, str], Array] = {}
        self.function: Function = next(program.functions())
        self.returns: Paths = []
        self.rounds = 0
        for module in program.modules.values():
            for record in module.records.values():
                const = record.name == CONST_RECORD
                for name, row in record.fields.items():
                    loose = const and any_calibration
                    lo, hi = KINDS[row.type.kind] if loose else (row.lo, row.hi)
                    exact = None
                    if const and calibration is not None:
                        exact = {i: v for (f, i), v in calibration.items() if f == name}
                    array = Array(row.type.shape, lo, hi, row.volatile, exact)
                    self.arrays[record.name, name] = array
            for constant in module.constants.values():
                if constant.type.shape:
                    flat = dict(elements(constant.value))
                    lo, hi = min(flat.values()), max(flat.values())
                    array = Array(constant.type.shape, lo, hi, exact=flat)
                    self.arrays[f"module {module.name}", constant.name] = array

    @property
    def findings(self) -> list[Finding]:
        """Obligations not met, by place."""
        return sorted(self.failed.values(), key=lambda f: (f.path, f.line, f.what))

    def run(self, function: Function) -> Paths:
        """Run ``function`` with parameters of any value of their type; no two overlap."""
        names: dict[str, Value | Place] = {}
        for name, kind in function.parameters.items():
            if kind.record:
                names[name] = Place(f"{kind.record} {name}", kind.record)
            elif kind.shape:
                owner = f"parameter {function.module}.{function.name}"
                self.arrays[owner, name] = Array(kind.shape, *KINDS[kind.kind])
                names[name] = Place(owner, owner, name)
            else:
                names[name] = Value(*KINDS[kind.kind])
        return self._paths(function, names, {})

    def add(self, other: "Interpreter") -> None:
        """Note values, ways and turns of another run too."""
        for node, value in other.seen.items():
            self._record(node, value)
        for test, ways in other.ways.items():
            self._way(test, *ways)
        for loop, turns in other.turns.items():
            self.turns[loop] = max(turns, self.turns.get(loop, 0))

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
            size = self.arrays[base.kind, base.name].shape[len(base.indices)]
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

    def _elements(self, place: Place) -> list[Element]:
        """The elements that a place may be."""
        ranges = [range(index.lo, index.hi + 1) for index in place.indices]
        return [(place.owner, place.kind, place.name, each) for each in product(*ranges)]

    def _element(self, element: Element, state: AbstractState) -> Value:
        """What an element may hold."""
        if (known := state.known.get(element)) is not None:
            return known
        _, kind, name, indices = element
        array = self.arrays[kind, name]
        if array.exact is not None:
            return Value(array.exact[indices], array.exact[indices])
        return self.ranges.get((kind, name, indices)) or Value(array.lo, array.hi)

    def _store(self, node: ast.stmt, target: ast.expr, value: Value, state: AbstractState) -> None:
        ref = self.refs[target]
        if isinstance(ref, Local):
            state.names[ref.name] = self._stored(node, value, *KINDS[ref.kind], ref.kind)
            return
        place = self._place(target, state)
        array = self.arrays[place.kind, place.name]
        label = f"{place.name} is declared in [{array.lo}, {array.hi}]"
        value = self._stored(node, value, array.lo, array.hi, label)
        if array.volatile:
            return
        targets = self._elements(place)
        for each in targets:
            self._note(each, value)
            # one of several elements may change
            before = value if len(targets) == 1 else self._element(each, state)
            state.known[each] = iv.hull(before, value)

    def _note(self, element: Element, value: Value) -> None:
        before = self.stored.get(element[1:], value)
        self.stored[element[1:]] = iv.hull(before, value)

    def joined(self, a: Way, b: Way) -> Way:
        """The state in which either way goes on."""
        if a is None or b is None:
            return a or b
        names: dict[str, Value | Place] = {}
        for name, one in a.names.items():
            other = b.names.get(name)
            if isinstance(one, Value) and isinstance(other, Value):
                names[name] = one if one is other else iv.hull(one, other)
            elif other is not None:
                names[name] = one
        known = dict(a.known)
        for element, value in b.known.items():
            before = known.get(element)
            if before is not value:
                before = self._element(element, a) if before is None else before
                known[element] = iv.hull(before, value)
        for element, value in a.known.items():
            if element not in b.known:
                known[element] = iv.hull(value, self._element(element, b))
        return AbstractState(names, known)

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
            case ast.Call():
                return self._call(node, state)
        match self.refs[node]:
            case Constant(value=int(number)):
                return Value(number, number)
            case Local(name=name):
                local = state.names[name]
                assert isinstance(local, Value)
                return local
        places = self._elements(self._place(node, state))
        return reduce(iv.hull, (self._element(each, state) for each in places))

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
        if self.exact and all(value.lo == value.hi for value in operands):
            number = operation.fold(*(value.lo for value in operands))
            result = result.limited(number, number)
        return self._checked(node, result) if operation.overflows else result

    def _access(self, node: ast.Call, access: Access, state: AbstractState) -> Value:
        """A record read or written as memory: an element read is any value of its kind."""
        place = self._place(node.args[0], state)
        record = self.program.record(place.kind)
        if access.effect == "clear":
            return self._clear(node, place, record, state)
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
        state.known = {e: v for e, v in state.known.items() if e[0] != place.owner}
        return Value(0, 0)

    def _clear(self, node: ast.Call, place: Place, record: Record, state: AbstractState) -> Value:
        """Set every element of a record to zero, or to the declared number next to it."""
        zero = Value(0, 0)
        for name, row in record.fields.items():
            array = self.arrays[record.name, name]
            self._oblige(node, row.lo <= 0 <= row.hi, f"{name} can't be zero", zero)
            if not array.volatile:
                for indices in product(*map(range, row.type.shape)):
                    element = (place.owner, place.kind, name, indices)
                    state.known[element] = zero.limited(array.lo, array.hi)
                    self._note(element, state.known[element])
        return zero

    # calls

    def _paths(
        self,
        function: Function,
        names: dict[str, Value | Place],
        known: dict[Element, Value],
    ) -> Paths:
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
            end = self.joined(end, state)
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
        yes, no = self._branch(test, state)
        self._way(test, yes is not None, no is not None)
        return yes, no

    def _way(self, test: ast.expr, *taken: bool) -> None:
        yes, no = self.ways.get(test, (False, False))
        self.ways[test] = yes or taken[0], no or taken[1]

    def _branch(self, test: ast.expr, state: AbstractState) -> tuple[Way, Way]:
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
                    left = self.joined(left, out)
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
                        ways[i] = self.joined(ways[i], after) if ways[i] else after.copy()
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
            place = self._place(node, state)
            array, targets = self.arrays[place.kind, place.name], self._elements(place)
            if len(targets) == 1 and not array.volatile and array.exact is None:
                state.known[targets[0]] = value

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
            end = self.joined(end, self._statement(following, after))
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
                return self.joined(self._block(node.body, yes), self._block(node.orelse, no))
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
            state = self.joined(skipped, self._block(node.body, state))
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
            merged = self.joined(entry, after)
            assert merged is not None
            grown = [n for n, v in merged.names.items() if v != entry.names.get(n)]
            changed = [e for e, v in merged.known.items() if v != self._element(e, entry)]
            if not grown and not changed:
                return merged
            if attempt >= WIDENED:
                for n in grown:
                    merged.names[n] = Value(*KINDS[self.function.kinds[n]])
                for element in changed:
                    del merged.known[element]
            entry, attempt = merged, attempt + 1
