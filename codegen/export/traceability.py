"""From requirement to source line, C line, proof obligations and tests, for one firmware.

The requirements are those of ``requirements.toml``. Lines and obligations are read from the program
and the emitted C themselves, so the table is that of the bundle it stands in.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

from canroll.errors import CanrollError
from codegen.c99.linkage import Names, linkage
from codegen.frame.checksum import PREFIX
from codegen.generated import own_stage
from codegen.proof.prove import Proof, prove
from codegen.run.bus_firmware import BusFirmware
from codegen.subset.program import Function, Program

FILE = Path(__file__).with_name("requirements.toml")
SCHEMA = 1
NOTE = (
    "| `TRACEABILITY.md` | from each requirement to source line, C line, proof obligations and "
    "tests |\n"
)
PAGE = "TRACEABILITY.md"
"""File of a bundle; code for one calibration has no functions to trace, as they are merged."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """What the loop must do; ``functions`` are patterns, ``tests`` "file::function"."""

    name: str
    text: str
    functions: tuple[str, ...]
    tests: tuple[str, ...]

    def covers(self, function: Function) -> bool:
        """Whether a function is there for it."""
        return self.matches(".".join(function.key))

    def matches(self, key: str) -> bool:
        """Whether the function "module.name" is there for it."""
        return any(fnmatchcase(key, pattern) for pattern in self.functions)


@cache
def requirements() -> tuple[Requirement, ...]:
    """The requirements, in order of the loop.

    Raises:
        CanrollError: another schema.
    """
    content = tomllib.loads(FILE.read_text(encoding="utf-8"))
    if content.pop("schema") != SCHEMA:
        raise CanrollError(f"{FILE}: this version reads schema {SCHEMA}")
    return tuple(
        Requirement(name, its["text"], tuple(its["functions"]), tuple(its["tests"]))
        for name, its in content.items()
    )


@dataclass(frozen=True, slots=True)
class Row:
    """One function: its lines in source and C, and how many obligations were proved in it."""

    function: str
    source: str
    emitted: str
    obligations: int


def rows(program: Program, files: Mapping[str, str]) -> dict[str, list[Row]]:
    """Return the functions by the requirement they are there for; "" for the engineer's own.

    Raises:
        CanrollError: a function that no requirement, or more than one, asks for.
    """
    links = linkage(program)
    names, proof = Names(program, links.public), prove(program)
    found: dict[str, list[Row]] = {its.name: [] for its in requirements()}
    found[""] = []
    for function in program.functions():
        if function.key not in links.reachable:
            continue
        asked = [its.name for its in requirements() if its.covers(function)]
        if function.module == own_stage.NAME or function.module.startswith(PREFIX):
            asked = [""]
        if len(asked) != 1:
            said = " and ".join(asked) or "none"
            raise CanrollError(f"{FILE.name}: {'.'.join(function.key)} has requirements: {said}")
        found[asked[0]].append(_row(program, function, names, proof, files))
    return found


def _row(
    program: Program, function: Function, names: Names, proof: Proof, files: Mapping[str, str]
) -> Row:
    path = program.modules[function.module].path
    first, last = function.node.lineno, function.node.end_lineno or function.node.lineno
    inside = range(first, last + 1)
    places = proof.obligations.items()
    obligations = sum(n for (file, line), n in places if file == str(path) and line in inside)
    file = f"canroll_{function.module}.c"
    line = defined(files[file], names.function(function))
    return Row(
        ".".join(function.key), f"{path.name}:{first}–{last}", f"src/{file}:{line}", obligations
    )


def defined(text: str, name: str) -> int:
    """Return the line of C on which a function is defined, not only declared."""
    for match in re.finditer(rf"^\w[\w ]*[ *]{name}\(", text, re.MULTILINE):
        if "{" in re.split(r"[;]", text[match.end() :], maxsplit=1)[0]:
            return text.count("\n", 0, match.start()) + 1
    raise CanrollError(f"no function {name} in the C")


def page(firmware: BusFirmware) -> str:
    """Return the table of a bundle as Markdown."""
    asked = FILE.read_text(encoding="utf-8")
    return firmware.kept(asked, lambda: {"text": _made(firmware)})["text"]


def _made(firmware: BusFirmware) -> str:
    return "\n".join([*_lines(rows(firmware.program(), firmware.files)), ""])


def _lines(found: Mapping[str, list[Row]]) -> Iterator[str]:
    total = sum(row.obligations for functions in found.values() for row in functions)
    yield "# From requirement to test"
    yield ""
    yield (
        "Made with this bundle. Source lines are those of canroll's `firmware/`, tests those of "
        "its `tests/`; `test/session_cases.c` runs every statement. Obligations are the places in "
        "a function at which the proof showed that nothing overflows, leaves its field or its "
        f"array, or is divided by zero: {total} in all, each for every state, frame and accepted "
        "calibration."
    )
    for its in requirements():
        yield from ("", f"## {its.name}", "", its.text, "")
        yield from _table(found[its.name])
        yield ""
        yield from (f"- `tests/{test}`" for test in its.tests)
    if found[""]:
        yield from ("", "## own stage, own checksums", "")
        yield "The engineer's own functions: their requirements and tests are the engineer's."
        yield ""
        yield from _table(found[""])


def _table(functions: list[Row]) -> Iterator[str]:
    yield "| function | source | C | obligations proved |"
    yield "| --- | --- | --- | ---: |"
    for row in functions:
        yield f"| `{row.function}` | {row.source} | {row.emitted} | {row.obligations} |"
