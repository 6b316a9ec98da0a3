"""The integer subset as C99 that reads like the source it came from.

One .c and .h per module, every name prefixed ``canroll_``, comments and docstrings carried over,
no state but the caller's records, no library call. Operations are done in 32 bits where
:mod:`canroll.codegen.proof.interpreter` shows that they fit, else in 64; a 64-bit value is stored
in a narrower type only where it is shown to fit, so that no cast changes a value.
"""

import ast
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from textwrap import wrap
from typing import Literal

from canroll.codegen.c99 import kept, record_name
from canroll.codegen.c99.function import FunctionWriter
from canroll.codegen.c99.linkage import (
    PUBLIC_NUMBERS,
    PUBLIC_TABLES,
    Home,
    Linkage,
    Names,
    linkage,
    reachable,
)
from canroll.codegen.c99.notes import Notes
from canroll.codegen.c99.reduced import Reducer
from canroll.codegen.c99.text import (
    CLOSE_C,
    OPEN_C,
    RUNTIME,
    WIDTH,
    broken,
    comment,
    comments_of,
    declaration,
    plain,
)
from canroll.codegen.operations.c_expression import C_TYPES, PRIMARY, literal
from canroll.codegen.operations.intervals import Value
from canroll.codegen.operations.table import Access
from canroll.codegen.proof.interpreter import Interpreter
from canroll.codegen.proof.one_calibration import outcome
from canroll.codegen.proof.prove import entries_of, prove
from canroll.codegen.subset import rules
from canroll.codegen.subset.parse import load
from canroll.codegen.subset.program import (
    CONST_RECORD,
    FIRMWARE,
    Constant,
    Function,
    Module,
    Program,
    Record,
    statements,
)
from canroll.codegen.subset.walk import walk

# the gains header carries the calibration's type too, so that it compiles alone
CALIBRATION_GUARD = "CANROLL_CALIBRATION_TYPE"


@cache
def firmware() -> dict[str, str]:
    """The firmware's files, translated once."""
    return kept.translation("ecu", emit)


def emit(
    entry: str = "ecu", folder: Path = FIRMWARE, services: Sequence[str] = ()
) -> dict[str, str]:
    """Translate the module ``entry``, ``services`` and all they use; return texts by file name.

    Raises SubsetError, naming file and line, for anything outside the subset.
    """
    return translated(load(entry, folder, services=services))


def translated(program: Program, notes: Notes | None = None) -> dict[str, str]:
    """Translate a program, which has been read for this alone; see :func:`emit`."""
    rules.check(program)
    links, seen = linkage(program), prove(program).seen
    # what no entry point reaches is typed by its function alone
    rest = Interpreter(program)
    for function in program.functions():
        if function.key in links.reachable and not _reached(function, seen):
            rest.run(function)
    return Emitter(program, links, {**rest.seen, **seen}, notes or Notes()).files()


def translated_for(
    program: Program,
    calibration: Mapping[tuple[str, tuple[int, ...]], int],
    notes: Notes | None = None,
) -> dict[str, str]:
    """Translate a program for one calibration, its loop as one unit; see :func:`translated`.

    ``calibration`` is every stored integer by field and indices. Services stay as they are.

    Raises:
        CanrollError: the result is not proved to be safe.
    """
    rules.check(program)
    seen = outcome(program, calibration)
    entries = {f.key for f in entries_of(program, program.entries[0])}
    loop = frozenset(key[0] for key in reachable(program, entries))
    reducer = Reducer(program, seen, calibration)
    for function in program.functions():
        if function.module in loop:
            reducer.reduce(function)
    return Emitter(program, linkage(program, loop), seen.seen, notes or Notes()).files()


class Emitter:
    """Writes the files of one program.

    Args:
        program: is written.
        links: which symbols are public, shared or static, and in which file.
        seen: the intervals of its expressions.
        notes: further comments.
    """

    def __init__(
        self, program: Program, links: Linkage, seen: Mapping[ast.AST, Value], notes: Notes
    ) -> None:
        self.program, self.linkage, self.seen, self.notes = program, links, seen, notes
        self.names = Names(program, links.public)

    # files

    def files(self) -> dict[str, str]:
        """All files, including the runtime header and the public header."""
        found = {RUNTIME.name: RUNTIME.read_text("utf-8"), "canroll.h": self._public_header()}
        sources: dict[str, list[Module]] = {}
        for module in self.program.modules.values():
            found[f"canroll_{module.name}.h"] = self._header(module)
            tables = [c for c in module.constants.values() if c.type.shape]
            if self._functions(module) or any(self._home(c) == "header" for c in tables):
                file = self.program.entries[0] if module.name in self.linkage.unit else module.name
                sources.setdefault(file, []).append(module)
        for name, modules in sources.items():
            found[f"canroll_{name}.c"] = self._source(modules)
        return found

    def _functions(self, module: Module) -> list[Function]:
        return [f for f in module.functions.values() if f.key in self.linkage.reachable]

    def _public_header(self) -> str:
        homes = dict.fromkeys(key[0] for key in self.linkage.public)
        lines = comment("The roll-control ECU: its records and its entry points.")
        lines += ["#ifndef CANROLL_H", "#define CANROLL_H", ""]
        records = [m.name for m in self.program.modules.values() if m.records]
        # the tables of the mailboxes, and the numbers by which receive() takes their frames
        tables = [name for name in (PUBLIC_NUMBERS, PUBLIC_TABLES) if name in self.program.modules]
        for name in dict.fromkeys([*records, *tables, *homes]):
            lines.append(f'#include "canroll_{name}.h"')
        return "\n".join([*lines, "", "#endif", ""])

    def _header(self, module: Module) -> str:
        guard = f"CANROLL_{module.name.upper()}_H"
        lines = comment(module.doc or module.name)
        lines += [f"#ifndef {guard}", f"#define {guard}", "", '#include "canroll_runtime.h"']
        functions = [f for f in self._functions(module) if f.key in self.linkage.shared]
        needed = {its.record for f in functions for its in f.parameters.values() if its.record}
        homes = {self.program.record(name).module for name in needed} - {module.name}
        lines += [f'#include "canroll_{home}.h"' for home in sorted(homes)]
        declared = list(self._constants(module, "header"))
        for record in module.records.values():
            declared += ["", *self._record(module, record)]
        if functions:
            declared.append("")
        for function in functions:
            declared += broken(f"{self._prototype(function)};")
        if functions or any(line.startswith("extern ") for line in declared):
            declared = [*OPEN_C, *declared, *CLOSE_C]
        return "\n".join([*lines, *declared, "", "#endif", ""])

    def _home(self, constant: Constant) -> Home:
        return self.linkage.homes[constant.module, constant.name]

    def _constants(self, module: Module, home: Literal["header", "source"]) -> Iterator[str]:
        last = -2
        for constant in module.constants.values():
            if self._home(constant) != home:
                continue
            if constant.line > last + 1 or constant.line - 1 in module.comments:
                yield ""
                yield from comments_of(module.comments, [constant.line - 1])
            last = constant.end_line
            if constant.type.shape:
                storage = "extern const" if home == "header" else "static const"
                yield from self._table(constant, storage, body=home == "source")
            elif isinstance(constant.value, int):
                text = literal(constant.value).inside(PRIMARY)
                yield f"#define {self.names.constant(constant)} {text}"

    def _table(self, constant: Constant, storage: str, *, body: bool) -> Iterator[str]:
        its, name = constant.type, self.names.constant(constant)
        head = f"{storage} {declaration(its.kind, name, its.shape)}"
        if not body:
            yield f"{head};"
            return
        yield f"{head} = {{"
        yield from _rows(constant)
        yield "};"

    def _record(self, module: Module, record: Record) -> Iterator[str]:
        yield from comment(record.doc or record.name)
        guarded = record.name == CONST_RECORD
        if guarded:
            yield f"#ifndef {CALIBRATION_GUARD}"
            yield f"#define {CALIBRATION_GUARD}"
        yield "typedef struct {"
        last = record.line
        for its in record.fields.values():
            yield from comments_of(module.comments, range(last + 1, its.line), "    ")
            last = its.line
            qualifier = "volatile " if its.volatile else ""
            field = declaration(its.type.kind, its.name, its.type.shape)
            yield f"    {qualifier}{field};{_described(its.meaning, its.unit, its.q)}"
        yield f"}} {record_name(record.name)};"
        if guarded:
            yield "#endif"

    def _prototype(self, function: Function) -> str:
        written = self.program.writers.get(function.key, frozenset())
        parameters = []
        for name, its in function.parameters.items():
            const = "" if name in written else "const "
            if its.kind == "record":
                parameters.append(f"{const}{record_name(its.record)} *{name}")
            elif its.shape:
                volatile = "volatile " if (function.key, name) in self.linkage.volatile else ""
                shape = ("",) if (function.key, name) in self.linkage.open else its.shape
                parameters.append(f"{const}{volatile}{declaration(its.kind, name, shape)}")
            else:
                parameters.append(f"{C_TYPES[its.kind]} {name}")
        result = C_TYPES[function.result] if function.result else "void"
        static = "" if function.key in self.linkage.shared else "static "
        return (
            f"{static}{result} {self.names.function(function)}({', '.join(parameters) or 'void'})"
        )

    def _source(self, modules: list[Module]) -> str:
        """One file of C; its modules are in the order in which they use each other."""
        files = ", ".join(module.path.name for module in modules)
        lines = comment("\n".join(wrap(f"Generated from {files}.", WIDTH - 8)))
        own = [module.name for module in modules]
        lines += [f'#include "canroll_{name}.h"' for name in own]
        used = {m for module in modules for m in module.uses() if m in self.program.modules}
        lines += [f'#include "canroll_{name}.h"' for name in sorted(used - {*own})]
        for module in modules:
            lines += [line for line in self._constants(module, "source")]
            for constant in module.constants.values():
                if constant.type.shape and self._home(constant) == "header":
                    lines += ["", *self._table(constant, "const", body=True)]
        functions = [(m, function) for m in modules for function in self._functions(m)]
        early = self._called_early([function for _, function in functions])
        if early:
            lines.append("")
        for function in early:
            lines += broken(f"{self._prototype(function)};")
        text = "\n".join(line for pair in functions for line in self._function(*pair))
        return "\n".join([*lines, "", text, ""]).replace("\n\n\n", "\n\n")

    def _called_early(self, functions: list[Function]) -> list[Function]:
        seen: set[tuple[str, str]] = set()
        early: dict[tuple[str, str], Function] = {}
        for function in functions:
            for called in self.program.calls(function):
                if called.key not in self.linkage.shared and called.key not in seen | {
                    function.key
                }:
                    early[called.key] = called
            seen.add(function.key)
        return list(early.values())

    def _function(self, module: Module, function: Function) -> list[str]:
        lines: list[str] = []
        doc = ast.get_docstring(function.node)
        if doc:
            lines += comment(doc)
        if note := self.notes.of_function(function):
            lines += comment(note)
        lines += broken(self._prototype(function))
        lines.append("{")
        for constant in module.constants.values():
            if self._home(constant) == function.key:
                table = self._table(constant, "static const", body=True)
                lines += comments_of(module.comments, [constant.line - 1], "    ")
                lines += [f"    {line}" for line in table]
        body = FunctionWriter(self.program, self.names, self.seen, function, self.notes)
        # a size is a literal in C
        sizes = {
            node.args[0]
            for node, ref in self.program.references(function)
            if isinstance(node, ast.Call) and isinstance(ref, Access) and ref.effect == "size"
        }
        used = {n.id for n in walk(function.node) if isinstance(n, ast.Name) and n not in sizes}
        lines += [f"    (void){name};" for name in function.parameters if name not in used]
        lines += body.lines()
        return [*lines, "}", ""]


def _reached(function: Function, seen: Mapping[ast.AST, Value]) -> bool:
    """Whether every statement and comparison of a function has been run."""
    nodes = (n for s in statements(function.node) for n in walk(s))
    values = (
        node.left if isinstance(node, ast.Compare) else getattr(node, "value", None)
        for node in nodes
        if isinstance(node, ast.stmt | ast.Compare)
    )
    return all(value in seen for value in values if value is not None)


def _described(meaning: str, unit: str, q: int) -> str:
    told = [meaning] if meaning else []
    if unit or q:
        told.append(" ".join(part for part in (unit, f"Q{q}" if q else "") if part))
    return f" /* {plain(', '.join(told))} */" if told else ""


def _rows(constant: Constant) -> Iterator[str]:
    assert isinstance(constant.value, tuple)
    suffix = "u" if constant.type.kind == "u32" else ""
    if isinstance(constant.value[0], tuple):
        for row in constant.value:
            assert isinstance(row, tuple)
            yield f"    {{{', '.join(f'{element}{suffix}' for element in row)}}},"
        return
    texts = [f"{element}{suffix}" for element in constant.value]
    across = min(16, (WIDTH - 4) // (max(map(len, texts)) + 2))
    for start in range(0, len(texts), across):
        yield f"    {', '.join(texts[start : start + across])},"
