"""The plant's authentication against the cryptography package, which it shares nothing with."""

import numpy as np
import pytest
from cryptography.hazmat.primitives.ciphers import Cipher, algorithms, modes
from cryptography.hazmat.primitives.cmac import CMAC
from hypothesis import given
from hypothesis import strategies as st

from canroll import dbc
from canroll.codegen.generated.bus_map import load
from canroll.plant_sim.nodes import authentication, codec_tables

KEY = bytes(range(200, 216))
TABLES = codec_tables.of_map(load(dbc.SECURED_PATH, dbc.SECURED_MAP))
IMU = codec_tables.message_index("Imu")
COMMAND = codec_tables.message_index("AntiRollBarCommand")
LATER = 10**9
"""A time at which the nodes take frames."""


def nodes(**options):
    return authentication.build(len(TABLES.message), **{"key": KEY, **options})


def secured(count, starts=1, *, row=IMU, key=KEY, payload=b"12345678"):
    """A frame by the standards' text."""
    identity = dbc.data_id(dbc.load().messages[row])
    judge = CMAC(algorithms.AES(key))
    frame = payload + starts.to_bytes(3, "big") + count.to_bytes(3, "big")
    judge.update(identity.to_bytes(2, "big") + frame)
    return np.frombuffer((frame + judge.finalize()[:6]).ljust(64, b"\0"), np.uint8).copy()


def verified(auth, frame, t_ns=LATER, row=IMU):
    return authentication.verify(auth, TABLES, row, frame, t_ns)


@given(st.binary(min_size=16, max_size=16), st.binary(min_size=16, max_size=16))
def test_a_block_is_that_of_another_aes(key, block):
    auth = nodes(key=key)
    auth.block[:] = list(block)
    authentication.encrypt(auth)
    judge = Cipher(algorithms.AES(key), modes.ECB()).encryptor()
    assert bytes(auth.block.tolist()) == judge.update(block)


@given(
    st.binary(min_size=16, max_size=16),
    st.binary(min_size=8, max_size=8),
    st.integers(1, 2**24 - 1),
    st.integers(0, 2**24 - 2),
    st.sampled_from([IMU, COMMAND]),
)
def test_a_frame_is_that_of_another_cmac(key, payload, starts, count, row):
    auth = nodes(key=key, starts=starts)
    auth.sent[row] = starts, count
    frame = np.frombuffer(payload + bytes(56), np.uint8).copy()
    authentication.protect(auth, TABLES, row, frame, False)
    expected = secured(count, starts, row=row, key=key, payload=payload)
    assert frame.tobytes() == expected.tobytes()


def test_the_first_frame_of_a_node_begins_a_start():
    auth = nodes()
    frame = secured(0)
    for first, starts, count in ((True, 1, 0), (False, 1, 1), (True, 2, 0), (False, 2, 1)):
        authentication.protect(auth, TABLES, IMU, frame, first)
        assert frame.tobytes() == secured(count, starts).tobytes()


def test_behind_the_last_number_of_a_start_a_frame_goes_on_as_the_next():
    auth, frame = nodes(starts=300), secured(0)
    auth.sent[IMU] = 300, 2**24 - 2
    for starts, count in ((300, 2**24 - 2), (301, 0), (301, 1)):
        authentication.protect(auth, TABLES, IMU, frame, False)
        assert frame.tobytes() == secured(count, starts).tobytes()
        assert verified(nodes(heard_starts=[300] * len(TABLES.message)), frame)


def test_every_frame_passes_once_and_older_ones_never():
    auth = nodes()
    for count in (0, 1, 5, 4000):
        assert verified(auth, secured(count))
        assert not verified(auth, secured(count))
    assert not verified(auth, secured(3))
    assert auth.flag["refused"] == 5


@pytest.mark.parametrize("bit", range(8 * authentication.SECURED))
def test_any_bit_changed_is_refused(bit):
    auth = nodes()
    assert verified(auth, secured(8))
    frame = secured(9)
    frame[bit // 8] ^= 1 << bit % 8
    assert not verified(auth, frame)
    assert verified(auth, secured(9))


@pytest.mark.parametrize(
    "frame",
    [secured(3, key=bytes(16)), secured(3, row=COMMAND), secured(2**24 - 1)],
    ids=["another key", "another message", "last number"],
)
def test_what_is_not_for_now_is_refused(frame):
    assert not verified(nodes(), frame)


@pytest.mark.parametrize("missed", [0, 127, 128, 256, 10_000, 1 << 23])
def test_after_resets_of_the_sender_its_old_frames_are_old_for_ever(missed):
    auth = nodes()
    assert verified(auth, secured(9000))
    assert verified(auth, secured(0, starts=2 + missed))
    assert not verified(auth, secured(9001))
    assert not verified(auth, secured(9001, starts=1 + missed))


def test_a_node_that_has_just_started_takes_no_recorded_frame():
    auth = nodes(start_ns=(3 * LATER, 2 * LATER))
    assert verified(auth, secured(500))
    soon = 2 * LATER + authentication.LISTENING_NS - 1
    assert not verified(auth, secured(400), 2 * LATER)
    assert not verified(auth, secured(501), soon)
    assert auth.flag["refused"] == 0
    assert not verified(auth, secured(450), soon + 1)
    assert verified(auth, secured(502), soon + 1)
    assert not verified(auth, secured(503), 3 * LATER)


def test_a_bus_without_keys_has_plain_frames():
    auth = nodes(key=None)
    frame = np.full(64, 7, np.uint8)
    authentication.protect(auth, TABLES, IMU, frame, True)
    authentication.pretend(auth, frame)
    assert (frame == 7).all()
    assert verified(auth, frame)
    assert verified(auth, frame)


def test_an_attacker_counts_on_but_has_no_mac():
    auth = nodes()
    frame = secured(0x00FFFF)
    assert verified(auth, frame)
    authentication.pretend(auth, frame)
    assert frame[8:14].tolist() == [0, 0, 1, 1, 0, 0]
    assert not verified(auth, frame)
