"""What comes over a link, timed by its stamps."""

from itertools import pairwise

import can
import pytest
from support.bus_frames import frame

from canroll.hil.watch.observation import Observation
from canroll.hil.watch.onlooker import DRIFT, BusClock, Onlooker


def message(name, stamp, **signals):
    ident, payload = frame(name, **signals)
    return can.Message(timestamp=stamp, arbitration_id=ident, data=payload, is_extended_id=False)


def test_frames_taken_at_once_are_apart_by_their_stamps():
    onlooker = Onlooker(None, Observation(500_000))
    taken = [
        message("Imu", 1.8e9),
        message("SuspensionForceCommand", 1.8e9 + 0.004, Counter=2),
        message("ActuatorState", 1.8e9 + 0.01, AcceptedCounter=2),
    ]
    onlooker.take(taken)
    summary = onlooker.seen.summary()
    assert summary["imu_to_command_ms"]["max"] == pytest.approx(4.0, abs=1e-3)
    assert summary["command_to_acknowledgement_ms"]["max"] == pytest.approx(6.0, abs=1e-3)


def test_error_frames_are_counted_and_others_told_apart():
    onlooker = Onlooker(None, Observation(500_000))
    extended = can.Message(timestamp=5.0, arbitration_id=0xA0, is_extended_id=True, data=bytes(8))
    error = can.Message(timestamp=5.0, arbitration_id=0xA0, is_error_frame=True)
    onlooker.take([extended, error, message("Imu", 5.0)])
    summary = onlooker.seen.summary()
    assert summary["error_frames"] == 1
    assert summary["frames"] == {"0x000000A0": 1, "Imu": 1}


EPOCH = 1.8e9


def test_differences_are_those_of_the_stamps():
    """Frames 10 ms apart, taken in batches that come late by any amount."""
    clock = BusClock(100.0)
    stamps = [EPOCH + 0.01 * k for k in range(30)]
    times = clock.instants(stamps[:5], 100.3)
    times += clock.instants(stamps[5:6], 100.31)
    times += clock.instants(stamps[6:], 100.9)
    assert [b - a for a, b in pairwise(times)] == pytest.approx([0.01] * 29, abs=1e-6)


def test_the_present_is_never_before_a_frame():
    """The least delayed frame is taken for one of now; the others are that much older."""
    clock = BusClock(0.0)
    for k in range(1, 50):
        now = 0.1 * k
        (t,) = clock.instants([EPOCH + now - (0.02 if k % 3 else 0.08)], now)
        assert t <= clock.now(now)
        age = clock.now(now) - t
        assert age == pytest.approx(0.0 if k % 3 else 0.06, abs=1e-3)


def test_a_clock_that_runs_slower_does_not_fall_behind():
    """Half of DRIFT over an hour: the age of the newest frame stays what it is."""
    clock = BusClock(0.0)
    for k in range(36_000):
        now = 0.1 * k
        (t,) = clock.instants([EPOCH + now * (1 - DRIFT / 2)], now)
    assert clock.now(now) - t < 0.001


def test_frames_without_a_stamp_are_of_now():
    clock = BusClock(10.0)
    assert clock.instants([0.0, 0.0], 10.5) == [0.5, 0.5]


@pytest.mark.parametrize("leap", [-3600.0, 3600.0])
def test_another_clock_goes_on_where_the_time_is(leap):
    """A wall clock that is set, or the server of another machine."""
    clock = BusClock(0.0)
    clock.instants([EPOCH], 1.0)
    clock.instants([EPOCH + 1.0], 2.0)
    (t,) = clock.instants([EPOCH + leap], 3.0)
    assert t == pytest.approx(3.0, abs=0.01)
