"""End-to-end protection against the package autosar-e2e and the specification's state machine."""

import itertools

import numpy as np
import pytest
from cantools.database import load_string
from e2e import p01
from hypothesis import given, settings
from hypothesis import strategies as st

from canroll.codegen.frame.frame_protection import protection
from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.nodes import e2e

words = st.integers(-(1 << 63), (1 << 63) - 1)
data_ids = st.integers(0, 0xFFFF)
counters = st.integers(0, 14)


def tables(its):
    """Return the record of one protection."""
    row = np.zeros(1, e2e.PROTECTION)[0]
    e2e.put(row, its)
    return row


def of_map(size, **table):
    """The protection that a map describes, of a frame with the signals that it names."""
    text = f'VERSION ""\nBO_ 1313 Frame: {size} Car\n'
    for name, place in (("Low", "9|3@1+"), ("Wide", "30|11@0+")):
        text += f' SG_ {name} : {place} (1,0) [0|0] "" Ecu\n' if name in str(table) else ""
    its = protection(load_string(text, "dbc").messages[0], table, (), "map.toml")
    assert its is not None
    return its


def own(size, counter=None, **checksum):
    """A manufacturer's protection."""
    table = {"profile": "own", "checksum": checksum} if checksum else {"profile": "own"}
    return of_map(size, **table, **({"counter": counter} if counter else {}))


def profile_1(data_id):
    return tables(of_map(8, profile=1, data_id=data_id))


def to_array(word: int):
    return np.frombuffer(bytes(to_bytes(word)), np.uint8).copy()


def protected(data_id, counter, word):
    payload = to_array(word)
    e2e.protect(profile_1(data_id), counter, payload)
    return payload


def check(state, supervision, data_id, payload):
    return e2e.check(state, supervision, profile_1(data_id), payload)


def to_bytes(word: int) -> bytearray:
    return bytearray((word & (1 << 64) - 1).to_bytes(8, "little"))


@settings(deadline=None)
@given(words, data_ids, counters)
def test_protect_equals_the_reference_library(word, data_id, counter):
    ours = bytearray(protected(data_id, counter, word).tobytes())
    theirs = to_bytes(word)
    theirs[1] = theirs[1] & 0xF0 | counter
    p01.e2e_p01_protect(theirs, data_id, length=8, increment_counter=False)
    assert ours == theirs
    assert p01.e2e_p01_check(ours, data_id, length=8)


@settings(deadline=None)
@given(words, data_ids)
def test_check_accepts_a_checksum_exactly_when_the_reference_library_does(word, data_id):
    state = e2e.receiver_state(e2e.Supervision())
    accepted = check(state, e2e.Supervision(), data_id, to_array(word)) != e2e.WRONG_CRC
    assert accepted == p01.e2e_p01_check(to_bytes(word), data_id, length=8)


@settings(deadline=None)
@given(words, data_ids)
def test_a_right_checksum_is_accepted_but_for_counter_15(word, data_id):
    word = word & ~0xFF | e2e.checksum(profile_1(data_id), to_array(word))
    state = e2e.receiver_state(e2e.Supervision())
    accepted = check(state, e2e.Supervision(), data_id, to_array(word)) != e2e.WRONG_CRC
    assert accepted == ((word >> 8) & 0xF != 15)
    assert accepted == p01.e2e_p01_check(to_bytes(word), data_id, length=8)


@njit
def undetected(row, payload, flips):
    """Number of the bit-flip patterns, one a row of ``flips``, after which the checksum fits."""
    count = 0
    changed = payload.copy()
    for flip in flips:
        for k in range(8):
            changed[k] = payload[k] ^ flip[k]
        count += changed[0] == e2e.checksum(row, changed)
    return count


def test_every_one_and_two_bit_flip_is_rejected_and_few_of_three_bits_pass():
    bits = np.eye(64, dtype=np.uint8)
    payload, rows = protected(3200, 7, 0x0123_4567_89AB_C000), profile_1(3200)

    def flips(count):
        chosen = np.array(list(itertools.combinations(range(64), count)))
        return np.packbits(bits[chosen].sum(axis=1, dtype=np.uint8), axis=1)

    assert undetected(rows, payload, flips(1)) == 0
    assert undetected(rows, payload, flips(2)) == 0
    three = flips(3)
    assert 0 < undetected(rows, payload, three) / len(three) < 1 / 200


REFLECTED = {"reflect_in": True, "reflect_out": True, "start": 5}
PROTECTIONS = {
    "1 alternating": of_map(6, profile=1, data_id=0xA5C3, data_id_mode="alternating"),
    "1 nibble": of_map(8, profile=1, data_id=0xAC3, data_id_mode="nibble"),
    "2": of_map(8, profile=2, data_id=list(range(7, 23))),
    "4": of_map(24, profile=4, data_id=0xDEADBEEF, offset=24),
    "5": of_map(32, profile=5, data_id=0x1234, offset=24),
    "6": of_map(32, profile=6, data_id=0x1234),
    "7": of_map(64, profile=7, data_id=0xDEADBEEF, offset=64),
    "11": of_map(8, profile=11, data_id=0x1234),
    "xor": own(8, {"bit": 52, "width": 2}, method="xor", byte=7, constant=0x42),
    "xor of nibbles": own(8, method="xor", bit=3, width=4, unit=4, start=3),
    "sum": own(5, method="sum", byte=4, end=255),
    "sum of the identifier": own(
        8, method="sum", signal="Low", unit=1, negate=True, start=3, over=["id", "frame"]
    ),
    "words with a carry": own(
        8,
        {"signal": "Low"},
        method="sum",
        byte=4,
        width=16,
        unit=16,
        carry=True,
        over=["bytes 0-3", "length", "id", "counter", {"signal": "Low"}],
    ),
    "32 bits": own(12, method="sum", byte=8, width=32, unit=32, carry=True, negate=True),
    "crc 12": own(8, method="crc", signal="Wide", polynomial=0x385, reflect_out=True),
    "crc 16": own(8, method="crc16_arc", byte=3, width=16, order="big"),
    "crc 32": own(8, method="crc", byte=0, width=32, polynomial=0x04C11DB7, end=7),
    "crc 40": own(9, method="crc", byte=0, width=40, polynomial=0x4820009, **REFLECTED),
    "crc 64": own(9, method="crc", byte=0, width=64, polynomial=0x42F0E1EBA9EA3693),
    "crc 64 turned": own(
        9, method="crc", byte=0, width=64, polynomial=0x42F0E1EBA9EA3693, reflect_out=True
    ),
    "counter": own(3, {"bit": 17, "width": 3, "values": 6}),
    "wide counter": own(4, {"byte": 0, "width": 32}),
}


@settings(deadline=None)
@given(st.sampled_from(sorted(PROTECTIONS)), st.binary(min_size=64, max_size=64), st.data())
def test_any_protection_is_what_the_map_means(name, payload, data):
    its = PROTECTIONS[name]
    count = data.draw(st.integers(0, its.counter.values - 1 if its.counter else 0))
    theirs = bytearray(payload)
    its.apply(theirs, count)
    ours = np.frombuffer(payload, np.uint8).copy()
    rows = tables(its)
    e2e.protect(rows, count, ours)
    assert ours.tobytes() == theirs
    assert e2e.intact(rows, ours)
    if its.checksum is not None:
        bit = data.draw(st.sampled_from(its.checksum.place.bits))
        ours[bit // 8] ^= 1 << bit % 8
        assert not e2e.intact(rows, ours)


@pytest.mark.parametrize("name", ["5", "counter", "sum"])
def test_any_counter_is_supervised_alike(name):
    its = PROTECTIONS[name]
    rows, payload = tables(its), np.zeros(64, np.uint8)
    state, supervision = e2e.receiver_state(e2e.Supervision()), e2e.Supervision()
    found = []
    for count in (0, 1, 1, 2, 4):
        e2e.protect(rows, count, payload)
        found.append(STATUS[e2e.check(state, supervision, rows, payload)])
    expected = "INITIAL OK REPEATED OK OKSOMELOST" if its.counter else "OK OK OK OK OK"
    assert found == expected.split()


STATUS = ("OK", "OKSOMELOST", "INITIAL", "SYNC", "REPEATED", "WRONGSEQUENCE", "WRONGCRC")


def receive(state, supervision, *counters):
    return [
        STATUS[check(state, supervision, 3200, protected(3200, counter, 0))] for counter in counters
    ]


CASES = {
    "in order, wrapping": ((3, 14, 1), [12, 13, 14, 0, 1], "INITIAL OK OK OK OK"),
    "repeated": ((3, 14, 1), [2, 2, 3], "INITIAL REPEATED OK"),
    "lost within the limit": ((1, 14, 1), [0, 2, 3], "INITIAL OKSOMELOST OK"),
    "lost beyond it": ((1, 14, 1), [0, 5, 6, 7], "INITIAL WRONGSEQUENCE SYNC OK"),
    "two of synchronisation": ((1, 14, 2), [0, 5, 6, 7, 8], "INITIAL WRONGSEQUENCE SYNC SYNC OK"),
    # Without synchronisation the last counter stays until the growing window reaches it.
    "none": ((1, 14, 0), [0, 4, 4, 4], "INITIAL WRONGSEQUENCE WRONGSEQUENCE OKSOMELOST"),
    "not too long": ((1, 1, 1), [0, 0, 1], "INITIAL REPEATED OK"),
    "too long": ((1, 1, 1), [0, 0, 0, 1, 2, 3], "INITIAL REPEATED REPEATED SYNC SYNC OK"),
}


@pytest.mark.parametrize("case", CASES)
def test_receiver_follows_the_specification(case):
    limits, sequence, expected = CASES[case]
    supervision = e2e.Supervision(*limits)
    state = e2e.receiver_state(supervision)
    assert receive(state, supervision, *sequence) == expected.split()


def test_the_number_of_lost_frames_is_kept():
    supervision = e2e.Supervision()
    state = e2e.receiver_state(supervision)
    receive(state, supervision, 4, 7)
    assert state["lost"] == 2
    receive(state, supervision, 8)
    assert state["lost"] == 0


def test_wrong_checksum_changes_nothing_but_the_window():
    supervision = e2e.Supervision()
    state = e2e.receiver_state(supervision)
    assert receive(state, supervision, 4) == ["INITIAL"]
    before = state.copy()
    payload = protected(3200, 5, 0)
    payload[5] ^= 1
    assert check(state, supervision, 3200, payload) == e2e.WRONG_CRC
    before["max_delta"] += 1
    assert state == before
    assert receive(state, supervision, 5) == ["OK"]


def test_another_messages_frame_is_rejected():
    state = e2e.receiver_state(e2e.Supervision())
    assert check(state, e2e.Supervision(), 3200, protected(3201, 0, 0)) == e2e.WRONG_CRC
