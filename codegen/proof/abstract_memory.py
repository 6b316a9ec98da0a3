"""Records on intervals: possible values of elements, obligations of stores."""

import ast
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from itertools import product

from codegen.operations import intervals as iv
from codegen.operations.intervals import KINDS, Value
from codegen.proof.abstract_state import AbstractState, Array, Element, Finding, Key, Reference
from codegen.subset.program import (
    CONST_RECORD,
    Constant,
    FieldReference,
    Function,
    Local,
    Module,
    Program,
    elements,
)

I64 = KINDS["i64"]


class Memory(ABC):
    """The arrays of a program, the interval of each syntax node, the obligations not met."""

    def __init__(
        self,
        program: Program,
        *,
        proof: bool,
        calibration: Mapping[tuple[str, tuple[int, ...]], int] | None = None,
        any_calibration: bool = False,
        bounded: str = "",
    ) -> None:
        self.program = program
        self.proof = proof
        self.refs = program.refs
        self.seen: dict[ast.AST, Value] = {}
        self.turns: dict[ast.For, int] = {}
        self.found: dict[tuple[str, int, str], Finding] = {}
        self.obligations: set[tuple[str, int, int, str]] = set()
        self.arrays: dict[Key, Array] = {}
        self.module: Module = next(iter(program.modules.values()))
        self.function: Function = next(iter(program.functions()))
        self.returns: list[tuple[Value | None, AbstractState]] = []
        self.bounded = bounded
        self.rounds = 0
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
                    flat = dict(elements(constant.value))
                    lo, hi = min(flat.values()), max(flat.values())
                    key = (f"module {module.name}", constant.name)
                    self.arrays[key] = Array(constant.type.shape, lo, hi, exact=flat)

    @property
    def findings(self) -> list[Finding]:
        """Obligations not met, by place."""
        return sorted(self.found.values(), key=lambda f: (f.path, f.line, f.what))

    @abstractmethod
    def value(self, node: ast.expr, state: AbstractState) -> Value:
        """The interval of an expression in ``state``; calls in it change ``state``."""

    def _join(self, a: AbstractState, b: AbstractState) -> AbstractState:
        names: dict[str, Value | Reference] = {}
        for name, mine in a.names.items():
            other = b.names.get(name)
            if isinstance(mine, Value) and isinstance(other, Value):
                names[name] = mine if mine is other else iv.hull(mine, other)
            elif other is not None:
                names[name] = mine
        known = dict(a.known)
        for element, two in b.known.items():
            one = known.get(element)
            if one is not two:
                one = self._element(element, a) if one is None else one
                known[element] = iv.hull(one, two)
        for element, one in a.known.items():
            if element not in b.known:
                known[element] = iv.hull(one, self._element(element, b))
        return AbstractState(names, known)

    def _store(self, node: ast.stmt, target: ast.expr, value: Value, state: AbstractState) -> None:
        ref = self.refs[target]
        if isinstance(ref, Local):
            state.names[ref.name] = self._stored(node, value, *KINDS[ref.kind], ref.kind)
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

    def _place(self, node: ast.expr, state: AbstractState) -> Reference:
        if isinstance(node, ast.Subscript):
            return self._indexed(node, state)
        match self.refs[node]:
            case Constant(module=module, name=name):
                return Reference("", (f"module {module}", name))
            case FieldReference(record=record, field=field):
                return Reference(record, (record, field.name))
        assert isinstance(node, ast.Name)
        found = state.names[node.id]
        assert isinstance(found, Reference)
        return found

    def _indexed(self, node: ast.Subscript, state: AbstractState) -> Reference:
        base = self._place(node.value, state)
        assert base.key is not None
        index = self.value(node.slice, state)
        size = self.arrays[base.key].shape[len(base.prefix)]
        self._oblige(node, index.within(0, size - 1), f"index of {size} elements", index)
        return Reference(base.record, base.key, (*base.prefix, index.limited(0, size - 1)))

    def _targets(self, reference: Reference, array: Array) -> Iterator[tuple[int, ...]]:
        ranges = [range(index.lo, index.hi + 1) for index in reference.prefix]
        return product(*ranges)

    def _element(self, element: Element, state: AbstractState) -> Value:
        found = state.known.get(element)
        if found is not None:
            return found
        key, indices = element
        array = self.arrays[key]
        if array.exact is not None:
            exact = array.exact[indices]
            return Value(exact, exact)
        return Value(array.lo, array.hi)

    def _load(self, reference: Reference, state: AbstractState) -> Value:
        assert reference.key is not None
        array = self.arrays[reference.key]
        value: Value | None = None
        for indices in self._targets(reference, array):
            one = self._element((reference.key, indices), state)
            value = one if value is None else iv.hull(value, one)
        assert value is not None
        return value

    def _record(self, node: ast.AST, value: Value) -> None:
        before = self.seen.get(node)
        if before is None or not before.lo <= value.lo <= value.hi <= before.hi:
            self.seen[node] = value if before is None else iv.hull(before, value)

    def _checked(self, node: ast.AST, value: Value) -> Value:
        self._oblige(node, value.within(*I64), "overflows 64 bits", value)
        self._record(node, value)
        return value.limited(*I64)

    def _oblige(self, node: ast.AST, met: bool, what: str, value: Value) -> None:
        if not self.proof:
            return
        path = str(self.module.path)
        line = getattr(node, "lineno", 0)
        self.obligations.add((path, line, getattr(node, "col_offset", 0), what))
        if met:
            return
        before = self.found.get((path, line, what))
        lo = value.lo if before is None else min(before.lo, value.lo)
        hi = value.hi if before is None else max(before.hi, value.hi)
        self.found[path, line, what] = Finding(path, line, what, lo, hi)
