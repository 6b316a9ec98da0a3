"""The generated signals module against cantools, frame by frame and bit by bit."""

import math
import re
import tomllib

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from canroll import dbc
from canroll.codegen.export import bundle
from canroll.codegen.generated import bus_map, mailbox
from canroll.codegen.generated import frames as frame_source
from canroll.codegen.generated import protection as protection_source
from canroll.codegen.generated import signals as signal_source
from canroll.errors import CanrollError
from canroll.firmware.com import protection, signals
from canroll.firmware.state import Ecu

TO_SI = {
    "deg": math.pi / 180,
    "deg/s": math.pi / 180,
    "km/h": 1 / 3.6,
    "mm": 1e-3,
    "mm/s": 1e-3,
}
BUS = bus_map.load(signal_source.DBC, signal_source.MAP)


def place(text):
    name, _, rest = text.partition("[")
    return name, int(rest[:-1]) if rest else None


def put(ecu, text, value):
    name, index = place(text)
    if index is None:
        setattr(ecu, name, value)
    else:
        getattr(ecu, name)[index] = value


@pytest.mark.drift
def test_checked_in_module_is_what_the_dbc_says():
    assert signal_source.SIGNALS.read_text(encoding="utf-8") == signal_source.generate()
    checked_in = protection_source.PROTECTION.read_text(encoding="utf-8")
    assert checked_in == protection_source.generate()
    assert frame_source.FRAMES.read_text(encoding="utf-8") == frame_source.generate()


def test_tables_match_the_dbc():
    database = dbc.load()
    for boxes, ids, data_ids in (
        (BUS.received, signals.RX_IDS, protection.RX_DATA_IDS),
        (BUS.transmitted, signals.TX_IDS, protection.TX_DATA_IDS),
    ):
        for box, ident, data_id in zip(boxes, ids, data_ids, strict=True):
            message = database.get_message_by_frame_id(ident)
            assert message.name == box.name
            assert dbc.data_id(message) == data_id


@given(st.data())
def test_packed_frames_are_what_cantools_encodes(data):
    for slot, box in enumerate(BUS.transmitted):
        message = dbc.load().get_message_by_name(box.name)
        ecu = Ecu()
        expected = {}
        page = data.draw(st.integers(0, 4))
        for signal in box.signals:
            lo, hi = signal.place.lo, signal.place.hi
            value = data.draw(st.integers(lo, hi) | st.sampled_from([lo, hi, 0]))
            if signal.page is not None and signal.page != page:
                continue
            put(ecu, signal.place.text, value)
            definition = message.get_signal_by_name(signal.name)
            unit = definition.unit
            physical = value / 2**signal.place.q / TO_SI.get(unit, 1)
            expected[signal.name] = min(max(physical, definition.minimum), definition.maximum)
        ecu.diagnostics_page = page
        if box.pages:
            expected["Page"] = page
        signals.pack(ecu, slot)
        got = message.decode(bytes(ecu.tx_payload[slot]), decode_choices=False)
        for name, physical in expected.items():
            step = message.get_signal_by_name(name).scale
            assert abs(got[name] - physical) <= step / 2 * (1 + 1e-6), name
        assert all(got[name] == 0 for name in got if name not in expected)


USER_DBC = """VERSION ""
NS_ :
BS_:
BU_: Ecu Car
BO_ 2566844672 Yaw: 6 Car
 SG_ Rate : 7|12@0- (0.1,-5) [-200|199] "deg/s" Ecu
 SG_ Lateral : 11|12@0+ (0.01,-20.48) [-20.48|20.45] "g" Ecu
VAL_ 2566844672 Lateral 4095 "SNA" ;
"""
USER_MAP = """schema = 1
[receive.imu]
message = "Yaw"
signals.Rate = "roll_rate"
signals.Lateral = { field = "lateral_acceleration", unavailable = [4094] }
"""


def user(tmp_path, dbc_text=USER_DBC, map_text=USER_MAP):
    (tmp_path / "user.dbc").write_text(dbc_text)
    (tmp_path / "user.toml").write_text(map_text)
    return tmp_path / "user.dbc", tmp_path / "user.toml"


def test_a_users_big_endian_bus_with_offsets_and_no_e2e(tmp_path):
    paths = user(tmp_path)
    namespace = {}
    exec(compile(signal_source.generate(*paths), "signals", "exec"), namespace)
    message = cantools.database.load_file(paths[0]).messages[0]
    assert namespace["RX_IDS"][0] == message.frame_id | mailbox.EXTENDED
    assert not bus_map.load(*paths).protected
    ecu = Ecu()
    for rate in (-200.0, -5.0, 0.0, 12.3, 199.0):
        for raw in (0, 2048, 4093, 4094, 4095):
            lateral = raw * 0.01 - 20.48
            payload = message.encode({"Rate": rate, "Lateral": lateral}, strict=False, scaling=True)
            ecu.rx_payload[0] = [*payload, 0, 0]
            before, sample = ecu.lateral_acceleration, ecu.imu_sample
            namespace["unpack"](ecu, 0, 0)
            assert ecu.roll_rate / 2**27 == pytest.approx(math.radians(rate), abs=1e-7)
            assert ecu.imu_sample == (sample + 1) % 16
            if raw >= 4094:
                assert ecu.lateral_acceleration == before
                assert ecu.valid[0] == 1
            else:
                exact = min(max(lateral * 9.80665, -64), 64)
                assert ecu.lateral_acceleration / 2**24 == pytest.approx(exact, abs=1e-6)
                assert ecu.valid[0] == 3
    ecu.valid[1] = 7
    namespace["unpack"](ecu, 1, 2)
    assert ecu.valid[1] == 0


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("schema = 1", "schema = 2", "schema must be 1"),
        ("[receive.imu]", "[receive.imus]", "did you mean 'imu'"),
        ('"Yaw"', '"Jaw"', "did you mean 'Yaw'"),
        ("signals.Rate", "signals.Rat", "did you mean 'Rate'"),
        ('"roll_rate"', '"roll_rte"', "did you mean 'roll_rate'"),
        ('"roll_rate"', '"speed"', "'deg/s' does not match speed"),
        ('"roll_rate"', '"stroke_rate"', "shape"),
        ('"roll_rate"', '"stroke_rate[4]"', "4 elements"),
        ('"roll_rate"', '"roll_rate + 1"', "field & mask"),
        ('"roll_rate"', '"status[0] & 1"', "deg/s"),
    ],
)
def test_a_wrong_map_is_named(tmp_path, old, new, word):
    paths = user(tmp_path, map_text=USER_MAP.replace(old, new, 1))
    with pytest.raises(CanrollError, match=re.escape(word)) as caught:
        signal_source.generate(*paths)
    assert "user.toml" in str(caught.value)


UNUSED = {"LongitudinalAcceleration"}
SELECTORS = {"Page"}


def test_map_covers_every_signal_but_the_e2e_header_and_what_the_loop_has_no_use_for():
    document = tomllib.loads(signal_source.MAP.read_text(encoding="utf-8"))
    for direction in ("receive", "transmit"):
        for table in document[direction].values():
            message = dbc.load().get_message_by_name(table["message"])
            names = {signal.name for signal in message.signals} - {"Checksum", "Counter"}
            names -= UNUSED | SELECTORS
            assert set(table["signals"]) == names


TOP_DBC = """VERSION ""
NS_ :
BS_:
BU_: Ecu Car
BO_ 100 Corners: 8 Car
 SG_ Stuck : 63|1@1+ (1,0) [0|1] "" Ecu
 SG_ Held : {held} (1,0) [0|1] "" Ecu
 SG_ Front : 0|16@1- (1,0) [-8000|8000] "Nm" Ecu
BO_ 101 Status: 8 Ecu
 SG_ Lost : 63|1@1+ (1,0) [0|1] "" Car
 SG_ Mode : {mode} (1,0) [0|3] "" Car
"""
TOP_MAP = """schema = 1
[receive.actuator_state]
message = "Corners"
signals.Stuck = "enabled"
signals.Held = "command_held"
signals.Front = "delivered[0]"
[transmit.status]
message = "Status"
signals.Lost = "lateral_lost"
signals.Mode = "mode"
"""


@pytest.mark.parametrize(("held", "mode"), [("62|1@1+", "61|2@1+"), ("56|1@0+", "57|2@0+")])
def test_a_signal_at_bit_63(tmp_path, held, mode):
    paths = user(tmp_path, TOP_DBC.format(held=held, mode=mode), TOP_MAP)
    namespace = {}
    exec(compile(signal_source.generate(*paths), "signals", "exec"), namespace)
    # nor does the emitter have anything against it
    assert "canroll_signals.c" in bundle.sources(*paths)
    corners, status = cantools.database.load_file(paths[0]).messages
    ecu = Ecu()
    for k in range(4):
        values = {"Stuck": k & 1, "Held": k >> 1, "Front": -8000}
        ecu.rx_payload[6] = list(corners.encode(values))
        namespace["unpack"](ecu, 3, 6)
        assert (ecu.enabled, ecu.command_held) == (k & 1, k >> 1)
        assert ecu.delivered[0] == -8000 << 14
        ecu.lateral_lost, ecu.mode = k & 1, k
        namespace["pack"](ecu, 4)
        assert status.decode(bytes(ecu.tx_payload[4])) == {"Lost": k & 1, "Mode": k}
