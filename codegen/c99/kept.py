"""Translations kept between runs: proving and translating the firmware takes seconds."""

from collections.abc import Callable
from typing import TypeVar

from canroll import build_cache

Result = TypeVar("Result")


def translation(parts: object, make: Callable[[], Result]) -> Result:
    """Return what ``make`` makes of the firmware, or what it made before.

    Args:
        parts: all that it makes them from beside the firmware and the translator; its ``repr``
            tells any two apart.
        make: translates or proves; its errors are raised each time.
    """
    sources = build_cache.sources("firmware", "codegen")
    return build_cache.kept("c99", sources + repr(parts).encode(), make)
