"""The E2E receiver against the specification's state machine and the package autosar-e2e."""

import itertools
import math

import pytest
import rig
from e2e import p01
from hypothesis import given
from hypothesis import strategies as st

from canroll import dbc
from canroll.firmware.calibration import N_RX, Calibration
from canroll.firmware.com import e2e, protection
from canroll.firmware.state import Ecu

PROTECTED = [m for m in rig.DATABASE.messages if dbc.data_id(m)]
payloads = st.binary(min_size=8, max_size=8)
data_ids = st.integers(0, 0xFFFF)


class SpecifiedReceiver:
    """E2E_P01Check of the AUTOSAR E2E protocol specification, its flow chart step by step."""

    def __init__(self, max_delta: int, max_repeated: int, sync: int) -> None:
        self.max_delta_init, self.max_repeated, self.sync_init = max_delta, max_repeated, sync
        self.max_delta = max_delta
        self.wait_for_first = True
        self.last, self.no_new_or_repeated, self.sync = 0, 0, 0

    def check(self, data: bytes | None, data_id: int) -> str:
        self.max_delta = min(self.max_delta + 1, 14)
        if data is None:
            self.no_new_or_repeated = min(self.no_new_or_repeated + 1, 14)
            return "NONEWDATA"
        counter = data[1] & 0xF
        if counter > 14 or not p01.e2e_p01_check(bytearray(data), data_id):
            return "WRONGCRC"
        if self.wait_for_first:
            self.wait_for_first = False
            self.max_delta, self.last = self.max_delta_init, counter
            return "INITIAL"
        delta = (counter - self.last) % 15
        if delta == 0:
            self.no_new_or_repeated = min(self.no_new_or_repeated + 1, 14)
            return "REPEATED"
        if delta == 1 or delta <= self.max_delta:
            self.max_delta, self.last = self.max_delta_init, counter
            good = "OK" if delta == 1 else "OKSOMELOST"
            if self.no_new_or_repeated <= self.max_repeated:
                self.no_new_or_repeated = 0
                if self.sync > 0:
                    self.sync -= 1
                    return "SYNC"
                return good
            self.no_new_or_repeated, self.sync = 0, self.sync_init
            return "SYNC"
        self.no_new_or_repeated, self.sync = 0, self.sync_init
        if self.sync > 0:
            self.max_delta, self.last = self.max_delta_init, counter
        return "WRONGSEQUENCE"


@given(payloads, data_ids, st.integers(0, 14))
def test_protect_equals_the_reference_library(payload, data_id, counter):
    ours, theirs = list(payload), bytearray(payload)
    protection.protect_0(ours, counter, data_id)
    theirs[1] = theirs[1] & 0xF0 | counter
    p01.e2e_p01_protect(theirs, data_id, increment_counter=False)
    assert bytes(ours) == bytes(theirs)


def judged(ecu: Ecu, cal: Calibration, message: int, data: bytes, data_id: int) -> int:
    """What the receiver says of a frame in the first slot of ``message``."""
    ecu.rx_payload[2 * message] = list(data)
    e2e.due(ecu, message)
    return protection.check_0(ecu, cal, message, 2 * message, data_id)


def follow(max_delta: int, repeated: int, sync: int, steps, counter: int = 0) -> None:
    """Both receivers through one history: counter steps, "bad" checksums, None for no frame."""
    cal, ecu = Calibration(), Ecu()
    cal.e2e_max_delta, cal.e2e_max_repeated, cal.e2e_sync = (
        [max_delta] * N_RX,
        [repeated] * N_RX,
        [sync] * N_RX,
    )
    ecu.e2e_last, ecu.e2e_delta = [e2e.NO_COUNTER] * N_RX, [max_delta] * N_RX
    reference = SpecifiedReceiver(max_delta, repeated, sync)
    data_id, message = 0x0CA0, 2
    for step in steps:
        if step is None:
            e2e.due(ecu, message)
            e2e.missed(ecu, message)
            assert reference.check(None, data_id) == "NONEWDATA"
        else:
            counter = (counter + (1 if step == "bad" else step)) % 15
            data = bytearray(8)
            data[1] = 0xA0 | counter
            p01.e2e_p01_protect(data, data_id, increment_counter=False)
            if step == "bad":
                data[5] ^= 0x21
            usable = judged(ecu, cal, message, data, data_id)
            assert usable == (reference.check(bytes(data), data_id) in ("OK", "OKSOMELOST"))
        # a step of 15 or more there is not: whether the bound is 14 or 15 is the same
        assert min(ecu.e2e_delta[message], 14) == reference.max_delta
        last = e2e.NO_COUNTER if reference.wait_for_first else reference.last
        assert ecu.e2e_last[message] == last
        assert (ecu.e2e_repeated[message], ecu.e2e_resync[message]) == (
            reference.no_new_or_repeated,
            reference.sync,
        )


@given(
    st.integers(1, 14),
    st.integers(0, 14),
    st.integers(0, 14),
    st.lists(st.sampled_from([None, "bad", 0, 1, 1, 1, 1, 2, 3, 5, 14]), max_size=80),
)
def test_receiver_follows_the_specification_through_any_history(max_delta, repeated, sync, steps):
    follow(max_delta, repeated, sync, steps)


@pytest.mark.parametrize(("repeated", "sync"), [*itertools.product((0, 1), (0, 1, 2))])
def test_receiver_follows_the_specification_through_every_short_history(repeated, sync):
    for steps in itertools.product((None, 0, 1, 3), repeat=4):
        # a step of three goes to 0
        follow(1, repeated, sync, (1, 1, *steps), counter=10)


def test_the_counter_never_is_fifteen():
    cal = rig.calibration()
    ecu = rig.started(cal)
    for counter in (13, 14, 15, 0):
        data = bytearray(8)
        data[1] = 0xA0 | counter
        data[0] = protection.checksum_0(list(data), 0x0CA0)
        assert judged(ecu, cal, 2, data, 0x0CA0) == (counter in (14, 0))
        assert ecu.e2e_last[2] == counter or counter == 15


def flipped(data: bytes, bits) -> list[int]:
    word = int.from_bytes(data, "little")
    for bit in bits:
        word ^= 1 << bit
    return list(word.to_bytes(8, "little"))


@pytest.mark.parametrize("message", PROTECTED, ids=lambda m: m.name)
def test_every_flip_of_one_or_two_bits_is_rejected(message):
    """A CRC is linear: a flip goes unseen when the checksum of the flip alone is right."""
    data_id = dbc.data_id(message)
    sample = bytearray(range(16, 24))
    p01.e2e_p01_protect(sample, data_id, increment_counter=False)
    for bits in itertools.chain(
        itertools.combinations(range(64), 1), itertools.combinations(range(64), 2)
    ):
        broken = flipped(bytes(sample), bits)
        assert protection.checksum_0(broken, data_id) != broken[0], bits


def unseen_triples() -> int:
    """Number of three-bit flips that leave the checksum right; linear, so of any frame."""
    zero = protection.checksum_0([0] * 8, 0)
    syndrome = []
    for bit in range(64):
        broken = flipped(bytes([zero, *[0] * 7]), [bit])
        syndrome.append(protection.checksum_0(broken, 0) ^ broken[0])
    return sum(a ^ b ^ c == 0 for a, b, c in itertools.combinations(syndrome, 3))


def test_share_of_unseen_three_bit_flips_is_as_stated():
    """SAE J1850's polynomial has Hamming distance 3 here: 198 of 41664 triples, 0.48 %, pass."""
    unseen = unseen_triples()
    assert unseen == 198
    assert unseen / math.comb(64, 3) == pytest.approx(0.00475, abs=1e-5)
    data = bytearray(b"\x00\x35\x12\x99\x40\x07\xc3\x5a")
    p01.e2e_p01_protect(data, 0x0CA0, increment_counter=False)
    passed = sum(
        p01.e2e_p01_check(bytearray(flipped(bytes(data), bits)), 0x0CA0)
        for bits in itertools.combinations(range(64), 3)
    )
    assert passed == unseen


def test_the_table_divides_by_the_polynomial():
    """SAE J1850: x^8 + x^4 + x^3 + x^2 + 1, without the start and end values of the checksum."""
    for byte, entry in enumerate(protection.CRC8_1D):
        rest = byte << 8
        for bit in range(15, 7, -1):
            if rest >> bit & 1:
                rest ^= 0x11D << bit - 8
        assert entry == rest
