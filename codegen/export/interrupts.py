"""Fields of the ECU's record read and written by each entry point, for interrupt safety.

``receive`` may interrupt ``tick`` anywhere: it may only access volatile fields, and must not write
any field that the tick writes too, except the flags that hand over a frame.
"""

import ast
from dataclasses import dataclass

from canroll.errors import CanrollError
from codegen.operations.table import Access
from codegen.proof.prove import entry_points
from codegen.subset.parse import load
from codegen.subset.program import CONST_RECORD, FieldReference, Function, Program, base
from codegen.subset.resolve import stored

STATE = "Ecu"
HANDED_OVER = frozenset({"rx_fresh", "rx_own"})
"""Set by ``receive``, cleared by ``tick``: each a single byte."""


@dataclass(frozen=True, slots=True)
class SharedAccess:
    """Fields of the ECU's record that an entry point reads and writes.

    ``calibrated``: whether it needs the calibration.
    """

    reads: frozenset[str]
    writes: frozenset[str]
    calibrated: bool


def accesses(program: Program | None = None) -> dict[str, SharedAccess]:
    """Fields accessed by each entry point, by its name."""
    program = program or load()
    return {entry.name: _access(program, entry) for entry in entry_points(program)}


def _access(program: Program, entry: Function) -> SharedAccess:
    reads: set[str] = set()
    writes: set[str] = set()
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
            if isinstance(node, ast.Call) and isinstance(ref, Access) and ref.effect == "clear":
                writes |= set(program.record(STATE).fields)
            if (
                isinstance(node, ast.Attribute)
                and isinstance(ref, FieldReference)
                and ref.record == STATE
            ):
                (writes if node in places else reads).add(ref.field.name)
    return SharedAccess(frozenset(reads), frozenset(writes), calibrated)


def check(program: Program | None = None) -> dict[str, SharedAccess]:
    """Return :func:`accesses`; raise CanrollError if ``receive`` is unsafe as an interrupt."""
    program = program or load()
    found = accesses(program)
    receive, tick = found["receive"], found["tick"]
    volatile = {name for name, its in program.record(STATE).fields.items() if its.volatile}
    for name in sorted((receive.reads | receive.writes) - volatile):
        raise CanrollError(f"firmware: receive uses {name}, which is not volatile")
    for name in sorted(receive.writes & tick.writes - HANDED_OVER):
        raise CanrollError(f"firmware: receive and tick both write {name}")
    if receive.calibrated:
        raise CanrollError("firmware: receive reads the calibration")
    return found


def table(program: Program | None = None) -> str:
    """The fields that an interrupt shares with the tick, as Markdown."""
    found = check(program)
    receive, tick = found["receive"], found["tick"]
    rows = ["| field | `canroll_receive` | `canroll_tick` |", "| --- | --- | --- |"]
    for name in sorted(receive.reads | receive.writes):
        rows.append(f"| `{name}` | {_how(receive, name)} | {_how(tick, name)} |")
    return "\n".join(rows)


def _how(access: SharedAccess, name: str) -> str:
    uses = {"reads": access.reads, "writes": access.writes}
    return ", ".join(word for word, names in uses.items() if name in names) or "—"
