"""A DBC that breaks the rules of its format, without the statements that break them.

:func:`repaired` asks cantools about one statement after the other, each with what it refers to, and
leaves out the smallest that it refuses: a signal, a comment, a value table, an attribute.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field

from cantools.database.can import Database
from textparser import Error as SyntaxRefusal

from canroll.dbc.statements import (
    EXTENDED_BIT,
    block_end,
    ends,
    first_string,
    following,
    identifier,
    keyword,
    plain,
    shown,
)
from canroll.errors import CanrollError

_DEFINITIONS = ("BA_DEF_", "BA_DEF_REL_")
_ATTRIBUTES = ("BA_", "BA_REL_", "BA_DEF_DEF_", "BA_DEF_DEF_REL_")
_EMPTY = ("NS_", "BS_", "VERSION")
"""Statements that say nothing of frames."""
_DECISIVE = ("SIG_VALTYPE_", "SG_MUL_VAL_")
"""Statements without which a signal is read wrongly."""
_CODED = re.compile(rf"\s*(?:{'|'.join(_DECISIVE)})\s+(\d+)\s+(\w+)")
_SIGNAL = re.compile(r"\s*SG_\s+(\w+)")
_SELECTOR = re.compile(r"\s*SG_\s+\w+\s+m?\d*M\s*:")
_MOST = 1000
"""Statements that are left out at most: what has more is no DBC."""


@dataclass(slots=True)
class Repaired:
    """A DBC without its unreadable parts; every line is where it was.

    Attributes:
        text: what is left of it.
        left_out: the beginning of each statement that is left out, by line.
        renamed: new names of what had a name that begins with a digit.
        extended: identifiers taken as those of extended frames, by the messages' names.
    """

    text: str = ""
    left_out: dict[int, str] = field(default_factory=dict)
    renamed: dict[str, str] = field(default_factory=dict)
    extended: dict[str, int] = field(default_factory=dict)


def repaired(text: str) -> Repaired:
    """Return what cantools reads of a DBC, and what it had to be spared."""
    return _Repair(text.splitlines()).run()


@dataclass(slots=True)
class _Repair:
    lines: list[str]
    accepted: dict[int, str] = field(default_factory=dict)
    blocks: dict[int | None, list[int]] = field(default_factory=dict)
    definitions: dict[str, str] = field(default_factory=dict)
    unclear: list[tuple[int, str]] = field(default_factory=list)
    result: Repaired = field(default_factory=Repaired)

    def run(self) -> Repaired:
        self._segment()
        others = [line for line, text in self.accepted.items() if keyword(text) != "BO_"]
        # a signal that is left out takes what refers to it along
        for first in sorted(others, key=lambda line: keyword(self.accepted[line]) not in _DECISIVE):
            self._leave_out_unclear()
            self._check_reference(first)
        self._leave_out_unclear()
        lines = [""] * len(self.lines)
        for first, text in self.accepted.items():
            part = text.split("\n")
            lines[first : first + len(part)] = part
        self.result.text = "\n".join(lines) + "\n"
        self.result.left_out = dict(sorted(self.result.left_out.items()))
        return self.result

    def _segment(self) -> None:
        """Accept the statements that can be read by themselves, and the signals of messages."""
        i, message = 0, None
        while i < len(self.lines):
            word = keyword(self.lines[i])
            if word == "SG_" and message is not None:
                i = self._signal(message, i)
                continue
            if word:
                message = None
            end = self._statement(i)
            if word == "BO_":
                if i in self.accepted:
                    message = i
                else:
                    end = block_end(self.lines, i)
            i = end

    def _statement(self, first: int) -> int:
        """Accept the statement of a line, or leave it out; return the line after it."""
        for end in ends(self.lines, first):
            text, names = plain("\n".join(self.lines[first:end]))
            if not text.strip():
                return end
            if keyword(text) in _EMPTY:
                return following(self.lines, first)
            if _refusal(text, syntax=keyword(text) != "BO_") is None:
                self._accept(first, text, names)
                return end
        self._leave_out(first)
        return following(self.lines, first)

    def _accept(self, first: int, text: str, names: list[str]) -> None:
        self.accepted[first] = text
        self.result.renamed |= {name: f"_{name}" for name in names}
        ident = identifier(text)
        if keyword(text) in _DEFINITIONS:
            self.definitions[first_string(text)] = text
        elif keyword(text) == "BO_" and ident is not None:
            self.blocks.setdefault(ident, []).append(first)
            if ident != identifier("\n".join(self.lines[first : first + 1])):
                self.result.extended[text.split()[2].rstrip(":")] = ident & ~EXTENDED_BIT

    def _signal(self, message: int, first: int) -> int:
        """Add the signal of a line to its message, or leave it out; return the line after it."""
        for end in ends(self.lines, first):
            text, names = plain("\n".join(self.lines[first:end]))
            before = self.accepted[message]
            if _refusal(f"{_extract(before, _SELECTOR.match)}\n{text}") is None:
                gap = "\n" * (first - message - before.count("\n"))
                self.accepted[message] = f"{before}{gap}{text}"
                self.result.renamed |= {name: f"_{name}" for name in names}
                return end
        self._leave_out(first)
        return following(self.lines, first)

    def _check_reference(self, first: int) -> None:
        """Leave out a statement that does not fit what it refers to."""
        text = self.accepted[first]
        context = self.definitions.get(first_string(text), "") if _attribute(text) else ""
        named = set(re.findall(r"\w+", text))
        for block in self.blocks.get(identifier(text), ()):
            message = _extract(self.accepted[block], lambda line: _signal_name(line) in named)
            context = f"{context}\n{message}"
        if _refusal(f"{context}\n{text}") is not None:
            del self.accepted[first]
            self._leave_out(first)

    def _leave_out_unclear(self) -> None:
        """Leave out the signals of which nothing readable says how they are coded."""
        while self.unclear:
            ident, name = self.unclear.pop()
            for block in self.blocks.get(ident, ()):
                lines = self.accepted[block].split("\n")
                for i, line in enumerate(lines):
                    if _signal_name(line) == name:
                        self._leave_out(block + i)
                        lines[i] = ""
                self.accepted[block] = "\n".join(lines)

    def _leave_out(self, first: int) -> None:
        self.result.left_out[first + 1] = shown(self.lines[first])
        coded = _CODED.match(plain(self.lines[first])[0])
        if coded:
            self.unclear.append((int(coded[1]), coded[2]))
        if len(self.result.left_out) > _MOST:
            raise CanrollError(f"more than {_MOST} of its statements cannot be read")


def _extract(block: str, chosen: Callable[[str], object]) -> str:
    """A message with some of its signals only."""
    head, *rest = block.split("\n")
    return "\n".join([head, *filter(chosen, rest)])


def _signal_name(line: str) -> str:
    signal = _SIGNAL.match(line)
    return signal[1] if signal else ""


def _attribute(text: str) -> bool:
    return keyword(text) in _ATTRIBUTES


def _refusal(text: str, *, syntax: bool = False) -> Exception | None:
    """Return why cantools refuses a part of a DBC; with ``syntax``, only where it cannot parse."""
    try:
        # with a statement behind it, as cantools takes one that ends in the middle of a file
        Database(strict=False).add_dbc_string(f"{text}\nBS_:\n")
    except SyntaxRefusal as error:
        return error
    except Exception as error:  # cantools passes on any error of its parsers
        return None if syntax else error
    return None
