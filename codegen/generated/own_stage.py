"""An engineer's own stage: a file in the subset that replaces modules of the firmware.

The file replaces ``firmware/stage.py`` and defines some of its functions; of it
:mod:`canroll.codegen.run.stage_modules` makes the modules. Its state is the fields of one record
derived from ``Ecu``; they follow those of the firmware in memory, so that all others keep their
place. Line numbers are preserved, so that messages name those of the file.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from canroll import documents
from canroll.errors import CanrollError, reason

NAME = "stage"
MOST_CHARACTERS = 100_000


@dataclass(frozen=True, slots=True)
class OwnStage:
    """A stage: name and text of its file, and its folder for messages."""

    file: str
    source: str
    folder: Path = field(default=Path(), compare=False)

    @property
    def name(self) -> str:
        """Name of the file without its suffix."""
        return Path(self.file).stem

    @property
    def path(self) -> Path:
        """Path of the file for messages."""
        return self.folder / self.file

    def table(self) -> dict[str, str]:
        """Return the table of a calibration file that contains the stage."""
        return {"file": self.file, "source": self.source}


def read(path: Path) -> OwnStage:
    """Read a stage.

    Raises:
        CanrollError: it cannot be read.
    """
    try:
        source = documents.text(path)
    except (OSError, ValueError) as error:
        raise CanrollError(f"cannot read stage {path}: {reason(error)}") from error
    if len(source) > MOST_CHARACTERS:
        raise CanrollError(f"{path}: more than {MOST_CHARACTERS} characters: not a stage")
    return OwnStage(path.name, source, path.parent)


def carried(tables: Mapping[str, Any]) -> OwnStage | None:
    """Return the stage in the tables of a calibration, or None."""
    table = tables.get(NAME)
    return None if table is None else OwnStage(table["file"], table["source"])


def added(tables: Mapping[str, Any], stage: OwnStage | None) -> Mapping[str, Any]:
    """Return the tables of a calibration with the stage added."""
    return tables if stage is None else {**tables, NAME: stage.table()}
