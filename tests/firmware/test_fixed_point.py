"""Saturating fixed point, and records read as the memory that they are in C."""

from fractions import Fraction
from math import floor

import pytest
import rig
from hypothesis import given
from hypothesis import strategies as st

from canroll.codegen.run import memory_image
from canroll.firmware.calibration import Calibration
from canroll.firmware.check import check_ranges
from canroll.firmware.fixed_point import product, weighted
from canroll.firmware.state import Ecu
from canroll.firmware.subset import I32_MAX, I32_MIN, fields, octet, sat31, scaled, word

wide = st.integers(-(2**62), 2**62)
words = st.integers(I32_MIN, I32_MAX)
LEAST, MOST = -(2**30), 2**30 - 1


@given(wide, st.integers(1, 62))
def test_scaled_is_the_nearest_quotient_in_31_bits(value, shift):
    nearest = floor(Fraction(value, 2**shift) + Fraction(1, 2))
    assert scaled(value, shift) == min(max(nearest, LEAST), MOST)
    assert sat31(value) == min(max(value, LEAST), MOST)


@given(words, words, st.integers(1, 62))
def test_a_product_is_scaled(a, b, shift):
    assert product(a, b, shift) == scaled(a * b, shift)


@given(st.lists(words, min_size=5, max_size=5), st.lists(words, min_size=5, max_size=5))
def test_a_row_weighs_all_states(row, x):
    assert weighted(row, x) == sum(a * b for a, b in zip(row, x, strict=True))


@pytest.mark.parametrize("record_class", [Calibration, Ecu])
def test_memory_is_read_as_c_lays_it_out(record_class):
    record, count = record_class(), 0
    for field in fields(record_class):
        for index in range(len(flat(getattr(record, field.name)))):
            count += 1
            put(record, field.name, index, count % (field.f.hi - field.f.lo + 1) + field.f.lo)
    image = memory_image.image(record)
    offsets = memory_image.dtype(record_class).fields
    for field in fields(record_class):
        start = offsets[field.name][1]
        for index, value in enumerate(flat(getattr(record, field.name))):
            if field.kind == "u8":
                assert octet(record, start + index) == value == image[start + index]
            else:
                place = start // 4 + index
                assert word(record, place) == value
                assert image[4 * place : 4 * place + 4] == value.to_bytes(4, "little", signed=True)


@pytest.mark.parametrize("number", range(1, len(fields(Calibration)) + 1))
def test_every_element_out_of_its_range_is_found_by_its_field(number):
    field = fields(Calibration)[number - 1]
    least, most = (0, 255) if field.kind == "u8" else (I32_MIN, I32_MAX)
    cal = rig.calibration()
    assert check_ranges(cal) == 0
    for index in {0, len(flat(getattr(cal, field.name))) - 1}:
        for value, good in (
            (field.f.lo, True),
            (field.f.hi, True),
            (field.f.lo - 1, False),
            (field.f.hi + 1, False),
        ):
            if least <= value <= most:
                cal = rig.calibration()
                put(cal, field.name, index, value)
                assert check_ranges(cal) == (0 if good else number)


def flat(value):
    return [x for item in value for x in flat(item)] if isinstance(value, list) else [value]


def put(record, name, index, value):
    """Set the ``index``-th element of a field."""
    place = getattr(record, name)
    if not isinstance(place, list):
        setattr(record, name, value)
    elif isinstance(place[0], list):
        place[index // len(place[0])][index % len(place[0])] = value
    else:
        place[index] = value
