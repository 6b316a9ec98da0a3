"""Translations kept between runs: proving and translating the firmware takes seconds."""

from collections.abc import Callable

from canroll import build_cache


def translation(parts: object, make: Callable[[], dict[str, str]]) -> dict[str, str]:
    """Return what ``make`` returns, texts by file name, or what it returned before.

    Args:
        parts: all that it makes them from beside the firmware and the translator; its ``repr``
            tells any two apart.
        make: translates; its errors are raised each time.
    """
    sources = build_cache.sources("firmware", "codegen")
    return build_cache.kept("c99", sources + repr(parts).encode(), make)
