"""Lines of a log in text, and what python-can's readers make of each of them."""

import codecs
import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Final, NamedTuple

import can

from canroll.errors import CanrollError

_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_SHOWN: Final = 40


class Line(NamedTuple):
    """A line of a file without its end, and its number from 1."""

    number: int
    text: str


class Numbered(NamedTuple):
    """A message, and the number of its line in a text or of its frame in a binary log."""

    number: int
    message: can.Message


class LineError(CanrollError):
    """A line that cannot be read."""

    def __init__(self, line: Line, problem: str) -> None:
        text = "".join(c if c.isprintable() else "?" for c in line.text.strip())
        text = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"
        super().__init__(f"line {line.number}: {problem}: '{text}'")
        self.number = line.number


def lines_of(content: bytes) -> tuple[list[Line], bool]:
    """Return the lines of a text in UTF-8 or UTF-16, and whether the last one has an end.

    Bytes that are no text occur in comments, and are replaced.
    """
    encoding = next((name for mark, name in _MARKS if content.startswith(mark)), "utf-8")
    *texts, rest = content.decode(encoding, "replace").split("\n")
    lines = [Line(number, text.rstrip("\r")) for number, text in enumerate(texts, 1)]
    return (lines, True) if not rest else ([*lines, Line(len(lines) + 1, rest)], False)


class _Feed:
    """A text file for a reader of python-can that keeps the line it gave last."""

    def __init__(self, lines: Iterable[tuple[Line, str]]) -> None:
        self._lines = iter(lines)
        self.line = Line(0, "")

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        self.line, text = next(self._lines)
        return text

    def close(self) -> None:
        pass


def parsed(
    reader: type[can.io.generic.MessageReader], lines: Iterable[tuple[Line, str]], what: str
) -> Iterator[Numbered]:
    """Yield the messages that a reader of python-can makes of lines, each with its line's number.

    Args:
        reader: class of the reader; it makes at most one message of a line.
        lines: each with the text that the reader gets for it.
        what: a line as it should be, for errors.

    Raises:
        LineError: the reader fails at a line, or warns of it.
    """
    feed = _Feed(lines)
    with reader_warnings() as warned:
        messages = iter(reader(feed))  # type: ignore[arg-type]
        while True:
            try:
                message = next(messages, None)
            except Exception as error:  # whatever its parser raises
                raise LineError(feed.line, f"not {what}") from error
            if warned:
                raise LineError(feed.line, f"not {what}")
            if message is None:
                return
            yield Numbered(feed.line.number, message)


@contextmanager
def reader_warnings() -> Iterator[list[str]]:
    """Collect the warnings of python-can's readers, which else go to stderr."""
    warned: list[str] = []
    log, listener = logging.getLogger("can.io"), logging.Handler(logging.WARNING)
    listener.emit = lambda record: warned.append(record.getMessage())  # type: ignore[method-assign]
    passed_on, log.propagate = log.propagate, False
    level = log.level
    log.setLevel(logging.WARNING)
    log.addHandler(listener)
    try:
        yield warned
    finally:
        log.removeHandler(listener)
        log.setLevel(level)
        log.propagate = passed_on
