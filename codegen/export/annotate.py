"""The C of a bundle with comments for its reviewer: where each function is from, and formats."""

import ast
from dataclasses import dataclass, field

from codegen.c99.emit import Emitter
from codegen.c99.notes import Notes
from codegen.export import traceability
from codegen.run.bus_firmware import BusFirmware
from codegen.subset.formats import Formats
from codegen.subset.program import Function, Program

OWN = "the engineer's own"


@dataclass
class ReviewNotes(Notes):
    """Source line and requirement of each function, formats of each statement where known.

    ``general``: the program that ``program`` was specialised from, or None.
    """

    program: Program
    general: Program | None = None
    formats: Formats = field(init=False)

    def __post_init__(self) -> None:
        self.formats = Formats(self.program)

    def of_function(self, function: Function) -> str:
        """Return its source line and its requirement, as TRACEABILITY.md has them."""
        origin = traceability.origin_of(function, self.general)
        home = self.program if origin is function or self.general is None else self.general
        _, source = traceability.source_of(home, origin)
        return f"{source}, requirement: {traceability.requirement_of(origin) or OWN}"

    def of_statement(self, function: Function, node: ast.stmt) -> str:
        """Return its formats."""
        return self.formats.note(function, node)


def files(firmware: BusFirmware, general: BusFirmware | None = None) -> dict[str, str]:
    """Return ``firmware.files`` with comments; ``general``: what it was specialised from."""

    def made() -> dict[str, str]:
        program = firmware.program()
        origin = None if general is None else general.program()
        return Emitter(program, ReviewNotes(program, origin)).files()

    return firmware.kept(f"with comments: {traceability.requirements()}", made)
