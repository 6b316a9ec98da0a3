"""Multiplexed frames of a user's bus: the page received, the page sent, what is refused."""

import re

import numpy as np
import pytest
from cantools.database import load_string
from support.replays import compare

from canroll.codegen.generated import bus_map
from canroll.codegen.run import ecu_traffic, memory_image, native
from canroll.codegen.run.bus_firmware import of_bus
from canroll.errors import CanrollError

DBC = """VERSION ""
NS_ :
BS_:
BU_: Ecu Car
BO_ 160 Imu: 6 Car
 SG_ Which M : 6|3@0+ (1,0) [0|7] "" Ecu
 SG_ Rate m2 : 8|16@1- (0.01,0) [-300|300] "deg/s" Ecu
 SG_ Lateral m2 : 24|16@1- (0.002,0) [-60|60] "m/s2" Ecu
 SG_ Yaw m5 : 8|16@1- (0.01,0) [-300|300] "deg/s" Ecu
 SG_ Temperature m1 : 8|8@1- (1,0) [-100|100] "" Ecu
BO_ 200 Force: 7 Ecu
 SG_ Page M : 48|8@1+ (1,0) [0|255] "" Car
 SG_ Left m3 : 0|16@1- (0.5,0) [-8000|8000] "N" Car
 SG_ Right m3 : 16|16@1- (0.5,0) [-8000|8000] "N" Car
 SG_ Other m4 : 0|16@1- (1,0) [-8000|8000] "N" Car
BO_ 201 Faults: 8 Ecu
 SG_ Part M : 0|4@1+ (1,0) [0|15] "" Car
 SG_ Active m1 : 8|24@1+ (1,0) [0|0] "" Car
 SG_ Count0 m4 : 8|8@1+ (1,0) [0|255] "" Car
 SG_ Count1 m9 : 8|8@1+ (1,0) [0|255] "" Car
 SG_ Top : 63|1@1+ (1,0) [0|1] "" Car
"""
MAP = """schema = 1
[receive.imu]
message = "Imu"
signals.Rate = "roll_rate"
signals.Lateral = "lateral_acceleration"
[transmit.suspension_force]
message = "Force"
signals.Left = "force[0]"
signals.Right = "force[1]"
[transmit.diagnostics]
message = "Faults"
signals.Active = "fault_active"
signals.Count0 = "fault_count[16]"
signals.Count1 = "fault_count[17]"
signals.Top = "lateral_lost"
"""
DATABASE = load_string(DBC, "dbc")


def files(tmp_path, dbc=DBC, table=MAP):
    (tmp_path / "car.dbc").write_text(dbc)
    (tmp_path / "car.toml").write_text(table)
    return tmp_path / "car.dbc", tmp_path / "car.toml"


@pytest.fixture
def firmware(tmp_path):
    """The firmware on this bus."""
    return of_bus(*files(tmp_path))


def calibration():
    cal = ecu_traffic.random_calibration(3)
    cal.observer, cal.actuator, cal.law, cal.compensator_outputs, cal.e2e = 1, 0, 0, 1, 0
    cal.timeout_ticks, cal.status_ticks = [5, 5, 0, 0, 0], 1
    return memory_image.sealed(cal)


def imu(page, **values):
    return list(DATABASE.encode_message("Imu", {"Which": page, **values}))


def test_a_received_page_is_taken_and_every_other_passed_by(firmware):
    loop, cal, ecu = firmware.loop, calibration(), firmware.record()
    assert loop.init(ecu, cal) == 0
    for k in range(40):
        # the wanted page is never the last frame before a tick
        wanted = imu(2, Rate=k - 20.0, Lateral=0.5 * k)
        for payload in (wanted, imu(5, Yaw=200.0), imu(1, Temperature=20)):
            loop.receive(ecu, 0, payload, 6)
        loop.tick(ecu, cal, 1)
        assert ecu.roll_rate / 2**27 == pytest.approx(np.radians(k - 20.0), abs=1e-6)
        assert ecu.lateral_acceleration / 2**24 == pytest.approx(0.5 * k, abs=1e-6)
        assert (ecu.valid[0], ecu.age[0]) == (3, 0)
    before = ecu.roll_rate
    for k in range(3):
        loop.receive(ecu, 0, imu(5, Yaw=100.0), 6)
        loop.tick(ecu, cal, 1)
        assert ecu.roll_rate == before
        assert ecu.age[0] == k + 1


def test_a_page_sent_carries_its_selector(firmware):
    loop, cal, ecu = firmware.loop, calibration(), firmware.record()
    assert loop.init(ecu, cal) == 0
    ecu.force = [100 << 14, -100 << 14, 0, 0]
    firmware.module("com.signals").pack(ecu, 0)
    decoded = DATABASE.decode_message("Force", bytes(ecu.tx_payload[0][:7]))
    assert decoded == {"Page": 3, "Left": 100.0, "Right": -100.0}


def test_diagnostics_send_their_pages_in_turn(firmware):
    loop, cal, ecu = firmware.loop, calibration(), firmware.record()
    assert loop.init(ecu, cal) == 0
    seen = []
    for k in range(7):
        ecu.fault_count[16], ecu.fault_count[17], ecu.fault_active = 20, 30, 1 << 16
        ecu.lateral_lost = k & 1
        firmware.module("com.signals").pack(ecu, 5)
        decoded = DATABASE.decode_message("Faults", bytes(ecu.tx_payload[5]))
        assert decoded.pop("Top") == k & 1
        seen.append(decoded)
        ecu.diagnostics_page = (ecu.diagnostics_page + 1) % firmware.module("com.signals").PAGES
    turn = [
        {"Part": 1, "Active": 1 << 16},
        {"Part": 4, "Count0": 20},
        {"Part": 9, "Count1": 30},
    ]
    assert seen == (3 * turn)[:7]


def test_the_loop_turns_the_pages_of_this_bus(firmware):
    loop, cal, ecu = firmware.loop, calibration(), firmware.record()
    assert loop.init(ecu, cal) == 0
    pages = []
    for _ in range(6):
        loop.tick(ecu, cal, 1)
        pages.append(ecu.tx_payload[5][0] & 15)
    assert pages == [1, 4, 9, 1, 4, 9]


@pytest.mark.slow
@pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
def test_c_gives_the_bytes_of_python(firmware):
    traffic = ecu_traffic.random_traffic(3, 60, bus=firmware.bus)
    compare(firmware, calibration(), traffic)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        (
            'signals.Lateral = "lat',
            'signals.Yaw = "yaw_rate"\nsignals.Lateral = "lat',
            "pages 2, 5",
        ),
        ('signals.Right = "force[1]"', 'signals.Other = "force[1]"', "map the signals of one page"),
        ("signals.Left", 'signals.Page = "mode"\nsignals.Left', "Page is the selector"),
        (
            'signals.Left = "force[0]"\nsignals.Right = "force[1]"\n',
            "",
            "Force is multiplexed: map a signal of the page",
        ),
    ],
)
def test_a_map_of_too_many_pages_is_refused(tmp_path, old, new, word):
    assert old in MAP
    paths = files(tmp_path, table=MAP.replace(old, new, 1))
    with pytest.raises(CanrollError, match=re.escape(word)) as caught:
        bus_map.load(*paths)
    assert "\n" not in str(caught.value)
    assert "car.toml [" in str(caught.value)


EXTENDED = """VERSION ""
NS_ :
BS_:
BU_: Ecu Car
BO_ 160 Imu: 6 Car
 SG_ Which M : 0|3@1+ (1,0) [0|7] "" Ecu
 SG_ Rate m2 : 8|16@1- (0.01,0) [-300|300] "deg/s" Ecu
 SG_ Lateral : 24|16@1- (0.002,0) [-60|60] "m/s2" Ecu
 SG_ Inner {inner} : 40|4@1+ (1,0) [0|15] "" Ecu
 SG_ Deep m3 : 44|4@1- (1,0) [0|0] "deg/s" Ecu
SG_MUL_VAL_ 160 Rate Which {pages};
SG_MUL_VAL_ 160 Inner Which 1-1;
SG_MUL_VAL_ 160 Deep Inner 3-3;
"""


@pytest.mark.parametrize(
    ("inner", "pages", "signal"),
    [("m1", "2-2, 4-4", "Rate"), ("m1", "2-3", "Rate"), ("m1M", "2-2", "Deep")],
)
def test_extended_multiplexing_is_refused_in_one_line(tmp_path, inner, pages, signal):
    text = EXTENDED.format(inner=inner, pages=pages)
    table = MAP[: MAP.index("[transmit.")].replace("Rate", signal)
    with pytest.raises(CanrollError, match="Imu has extended multiplexing") as caught:
        bus_map.load(*files(tmp_path, text, table))
    assert "\n" not in str(caught.value)


def test_signals_beside_extended_multiplexing_are_received(tmp_path):
    """On a page of the first selector, or on all pages."""
    text = EXTENDED.format(inner="m1M", pages="2-2")
    table = MAP[: MAP.index("[transmit.")]
    assert bus_map.load(*files(tmp_path, text, table)).received[0].pages == (2,)
    alone = table.replace('signals.Rate = "roll_rate"\n', "")
    box = bus_map.load(*files(tmp_path, text, alone)).received[0]
    assert box.pages == () and box.selector is None


def test_extended_multiplexing_is_not_sent(tmp_path):
    text = EXTENDED.format(inner="m1M", pages="2-2")
    table = 'schema = 1\n[transmit.status]\nmessage = "Imu"\nsignals.Rate = "roll_rate"\n'
    with pytest.raises(CanrollError, match="Imu has extended multiplexing"):
        bus_map.load(*files(tmp_path, text, table))


def test_a_frame_of_simple_pages_is_taken_by_its_page(tmp_path):
    table = MAP[: MAP.index("[transmit.")]
    plain = EXTENDED.format(inner="m1", pages="2-2")
    assert bus_map.load(*files(tmp_path, plain, table)).received[0].pages == (2,)
