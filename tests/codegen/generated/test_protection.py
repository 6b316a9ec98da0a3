"""Checksums and counters of each frame: against autosar-e2e, in Python and in C, on any bus."""

import re
import types

import numpy as np
import pytest
from cantools.database import load_string
from e2e import p01, p02, p04, p05, p06, p07, p11
from hypothesis import given
from hypothesis import strategies as st
from support.compiled_protection import CompiledProtection
from support.replays import replayed

from canroll.codegen.export import bundle
from canroll.codegen.frame.frame_protection import protection
from canroll.codegen.generated import bus_map
from canroll.codegen.generated import protection as protection_source
from canroll.codegen.proof.prove import prove
from canroll.codegen.run import bus_firmware, ecu_traffic, memory_image, native
from canroll.errors import CanrollError
from canroll.firmware.calibration import N_RX, Calibration
from canroll.firmware.com import e2e
from canroll.firmware.state import N_TX, Ecu

IDS = list(range(101, 117))
HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: Ecu Car\n'
DBC = (
    HEAD
    + """BO_ 160 Imu: 8 Car
 SG_ Checksum : 0|8@1+ (1,0) [0|255] "" Ecu
 SG_ Counter : 8|4@1+ (1,0) [0|14] "" Ecu
 SG_ Rate : 16|16@1- (0.01,0) [-300|300] "deg/s" Ecu
 SG_ Lateral : 32|16@1- (0.002,0) [-60|60] "m/s2" Ecu
BO_ 161 Motion: 6 Car
 SG_ Speed : 0|16@1+ (0.01,0) [0|300] "km/h" Ecu
 SG_ Angle : 16|16@1- (0.1,0) [-700|700] "deg" Ecu
BO_ 200 Force: 8 Ecu
 SG_ FrontLeft : 0|16@1- (0.5,0) [-8000|8000] "N" Car
 SG_ FrontRight : 16|16@1- (0.5,0) [-8000|8000] "N" Car
 SG_ RearLeft : 32|16@1- (0.5,0) [-8000|8000] "N" Car
 SG_ RearRight : 48|16@1- (0.5,0) [-8000|8000] "N" Car
BO_ 201 State: 5 Ecu
 SG_ Mode : 32|4@1+ (1,0) [0|15] "" Car
BA_DEF_ BO_ "E2EDataId" INT 0 65535;
BA_DEF_DEF_ "E2EDataId" 0;
BA_ "E2EDataId" BO_ 160 4660;
"""
)
MAP = """schema = 1
[receive.imu]
message = "Imu"
signals.Rate = "roll_rate"
signals.Lateral = "lateral_acceleration"
[receive.vehicle_motion]
message = "Motion"
signals.Speed = "speed"
signals.Angle = "steering"
[transmit.suspension_force]
message = "Force"
signals.FrontLeft = "force[0]"
signals.FrontRight = "force[1]"
signals.RearLeft = "force[2]"
signals.RearRight = "force[3]"
[transmit.status]
message = "State"
signals.Mode = "mode"
"""
LONG_DBC = DBC.replace("BO_ 201 State: 5", "BO_ 201 State: 32").replace("Mode : 32|", "Mode : 248|")
LONG_MAP = MAP + "fd = true\n"
PROTECTED_STATE = 'signals.Mode = "mode"\nprotection = '


PARTS = """ SG_ Low : 9|3@1+ (1,0) [0|7] "" Car
 SG_ High : 20|2@1+ (1,0) [0|3] "" Car
 SG_ Wide : 30|10@0+ (1,0) [0|1023] "" Car
"""


def with_parts(dbc, entry):
    """The DBC with signals in both frames that an entry of the map names."""
    if "signal" not in entry:
        return dbc
    for last in ('[0|15] "" Car\n', '"km/h" Ecu\n'):
        dbc = dbc.replace(last, last + PARTS)
    return dbc


def files(tmp_path, dbc=DBC, table=MAP):
    (tmp_path / "car.dbc").write_text(dbc)
    (tmp_path / "car.toml").write_text(table)
    return tmp_path / "car.dbc", tmp_path / "car.toml"


def frame(size, table, used=()):
    text = HEAD + f'BO_ 1 Frame: {size} Car\n SG_ Last : {8 * size - 1}|1@1+ (1,0) [0|1] "" Ecu\n'
    return protection(load_string(text, "dbc").messages[0], table, used, "map.toml")


payloads = st.binary(min_size=8, max_size=8)
sizes = st.integers(5, 8)
counts = st.integers(0, 14)


@given(payloads, sizes, st.integers(0, 0xFFFF), counts, st.integers(0, 3))
def test_profile_1_is_that_of_the_reference_library(payload, size, data_id, count, at):
    modes = {
        "both": p01.E2E_P01_DATAID_BOTH,
        "alternating": p01.E2E_P01_DATAID_ALT,
        "low": p01.E2E_P01_DATAID_LOW,
        "nibble": p01.E2E_P01_DATAID_NIBBLE,
    }
    for mode, theirs in modes.items():
        identity = data_id & 0xFFF if mode == "nibble" else data_id
        table = {"profile": 1, "data_id": identity, "data_id_mode": mode}
        table |= {"crc_offset": 8 * at, "counter_offset": 8 * at + 8}
        if mode == "nibble":
            table["data_id_nibble_offset"] = 8 * at + 12
        its = frame(size, table)
        ours = bytearray(payload[:size])
        its.apply(ours, count)
        expected = bytearray(ours)
        expected[at] ^= 0x5A
        p01.e2e_p01_protect(
            expected, identity, data_id_mode=theirs, offset=at, increment_counter=False
        )
        assert ours == expected, mode
        assert ours[at + 1] & 15 == count


@given(payloads, sizes, st.lists(st.integers(0, 255), min_size=16, max_size=16), counts)
def test_profiles_2_and_22_are_that_of_the_reference_library(payload, size, ids, count):
    ours = bytearray(payload[:size])
    frame(size, {"profile": 2, "data_id": ids}).apply(ours, count)
    expected = bytearray(ours)
    expected[0] ^= 0x5A
    p02.e2e_p02_protect(expected, bytes(ids), increment_counter=False)
    assert ours == expected
    # profile 22 is profile 2 at an offset: the library sees the header first, the rest in order
    for at in range(size - 1):
        moved = bytearray(payload[:size])
        frame(size, {"profile": 22, "data_id": ids, "offset": 8 * at}).apply(moved, count)
        turned = bytearray([0x5A, *moved[:at], *moved[at + 1 :]])
        p02.e2e_p02_protect(turned, bytes([ids[count]] * 16), increment_counter=False)
        assert moved[at] == turned[0]
        assert moved[at + 1] & 15 == count


@given(payloads, sizes, st.integers(0, 0xFFFF), st.integers(0, 255), st.integers(0, 2))
def test_profile_5_is_that_of_the_reference_library(payload, size, data_id, count, at):
    ours = bytearray(payload[:size])
    frame(size, {"profile": "E2E_P05", "data_id": data_id, "offset": 8 * at}).apply(ours, count)
    expected = bytearray(ours)
    expected[at] ^= 0x5A
    p05.e2e_p05_protect(expected, data_id, offset=at, increment_counter=False)
    assert ours == expected
    assert ours[at + 2] == count


wide = st.binary(min_size=64, max_size=64)


@given(wide, st.sampled_from([20, 32, 48, 64]), st.integers(0, 0xFFFFFFFF), st.data())
def test_profiles_4_6_and_7_are_those_of_the_reference_library(payload, size, data_id, data):
    for profile, bits, header, count, theirs in (
        (4, 32, 12, 16, p04.e2e_p04_protect),
        (6, 16, 5, 8, p06.e2e_p06_protect),
        (7, 32, 20, 30, p07.e2e_p07_protect),
    ):
        identity = data_id & (1 << bits) - 1
        at = data.draw(st.integers(0, size - header))
        number = data.draw(st.integers(0, (1 << count) - 1))
        ours = bytearray(payload[:size])
        its = frame(size, {"profile": profile, "data_id": identity, "offset": 8 * at})
        its.apply(ours, number)
        assert its.counter.read(ours) == number
        expected = bytearray(ours)
        theirs(expected, identity, length=size, offset=at, increment_counter=False)
        assert ours == expected, profile


@given(payloads, sizes, st.integers(0, 0xFFFF), counts, st.integers(0, 3))
def test_profile_11_is_that_of_the_reference_library(payload, size, data_id, count, at):
    for mode, theirs in (("both", p11.E2E_P11_DATAID_BOTH), ("nibble", p11.E2E_P11_DATAID_NIBBLE)):
        identity = data_id & 0xFFF if mode == "nibble" else data_id
        table = {"profile": 11, "data_id": identity, "data_id_mode": mode}
        table |= {"crc_offset": 8 * at, "counter_offset": 8 * at + 8}
        if mode == "nibble":
            table["data_id_nibble_offset"] = 8 * at + 12
        ours = bytearray(payload[:size])
        frame(size, table).apply(ours, count)
        expected = bytearray(ours)
        expected[at] ^= 0x5A
        p11.e2e_p11_protect(
            expected, identity, data_id_mode=theirs, offset=at, increment_counter=False
        )
        assert ours == expected, mode


def test_what_manufacturers_made_themselves():
    data = bytes.fromhex("00 35 12 99 40 07 c3 5a")
    cases = {
        "xor": (7, 0x35 ^ 0x12 ^ 0x99 ^ 0x40 ^ 0x07 ^ 0xC3 ^ 0x21),
        "sum": (7, (0x35 + 0x12 + 0x99 + 0x40 + 0x07 + 0xC3 + 0x21) & 255),
    }
    for method, (byte, expected) in cases.items():
        ours = bytearray(data)
        table = {"method": method, "byte": byte, "constant": 0x21}
        frame(8, {"profile": "own", "checksum": table}).apply(ours, 0)
        assert ours[byte] == expected, method
        assert ours[:byte] == data[:byte]


def over_the_digits(**table):
    """A checksum over the characters "123456789", as catalogues of CRCs give its check value."""
    table = {"byte": 0, "over": list(b"123456789")} | table
    its = frame(8, {"profile": "own", "checksum": table})
    return its.value(bytes(8), 0)


@pytest.mark.parametrize(
    ("width", "polynomial", "start", "end", "reflected", "check"),
    [
        (3, 0x3, 0, 0x7, False, 0x4),  # GSM
        (4, 0x3, 0xF, 0xF, False, 0xB),  # INTERLAKEN
        (5, 0x15, 0, 0, True, 0x07),  # G-704
        (8, 0x07, 0, 0, False, 0xF4),  # SMBUS
        (12, 0x80F, 0, 0, False, 0xF5B),  # DECT
        (15, 0x4599, 0, 0, False, 0x059E),  # CAN
        (16, 0x1021, 0xFFFF, 0xFFFF, True, 0x906E),  # IBM-SDLC
        (21, 0x102899, 0, 0, False, 0x0ED841),  # CAN-FD
        (24, 0x864CFB, 0xB704CE, 0, False, 0x21CF02),  # OPENPGP
        (32, 0x1EDC6F41, 0xFFFFFFFF, 0xFFFFFFFF, True, 0xE3069283),  # ISCSI
        (40, 0x4820009, 0, 0xFFFFFFFFFF, False, 0xD4164FC646),  # GSM
        (64, 0x42F0E1EBA9EA3693, 0, 0, False, 0x6C40DF5F0B497347),  # ECMA-182
    ],
)
def test_a_crc_by_numbers_has_its_published_check_value(  # noqa: PLR0917
    width, polynomial, start, end, reflected, check
):
    table = {"method": "crc", "width": width, "polynomial": polynomial}
    table |= {"start": start, "end": end, "reflect_in": reflected, "reflect_out": reflected}
    assert over_the_digits(**table) == check


def test_a_crc_may_be_reflected_at_its_end_alone():
    """CRC-12/UMTS."""
    table = {"method": "crc", "width": 12, "polynomial": 0x80F, "reflect_out": True}
    assert over_the_digits(**table) == 0xDAF


@pytest.mark.parametrize(
    ("method", "check"),
    [
        ("crc8_j1850", 0x4B),
        ("crc8_h2f", 0xDF),
        ("crc16_ccitt", 0x29B1),
        ("crc16_arc", 0xBB3D),
        ("crc32", 0xCBF43926),
        ("crc32_p4", 0x1697D06A),
        ("crc64", 0x995DC9BBDF1939FA),
    ],
)
def test_a_crc_by_name_has_its_published_check_value(method, check):
    width = int(re.match(r"crc(\d+)", method)[1])
    assert over_the_digits(method=method, width=width) == check


def own_sum(checksum, counter=""):
    return f'{{ profile = "own", checksum = {{ {checksum} }}{counter} }}'


def own_crc(place, polynomial, more, counter=""):
    more = f", {more}" if more else ""
    return own_sum(f'method = "crc", {place}, polynomial = {polynomial}{more}', counter)


REFLECTED = "start = 9, reflect_in = true, reflect_out = true"
TABLES = {
    "1": "{ profile = 1, data_id = 291 }",
    "1 alternating": '{ profile = 1, data_id = 291, data_id_mode = "alternating" }',
    "1 nibble": '{ profile = 1, data_id = 291, data_id_mode = "nibble" }',
    "1 elsewhere": "{ profile = 1, data_id = 291, crc_offset = 24, counter_offset = 20 }",
    "1 short": "{ profile = 1, data_id = 291, data_length = 24 }",
    "2": f"{{ profile = 2, data_id = {IDS} }}",
    "5": '{ profile = "5", data_id = 291 }',
    "5 elsewhere": '{ profile = "5", data_id = 291, offset = 8 }',
    "22": f"{{ profile = 22, data_id = {IDS}, offset = 16 }}",
    "own xor": '{ profile = "own", checksum = { method = "xor", byte = 0 } }',
    "own sum": '{ profile = "own", checksum = { method = "sum", byte = 1, constant = 9, '
    "end = 255 }, counter = { bit = 0, width = 2 } }",
    "own crc": '{ profile = "own", checksum = { method = "crc8", byte = 2, polynomial = 47, '
    f"start = 255, constant = {IDS} }}, counter = {{ bit = 8, values = 10 }} }}",
    "own counter": '{ profile = "own", counter = { bit = 0, width = 8 } }',
    "a counter across bytes": '{ profile = "own", counter = { bit = 3, width = 11 } }',
    "11": "{ profile = 11, data_id = 291 }",
    "11 nibble": '{ profile = 11, data_id = 291, data_id_mode = "nibble" }',
    "a counter of two signals": '{ profile = "own", counter = { signal = ["Low", "High"] }, '
    'checksum = { method = "xor", byte = 0 } }',
    "nibbles, negated": own_sum(
        'method = "sum", bit = 28, width = 4, unit = 4, start = 8, '
        'negate = true, over = ["id", "frame"]'
    ),
    "bits": own_sum('method = "sum", signal = ["Low", "High"], unit = 1, end = 9'),
    "ones' complement": own_sum('method = "sum", byte = 0, carry = true, end = 255'),
    "words": own_sum(
        'method = "sum", byte = 2, width = 16, order = "big", unit = 16, '
        'negate = true, over = ["bytes 0-1", "length", "bytes 4-3", 4660]'
    ),
    "wide words with a carry": own_sum(
        'method = "sum", byte = 0, width = 32, unit = 32, '
        'carry = true, over = ["bytes 3-0", 4294967295, "id"]'
    ),
    "the counter and a signal": own_sum(
        'method = "sum", byte = 0, start = 3, over = ["counter", { signal = "Wide" }]',
        ', counter = { signal = "Low" }',
    ),
    "xor of nibbles": own_sum('method = "xor", bit = 2, width = 4, unit = 4, end = 9'),
    "xor of words": own_sum(
        'method = "xor", byte = 0, width = 16, unit = 16, start = 291, '
        'over = ["bytes 2-3", "id", "length"]'
    ),
    "crc of 3 bits": own_crc("bit = 5, width = 3", 3, ""),
    "crc across bytes": own_crc("bit = 5, width = 12", 0x80F, "reflect_out = true"),
    "crc backwards": own_crc(
        "byte = 3", 0x1D, 'over = ["bytes 2-0", 7, { id = true, order = "big" }]'
    ),
    "crc of 5 bits, reflected": own_crc("bit = 0, width = 5", 0x15, REFLECTED),
    "crc of 8 bits, reflected": own_crc("byte = 1", 0x31, REFLECTED),
    "crc of 15 bits": own_crc("bit = 1, width = 15", 0x4599, "start = 77"),
    "crc 16": '{ profile = "own", checksum = { method = "crc16_ccitt", byte = 2, '
    'order = "big", width = 16, over = ["frame", "id"] } }',
    "crc 16, arc": '{ profile = "own", checksum = { method = "crc16_arc", byte = 0, width = 16 } }',
    "crc 24": own_crc("byte = 1, width = 24", 0x864CFB, "start = 11994318"),
    "crc 32": '{ profile = "own", checksum = { method = "crc32", byte = 0, width = 32 } }',
    "crc 32, straight": own_crc("byte = 0, width = 32", 0x04C11DB7, "end = 4294967295"),
}
LONG = {
    "4": "{ profile = 4, data_id = 3735928559, offset = 24 }",
    "5": "{ profile = 5, data_id = 291 }",
    "6": "{ profile = 6, data_id = 291, offset = 8 }",
    "7": "{ profile = 7, data_id = 3735928559 }",
    "sum": own_sum('method = "sum", byte = 1, over = ["id", "length", "bytes 30-2"]'),
    "nibbles": own_sum('method = "sum", byte = 1, unit = 4, carry = true'),
    "xor": own_sum('method = "xor", byte = 9, start = 7'),
    "crc 8": own_crc("byte = 0", 0x2F, f"constant = {IDS}", ", counter = { bit = 12 }"),
    "crc 40": own_crc("byte = 2, width = 40", 0x4820009, "end = 1099511627775"),
    "crc 40, reflected": own_crc("byte = 2, width = 40", 0x4820009, REFLECTED),
    "crc 40, half reflected": own_crc("byte = 2, width = 40", 0x4820009, "reflect_in = true"),
    "crc 33, reflected out": own_crc("bit = 2, width = 33", 0x4820009, "reflect_out = true"),
    "crc 64": own_crc('byte = 0, width = 64, order = "big"', 0x42F0E1EBA9EA3693, ""),
    "crc 64, turned": own_crc("byte = 0, width = 64", 0x42F0E1EBA9EA3693, "reflect_out = true"),
    "crc 32": '{ profile = "own", checksum = { method = "crc32", byte = 0, width = 32 } }',
}


@pytest.fixture(params=TABLES)
def state_protected(request, tmp_path):
    """A bus on which the status frame has five bytes and a protection."""
    entry = TABLES[request.param]
    table = MAP.replace('signals.Mode = "mode"\n', PROTECTED_STATE + entry)
    paths = files(tmp_path, with_parts(DBC, entry), table)
    return bus_map.load(*paths), paths


def module_of(text):
    module = types.ModuleType("generated")
    exec(compile(text, "generated", "exec"), module.__dict__)
    return module


@given(st.data())
def protected_alike(module, its, data):
    ecu = Ecu()
    payload = data.draw(st.binary(min_size=5, max_size=5))
    count = data.draw(st.integers(0, its.counter.values - 1)) if its.counter else 0
    ecu.tx_payload[4] = [*payload, 0, 0, 0]
    ecu.tx_counter[4] = count
    module.protect(ecu, 4)
    expected = bytearray(payload)
    its.apply(expected, count)
    assert ecu.tx_payload[4] == [*expected, 0, 0, 0]


def test_generated_protection_does_what_its_description_says(state_protected):
    bus, paths = state_protected
    protected_alike(module_of(protection_source.generate(*paths)), bus.transmitted[4].protection)


@pytest.mark.parametrize("name", TABLES)
def test_a_generated_receiver_takes_right_frames_only(tmp_path, name):
    table = MAP.replace(
        'signals.Speed = "speed"\n', f'signals.Speed = "speed"\nprotection = {TABLES[name]}\n'
    )
    dbc = DBC.replace("SG_ Speed : 0|16", "SG_ Speed : 32|16").replace(
        ' SG_ Angle : 16|16@1- (0.1,0) [-700|700] "deg" Ecu\n', ""
    )
    dbc = with_parts(dbc, TABLES[name])
    paths = files(tmp_path, dbc, table.replace('signals.Angle = "steering"\n', ""))
    firmware = bus_firmware.of_bus(*paths)
    module, e2e = firmware.module("com.protection"), firmware.module("com.e2e")
    its = firmware.bus.received[1].protection
    cal = Calibration()
    cal.e2e_max_delta, cal.e2e_sync, cal.e2e_max_repeated = [2] * N_RX, [0] * N_RX, [14] * N_RX
    ecu = firmware.record()
    ecu.e2e_last = [e2e.NO_COUNTER] * N_RX
    rng = np.random.default_rng(4)
    values = its.counter.values if its.counter else 16
    taken = 0
    rounds = 2 * min(values, 300) + 5
    for k in range(rounds):
        payload = bytearray(rng.integers(0, 256, 6).tolist())
        its.apply(payload, k % values)
        ecu.rx_payload[2] = [*payload, 0, 0]
        e2e.due(ecu, 1)
        taken += module.check(ecu, cal, 1, 2)
        if its.checksum is not None:
            place = its.checksum.place
            broken = bytearray(payload)
            place.write(broken, place.read(payload) ^ 1 << int(rng.integers(0, place.width)))
            ecu.rx_payload[2] = [*broken, 0, 0]
            assert module.check(ecu, cal, 1, 2) == 0
        elif its.counter is not None:
            assert module.check(ecu, cal, 1, 2) == 0
    # profiles 1 and 2 and counters of few values take a first frame to know the counter by
    assert taken == rounds - int(its.resynchronises)


def test_profile_5_and_22_judge_counters_as_specified():
    """E2E_P05Check: the last right frame counts, whatever it was."""
    cal, ecu = Calibration(), Ecu()
    cal.e2e_max_delta = [2] * N_RX
    ecu.e2e_last = [e2e.NO_COUNTER] * N_RX
    judged = [e2e.in_sequence(ecu, cal, 0, c, 256) for c in (0, 1, 3, 3, 6, 7, 9, 12, 13, 255, 0)]
    assert judged == [1, 1, 1, 0, 0, 1, 1, 0, 1, 0, 1]
    judged = [e2e.in_sequence(ecu, cal, 1, c, 16) for c in (0, 1, 15, 0, 2, 5, 6)]
    assert judged == [1, 1, 0, 1, 1, 0, 1]


@pytest.mark.parametrize("name", LONG)
def test_generated_protection_of_a_long_frame_does_what_its_description_says(name, tmp_path):
    paths = files(tmp_path, LONG_DBC, LONG_MAP + f"protection = {LONG[name]}\n")
    its = bus_map.load(*paths).transmitted[4].protection
    module = module_of(protection_source.generate(*paths))
    rng = np.random.default_rng(7)
    ecu = Ecu()
    for _ in range(50):
        payload = bytearray(rng.bytes(32))
        count = int(rng.integers(0, its.counter.values if its.counter else 1))
        ecu.tx_payload[4], ecu.tx_counter[4] = [*payload], count
        module.protect(ecu, 4)
        its.apply(payload, count)
        assert ecu.tx_payload[4] == [*payload]


@pytest.mark.parametrize("method", ["crc16_ccitt", "crc16_arc", "crc32"])
def test_long_and_short_frames_have_one_crc(method, tmp_path):
    width = int(re.match(r"crc(\d+)", method)[1])
    entry = own_sum(f'method = "{method}", byte = 0, width = {width}')
    dbc = HEAD + "BO_ 200 Long: 32 Ecu\nBO_ 201 Short: 8 Ecu\n"
    table = "schema = 1\n"
    for mailbox, name in (("damper", "Long"), ("valve", "Short")):
        table += f'[transmit.{mailbox}]\nmessage = "{name}"\nfd = true\nprotection = {entry}\n'
    paths = files(tmp_path, dbc, table)
    module, ecu = module_of(protection_source.generate(*paths)), Ecu()
    for slot, size in ((2, 32), (3, 8)):
        expected = bytearray(range(7, 7 + size))
        ecu.tx_payload[slot] = [*expected]
        module.protect(ecu, slot)
        bus_map.load(*paths).transmitted[slot].protection.apply(expected, 0)
        assert ecu.tx_payload[slot] == [*expected]


needs_cc = pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")


@needs_cc
@pytest.mark.parametrize(
    "name",
    [
        "1",
        "own crc",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("2", "5 elsewhere", "a counter across bytes")
        ),
    ],
)
def test_c_sends_the_frames_of_the_whole_loop(tmp_path, name):
    """A protection of each kind through the compiled loop, one frame after the other."""
    table = MAP.replace('signals.Mode = "mode"\n', PROTECTED_STATE + TABLES[name])
    firmware = bus_firmware.of_bus(*files(tmp_path, table=table))
    bus = firmware.bus
    library = native.library_of(firmware)
    record = ecu_traffic.random_calibration(3)
    record.timeout_ticks = [5, 5, 0, 0, 5] if record.observer == 0 else [5, 5, 0, 0, 0]
    record.e2e, record.status_ticks, record.actuator = 1, 1, 0
    memory_image.sealed(record)
    run = replayed(library, record, ecu_traffic.random_traffic(5, 40, bus=bus))
    its = bus.transmitted[4].protection
    status = run.frames[run.frames["message"] == 4]
    assert len(status) == 40
    for k, sent in enumerate(status):
        payload = bytearray(sent["payload"][:5].tolist())
        expected = bytearray(payload)
        its.apply(expected, k % its.counter.values if its.counter else 0)
        assert payload == expected
        assert sent["length"] == 5
        assert not sent["payload"][5:].any()


MAILBOXES = {
    "imu": "roll_rate",
    "vehicle_motion": "speed",
    "suspension_rate": "stroke_rate[0]",
    "actuator_state": "delivered[0]",
    "roll_reference": "reference_roll",
}
SENT = ("suspension_force", "anti_roll_bar", "damper", "valve", "status")


def groups():
    """Protections five at a time, with the bytes of their frames."""
    for tables, size in ((TABLES, 6), (LONG, 32)):
        entries = list(tables.items())
        for start in range(0, len(entries), 5):
            part = dict(entries[start : start + 5])
            yield pytest.param(part, size, id=" and ".join(part))


def both_ways(tmp_path, entries, size):
    """A bus on which each protection is of a frame received and of one sent."""
    dbc, table = [HEAD], ["schema = 1"]
    last = f' SG_ Value : {8 * size - 8}|8@1+ (0.01,0) [0|2] "" Ecu\n'
    for k, (mailbox, sent, entry) in enumerate(
        zip(MAILBOXES, SENT, entries.values(), strict=False)
    ):
        parts = last + (PARTS if "signal" in entry else "")
        for way, name, ident in (("receive", mailbox, 160 + k), ("transmit", sent, 1824 + k)):
            dbc.append(f"BO_ {ident} {name}: {size} Car\n{parts}")
            table += [f"[{way}.{name}]", f'message = "{name}"', "fd = true"]
            table += [f"protection = {entry}"]
        field = f'{{ field = "{MAILBOXES[mailbox]}", unit = "{UNITS[mailbox]}" }}'
        at = table.index(f"[receive.{mailbox}]") + 1
        table.insert(at, f"signals.Value = {field}")
    return files(tmp_path, "".join(dbc), "\n".join(table) + "\n")


UNITS = {
    "imu": "rad/s",
    "vehicle_motion": "m/s",
    "suspension_rate": "m/s",
    "actuator_state": "Nm",
    "roll_reference": "rad",
}


@needs_cc
@pytest.mark.slow
@pytest.mark.parametrize(("entries", "size"), list(groups()))
def test_c_protects_and_judges_as_described(tmp_path, entries, size):
    """Proved, and alone for frames right and wrong in one bit; in CPython they are judged alike."""
    firmware = bus_firmware.of_bus(*both_ways(tmp_path, entries, size))
    assert not prove(firmware.program()).findings
    compiled = CompiledProtection(firmware, tmp_path)
    module = firmware.module("com.protection")
    cal, rng = Calibration(), np.random.default_rng(3)
    cal.e2e_max_delta, cal.e2e_max_repeated = [3] * N_RX, [14] * N_RX
    ecu, other = firmware.record(), firmware.record()
    room = len(ecu.tx_payload[0])
    for slot in range(len(entries)):
        its = firmware.bus.transmitted[slot].protection
        values = its.counter.values if its.counter else 1
        judged = []
        for k in range(40):
            count = (values - 20 + k) % values
            payload = bytearray(rng.bytes(size))
            ecu.tx_payload[slot], ecu.tx_counter[slot] = [*payload, *bytes(room - size)], count
            compiled.protect(ecu, slot)
            its.apply(payload, count)
            assert ecu.tx_payload[slot][:size] == [*payload]
            received = firmware.bus.received[slot].protection
            received.apply(payload, count)
            if k % 3 == 2:
                bit = int(rng.integers(0, 8 * size))
                payload[bit // 8] ^= 1 << bit % 8
            for record, check in ((ecu, compiled.check), (other, module.check)):
                record.rx_payload[2 * slot] = [*payload, *bytes(room - size)]
                judged.append(check(record, cal, slot, 2 * slot))
            assert judged[-1] == judged[-2]
            assert ecu.e2e_last == other.e2e_last
        assert 0 < sum(judged) < len(judged) or its.checksum is None


@pytest.mark.slow
@needs_cc
def test_only_the_frames_that_have_a_data_id_are_protected(tmp_path):
    """A frame received with E2E and one sent without: neither gets what the other has."""
    paths = files(tmp_path)
    bus = bus_map.load(*paths)
    assert [bool(box.protection) for box in bus.received] == [True, False, False, False, False]
    assert not any(box.protection for box in bus.transmitted)
    module = module_of(protection_source.generate(*paths))
    ecu = Ecu()
    for slot in range(N_TX):
        ecu.tx_payload[slot] = [1, 2, 3, 4, 5, 6, 7, 8]
        module.protect(ecu, slot)
        assert ecu.tx_payload[slot] == [1, 2, 3, 4, 5, 6, 7, 8]
    # an unprotected frame is taken as it is, a protected one with its checksum only
    assert module.check(ecu, Calibration(), 1, 2) == 1
    assert module.check(ecu, Calibration(), 0, 0) == 0
    library = native.build(bundle.sources(*paths))
    run = one_with_forces(library, ecu_traffic.random_traffic(7, 60, hostile=0.0, bus=bus))
    assert run.states["age"][0, -1, 1] < 5
    force = run.frames[run.frames["message"] == 0]
    state = run.states[0][force["tick"]]
    message = load_string(DBC, "dbc").get_message_by_name("Force")
    for sent, its in zip(force, state, strict=True):
        decoded = message.decode(sent["payload"].tobytes())
        for k, name in enumerate(("FrontLeft", "FrontRight", "RearLeft", "RearRight")):
            assert decoded[name] == pytest.approx(its["force"][k] / 2**14, abs=0.26)


def one_with_forces(library, traffic):
    """Run the first calibration that lets the suspension push."""
    for seed in range(30):
        record = ecu_traffic.random_calibration(seed)
        record.timeout_ticks, record.observer, record.actuator = [5, 5, 0, 0, 0], 1, 0
        record.law, record.compensator_outputs = 0, 1
        record.e2e, record.init_ticks = 1, 3
        run = replayed(library, memory_image.sealed(record), traffic)
        if run.states["force"].any():
            return run
    pytest.fail("no calibration lets the suspension push")


@pytest.mark.parametrize(
    ("entry", "word"),
    [
        ("{ profile = 8 }", "E2E profile 8 is not supported"),
        ("{ profile = 1 }", "needs data_id"),
        ("{ profile = 1, data_id = 70000 }", "must fit 16 bits"),
        ("{ profile = 1, data_id = 1, counter_ofset = 8 }", "did you mean 'counter_offset'"),
        ("{ profile = 1, data_id = 1, crc_offset = 4 }", "multiple of 8"),
        ("{ profile = 1, data_id = 1, crc_offset = 40 }", "inside 40 bits"),
        ("{ profile = 1, data_id = 1, counter_offset = 32 }", "overlaps the signal Mode at bit 32"),
        ("{ profile = 1, data_id = 1, counter_offset = 4 }", "overlap"),
        ("{ profile = 1, data_id = 1, data_length = 44 }", "whole bytes"),
        ("{ profile = 1, data_id = 1, data_length = 48 }", "whole bytes"),
        ("{ profile = 2, data_id = 7 }", "list of 16 bytes"),
        ("{ profile = 5, data_id = 7, offset = 24 }", "inside 40 bits"),
        ('{ profile = "own" }', "a checksum, a counter or both"),
        ('{ profile = "own", checksum = { method = "crc9", byte = 0 } }', "did you mean 'crc'"),
        ('{ profile = "own", checksum = { method = "crc8", byte = 0 } }', "polynomial"),
        ('{ profile = "own", checksum = { method = "xor", byte = 5 } }', "inside 40 bits"),
        ('{ profile = "own", checksum = { method = "xor", signal = "Mod" } }', "'Mode'"),
        ('{ profile = "own", checksum = { method = "xor", signal = "Mode" } }', "the signal Mode"),
        ('{ profile = "own", counter = { bit = 38 } }', "inside 40 bits"),
        ('{ profile = "own", counter = { bit = 0, values = 17 } }', "17 values"),
        ('{ profile = "own", counter = { byte = 0, width = 33 } }', "up to 32 bits"),
        ('{ profile = "own", counter = { bit = 0, byte = 0 } }', "one of signal, byte or bit"),
        ('{ profile = "own", counter = { bit = 8, order = "big" } }', "needs whole bytes"),
        (own_sum('byte = 0, method = "sum", over = ["frme"]'), "did you mean 'frame'"),
        (own_sum('byte = 0, method = "sum", over = ["bytes 0-5"]'), "outside the 5 bytes"),
        (own_sum('byte = 0, method = "sum", over = ["byte x"]'), "did you mean 'byte 3'"),
        (own_sum('byte = 0, method = "sum", over = []'), "takes in nothing"),
        (own_sum('byte = 0, method = "sum", over = [256]'), "a number of up to 8 bits"),
        (own_sum('byte = 0, method = "sum", over = ["counter"]'), "there is none"),
        (own_sum('byte = 0, method = "sum", over = [{ signal = "Mod" }]'), "did you mean 'Mode'"),
        (own_sum('byte = 0, method = "sum", over = [{ sgnal = "Mode" }]'), "did you mean 'signal'"),
        (own_sum(f'byte = 0, method = "sum", constant = {IDS}'), "needs a counter of up to 16"),
        (own_sum('byte = 0, method = "sum", unit = 3'), "unit 3 must be 1, 4, 8, 16, 32 bits"),
        (own_sum('byte = 0, method = "xor", negate = true'), "negate is not of a checksum by xor"),
        (own_sum('byte = 0, method = "sum", carry = 1'), "carry must be true or false"),
        (own_sum('byte = 0, method = "sum", start = 256'), "must fit 8 bits"),
        (own_sum('byte = 0, width = 16, method = "crc32"'), "has 32 bits, its place 16"),
        (own_sum('byte = 0, width = 33, method = "sum"'), "up to 32 bits"),
        (own_sum('byte = 0, width = 16, method = "sum", unit = 16'), "words of 16 bits"),
        (own_crc("bit = 0, width = 4", 19, ""), "must fit 4 bits"),
        ("{ profile = 4, data_id = 1 }", "12 bytes does not fit the 5 protected"),
        ('{ profile = 11, data_id = 1, data_id_mode = "low" }', "choose from both, nibble"),
    ],
)
def test_a_wrong_protection_is_named(tmp_path, entry, word):
    paths = files(tmp_path, table=MAP.replace('signals.Mode = "mode"', PROTECTED_STATE + entry))
    with pytest.raises(CanrollError, match=re.escape(word)) as caught:
        bus_map.load(*paths)
    assert "car.toml [transmit.status]" in str(caught.value)


def test_a_protection_over_a_signal_in_use_is_refused(tmp_path):
    dbc = DBC + 'BA_ "E2EDataId" BO_ 200 4661;\n'
    with pytest.raises(CanrollError, match=r"checksum of E2E profile 1 overlaps .* FrontLeft"):
        bus_map.load(*files(tmp_path, dbc))


def test_attributes_of_the_dbc_give_profile_and_places(tmp_path):
    attributes = """BA_DEF_ BO_ "E2EProfile" ENUM "none","P01","P02","P05","P22";
BA_DEF_ BO_ "E2EOffset" INT 0 512;
BA_DEF_ BO_ "E2EDataLength" INT 0 512;
BA_DEF_ BO_ "E2EDataIdList" STRING;
BA_DEF_DEF_ "E2EProfile" "none";
BA_ "E2EProfile" BO_ 160 0;
BA_ "E2EProfile" BO_ 161 3;
BA_ "E2EDataId" BO_ 161 0;
BA_ "E2EOffset" BO_ 161 0;
BA_ "E2EProfile" BO_ 201 4;
BA_ "E2EDataIdList" BO_ 201 "1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,0x10";
BA_ "E2EDataLength" BO_ 201 32;
"""
    motion = "SG_ Speed : 24|16"
    dbc = DBC.replace("SG_ Speed : 0|16", motion).replace("SG_ Angle : 16|16", "SG_ Angle : 40|8")
    bus = bus_map.load(*files(tmp_path, dbc + attributes))
    assert bus.received[0].protection is None
    assert bus.received[1].protection == frame(6, {"profile": 5, "data_id": 0})
    listed = {"profile": 22, "data_id": list(range(1, 17)), "data_length": 32}
    assert bus.transmitted[4].protection == frame(5, listed)
