"""One choice of a run: its option, type, default, limits and names."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from canroll.arguments import require
from canroll.errors import CanrollError, UnknownNameError
from canroll.registry import Registry

ON, OFF = ("on", "true", "1"), ("off", "false", "0")


@runtime_checkable
class StateSpace(Protocol):
    """A linear system with matrices ``A`` to ``D``, such as python-control's ``ss`` makes.

    Its ``dt``, if it has one, is its sample time in s: 0 is continuous, None and True say nothing.
    """

    A: Any
    B: Any
    C: Any
    D: Any


@dataclass(frozen=True, slots=True)
class Choice:
    """One choice of a run.

    Attributes:
        option: option on the command line.
        help: help text; names, unit and default are added when shown.
        of: "world", "controller" or "run": what it belongs to.
        default: default value; None if it depends on other choices.
        values: the allowed names, read when needed; none: any text.
        extensible: registry of the names, where "file.py:name" or "module:name" is one as well.
        unit: unit of a number.
        low: least number.
        high: largest number.
        frozen_in_calibration: whether a calibration file fixes it.
        saved: whether results contain it; otherwise it is in their calibration.
        repeated: whether it may be given several times: see :func:`one_or_several`.
        rare: whether only ``--help-all`` shows it.
        excludes: other options, such as "law=passive", with which it has no effect, and why.
        name: keyword of :func:`canroll.run`, and key in JSON.
        kind: str, Path, float, int, bool, Mapping or Sequence.
        hint: annotation of the keyword: the types of its values.
    """

    option: str
    help: str
    of: str
    default: Any = None
    values: Callable[[], Iterable[str]] = tuple
    extensible: Registry[Any] | None = None
    unit: str = ""
    low: float = -inf
    high: float = inf
    frozen_in_calibration: bool = False
    saved: bool = True
    repeated: bool = False
    rare: bool = False
    excludes: Mapping[str, str] = field(default_factory=dict)
    name: str = ""
    kind: type = str
    hint: Any = str

    @property
    def word(self) -> str:
        """Name in messages and in "key=value": the option without dashes."""
        return self.option.removeprefix("--").removeprefix("no-")

    def check(self, value: Any) -> None:  # noqa: ANN401
        """Reject an invalid name or number.

        Raises:
            UnknownNameError: no such name; the nearest is suggested.
            CanrollError: a number out of range.
        """
        self._check_kind(value)
        known = tuple(self.values())
        refers = self.extensible is not None and value in self.extensible
        if known and value not in known and not refers:
            if isinstance(value, str) and Path(value).suffix and Path(value).is_file():
                suffixes = ", ".join(getattr(self.values(), "suffixes", ()))
                if suffixes:
                    raise CanrollError(f"{value}: the file of a {self.word} ends in {suffixes}")
            raise UnknownNameError(self.word, value, known)
        unit = f" {self.unit}" if self.unit else ""
        if self.kind is float and not isfinite(value):
            raise CanrollError(f"{self.word} {value:g}{unit}: must be finite")
        if self.kind in (float, int) and not self.low <= value <= self.high:
            allowed = f"{self.low:.10g} to {self.high:.10g}"
            if self.high == inf:
                allowed = f"{self.low:g} or more" if self.low >= 1 or not self.low else "above 0"
            raise CanrollError(f"{self.word} {value:g}{unit}: must be {allowed}{unit}")

    def _check_kind(self, value: Any) -> None:  # noqa: ANN401
        """Reject a value of another type."""
        if not self.values():
            require(self.name, value, self.hint)
        elif not isinstance(value, str | Path):
            raise CanrollError(f"{self.name}={value!r}: must be a name")

    def check_in_file(self, value: Any, where: str) -> None:  # noqa: ANN401
        """Reject an invalid value that stands in a file, and a name that is code.

        Raises:
            CanrollError: the message begins with ``where``.
        """
        try:
            self.check(value)
        except CanrollError as error:
            raise CanrollError(f"{where}: {error}") from error
        if self.extensible is not None:
            self.extensible.refuse_code(value, where)

    def read(self, text: str) -> Any:  # noqa: ANN401
        """Return the value given by ``text``.

        Raises:
            UnknownNameError: no such name.
            CanrollError: not a number, out of range, or neither on nor off.
        """
        if self.kind is bool:
            if text.lower() not in (*ON, *OFF):
                raise CanrollError(f"{self.word} must be on or off, got {text!r}")
            return text.lower() in ON
        if not text:
            raise CanrollError(f"{self.option} must not be empty")
        try:
            value = self.kind(text)
        except ValueError as error:
            raise CanrollError(f"{self.word}={text}: {text!r} is not a number") from error
        self.check(value)
        return value


def one_or_several(given: str | Path | Sequence[str | Path] | None) -> str | tuple[str, ...] | None:
    """Return one value as a text, several as a tuple; a list of one is that one."""
    if given is None or isinstance(given, str | Path):
        return None if given is None else str(given)
    texts = tuple(map(str, given))
    return texts[0] if len(texts) == 1 else texts


def as_text(given: Path | str | None) -> str | None:
    """Return a path as text."""
    return None if given is None else str(given)


def several(given: str | Sequence[str]) -> tuple[str, ...]:
    """Return what may be one value or several as a tuple."""
    return (given,) if isinstance(given, str) else tuple(given)
