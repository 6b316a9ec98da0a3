"""Cases by which an engine is tried: of numbers, of failure, of death.

Processes import them from here by name. The module of a test they may not find: pya2l puts its own
folder on the path, where a package "tests" hides ours.
"""

import os
import signal
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from canroll.cases.execution import Cases, Execution
from canroll.errors import CanrollError, UnknownNameError

COUNT = 12


@dataclass(frozen=True)
class Pair:
    number: int
    text: str


@dataclass(frozen=True)
class Row:
    figures: NDArray[np.float64]
    share: float | None
    pairs: tuple[Pair, ...]
    bounds: tuple[float, int] | None


def work(number: int, common: float = 0.0, grave: str | None = None) -> Row:
    """Return a row of some numbers; with ``grave`` the first to come to case 5 dies."""
    if grave is not None and number == 5 and not Path(grave).exists():
        Path(grave).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    random = np.random.default_rng(number)
    odd = number % 2 == 1
    return Row(
        common + random.random((2, 3)),
        None if odd else random.random(),
        (Pair(number, "first"), Pair(-number, "second")),
        (0.1 * number, number) if odd else None,
    )


def fails(number: int) -> Row:
    """Fail, by an error of more than one argument."""
    raise UnknownNameError("case", str(number), ("1",))


def refuses(number: int) -> Row:
    """Fail."""
    raise CanrollError(f"case {number} is refused")


def study(cases: Cases, grave: str | None = None) -> list[str]:
    """Drive all cases, or the picked one, and return their rows as text."""
    own = cases.of({"study": "of tests"})
    common = own.engine.common(0.5)
    arguments = [(number, common, grave) for number in own.picked(range(COUNT))]
    return list(map(repr, own.rows("cases", work, arguments)))


if __name__ == "__main__":
    with Execution(folder=Path(sys.argv[1])).cases() as alone:
        study(alone, sys.argv[2])
