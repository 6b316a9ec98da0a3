"""The C of a bundle with comments for its reviewer: where each function is from, and formats."""

import ast
from dataclasses import dataclass, field

from canroll.codegen.c99.notes import Notes
from canroll.codegen.export import traceability
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.translation import translated
from canroll.codegen.subset.formats import Formats
from canroll.codegen.subset.program import Function, Program

OWN = "the engineer's own"


@dataclass
class ReviewNotes(Notes):
    """Source line and requirement of each function, formats of each statement where known."""

    program: Program
    formats: Formats = field(init=False)

    def __post_init__(self) -> None:
        self.formats = Formats(self.program)

    def of_function(self, function: Function) -> str:
        """Return its source line and its requirement, as TRACEABILITY.md has them."""
        _, source = traceability.source_of(self.program, function)
        return f"{source}, requirement: {traceability.requirement_of(function) or OWN}"

    def of_statement(self, function: Function, node: ast.stmt) -> str:
        """Return its formats."""
        return self.formats.note(function, node)


def files(firmware: BusFirmware) -> dict[str, str]:
    """Return ``canroll.firmware.files`` with comments."""

    def made() -> dict[str, str]:
        program = firmware.program()
        return translated(program, None, firmware.calibration, ReviewNotes(program))

    return firmware.kept(f"with comments: {traceability.requirements()}", made)
