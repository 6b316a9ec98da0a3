"""The firmware for a bus of CAN FD frames: proved, the same on every back end, cantools' frames."""

import json
from pathlib import Path

import cantools
import numpy as np
import pytest
from e2e import p05
from hypothesis import given
from hypothesis import strategies as st
from support.bundles import export, make
from support.replays import compare, replayed

from canroll import dbc
from canroll.codegen.export import bundle
from canroll.codegen.generated import bus_map, mailbox, signals
from canroll.codegen.proof.prove import prove
from canroll.codegen.run import (
    backends,
    bus_firmware,
    cortex,
    ecu_traffic,
    memory_image,
    native,
    translation,
)
from canroll.codegen.run import qemu as qemu_run
from canroll.codegen.run import unicorn as unicorn_run
from canroll.codegen.subset.parse import load
from canroll.errors import CanrollError
from canroll.firmware.calibration import Calibration

PATHS = (
    signals.DBC.with_name("roll_control_fd.dbc"),
    signals.MAP.with_name("roll_control_fd.toml"),
)
DATABASE = cantools.database.load_file(PATHS[0])
FIRMWARE = bus_firmware.of_bus(*PATHS)
CLUSTER = DATABASE.get_message_by_name("SensorCluster")
DATA_ID = dbc.data_id(CLUSTER)
SI = {"deg/s": np.pi / 180, "deg": np.pi / 180, "km/h": 1 / 3.6, "mm/s": 1e-3, "m/s2": 1.0}

needs_cc = pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")


def calibration(**changes):
    record = ecu_traffic.random_calibration(3)
    for name, value in {"e2e": 1, "observer": 0, "timeout_ticks": [5] * 5, **changes}.items():
        setattr(record, name, value)
    return memory_image.sealed(record)


def test_mailboxes_have_the_room_that_the_bus_needs():
    assert bus_firmware.built_in().record().rx_payload[0] == [0] * 8
    ecu = FIRMWARE.record()
    assert [len(ecu.rx_payload[0]), len(ecu.tx_payload[0])] == [32, 8]
    assert FIRMWARE.slots[CLUSTER.frame_id] == (0, 1, 2)


def test_it_is_proved(tmp_path):
    with translation.folder_of(FIRMWARE.modules) as folder:
        assert prove(load(folder=folder)).findings == ()


@needs_cc
@pytest.mark.parametrize("seed", range(4))
def test_native_is_python(seed):
    record = ecu_traffic.random_calibration(seed)
    traffic = ecu_traffic.random_traffic(seed, 40, bus=FIRMWARE.bus)
    compare(FIRMWARE, record, traffic)


@pytest.mark.slow
@needs_cc
@pytest.mark.skipif(not cortex.has_pip_tools(), reason="needs canroll[target]")
def test_cortex_m4_is_native():
    record = ecu_traffic.random_calibration(5)
    traffic = ecu_traffic.random_traffic(5, 12, bus=FIRMWARE.bus)
    run = unicorn_run.replay(record, traffic, "cortex-m4", FIRMWARE)
    expected = replayed(native.library_of(FIRMWARE), record, traffic)
    assert run.states.tobytes() == expected.states[0].tobytes()
    assert run.frames.tobytes() == expected.frames.tobytes()


@pytest.mark.slow
@needs_cc
@pytest.mark.skipif(not cortex.has_gcc_and_qemu(), reason="needs arm-none-eabi-gcc and QEMU")
def test_qemu_is_native():
    record = ecu_traffic.random_calibration(6)
    traffic = ecu_traffic.random_traffic(6, 60, bus=FIRMWARE.bus)
    run = qemu_run.replay(record, traffic, "cortex-m4", firmware=FIRMWARE)
    expected = replayed(native.library_of(FIRMWARE), record, traffic)
    assert run.states.tobytes() == expected.states[0].tobytes()
    assert run.frames.tobytes() == expected.frames.tobytes()


def value(signal):
    """Any raw code of a signal."""
    if signal.is_signed:
        return st.integers(-(1 << (signal.length - 1)), (1 << (signal.length - 1)) - 1)
    return st.integers(0, (1 << signal.length) - 1)


def protected(raws, counter):
    payload = bytearray(
        CLUSTER.encode(raws | {"Checksum": 0, "Counter": counter}, scaling=False, strict=False)
    )
    p05.e2e_p05_protect(payload, DATA_ID, increment_counter=False)
    return bytes(payload)


@given(st.fixed_dictionaries({s.name: value(s) for s in CLUSTER.signals[2:]}), st.integers(0, 255))
def test_one_frame_fills_three_mailboxes_with_what_cantools_encoded(raws, counter):
    payload = protected(raws, counter)
    ecu, loop, record = FIRMWARE.record(), FIRMWARE.loop, calibration()
    assert loop.init(ecu, record) == 0
    # the receiver of profile 5 takes a frame by the counter of the one before
    ecu.e2e_last[:3] = [(counter - 1) % 256] * 3
    for slot in FIRMWARE.slots[CLUSTER.frame_id]:
        loop.receive(ecu, slot, list(payload), len(payload))
    loop.tick(ecu, record, 1)
    assert ecu.age[:3] == [0, 0, 0]
    for box in FIRMWARE.bus.received[:3]:
        for number, place in enumerate(mailbox.VALID_BITS[box.slot]):
            signal = next(its for its in box.signals if its.place.text == place)
            its = CLUSTER.get_signal_by_name(signal.name)
            raw = raws[signal.name]
            reserved = raw in (its.choices or {})
            assert ecu.valid[FIRMWARE.bus.received.index(box)] >> number & 1 == (not reserved)
            name, _, index = place.partition("[")
            got = getattr(ecu, name)[int(index[:-1])] if index else getattr(ecu, name)
            exact = raw * float(its.scale) * SI[its.unit] * 2**signal.place.q
            limited = min(max(exact, signal.place.lo), signal.place.hi)
            assert reserved or abs(got - limited) <= 0.5 + abs(exact) * 2e-9


@given(st.integers(0, 32 * 8 - 1))
def test_a_flipped_bit_is_noticed(bit):
    payload = bytearray(protected({s.name: 1 for s in CLUSTER.signals[2:]}, 7))
    payload[bit // 8] ^= 1 << bit % 8
    ecu, loop, record = FIRMWARE.record(), FIRMWARE.loop, calibration()
    loop.init(ecu, record)
    ecu.e2e_last[:3] = [6] * 3
    for slot in range(3):
        loop.receive(ecu, slot, list(payload), 32)
    loop.tick(ecu, record, 1)
    assert ecu.age[:3] == [1, 1, 1]


def test_a_frame_shorter_than_its_message_is_passed_by():
    payload = protected({s.name: 1 for s in CLUSTER.signals[2:]}, 1)
    for length, fresh in ((24, 0), (32, 1), (48, 1)):
        ecu = FIRMWARE.record()
        FIRMWARE.loop.receive(ecu, 0, list(payload), length)
        assert ecu.rx_fresh[0] == fresh


def test_a_backend_hands_one_frame_to_every_mailbox_that_takes_it():
    record = calibration()
    for name in ("python", *(["native"] if native.compiler() else [])):
        ecu = backends.open_backend(name, record, FIRMWARE)
        ecu.receive(CLUSTER.frame_id, protected({s.name: 1 for s in CLUSTER.signals[2:]}, 0), 32)
        assert ecu.state.rx_fresh[::2] == [1, 1, 1, 0, 0]


LONG = """VERSION ""
NS_ :
BS_:
BU_: Ecu Car
BO_ 291 Inertial: {size} Car
 SG_ Rate : {rate}|16@1- (0.01,0) [-327|327] "deg/s" Ecu
 SG_ Lateral : {lateral}|12@0+ (0.02,-40) [-40|40] "m/s2" Ecu
BO_ 293 State: {size} Ecu
 SG_ Moment : {rate}|16@1- (1,0) [-30000|30000] "Nm" Car
 SG_ Mode : {lateral}|4@0+ (1,0) [0|15] "" Car
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN",{reserved},"StandardCAN_FD";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
"""
FORMATS = 'BA_ "VFrameFormat" BO_ 291 14;\nBA_ "VFrameFormat" BO_ 293 14;\n'
LONG_MAP = """schema = 1
[receive.imu]
message = "Inertial"
signals.Rate = "roll_rate"
signals.Lateral = "lateral_acceleration"
[transmit.status]
message = "State"
signals.Moment = "moment"
signals.Mode = "mode"
protection = {{ profile = 5, data_id = 4660, offset = {offset} }}
"""


def files(folder, *, size=21, rate=57, lateral=151, offset=0, fd=True):
    text = LONG.format(
        size=size, rate=rate, lateral=lateral, reserved=",".join(['"reserved"'] * 12)
    )
    (folder / "car.dbc").write_text(text + (FORMATS if fd else ""))
    (folder / "car.toml").write_text(LONG_MAP.format(offset=offset))
    return folder / "car.dbc", folder / "car.toml"


@pytest.mark.parametrize(
    ("size", "rate", "lateral"), [(21, 57, 151), (64, 500 - 52, 495), (12, 56, 87), (9, 32, 63)]
)
def test_long_frames_of_any_length_and_byte_order(tmp_path, size, rate, lateral):
    """Signals across the ends of words, in both byte orders; padding to the next length code."""
    paths = files(tmp_path, size=size, rate=rate, lateral=lateral)
    database = cantools.database.load_file(paths[0])
    its = bus_firmware.of_bus(*paths)
    ecu, loop = its.record(), its.loop
    assert len(ecu.rx_payload[0]) % 8 == 0
    record = calibration(status_ticks=1)
    assert loop.init(ecu, record) == 0
    payload = database.encode_message("Inertial", {"Rate": -12.34, "Lateral": 3.5})
    assert len(payload) == size
    loop.receive(ecu, 0, list(payload), dbc.padded(size))
    loop.tick(ecu, record, 1)
    for name, expected in (("roll_rate", -12.34 * np.pi / 180), ("lateral_acceleration", 3.5)):
        field = next(s for s in its.bus.received[0].signals if s.place.text == name)
        assert getattr(ecu, name) / 2**field.place.q == pytest.approx(expected, rel=1e-6)
    ident, length = its.sent[4]
    assert (ident, length) == (293, dbc.padded(size))
    ecu.moment = -1234 << 14
    loop.tick(ecu, record, 1)
    sent = bytes(ecu.tx_payload[4][:length])
    assert sent[size:] == bytes(length - size)
    decoded = database.decode_message("State", sent[:size], decode_choices=False)
    assert decoded["Mode"] == ecu.mode
    again = bytearray(sent[:size])
    again[:2] = b"\0\0"
    p05.e2e_p05_protect(again, 4660, increment_counter=False)
    assert again == sent[:size]


def test_what_is_no_fd_frame_cannot_be_long(tmp_path):
    with pytest.raises(CanrollError, match=r"Inertial has 21 bytes but is not a CAN FD frame"):
        bus_map.load(*files(tmp_path, fd=False))


@pytest.mark.long
@needs_cc
def test_its_bundle_passes_its_vectors(tmp_path):
    bundle.write(tmp_path, export(dbc=PATHS[0], map_file=PATHS[1]))
    goals = ["test"]
    if cortex.has_gcc_and_qemu():
        goals += ["run", "example.elf"]
    flags = "CFLAGS=-std=c99 -O1 -Wall -Wextra -Wpedantic -Wconversion -Werror"
    for goal in goals:
        result = make(tmp_path, goal, *([flags] if goal == "test" else []))
        assert result.returncode == 0, result.stderr
    assert "CAN FD" in (tmp_path / "README.md").read_text()


def test_a_name_in_a_description_is_no_code(tmp_path, monkeypatch):
    """A KCD may call a message anything: in what is made of it, the name is text at most."""
    monkeypatch.chdir(tmp_path)
    folder = Path(__file__).parents[3] / "examples" / "own_bus"
    name = 'X"""\n    __import__("pathlib").Path("sprung").touch()\n    """ \\'
    database = cantools.database.load_file(folder / "own.dbc")
    for message in database.messages:
        if message.name == "GYRO_01":
            message._name = name
    kcd = tmp_path / 'own".kcd'
    cantools.database.dump_file(database, kcd)
    kcd.write_text(kcd.read_text().replace('"""\n', '"""&#10;'))
    text = (folder / "own.toml").read_text()
    (tmp_path / "own.toml").write_text(text.replace('"GYRO_01"', json.dumps(name)))
    firmware = bus_firmware.of_bus(kcd, tmp_path / "own.toml")
    assert "Take the signals of X" in firmware.modules["signals.py"]
    firmware.loop.init(firmware.record(), Calibration())
    firmware.module("com.signals").unpack_imu(firmware.record(), 0)
    assert not (tmp_path / "sprung").exists()
