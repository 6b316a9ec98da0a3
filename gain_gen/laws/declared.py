"""What a law declares of itself: the options that it takes besides its task."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, TypeVar

from canroll.errors import CanrollError
from canroll.gain_gen.laws import LAWS

COMPUTED = "computed"
FEEDFORWARDS = ("apart", "none", "alone")
Solve = TypeVar("Solve", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True, kw_only=True)
class Declared:
    """The options of a law.

    Attributes:
        gains: kinds that it has: "computed", "theorem" (of its paper, on a 1-DOF model),
            "as_printed" (in its paper).
        feedforward: "apart" from its feedback, so that it can be left out, "none", or "alone".
        share: whether it is designed for a share of the roll moment m h a_y.
        level: whether its theorem certifies a given H∞ level.
        matrices: whether its gains come from a file of the user.
    """

    gains: tuple[str, ...] = (COMPUTED,)
    feedforward: str = "apart"
    share: bool = False
    level: bool = False
    matrices: bool = False


def law(**options: Any) -> Callable[[Solve], Solve]:  # noqa: ANN401
    """Declare the options of a law: a decorator of its function.

    Args:
        options: those of :class:`Declared`.

    Raises:
        CanrollError: there is no such option, or no such feedforward.
    """
    known = [field.name for field in fields(Declared)]
    for name in options:
        if name not in known:
            raise CanrollError(f"a law has no option '{name}', only {', '.join(known)}")
    declared = Declared(**options)
    if declared.feedforward not in FEEDFORWARDS:
        raise CanrollError(f"the feedforward of a law is one of {', '.join(FEEDFORWARDS)}")

    def mark(solve: Solve) -> Solve:
        solve.declared = declared  # type: ignore[attr-defined]
        return solve

    return mark


def declared(solve: Callable[..., Any]) -> Declared:
    """Return what a law declares; without a declaration it takes no such option."""
    declaration: Declared = getattr(solve, "declared", Declared())
    return declaration


def built_in(takes: Callable[[Declared], bool]) -> list[str]:
    """Return the names of the built-in laws that declare something."""
    return [name for name in LAWS if LAWS.origin(name).is_built_in and takes(declared(LAWS[name]))]
