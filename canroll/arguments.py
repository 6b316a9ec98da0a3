"""Arguments from Python, checked against the annotations of what takes them."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from inspect import Parameter, signature
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    ParamSpec,
    TypeGuard,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from canroll.errors import CanrollError

P = ParamSpec("P")
R = TypeVar("R")

PLAIN: dict[Any, tuple[type, str, str]] = {
    float: (Real, "a number", "numbers"),
    int: (Integral, "a whole number", "whole numbers"),
    bool: (bool, "True or False", "True or False"),
    str: (str, "a text", "texts"),
    Path: (Path, "a path", "paths"),
    Any: (object, "a value", "values"),
}
"""For each annotation the type of its values, one in words, and several in words."""


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Return ``function``, which then refuses arguments that are not of their annotated type.

    Numbers of NumPy count as numbers, arrays as lists. Further keywords (``**choices``) are left to
    the function.
    """
    shape = signature(function)

    @cache
    def hints() -> dict[str, Any]:
        return get_type_hints(function)

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        for name, value in shape.bind(*args, **kwargs).arguments.items():
            if shape.parameters[name].kind is not Parameter.VAR_KEYWORD:
                require(name, value, hints()[name])
        return function(*args, **kwargs)

    return call


def require(name: str, value: object, hint: Any) -> None:  # noqa: ANN401
    """Reject an argument that is not of the type ``hint``.

    Raises:
        CanrollError: the message names the argument and what it must be.
    """
    if not _fits(value, hint):
        raise CanrollError(f"{name}={_shown(value)}: must be {_one(hint)}")


def _shown(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def _parts(hint: Any) -> tuple[Any, ...]:  # noqa: ANN401
    """Return the alternatives of an annotation."""
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def _fits(value: object, hint: Any) -> bool:  # noqa: ANN401
    """Whether a value is of an annotated type, with all its entries."""
    parts = _parts(hint)
    if len(parts) > 1:
        return any(_fits(value, part) for part in parts)
    if hint in PLAIN:
        return isinstance(value, PLAIN[hint][0]) and (
            hint in (bool, Any) or not isinstance(value, bool)
        )
    kind, inner = get_origin(hint) or hint, get_args(hint)
    if kind is Annotated:
        return _fits(value, inner[0])
    if kind is Sequence:
        return _is_list(value) and all(_fits(item, inner[0]) for item in value)
    if kind is Mapping:
        return isinstance(value, Mapping) and all(
            _fits(key, inner[0]) and _fits(item, inner[1]) for key, item in value.items()
        )
    return isinstance(value, kind)


def _is_list(value: object) -> TypeGuard[Sequence[object]]:
    listed = hasattr(value, "__getitem__") and bool(getattr(value, "__len__", None))
    return listed and not isinstance(value, str | bytes | Mapping)


def _one(hint: Any) -> str:  # noqa: ANN401
    """Return in words what an argument must be."""
    words = [_words(part) for part in _parts(hint) if part is not NoneType]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])}, or {words[-1]}"


def _words(hint: Any) -> str:  # noqa: ANN401
    kind, inner = get_origin(hint) or hint, get_args(hint)
    if hint in PLAIN:
        return PLAIN[hint][1]
    if kind is Sequence:
        return f"a list of {_several(inner[0])}"
    if kind is Mapping:
        return f"a dictionary of {_several(inner[1])} by name"
    if kind is Callable:
        return "a function"
    return f"a {kind.__name__}"


def _several(hint: Any) -> str:  # noqa: ANN401
    """Return the plural of an annotated type."""
    if len(parts := _parts(hint)) > 1:
        return " or ".join(_several(part) for part in parts if part is not NoneType)
    if hint in PLAIN:
        return PLAIN[hint][2]
    return "dictionaries" if get_origin(hint) is Mapping else f"{hint.__name__}s"
