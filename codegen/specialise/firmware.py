"""The firmware of a bus, specialised for one calibration: another firmware of the same bus.

It is a program of the subset like the one it came from, so it is checked, proved and emitted by the
same means, and CPython runs it. It takes the same records and leaves the same bytes in the state;
only the calibration it was made for starts it, as its CRC is that of the record it is given.
"""

import ast
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import product

from canroll.errors import CanrollError
from codegen.operations.intervals import KINDS
from codegen.operations.table import INTRINSICS
from codegen.proof.prove import entry_points, prove
from codegen.run.bus_firmware import BusFirmware
from codegen.run.ecu_traffic import refused
from codegen.run.memory_image import fill, image
from codegen.specialise import reach, state_ranges
from codegen.specialise.evaluator import Evaluator, steady
from codegen.specialise.expressions import Copy
from codegen.specialise.places import Element
from codegen.subset.program import FIRMWARE, Const, Program, Type, names
from codegen.subset.walk import walk
from firmware.calibration import Calibration
from firmware.subset import fields

CHECK = ("check", "check")
RUNS = 3
"""Runs that narrow the state's ranges and cut off branches; later ones hardly add to it."""
Tables = dict[str, tuple[Type, Const]]
HEAD = '''\
"""The loop for the calibration with id {id} and CRC {crc}, and for no other.

Made by codegen.specialise, not to be edited.
"""

from typing import Annotated

from firmware.com import signals
from firmware.calibration import Calibration
from firmware.state import Ecu
from firmware.subset import {names}

__all__ = ["Ecu", "init", "receive", "signals", "tick"]
'''


def specialised(firmware: BusFirmware, record: Calibration) -> BusFirmware:
    """Return ``firmware`` specialised for a calibration; services beside the loop stay as they are.

    Raises:
        CanrollError: ``init`` refuses the calibration, or the result is not proved to be safe.
    """
    return _specialised(firmware, image(record))


@cache
def _specialised(firmware: BusFirmware, data: bytes) -> BusFirmware:
    record = Calibration()
    fill(record, data)
    started = firmware.record()
    rule = firmware.loop.init(started, record)
    if rule:
        raise refused(rule)
    modules = firmware.kept(
        f"loop of the calibration {data.hex()}", lambda: _modules(firmware, record, started)
    )
    return replace(firmware, modules=modules)


def _modules(firmware: BusFirmware, record: Calibration, started: object) -> dict[str, str]:
    """The modules of the specialised firmware that differ from those checked in, proved."""
    # what is beside the loop has records of its own, of which the calibration says nothing
    loop = replace(firmware, services=())
    functions, tables = _loop(loop.program(), record, dict(_elements(started)))
    state = firmware.modules.get("state.py") or (FIRMWARE / "state.py").read_text("utf-8")
    modules = {**firmware.modules, "ecu.py": _source(record, functions, tables)}
    for _ in range(RUNS):
        program = replace(loop, modules=modules).program()
        modules["state.py"] = state_ranges.declared(state, state_ranges.stored(program))
        modules["ecu.py"] = _source(record, reach.cut(program, "ecu"), tables)
    result = replace(firmware, modules=modules)
    findings = prove(result.program()).findings
    if findings:
        raise CanrollError(f"the specialised firmware is not proved to be safe: {findings[0]}")
    return modules


def _loop(
    program: Program, record: Calibration, started: dict[Element, int]
) -> tuple[list[ast.FunctionDef], Tables]:
    """The functions of the specialised loop, and the tables that they may read."""
    calibration = dict(_elements(record))
    entries = {f.name: f for f in entry_points(program)}
    results = {CHECK: 0}
    held = steady(program, entries, calibration, started, results)
    # before the start nothing holds, and a frame may come whatever the start came to
    early = Evaluator(program, calibration, {}, results)
    early.entry(entries["init"])
    early.entry(entries["receive"])
    late = Evaluator(program, calibration, held, results, tables=early.tables, used=early.used)
    late.entry(entries["tick"])
    return _merged([*early.copies.values(), *late.copies.values()], tuple(entries)), early.tables


def _merged(copies: Iterable[Copy], entries: Sequence[str]) -> list[ast.FunctionDef]:
    """The functions of ``copies`` that ``entries`` need, callees first; equal ones only once."""
    renamed: dict[str, str] = {}
    known: dict[str, str] = {}
    functions: dict[str, ast.FunctionDef] = {}
    for copy in copies:
        node = copy.node
        for inner in walk(node):
            if isinstance(inner, ast.Name):
                inner.id = renamed.get(inner.id, inner.id)
        head = ast.unparse(ast.fix_missing_locations(node.args))
        text = head + "".join(ast.unparse(statement) for statement in node.body[1:])
        renamed[copy.name] = known.setdefault(text, copy.name)
        functions.setdefault(renamed[copy.name], node)
    needed = reach.needed(functions, entries)
    return [node for name, node in functions.items() if name in needed]


def _source(record: Calibration, functions: list[ast.FunctionDef], tables: Tables) -> str:
    """The module of the loop."""
    bodies = "\n\n\n".join(ast.unparse(ast.fix_missing_locations(f)) for f in functions)
    words = names(functions)
    needed = {name: tables[name] for name in sorted(tables) if name in words}
    text = "\n".join(_table(name, *table) for name, table in needed.items())
    kinds = {its.kind for its, _ in needed.values()}
    imported = sorted(words & (INTRINSICS.keys() | KINDS.keys()) | kinds)
    head = HEAD.format(id=record.id, crc=record.crc, names=", ".join(imported))
    return f"{head}\n{text}\n\n\n{bodies}\n"


def _table(name: str, its: Type, value: Const) -> str:
    inner = its.kind
    for _ in its.shape:
        inner = f"tuple[{inner}, ...]"
    return f"{name}: {inner} = {value!r}"


def _elements(record: object) -> Iterator[tuple[Element, int]]:
    for field in fields(type(record)):
        for indices in product(*map(range, field.shape)):
            value = getattr(record, field.name)
            for index in indices:
                value = value[index]
            yield (field.name, indices), value
