"""The firmware's source run on intervals instead of integers.

Two ways of running it share this interpreter. *Modular*: each function by itself, parameters of
any value, loops to a fixed point; what each expression can be is what the emitter types C with.
*Proof*: calls followed, loops unrolled, each element of each record tracked; every overflow, store,
index and divisor is an obligation, and :attr:`Interpreter.findings` lists those not met.
Conditions narrow what they compare; where paths meet their values are joined.
"""

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product

from codegen import intervals as iv
from codegen.effects import assigned, local_kinds, writers
from codegen.intervals import Value
from codegen.program import CONST_RECORD, KINDS, Function, Module, Program, Type

UNROLLED = 64
ARITHMETIC = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.BitAnd: "&",
    ast.BitOr: "|",
    ast.BitXor: "^",
    ast.LShift: "<<",
    ast.RShift: ">>",
}
NEGATED = {
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
SWAPPED = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}
I64 = KINDS["i64"]

Key = tuple[str, str]
Element = tuple[Key, tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class Reference:
    """A record, or an array (or row of one) in it; ``prefix`` are the indices taken so far."""

    record: str
    key: Key | None = None
    prefix: tuple[Value, ...] = ()


@dataclass(frozen=True, slots=True)
class Array:
    """Where an array or field lives and what its elements may be when nothing else is known."""

    shape: tuple[int, ...]
    lo: int
    hi: int
    volatile: bool = False
    exact: Mapping[tuple[int, ...], int] | None = None


@dataclass(slots=True)
class State:
    """Locals of the running function, and elements known better than their declared range."""

    names: dict[str, Value | Reference]
    known: dict[Element, Value] = field(default_factory=dict)

    def copy(self) -> "State":
        """Return a state to change on its own."""
        return State(dict(self.names), dict(self.known))


@dataclass(frozen=True, slots=True)
class Finding:
    """An obligation not met: where, which, and the range that breaks it."""

    path: str
    line: int
    what: str
    lo: int
    hi: int

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.what}: [{self.lo}, {self.hi}]"


class Interpreter:
    """Runs functions of a program on intervals; see the module's docstring for the two ways."""

    def __init__(
        self,
        program: Program,
        *,
        proof: bool,
        calibration: Mapping[tuple[str, tuple[int, ...]], int] | None = None,
        any_calibration: bool = False,
    ) -> None:
        self.program = program
        self.proof = proof
        self.seen: dict[int, Value] = {}
        self.found: dict[tuple[str, int, str], Finding] = {}
        self.arrays: dict[Key, Array] = {}
        self.module: Module = next(iter(program.modules.values()))
        self.function: Function = next(iter(program.functions()))
        self.locals = {f.key: local_kinds(f) for f in program.functions()}
        self.assigned = {f.key: assigned(f) for f in program.functions()}
        self.writers = writers(program)
        self.returns: list[tuple[Value | None, State]] = []
        for module in program.modules.values():
            for record in module.records.values():
                const = record.name == CONST_RECORD
                loose = const and (any_calibration or not proof)
                for name, its in record.fields.items():
                    lo, hi = KINDS[its.type.kind] if loose else (its.lo, its.hi)
                    exact = None
                    if const and calibration is not None:
                        exact = {i: v for (f, i), v in calibration.items() if f == name}
                    self.arrays[record.name, name] = Array(
                        its.type.shape, lo, hi, its.volatile, exact
                    )
            for constant in module.constants.values():
                if constant.type.shape:
                    flat = dict(_elements(constant.value))
                    lo, hi = min(flat.values()), max(flat.values())
                    key = (f"module {module.name}", constant.name)
                    self.arrays[key] = Array(constant.type.shape, lo, hi, exact=flat)

    @property
    def findings(self) -> list[Finding]:
        """Obligations not met, by place."""
        return sorted(self.found.values(), key=lambda f: (f.path, f.line, f.what))

    # running

    def run(self, function: Function, state: State | None = None) -> Value | None:
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

    def _body(
        self,
        function: Function,
        names: dict[str, Value | Reference],
        known: dict[Element, Value],
    ) -> tuple[Value | None, dict[Element, Value]]:
        result: Value | None = None
        joined: State | None = None
        for value, state in self._paths(function, names, known):
            state.names = {}
            if value is not None:
                result = value if result is None else iv.hull(result, value)
            joined = state if joined is None else self._join(joined, state)
        return result, joined.known if joined is not None else known

    def _paths(
        self,
        function: Function,
        names: dict[str, Value | Reference],
        known: dict[Element, Value],
    ) -> list[tuple[Value | None, State]]:
        """Run a function; return what it returns and the state it leaves, path by path."""
        outer = (self.module, self.function, self.returns)
        self.module, self.function = self.program.modules[function.module], function
        self.returns = []
        end = self._block(function.node.body, State(names, dict(known)))
        if end is not None:
            self.returns.append((None, end))
        paths = self.returns
        self.module, self.function, self.returns = outer
        return paths

    def _block(self, statements: list[ast.stmt], state: State | None) -> State | None:
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
        """Whether ``following`` is an ``if`` on what ``statement`` got from a function."""
        if not (self.proof and isinstance(statement, ast.AnnAssign)):
            return False
        if not (isinstance(following, ast.If) and isinstance(following.test, ast.Compare)):
            return False
        call = statement.value
        if not isinstance(call, ast.Call) or self.program.function(self.module, call.func) is None:
            return False
        return ast.unparse(following.test.left) == ast.unparse(statement.target)

    def _by_path(self, statement: ast.stmt, following: ast.stmt, state: State) -> State | None:
        """Run a call and the ``if`` on its result path by path: they belong together."""
        assert isinstance(statement, ast.AnnAssign) and isinstance(statement.value, ast.Call)
        assert isinstance(statement.target, ast.Name)
        function, names = self._arguments(statement.value, state)
        joined: State | None = None
        for value, end in self._paths(function, names, state.known):
            assert value is not None
            self._record(statement.value, value)
            kind = ast.unparse(statement.annotation)
            given = self._stored(statement, value, *KINDS[kind], kind)
            after = State({**state.names, statement.target.id: given}, end.known)
            self._learn_arguments(statement.value, function, end, after)
            outcome = self._statement(following, after)
            if outcome is not None:
                joined = outcome if joined is None else self._join(joined, outcome)
        return joined

    def _statement(self, node: ast.stmt, state: State) -> State | None:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            assert node.value is not None
            value = self.value(node.value, state)
            kind = ast.unparse(node.annotation)
            state.names[node.target.id] = self._stored(node, value, *KINDS[kind], kind)
        elif isinstance(node, ast.Assign):
            self._store(node, node.targets[0], self.value(node.value, state), state)
        elif isinstance(node, ast.AugAssign):
            before = self.value(node.target, state)
            after = self._operate(node, node.op, before, self.value(node.value, state))
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

    def _join(self, a: State, b: State) -> State:
        names: dict[str, Value | Reference] = {}
        for name, mine in a.names.items():
            other = b.names.get(name)
            if isinstance(mine, Value) and isinstance(other, Value):
                names[name] = mine if mine is other else iv.hull(mine, other)
            elif other is not None:
                names[name] = mine
        known = {}
        for element in {*a.known, *b.known}:
            one, two = self._element(element, a), self._element(element, b)
            known[element] = one if one is two else iv.hull(one, two)
        return State(names, known)

    def _loop(self, node: ast.For, state: State) -> State | None:
        assert isinstance(node.iter, ast.Call) and isinstance(node.target, ast.Name)
        start, stop, step = self._range(node.iter, state)
        name = node.target.id
        first, last = (start.lo, stop.hi) if step > 0 else (start.hi, stop.lo)
        known_start = start.lo == start.hi
        trips = range(first, last, step)
        if self.proof and known_start and len(trips) <= UNROLLED:
            current: State | None = state
            for k in trips:
                if current is None:
                    return None
                certain = k < stop.lo if step > 0 else k > stop.hi
                skipped = None if certain else current.copy()
                current.names[name] = Value(k, k)
                current = self._block(node.body, current)
                if skipped is not None:
                    current = skipped if current is None else self._join(skipped, current)
            if current is not None:
                current.names.pop(name, None)
            return current
        return self._fixed_point(node, name, trips, state)

    def _range(self, call: ast.Call, state: State) -> tuple[Value, Value, int]:
        bounds = [self.value(argument, state) for argument in call.args]
        if len(bounds) == 1:
            return Value(0, 0), bounds[0], 1
        return bounds[0], bounds[1], bounds[2].lo if len(bounds) == 3 else 1

    def _fixed_point(self, node: ast.For, name: str, trips: range, state: State) -> State | None:
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
                if isinstance(value, Value) and not _same(value, entry.names.get(n))
            ]
            changed = [e for e in merged.known if not _same(merged.known[e], entry.known.get(e))]
            if not grown and not changed:
                return merged
            if attempt >= 2:
                for n in grown:
                    merged.names[n] = Value(*KINDS[self.locals[self.function.key][n]])
                for element in changed:
                    del merged.known[element]
            entry = merged
        return entry

    # stores and loads

    def _store(self, node: ast.stmt, target: ast.expr, value: Value, state: State) -> None:
        if isinstance(target, ast.Name):
            kind = self.locals[self.function.key][target.id]
            state.names[target.id] = self._stored(node, value, *KINDS[kind], kind)
            return
        reference = self._place(target, state)
        assert reference.key is not None
        array = self.arrays[reference.key]
        label = f"{reference.key[1]} is declared in [{array.lo}, {array.hi}]"
        value = self._stored(node, value, array.lo, array.hi, label)
        elements = list(self._targets(reference, array))
        if array.volatile or not (self.proof or elements == [()]):
            return
        for indices in elements:
            element = (reference.key, indices)
            if len(elements) == 1:
                state.known[element] = value
            else:
                state.known[element] = iv.hull(self._element(element, state), value)

    def _stored(self, node: ast.AST, value: Value, lo: int, hi: int, what: str) -> Value:
        self._record(node, value)
        self._oblige(node, value.within(lo, hi), f"does not fit {what}", value)
        return value.limited(lo, hi)

    def _place(self, node: ast.expr, state: State) -> Reference:
        if isinstance(node, ast.Name):
            found = state.names.get(node.id)
            if isinstance(found, Reference):
                return found
        if isinstance(node, ast.Name | ast.Attribute):
            constant = self.program.constant(self.module, node)
            if constant is not None:
                return Reference("", (f"module {constant.module}", constant.name))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            owner = state.names[node.value.id]
            assert isinstance(owner, Reference)
            return Reference(owner.record, (owner.record, node.attr))
        assert isinstance(node, ast.Subscript)
        base = self._place(node.value, state)
        assert base.key is not None
        index = self.value(node.slice, state)
        size = self.arrays[base.key].shape[len(base.prefix)]
        self._oblige(node, index.within(0, size - 1), f"index of {size} elements", index)
        return Reference(base.record, base.key, (*base.prefix, index.limited(0, size - 1)))

    def _targets(self, reference: Reference, array: Array) -> Iterator[tuple[int, ...]]:
        ranges = [range(index.lo, index.hi + 1) for index in reference.prefix]
        return product(*ranges)

    def _element(self, element: Element, state: State) -> Value:
        found = state.known.get(element)
        if found is not None:
            return found
        key, indices = element
        array = self.arrays[key]
        if array.exact is not None:
            exact = array.exact[indices]
            return Value(exact, exact)
        return Value(array.lo, array.hi)

    def _load(self, reference: Reference, state: State) -> Value:
        assert reference.key is not None
        array = self.arrays[reference.key]
        value: Value | None = None
        for indices in self._targets(reference, array):
            one = self._element((reference.key, indices), state)
            value = one if value is None else iv.hull(value, one)
        assert value is not None
        return value

    # expressions

    def value(self, node: ast.expr, state: State) -> Value:
        """What an expression can be in ``state``; calls take effect on it."""
        result = self._value(node, state)
        self._record(node, result)
        return result

    def _record(self, node: ast.AST, value: Value) -> None:
        before = self.seen.get(id(node))
        if before is None or not before.lo <= value.lo <= value.hi <= before.hi:
            self.seen[id(node)] = value if before is None else iv.hull(before, value)

    def _value(self, node: ast.expr, state: State) -> Value:
        if isinstance(node, ast.Constant):
            return Value(int(node.value), int(node.value))  # type: ignore[arg-type]
        if isinstance(node, ast.Name) and isinstance(state.names.get(node.id), Value):
            return state.names[node.id]  # type: ignore[return-value]
        if isinstance(node, ast.Name | ast.Attribute):
            limit = self.program.limit(self.module, node)
            constant = self.program.constant(self.module, node)
            if limit is not None:
                return Value(limit, limit)
            if constant is not None and isinstance(constant.value, int):
                return Value(constant.value, constant.value)
        if isinstance(node, ast.Attribute | ast.Subscript):
            return self._load(self._place(node, state), state)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return self._checked(node, iv.negate(self.value(node.operand, state)))
        if isinstance(node, ast.BinOp):
            left = self.value(node.left, state)
            return self._operate(node, node.op, left, self.value(node.right, state))
        if isinstance(node, ast.IfExp):
            return self._conditional(node, state)
        assert isinstance(node, ast.Call), ast.unparse(node)
        return self._call(node, state)

    def _conditional(self, node: ast.IfExp, state: State) -> Value:
        yes, no = self.branch(node.test, state)
        values = []
        if yes is not None:
            values.append(self.value(node.body, yes))
        if no is not None:
            values.append(self.value(node.orelse, no))
        return values[0] if len(values) == 1 else iv.hull(*values)

    def _operate(self, node: ast.AST, op: ast.operator, a: Value, b: Value) -> Value:
        sign = ARITHMETIC[type(op)]
        if sign == "+":
            result = iv.add(a, b)
        elif sign == "-":
            result = iv.add(a, iv.negate(b))
        elif sign == "*":
            result = iv.multiply(a, b)
        elif sign == "<<":
            result = iv.multiply(a, Value(1 << b.lo, 1 << b.lo))
        elif sign == ">>":
            result = Value(a.lo >> b.lo, a.hi >> b.lo)
        else:
            result = iv.bitwise(sign, a, b)
        return self._checked(node, result)

    def _checked(self, node: ast.AST, value: Value) -> Value:
        self._oblige(node, value.within(*I64), "overflows 64 bits", value)
        self._record(node, value)
        return value.limited(*I64)

    def _call(self, node: ast.Call, state: State) -> Value:
        intrinsic = self.program.intrinsic(self.module, node.func)
        if intrinsic is not None:
            return self._intrinsic(node, intrinsic, [self.value(a, state) for a in node.args])
        function, names = self._arguments(node, state)
        if self.proof:
            result, state.known = self._body(function, names, state.known)
        else:
            if function.key in self.writers:
                state.known = {}
            result = None
        if result is None:
            result = Value(*KINDS[function.result or "i32"])
        return result

    def _arguments(
        self, node: ast.Call, state: State
    ) -> tuple[Function, dict[str, Value | Reference]]:
        function = self.program.function(self.module, node.func)
        assert function is not None
        names: dict[str, Value | Reference] = {}
        for argument, (name, its) in zip(node.args, function.parameters.items(), strict=True):
            if its.kind == "record" or its.shape:
                names[name] = self._place(argument, state)
            else:
                given = self.value(argument, state)
                names[name] = self._stored(argument, given, *KINDS[its.kind], its.kind)
        return function, names

    def _intrinsic(self, node: ast.Call, name: str, a: list[Value]) -> Value:
        if name == "sat32":
            return iv.clamp(a[0], Value(*(KINDS["i32"][:1] * 2)), Value(*(KINDS["i32"][1:] * 2)))
        if name == "clamp":
            return iv.clamp(*a)
        if name == "rsh":
            self._oblige(node, a[1].within(1, 62), "shift count outside 1 … 62", a[1])
            half = 1 << (min(max(a[1].hi, 1), 62) - 1)
            rounded = Value(a[0].lo, a[0].hi + half)
            self._oblige(node, rounded.within(*I64), "rounding overflows 64 bits", rounded)
            return iv.shift_rounded(a[0], a[1])
        if name == "tdiv":
            self._oblige(node, not a[1].lo <= 0 <= a[1].hi, "divides by zero", a[1])
            return self._checked(node, iv.divide(*a))
        if name == "byte":
            return Value(a[0].lo, a[0].hi) if a[0].within(0, 255) else Value(0, 255)
        self._oblige(node, a[0].within(*KINDS["i32"]), "does not fit i32", a[0])
        return a[0].limited(*KINDS["i32"])

    # conditions

    def branch(self, test: ast.expr, state: State) -> tuple[State | None, State | None]:
        """States in which ``test`` holds and in which it doesn't; None where it can't."""
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
        if call is not None and self.program.function(self.module, call.func) is not None:
            return self._branch_on_call(test, call, state)
        a = self.value(test.left, state)
        b = self.value(test.comparators[0], state)
        op = type(test.ops[0])
        return (
            self._narrowed(test, op, a, b, state),
            self._narrowed(test, NEGATED[op], a, b, state),
        )

    def _branch_on_call(
        self, test: ast.Compare, call: ast.Call, state: State
    ) -> tuple[State | None, State | None]:
        """Ask each path of the call by itself: what it learnt of its arguments holds outside."""
        function, names = self._arguments(call, state)
        op = type(test.ops[0])
        results: list[State | None] = [None, None]
        for value, end in self._paths(function, names, state.known):
            after = State(dict(state.names), end.known)
            self._learn_arguments(call, function, end, after)
            assert value is not None
            self._record(call, value)
            limit = self.value(test.comparators[0], after)
            for i, each in enumerate((op, NEGATED[op])):
                if _narrow(each, value, limit) is not None:
                    earlier = results[i]
                    results[i] = after if earlier is None else self._join(earlier, after)
        return results[0], results[1]

    def _learn_arguments(
        self, call: ast.Call, function: Function, end: State, after: State
    ) -> None:
        """What a path of ``call`` found out about its parameters holds for the arguments."""
        for argument, name in zip(call.args, function.parameters, strict=True):
            learnt = end.names.get(name)
            if isinstance(learnt, Value) and name not in self.assigned[function.key]:
                self._learn(argument, learnt, after)

    def _narrowed(
        self, test: ast.Compare, op: type[ast.cmpop], a: Value, b: Value, state: State
    ) -> State | None:
        one = _narrow(op, a, b)
        two = _narrow(SWAPPED.get(op, op), b, a)
        if one is None or two is None:
            return None
        narrowed = state.copy()
        self._learn(test.left, one, narrowed)
        self._learn(test.comparators[0], two, narrowed)
        return narrowed

    def _learn(self, node: ast.expr, value: Value, state: State) -> None:
        if isinstance(node, ast.Name):
            if isinstance(state.names.get(node.id), Value):
                state.names[node.id] = value
        elif isinstance(node, ast.Attribute | ast.Subscript):
            if self.program.constant(self.module, node) is not None:
                return
            if self.program.limit(self.module, node) is not None:
                return
            reference = self._place(node, state)
            assert reference.key is not None
            array = self.arrays[reference.key]
            fixed = all(index.lo == index.hi for index in reference.prefix)
            fixed = fixed and (self.proof or not reference.prefix)
            if fixed and not array.volatile and array.exact is None:
                indices = tuple(index.lo for index in reference.prefix)
                state.known[reference.key, indices] = value

    def _oblige(self, node: ast.AST, met: bool, what: str, value: Value) -> None:
        if met or not self.proof:
            return
        path = str(self.module.path)
        line = getattr(node, "lineno", 0)
        before = self.found.get((path, line, what))
        lo = value.lo if before is None else min(before.lo, value.lo)
        hi = value.hi if before is None else max(before.hi, value.hi)
        self.found[path, line, what] = Finding(path, line, what, lo, hi)


def _narrow(op: type[ast.cmpop], a: Value, b: Value) -> Value | None:
    """What of ``a`` can stand in ``a op b``, or None."""
    lo, hi = a.lo, a.hi
    if op is ast.Lt:
        hi = min(hi, b.hi - 1)
    elif op is ast.LtE:
        hi = min(hi, b.hi)
    elif op is ast.Gt:
        lo = max(lo, b.lo + 1)
    elif op is ast.GtE:
        lo = max(lo, b.lo)
    elif op is ast.Eq:
        lo, hi = max(lo, b.lo), min(hi, b.hi)
    elif b.lo == b.hi:
        lo += lo == b.lo
        hi -= hi == b.lo
    return None if lo > hi else a.limited(lo, hi)


def _same(a: Value, b: object) -> bool:
    return isinstance(b, Value) and (a.lo, a.hi) == (b.lo, b.hi)


def _elements(value: object, prefix: tuple[int, ...] = ()) -> Iterator[tuple[tuple[int, ...], int]]:
    if isinstance(value, tuple):
        for i, inner in enumerate(value):
            yield from _elements(inner, (*prefix, i))
    else:
        yield prefix, int(value)  # type: ignore[call-overload]
