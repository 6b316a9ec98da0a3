"""State of the interval interpreter: places, values, unmet obligations."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from codegen.operations.intervals import Value

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
    """The storage of an array or field, and the default interval of its elements."""

    shape: tuple[int, ...]
    lo: int
    hi: int
    volatile: bool = False
    exact: Mapping[tuple[int, ...], int] | None = None


@dataclass(slots=True)
class AbstractState:
    """Locals of the current function, and elements known more closely than their declared range."""

    names: dict[str, Value | Reference]
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


def same(a: Value, b: object) -> bool:
    """Whether both are the same interval."""
    return isinstance(b, Value) and (a.lo, a.hi) == (b.lo, b.hi)
