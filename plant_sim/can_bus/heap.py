# ruff: noqa: PLR0917
"""Binary heaps on plain arrays: (key, tie) ascending with a value beside each."""

import numpy as np
from numpy.typing import NDArray

from plant_sim.jit import njit

Column = NDArray[np.int64]


@njit
def push(
    keys: Column, ties: Column, values: Column, size: int, key: int, tie: int, value: int
) -> None:
    """Insert one entry into the heap of ``size`` entries; the caller counts."""
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
    """Remove the least entry from the heap of ``size`` entries and return its value."""
    result: int = values[0]
    last = size - 1
    key, tie, value = keys[last], ties[last], values[last]
    parent = 0
    while True:
        child = 2 * parent + 1
        if child >= last:
            break
        other = child + 1
        if other < last and (
            keys[other] < keys[child] or (keys[other] == keys[child] and ties[other] < ties[child])
        ):
            child = other
        if key < keys[child] or (key == keys[child] and tie <= ties[child]):
            break
        keys[parent] = keys[child]
        ties[parent] = ties[child]
        values[parent] = values[child]
        parent = child
    keys[parent] = key
    ties[parent] = tie
    values[parent] = value
    return result
