"""The firmware as data: modules of the integer subset parsed, their names resolved.

Nothing is imported or run: :mod:`codegen.subset.parse` reads the sources into these classes.
"""

import ast
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any

from canroll.errors import CanrollError
from codegen.subset.walk import walk

FIRMWARE = Path(__file__).resolve().parents[2] / "firmware"
PACKAGE = "firmware"
RUNTIME = "subset"
KINDS = {
    "i32": (-(2**31), 2**31 - 1),
    "i64": (-(2**63), 2**63 - 1),
    "u8": (0, 255),
    "u16": (0, 2**16 - 1),
    "u32": (0, 2**32 - 1),
}
INTRINSICS = {"sat32": 1, "sat31": 1, "scaled": 2, "clamp": 3, "rsh": 2, "tdiv": 2}
INTRINSICS |= {"byte": 1, "narrow": 1, "word": 2, "octet": 2}
INTRINSICS |= {"to_i32": 1, "to_u32": 1, "clear": 1, "bytes_of": 1, "set_octet": 3}
INTRINSICS |= {"set_word": 3}
MEMORY = {"word": "i32", "octet": "u8"}
"""Intrinsics that read a record as an array, and of what."""
WRITERS = ("clear", "set_octet", "set_word")
"""Intrinsics that write their record and return nothing."""
BITS_31 = (-(2**30), 2**30 - 1)
LIMITS = {
    "I32_MIN": KINDS["i32"][0],
    "I32_MAX": KINDS["i32"][1],
    "I64_MIN": KINDS["i64"][0],
    "I64_MAX": KINDS["i64"][1],
}
CONST_RECORD = "Calibration"

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


@dataclass(frozen=True, slots=True)
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
    """All modules, each after those it uses; ``entries`` are those with the entry points."""

    modules: dict[str, Module]
    entries: tuple[str, ...] = ()

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

    def constant(self, module: Module, node: ast.expr) -> Constant | None:
        """The constant a name or ``module.name`` stands for, or None."""
        home, name = self._where(module, node)
        return self.modules[home].constants.get(name) if home in self.modules else None

    def function(self, module: Module, node: ast.expr) -> Function | None:
        """The function a name or ``module.name`` stands for, or None."""
        home, name = self._where(module, node)
        return self.modules[home].functions.get(name) if home in self.modules else None

    def intrinsic(self, module: Module, node: ast.expr) -> str | None:
        """The intrinsic a name stands for, or None."""
        home, name = self._where(module, node)
        return name if home == RUNTIME and name in INTRINSICS else None

    def limit(self, module: Module, node: ast.expr) -> int | None:
        """The value of I32_MIN and its like, or None."""
        home, name = self._where(module, node)
        return LIMITS.get(name) if home == RUNTIME else None

    def _where(self, module: Module, node: ast.expr) -> tuple[str, str]:
        if isinstance(node, ast.Name):
            if node.id in module.imported:
                home, name = module.imported[node.id]
                if home in self.modules and name in self.modules[home].imported:
                    return self.modules[home].imported[name]
                return home, name
            return module.name, node.id
        owner = node.value if isinstance(node, ast.Attribute) else None
        if isinstance(owner, ast.Name) and owner.id in module.modules:
            assert isinstance(node, ast.Attribute)
            return module.modules[owner.id], node.attr
        return "", ""


def evaluate(program: Program, module: Module, node: ast.expr) -> Const:
    """Evaluate a constant expression of ints, names of constants and tuples."""
    if isinstance(node, ast.Constant) and type(node.value) is int:
        return node.value
    if isinstance(node, ast.Tuple):
        return tuple(evaluate(program, module, element) for element in node.elts)
    if isinstance(node, ast.Name | ast.Attribute):
        limit = program.limit(module, node)
        constant = program.constant(module, node)
        if limit is not None:
            return limit
        if constant is not None:
            return constant.value
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        inner = evaluate(program, module, node.operand)
        if isinstance(inner, int):
            return -inner
    if isinstance(node, ast.BinOp):
        left, right = (evaluate(program, module, side) for side in (node.left, node.right))
        operation = OPERATIONS.get(type(node.op))
        if operation and isinstance(left, int) and isinstance(right, int):
            if isinstance(node.op, ast.Pow | ast.LShift | ast.RShift) and not 0 <= right <= 64:
                raise SubsetError(module.path, node, f"{right} is no shift count or exponent")
            if isinstance(node.op, ast.FloorDiv) and right == 0:
                raise SubsetError(module.path, node, "divides by zero")
            return operation(left, right)
    raise SubsetError(module.path, node, f"'{ast.unparse(node)}' is not a constant of ints")


OPERATIONS: dict[type[ast.operator], Callable[[int, int], int]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.LShift: lambda a, b: a << b,
    ast.RShift: lambda a, b: a >> b,
    ast.BitOr: lambda a, b: a | b,
    ast.BitAnd: lambda a, b: a & b,
    ast.BitXor: lambda a, b: a ^ b,
    ast.FloorDiv: lambda a, b: a // b,
    ast.Pow: lambda a, b: int(a**b),
}
"""What operators do to constants."""


def calls(program: Program, function: Function) -> list[Function]:
    """Functions that ``function`` calls, each once."""
    module = program.modules[function.module]
    found = {}
    for node in walk(function.node):
        if isinstance(node, ast.Call):
            called = program.function(module, node.func)
            if called is not None:
                found[called.key] = called
    return list(found.values())
