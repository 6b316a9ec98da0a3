"""Signals that are floating-point numbers: the generated code is proved, and is what cantools says.

What cannot be one is refused in a line.
"""

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import float_bus
from support.bundles import compared, export, make
from support.replays import compare

from canroll.codegen.export import bundle
from canroll.codegen.generated import bus_map
from canroll.codegen.proof.prove import prove
from canroll.codegen.run import ecu_traffic, memory_image, native
from canroll.codegen.run.bus_firmware import built_in, of_bus
from canroll.codegen.subset import rules
from canroll.dbc import read
from canroll.errors import CanrollError
from canroll.firmware.state import RX_IMU, TX_ANTI_ROLL_BAR, Ecu
from canroll.firmware.subset import fields

KILO = 1000.0
RATE = '{ field = "roll_rate", unit = "deg/s" }'
Q = {field.name: field.f.q for field in fields(Ecu)}
BAR = next(field.f for field in fields(Ecu) if field.name == "bar")
reals = st.binary(min_size=4, max_size=4) | st.floats(-200, 200, width=32).map(
    lambda value: struct.pack("<f", value)
)
"""The bytes of any number, infinity and not a number among them, or of one of a field's size."""


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    return float_bus.write(tmp_path_factory.mktemp("float"))


@pytest.fixture(scope="module")
def firmware(paths):
    return of_bus(*paths)


@pytest.fixture(scope="module")
def database(paths):
    return read(paths[0])[0]


def test_only_buses_that_have_them_have_their_module(firmware):
    rules.check(firmware.program())
    assert "canroll_float32.c" in firmware.files
    assert "canroll_float32.c" not in built_in().files


def test_the_program_is_proved(firmware):
    assert not prove(firmware.program()).findings


@given(first=reals, second=reals)
def test_fields_are_what_cantools_decodes(firmware, database, first, second):
    data = first + second[::-1]
    message = database.get_message_by_name("GYRO_01")
    ecu = firmware.record()
    ecu.roll_rate = ecu.lateral_acceleration = 7
    ecu.rx_payload[0] = list(data)
    firmware.module("com.signals").unpack(ecu, RX_IMU, 0)
    decoded = message.decode(data)
    rate, side = decoded["GY_RollRate"], decoded["GY_LateralAcceleration"]
    assert ecu.valid[RX_IMU] & 3 == math.isfinite(rate) + 2 * math.isfinite(side)
    for value, unit, name in (
        (rate, -math.pi / 180, "roll_rate"),
        (side, 9.80665, "lateral_acceleration"),
    ):
        field = getattr(ecu, name)
        if not math.isfinite(value):
            assert field == 7
        else:
            exact = min(max(value * unit * 2 ** Q[name], -(2**30)), 2**30 - 1)
            assert abs(field - exact) <= 0.5 + abs(exact) * 2e-9


@given(st.tuples(*[st.integers(BAR.lo, BAR.hi)] * 2))
def test_commands_are_the_nearest_numbers_within_their_limits(firmware, database, values):
    ecu = firmware.record()
    ecu.bar = list(values)
    firmware.module("com.signals").pack(ecu, TX_ANTI_ROLL_BAR)
    decoded = database.get_message_by_name("ROLL_BAR").decode(bytes(ecu.tx_payload[1][:12]))
    front, rear = (value / 2**BAR.q for value in values)
    front = min(max(front, -8191.0), 8191.0)
    # of two numbers that are as near, the even one may be the other
    nearest = abs(float(np.float32(front)) - front)
    assert abs(decoded["RB_TorqueFront"] - front) == nearest
    assert decoded["RB_TorqueRear"] == pytest.approx(rear / KILO, rel=2.0**-24 + 2e-9)


def calibration():
    return memory_image.sealed(ecu_traffic.random_calibration(3))


@pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
def test_c_gives_the_states_of_python(firmware):
    traffic = ecu_traffic.random_traffic(5, 60, bus=firmware.bus)
    compare(firmware, calibration(), traffic)


@pytest.mark.long
@pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
def test_the_bundle_passes_and_agrees_with_cantools(paths, tmp_path):
    dbc, map_file = paths
    bundle.write(tmp_path, export(dbc=dbc, map_file=map_file))
    done = make(tmp_path, "test", "CFLAGS=-std=c99 -O1 -Wall -Wextra -Werror")
    assert done.returncode == 0, done.stdout + done.stderr
    done = compared(tmp_path, 5000)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("PASS") == 8 and done.stderr == ""


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('"yaw_rate"', '{ field = "yaw_rate", unavailable = [1] }', "can have no unavailable"),
        ('"yaw_rate"', '{ field = "yaw_rate", offset = 1 }', "can have no offset"),
        ('"yaw_rate"', '{ field = "yaw_rate", redundant = "GY_YawRate" }', "can have no redundant"),
        ('"yaw_rate"', '{ field = "yaw_rate", factor = 1e30 }', "factor of GY_YawRate is out of"),
        ('"yaw_rate"', '{ field = "yaw_rate", valid = "GY_YawRate" }', "not an integer"),
        ('"lateral_acceleration"', RATE, "only plain signals of integers"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(tmp_path, old, new, word):
    dbc, map_file = float_bus.write(tmp_path)
    table = map_file.read_text()
    assert old in table
    map_file.write_text(table.replace(old, new))
    with pytest.raises(CanrollError, match=word) as caught:
        bus_map.load(dbc, map_file)
    assert "\n" not in str(caught.value)


def test_codes_for_not_available_are_refused(tmp_path):
    dbc, map_file = float_bus.write(tmp_path)
    dbc.write_text(f'{dbc.read_text()}VAL_ 258 GY_YawRate 0 "SNA";\n')
    with pytest.raises(CanrollError, match=r"GY_YawRate .* can have no code for not available"):
        bus_map.load(dbc, map_file)
