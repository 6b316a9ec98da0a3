"""Authenticated frames: what passes, what does not, and how either side comes back."""

import random

import pytest
from cryptography.hazmat.primitives.ciphers import algorithms
from cryptography.hazmat.primitives.cmac import CMAC

from canroll.firmware.com.protection import RX_DATA_IDS, TX_DATA_IDS
from canroll.firmware.security import secoc
from canroll.firmware.security.secoc_state import COUNTER_MAX, RESET_MAX, SECURED, Secoc
from canroll.firmware.state import RX_IMU, TX_ANTI_ROLL_BAR, TX_STATUS

KEY = bytes(range(100, 116))
PAYLOAD = bytes.fromhex("1122334455667788")


def started(reset=1, key=KEY, listening=0):
    its = Secoc()
    secoc.start(its, list(key), reset, listening)
    return its


def secured(count, reset=1, *, payload=PAYLOAD, identity=RX_DATA_IDS[RX_IMU], key=KEY):
    """A frame as another implementation sends it."""
    judge = CMAC(algorithms.AES(key))
    frame = payload + reset.to_bytes(3, "big") + count.to_bytes(3, "big")
    judge.update(identity.to_bytes(2, "big") + frame)
    return frame + judge.finalize()[:6]


def verified(its, frame, message=RX_IMU, length=SECURED):
    return secoc.verify(its, message, list(frame.ljust(SECURED, b"\0")), length)


def test_a_frame_sent_is_that_of_the_specification():
    its = started(reset=0x010203)
    for count in range(3):
        identity = TX_DATA_IDS[TX_ANTI_ROLL_BAR]
        assert sent(its) == secured(count, 0x010203, identity=identity)


def test_every_frame_passes_once_and_lost_ones_do_not_matter():
    its = started()
    for count in (0, 1, 2, 7, 300, 70_000):
        assert verified(its, secured(count)) == 1
        assert verified(its, secured(count)) == 0
    assert its.refused == 6


@pytest.mark.parametrize("count", [0, 4, 5])
def test_an_older_frame_is_refused(count):
    its = started()
    assert verified(its, secured(5)) == 1
    assert verified(its, secured(count)) == 0
    assert verified(its, secured(6)) == 1


@pytest.mark.parametrize("bit", range(8 * SECURED))
def test_any_bit_changed_is_refused(bit):
    its = started()
    assert verified(its, secured(8)) == 1
    frame = bytearray(secured(9))
    frame[bit // 8] ^= 1 << bit % 8
    assert verified(its, bytes(frame)) == 0
    assert (its.rx_freshness[RX_IMU], its.refused) == (8, 1)
    assert verified(its, secured(9)) == 1


@pytest.mark.parametrize(
    "frame",
    [secured(3, key=bytes(16)), secured(3, identity=RX_DATA_IDS[1])],
    ids=["another key", "another message"],
)
def test_what_was_authenticated_for_something_else_is_refused(frame):
    assert verified(started(), frame) == 0


@pytest.mark.parametrize("length", [0, 8, 12, 16, 19, 21, 64])
def test_another_length_is_refused(length):
    its = started()
    assert verified(its, secured(1), length=length) == 0
    assert its.refused == 1


@pytest.mark.parametrize("message", [-1, 5])
def test_there_is_no_other_message(message):
    its = started()
    assert verified(its, secured(1), message=message) == 0
    assert its.refused == 0


def test_a_reset_of_the_sender_resynchronises_with_its_first_frame():
    its = started()
    assert verified(its, secured(9000, reset=1)) == 1
    assert verified(its, secured(0, reset=2)) == 1
    # and what it sent before is old for ever
    assert verified(its, secured(9001, reset=1)) == 0
    assert verified(its, secured(1, reset=2)) == 1


@pytest.mark.parametrize("missed", [127, 128, 255, 256, 10_000, 1 << 16, 1 << 23])
def test_a_receiver_that_missed_any_number_of_starts_hears_the_sender_again(missed):
    its, recorded = started(), [secured(count, reset=7) for count in (4, COUNTER_MAX - 1)]
    assert verified(its, recorded[0]) == 1
    assert verified(its, secured(5, reset=7 + missed)) == 1
    assert its.rx_reset[RX_IMU] == 7 + missed
    # what was recorded in any start before is old for ever
    recorded += [secured(COUNTER_MAX - 1, reset=6 + missed), secured(4, reset=7 + missed)]
    assert [verified(its, frame) for frame in recorded] == [0] * 4
    assert verified(its, secured(6, reset=7 + missed)) == 1


def test_a_reset_of_the_receiver_resynchronises_with_the_next_frame():
    its = started()
    assert verified(its, secured(12345)) == 1
    assert verified(started(), secured(12346)) == 1


def test_messages_do_not_share_their_freshness():
    its = started()
    assert verified(its, secured(9)) == 1
    assert verified(its, secured(2, identity=RX_DATA_IDS[3]), message=3) == 1


def sent(its, slot=TX_ANTI_ROLL_BAR):
    frame = list(PAYLOAD.ljust(SECURED, b"\0"))
    secoc.protect(its, slot, frame)
    return bytes(frame)


def test_behind_the_last_number_of_a_start_all_frames_go_on_as_the_next():
    its = started(reset=300)
    its.tx_freshness[TX_ANTI_ROLL_BAR] = COUNTER_MAX - 1
    its.tx_freshness[TX_STATUS] = 70_000
    identity, other = TX_DATA_IDS[TX_ANTI_ROLL_BAR], TX_DATA_IDS[TX_STATUS]
    assert sent(its) == secured(COUNTER_MAX - 1, 300, identity=identity)
    assert sent(its, TX_STATUS) == secured(70_000, 300, identity=other)
    assert sent(its) == secured(0, 301, identity=identity)
    assert its.tx_reset == 301
    assert sent(its) == secured(1, 301, identity=identity)
    assert sent(its, TX_STATUS) == secured(0, 301, identity=other)


def test_a_receiver_follows_a_sender_into_its_next_start_and_takes_nothing_of_the_last():
    its = started(reset=300)
    secoc.resume(its, RX_IMU, 300)
    recorded = [secured(count, 300) for count in (0, COUNTER_MAX - 2, COUNTER_MAX - 1)]
    assert verified(its, recorded[1]) == 1
    assert verified(its, recorded[2]) == 1
    assert verified(its, secured(COUNTER_MAX, 300)) == 0
    assert verified(its, secured(0, 301)) == 1
    assert [verified(its, frame) for frame in (*recorded, secured(0, 301))] == [0] * 4
    assert verified(its, secured(1, 301)) == 1


def test_the_last_number_of_the_last_start_authenticates_nothing():
    its = started(reset=RESET_MAX)
    its.tx_freshness[TX_ANTI_ROLL_BAR] = COUNTER_MAX - 1
    frames = [sent(its) for _ in range(3)]
    identity = TX_DATA_IDS[TX_ANTI_ROLL_BAR]
    assert frames[0] == secured(COUNTER_MAX - 1, RESET_MAX, identity=identity)
    assert frames[1][14:] == frames[2][14:] == bytes(6)
    assert its.tx_reset == RESET_MAX


@pytest.mark.parametrize("slot", [-1, 6])
def test_there_is_no_other_slot(slot):
    frame = [0] * SECURED
    secoc.protect(started(), slot, frame)
    assert frame == [0] * SECURED


def test_refusals_are_counted_without_end():
    its = started()
    its.refused = 2**31 - 1
    assert verified(its, secured(1), length=8) == 0
    assert its.refused == 2**31 - 1


def test_a_receiver_continues_from_the_last_known_start():
    old = secured(70_000, reset=298)
    assert verified(started(), old) == 1
    its = started()
    secoc.resume(its, RX_IMU, 299)
    assert verified(its, old) == 0
    assert verified(its, secured(0, reset=299)) == 1


@pytest.mark.parametrize("message", [-1, 5])
def test_there_is_no_other_sender_to_continue_with(message):
    its = started()
    secoc.resume(its, message, 7)
    assert its.rx_reset == [0] * 5


def test_a_receiver_that_has_just_started_takes_no_recorded_frame():
    its = started(listening=10)
    assert verified(its, secured(400)) == 0
    assert verified(its, secured(500)) == 0
    secoc.elapse(its, 9)
    assert verified(its, secured(501)) == 0
    secoc.elapse(its, 1)
    assert its.refused == 0
    assert verified(its, secured(401)) == 0
    assert verified(its, secured(502)) == 1
    assert its.refused == 1


class Receiver:
    """What is taken by the words of the specification, from tuples of start and number."""

    def __init__(self, start=0, listening=0):
        self.last, self.listening, self.refused = (start, -1), listening, 0

    def verified(self, frame):
        freshness = int.from_bytes(frame[8:11], "big"), int.from_bytes(frame[11:14], "big")
        authentic = frame == secured(freshness[1], freshness[0], payload=frame[:8])
        if not authentic or freshness <= self.last or freshness[1] == COUNTER_MAX:
            self.refused += 1
            return 0
        self.last = freshness
        return int(self.listening == 0)


@pytest.mark.parametrize("seed", range(4))
def test_what_is_taken_of_random_and_hostile_traffic_is_what_the_specification_says(seed):
    rng = random.Random(seed)
    start, count, recorded = 1, 0, [secured(0)]
    its, model, taken = started(), Receiver(), 0
    for _ in range(400):
        event = rng.random()
        if event < 0.1:
            start, count = start + rng.choice((1, 1, 2, 127, 128, 256, 10_000, 1 << 16)), 0
        elif event < 0.12:
            count = COUNTER_MAX - 2
        elif event < 0.2:
            memory, listening = rng.choice((0, its.rx_reset[RX_IMU])), rng.choice((0, 0, 3))
            its, model = started(listening=listening), Receiver(memory, listening)
            secoc.resume(its, RX_IMU, memory)
        elif event < 0.3:
            secoc.elapse(its, 1)
            model.listening = max(model.listening - 1, 0)
        frame = rng.choice(recorded)
        if event > 0.5 and count < COUNTER_MAX:
            count += rng.choice((1, 1, 1, 7))
            count = min(count, COUNTER_MAX)
            frame = secured(count, start, payload=rng.randbytes(8))
            recorded.append(frame)
        if event > 0.9:
            frame = bytearray(frame)
            frame[rng.randrange(SECURED)] ^= 1 << rng.randrange(8)
        result = verified(its, bytes(frame))
        assert (result, its.refused) == (model.verified(bytes(frame)), model.refused)
        assert (its.rx_reset[RX_IMU], its.rx_freshness[RX_IMU]) == model.last
        taken += result
    assert 80 < taken < 300


def test_time_counts_forwards_only():
    its = started(listening=5)
    secoc.elapse(its, -3)
    assert its.listening == 5
    secoc.elapse(its, 2**31 - 1)
    assert its.listening == 0
