"""Registries of named objects: built in, added at run time, or from an installed package."""

from collections.abc import Iterator, Mapping, MutableMapping
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from pkgutil import resolve_name
from typing import Any, TypeVar, cast

from canroll.errors import UnknownNameError

Thing = TypeVar("Thing")


class Registry(MutableMapping[str, Thing]):
    """Things by name, each loaded when it is first asked for: names alone cost nothing.

    Args:
        what: what a thing is called in errors, such as "law".
        group: entry points by which other packages offer things of this kind.
        built_in: "module:name" of each thing.
    """

    def __init__(self, what: str, group: str, built_in: Mapping[str, str]) -> None:
        self.what, self.group = what, group
        self._built_in = dict(built_in)
        self._loaded: dict[str, Thing] = {}

    @cached_property
    def _offered(self) -> Mapping[str, EntryPoint]:
        offered = {point.name: point for point in entry_points(group=self.group)}
        return {name: point for name, point in offered.items() if name not in self._built_in}

    def __getitem__(self, name: str) -> Thing:
        """Return the thing of that name; :class:`UnknownNameError` suggests the nearest."""
        if name not in self._loaded:
            if name not in self:
                raise UnknownNameError(self.what, name, list(self))
            here = self._built_in.get(name)
            loaded: Any = resolve_name(here) if here else self._offered[name].load()
            self._loaded[name] = cast(Thing, loaded)
        return self._loaded[name]

    def __setitem__(self, name: str, thing: Thing) -> None:
        """Add a thing for this process."""
        self._loaded[name] = thing

    def __delitem__(self, name: str) -> None:
        """Take an added thing out again; what is built in stays."""
        del self._loaded[name]

    def __contains__(self, name: object) -> bool:
        """Whether there is a thing of that name; it is not loaded for that."""
        return name in self._built_in or name in self._loaded or name in self._offered

    def __iter__(self) -> Iterator[str]:
        """Names: built in, then offered, then added."""
        return iter(dict.fromkeys([*self._built_in, *self._offered, *self._loaded]))

    def __len__(self) -> int:
        return len(list(iter(self)))
