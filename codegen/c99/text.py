"""C text: declarations, comments, line breaks."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from canroll.codegen.operations.c_expression import C_TYPES

WIDTH = 100
RUNTIME = Path(__file__).with_name("canroll_runtime.h")
"""What emitted C needs of the machine: integers of fixed width, helpers of intrinsics."""
OPEN_C = ["", "#ifdef __cplusplus", 'extern "C" {', "#endif"]
CLOSE_C = ["", "#ifdef __cplusplus", "}", "#endif"]
"""What makes declarations those of C where C++ reads them."""

_ASCII = str.maketrans(
    {
        "·": ".",
        "…": "...",
        "²": "^2",
        "³": "^3",
        "°": "deg",
        "−": "-",
        "–": "-",
        "±": "+-",
        "≤": "<=",
        "≥": ">=",
        "×": "x",
        "φ": "phi",
        "ε": "epsilon",
        "Ω": "Omega",
        "Σ": "Sum",
        "ξ": "xi",
        "’": "'",
    }
)


def declaration(kind: str, name: str, shape: Sequence[int | str]) -> str:
    """A variable, parameter or field with its type and sizes; a size may be left out, ""."""
    return f"{C_TYPES[kind]} {name}{''.join(f'[{length}]' for length in shape)}"


def plain(text: str) -> str:
    """Text for a C comment: ASCII, no markup, nothing that would end the comment."""
    text = text.replace("``", "").replace(":func:", "").replace("`", "'").replace("\\", "/")
    text = text.translate(_ASCII).encode("ascii", "replace").decode()
    text = re.sub(r"\?\?+", "?", text)  # of two C99 makes other characters: a trigraph
    return text.replace("*/", "* /").replace("/*", "/ *")


def comment(text: str, indent: str = "") -> list[str]:
    """A block comment."""
    lines = plain(text).splitlines()
    if len(lines) == 1 and len(indent) + len(lines[0]) + 6 <= WIDTH:
        return [f"{indent}/* {lines[0].strip()} */"]
    body = [f"{indent} * {line.strip()}".rstrip() for line in lines]
    return [f"{indent}/*", *body, f"{indent} */"]


def comments_of(
    comments: Mapping[int, tuple[bool, str]], lines: Iterable[int], indent: str = ""
) -> Iterator[str]:
    """The comments of a module that stand alone on some ``lines`` of it."""
    for line in lines:
        alone, text = comments.get(line, (False, ""))
        if alone:
            yield from comment(text, indent)


def filled(words: Iterable[str], width: int = WIDTH) -> list[str]:
    """Lines of ``words``, indented by four; a word is never broken."""
    lines: list[str] = []
    line, length = ["   "], 3
    for word in words:
        length += 1 + len(word)
        if length > width:
            lines.append(" ".join(line))
            line, length = ["   "], 4 + len(word)
        line.append(word)
    return [*lines, " ".join(line)]


OPERATORS = ("+", "-", "*", "/", "|", "||", "&&")


def broken(line: str) -> list[str]:
    """A line broken where too long: at the outermost comma or operator, else an opening bracket."""
    if len(line) <= WIDTH:
        return [line]
    indent = " " * (len(line) - len(line.lstrip()) + 4)
    depth, best, best_depth, bracket = 0, 0, 99, 0
    for i, letter in enumerate(line[:WIDTH]):
        depth += {"(": 1, ")": -1}.get(letter, 0)
        if i <= len(indent):
            continue
        after_comma = line[i - 1 : i + 1] == ", "
        before_operator = letter == " " and line[i + 1 : i + 3].strip() in OPERATORS
        if (after_comma or before_operator) and depth <= best_depth:
            best, best_depth = i, depth
        if letter == "(":
            bracket = i + 1
    best = best or bracket
    if not best:
        return [line]
    return [line[:best].rstrip(), *broken(indent + line[best:].lstrip())]
