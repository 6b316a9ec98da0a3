"""Speed that falls faster than brakes can, up to its last unit."""

import pytest
import rig
from hypothesis import given
from hypothesis import strategies as st

from canroll.firmware.monitors.speed import watch_speed
from canroll.firmware.plausibility import FAULT_SPEED
from canroll.firmware.state import RX_VEHICLE_MOTION

FALL, NOISE = 1000, 300
WALKING = 50_000
speeds = st.integers(0, 200 << 20)


def judged(samples, fall=FALL, noise=NOISE):
    """Yield believed speed and fault of samples: (ticks since the last one, speed or None)."""
    cal = rig.calibration(speed_fall=fall, speed_noise=noise, fade_low=0, fade_high=WALKING)
    ecu = rig.started(cal)
    for elapsed, speed in samples:
        ecu.detected, ecu.fresh[RX_VEHICLE_MOTION] = 0, 0
        if speed is not None:
            ecu.speed, ecu.fresh[RX_VEHICLE_MOTION], ecu.valid[RX_VEHICLE_MOTION] = speed, 67, 3
        watch_speed(ecu, cal, elapsed)
        assert ecu.speed_fell == ecu.detected >> FAULT_SPEED & 1
        yield ecu.speed, ecu.speed_fell


@pytest.mark.parametrize("ticks", [1, 2, 40])
def test_what_brakes_take_and_noise_is_believed_and_no_unit_more(ticks):
    start = 1_000_000
    least = start - ticks * FALL - NOISE
    assert list(judged([(1, start), (ticks, least)]))[-1] == (least, 0)
    assert list(judged([(1, start), (ticks, least - 1)]))[-1] == (start, 1)


def test_zero_at_speed_keeps_the_speed_until_it_is_back():
    start = 1_000_000
    seen = list(judged([(1, start), *[(1, 0), (1, None)] * 2000, (1, start - 500)]))
    assert set(seen[1:-1]) == {(start, 1)}
    assert seen[-1] == (start - 500, 0)


def test_a_car_that_brakes_to_a_stand_is_believed_all_the_way():
    speeds = range(1_000_000, -1, -FALL)
    assert all(not fell for _, fell in judged([(1, speed) for speed in speeds]))


@given(st.lists(st.tuples(st.integers(1, 1000), speeds), min_size=1, max_size=30))
def test_no_believed_speed_falls_faster_whatever_comes(samples):
    known, since = 0, 0
    for (elapsed, speed), (believed, fell) in zip(samples, judged(samples), strict=True):
        since += elapsed
        assert believed == (known if fell else speed)
        if not fell:
            assert speed >= min(known - since * FALL - NOISE, known)
            known, since = speed, 0
