"""The mutants of the firmware: every operator exchanged, every integer incremented."""

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from codegen.subset.program import FIRMWARE, file_of, source_files

GENERATED = ("signals", "limits")
"""Modules that a drift test holds against their generator."""
SKIPPED = ("subset", "calibration", "state", *GENERATED)
TABLE_LINES = 16
OPERATORS: dict[type[ast.AST], tuple[str, str]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "+"),
    ast.LShift: ("<<", ">>"),
    ast.RShift: (">>", "<<"),
    ast.BitAnd: ("&", "|"),
    ast.BitOr: ("|", "&"),
    ast.BitXor: ("^", "|"),
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.And: ("and", "or"),
    ast.Or: ("or", "and"),
}


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change: ``before`` at ``start`` of a module's text becomes ``after``.

    Its statement begins in line ``first``; ``text`` is the changed line. ``function`` is "" if a
    constant of the module is changed.
    """

    module: str
    function: str
    first: int
    line: int
    start: int
    before: str
    after: str
    text: str

    @property
    def place(self) -> str:
        """Module and function."""
        return f"{self.module}.{self.function}" if self.function else self.module

    def __str__(self) -> str:
        return f"{self.module}.py:{self.line}: {self.before} -> {self.after or 'nothing'}"

    def apply(self, source: str) -> str:
        """The module's text with the change."""
        return source[: self.start] + self.after + source[self.start + len(self.before) :]


class Finder:
    """Finds the changes in one module's text."""

    def __init__(self, module: str, source: str) -> None:
        self.module, self.source = module, source
        self.lines = source.splitlines(keepends=True)
        self.starts = [0]
        for text in self.lines:
            self.starts.append(self.starts[-1] + len(text))

    def offset(self, line: int, column: int) -> int:
        """Offset in the text of a position in the syntax tree, whose columns count bytes."""
        return self.starts[line - 1] + len(self.lines[line - 1].encode()[:column].decode())

    def changes(self, node: ast.AST) -> Iterator[tuple[int, str, str]]:
        """Place, old and new text of the changes to ``node`` itself."""
        if isinstance(node, ast.BinOp):
            yield from self.between(node.left, node.right, node.op)
        elif isinstance(node, ast.AugAssign) and type(node.op) in OPERATORS:
            before, after = (f"{text}=" for text in OPERATORS[type(node.op)])
            begin = self.offset(node.target.end_lineno or 0, node.target.end_col_offset or 0)
            yield self.source.index(before, begin), before, after
        elif isinstance(node, ast.Compare):
            yield from self.between(node.left, node.comparators[0], node.ops[0])
        elif isinstance(node, ast.BoolOp):
            for left, right in zip(node.values, node.values[1:], strict=False):
                yield from self.between(left, right, node.op)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            yield self.offset(node.lineno, node.col_offset), "-", ""
        elif isinstance(node, ast.Constant) and type(node.value) is int:
            place = self.offset(node.lineno, node.col_offset)
            end = self.offset(node.end_lineno or 0, node.end_col_offset or 0)
            yield place, self.source[place:end], str(node.value + 1)

    def between(
        self, left: ast.expr, right: ast.expr, operator: ast.AST
    ) -> Iterator[tuple[int, str, str]]:
        """The change of an operator between two expressions."""
        if type(operator) not in OPERATORS:
            return
        before, after = OPERATORS[type(operator)]
        begin = self.offset(left.end_lineno or 0, left.end_col_offset or 0)
        place = self.source.find(before, begin, self.offset(right.lineno, right.col_offset))
        if place >= 0:
            yield place, before, after

    def mutants(self, function: str, statements: list[ast.stmt]) -> Iterator[Mutant]:
        """The mutants of the statements of one function, or of the module if that is ""."""
        for first, node in _nodes(statements):
            for place, before, after in self.changes(node):
                line = self.source.count("\n", 0, place) + 1
                begin, end = self.starts[line - 1], self.starts[line]
                text = self.source[begin:place] + after + self.source[place + len(before) : end]
                yield Mutant(self.module, function, first, line, place, before, after, text.strip())


def _lines(node: ast.stmt) -> int:
    return (node.end_lineno or 0) + 1 - node.lineno


def _nodes(statements: list[ast.stmt]) -> Iterator[tuple[int, ast.AST]]:
    """Every node below ``statements``, with the first line of its innermost statement."""
    for statement in statements:
        waiting: list[tuple[int, ast.AST]] = [(statement.lineno, statement)]
        while waiting:
            first, node = waiting.pop(0)
            yield first, node
            for inner in ast.iter_child_nodes(node):
                waiting.append((inner.lineno if isinstance(inner, ast.stmt) else first, inner))


def mutants(module: str, source: str) -> Iterator[Mutant]:
    """Every mutant of a module's functions and constants, in order of the text.

    Published tables are left out: a test compares each with its source.
    """
    finder = Finder(module, source)
    for node in ast.parse(source).body:
        found: Iterator[Mutant] = iter(())
        if isinstance(node, ast.FunctionDef):
            found = finder.mutants(node.name, node.body)
        elif isinstance(node, ast.Assign | ast.AnnAssign) and _lines(node) < TABLE_LINES:
            found = finder.mutants("", [node])
        yield from sorted(found, key=lambda mutant: mutant.start)


def sources() -> dict[str, str]:
    """The text of every module of the firmware."""
    return {path.stem: path.read_text(encoding="utf-8") for path in source_files()}


def write(texts: Mapping[str, str], folder: Path) -> None:
    """Write modules to ``folder`` as a package, each in its room."""
    for name, text in texts.items():
        path = folder / file_of(name).relative_to(FIRMWARE)
        path.parent.mkdir(parents=True, exist_ok=True)
        (path.parent / "__init__.py").touch()
        path.write_text(text, encoding="utf-8")


def all_mutants(texts: Mapping[str, str]) -> list[Mutant]:
    """Every mutant of the hand-written firmware, in order of file and line."""
    found: list[Mutant] = []
    for module, source in texts.items():
        if module not in SKIPPED:
            found += mutants(module, source)
    return found
