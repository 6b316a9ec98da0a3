"""A quantity in two signals: one has it in coarse steps, the other the rest, as Toyota's angle.

The judge is cantools, which decodes both signals of the frame.
"""

import re

import cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from canroll.codegen.generated import bus_map
from canroll.codegen.generated import signals as signal_source
from canroll.errors import CanrollError
from canroll.firmware.state import RX_VEHICLE_MOTION, Ecu
from canroll.gain_gen.calibration import resolution
from canroll.plant_sim.nodes import codec, codec_tables

DBC = """VERSION ""
BU_: Car
BO_ 37 STEER: 8 Car
 SG_ ANGLE : 3|12@0- (1.5,0) [-500|500] "deg" Car
 SG_ FRACTION : 39|4@0- (0.1,0) [-0.7|0.7] "deg" Car
 SG_ UPWARD : 40|4@1+ (0.1,0) [0|1.4] "deg" Car
 SG_ ALIKE : 48|12@1- (1.5,0) [-500|500] "deg" Car
BO_ 180 SPEED: 8 Car
 SG_ SPEED : 47|16@0+ (0.01,0) [0|250] "km/h" Car
BO_ 160 MOTION: 8 Car
 SG_ AY : 0|12@1- (0.02,0) [0|40] "m/s2" Car
 SG_ YAW : 16|12@1- (0.1,0) [-100|0] "deg/s" Car
 SG_ ROLL : 32|8@1- (0.1,12.8) [0|25.5] "deg/s" Car
"""
MAP = """schema = 1
[[receive.vehicle_motion]]
message = "STEER"
signals.FRACTION = { field = "steering", add = true }
signals.ANGLE = "steering"
[[receive.vehicle_motion]]
message = "SPEED"
signals.SPEED = "speed"
"""
MOTION = """[receive.imu]
message = "MOTION"
signals.AY = "lateral_acceleration"
signals.YAW = "yaw_rate"
signals.ROLL = "roll_rate"
"""
DATABASE = cantools.database.load_string(DBC, "dbc", strict=False)
STEER = DATABASE.get_message_by_name("STEER")
FRAME = 5
"""The number of the frame: that of the speed is the mailbox's first one."""


def files(folder, text=MAP):
    (folder / "car.dbc").write_text(DBC)
    (folder / "car.toml").write_text(text)
    return folder / "car.dbc", folder / "car.toml"


@pytest.fixture(scope="module", params=["FRACTION", "UPWARD"])
def car(request, tmp_path_factory):
    """Return the name of the finer signal, the generated module, and the simulation's tables."""
    text = MAP.replace("FRACTION", request.param)
    paths = files(tmp_path_factory.mktemp("car"), text)
    namespace = {}
    exec(compile(signal_source.generate(*paths), "signals", "exec"), namespace)
    return request.param, namespace, codec_tables.of_map(bus_map.load(*paths))


def steering(module, payload):
    """Return what the firmware takes from a frame, deg."""
    ecu = Ecu()
    ecu.rx_payload[0] = list(payload)
    module["unpack"](ecu, FRAME, 0)
    assert ecu.valid[RX_VEHICLE_MOTION] == 2
    return np.degrees(ecu.steering / 2**24)


@given(payload=st.binary(min_size=8, max_size=8))
def test_the_firmware_takes_the_sum(car, payload):
    finer, module, _ = car
    values = STEER.decode(payload)
    expected = values["ANGLE"] + values[finer]
    assert steering(module, payload) == pytest.approx(expected, abs=1e-4)


@given(angle=st.floats(-499, 499))
def test_the_simulated_sensor_splits_what_it_sends(car, angle):
    finer, module, tables = car
    payload = np.zeros(codec.MAX_PAYLOAD, np.uint8)
    row = codec_tables.signal_index("VehicleMotion", "SteeringWheelAngle")
    codec.put_value(tables, tables.field[row]["frame"], row, payload, angle)
    values = STEER.decode(payload[:8].tobytes())
    assert values["ANGLE"] + values[finer] == pytest.approx(angle, abs=0.0501)
    assert steering(module, payload[:8].tobytes()) == pytest.approx(angle, abs=0.0501)


def test_the_step_is_the_finer_one(tmp_path):
    steps = resolution.of_bus(bus_map.load(*files(tmp_path)))
    assert np.degrees(steps.steering) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (", add = true", "", "FRACTION and ANGLE"),
        (", add = true", ", add = 1", "add must be true or false"),
        ('signals.ANGLE = "steering"', "", "FRACTION is added to"),
        ("signals.ANGLE", 'signals.ALIKE = "steering"\nsignals.ANGLE', "FRACTION is added to"),
    ],
)
def test_a_mean_of_unlike_signals_and_a_sum_of_nothing_are_refused(tmp_path, old, new, words):
    with pytest.raises(CanrollError, match=re.escape(words)) as caught:
        bus_map.load(*files(tmp_path, MAP.replace(old, new)))
    assert "car.toml [receive.vehicle_motion]" in str(caught.value)


def test_a_sent_frame_has_no_sum(tmp_path):
    sent = '[transmit.status]\nmessage = "MOTION"\nsignals.AY = { field = "speed", add = true }\n'
    with pytest.raises(CanrollError, match="AY: add applies to received signals only"):
        bus_map.load(*files(tmp_path, MAP + sent.replace('"speed"', '"lateral_acceleration"')))


def test_limits_that_leave_a_signed_signal_one_side_are_none(tmp_path):
    bus = bus_map.load(*files(tmp_path, MAP + MOTION))
    (box,) = bus.frames_of("imu")
    limits = {signal.name: (signal.raw_lo, signal.raw_hi) for signal in box.signals}
    # the range of ROLL is all of its codes: its offset shifts them
    assert limits == {"AY": (-2048, 2047), "YAW": (-2048, 2047), "ROLL": (-128, 127)}
    ay, yaw = bus.warnings
    assert "car.toml [receive.imu] AY" in ay and "[0|40]" in ay
    assert "YAW" in yaw and "[-100|0]" in yaw
    tables = codec_tables.of_map(bus)
    row = codec_tables.signal_index("Imu", "LateralAcceleration")
    assert codec.raw_value(tables, row, -3.0) == -150
