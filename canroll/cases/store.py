"""Rows of cases on disk, each whole or absent, so that what was driven is not driven again."""

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from secrets import token_hex
from types import NoneType
from typing import Any, ClassVar, Generic, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from canroll import documents
from canroll.errors import UNREADABLE, CanrollError, reason

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Store(ABC, Generic[T]):
    """A folder of rows of one study; several processes may add to it at once.

    Attributes:
        folder: the folder.
        digest: fingerprint of the study.
    """

    folder: Path
    digest: str
    suffix: ClassVar[str]

    def path(self, name: str) -> Path:
        """Return the path of a row."""
        return self.folder / f"{name}{self.suffix}"

    def has(self, name: str) -> bool:
        """Whether the row is there."""
        return self.path(name).is_file()

    @abstractmethod
    def read(self, name: str) -> T:
        """Return a row.

        Raises:
            CanrollError: it is damaged, or of another study.
        """

    @abstractmethod
    def write(self, name: str, row: T) -> None:
        """Write a row, whole or not at all."""


@dataclass(frozen=True, slots=True)
class JsonRows(Store[T]):
    """Rows as JSON.

    Attributes:
        kind: type of a row: plain values, arrays, and tuples and dataclasses of these.
    """

    kind: Any
    suffix = ".json"

    def read(self, name: str) -> T:
        """Return a row."""
        path = self.path(name)
        try:
            row: T = restored(self.kind, documents.parse_json(documents.text(path)))
        except UNREADABLE as error:
            raise CanrollError(
                f"{path}: not a row of a study ({reason(error)}): delete it and continue with "
                "--resume"
            ) from error
        return row

    def write(self, name: str, row: T) -> None:
        """Write a row, whole or not at all."""
        plain = asdict(row) if is_dataclass(row) and not isinstance(row, type) else row
        with placed(self.path(name)) as part:
            part.write_text(json.dumps(plain, default=_listed), encoding="utf-8")


def _listed(value: object) -> object:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"a row has a {type(value).__name__}")


def restored(kind: Any, value: Any) -> Any:  # noqa: ANN401
    """Return a value of the type ``kind`` from its plain data."""
    inner = get_args(kind)
    if NoneType in inner:
        (kind,) = (part for part in inner if part is not NoneType)
        return None if value is None else restored(kind, value)
    if get_origin(kind) is np.ndarray:
        return np.array(value, float)
    if get_origin(kind) is tuple:
        kinds = inner[:1] * len(value) if inner[-1] is Ellipsis else inner
        return tuple(map(restored, kinds, value))
    if isinstance(kind, type) and is_dataclass(kind):
        hints = get_type_hints(kind)
        return kind(**{name: restored(hints[name], value[name]) for name in hints})
    return value


@contextmanager
def placed(path: Path) -> Iterator[Path]:
    """Yield a file next to ``path`` that is moved there when the body has succeeded."""
    # machines that share a folder may have processes of the same number
    part = path.with_name(f".{path.name}.{token_hex(8)}.part")
    try:
        yield part
        with part.open("rb+") as file:
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
