"""Messages whose signals are in several frames, as those of nearly every car are.

The judge of what is unpacked is cantools; what is late or invalid is compared with what was sent.
"""

import sys

import cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.replays import compare

from canroll.codegen.generated import bus_map
from canroll.codegen.proof.prove import prove
from canroll.codegen.run import ecu_traffic, memory_image, native
from canroll.codegen.run.bus_firmware import of_bus
from canroll.codegen.subset import rules
from canroll.errors import CanrollError
from canroll.firmware.state import (
    ACTIVE,
    DEGRADED,
    FIRST_FRAME,
    RX_IMU,
    RX_VEHICLE_MOTION,
    SAFE,
)

DBC = """\
VERSION ""
BU_: Car
BO_ 36 YAW: 8 Car
 SG_ YAW_RATE : 1|10@0+ (0.25,-125) [0|0] "deg/s" Car
 SG_ YAW_STATE : 7|2@0+ (1,0) [0|3] "" Car
BO_ 42 ACCEL: 8 Car
 SG_ ACCEL_Y : 11|12@0- (0.01,0) [0|0] "m/s2" Car
 SG_ ROLL_RATE : 31|16@0- (0.01,0) [0|0] "deg/s" Car
 SG_ COUNT : 55|4@0+ (1,0) [0|15] "" Car
BO_ 44 WHEELS: 8 Car
 SG_ FL : 0|15@1+ (0.1,0) [0|0] "rpm" Car
 SG_ FR : 16|15@1+ (0.1,-2) [0|0] "rpm" Car
 SG_ FL_OK : 15|1@1+ (1,0) [0|1] "" Car
 SG_ FL_AGAIN : 32|15@1+ (0.1,0) [0|0] "rpm" Car
 SG_ FR_OK : 31|1@1+ (1,0) [0|1] "" Car
BO_ 37 STEER: 8 Car
 SG_ ANGLE : 3|12@0- (0.5,0) [0|0] "deg" Car
 SG_ ANGLE_AGAIN : 23|12@0- (0.5,0) [0|0] "deg" Car
 SG_ COUNT : 55|4@0+ (1,0) [0|15] "" Car
BO_ 80 MOMENTS: 8 Car
 SG_ FRONT : 0|16@1- (1,0) [0|0] "Nm" Car
 SG_ REAR : 16|16@1- (1,0) [0|0] "Nm" Car
BO_ 79 CORNERS: 8 Car
 SG_ STATE : 0|2@1+ (1,0) [0|0] "" Car
 SG_ MANY : 8|8@1+ (1,0) [0|0] "" Car
BO_ 81 BARS: 8 Car
 SG_ FRONT : 0|16@1- (1,0) [0|0] "Nm" Car
 SG_ REAR : 16|16@1- (1,0) [0|0] "Nm" Car
"""
MAP = """\
schema = 1

[[receive.imu]]
message = "YAW"
period_ms = 20
signals.YAW_RATE = { field = "yaw_rate", valid = { signal = "YAW_STATE", codes = [1, 2] } }

[[receive.imu]]
message = "ACCEL"
period_ms = 10
signals.ACCEL_Y = "lateral_acceleration"
signals.ROLL_RATE = "roll_rate"

[[receive.vehicle_motion]]
message = "STEER"
period_ms = 20
signals.ANGLE = "steering"

[[receive.vehicle_motion]]
message = "WHEELS"
period_ms = 20
signals.FL = { field = "speed", radius = 0.3, valid = "FL_OK" }
signals.FR = { field = "speed", radius = 0.32, valid = "FR_OK" }

[transmit.anti_roll_bar]
message = "BARS"
signals.FRONT = "bar[0]"
signals.REAR = "bar[1]"
"""
DATABASE = cantools.database.load_string(DBC, "dbc")
ACCEL, WHEELS, YAW, STEER = 0, 1, 5, 6
"""Numbers of the frames: the first of each message, then the others."""
TIMEOUT = 5


def files(folder, table=MAP):
    (folder / "car.dbc").write_text(DBC, encoding="utf-8")
    (folder / "car.toml").write_text(table, encoding="utf-8")
    return folder / "car.dbc", folder / "car.toml"


@pytest.fixture(scope="module")
def firmware(tmp_path_factory):
    return of_bus(*files(tmp_path_factory.mktemp("car")))


def calibration(measurements=3):
    cal = ecu_traffic.random_calibration(3)
    cal.observer, cal.actuator, cal.law, cal.compensator_outputs, cal.e2e = 1, 1, 0, 1, 0
    cal.timeout_ticks, cal.measurements = [TIMEOUT, TIMEOUT, 0, 0, 0], measurements
    cal.recovery_ticks, cal.init_ticks, cal.identification = 5, 2, 0
    for name in ("redundancy_min", "clock_period", "delivery_min", "response_min", "rolling_min"):
        setattr(cal, name, 0)
    cal.erratic_scale, cal.feedback, cal.feedforward = [0] * 5, [0] * 5, [0] * 5
    return memory_image.sealed(cal)


def frame(name, **values):
    return list(DATABASE.encode_message(name, values, padding=False))


class Car:
    """An ECU whose frames come in every tick, but for those that are dropped."""

    def __init__(self, firmware, cal):
        self.firmware, self.cal = firmware, cal
        self.ecu = firmware.record()
        assert firmware.loop.init(self.ecu, cal) == 0

    def drive(self, ticks, drop=(), yaw_state=1):
        frames = {
            ACCEL: frame("ACCEL", ACCEL_Y=0.5, ROLL_RATE=0, COUNT=0),
            WHEELS: frame("WHEELS", FL=600, FR=600, FL_OK=1, FR_OK=1, FL_AGAIN=0),
            YAW: frame("YAW", YAW_RATE=1, YAW_STATE=yaw_state),
            STEER: frame("STEER", ANGLE=2, ANGLE_AGAIN=2, COUNT=0),
        }
        for _ in range(ticks):
            for number, payload in frames.items():
                if number not in drop:
                    self.firmware.loop.receive(self.ecu, number, payload, 8)
            self.firmware.loop.tick(self.ecu, self.cal, 1)
        return self.ecu


def test_the_first_frame_of_a_message_has_its_first_signal(firmware):
    assert [box.name for box in firmware.bus.received[:2]] == ["ACCEL", "WHEELS"]
    assert [box.name for box in firmware.bus.received[5:]] == ["YAW", "STEER"]
    assert firmware.slots == {42: (ACCEL,), 44: (WHEELS,), 36: (YAW,), 37: (STEER,)}
    assert [box.name for box in firmware.bus.frames_of("imu")] == ["ACCEL", "YAW"]


def test_the_program_keeps_the_rules_and_is_proved(firmware):
    program = firmware.program()
    rules.check(program)
    assert not prove(program).findings


@given(data=st.binary(min_size=8, max_size=8))
def test_a_mean_and_a_validity_are_what_cantools_decodes(firmware, data):
    ecu = firmware.record()
    ecu.speed = 7
    ecu.rx_payload[2 * WHEELS] = list(data)
    unpacker = sys.modules[f"{firmware.loop.__package__}.com.signals"]
    unpacker.unpack(ecu, WHEELS, 2 * WHEELS)
    values = DATABASE.decode_message("WHEELS", data)
    valid = values["FL_OK"] == values["FR_OK"] == 1
    assert (ecu.valid[RX_VEHICLE_MOTION] & 1) == valid
    mean = (0.3 * values["FL"] + 0.32 * values["FR"]) / 2 * np.pi / 30
    expected = min(max(mean, 0.0), 200.0) if valid else 7 / 2**20
    assert ecu.speed / 2**20 == pytest.approx(expected, abs=2e-6)


def test_each_frame_brings_its_own_signals_anew(firmware):
    car = Car(firmware, calibration())
    car.drive(4)
    assert car.ecu.fresh[RX_IMU] == FIRST_FRAME | 7
    car.drive(1, drop={YAW})
    assert car.ecu.fresh[RX_IMU] == FIRST_FRAME | 3
    car.drive(1, drop={ACCEL, WHEELS})
    assert car.ecu.fresh == [4, 2, 0, 0, 0]
    assert (car.ecu.age[ACCEL], car.ecu.age[YAW]) == (1, 0)
    assert car.ecu.valid[RX_IMU] == 7


@pytest.mark.parametrize(
    ("drop", "mode", "valid", "late"),
    [
        ({YAW}, ACTIVE, (3, 3), 0),
        ({STEER}, DEGRADED, (7, 3), 1 << 1),
        ({WHEELS}, DEGRADED, (7, 3), 1 << 1),
        ({ACCEL}, SAFE, (7, 3), 1 << 0),
    ],
)
def test_a_frame_that_stays_away_takes_its_own_signals_with_it(firmware, drop, mode, valid, late):
    car = Car(firmware, calibration())
    car.drive(20)
    assert car.ecu.mode == ACTIVE and car.ecu.fault_active == 0
    car.drive(TIMEOUT, drop)
    assert car.ecu.mode == ACTIVE
    car.drive(1, drop)
    assert car.ecu.mode == mode
    assert (car.ecu.valid[RX_IMU], car.ecu.valid[RX_VEHICLE_MOTION]) == valid
    assert car.ecu.fault_active == late
    car.drive(20)
    assert car.ecu.mode == ACTIVE


def test_without_roll_rate_the_lateral_acceleration_must_not_be_late(tmp_path):
    table = MAP.replace('signals.ROLL_RATE = "roll_rate"\n', "")
    car = Car(of_bus(*files(tmp_path, table)), calibration(measurements=2))
    car.drive(TIMEOUT + 20, drop={ACCEL})
    assert car.ecu.mode not in (ACTIVE, DEGRADED)
    assert car.ecu.fault_active & 1


def test_a_signal_that_another_says_has_no_value_keeps_the_last(firmware):
    car = Car(firmware, calibration())
    car.drive(4)
    known = car.ecu.yaw_rate
    assert known == pytest.approx(np.radians(1) * 2**27, abs=2)
    for state, valid in ((0, 3), (2, 7), (3, 3), (1, 7)):
        car.drive(1, yaw_state=state)
        assert (car.ecu.valid[RX_IMU], car.ecu.yaw_rate) == (valid, known)


@pytest.mark.slow
@pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
def test_c_gives_the_states_of_python(firmware):
    traffic = ecu_traffic.random_traffic(5, 60, bus=firmware.bus)
    compare(firmware, calibration(), traffic)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('message = "YAW"', 'message = "ACCEL"', "unknown signal"),
        ('signals.ROLL_RATE = "roll_rate"\n', 'signals.ROLL_RATE = "yaw_rate"\n', "is mapped in"),
        ("signals.ANGLE", 'signals.COUNT = "motion_sample"\nsignals.ANGLE', "must be in WHEELS"),
        (
            'valid = "FL_OK"',
            'redundant = "FL_AGAIN"',
            "FL and FR are both mapped to speed; only plain signals",
        ),
        ("radius = 0.32", "radius = 0", "radius must be above 0"),
        ('field = "yaw_rate",', 'field = "yaw_rate", radius = 1,', "belongs to the speed"),
        ("codes = [1, 2]", "codes = []", "must be a list of raw codes"),
        ("codes = [1, 2]", "codes = [4]", "whole numbers 0 to 3, which YAW_STATE can be"),
        ("codes = [1, 2]", "codes = [0, 1, 2, 3]", "every code of YAW_STATE is valid"),
        ('{ signal = "YAW_STATE", codes = [1, 2] }', '"YAW_RATE"', "codes of itself"),
        ('{ signal = "YAW_STATE", codes = [1, 2] }', "1", "valid must be the name of a signal"),
        ('"bar[0]"', '{ field = "bar[0]", valid = "REAR" }', "applies to received signals only"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(tmp_path, old, new, word):
    assert old in MAP
    with pytest.raises(CanrollError, match=word) as caught:
        bus_map.load(*files(tmp_path, MAP.replace(old, new)))
    assert "\n" not in str(caught.value)


def test_a_frame_is_in_a_message_once(tmp_path):
    table = MAP + '\n[[receive.imu]]\nmessage = "YAW"\nsignals.YAW_STATE = "rate_sample"\n'
    with pytest.raises(CanrollError, match="YAW is there twice"):
        bus_map.load(*files(tmp_path, table))


def test_second_codes_are_in_one_frame_of_a_message(tmp_path):
    table = MAP.replace('"steering"', '{ field = "steering", redundant = "ANGLE_AGAIN" }')
    assert len(bus_map.load(*files(tmp_path, table)).received) == 7
    both = table.replace('valid = "FL_OK"', 'redundant = "FL_AGAIN"')
    both = both.replace('signals.FR = { field = "speed", radius = 0.32, valid = "FR_OK" }', "")
    with pytest.raises(CanrollError, match="must be in one frame, not in WHEELS and STEER"):
        bus_map.load(*files(tmp_path, both))


@pytest.mark.parametrize(
    ("limits", "codes"),
    [
        ("[0|65535]", (0, 1023)),
        ("[-125|131]", (0, 1023)),
        ("[-100|100]", (100, 900)),
        ("[0|130.75]", (500, 1023)),
        ("[0|0]", (0, 1023)),
    ],
)
def test_limits_that_no_code_reaches_limit_nothing(tmp_path, limits, codes):
    paths = files(tmp_path)
    text = DBC.replace("(0.25,-125) [0|0]", f"(0.25,-125) {limits}")
    paths[0].write_text(text, encoding="utf-8")
    (signal,) = bus_map.load(*paths).received[YAW].signals
    assert (signal.raw_lo, signal.raw_hi) == codes


STATUS = """
[[receive.actuator_state]]
message = "MOMENTS"
signals.FRONT = "delivered[0]"
signals.REAR = "delivered[1]"

[[receive.actuator_state]]
message = "CORNERS"
signals.STATE = "status[0]"
"""
MOMENTS, CORNERS = 3, 7


@pytest.mark.parametrize("lost", [MOMENTS, CORNERS])
def test_a_frame_of_states_alone_is_missed_too(tmp_path, lost):
    cal = calibration()
    cal.timeout_ticks = [TIMEOUT, TIMEOUT, 0, TIMEOUT, 0]
    car = Car(of_bus(*files(tmp_path, MAP + STATUS)), memory_image.sealed(cal))
    frames = {
        MOMENTS: frame("MOMENTS", FRONT=1, REAR=1),
        CORNERS: frame("CORNERS", STATE=0, MANY=0),
    }
    for tick in range(60):
        for number, payload in frames.items():
            if number != lost or tick < 30:
                car.firmware.loop.receive(car.ecu, number, payload, 8)
        car.drive(1)
        if tick == 29:
            assert car.ecu.fault_active & 1 << 3 == 0
    assert car.ecu.fault_active & 1 << 3
    assert car.ecu.moment_unknown == 1


def test_a_frame_that_no_observer_asks_for_may_stay_away(tmp_path):
    table = MAP.replace('signals.ROLL_RATE = "roll_rate"\n', "")
    rate = '{ field = "roll_rate", unit = "deg/s" }'
    table += f'\n[[receive.imu]]\nmessage = "STEER"\nsignals.ANGLE_AGAIN = {rate}\n'
    firmware = of_bus(*files(tmp_path, table))
    # the frame with the roll rate is the first; it never comes
    assert firmware.bus.frames_of("imu")[0].name == "STEER"
    accel = next(k for k, box in enumerate(firmware.bus.received) if box.name == "ACCEL")
    cal = calibration(measurements=2)
    cal.timeout_ticks = [TIMEOUT, 1000, 0, 0, 0]
    ecu = firmware.record()
    assert firmware.loop.init(ecu, memory_image.sealed(cal)) == 0
    for _ in range(40):
        firmware.loop.receive(ecu, accel, frame("ACCEL", ACCEL_Y=0.5, ROLL_RATE=0, COUNT=0), 8)
        firmware.loop.tick(ecu, cal, 1)
    assert (ecu.mode, ecu.fault_active) == (DEGRADED, 0)


def test_further_frames_may_be_awaited_as_long_as_the_first(firmware):
    cal = calibration()
    cal.init_ticks = 20
    car = Car(firmware, memory_image.sealed(cal))
    car.drive(TIMEOUT + 15, drop={ACCEL, YAW, STEER, WHEELS})
    assert car.ecu.fault_latched == 0
    car.drive(25)
    assert car.ecu.mode == ACTIVE


def test_a_wide_sample_counter_goes_round_with_the_firmware_s(tmp_path):
    counter = 'signals.FL_AGAIN = { field = "motion_sample", unit = "" }'
    table = MAP.replace('message = "WHEELS"', f'message = "WHEELS"\n{counter}')
    firmware = of_bus(*files(tmp_path, table))
    ecu = firmware.record()
    unpacker = sys.modules[f"{firmware.loop.__package__}.com.signals"]
    payload = frame("WHEELS", FL=600, FR=600, FL_OK=1, FR_OK=1, FL_AGAIN=1.8)
    ecu.rx_payload[2 * WHEELS] = payload
    unpacker.unpack(ecu, WHEELS, 2 * WHEELS)
    assert ecu.motion_sample == 18 % 16


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('valid = "FR_OK"', 'valid = { signal = "FL_OK", codes = [0] }', "no code of FL_OK"),
        ('message = "BARS"', 'message = "BARS"\nid = 36', "is in several mailboxes|identifier"),
        ('signals.ANGLE = "steering"', "", "maps no signal of STEER"),
    ],
)
def test_frames_that_contradict_each_other_are_refused(tmp_path, old, new, word):
    with pytest.raises(CanrollError, match=f"(?:{word})"):
        bus_map.load(*files(tmp_path, MAP.replace(old, new)))


def test_a_sent_signal_keeps_the_limit_that_it_can_reach(tmp_path):
    paths = files(tmp_path)
    text = DBC.replace("SG_ FRONT : 0|16@1- (1,0) [0|0]", "SG_ FRONT : 0|16@1- (1,0) [-90000|500]")
    paths[0].write_text(text, encoding="utf-8")
    (front, _) = bus_map.load(*paths).transmitted[1].signals
    assert (front.raw_lo, front.raw_hi) == (-(1 << 15), 500)
