"""Choices of a run as words: ``law=lqr,bus=500k``, and options of a command line."""

from collections.abc import Mapping, Sequence
from typing import Any

from canroll.errors import UnknownNameError
from canroll.setup.choice import one_or_several, several
from canroll.setup.choices import CHOICES

BY_WORD = {
    choice.word: choice for choice in CHOICES.values() if choice.kind not in (Mapping, Sequence)
}
"""Choices that can be given as ``key=value``."""


def described(text: str) -> dict[str, Any]:
    """Return the choices given as "law=lqr,bus=125k_busy".

    Raises:
        UnknownNameError: an unknown key or name.
        CanrollError: an invalid value.
    """
    values: dict[str, Any] = {}
    for part in text.split(","):
        word, _, value = part.partition("=")
        if word not in BY_WORD:
            raise UnknownNameError("key of a run", word, BY_WORD)
        choice = BY_WORD[word]
        read = choice.read(value)
        if choice.repeated and choice.name in values:
            read = one_or_several([*several(values[choice.name]), read])
        values[choice.name] = read
    return values


def arguments(values: Mapping[str, Any]) -> list[str]:
    """Return the command-line options for ``values``."""
    words: list[str] = []
    for name, value in values.items():
        choice = CHOICES[name]
        if value is None or (choice.kind is bool and value == choice.default):
            continue
        if choice.kind is bool:
            words.append(choice.option)
        elif choice.kind is Mapping:
            for key, item in value.items():
                words += [choice.option, f"{key}={item}"]
        elif choice.kind is Sequence or choice.repeated:
            for item in several(value):
                words += [choice.option, str(item)]
        else:
            words += [choice.option, repr(value) if choice.kind is float else str(value)]
    return words
