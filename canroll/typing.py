"""Types used by many modules."""

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Progress = Callable[[str, float], None]
"""Called with the name of the activity and the share done, 0 to 1."""


@runtime_checkable
class StateSpace(Protocol):
    """A linear system with matrices ``A`` to ``D``, such as python-control's ``ss`` makes.

    Its ``dt``, if it has one, is its sample time in s: 0 is continuous, None and True say nothing.
    """

    A: Any
    B: Any
    C: Any
    D: Any
