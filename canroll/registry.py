"""Registries of named objects: built in, from an installed package, or in a user's file."""

import re
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from contextvars import ContextVar
from functools import cached_property
from hashlib import sha256
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, Generic, NamedTuple, TypeVar, cast

from canroll import extension
from canroll.errors import CanrollError, UnknownNameError

Thing = TypeVar("Thing")
BUILT_IN = "built in"
TRUST: ContextVar[bool] = ContextVar("trust", default=False)
"""Whether code that a file names may be executed: ``--trust``."""
_RATES = re.compile(r"@[\d/]+$")


class Origin(NamedTuple):
    """Origin of an object: ``who`` provides it, and ``where`` its code is, as "module:name"."""

    who: str
    where: str

    @property
    def is_built_in(self) -> bool:
        """Whether the object is built in."""
        return self.who == BUILT_IN


class Registry(MutableMapping[str, Thing], Generic[Thing]):
    """Objects by name, each imported on first access; listing the names imports nothing.

    A name may also be a reference, "file.py:name" or "module:name", or a data file's path.

    Args:
        what: kind of object for error messages, such as "law".
        group: entry-point group under which packages provide objects of this kind.
        built_in: "module:name" of each built-in object.
        accept: "module:function" that checks an object that is not built in: called with its
            description, for errors, and the object; returns the object to use.
        files: "module:function" by file suffix, called with the name as given, which may carry
            a fragment after "#", and bit rates after "@"; packages add to them under
            ``group`` and ".files".
    """

    def __init__(
        self,
        what: str,
        group: str,
        built_in: Mapping[str, str],
        accept: str = "",
        files: Mapping[str, str] | None = None,
    ) -> None:
        self.what, self.group = what, group
        self._built_in = dict(built_in)
        self._accept = accept
        self._own_files = dict(files or {})
        self._loaded: dict[str, Thing] = {}
        self._registered: set[str] = set()

    @cached_property
    def _offered(self) -> Mapping[str, EntryPoint]:
        points = _installed(self.group)
        return {name: point for name, point in points.items() if name not in self._built_in}

    @cached_property
    def _files(self) -> Mapping[str, str]:
        """Readers of data files: "module:function" by suffix."""
        added = _installed(f"{self.group}.files")
        return {**{suffix: point.value for suffix, point in added.items()}, **self._own_files}

    def __getitem__(self, name: str) -> Thing:
        """Return the object of that name.

        Raises:
            UnknownNameError: there is none; the message suggests the nearest name.
            CanrollError: the extension cannot be used; the message names the fault and file.
        """
        if name not in self._loaded:
            if name not in self:
                raise UnknownNameError(self.what, name, list(self))
            self._loaded[name] = self._load(name)
        return self._loaded[name]

    def _load(self, name: str) -> Thing:
        if name in self._built_in:
            return cast(Thing, resolve_name(self._built_in[name]))
        if self._reader(name):
            read: Callable[[str], Thing] = resolve_name(self._reader(name))
            return read(name)
        what = f"{self.what} '{name}'"
        if name in self._offered:
            what += f" of {self.origin(name).who}"
            with extension.refusing(what):
                thing = self._offered[name].load()
        else:
            thing = extension.load(self.what, name)
        if not self._accept:
            return cast(Thing, thing)
        accept: Callable[[str, Any], Thing] = resolve_name(self._accept)
        return accept(what, thing)

    def refuse_code(self, name: object, where: str) -> None:
        """Refuse a name that stands in a file if it is code: what is opened executes nothing.

        Names built in, of packages and data files are none, nor is what is loaded already.

        Raises:
            CanrollError: it is, and files are not trusted; the message begins with ``where``.
        """
        if TRUST.get() or not isinstance(name, str) or self._reader(name):
            return
        known = name in self._built_in or name in self._loaded or name in self._offered
        if not known and extension.is_reference(name):
            raise CanrollError(
                f"{where}: {self.what} '{name}' is code, which a file may not name: "
                "add --trust to execute it"
            )

    def _reader(self, name: object) -> str:
        """Return "module:function" of the reader of a data file, or "" if ``name`` is not one."""
        path = _RATES.sub("", name.partition("#")[0]) if isinstance(name, str) else ""
        return self._files.get(Path(path).suffix.lower(), "")

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Suffixes of the data files that are read."""
        return tuple(self._files)

    def origin(self, name: str) -> Origin:
        """Return the origin of the object of that name without importing it."""
        if name in self._registered:
            return Origin("this program", "")
        if name in self._built_in:
            return Origin(BUILT_IN, self._built_in[name])
        if name in self._offered:
            point = self._offered[name]
            return Origin(_package(point), point.value)
        if self._reader(name):
            return Origin(f"file {name}", "")
        if extension.is_reference(name):
            file = Path(name.rpartition(":")[0])
            known = file.suffix == ".py" and file.is_file()
            digest = f", SHA-256 {sha256(file.read_bytes()).hexdigest()}" if known else ""
            return Origin(f"{'file' if known else 'module'} {file}{digest}", name)
        return Origin("this program", "")

    def description(self, name: str) -> str:
        """Return a one-line description of that name, read from its source without importing it."""
        module, _, attribute = self.origin(name).where.partition(":")
        if module:
            return extension.described(module, attribute)
        return extension.documented(self._loaded[name])

    def __setitem__(self, name: str, thing: Thing) -> None:
        """Register an object for this process."""
        self._loaded[name] = thing
        self._registered.add(name)

    def __delitem__(self, name: str) -> None:
        """Remove a registered object; built-in ones remain."""
        del self._loaded[name]
        self._registered.discard(name)

    def __contains__(self, name: object) -> bool:
        """Whether that name is registered, or is a reference; nothing is imported."""
        return (
            name in self._built_in
            or name in self._loaded
            or name in self._offered
            or bool(self._reader(name))
            or extension.is_reference(name)
        )

    def __iter__(self) -> Iterator[str]:
        """Iterate over names: built in, from packages, then registered; no references or files."""
        named = dict.fromkeys([*self._built_in, *self._offered, *self._loaded])
        return (n for n in named if not extension.is_reference(n) and not self._reader(n))

    def __len__(self) -> int:
        return len(list(iter(self)))


def _installed(group: str) -> Mapping[str, EntryPoint]:
    """Return the entry points of a group by name; of canroll's extensions those that are there.

    Raises:
        CanrollError: two packages offer one name, which none of canroll's own has.
    """
    found: dict[str, EntryPoint] = {}
    for point in entry_points(group=group):
        other = found.get(point.name)
        if _is_own(point):
            if extension.is_installed(point.module):
                found[point.name] = point
        elif other is None:
            found[point.name] = point
        elif not _is_own(other):
            raise CanrollError(
                f"{group} '{point.name}' is offered by {_package(other)} and {_package(point)}: "
                "remove one"
            )
    return found


def _is_own(point: EntryPoint) -> bool:
    return point.dist is not None and point.dist.name == "canroll"


def _package(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist else "a package"
