"""A network description from its files: DBC, KCD, ARXML or SYM; defects become warnings.

A DBC may be in UTF-8 or in Windows' western code page, which differ from line to line in files that
several programs wrote.
"""

import logging
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import cantools
from cantools.database import Database, Message

from canroll.errors import CanrollError, reason

if TYPE_CHECKING:
    from canroll.dbc.tolerant import Repaired

_NAMED = 8
"""Defects of a kind that a warning names."""


Files: TypeAlias = Path | tuple[Path, ...]
"""The file of a network description, or several that together are one."""


@dataclass(frozen=True, slots=True, eq=False)
class NetworkFile:
    """One file of a network description.

    Attributes:
        path: the file.
        database: its messages.
        warnings: what had to be left out or assumed; none or one line.
        repaired: a DBC's text without its unreadable parts; None where it is as in the file.
        left_out: the beginning of each statement that cannot be read, by line.
    """

    path: Path
    database: Database
    warnings: tuple[str, ...]
    repaired: str | None = None
    left_out: Mapping[int, str] = field(default_factory=dict)

    def unread(self, name: str) -> str:
        """Return the lines that cannot be read and have ``name`` in their beginning, or ""."""
        lines = [
            f"line {line} ({text})"
            for line, text in self.left_out.items()
            if name in re.findall(r"\w+", text)
        ]
        return ", ".join(lines[:_NAMED])


@dataclass(frozen=True, slots=True)
class NetworkDescription:
    """A network description.

    Attributes:
        database: the messages of all files, each with its attributes.
        files: what it was read from.
    """

    database: Database
    files: tuple[NetworkFile, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What had to be left out or assumed; none or one line for each file."""
        return tuple(line for file in self.files for line in file.warnings)

    def unread(self, name: str) -> str:
        """Return file and lines that cannot be read and have ``name`` in them, or ""."""
        for file in self.files:
            lines = file.unread(name)
            if lines:
                return f"{file.path}: {name} cannot be read: {lines}"
        return ""

    def described_in(self, name: str) -> tuple[Path, ...]:
        """Return the files that have a message ``name``."""
        return tuple(
            file.path
            for file in self.files
            if any(message.name == name for message in file.database.messages)
        )


def paths_of(given: str | Path | Sequence[str | Path]) -> Files:
    """Return a path, or the paths of a list; a list of one is that path."""
    if isinstance(given, str | Path):
        return Path(given)
    paths = tuple(map(Path, given))
    return paths[0] if len(paths) == 1 else paths


def each(files: Files) -> tuple[Path, ...]:
    """Return one or several files as a tuple."""
    return files if isinstance(files, tuple) else (files,)


def file_names(files: Files) -> str:
    """Return the names of files without their folders, for a sentence."""
    return " and ".join(path.name for path in each(files))


def network(files: Files) -> NetworkDescription:
    """Read a network description: the messages of all ``files`` together.

    Raises:
        CanrollError: one is none of the formats, not one of CAN, or there twice.
    """
    paths = each(files)
    for path in paths:
        if paths.count(path) > 1:
            raise CanrollError(f"{path}: given twice as a network description: omit one")
    sources = tuple(map(network_file, paths))
    return NetworkDescription(_joined(sources), sources)


@lru_cache(maxsize=8)
def _joined(files: tuple[NetworkFile, ...]) -> Database:
    if len(files) == 1:
        return files[0].database
    with _silent():
        return Database(
            [message for file in files for message in file.database.messages], strict=False
        )


def network_file(path: Path) -> NetworkFile:
    """Read one file of a network description.

    A DBC that breaks the rules of its format is read without those parts.

    Raises:
        CanrollError: it is none of these files, or not one of CAN.
    """
    try:
        if path.suffix.lower() == ".dbc":
            return _of_dbc(path, path.read_bytes())
        return _of_others(path)
    except Exception as error:  # cantools passes on any error of its parsers
        raise CanrollError(
            f"{path}: not a readable DBC, KCD, ARXML or SYM: {reason(error)}"
        ) from error


def decoded(data: bytes) -> str:
    """Return the text of a DBC, line by line in UTF-8 where that can be, else in cp1252."""
    return "".join(map(_line, data.removeprefix(b"\xef\xbb\xbf").splitlines(keepends=True)))


def _line(data: bytes) -> str:
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


@lru_cache(maxsize=8)
def _of_dbc(path: Path, data: bytes) -> NetworkFile:
    text = decoded(data)
    with _silent():
        try:
            database = cantools.database.load_string(text, "dbc")
            return NetworkFile(path, database, _warnings(path, _shared(database)))
        except Exception as error:  # cantools passes on any error of its parsers
            strict = error
        try:
            database = cantools.database.load_string(text, "dbc", strict=False)
            notes = (*_broken(database), *_shared(database))
            return NetworkFile(path, database, _warnings(path, notes))
        except Exception:  # the first defect has been kept
            # for a file that cannot be read as it is
            from canroll.dbc.tolerant import repaired  # noqa: PLC0415

            repair = repaired(text)
        if "BO_" not in repair.text:
            raise strict
        database = cantools.database.load_string(repair.text, "dbc", strict=False)
        notes = (*_repairs(repair), *_broken(database), *_shared(database))
        return NetworkFile(path, database, _warnings(path, notes), repair.text, repair.left_out)


def _of_others(path: Path) -> NetworkFile:
    with _silent():
        try:
            database = cantools.database.load_file(path)
            defects: Iterable[str] = ()
        except cantools.Error:
            database = cantools.database.load_file(path, strict=False)
            defects = _broken(database)
    if not isinstance(database, Database):
        raise CanrollError("not a CAN database; give a .dbc file")
    return NetworkFile(path, database, _warnings(path, (*defects, *_shared(database))))


@contextmanager
def _silent() -> Iterator[None]:
    """Keep what cantools logs from stderr: the warnings say it."""
    logger = logging.getLogger("cantools")
    disabled = logger.disabled, logger.propagate
    handler = logging.NullHandler()
    logger.addHandler(handler)
    logger.propagate = False
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.disabled, logger.propagate = disabled


def _warnings(path: Path, defects: Iterable[str]) -> tuple[str, ...]:
    text = "; ".join(defects)
    return (f"{path}: read leniently: {text}",) if text else ()


def _repairs(repair: "Repaired") -> Iterator[str]:
    if repair.left_out:
        lines = [f"line {line} ({text})" for line, text in repair.left_out.items()]
        yield f"left out {_listed(lines)}"
    if repair.renamed:
        yield f"named {_listed([f'{new} what is {old}' for old, new in repair.renamed.items()])}"
    if repair.extended:
        idents = [f"0x{ident:X} ({name})" for name, ident in repair.extended.items()]
        yield f"taken as extended {_listed(idents)}"


def _broken(database: Database) -> Iterator[str]:
    """The rules that messages break: one for each."""
    defects = []
    for message in database.messages:
        try:
            message.refresh(strict=True)
        except cantools.Error as error:
            defects.append(reason(error).removesuffix("."))
            message.refresh(strict=False)
    if defects:
        yield _listed(defects)


def _shared(database: Database) -> Iterator[str]:
    """Identifiers and names that several messages have."""
    idents: defaultdict[tuple[object, ...], list[str]] = defaultdict(list)
    names: defaultdict[str, int] = defaultdict(int)
    for message in database.messages:
        idents[message.bus_name, message.frame_id, message.is_extended_frame].append(message.name)
        names[message.name] += 1
    several = [
        f"{' and '.join(who)} have the identifier 0x{key[1]:X}"
        for key, who in idents.items()
        if len(who) > 1
    ]
    several += [f"{count} messages are named {name}" for name, count in names.items() if count > 1]
    if several:
        yield _listed(several)


def _listed(texts: list[str]) -> str:
    more = len(texts) - _NAMED
    return ", ".join(texts[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def same_identifier(database: Database, message: Message) -> tuple[str, ...]:
    """Return the names of other messages of a bus that have a message's identifier."""
    return tuple(
        other.name
        for other in database.messages
        if other is not message
        and other.bus_name == message.bus_name
        and other.frame_id == message.frame_id
        and other.is_extended_frame == message.is_extended_frame
    )
