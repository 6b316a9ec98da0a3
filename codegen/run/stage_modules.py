"""The firmware's modules that an engineer's own stage replaces."""

import ast
import io
import json
import tempfile
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path

from canroll.codegen.generated.own_stage import NAME, OwnStage
from canroll.codegen.proof.service_rules import STATE
from canroll.codegen.subset import grammar
from canroll.codegen.subset.parse import load
from canroll.codegen.subset.program import FIRMWARE, Module, RecordField, SubsetError, copy_sources
from canroll.codegen.subset.rules import C_WORDS

FILE = f"{NAME}.py"
IMPORTS = """
from canroll.firmware.calibration import Calibration
from canroll.firmware.state import Ecu
from canroll.firmware.subset import i32
"""


def modules(stage: OwnStage) -> dict[str, str]:
    """Return the sources of the firmware's modules that ``stage`` replaces.

    Raises:
        SubsetError: not a stage; the message names file and line.
    """
    path = stage.path
    tree = grammar.parsed(path, stage.source)
    own = _record(path, tree)
    parsed = _parsed(stage)
    replaced = {FILE: _without_record(_with_missing(stage, parsed, own), own)}
    if own is not None:
        taken = load("state").record(STATE).fields
        fields = [its for name, its in parsed.records[own.name].fields.items() if name not in taken]
        _refuse_fields(path, fields)
        state = (FIRMWARE / "state.py").read_text(encoding="utf-8")
        replaced["state.py"] = "\n".join([state.rstrip(), "", *_rows(fields, path), ""])
    return replaced


def _record(path: Path, tree: ast.Module) -> ast.ClassDef | None:
    """The record with the stage's own fields, if it has one."""
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    for node in classes:
        decorators = [ast.unparse(d) for d in node.decorator_list]
        if [ast.unparse(b) for b in node.bases] != [STATE] or decorators != ["record"]:
            rule = f"a stage's own fields are in one '@record class {node.name}({STATE})'"
            raise SubsetError(path, node, rule)
        if node is not classes[0]:
            raise SubsetError(path, node, "a stage has one record")
        if node.name == STATE:
            raise SubsetError(path, node, f"the record needs another name than {STATE}")
    return classes[0] if classes else None


def _parsed(stage: OwnStage) -> Module:
    """The stage alone, with the firmware's modules that it uses."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        copy_sources(folder)
        (folder / FILE).write_text(stage.source, encoding="utf-8")
        return load(NAME, folder, {NAME: stage.path}).modules[NAME]


def _with_missing(stage: OwnStage, parsed: Module, own: ast.ClassDef | None) -> str:
    """The source with the firmware's functions where it defines none; refuse other signatures."""
    default = load(NAME).modules[NAME]
    missing = []
    for name, function in default.functions.items():
        its = parsed.functions.get(name)
        if its is None:
            missing.append(ast.get_source_segment(default.source, function.node) or "")
            continue
        kinds = [
            (kind.kind, kind.shape, STATE if own and kind.record == own.name else kind.record)
            for kind in its.parameters.values()
        ]
        right = [(kind.kind, kind.shape, kind.record) for kind in function.parameters.values()]
        if kinds != right or its.result != function.result:
            signature = f"def {name}({ast.unparse(function.node.args)})"
            result = function.result or "None"
            raise SubsetError(stage.path, its.node, f"must be: {signature} -> {result}")
    if len(missing) == len(default.functions):
        names = ", ".join(default.functions)
        raise SubsetError(stage.path, 1, f"a stage defines at least one of {names}")
    if not missing:
        return stage.source
    return "\n\n".join([stage.source.rstrip(), IMPORTS.strip(), *missing]) + "\n"


def _without_record(source: str, own: ast.ClassDef | None) -> str:
    """The source with its record's lines emptied and the firmware's record in its place."""
    if own is None:
        return source
    lines = source.split("\n")
    for token in reversed([*tokenize.generate_tokens(io.StringIO(source).readline)]):
        if token.type == tokenize.NAME and token.string == own.name:
            row, (begin, end) = token.start[0] - 1, (token.start[1], token.end[1])
            lines[row] = lines[row][:begin] + STATE + lines[row][end:]
    for number in range(own.decorator_list[0].lineno, (own.end_lineno or own.lineno) + 1):
        lines[number - 1] = ""
    return "\n".join(lines)


def _refuse_fields(path: Path, fields: Iterable[RecordField]) -> None:
    for its in fields:
        if its.name in C_WORDS or its.name.startswith("__") or its.name.endswith("_t"):
            raise SubsetError(path, its.line, f"'{its.name}' has another meaning in C")
        if its.volatile:
            raise SubsetError(path, its.line, f"{its.name}: no interrupt writes a stage's field")
        if not its.lo <= 0 <= its.hi:
            rule = f"{its.name} starts at 0, which is outside [{its.lo}, {its.hi}]"
            raise SubsetError(path, its.line, rule)


def _rows(fields: Iterable[RecordField], path: Path) -> Iterator[str]:
    """The fields in the order of the state record: words, then bytes."""
    yield f"    # own stage {path.name}"
    for its in sorted(fields, key=lambda one: one.type.kind == "u8"):
        kind = its.type.kind
        for _ in its.type.shape:
            kind = f"list[{kind}]"
        sizes = "".join(f"{size}, " for size in its.type.shape)
        texts = ", ".join(json.dumps(text, ensure_ascii=False) for text in (its.unit, its.meaning))
        described = f"F({its.lo}, {its.hi}, {its.q}, {texts})"
        yield f"    {its.name}: Annotated[{kind}, {sizes}{described}]"
