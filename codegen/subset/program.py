"""The firmware as data: modules of the integer subset parsed, their names resolved.

Nothing is imported or run: :mod:`canroll.codegen.subset.parse` reads the sources into these
classes.
"""

import ast
import shutil
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import prod
from pathlib import Path
from typing import Any

from canroll.codegen.operations.intervals import KINDS
from canroll.codegen.operations.table import CONSTANT_OPERATORS, INTRINSICS, Intrinsic
from canroll.codegen.subset.walk import walk
from canroll.errors import CanrollError

FIRMWARE = Path(__file__).resolve().parents[2] / "firmware"
PACKAGE = "canroll.firmware"
RUNTIME = "subset"
CONST_RECORD = "Calibration"
MOST_BITS = 128
"""Bits of a number in a source, or in between in a constant."""

Const = int | tuple[Any, ...]


def source_files(folder: Path = FIRMWARE) -> list[Path]:
    """The Python files of a firmware folder and of the rooms in it, without their ``__init__``."""
    inside = [*folder.glob("*.py"), *folder.glob("*/*.py")]
    return sorted(path for path in inside if path.name != "__init__.py")


def file_of(name: str, folder: Path = FIRMWARE) -> Path:
    """The file of a module, in ``folder`` or in the only room of it that has one of this name."""
    here = folder / f"{name}.py"
    if here.is_file():
        return here
    found = sorted(folder.glob(f"*/{name}.py"))
    if len(found) > 1:
        raise CanrollError(f"{found[0]} and {found[1]}: a module's name must be unique")
    return found[0] if found else here


def copy_sources(folder: Path) -> None:
    """Copy the firmware with its rooms into ``folder``."""
    for path in FIRMWARE.rglob("*.py"):
        copy = folder / path.relative_to(FIRMWARE)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, copy)


class SubsetError(CanrollError):
    """A construct outside the subset: ``file:line: rule``."""

    def __init__(self, path: Path, node: ast.AST | int, rule: str) -> None:
        line = node if isinstance(node, int) else getattr(node, "lineno", 1)
        super().__init__(f"{path}:{line}: {rule}")


@dataclass(frozen=True, slots=True)
class Type:
    """Type of a parameter, a local, a field or a result; ``shape`` is () for a scalar.

    ``kind`` is i32, i64, u8, u16 or u32, or "record" with ``record`` its class.
    """

    kind: str
    shape: tuple[int, ...] = ()
    record: str = ""


@dataclass(frozen=True, slots=True)
class RecordField:
    """One field of a record: its type and the contents of its ``F``."""

    name: str
    type: Type
    lo: int
    hi: int
    q: int
    unit: str
    meaning: str
    volatile: bool
    line: int


@dataclass(frozen=True, slots=True)
class Record:
    """A record class; ``fields`` in the order of memory."""

    module: str
    name: str
    doc: str
    line: int
    fields: Mapping[str, RecordField]

    @property
    def size(self) -> int:
        """Size in bytes up to the end of the last field."""
        end = 0
        for its in self.fields.values():
            width = 4 if its.type.kind == "i32" else 1
            end = -(-end // width) * width + width * prod(its.type.shape)
        return end


@dataclass(frozen=True, slots=True)
class Constant:
    """A module constant: an int, or a table with its element kind."""

    module: str
    name: str
    value: Const
    type: Type
    line: int
    end_line: int


LIMITS = {
    name: Constant(RUNTIME, name, value, Type(kind), 0, 0)
    for kind in ("i32", "i64")
    for name, value in zip((f"{kind.upper()}_MIN", f"{kind.upper()}_MAX"), KINDS[kind], strict=True)
}
"""Constants of the subset itself."""


@dataclass(frozen=True)
class Function:
    """One function of the firmware; ``result`` is None where it returns nothing."""

    module: str
    name: str
    parameters: Mapping[str, Type]
    result: str | None
    node: ast.FunctionDef

    @property
    def key(self) -> tuple[str, str]:
        """Module and name."""
        return (self.module, self.name)

    @cached_property
    def kinds(self) -> dict[str, str]:
        """Kind of each scalar parameter, local and loop counter."""
        kinds = {name: its.kind for name, its in self.parameters.items() if is_scalar(its)}
        for node in walk(self.node):
            if isinstance(node, ast.For) and isinstance(node.target, ast.Name):
                kinds.setdefault(node.target.id, "i32")
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                kinds[node.target.id] = getattr(node.annotation, "id", "")
        return kinds

    @cached_property
    def assigned(self) -> frozenset[str]:
        """Names that it assigns again after their declaration."""
        return frozenset(assigned(self.node))


@dataclass(frozen=True, slots=True)
class Local:
    """A scalar parameter, a local or a loop counter."""

    name: str
    kind: str


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter that is a record or an array."""

    name: str
    type: Type


@dataclass(frozen=True, slots=True)
class FieldReference:
    """A field of the record that the parameter ``owner`` is."""

    owner: str
    record: str
    field: RecordField


Ref = Local | Parameter | FieldReference | Constant | Function | Intrinsic
"""What a name, field, element or call of a function body refers to."""


@dataclass(slots=True)
class Module:
    """One source file: its text, what it defines, what it imports, its comments by line."""

    name: str
    path: Path
    doc: str
    source: str
    constants: dict[str, Constant] = field(default_factory=dict)
    functions: dict[str, Function] = field(default_factory=dict)
    records: dict[str, Record] = field(default_factory=dict)
    imported: dict[str, tuple[str, str]] = field(default_factory=dict)
    modules: dict[str, str] = field(default_factory=dict)
    comments: dict[int, tuple[bool, str]] = field(default_factory=dict)

    def uses(self) -> list[str]:
        """Names of the modules this one imports from, each once, in order."""
        found = [module for module, _ in self.imported.values()] + list(self.modules.values())
        return list(dict.fromkeys(found))


@dataclass(slots=True)
class Program:
    """All modules, each after those it uses; ``entries`` are those with the entry points.

    Attributes:
        refs: what each name, field, element and call in a function refers to, by its node; an
            element refers to its array, a call to what is called.
        writers: functions that write to their parameters, with the names of those parameters.
    """

    modules: dict[str, Module]
    entries: tuple[str, ...] = ()
    refs: dict[ast.AST, Ref] = field(default_factory=dict)
    writers: dict[tuple[str, str], frozenset[str]] = field(default_factory=dict)

    def functions(self) -> Iterator[Function]:
        """Every function, module by module."""
        for module in self.modules.values():
            yield from module.functions.values()

    def record(self, name: str) -> Record:
        """The record class ``name``, wherever it is defined."""
        for module in self.modules.values():
            if name in module.records:
                return module.records[name]
        raise KeyError(name)

    def references(self, function: Function) -> Iterator[tuple[ast.AST, Ref]]:
        """Each node of ``function`` that refers to something, with what it refers to."""
        for node in walk(function.node):
            ref = self.refs.get(node)
            if ref is not None:
                yield node, ref

    def calls(self, function: Function) -> list[Function]:
        """Functions that ``function`` calls, each once."""
        called = (ref for node, ref in self.references(function) if isinstance(node, ast.Call))
        return list({ref.key: ref for ref in called if isinstance(ref, Function)}.values())

    def lookup(self, module: Module, node: ast.expr) -> Constant | Function | Intrinsic | None:
        """What a name or ``module.name`` means at the top of ``module``, or None."""
        home, name = module.name, ""
        if isinstance(node, ast.Name):
            home, name = module.imported.get(node.id, (home, node.id))
            if home in self.modules and home != module.name:
                home, name = self.modules[home].imported.get(name, (home, name))
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            home, name = module.modules.get(node.value.id, ""), node.attr
        if home == RUNTIME:
            return LIMITS.get(name) or INTRINSICS.get(name)
        if home not in self.modules:
            return None
        there = self.modules[home]
        return there.constants.get(name) or there.functions.get(name)


def elements(value: object, prefix: tuple[int, ...] = ()) -> Iterator[tuple[tuple[int, ...], int]]:
    """The integers in nested tuples, each with its indices."""
    if isinstance(value, tuple):
        for i, inner in enumerate(value):
            yield from elements(inner, (*prefix, i))
    else:
        yield prefix, int(value)  # type: ignore[call-overload]


def is_scalar(its: Type) -> bool:
    """Whether a type is that of one number."""
    return its.kind != "record" and not its.shape


def statements(node: ast.FunctionDef) -> list[ast.stmt]:
    """The body of a function without its docstring."""
    return node.body[ast.get_docstring(node) is not None :]


def assigned(node: ast.AST) -> set[str]:
    """Names that ``node`` assigns, but where it declares them."""
    found = set()
    for inner in walk(node):
        targets = inner.targets if isinstance(inner, ast.Assign) else []
        if isinstance(inner, ast.AugAssign | ast.For):
            targets = [inner.target]
        found |= {target.id for target in targets if isinstance(target, ast.Name)}
    return found


def names(nodes: Iterable[ast.AST]) -> set[str]:
    """All names in ``nodes``."""
    return {n.id for node in nodes for n in walk(node) if isinstance(n, ast.Name)}


def base(node: ast.expr) -> ast.expr:
    """The array of which ``node`` is an element or a row."""
    while isinstance(node, ast.Subscript):
        node = node.value
    return node


def evaluate(program: Program, module: Module, node: ast.expr) -> Const:
    """Evaluate a constant expression of ints, names of constants and tuples."""
    if isinstance(node, ast.Constant) and type(node.value) is int:
        return node.value
    if isinstance(node, ast.Tuple):
        return tuple(evaluate(program, module, element) for element in node.elts)
    constant = program.lookup(module, node)
    if isinstance(constant, Constant):
        return constant.value
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        inner = evaluate(program, module, node.operand)
        if isinstance(inner, int):
            return -inner
    if isinstance(node, ast.BinOp):
        left, right = (evaluate(program, module, side) for side in (node.left, node.right))
        operation = CONSTANT_OPERATORS.get(type(node.op))
        if operation and isinstance(left, int) and isinstance(right, int):
            if isinstance(node.op, ast.Pow | ast.LShift | ast.RShift) and not 0 <= right <= 64:
                raise SubsetError(module.path, node, f"{right} is no shift count or exponent")
            if isinstance(node.op, ast.FloorDiv) and right == 0:
                raise SubsetError(module.path, node, "divides by zero")
            value = int(operation(left, right))
            if value.bit_length() > MOST_BITS:
                raise SubsetError(module.path, node, f"a number of more than {MOST_BITS} bits")
            return value
    raise SubsetError(module.path, node, f"'{ast.unparse(node)}' is not a constant of ints")
