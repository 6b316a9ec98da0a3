"""What a map says where the DBC is silent or wrong: unit, scale, sign, second signals."""

import math
import re

import cantools
import pytest
from cantools.database import Message
from hypothesis import given
from hypothesis import strategies as st

from canroll.codegen.export import bundle
from canroll.codegen.generated import bus_map
from canroll.codegen.generated import signals as signal_source
from canroll.errors import CanrollError
from canroll.firmware.state import DISAGREES, Ecu

# overlapping, as the public DBCs of real cars often are: strict reading refuses it
DBC = """VERSION ""
NS_ :
BS_:
BU_: Ecu Car
BO_ 100 Motion: 8 Car
 SG_ Rate : 0|14@1+ (0.01,0) [0|163.82] "Unit_Turn" Ecu
 SG_ RateSign : 14|1@1+ (1,0) [0|1] "" Ecu
 SG_ Lateral : 16|12@1- (1,0) [0|0] "" Ecu
 SG_ Yaw : 28|12@1- (0.1,0) [0|0] "deg/s" Ecu
 SG_ YawInverted : 40|12@1- (0.1,0) [0|0] "deg/s" Ecu
 SG_ YawAgain : 52|12@1- (0.1,0) [0|0] "deg/s" Ecu
 SG_ Overlapping : 8|16@1+ (1,0) [0|0] "" Ecu
BO_ 101 Forces: 8 Ecu
 SG_ Left : 0|15@1+ (0.5,0) [0|4000] "N" Car
 SG_ LeftSign : 15|1@1+ (1,0) [0|1] "" Car
 SG_ Right : 16|16@1- (1,0) [0|0] "N" Car
 SG_ RightInverted : 32|16@1- (1,0) [0|0] "N" Car
 SG_ Clash : 30|4@1+ (1,0) [0|0] "" Car
BO_ 102 Short: 2 Car
 SG_ Beyond : 12|8@1+ (1,0) [0|0] "deg/s" Ecu
"""
MAP = """schema = 1
[receive.imu]
message = "Motion"
signals.Rate = { field = "roll_rate", unit = "deg/s", sign = "RateSign", unavailable = [16383] }
signals.Lateral = { field = "lateral_acceleration", unit = "g", factor = -0.001, offset = 0.5 }
signals.Yaw = { field = "yaw_rate", sign = -1, SECOND }
[transmit.suspension_force]
message = "Forces"
signals.Left = { field = "force[0]", sign = "LeftSign" }
signals.Right = { field = "force[1]", inverted = "RightInverted" }
"""
SECOND = {
    "inverted": 'inverted = "YawInverted"',
    "redundant": 'redundant = "YawAgain"',
    "tolerant": 'redundant = "YawAgain", tolerance = 0.35',
}


def files(folder, second="inverted", text=MAP):
    (folder / "car.dbc").write_text(DBC)
    (folder / "car.toml").write_text(text.replace("SECOND", SECOND[second]))
    return folder / "car.dbc", folder / "car.toml"


@pytest.fixture(scope="module", params=SECOND)
def car(request, tmp_path_factory):
    """Return the second signal's kind, the module generated for it, and the frames."""
    paths = files(tmp_path_factory.mktemp("car"), request.param)
    namespace = {}
    exec(compile(signal_source.generate(*paths), "signals", "exec"), namespace)
    return request.param, namespace, cantools.database.load_file(paths[0], strict=False)


def apart(database, name, left_out):
    """Return a message without the signal that overlaps: cantools decodes none of overlapping."""
    message = database.get_message_by_name(name)
    signals = [signal for signal in message.signals if signal.name != left_out]
    return Message(message.frame_id, name, message.length, signals)


@given(payload=st.binary(min_size=8, max_size=8), alike=st.booleans())
def test_a_frame_is_taken_as_the_map_says(car, payload, alike):
    kind, module, database = car
    message = apart(database, "Motion", "Overlapping")
    raws = message.decode(payload, scaling=False)
    if alike:
        # most random codes disagree: make them agree
        word = int.from_bytes(payload, "little") & ((1 << 40) - 1)
        yaw = raws["Yaw"] & 0xFFF
        payload = (word | (yaw ^ 0xFFF) << 40 | yaw << 52).to_bytes(8, "little")
        raws = message.decode(payload, scaling=False)
    ecu = Ecu()
    ecu.roll_rate = ecu.yaw_rate = 1
    ecu.rx_payload[0] = list(payload)
    module["unpack"](ecu, 0, 0)
    if raws["Rate"] == 16383:
        assert ecu.roll_rate == 1 and not ecu.valid[0] & 1
    else:
        exact = math.radians(raws["Rate"] * 0.01) * (-1) ** raws["RateSign"]
        exact = min(max(exact, -8), 8)
        assert ecu.roll_rate / 2**27 == pytest.approx(exact, rel=3e-9, abs=1e-8)
    exact = (raws["Lateral"] * -0.001 + 0.5) * 9.80665
    assert ecu.lateral_acceleration / 2**24 == pytest.approx(exact, rel=3e-9, abs=1e-7)
    agrees = {
        "inverted": raws["Yaw"] == ~raws["YawInverted"],
        "redundant": raws["Yaw"] == raws["YawAgain"],
        "tolerant": abs(raws["Yaw"] - raws["YawAgain"]) <= 3,
    }[kind]
    assert bool(ecu.valid[0] & DISAGREES) != agrees == bool(ecu.valid[0] & 4)
    assert module["contradicted"](ecu) == (not agrees)
    exact = -math.radians(raws["Yaw"] * 0.1) if agrees else 2**-27
    assert ecu.yaw_rate / 2**27 == pytest.approx(exact, rel=3e-9, abs=1e-8)


@given(left=st.integers(-4090 << 14, 4090 << 14), right=st.integers(-4090 << 14, 4090 << 14))
def test_a_frame_is_sent_as_the_map_says(car, left, right):
    _, module, database = car
    ecu = Ecu()
    ecu.force[0], ecu.force[1] = left, right
    module["pack"](ecu, 0)
    raws = apart(database, "Forces", "Clash").decode(bytes(ecu.tx_payload[0]), scaling=False)
    sent = raws["Left"] * 0.5 * (-1) ** raws["LeftSign"]
    assert sent == pytest.approx(min(max(left / 2**14, -4000), 4000), abs=0.25)
    assert raws["Right"] == pytest.approx(right / 2**14, abs=0.5)
    assert raws["RightInverted"] == ~raws["Right"]


def test_the_emitter_takes_it(tmp_path):
    assert "contradicted" in bundle.sources(*files(tmp_path))["canroll_signals.c"]


def test_what_is_read_leniently_is_said(tmp_path):
    (warning,) = bus_map.load(*files(tmp_path)).warnings
    assert "car.dbc: read leniently:" in warning and "Motion" in warning


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('unit = "deg/s"', 'unit = "deg/h"', "did you mean 'deg/s'"),
        ('unit = "deg/s", ', "", "Unit_Turn"),
        ('unit = "g"', 'units = "g"', "did you mean 'unit'"),
        ('unit = "g"', 'unit = "deg"', "'deg' does not match lateral_acceleration"),
        ("factor = -0.001", "factor = 0", "factor is 0"),
        ("factor = -0.001", 'factor = "1"', "factor must be a number"),
        ("sign = -1", "sign = -2", "sign must be 1, -1"),
        ('sign = "RateSign"', 'sign = "Yaw"', "a sign must have one"),
        ('sign = "RateSign"', 'sign = "Sign"', "unknown signal"),
        ('sign = "RateSign"', 'sign = "RateSign", offset = 1', "offset 0"),
        ("sign = -1", 'sign = "RateSign"', "is signed"),
        ("SECOND", 'inverted = "Lateral"', "must have the scale of Yaw"),
        ("SECOND", 'inverted = "Rate"', "must have the length of Yaw"),
        ("SECOND", 'inverted = "Yaw"', "its own inverted signal"),
        ("SECOND", 'inverted = "YawAgain", redundant = "YawInverted"', "give either"),
        ("SECOND", "tolerance = 1", "needs redundant or inverted"),
        ("unavailable = [16383]", "unavailable = 16383", "a list of raw codes"),
        ('"roll_rate"', '"roll_rate", q = 20', "q of roll_rate is fixed"),
        ('inverted = "RightInverted"', 'sign = "RightInverted"', "a sign must have one"),
        ("signals.Right", 'signals.Clash = "mode"\nsignals.Right', "share bit 30"),
        ('"Motion"', '["Motion"]', "unknown message in"),
        ("[receive.imu]", "receive = 5\n[transmit.imu]", "receive must be a table"),
        ("[receive.imu]", "[receive]\nimu = 5\n[transmit.imu]", "[receive.imu] must be a table"),
        ("[receive.imu]", "[receive]\nimu = []\n[transmit.imu]", "[receive.imu]: has no frame"),
        ("[receive.imu]", "secoc = true\n[x]", "secoc must be a table"),
        (
            '"Motion"\n',
            '"Motion"\nsignals = 5\n[receive.vehicle_motion]\n',
            "signals must be a table",
        ),
        ('"Motion"\n', '"Motion"\nprotection = "1"\n', "protection must be a table"),
        (
            "[transmit.",
            '[receive.imu.protection]\nprofile = "own"\ncounter = { signal = {} }\n[transmit.',
            "unknown signal of Motion",
        ),
        (
            "[transmit.",
            '[receive.vehicle_motion]\nmessage = "Short"\n'
            'signals.Beyond = { field = "steering", unit = "deg" }\n[transmit.',
            "outside the 2 bytes",
        ),
    ],
)
def test_a_wrong_key_is_named(tmp_path, old, new, word):
    assert old in MAP
    paths = files(tmp_path, text=MAP.replace(old, new, 1))
    with pytest.raises(CanrollError, match=re.escape(word)) as caught:
        bus_map.load(*paths)
    assert "car.toml" in str(caught.value)
