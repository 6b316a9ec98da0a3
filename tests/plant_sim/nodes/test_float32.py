"""Floating-point numbers of the plant's frames: what numpy and cantools make of the same bits."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support import float_bus

from canroll.codegen.generated import bus_map
from canroll.dbc import read
from canroll.plant_sim.nodes import codec, codec_tables, float32

LARGEST = float(np.finfo(np.float32).max)
REALS = ("RollRate", "LateralAcceleration", "YawRate")
FRAMES = {"RollRate": "GYRO_01", "LateralAcceleration": "GYRO_01", "YawRate": "GYRO_02"}


def bits(value):
    return int(np.array([value], np.float32).view(np.int32)[0])


@given(st.integers(-(2**31), 2**31 - 1))
@example(0x7F800000)
@example(-1)
@example(1)
@example(-(2**31))
def test_bits_are_the_number_that_numpy_says(code):
    value = float(np.array([code], np.int32).view(np.float32)[0])
    assert float32.finite(code) == math.isfinite(value)
    if not math.isfinite(value):
        assert math.isnan(float32.number_of(code))
    elif abs(value) < np.finfo(np.float32).tiny:
        assert float32.number_of(code) == 0.0
    else:
        assert float32.number_of(code) == value
        assert float32.code_of(value) == code


@given(st.floats(-LARGEST, LARGEST))
@example(16777215.5)
@example(LARGEST)
def test_a_number_has_the_bits_of_the_nearest(value):
    if abs(value) < np.finfo(np.float32).tiny:
        assert float32.code_of(value) == 0
        return
    found = float32.number_of(float32.code_of(value))
    # of two that are as near, the even one may be the other
    assert abs(found - value) == abs(float(np.float32(value)) - value)


@pytest.fixture(scope="module")
def bus(tmp_path_factory):
    paths = float_bus.write(tmp_path_factory.mktemp("float"))
    database, _ = read(paths[0])
    return codec_tables.of_map(bus_map.load(*paths)), database


@settings(deadline=None)
@given(data=st.binary(min_size=8, max_size=8), name=st.sampled_from(REALS))
def test_a_frame_is_read_and_written_as_by_cantools(bus, data, name):
    tables, database = bus
    message, row = (
        database.get_message_by_name(FRAMES[name]),
        codec_tables.signal_index("Imu", name),
    )
    expected = next(v for k, v in message.decode(data).items() if k.endswith(name))
    payload = np.zeros(codec.MAX_PAYLOAD, np.uint8)
    payload[:8] = list(data)
    raw = codec.extract(tables, row, payload)
    assert codec.valid(tables, row, raw) == math.isfinite(expected)
    if not math.isfinite(expected):
        assert math.isnan(codec.physical(tables, row, raw))
        return
    its = codec.physical(tables, row, raw)
    # right is positive there, and angles are in other units
    factor = {"RollRate": -1.0, "LateralAcceleration": 9.80665, "YawRate": 180 / math.pi}[name]
    assert its == pytest.approx(expected * factor, rel=1e-9, abs=1e-30)
    if abs(expected) >= np.finfo(np.float32).tiny:
        again = codec.raw_value(tables, row, its)
        # the product and the quotient round, too
        assert abs(again - raw) <= 1
    codec.insert(tables, row, payload, raw)
    assert payload[:8].tobytes() == data


def test_what_is_not_available_is_not_a_number(bus):
    tables, database = bus
    row = codec_tables.signal_index("Imu", "RollRate")
    payload = np.zeros(codec.MAX_PAYLOAD, np.uint8)
    codec.insert(tables, row, payload, codec.raw_value(tables, row, math.nan))
    decoded = database.get_message_by_name("GYRO_01").decode(payload[:8].tobytes())
    assert math.isnan(decoded["GY_RollRate"]) and decoded["GY_LateralAcceleration"] == 0.0


@pytest.mark.parametrize("value", [1e300, -1e300, math.inf])
def test_values_out_of_range_are_clipped(bus, value):
    tables, _ = bus
    row = codec_tables.signal_index("Imu", "YawRate")
    found = float32.number_of(codec.raw_value(tables, row, value))
    assert found == math.copysign(LARGEST, value)
