"""Fields of the ECU's record read and written by each entry point, for interrupt safety.

``receive`` may interrupt ``tick`` anywhere: it may only access volatile fields, and must not write
any field that the tick writes too, except the flags that hand over a frame.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass

from canroll.errors import CanrollError
from codegen.proof.prove import entry_points
from codegen.subset.effects import stored, writers
from codegen.subset.parse import load
from codegen.subset.program import Function, Program, calls

STATE = "Ecu"
CONST = "Calibration"
HANDED_OVER = frozenset({"rx_fresh", "rx_own"})
"""Set by ``receive``, cleared by ``tick``: each a single byte."""


@dataclass(frozen=True, slots=True)
class Access:
    """Fields of the ECU's record that an entry point reads and writes.

    ``calibrated``: whether it needs the calibration.
    """

    reads: frozenset[str]
    writes: frozenset[str]
    calibrated: bool


def accesses(program: Program | None = None) -> dict[str, Access]:
    """Fields accessed by each entry point, by its name."""
    program = program or load()
    written = writers(program)
    return {entry.name: _access(program, entry, written) for entry in entry_points(program)}


def _access(
    program: Program, entry: Function, written: dict[tuple[str, str], frozenset[str]]
) -> Access:
    reads: set[str] = set()
    writes: set[str] = set()
    todo, done = [entry], set()
    calibrated = False
    while todo:
        function = todo.pop()
        if function.key in done:
            continue
        done.add(function.key)
        todo += calls(program, function)
        calibrated |= any(its.record == CONST for its in function.parameters.values())
        places = set(_fields_stored(program, function, written))
        for node in ast.walk(function.node):
            if (
                isinstance(node, ast.Call)
                and program.intrinsic(program.modules[function.module], node.func) == "clear"
            ):
                writes |= set(program.record(STATE).fields)
            if _is_field(function, node):
                assert isinstance(node, ast.Attribute)
                (writes if node in places else reads).add(node.attr)
    return Access(frozenset(reads), frozenset(writes), calibrated)


def _is_field(function: Function, node: ast.AST) -> bool:
    if not (isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)):
        return False
    owner = function.parameters.get(node.value.id)
    return owner is not None and owner.record == STATE


def _fields_stored(
    program: Program, function: Function, written: dict[tuple[str, str], frozenset[str]]
) -> Iterator[ast.AST]:
    """Yield fields that are assigned, or passed to a function that writes its parameter."""
    for target in stored(program, function, written):
        base = target
        while isinstance(base, ast.Subscript):
            base = base.value
        yield base


def check(program: Program | None = None) -> dict[str, Access]:
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


def _how(access: Access, name: str) -> str:
    uses = {"reads": access.reads, "writes": access.writes}
    return ", ".join(word for word, names in uses.items() if name in names) or "—"
