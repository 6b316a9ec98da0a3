"""A checksum that the user writes as a function in the firmware's subset of Python.

``def name(payload: Annotated[list[u8], n], identifier: i32) -> i32``, with helpers, constants and
tables beside it: the file becomes a module of the firmware, is proved as it is read, and is called
with the frame and its identifier. What it returns is put into the checksum's place.
"""

import ast
import re
import tempfile
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from canroll import documents
from canroll.codegen.c99.emit import translated
from canroll.codegen.frame.checksum import PREFIX, OwnChecksum
from canroll.codegen.proof.prove import prove
from canroll.codegen.subset import grammar, rules
from canroll.codegen.subset.parse import load
from canroll.codegen.subset.program import PACKAGE, RUNTIME, Module, SubsetError, Type, copy_sources
from canroll.errors import CanrollError, UnknownNameError, reason

SIGNATURE = "(payload: Annotated[list[u8], n], identifier: i32) -> i32"
TAKEN = (
    *("Annotated", "Calibration", "Ecu", "check", "protect", "e2e"),
    *("byte", "i32", "i64", "to_i32", "u8", "u16", "u32"),
)
"""Names that the module of the frames' protection has for something else."""
RESULTS = ("i32", "u32", "i64")
MOST_CHARACTERS = 100_000
# what the proof starts from: any frame, any identifier of up to 29 bits
ENTRY = "entry_of_maker"
ENTRY_TEXT = """\
from typing import Annotated

from canroll.firmware.{module} import {name}
from canroll.firmware.subset import i32, i64, u8


def tick(payload: Annotated[list[u8], {size}], identifier: i32) -> i64:
    return {name}(payload, identifier & {identifiers})
"""
IDENTIFIERS = (1 << 29) - 1


def own_checksum(text: str, folder: Path, where: str) -> OwnChecksum:
    """Read, check and prove the function that ``text`` names as ``file.py:name``.

    Args:
        text: file, relative to ``folder``, and function.
        folder: of the map.
        where: location of the key, for messages.

    Raises:
        CanrollError: no such function, or one outside the subset; the message names file and line.
    """
    file, colon, name = text.rpartition(":")
    stem = Path(file).stem
    if not colon or not file.endswith(".py") or not name.isidentifier():
        raise CanrollError(f"{where}: {text!r} must be file.py:function")
    if name in TAKEN or re.fullmatch(r"(checksum|check|protect)_\d+", name):
        raise CanrollError(f"{where}: {name} is a name of the firmware's own: choose another")
    if not stem.isidentifier() or stem != stem.lower():
        raise CanrollError(f"{where}: {file}: its name must be lower-case letters, digits and _")
    path = folder / file
    try:
        source = documents.text(path)
    except (OSError, ValueError) as error:
        raise CanrollError(f"{where}: cannot read {path}: {reason(error)}") from error
    if len(source) > MOST_CHARACTERS:
        raise CanrollError(f"{where}: {path} has more than {MOST_CHARACTERS} characters")
    return _proved(path, source, name, where)


def modules(functions: Iterable[OwnChecksum]) -> dict[str, OwnChecksum]:
    """The modules of the firmware that functions make, by name.

    Raises:
        CanrollError: two files would be one module.
    """
    found: dict[str, OwnChecksum] = {}
    for own in functions:
        other = found.setdefault(own.module, own)
        if (other.path, other.source) != (own.path, own.source):
            raise CanrollError(f"{other.path} and {own.path}: rename one, their modules are one")
    return found


@cache
def _proved(path: Path, source: str, name: str, where: str) -> OwnChecksum:
    _refuse_imports(path, source)
    module = f"{PREFIX}{path.stem}"
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        copy_sources(folder)
        (folder / f"{module}.py").write_text(source, encoding="utf-8")
        shown = {module: path}
        alone = load(module, folder, shown).modules[module]
        own = _signed(alone, source, name, where)
        text = ENTRY_TEXT.format(module=module, name=name, size=own.size, identifiers=IDENTIFIERS)
        (folder / f"{ENTRY}.py").write_text(text, encoding="utf-8")
        program = load(ENTRY, folder, shown)
    rules.check(program)
    if alone.functions[name].key in program.writers:
        raise SubsetError(path, alone.functions[name].node, f"{name} must not change the frame")
    for finding in prove(program, bounded=module).findings:
        rule = f"not proved: {finding.what}: [{finding.lo}, {finding.hi}]"
        raise SubsetError(Path(finding.path), finding.line, rule)
    # what remains to be refused is what only the translation sees
    translated(program)
    return own


def _refuse_imports(path: Path, source: str) -> None:
    """Refuse all imports but the subset's words: the function has nothing but the frame."""
    for node in grammar.parsed(path, source).body:
        if isinstance(node, ast.ImportFrom) and node.module not in (
            f"{PACKAGE}.{RUNTIME}",
            "typing",
        ):
            raise SubsetError(path, node, f"a checksum imports from {PACKAGE}.{RUNTIME} only")


def _signed(module: Module, source: str, name: str, where: str) -> OwnChecksum:
    """The function, of which the signature is right."""
    if name not in module.functions:
        raise UnknownNameError(f"function of {module.path} in {where}", name, module.functions)
    function = module.functions[name]
    kinds = list(function.parameters.values())
    if (
        len(kinds) != 2
        or kinds[0].kind != "u8"
        or len(kinds[0].shape) != 1
        or kinds[1] != Type("i32")
        or function.result not in RESULTS
    ):
        rule = f"must be: def {name}{SIGNATURE}; it may return {' or '.join(RESULTS[1:])} as well"
        raise SubsetError(module.path, function.node, rule)
    assert function.result is not None
    return OwnChecksum(module.path, source, name, function.result, kinds[0].shape[0])
