"""Ranges of the state's fields for one program, and a state record that declares them.

The declared ranges are an invariant of the general program, so one run from them shows what a
calibration leaves of each: the hull of all that is stored. The next run starts from there.
"""

import ast
from collections.abc import Mapping

from codegen.operations import intervals as iv
from codegen.operations.intervals import KINDS, Value
from codegen.proof.abstract_memory import AbstractState
from codegen.proof.interpreter import Interpreter
from codegen.proof.prove import entry_points
from codegen.specialise import fold
from codegen.specialise.places import STATE_RECORD
from codegen.subset.program import FieldReference, Program, Record
from codegen.subset.walk import walk


class Stores(Interpreter):
    """Runs a program and notes what it stores in each field of the state."""

    def __init__(self, program: Program) -> None:
        super().__init__(program)
        self.stored: dict[str, Value] = {}

    def _store(self, node: ast.stmt, target: ast.expr, value: Value, state: AbstractState) -> None:
        super()._store(node, target, value, state)
        ref = self.refs[target]
        if isinstance(ref, FieldReference):
            self.note(ref.record, ref.field.name, value)

    def _clear(self, node: ast.Call, record: Record, state: AbstractState) -> Value:
        zero = super()._clear(node, record, state)
        for name in record.fields:
            self.note(record.name, name, zero)
        return zero

    def note(self, record: str, field: str, value: Value) -> None:
        """Add ``value`` to what is stored in a field of the state."""
        if record == STATE_RECORD:
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
    lines = source.splitlines()
    (record,) = (n for n in ast.parse(source).body if getattr(n, "name", "") == STATE_RECORD)
    assert isinstance(record, ast.ClassDef)
    for node in reversed(record.body):
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) in ranges:
            its = ranges[ast.unparse(node.target)]
            (described,) = (n for n in walk(node) if isinstance(n, ast.Call))
            described.args[:2] = [fold.literal(its.lo), fold.literal(its.hi)]
            lines[node.lineno - 1 : node.end_lineno] = [f"    {ast.unparse(node)}"]
    return "\n".join([*lines, ""])


def _in_size(its: Value, kind: str) -> Value:
    """``its``, widened where the field table would else take a word for a byte."""
    if kind != "u8" and its.within(*KINDS["u8"]):
        return Value(its.lo, KINDS["u8"][1] + 1)
    return its
