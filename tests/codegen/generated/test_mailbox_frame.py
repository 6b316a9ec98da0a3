"""What a map says of a frame where the DBC lacks it or has it wrong."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from canroll.codegen.generated import bus_map
from canroll.codegen.generated import signals as signal_source
from canroll.codegen.generated.mailbox import EXTENDED
from canroll.errors import CanrollError
from canroll.firmware.state import Ecu

DBC = """VERSION ""
BU_: Ecu Car
BO_ 100 Motion: 8 Car
 SG_ Rate : 0|16@1- (0.01,0) [0|0] "deg/s" Ecu
 SG_ Twice : 16|8@1- (0.01,0) [0|0] "deg/s" Ecu
 SG_ Twice : 24|8@1- (0.01,0) [0|0] "deg/s" Ecu
BO_ 101 Wheels: 8 Car
 SG_ Speed : 0|16@1+ (0.01,0) [0|0] "km/h" Ecu
BO_ 102 Long: 32 Car
 SG_ Last : 240|16@1- (0.01,0) [0|0] "deg/s" Ecu
BO_ 103 Empty: 0 Car
 SG_ Nothing : 0|8@1- (0.01,0) [0|0] "deg/s" Ecu
BO_ 104 Same: 8 Car
 SG_ Rate : 0|16@1- (0.01,0) [0|0] "deg/s" Ecu
BO_ 104 Other: 8 Car
 SG_ Speed : 0|16@1+ (0.01,0) [0|0] "km/h" Ecu
BO_ 105 Named: 8 Car
 SG_ Rate : 0|16@1- (0.01,0) [0|0] "deg/s" Ecu
BO_ 106 Named: 8 Car
 SG_ Rate : 0|16@1- (0.01,0) [0|0] "deg/s" Ecu
"""


def load(folder, message="Motion", more="", signal="Rate", rest=""):
    (folder / "car.dbc").write_text(DBC)
    table = f'schema = 1\n[receive.imu]\nmessage = "{message}"\n{more}\n'
    (folder / "car.toml").write_text(f'{table}signals.{signal} = "roll_rate"\n{rest}')
    return bus_map.load(folder / "car.dbc", folder / "car.toml")


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ("", (100, 8, False, 0)),
        ("id = 0x123", (0x123, 8, False, 0)),
        ("id = 0x12345", (0x12345 | EXTENDED, 8, False, 0)),
        ("id = 5\nextended = true", (5 | EXTENDED, 8, False, 0)),
        ("extended = true", (100 | EXTENDED, 8, False, 0)),
        ("fd = true", (100, 8, True, 0)),
        ("bytes = 3", (100, 3, False, 0)),
        ("fd = true\nbytes = 24", (100, 24, True, 0)),
        ("period_ms = 20", (100, 8, False, 20)),
        ("cycle_ms = 30", (100, 8, False, 30)),
        ("period_ms = 12.5", (100, 8, False, 12.5)),
    ],
)
def test_a_map_says_of_a_frame_what_the_dbc_lacks(tmp_path, more, expected):
    box = load(tmp_path, more=more).received[0]
    assert (box.ident, box.length, box.fd, box.cycle_ms) == expected


def test_a_long_frame_without_its_format_is_one_of_can_fd(tmp_path):
    box = load(tmp_path, "Long", "fd = true", "Last").received[0]
    assert (box.length, box.fd, box.bit_rate_switch) == (32, True, True)


def test_an_empty_message_has_the_bytes_that_the_map_gives(tmp_path):
    assert load(tmp_path, "Empty", "bytes = 1", "Nothing").received[0].length == 1


@pytest.mark.parametrize(
    ("message", "more", "signal", "words"),
    [
        ("Long", "", "Last", "32 bytes but is not a CAN FD frame: give fd = true in the map"),
        ("Long", "fd = false", "Last", "is not a CAN FD frame"),
        ("Empty", "", "Nothing", "Empty has 0 bytes, which carry no signal"),
        ("Motion", "bytes = 1", "Rate", "Rate has bits outside the 1 bytes"),
        ("Motion", "bytes = 65", "Rate", "bytes must be a whole number up to 64, not 65"),
        ("Motion", "bytes = true", "Rate", "bytes must be a whole number"),
        ("Motion", "fd = 1", "Rate", "fd must be true or false, not 1"),
        ("Motion", "id = 0x20000000", "Rate", "id must be a whole number up to 536870911"),
        ("Motion", "id = 0x800\nextended = false", "Rate", "0x800 in 11 bits: give extended"),
        ("Motion", "period_ms = 20000", "Rate", "period_ms must be a number from 1 to 10000"),
        ("Motion", "period_ms = 2\ncycle_ms = 2", "Rate", "give one of them"),
        ("Same", "", "Rate", "Same and Other have the identifier 0x68: give that of Same as id"),
        ("Named", "", "Rate", "2 messages are named Named: rename all but one"),
        ("Motion", "", "Twice", "2 signals of Motion are named Twice: rename all but one"),
        ("Motien", "", "Rate", "did you mean 'Motion'"),
    ],
)
def test_what_no_frame_can_be_is_refused_by_its_place(tmp_path, message, more, signal, words):
    with pytest.raises(CanrollError, match=r"car\.toml") as refused:
        load(tmp_path, message, more, signal)
    assert words in str(refused.value) and "[receive.imu]" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_an_identifier_of_two_messages_is_that_of_the_one_that_the_map_gives_it(tmp_path):
    assert load(tmp_path, "Same", "id = 104").received[0].ident == 104


def test_two_mailboxes_may_not_give_two_messages_one_identifier(tmp_path):
    rest = '[receive.vehicle_motion]\nmessage = "Wheels"\nid = 100\nsignals.Speed = "speed"\n'
    with pytest.raises(CanrollError, match="Motion and Wheels have the identifier 0x64"):
        load(tmp_path, rest=rest)


@pytest.mark.parametrize(("ident", "free"), [("0x123", False), ("0x80000123", True)])
def test_a_service_may_not_have_the_identifier_that_a_map_gives_a_frame(tmp_path, ident, free):
    rest = f"[uds]\nrequest = {ident}\nresponse = 0x7E8\n"
    if free:
        assert load(tmp_path, more="id = 0x123", rest=rest).uds.request == 0x80000123
        return
    with pytest.raises(CanrollError, match=r"\[uds\]: request 0x123 is the identifier of Motion"):
        load(tmp_path, more="id = 0x123", rest=rest)


def test_defects_of_frames_that_are_not_used_are_no_error(tmp_path):
    (warning,) = load(tmp_path).warnings
    assert "Same and Other have the identifier 0x68" in warning


@pytest.mark.parametrize(("message", "signal"), [("Motion", "Bad"), ("Gone", "Rate")])
def test_what_cannot_be_read_is_refused_by_its_line(tmp_path, message, signal):
    broken = DBC.replace("BO_ 101", " SG_ Bad : 0|x@1\nBO_ 107 Gone: \nBO_ 101", 1)
    (tmp_path / "car.dbc").write_text(broken)
    table = f'schema = 1\n[receive.imu]\nmessage = "{message}"\nsignals.{signal} = "roll_rate"\n'
    (tmp_path / "car.toml").write_text(table)
    with pytest.raises(CanrollError, match=r"car\.dbc: (Bad|Gone) cannot be read: line [78] \("):
        bus_map.load(tmp_path / "car.dbc", tmp_path / "car.toml")


OVERLAID = """VERSION ""
BU_: Ecu Car
BO_ 100 State: 4 Car
 SG_ Status : 0|8@1+ (1,0) [0|0] "" Ecu
 SG_ Flag : 0|1@1+ (1,0) [0|1] "" Ecu
 SG_ Held : 1|1@1+ (1,0) [0|1] "" Ecu
 SG_ Front : 8|16@1- (1,0) [0|0] "Nm" Ecu
 SG_ Real : 0|32@1- (1,0) [0|0] "Nm" Ecu
BO_ 101 Double: 8 Car
 SG_ Precise : 0|64@1- (1,0) [0|0] "Nm" Ecu
SIG_VALTYPE_ 100 Real : 1;
SIG_VALTYPE_ 101 Precise : 2;
"""


def overlaid(folder, table):
    (folder / "car.dbc").write_text(OVERLAID)
    (folder / "car.toml").write_text(f"schema = 1\n{table}")
    return folder / "car.dbc", folder / "car.toml"


@given(payload=st.binary(min_size=4, max_size=4))
def test_a_byte_and_the_bits_that_overlay_it_are_both_read(state, payload):
    ecu = Ecu()
    ecu.rx_payload[3] = [*payload, 0, 0, 0, 0]
    state["unpack"](ecu, 3, 3)
    assert ecu.accepted_counter == payload[0]
    assert (ecu.enabled, ecu.command_held) == (payload[0] & 1, payload[0] >> 1 & 1)


@pytest.fixture(scope="module")
def state(tmp_path_factory):
    """Return the module generated for a frame with a byte overlaid by its bits."""
    table = """[receive.actuator_state]
message = "State"
signals.Front = "delivered[0]"
signals.Status = "accepted_counter"
signals.Flag = "enabled"
signals.Held = "command_held"
"""
    namespace = {}
    paths = overlaid(tmp_path_factory.mktemp("overlaid"), table)
    exec(compile(signal_source.generate(*paths), "signals", "exec"), namespace)
    return namespace


def test_a_byte_and_a_bit_that_overlays_it_are_not_both_sent(tmp_path):
    table = '[transmit.status]\nmessage = "State"\nsignals.Status = "mode"\n'
    assert bus_map.load(*overlaid(tmp_path, table)).transmitted[4].name == "State"
    with pytest.raises(CanrollError, match=r"Flag and Status share bit 0"):
        bus_map.load(*overlaid(tmp_path, f'{table}signals.Flag = "lateral_lost"\n'))


def test_a_float_of_double_precision_is_refused_by_its_name(tmp_path):
    table = '[receive.actuator_state]\nmessage = "State"\nsignals.Real = "delivered[0]"\n'
    assert bus_map.load(*overlaid(tmp_path, table)).received[3].signals[0].real
    table = table.replace("State", "Double").replace("Real", "Precise")
    with pytest.raises(CanrollError, match=r"Precise is a floating-point number of 64 bits"):
        bus_map.load(*overlaid(tmp_path, table))
