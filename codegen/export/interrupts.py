"""Fields of the records read and written by each entry point, for interrupt safety.

``receive``, of the loop or of a service, may interrupt all other entry points anywhere: it may only
access volatile fields, and must not write any field that another writes too, except the flags that
hand over a frame. ``init`` comes before the first interrupt.
"""

import ast
from dataclasses import dataclass

from canroll.codegen.c99.linkage import public_name
from canroll.codegen.operations.table import Access
from canroll.codegen.proof.prove import entry_points
from canroll.codegen.subset.parse import load
from canroll.codegen.subset.program import (
    CONST_RECORD,
    FieldReference,
    Function,
    Parameter,
    Program,
    base,
)
from canroll.codegen.subset.resolve import stored
from canroll.errors import CanrollError

HANDED_OVER = frozenset({"rx_fresh", "rx_own"})
"""Set by ``receive``, cleared by ``tick``: each a single byte."""

Field = tuple[str, str]
"""A record and one of its fields."""


@dataclass(frozen=True, slots=True)
class SharedAccess:
    """Fields that an entry point reads and writes.

    ``calibrated``: whether it needs the calibration.
    """

    reads: frozenset[Field]
    writes: frozenset[Field]
    calibrated: bool


def accesses(program: Program | None = None) -> dict[str, SharedAccess]:
    """Fields accessed by each entry point, by its name in C."""
    program = program or load()
    return {public_name(program, f): _access(program, f) for f in entry_points(program)}


def _access(program: Program, entry: Function) -> SharedAccess:
    reads: set[Field] = set()
    writes: set[Field] = set()
    todo, done = [entry], set()
    calibrated = False
    while todo:
        function = todo.pop()
        if function.key in done:
            continue
        done.add(function.key)
        todo += program.calls(function)
        calibrated |= any(its.record == CONST_RECORD for its in function.parameters.values())
        # assigned, or passed to a function that writes its parameter
        places = {base(target) for target in stored(program, ast.walk(function.node))}
        for node, ref in program.references(function):
            match node, ref:
                case ast.Attribute(), FieldReference(record=record, field=field):
                    (writes if node in places else reads).add((record, field.name))
                case ast.Call(args=[first, *_]), Access(effect="read" | "write" | "clear"):
                    given = program.refs[first]
                    assert isinstance(given, Parameter)
                    fields = program.record(given.type.record).fields
                    (writes if ref.writes else reads).update((given.type.record, f) for f in fields)
    constant = {each for each in reads | writes if each[0] == CONST_RECORD}
    return SharedAccess(frozenset(reads - constant), frozenset(writes - constant), calibrated)


def check(program: Program | None = None) -> dict[str, SharedAccess]:
    """Return :func:`accesses`; raise CanrollError if a ``receive`` is unsafe as an interrupt."""
    program = program or load()
    entries = accesses(program)
    for name in [name for name in entries if name.endswith("_receive")]:
        interrupt = entries[name]
        for record, field in sorted(interrupt.reads | interrupt.writes):
            if not program.record(record).fields[field].volatile:
                raise CanrollError(f"firmware: {name} uses {field}, which is not volatile")
        for other in sorted(entries.keys() - {name}):
            both = interrupt.writes & entries[other].writes if not other.endswith("_init") else ()
            for _, field in sorted(both):
                if field not in HANDED_OVER:
                    raise CanrollError(f"firmware: {name} and {other} both write {field}")
        if interrupt.calibrated:
            raise CanrollError(f"firmware: {name} reads the calibration")
    return entries


def table(program: Program | None = None) -> str:
    """The fields that the loop's interrupt shares with its tick, as Markdown."""
    entries = check(program)
    receive, tick = entries["canroll_receive"], entries["canroll_tick"]
    rows = ["| field | `canroll_receive` | `canroll_tick` |", "| --- | --- | --- |"]
    for field in sorted(receive.reads | receive.writes):
        rows.append(f"| `{field[1]}` | {_how(receive, field)} | {_how(tick, field)} |")
    return "\n".join(rows)


def _how(access: SharedAccess, field: Field) -> str:
    uses = {"reads": access.reads, "writes": access.writes}
    return ", ".join(word for word, fields in uses.items() if field in fields) or "—"
