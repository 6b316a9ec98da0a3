"""What kernels compute once they compute once in C, or they are refused."""

import numpy as np
import pytest

from canroll.extensions.exchange.kernels.kinds import FLOAT, ArrayKind, KernelError
from canroll.extensions.exchange.kernels.translate import Translator
from canroll.plant_sim.kernels.jit import njit

VECTOR = ArrayKind(np.dtype(np.float64), (4,))


@njit
def _next(v):
    v[0] += 1.0
    return v[0]


@njit
def _place(v):
    v[0] += 1.0
    return int(v[0])


@njit
def _squared(v, x):
    v[1] = _next(v) ** 2


@njit
def _between(v, x):
    if x < _next(v) < 3.0:
        v[1] = 1.0


@njit
def _among(v, x):
    if _next(v) in (1.0, x):
        v[1] = 1.0


@njit
def _changed(v, x):
    v[_place(v)] += x


@njit
def _chosen(v, x):
    v[1], v[2] = (1.0, 2.0) if _next(v) > x else (3.0, 4.0)


@njit
def _part(v, x):
    v[_place(v) : 3] = x


@pytest.mark.parametrize("kernel", [_squared, _between, _among, _changed, _chosen, _part])
def test_a_call_that_c_would_make_twice_is_refused(kernel):
    with pytest.raises(KernelError, match=r"test_function.py:\d+: C would call this twice"):
        Translator("test_").entry(kernel, (VECTOR, FLOAT), "run")


@njit
def _chain(v, x):
    first = second = _next(v)
    v[1], v[2] = first, second * x


@njit
def _filled(v, x):
    v[1:4] = _next(v) + v[1]


@njit
def _listed(v, x):
    i = 1
    for k in (i, i + 1, i + 2):
        i = 0
        v[k] = x + k


@njit
def _pure(v, x):
    v[3] = (x + v[1]) ** 2
    if 0.0 < v[3] < 9.0:
        v[2] += x


@pytest.mark.parametrize("kernel", [_chain, _filled, _listed, _pure])
def test_a_kernel_is_the_same_in_c(kernel, compiled):
    here, there = (np.array([0.5, 1.0, 2.0, 3.0]) for _ in range(2))
    getattr(kernel, "py_func", kernel)(here, 0.25)
    compiled(kernel, (VECTOR, FLOAT))(there, 0.25)
    assert here.tolist() == there.tolist()
