"""What of docstrings and signatures the API reference shows otherwise than Sphinx would."""

import logging
import re
from pkgutil import resolve_name

from docutils.nodes import Element
from sphinx.application import Sphinx
from sphinx.util.rst import escape

from canroll.setup.choice import Choice
from canroll.setup.choices import CHOICES, Choices

ARRAY = re.compile(
    r"numpy\.ndarray\[tuple\[~?typing\.Any, \.\.\.\], ~?numpy\.dtype\[([^][]|\[[^][]*\])*\]\]"
)


def setup(app: Sphinx) -> None:
    """Connect what follows; on errors alone, as a package that is imported prints its threads."""
    logging.getLogger("numexpr").setLevel(logging.ERROR)
    app.connect("autodoc-process-docstring", leave_prose, priority=100)
    app.connect("autodoc-process-docstring", list_choices)
    app.connect("autodoc-process-signature", shorten)
    app.connect("missing-reference", leave_plain)


def leave_prose(
    _app: Sphinx, what: str, _name: str, thing: object, _options: object, lines: list[str]
) -> None:
    """Keep of a value's docstring what its source says, and all of it as prose."""
    if lines and (
        str(type(thing).__doc__).startswith(lines[0]) or lines[0].startswith("Alias for")
    ):
        lines.clear()  # the words of Python on its own types
    if what in ("attribute", "data", "property"):
        lines[:0] = ["..", ""]  # napoleon takes for a type what the first line has before a colon


def list_choices(
    _app: Sphinx, _what: str, _name: str, thing: object, _options: object, lines: list[str]
) -> None:
    """Add the keywords of a run to the type of which they are, from where they are described."""
    if thing is Choices:
        lines += [
            "",
            *(f":param {choice.name}: {described(choice)}" for choice in CHOICES.values()),
        ]


def described(choice: Choice) -> str:
    """Return what a choice is, with its unit and its default."""
    without = "False: " if choice.option.startswith("--no-") else ""
    more = [choice.unit] if choice.unit else []
    if choice.default not in (None, "", ()) and choice.kind is not bool:
        more.append(f"default {choice.default}")
    text = escape(without + choice.help + (f" ({', '.join(more)})" if more else ""))
    return re.sub(r"--[a-z-]+", r"``\g<0>``", text)


def shorten(
    _app: Sphinx,
    _what: str,
    _name: str,
    _thing: object,
    _options: object,
    signature: str | None,
    result: str | None,
) -> tuple[str | None, str | None]:
    """Write defaults made anew as an ellipsis, which Python can read, and arrays without types."""
    signature = signature and signature.replace("<factory>", "...")
    return signature and ARRAY.sub("numpy.ndarray", signature), (
        result and ARRAY.sub("numpy.ndarray", result)
    )


def leave_plain(_app: Sphinx, _env: object, reference: Element, text: Element) -> Element | None:
    """Leave without a link what has no place in the reference: types, and names that exist."""
    if "refwarn" not in reference:  # of an annotation, not of a role in a docstring
        return text
    home = (reference.source or "").rpartition("docstring of ")[2].split(".")
    for depth in range(len(home) + 1):
        try:
            resolve_name(".".join([*home[:depth], reference["reftarget"]]))
        except (ImportError, AttributeError, ValueError):
            continue
        return text
    return None
