"""Types of values in kernels, and the C that stands for them.

Integers are ``int64_t`` in expressions, however narrow they are stored, as Numba has them. Arrays
are pointers to their first element, of a size known where they are made; a record is a pointer to a
struct without padding of importance: no code relies on its layout.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from canroll.errors import CanrollError

STORED = {
    "int64": "int64_t",
    "int32": "int32_t",
    "int16": "int16_t",
    "int8": "int8_t",
    "uint8": "uint8_t",
    "uint16": "uint16_t",
    "uint32": "uint32_t",
    "uint64": "uint64_t",
    "float64": "double",
    "bool": "uint8_t",
}


class KernelError(CanrollError):
    """A kernel uses what the translation does not know; the message names file and line."""


@dataclass(frozen=True, slots=True)
class NumberKind:
    """A number in an expression: int, unsigned (64 bits), float or bool."""

    kind: str

    @property
    def c(self) -> str:
        """Its C type."""
        return {"float": "double", "unsigned": "uint64_t"}.get(self.kind, "int64_t")


INT, FLOAT, UNSIGNED, BOOL = (
    NumberKind("int"),
    NumberKind("float"),
    NumberKind("unsigned"),
    NumberKind("bool"),
)


@dataclass(frozen=True, slots=True)
class RecordKind:
    """A record of a structured dtype."""

    dtype: np.dtype[Any]


@dataclass(frozen=True, slots=True)
class ArrayKind:
    """An array; sizes that are not known are None, which only the first can be."""

    dtype: np.dtype[Any]
    shape: tuple[int | None, ...]

    @property
    def count(self) -> int:
        """Number of its elements."""
        assert self.shape[0] is not None
        return self.shape[0] * self.inner

    @property
    def inner(self) -> int:
        """Elements from one index of the first dimension to the next."""
        count = 1
        for size in self.shape[1:]:
            assert size is not None
            count *= size
        return count


@dataclass(frozen=True, slots=True)
class Several:
    """A tuple of numbers, as functions return them."""

    items: tuple[NumberKind, ...]


Kind = NumberKind | RecordKind | ArrayKind | Several


def unified(one: Kind | None, other: Kind) -> Kind:
    """The kind of a variable that holds both."""
    if one is None or one == other:
        return other
    if isinstance(one, NumberKind) and isinstance(other, NumberKind):
        kinds = {one.kind, other.kind}
        if kinds <= {"bool", "int"}:
            return INT
        if "float" in kinds and "unsigned" not in kinds:
            return FLOAT
        raise KernelError(f"a variable is {one.kind} and {other.kind}")
    if isinstance(one, ArrayKind) and isinstance(other, ArrayKind) and one.dtype == other.dtype:
        return ArrayKind(one.dtype, (None, *one.shape[1:]))
    if isinstance(one, Several) and isinstance(other, Several):
        pairs = zip(one.items, other.items, strict=True)
        items = tuple(unified(a, b) for a, b in pairs)
        return Several(tuple(item for item in items if isinstance(item, NumberKind)))
    raise KernelError("a variable changes its kind")


def number_of(dtype: np.dtype[Any]) -> NumberKind:
    """The kind in expressions of a stored number."""
    if dtype.kind == "f":
        return FLOAT
    if dtype == np.uint64:
        return UNSIGNED
    return BOOL if dtype.kind == "b" else INT


@dataclass
class Structs:
    """The C structs of the records in use, by dtype."""

    prefix: str
    names: dict[np.dtype[Any], str] = field(default_factory=dict)
    texts: list[str] = field(default_factory=list)

    def name(self, dtype: np.dtype[Any], hint: str = "record") -> str:
        """The C type of a structured dtype; defines it, and those in it, when first asked for."""
        if dtype in self.names:
            return self.names[dtype]
        members = []
        for name in dtype.names or ():
            its = dtype[name]
            base, count = its.base, int(np.prod(its.shape, dtype=np.int64))
            sizes = f"[{count}]" if its.shape else ""
            members.append(f"    {self.stored(base, name)} {name}{sizes};")
        known = f"{self.prefix}{hint}"
        while known in self.names.values():
            known += "_"
        self.names[dtype] = known
        self.texts.append("\n".join(["typedef struct {", *members, f"}} {known};", ""]))
        return known

    def stored(self, dtype: np.dtype[Any], hint: str = "record") -> str:
        """The C type of an element in memory."""
        if dtype.names:
            return self.name(dtype, hint)
        return STORED[dtype.name]

    def c(self, kind: Kind) -> str:
        """The C type of a parameter or variable."""
        if isinstance(kind, NumberKind):
            return kind.c
        if isinstance(kind, RecordKind):
            return f"{self.name(kind.dtype)} *"
        if isinstance(kind, ArrayKind):
            return f"{self.stored(kind.dtype)} *"
        known = f"{self.prefix}{''.join(item.kind[0] for item in kind.items)}"
        text = "".join(f" {item.c} v{k};" for k, item in enumerate(kind.items))
        definition = f"typedef struct {{{text} }} {known};\n"
        if definition not in self.texts:
            self.texts.append(definition)
        return known


def initialiser(value: Any) -> str:  # noqa: ANN401 - a numpy scalar, record or array
    """The C initialiser of a value as stored."""
    if isinstance(value, np.void):
        return "{" + ", ".join(initialiser(value[name]) for name in value.dtype.names or ()) + "}"
    if isinstance(value, np.ndarray):
        flat = value.ravel()
        if not value.dtype.names and not np.any(flat):
            return "{0}"
        last = len(flat)
        if not value.dtype.names:
            last = int(np.flatnonzero(flat)[-1]) + 1
        return "{" + ", ".join(initialiser(item) for item in flat[:last]) + "}"
    if isinstance(value, float | np.floating):
        return floating(float(value))
    return integer(int(value))


def integer(value: int) -> str:
    """A C literal."""
    if value == -(2**63):
        return "INT64_MIN"
    wide = abs(value) >= 2**31
    if value >= 2**63:
        return f"UINT64_C({value})"
    return f"INT64_C({value})" if wide else str(value)


def floating(value: float) -> str:
    """A C literal of the very value."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(float(value))
