"""A service: a part of the firmware beside its loop, which an extension or a package adds."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from canroll.errors import CanrollError
from canroll.registry import Registry

if TYPE_CHECKING:
    from canroll.codegen.generated.bus_map import BusMap


@dataclass(frozen=True, slots=True, kw_only=True)
class Service:
    """One service; what is "module:function" is imported when it is called.

    Attributes:
        modules: package of its modules in the integer subset, with their requirements.toml; the
            one that is named as the service has the entry points.
        records: what an integrator owns for it, "module.Class" by its name in C.
        stores: fields of the loop's state in which it stores, beside its own records.
        needs: services with all of which it is there too, without an option of its own.
        hears: identifier of the frames for it on a bus; None: none.
        start: called with a running ECU, returns a :class:`canroll.codegen.run.services.Served`;
            "": it is exported only.
        session: called with contents and code of a bundle, returns its test in C; "": none.
        note: likewise, its section of the README.
        tested: row of the README's table of tests.
        described: called with the period of the tick in µs, returns the slave in the A2L; "": none.
        lasting: the one of its records that outlives a loss of power.
    """

    modules: str
    records: Mapping[str, str] = field(default_factory=dict)
    stores: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    hears: "Callable[[BusMap], int | None]" = lambda _: None
    start: str = ""
    session: str = ""
    note: str = ""
    tested: str = ""
    described: str = ""
    lasting: str = ""

    def sources(self) -> Mapping[str, tuple[Path, str]]:
        """Return place and text of its modules by file name, as modules of the firmware."""
        # here, as a command that translates nothing imports no translator
        from canroll.codegen.subset.program import PACKAGE  # noqa: PLC0415

        place, imported = (
            Path(*self.modules.split(".")),
            rf"^from {re.escape(self.modules)}(?=[. ])",
        )
        paths = sorted(files(self.modules).iterdir(), key=lambda path: path.name)
        return {
            path.name: (
                place / path.name,
                re.sub(imported, f"from {PACKAGE}", path.read_text("utf-8"), flags=re.MULTILINE),
            )
            for path in paths
            if path.name.endswith(".py") and path.name != "__init__.py"
        }


def accept(what: str, thing: object) -> Service:
    """Return a service that a package offers.

    Raises:
        CanrollError: it is none.
    """
    if not isinstance(thing, Service):
        raise CanrollError(f"{what}: a {type(thing).__name__}, it must be a Service")
    return thing


SERVICES: "Registry[Service]" = Registry(
    "service", "canroll.services", {}, accept=f"{__name__}:accept"
)
"""Every service by its name."""


def with_implied(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return services with those that are there because of them."""
    kinds = ((name, SERVICES[name]) for name in SERVICES if name not in names)
    return (*names, *(name for name, kind in kinds if kind.needs and {*kind.needs} <= {*names}))
