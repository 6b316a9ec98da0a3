"""Expressions on intervals: operators, intrinsics, calls."""

import ast
from abc import abstractmethod
from itertools import product

from codegen.proof import intervals as iv
from codegen.proof.abstract_memory import I64, Memory
from codegen.proof.abstract_state import Element, Reference, State
from codegen.proof.intervals import Value
from codegen.subset.program import BITS_31, KINDS, MEMORY, Function, Record

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


class Expressions(Memory):
    """Values of expressions; subclasses define calls and branches on conditions."""

    @abstractmethod
    def branch(self, test: ast.expr, state: State) -> tuple[State | None, State | None]:
        """States in which ``test`` holds and in which it does not; None where impossible."""

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

    def _call(self, node: ast.Call, state: State) -> Value:
        intrinsic = self.program.intrinsic(self.module, node.func)
        if intrinsic == "clear":
            return self._clear(node, state)
        if intrinsic == "bytes_of":
            bytes_ = self._record_of(node).size
            return Value(bytes_, bytes_)
        if intrinsic in ("set_octet", "set_word"):
            return self._set(node, "u8" if intrinsic == "set_octet" else "i32", state)
        if intrinsic in MEMORY:
            return self._read(node, MEMORY[intrinsic], state)
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

    def _clear(self, node: ast.Call, state: State) -> Value:
        """Set every element of a record to zero."""
        assert isinstance(node.args[0], ast.Name)
        record = self.function.parameters[node.args[0].id].record
        zero = Value(0, 0)
        for name in self.program.record(record).fields:
            array = self.arrays[record, name]
            self._oblige(node, array.lo <= 0 <= array.hi, f"{name} can't be zero", zero)
            if self.proof and not array.volatile:
                for indices in product(*map(range, array.shape)):
                    state.known[(record, name), indices] = zero
        return zero

    def _record_of(self, node: ast.Call) -> Record:
        """The record that is the first argument of an intrinsic."""
        assert isinstance(node.args[0], ast.Name)
        return self.program.record(self.function.parameters[node.args[0].id].record)

    def _set(self, node: ast.Call, kind: str, state: State) -> Value:
        """Part of a calibration that the loop does not run on: forget what was known of it."""
        record = self._record_of(node)
        size = record.size // (4 if kind == "i32" else 1)
        index = self.value(node.args[1], state)
        self._oblige(node, index.within(0, size - 1), f"index of {size} elements", index)
        self._stored(node, self.value(node.args[2], state), *KINDS[kind], kind)
        state.known = {e: value for e, value in state.known.items() if e[0][0] != record.name}
        return Value(0, 0)

    def _read(self, node: ast.Call, kind: str, state: State) -> Value:
        """An element of a record read as an array: any value of its kind."""
        size = self._record_of(node).size // (4 if kind == "i32" else 1)
        index = self.value(node.args[1], state)
        self._oblige(node, index.within(0, size - 1), f"index of {size} elements", index)
        return Value(*KINDS[kind])

    def _intrinsic(self, node: ast.Call, name: str, a: list[Value]) -> Value:
        if name in ("sat32", "sat31"):
            return a[0].limited(*(BITS_31 if name == "sat31" else KINDS["i32"]))
        if name == "clamp":
            return iv.clamp(*a)
        if name in ("rsh", "scaled"):
            self._oblige(node, a[1].within(1, 62), "shift count outside 1 … 62", a[1])
        if name == "scaled":
            last = Value(a[0].lo, a[0].hi + 1)
            self._oblige(node, last.within(*I64), "rounding overflows 64 bits", last)
            return iv.shift_rounded(*a).limited(*BITS_31)
        if name == "rsh":
            half = 1 << (min(max(a[1].hi, 1), 62) - 1)
            rounded = Value(a[0].lo, a[0].hi + half)
            self._oblige(node, rounded.within(*I64), "rounding overflows 64 bits", rounded)
            return iv.shift_rounded(a[0], a[1])
        if name == "tdiv":
            self._oblige(node, not a[1].lo <= 0 <= a[1].hi, "divides by zero", a[1])
            return self._checked(node, iv.divide(*a))
        if name == "to_u32":
            self._oblige(node, a[0].within(*KINDS["i32"]), "does not fit i32", a[0])
            return a[0] if a[0].lo >= 0 else Value(*KINDS["u32"])
        if name == "to_i32":
            self._oblige(node, a[0].within(*KINDS["u32"]), "does not fit u32", a[0])
            return a[0] if a[0].within(*KINDS["i32"]) else Value(*KINDS["i32"])
        if name == "byte":
            return Value(a[0].lo, a[0].hi) if a[0].within(0, 255) else Value(0, 255)
        self._oblige(node, a[0].within(*KINDS["i32"]), "does not fit i32", a[0])
        return a[0].limited(*KINDS["i32"])
