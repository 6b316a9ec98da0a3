"""Places of the records and of constant tables, while a program is specialised.

What is known of a place is folded in; what is read of the calibration or of a table by an index
that is not known is kept as a table of the program that is written.
"""

import ast
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from codegen.specialise import fold
from codegen.subset.program import (
    CONST_RECORD,
    Const,
    Constant,
    FieldReference,
    Program,
    RecordField,
    Type,
    base,
    names,
)

Element = tuple[str, tuple[int, ...]]

STATE_RECORD = "Ecu"
RECORDS = {STATE_RECORD: "ecu", CONST_RECORD: "cal"}
"""What each record is called in all copies."""
CALIBRATION = "calibration of"
TABLE = "table of "
"""Owners of places that are no names of the subset: the calibration and a module's tables."""


@dataclass(slots=True)
class Scope:
    """The names of the function that is read, in the function that is written.

    Attributes:
        values: what a parameter or local stands for: a literal, a place, or its name.
        constants: locals whose value is known here, and that value.
        taken: names that the written function has already.
    """

    values: dict[str, ast.expr]
    constants: dict[str, int] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)

    def declare(self, name: str) -> str:
        """A name for a local that the written function does not have yet."""
        fresh, n = name, 2
        while fresh in self.taken:
            fresh, n = f"{name}_{n}", n + 1
        self.taken.add(fresh)
        self.values[name] = ast.Name(fresh)
        self.constants.pop(name, None)
        return fresh

    def trial(self) -> "Scope":
        """Another scope that knows the same, to be adopted or thrown away."""
        return Scope(dict(self.values), dict(self.constants), set(self.taken))

    def adopt(self, trial: "Scope") -> None:
        """Know what a trial knows."""
        self.values, self.constants, self.taken = trial.values, trial.constants, trial.taken

    def forget(self, names: set[str]) -> None:
        """Know no longer what ``names`` are."""
        for name in names:
            self.constants.pop(name, None)


def agreed(a: dict[str, int] | None, b: dict[str, int] | None) -> dict[str, int]:
    """What two ways of getting here know alike; None is a way that does not get here."""
    if a is None or b is None:
        return dict(a if a is not None else b or {})
    return {name: value for name, value in a.items() if b.get(name) == value}


@dataclass(frozen=True, slots=True)
class Stored:
    """A store in the state: which elements, and the value if it is known."""

    elements: tuple[Element, ...]
    value: int | None


@dataclass(slots=True)
class Places(ABC):
    """What is known of the records of one program.

    Attributes:
        program: is read.
        calibration: every element of the calibration.
        steady: elements of the state with the value that they always have.
        results: what calls of these functions return, without effect.
        tables: what of the calibration and of the modules' tables is read by an unknown index.
        used: names of the functions that were written.
        stores: all stores in the state, but those that change nothing.
    """

    program: Program
    calibration: Mapping[Element, int]
    steady: Mapping[Element, int]
    results: Mapping[tuple[str, str], int]
    tables: dict[str, tuple[Type, Const]] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    stores: list[Stored] = field(default_factory=list)
    reserved: frozenset[str] = field(init=False)

    def __post_init__(self) -> None:
        functions = list(self.program.functions())
        self.reserved = frozenset(names(f.node for f in functions)).union(
            *(f.parameters for f in functions)
        )

    @abstractmethod
    def value(self, node: ast.expr, scope: Scope) -> ast.expr:
        """An expression with what is known folded in."""

    def _read(self, node: ast.expr, scope: Scope) -> ast.expr:
        ref = self.program.refs.get(node)
        if isinstance(ref, Constant) and isinstance(ref.value, int):
            return fold.literal(ref.value)
        place = self._place(node, scope)
        table = self._table(place)
        if table is not None:
            return table
        element = self._element(place)
        if element is not None and element in self.steady and not self._volatile(place):
            return fold.literal(self.steady[element])
        return place

    def _place(self, node: ast.expr, scope: Scope) -> ast.expr:
        """A field, an element or an array, its indices folded."""
        if isinstance(node, ast.Subscript):
            index = self.value(node.slice, scope)
            return ast.Subscript(self._place(node.value, scope), index)
        match self.program.refs[node]:
            case Constant(module=module, name=name):
                return ast.Attribute(ast.Name(f"{TABLE}{module}"), name)
            case FieldReference(record=record, field=field):
                owner = CALIBRATION if record == CONST_RECORD else RECORDS[record]
                return ast.Attribute(ast.Name(owner), field.name)
        return scope.values[ast.unparse(node)]

    def _table(self, place: ast.expr, *, whole: bool = False) -> ast.expr | None:
        """An element of the calibration or of a constant table: its value, or what reads it."""
        home, array = _owner(place)
        if home == CALIBRATION:
            its = self.program.record(CONST_RECORD).fields[array].type
            value = self._calibrated(array, its.shape, ())
        elif home.startswith(TABLE):
            constant = self.program.modules[home.removeprefix(TABLE)].constants[array]
            its, value = constant.type, constant.value
        else:
            return None
        indices = _indices(place)
        numbers = [fold.known(index) for index in indices]
        if not whole and None not in numbers:
            for number in numbers:
                assert isinstance(value, tuple) and number is not None
                value = value[number]
            assert isinstance(value, int)
            return fold.literal(value)
        name = array.upper()
        if self.tables.setdefault(name, (its, value)) != (its, value):
            name = f"{name}_{home.removeprefix(TABLE).upper()}"
            self.tables[name] = (its, value)
        found: ast.expr = ast.Name(name)
        for index in indices:
            found = ast.Subscript(found, index)
        return found

    def _calibrated(self, name: str, shape: tuple[int, ...], prefix: tuple[int, ...]) -> Const:
        if not shape:
            return self.calibration[name, prefix]
        return tuple(self._calibrated(name, shape[1:], (*prefix, k)) for k in range(shape[0]))

    def _keeps(self, place: ast.expr, value: ast.expr) -> bool:
        """Whether a store leaves what is there."""
        if self._volatile(place):
            return False
        if fold.same(place, value):
            return True
        element = self._element(place)
        number = fold.known(value)
        return element is not None and number is not None and self.steady.get(element) == number

    def _store(self, place: ast.expr, number: int | None) -> None:
        elements = tuple(self._elements(place))
        if elements:
            self.stores.append(Stored(elements, number))

    def _element(self, place: ast.expr) -> Element | None:
        found = list(self._elements(place))
        return found[0] if len(found) == 1 and fixed(place) else None

    def _elements(self, place: ast.expr) -> Iterator[Element]:
        """The elements of the state that ``place`` may be."""
        home, array = _owner(place)
        if not home or home == CALIBRATION or home.startswith(TABLE):
            return
        indices = [fold.known(index) for index in _indices(place)]
        shape = self._state()[array].type.shape
        ways: list[tuple[int, ...]] = [()]
        for at, size in enumerate(shape):
            index = indices[at] if at < len(indices) else None
            its = range(size) if index is None else (index,)
            ways = [(*way, k) for way in ways for k in its]
        yield from ((array, way) for way in ways)

    def _volatile(self, place: ast.expr) -> bool:
        _, array = _owner(place)
        return bool(array) and self._state()[array].volatile

    def _state(self) -> Mapping[str, RecordField]:
        return self.program.record(STATE_RECORD).fields


def _owner(place: ast.expr) -> tuple[str, str]:
    """The record or module in which a place lies, and its field or table; empty for a local."""
    array = base(place)
    if isinstance(array, ast.Attribute) and isinstance(array.value, ast.Name):
        return array.value.id, array.attr
    return "", ""


def _indices(place: ast.expr) -> list[ast.expr]:
    return [*_indices(place.value), place.slice] if isinstance(place, ast.Subscript) else []


def fixed(node: ast.expr) -> bool:
    """Whether ``node`` is a literal or a place without indices that are not known."""
    if isinstance(node, ast.Subscript):
        return fold.known(node.slice) is not None and fixed(node.value)
    if isinstance(node, ast.Attribute):
        return True
    return fold.known(node) is not None
