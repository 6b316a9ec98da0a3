"""Checksums by functions of the user's own, compiled for the plant and called by their address."""

from functools import cache
from types import FunctionType
from typing import Any

import numba
import numpy as np
from numba.types import Array, int64
from numpy.typing import NDArray

from canroll.codegen.frame.checksum import OwnChecksum
from canroll.plant_sim.kernels.jit import function_at, njit

_SIGNATURE = int64(Array(int64, 1, "C"), int64)
_function_at = function_at(_SIGNATURE)
LONGEST = 64
"""Bytes of the longest frame."""
_kept: list[Any] = []
"""What stands at the addresses given, for as long as this process lasts."""


@njit
def called(address: int, payload: NDArray[np.uint8], identifier: int) -> int:
    """The checksum of a frame by the function at an address."""
    # Python's integers: narrow ones would wrap
    given = np.zeros(LONGEST, np.int64)
    for k in range(len(payload)):
        given[k] = payload[k]
    function = _function_at(address)
    result: int = function(given, identifier)
    return result


@njit
def none(address: int, payload: NDArray[np.uint8], identifier: int) -> int:
    """In place of :func:`called` where no address lasts."""
    return 0


@cache
def address(own: OwnChecksum) -> int:
    """Where the compiled function is, which lasts as long as this process does."""
    names = own.namespace()
    for name, value in names.items():
        if isinstance(value, FunctionType):
            names[name] = numba.njit(value, error_model="numpy")
        elif isinstance(value, tuple):
            names[name] = np.array(value, np.int64)
    function = names[own.name]

    def summed(payload: NDArray[np.int64], identifier: int) -> int:
        result: int = function(payload, identifier)
        return result

    compiled = numba.cfunc(_SIGNATURE)(summed)
    _kept.append(compiled)
    return int(compiled.address)
