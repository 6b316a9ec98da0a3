"""End-to-end protection against the package autosar-e2e and the specification's state machine."""

import itertools

import numpy as np
import pytest
from e2e import p01
from hypothesis import given, settings
from hypothesis import strategies as st

from plant_sim.kernels.jit import njit
from plant_sim.nodes import e2e

words = st.integers(-(1 << 63), (1 << 63) - 1)
data_ids = st.integers(0, 0xFFFF)
counters = st.integers(0, 14)


def to_bytes(word: int) -> bytearray:
    return bytearray((word & (1 << 64) - 1).to_bytes(8, "little"))


@settings(deadline=None)
@given(words, data_ids, counters)
def test_protect_equals_the_reference_library(word, data_id, counter):
    ours = to_bytes(e2e.protect(data_id, counter, word))
    theirs = to_bytes(word)
    theirs[1] = theirs[1] & 0xF0 | counter
    p01.e2e_p01_protect(theirs, data_id, length=8, increment_counter=False)
    assert ours == theirs
    assert p01.e2e_p01_check(ours, data_id, length=8)


@settings(deadline=None)
@given(words, data_ids)
def test_check_accepts_a_checksum_exactly_when_the_reference_library_does(word, data_id):
    state = e2e.receiver_state(e2e.Supervision())
    accepted = e2e.check(state, e2e.Supervision(), data_id, word) != e2e.WRONG_CRC
    assert accepted == p01.e2e_p01_check(to_bytes(word), data_id, length=8)


@settings(deadline=None)
@given(words, data_ids)
def test_a_right_checksum_is_accepted_but_for_counter_15(word, data_id):
    word = word & ~0xFF | e2e.checksum(data_id, word)
    state = e2e.receiver_state(e2e.Supervision())
    accepted = e2e.check(state, e2e.Supervision(), data_id, word) != e2e.WRONG_CRC
    assert accepted == ((word >> 8) & 0xF != 15)
    assert accepted == p01.e2e_p01_check(to_bytes(word), data_id, length=8)


@njit
def undetected(data_id, word, flips):
    """Number of the bit-flip patterns ``flips`` after which the checksum still fits."""
    count = 0
    for flip in flips:
        changed = word ^ flip
        count += (changed & 0xFF) == e2e.checksum(data_id, changed)
    return count


def test_every_one_and_two_bit_flip_is_rejected_and_few_of_three_bits_pass():
    bits = [1 << b if b < 63 else -(1 << 63) for b in range(64)]
    word = e2e.protect(3200, 7, 0x0123_4567_89AB_C000)
    one = np.array(bits, dtype=np.int64)
    two = np.array([a ^ b for a, b in itertools.combinations(bits, 2)], dtype=np.int64)
    three = np.array([a ^ b ^ c for a, b, c in itertools.combinations(bits, 3)], dtype=np.int64)
    assert undetected(3200, word, one) == 0
    assert undetected(3200, word, two) == 0
    share = undetected(3200, word, three) / len(three)
    assert 0 < share < 1 / 200


STATUS = ("OK", "OKSOMELOST", "INITIAL", "SYNC", "REPEATED", "WRONGSEQUENCE", "WRONGCRC")


def receive(state, supervision, *counters):
    return [
        STATUS[e2e.check(state, supervision, 3200, e2e.protect(3200, counter, 0))]
        for counter in counters
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
    assert state[e2e.LOST] == 2
    receive(state, supervision, 8)
    assert state[e2e.LOST] == 0


def test_wrong_checksum_changes_nothing_but_the_window():
    supervision = e2e.Supervision()
    state = e2e.receiver_state(supervision)
    assert receive(state, supervision, 4) == ["INITIAL"]
    before = state.copy()
    word = e2e.protect(3200, 5, 0) ^ 1 << 40
    assert e2e.check(state, supervision, 3200, word) == e2e.WRONG_CRC
    before[e2e.MAX_DELTA] += 1
    np.testing.assert_array_equal(state, before)
    assert receive(state, supervision, 5) == ["OK"]


def test_another_messages_frame_is_rejected():
    word = e2e.protect(3201, 0, 0)
    state = e2e.receiver_state(e2e.Supervision())
    assert e2e.check(state, e2e.Supervision(), 3200, word) == e2e.WRONG_CRC
