"""Statements of a DBC file: where each begins and ends, what it refers to, what is plain in it.

A statement begins with a keyword at the start of a line. Lists of keywords, as NS_ has them, have
nothing behind the keyword.
"""

import re
from collections.abc import Sequence

EXTENDED_BIT = 1 << 31
"""Marks an identifier of 29 bits in a DBC."""
STANDARD = (1 << 11) - 1
"""Largest identifier of 11 bits."""
_LONGEST = 200
"""Lines of a statement at most."""
_WIDTH = 48

_KEYWORDS = (
    "VERSION|NS_|BS_|BU_|BO_|SG_|EV_|CM_|VAL_|VAL_TABLE_|BA_|BA_DEF_|BA_DEF_DEF_|BA_REL_|"
    "BA_DEF_REL_|BA_DEF_DEF_REL_|SIG_VALTYPE_|SG_MUL_VAL_|BO_TX_BU_|SIG_GROUP_|ENVVAR_DATA_"
)
_START = re.compile(rf"\s*({_KEYWORDS})\b\s*\S")
_STRING = re.compile(r'"(?:\\"|[^"])*"')
_OUTSIDE = re.compile(
    r'(?P<string>"(?:\\"|[^"])*"|//[^\n]*)'
    r"|(?P<number>(?<![\w.])\d*\.?\d*[eE][+-]?\d+\b)"
    r"|(?P<fraction>(?<![\w.])\.(?=\d))"
    r"|(?P<name>(?<![\w.])\d+[A-Za-z_]\w*)"
)
_REFERENCE = re.compile(
    r"\b((?:BO_|SG_|VAL_|SIG_VALTYPE_|SG_MUL_VAL_|BO_TX_BU_|SIG_GROUP_|BU_BO_REL_\s+\w+)\s+)(\d+)\b"
)
_OUTSIDE_REFERENCE = re.compile(f"{_STRING.pattern}|{_REFERENCE.pattern}")
_VALTYPE = re.compile(r"(\s*SIG_VALTYPE_\s+\d+\s+\w+)\s+(?=\d+\s*;)")


def keyword(line: str) -> str:
    """Return the keyword that begins a statement on a line, or ""."""
    start = _START.match(line)
    return start[1] if start else ""


def following(lines: Sequence[str], first: int) -> int:
    """Return the next line that begins a statement, whatever stands between."""
    last = min(len(lines), first + _LONGEST)
    return next((i for i in range(first + 1, last) if keyword(lines[i])), last)


def block_end(lines: Sequence[str], first: int) -> int:
    """Return the line before which the signals of a message end."""
    last = min(len(lines), first + _LONGEST)
    return next((i for i in range(first + 1, last) if keyword(lines[i]) not in ("", "SG_")), last)


def ends(lines: Sequence[str], first: int) -> list[int]:
    """Return the lines before which the statement of line ``first`` may end, the likeliest first.

    A message takes its signals along; a string may contain lines that look like statements, unless
    its closing quote is missing; and what is no statement may follow one.
    """
    last = min(len(lines), first + _LONGEST)
    candidates = []
    if keyword(lines[first]) == "BO_":
        candidates.append(block_end(lines, first))
    quotes = 0
    for i in range(first, last):
        if i > first and quotes % 2 == 0 and keyword(lines[i]):
            candidates.append(i)
            break
        quotes += lines[i].replace('\\"', "").count('"')
    else:
        candidates.append(last)
    return list(dict.fromkeys((*candidates, following(lines, first), first + 1)))


def plain(statement: str) -> tuple[str, list[str]]:
    """Return a statement as every reader takes it, and the names that begin with a digit in it.

    Such names get an underscore in front, and fractions a zero; identifiers that do not fit 11 bits
    are those of extended frames; the colon of SIG_VALTYPE_ is added.
    """
    names: list[str] = []

    def normal(match: re.Match[str]) -> str:
        if match["fraction"]:
            return "0."
        if match["name"]:
            names.append(match["name"])
            return f"_{match['name']}"
        return match[0]

    text = _VALTYPE.sub(r"\1 : ", _OUTSIDE.sub(normal, statement))
    return _OUTSIDE_REFERENCE.sub(_wide, text), names


def _wide(match: re.Match[str]) -> str:
    if match[2] is None:
        return match[0]
    ident = int(match[2])
    wide = STANDARD < ident < 1 << 29
    return f"{match[1]}{ident | EXTENDED_BIT if wide else ident}"


def identifier(statement: str) -> int | None:
    """Return the identifier that a statement refers to, None where there is none."""
    reference = _REFERENCE.search(_STRING.sub('""', statement))
    return int(reference[2]) if reference else None


def first_string(statement: str) -> str:
    """Return the first string of a statement: the name of an attribute."""
    string = _STRING.search(statement)
    return string[0] if string else ""


def shown(statement: str) -> str:
    """Return the beginning of a statement, for messages."""
    line = " ".join(statement.split("\n", 1)[0].split())
    return line if len(line) <= _WIDTH else f"{line[: _WIDTH - 1]}…"
