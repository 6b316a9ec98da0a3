"""Checksums and counters of each frame: against autosar-e2e, in Python and in C, on any bus."""

import re
import types

import numpy as np
import pytest
from cantools.database import load_string
from e2e import p01, p02, p05
from hypothesis import given
from hypothesis import strategies as st

from canroll.errors import CanrollError
from codegen.export import bundle
from codegen.generated import bus_map
from codegen.generated import protection as protection_source
from codegen.generated.frame_protection import crc_step, protection
from codegen.run import ecu_traffic, memory_image, native
from firmware.calibration import N_RX, Calibration
from firmware.com import e2e
from firmware.state import N_TX, Ecu

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
PROTECTED_STATE = 'signals.Mode = "mode"\nprotection = '


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


def test_a_crc_8_of_ones_own_has_the_published_check_values():
    """CRC-8/SAE-J1850, CRC-8/AUTOSAR, CRC-8/SMBUS of "123456789" in the catalogue of CRCs."""
    for polynomial, start, end, expected in (
        (0x1D, 255, 255, 0x4B),
        (0x2F, 255, 255, 0xDF),
        (0x07, 0, 0, 0xF4),
    ):
        table = {"method": "crc8", "byte": 0, "constant": ord("9")}
        table |= {"polynomial": polynomial, "start": start, "end": end}
        data = bytearray(b"?1234567")
        its = frame(8, {"profile": "own", "checksum": table | {"constant": ord("8")}})
        # nine characters: the last one is the constant of a longer frame's sum
        assert its.checksum is not None
        value = its.value(data, 0) ^ end
        assert crc_step(value, ord("9"), polynomial, 8) ^ end == expected


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
}


@pytest.fixture(params=TABLES)
def state_protected(request, tmp_path):
    """A bus on which the status frame has five bytes and a protection."""
    table = MAP.replace('signals.Mode = "mode"\n', PROTECTED_STATE + TABLES[request.param])
    paths = files(tmp_path, table=table)
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
    paths = files(tmp_path, dbc, table.replace('signals.Angle = "steering"\n', ""))
    module = module_of(protection_source.generate(*paths))
    its = bus_map.load(*paths).received[1].protection
    cal = Calibration()
    cal.e2e_max_delta, cal.e2e_sync, cal.e2e_max_repeated = [2] * N_RX, [0] * N_RX, [14] * N_RX
    ecu = Ecu()
    ecu.e2e_last = [e2e.NO_COUNTER] * N_RX
    rng = np.random.default_rng(4)
    values = its.counter.values if its.counter else 16
    taken = 0
    for k in range(2 * values + 5):
        payload = bytearray(rng.integers(0, 256, 6).tolist())
        its.apply(payload, k % values)
        ecu.rx_payload[2] = [*payload, 0, 0]
        e2e.due(ecu, 1)
        taken += module.check(ecu, cal, 1, 2)
        if its.checksum is not None:
            broken = bytearray(payload)
            broken[3 if its.checksum.byte != 3 else 2] ^= 1 << int(rng.integers(0, 8))
            if its.length > 3 or its.checksum.byte == 3:
                ecu.rx_payload[2] = [*broken, 0, 0]
                assert module.check(ecu, cal, 1, 2) == 0
        elif its.counter is not None:
            assert module.check(ecu, cal, 1, 2) == 0
    # profiles 1 and 2 and counters of few values take a first frame to know the counter by
    assert taken == 2 * values + 5 - int(its.resynchronises)


def test_profile_5_and_22_judge_counters_as_specified():
    """E2E_P05Check: the last right frame counts, whatever it was."""
    cal, ecu = Calibration(), Ecu()
    cal.e2e_max_delta = [2] * N_RX
    ecu.e2e_last = [e2e.NO_COUNTER] * N_RX
    judged = [e2e.in_sequence(ecu, cal, 0, c, 256) for c in (0, 1, 3, 3, 6, 7, 9, 12, 13, 255, 0)]
    assert judged == [1, 1, 1, 0, 0, 1, 1, 0, 1, 0, 1]
    judged = [e2e.in_sequence(ecu, cal, 1, c, 16) for c in (0, 1, 15, 0, 2, 5, 6)]
    assert judged == [1, 1, 0, 1, 1, 0, 1]


needs_cc = pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")


@needs_cc
@pytest.mark.parametrize("name", TABLES)
def test_c_sends_and_takes_the_same_frames(tmp_path, name):
    """Every kind of protection at once on the two ends of a bus, through the compiled loop."""
    table = MAP.replace('signals.Mode = "mode"\n', PROTECTED_STATE + TABLES[name])
    paths = files(tmp_path, table=table)
    bus = bus_map.load(*paths)
    library = native.build(bundle.sources(*paths))
    record = ecu_traffic.random_calibration(3)
    record.timeout_ticks = [5, 5, 0, 0, 5] if record.observer == 0 else [5, 5, 0, 0, 0]
    record.e2e, record.status_ticks, record.actuator = 1, 1, 0
    memory_image.sealed(record)
    cals = np.frombuffer(memory_image.image(record), memory_image.dtype(Calibration), 1).copy()
    traffic = ecu_traffic.random_traffic(5, 40, bus=bus)
    run = library.replay(library.start(cals), cals, [traffic])
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
        memory_image.sealed(record)
        cals = np.frombuffer(memory_image.image(record), memory_image.dtype(Calibration), 1).copy()
        run = library.replay(library.start(cals), cals, [traffic], states=True)
        if run.states["force"].any():
            return run
    pytest.fail("no calibration lets the suspension push")


@pytest.mark.parametrize(
    ("entry", "word"),
    [
        ("{ profile = 7 }", "E2E profile 7 is not supported"),
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
        ('{ profile = "own", checksum = { method = "crc", byte = 0 } }', "did you mean 'crc8'"),
        ('{ profile = "own", checksum = { method = "crc8", byte = 0 } }', "polynomial"),
        ('{ profile = "own", checksum = { method = "xor", byte = 5 } }', "inside 40 bits"),
        ('{ profile = "own", checksum = { method = "xor", signal = "Mod" } }', "'Mode'"),
        ('{ profile = "own", checksum = { method = "xor", signal = "Mode" } }', "exactly one byte"),
        ('{ profile = "own", counter = { bit = 6 } }', "inside one byte"),
        ('{ profile = "own", counter = { bit = 0, values = 17 } }', "17 values"),
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
