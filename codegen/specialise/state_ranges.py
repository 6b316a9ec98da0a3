"""Ranges of the state's fields for one program, and a state record that declares them.

The declared ranges are an invariant of the general program, so one run from them shows what a
calibration leaves of each: the hull of all that is stored. The next run starts from there.
"""

import ast
from collections.abc import Mapping

from codegen.operations.intervals import KINDS, Value
from codegen.proof.interpreter import Interpreter
from codegen.proof.prove import entry_points
from codegen.specialise import fold
from codegen.specialise.places import STATE_RECORD
from codegen.subset.program import Program
from codegen.subset.walk import walk


def stored(program: Program) -> dict[str, Value]:
    """What is stored in each field of the state that no interrupt writes."""
    run = Interpreter(program)
    for function in entry_points(program):
        run.run(function)
    fields = program.record(STATE_RECORD).fields
    return {
        name: _in_size(value.limited(its.lo, its.hi), its.type.kind)
        for name, its in fields.items()
        if not its.volatile and (value := run.stored.get((STATE_RECORD, name))) is not None
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
