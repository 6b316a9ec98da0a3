"""Records, arrays and tables on intervals: what each element may hold."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product

from codegen.operations.intervals import KINDS, Value, hull
from codegen.subset.program import CONST_RECORD, Function, Program, Record, elements

Element = tuple[str, str, str, tuple[int, ...]]
"""Owner, kind and name of an array as of :class:`Place`, and the indices of one element."""


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


Way = AbstractState | None
"""The state in which a way through a function goes on; None where it does not."""


class Memory:
    """The arrays of a program, loads and stores of their elements.

    Args:
        program: whose records and tables are declared.
        calibration: the numbers of the one calibration that it runs on, if it is known.
        any_calibration: whether a calibration may lie outside its declared ranges.
    """

    def __init__(
        self,
        program: Program,
        calibration: Mapping[tuple[str, tuple[int, ...]], int] | None,
        *,
        any_calibration: bool,
    ) -> None:
        self.arrays: dict[tuple[str, str], Array] = {}
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

    def parameters(self, function: Function) -> dict[str, Value | Place]:
        """The parameters of an entry point, of any value of their type; no two overlap."""
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
        return names

    def array(self, place: Place) -> Array:
        """What is declared of the array in which a place lies."""
        return self.arrays[place.kind, place.name]

    def elements(self, place: Place) -> list[Element]:
        """The elements that a place may be."""
        ranges = [range(index.lo, index.hi + 1) for index in place.indices]
        return [(place.owner, place.kind, place.name, each) for each in product(*ranges)]

    def element(self, element: Element, state: AbstractState) -> Value:
        """What an element may hold."""
        if (known := state.known.get(element)) is not None:
            return known
        _, kind, name, indices = element
        array = self.arrays[kind, name]
        if array.exact is not None:
            return Value(array.exact[indices], array.exact[indices])
        return Value(array.lo, array.hi)

    def load(self, place: Place, state: AbstractState) -> Value:
        """What the element at a place may hold."""
        first, *rest = self.elements(place)
        value = self.element(first, state)
        for each in rest:
            value = hull(value, self.element(each, state))
        return value

    def store(self, place: Place, value: Value, state: AbstractState) -> None:
        """Store ``value``, which is in the declared range: one of several elements may change."""
        if self.array(place).volatile:
            return
        targets = self.elements(place)
        for each in targets:
            before = value if len(targets) == 1 else self.element(each, state)
            state.known[each] = hull(before, value)

    def learn(self, place: Place, value: Value, state: AbstractState) -> None:
        """Note that the element at a place holds ``value``, if it is one that keeps it."""
        array, targets = self.array(place), self.elements(place)
        if len(targets) == 1 and not array.volatile and array.exact is None:
            state.known[targets[0]] = value

    def clear(self, place: Place, record: Record, state: AbstractState) -> None:
        """Set every element of a record to zero, or to the declared number next to it."""
        for name, row in record.fields.items():
            array = self.arrays[record.name, name]
            if not array.volatile:
                for indices in product(*map(range, row.type.shape)):
                    zero = Value(0, 0).limited(array.lo, array.hi)
                    state.known[place.owner, place.kind, name, indices] = zero

    def forget(self, place: Place, state: AbstractState) -> None:
        """Forget what was known of a record, as memory of it was written."""
        state.known = {e: v for e, v in state.known.items() if e[0] != place.owner}

    def joined(self, a: Way, b: Way) -> Way:
        """The state in which either way goes on."""
        if a is None or b is None:
            return a or b
        names: dict[str, Value | Place] = {}
        for name, one in a.names.items():
            other = b.names.get(name)
            if isinstance(one, Value) and isinstance(other, Value):
                names[name] = one if one is other else hull(one, other)
            elif other is not None:
                names[name] = one
        known = dict(a.known)
        for element, value in b.known.items():
            before = known.get(element)
            if before is not value:
                before = self.element(element, a) if before is None else before
                known[element] = hull(before, value)
        for element, value in a.known.items():
            if element not in b.known:
                known[element] = hull(value, self.element(element, b))
        return AbstractState(names, known)
