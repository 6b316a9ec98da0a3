"""Ranges of the state's fields for one program, and a state record that declares them.

The declared ranges are an invariant of the general program, so one run from them shows what a
calibration leaves of each: the hull of all that is stored. The next run starts from there.
"""

import ast
from collections.abc import Mapping

from codegen.proof import intervals as iv
from codegen.proof.abstract_state import State
from codegen.proof.interpreter import Interpreter
from codegen.proof.intervals import Value
from codegen.proof.prove import entry_points
from codegen.specialise.places import STATE_RECORD
from codegen.subset.program import KINDS, Program


class Stores(Interpreter):
    """Runs a program and notes what it stores in each field of the state."""

    def __init__(self, program: Program) -> None:
        super().__init__(program, proof=True)
        self.stored: dict[str, Value] = {}

    def _store(self, node: ast.stmt, target: ast.expr, value: Value, state: State) -> None:
        super()._store(node, target, value, state)
        if not isinstance(target, ast.Name):
            key = self._place(target, state).key
            assert key is not None
            if key[0] == STATE_RECORD:
                self.note(key[1], value)

    def _clear(self, node: ast.Call, state: State) -> Value:
        zero = super()._clear(node, state)
        for name in self.program.record(STATE_RECORD).fields:
            self.note(name, zero)
        return zero

    def note(self, field: str, value: Value) -> None:
        """Add ``value`` to what is stored in a field."""
        before = self.stored.get(field)
        self.stored[field] = value if before is None else iv.hull(before, value)


def stored(program: Program) -> dict[str, Value]:
    """What is stored in each field of the state that no interrupt writes."""
    run = Stores(program)
    for function in entry_points(program):
        run.run(function)
    fields = program.record(STATE_RECORD).fields
    return {
        name: _in_size(value.limited(its.lo, its.hi), its.type.kind)
        for name, its in fields.items()
        if not its.volatile and (value := run.stored.get(name)) is not None
    }


def declared(source: str, ranges: Mapping[str, Value]) -> str:
    """The module of the state record with ``ranges`` in place of those it declares.

    A field keeps its size in memory: bytes stay bytes, words words.
    """
    lines = source.splitlines(keepends=True)
    edits: list[tuple[int, int, int, int, str]] = []
    for record in ast.parse(source).body:
        if not isinstance(record, ast.ClassDef) or record.name != STATE_RECORD:
            continue
        for node in record.body:
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                its = ranges.get(node.target.id)
                if its is not None:
                    edits += _edits(node, its)
    for line, begin, end_line, end, text in sorted(edits, reverse=True):
        tail = lines[end_line - 1].encode()[end:].decode()
        lines[line - 1 : end_line] = [lines[line - 1].encode()[:begin].decode() + text + tail]
    return "".join(lines)


def _edits(node: ast.AnnAssign, its: Value) -> list[tuple[int, int, int, int, str]]:
    assert isinstance(node.annotation, ast.Subscript)
    assert isinstance(node.annotation.slice, ast.Tuple)
    description = node.annotation.slice.elts[-1]
    assert isinstance(description, ast.Call)
    first, last = description.args[:2]
    assert first.end_lineno is not None and last.end_col_offset is not None
    place = (first.lineno, first.col_offset, last.end_lineno or 0, last.end_col_offset)
    return [(*place, f"{its.lo}, {its.hi}")]


def _in_size(its: Value, kind: str) -> Value:
    """``its``, widened where the field table would else take a word for a byte."""
    if kind != "u8" and its.within(*KINDS["u8"]):
        return Value(its.lo, KINDS["u8"][1] + 1)
    return its
