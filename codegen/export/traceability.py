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
from importlib.resources import files

from canroll.codegen.c99.linkage import Names, linkage
from canroll.codegen.frame.checksum import PREFIX
from canroll.codegen.generated import own_stage
from canroll.codegen.proof.prove import Proof, prove
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.service import SERVICES
from canroll.codegen.subset.program import Function, Program
from canroll.errors import CanrollError

FILE = "requirements.toml"
"""Name of the files of requirements: of the loop, and beside the modules of each service."""
SCHEMA = 1
NOTE = (
    "| `TRACEABILITY.md` | from each requirement to source line, C line, proof obligations and "
    "tests |\n"
)
PAGE = "TRACEABILITY.md"
UNIT = "canroll_ecu.c"
"""File of all modules of the loop in code for one calibration."""
RUN = "; `test/session_cases.c` runs every statement"
SPECIALISED = """\
The code is for one calibration: a function without a line in C is not reached with it."""
NO_CODE = "—"


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
    packages = dict.fromkeys(
        ["canroll.codegen.export", *(kind.modules for kind in SERVICES.values())]
    )
    return tuple(each for package in packages for each in _read(package))


def _read(package: str) -> Iterator[Requirement]:
    file = files(package) / FILE
    if not file.is_file():
        return
    content = tomllib.loads(file.read_text(encoding="utf-8"))
    if content.pop("schema") != SCHEMA:
        raise CanrollError(f"{file}: this version reads schema {SCHEMA}")
    for name, its in content.items():
        yield Requirement(name, its["text"], tuple(its["functions"]), tuple(its["tests"]))


@dataclass(frozen=True, slots=True)
class Row:
    """One function: its lines in source and C, and how many obligations were proved in it."""

    function: str
    source: str
    emitted: str
    obligations: int


def rows(program: Program, files: Mapping[str, str]) -> dict[str, list[Row]]:
    """Return the functions by the requirement they are there for; "" for the engineer's own.

    ``files`` is the C. What is not reached with its one calibration has a row without a line in it.

    Raises:
        CanrollError: a function that no requirement, or more than one, asks for.
    """
    links = linkage(program)
    names, proof = Names(program, links.public), prove(program)
    traced: dict[str, list[Row]] = {its.name: [] for its in requirements()}
    traced[""] = []
    for function in program.functions():
        if function.key in links.reachable:
            place = _emitted(function, names, files), _obligations(program, function, proof)
            traced[requirement_of(function)].append(Row(*source_of(program, function), *place))
    return traced


def requirement_of(function: Function) -> str:
    """Return the name of the requirement that a function is there for; "": the engineer's own.

    Raises:
        CanrollError: no requirement, or more than one, asks for it.
    """
    if function.module == own_stage.NAME or function.module.startswith(PREFIX):
        return ""
    asked = [its.name for its in requirements() if its.covers(function)]
    if len(asked) != 1:
        said = " and ".join(asked) or "none"
        raise CanrollError(f"{FILE}: {'.'.join(function.key)} has requirements: {said}")
    return asked[0]


def _lines_of(function: Function) -> range:
    return range(function.node.lineno, (function.node.end_lineno or function.node.lineno) + 1)


def source_of(program: Program, function: Function) -> tuple[str, str]:
    """Return a function's name, and its file and lines."""
    lines, path = _lines_of(function), program.modules[function.module].path
    return ".".join(function.key), f"{path.name}:{lines[0]}–{lines[-1]}"


def _obligations(program: Program, function: Function, proof: Proof) -> int:
    path, lines = str(program.modules[function.module].path), _lines_of(function)
    return sum(n for (file, at), n in proof.obligations.items() if file == path and at in lines)


def _emitted(function: Function, names: Names, files: Mapping[str, str]) -> str:
    file, name = f"canroll_{function.module}.c", names.function(function)
    file = file if file in files else UNIT
    if file == UNIT and f" {name}(" not in files[UNIT]:
        return NO_CODE
    return f"src/{file}:{defined(files[file], name)}"


def defined(text: str, name: str) -> int:
    """Return the line of C on which a function is defined, not only declared."""
    for match in re.finditer(rf"^\w[\w ]*[ *]{name}\(", text, re.MULTILINE):
        if "{" in re.split(r"[;]", text[match.end() :], maxsplit=1)[0]:
            return text.count("\n", 0, match.start()) + 1
    raise CanrollError(f"no function {name} in the C")


def page(firmware: BusFirmware, files: Mapping[str, str]) -> str:
    """Return the table of a bundle as Markdown; ``files`` is its C, whose lines are shown."""
    asked = f"{requirements()} of {sorted(files.items())}"
    return firmware.kept(asked, lambda: {"text": _made(firmware, files)})["text"]


def _made(firmware: BusFirmware, files: Mapping[str, str]) -> str:
    traced = rows(firmware.program(), files)
    return "\n".join([*_lines(traced, specialised=bool(firmware.calibration)), ""])


def _lines(found: Mapping[str, list[Row]], *, specialised: bool) -> Iterator[str]:
    total = sum(row.obligations for functions in found.values() for row in functions)
    yield "# From requirement to test"
    yield ""
    yield (
        "Made with this bundle. Source lines are those of canroll's `firmware/`, tests those of "
        f"its `tests/`{'' if specialised else RUN}. Obligations are the places in "
        "a function at which the proof showed that nothing overflows, leaves its field or its "
        f"array, or is divided by zero: {total} in all, each for every state, frame and accepted "
        "calibration."
    )
    if specialised:
        yield from ("", SPECIALISED)
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
