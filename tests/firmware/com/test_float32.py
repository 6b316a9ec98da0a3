"""Floating-point numbers in integers: the nearest integer of any bits, the nearest number back."""

import math
import struct
from fractions import Fraction

from hypothesis import example, given
from hypothesis import strategies as st

from canroll.firmware.com.float32 import code_of, fixed_of
from canroll.firmware.subset import I32_MAX, I32_MIN, clamp

codes = st.integers(I32_MIN, I32_MAX)
sized = st.integers(100 << 23, 155 << 23)
"""The bits of numbers of a field's size."""
factors = st.integers(2**29, 2**30) | st.integers(-(2**30), -(2**29))
shifts = st.integers(-31, 90)
REAL = 0x7F800000
LEAST = 0x00800000


def number(code):
    return struct.unpack("<f", struct.pack("<i", code))[0]


@given(codes | sized, factors, shifts)
@example(LEAST, 2**29, 90)
@example(LEAST - 1, 2**30, -31)
@example(I32_MIN, 2**29, 0)
@example(REAL - 1, 2**30, -31)
@example(REAL - 1 + I32_MIN, 2**30, 90)
def test_a_number_is_the_nearest_integer_of_its_field(code, factor, shift):
    if not math.isfinite(number(code)):
        return
    exact = Fraction(number(code)) * factor / Fraction(2) ** shift
    nearest = min(max(math.floor(exact + Fraction(1, 2)), I32_MIN), I32_MAX)
    assert clamp(fixed_of(code, factor, shift), I32_MIN, I32_MAX) == nearest


@given(codes, factors, shifts)
@example(2**24 - 1, 2**30 - 1, 0)
@example(I32_MIN, -(2**30), -31)
@example(1, 2**29, 90)
@example(0, 2**29, 0)
def test_an_integer_is_the_nearest_number(value, factor, shift):
    exact = Fraction(value) * factor / Fraction(2) ** shift
    code = code_of(value, factor, shift)
    apart = abs(Fraction(number(code)) - exact)
    if not value:
        assert code == 0
        return
    assert I32_MIN <= code <= I32_MAX
    assert all(apart <= abs(Fraction(number(code + step)) - exact) for step in (-1, 1))
