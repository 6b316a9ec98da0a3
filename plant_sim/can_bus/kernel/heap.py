# ruff: noqa: PLR0917
"""Binary heaps on plain arrays: (key, tie) ascending with a value beside each."""

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels.jit import njit

Column = NDArray[np.int64]


@njit
def push(
    keys: Column, ties: Column, values: Column, size: int, key: int, tie: int, value: int
) -> None:
    """Insert one entry into a heap of ``size`` entries; the caller updates the size."""
    child = size
    while child > 0:
        parent = (child - 1) >> 1
        if keys[parent] < key or (keys[parent] == key and ties[parent] <= tie):
            break
        keys[child] = keys[parent]
        ties[child] = ties[parent]
        values[child] = values[parent]
        child = parent
    keys[child] = key
    ties[child] = tie
    values[child] = value


@njit
def pop(keys: Column, ties: Column, values: Column, size: int) -> int:
    """Remove the smallest entry from a heap of ``size`` entries and return its value.

    The gap moves to the bottom along the smaller children, and the last entry is inserted from
    there. The child is selected arithmetically, because a branch would be mispredicted half of the
    time and make large heaps slow.
    """
    result: int = values[0]
    last = size - 1
    gap, child = 0, 1
    while child < last:
        other = min(child + 1, last - 1)
        less = (keys[other] < keys[child]) | (
            (keys[other] == keys[child]) & (ties[other] < ties[child])
        )
        child += int(less)
        keys[gap] = keys[child]
        ties[gap] = ties[child]
        values[gap] = values[child]
        gap = child
        child = 2 * gap + 1
    push(keys, ties, values, gap, keys[last], ties[last], values[last])
    return result
