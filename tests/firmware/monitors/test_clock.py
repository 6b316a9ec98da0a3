"""Clock monitor: the inertial unit's samples against the ECU's ticks."""

import pytest
import rig

from canroll.firmware import calibration as fw
from canroll.firmware.com.signals import RX_SIGNALS
from canroll.firmware.monitors.samples import watch_samples
from canroll.firmware.plausibility import FAULT_SAMPLE_RATE_OFF
from canroll.firmware.state import ACTIVE, AGE_MAX, RX_IMU, Ecu

BIT = 1 << FAULT_SAMPLE_RATE_OFF
TICK, PERIOD, LIMIT, WINDOW, TIMEOUT = 10_000, 10_000, 40_000, 200, 5


def watched(**changes) -> fw.Calibration:
    """A calibration with the monitor on."""
    given = {"clock_period": PERIOD, "clock_limit": LIMIT, "clock_window": WINDOW}
    return rig.calibration(**{**given, **changes})


def ticks(ecu: Ecu, cal: fw.Calibration, elapsed: int, counter: int | None) -> bool:
    """Let ``elapsed`` ticks pass at once, with a sample or without; return whether it reports."""
    ecu.fresh[RX_IMU] = 0 if counter is None else RX_SIGNALS[RX_IMU]
    if counter is not None:
        ecu.imu_sample = counter % 16
    ecu.detected = 0
    watch_samples(ecu, cal, elapsed)
    assert ecu.detected in (0, BIT)
    return ecu.detected == BIT


def begun(cal: fw.Calibration) -> Ecu:
    """An ECU that has just received sample 0 as its first."""
    ecu = rig.started(cal)
    assert not ticks(ecu, cal, 1, 0)
    assert (ecu.clock_error, ecu.clock_ticks, ecu.sample_gap[0]) == (0, 0, 0)
    return ecu


def found_after(cal: fw.Calibration, period: float, seconds: float = 20.0) -> float | None:
    """Time until samples every ``period`` s are reported, s; None: never."""
    ecu, tick, last = begun(cal), cal.tick_us * 1e-6, 0
    for k in range(1, round(seconds / tick)):
        counter = int((k * tick + 1e-9) / period)
        if ticks(ecu, cal, 1, counter if counter != last else None):
            return k * tick
        last = counter
    return None


@pytest.mark.parametrize("period", [0.0103, 0.0097, 0.013, 0.007, 0.02, 0.005])
def test_another_rate_is_found_once_it_makes_more_than_the_limit(period):
    """A deviation adds up to the limit; what it adds within a sample and a tick is not seen."""
    deviation = abs(PERIOD * 1e-6 / period - 1.0)
    found = found_after(watched(), period)
    assert found is not None
    least = LIMIT * 1e-6 / deviation
    assert least <= found <= least + PERIOD * 1e-6 / deviation + period + TICK * 1e-6


@pytest.mark.parametrize("period", [0.01, 0.0101, 0.0099])
def test_a_rate_that_is_off_by_less_is_not_found(period):
    assert found_after(watched(), period) is None


@pytest.mark.parametrize("tick_us", [1000, 5000, 20_000])
def test_samples_and_ticks_may_have_other_periods(tick_us):
    tick = tick_us * 1e-6
    cal = watched(
        tick_us=tick_us,
        clock_window=round(2.0 / tick),
        timeout_ticks=[round(0.1 / tick), round(0.1 / tick), 0, round(0.1 / tick), 0],
    )
    assert found_after(cal, 0.01) is None
    for period in (0.0095, 0.0105):
        found = found_after(cal, period, 4.0)
        assert found is not None and 0.75 < found < 1.3


def test_lost_frames_missed_ticks_and_jitter_are_no_other_rate():
    cal = watched()
    ecu = begun(cal)
    # samples as old as three ticks, frames lost and ticks missed up to the timeout
    now = sample = 0
    for k in range(3000):
        elapsed = (1, 2, 5, 1, 3)[k % 5]
        now += elapsed
        sample = max(sample, now - k * 7 % 4)
        assert not ticks(ecu, cal, elapsed, sample)
    # and five ticks in a row without a frame
    for k in range(1, 400):
        arrived = now + k if k % TIMEOUT == 0 else None
        assert not ticks(ecu, cal, 1, arrived)


def test_ticks_without_a_frame_add_up():
    cal = watched()
    ecu = begun(cal)
    for gone in range(1, 4):
        ticks(ecu, cal, 1, None)
        assert ecu.sample_gap[0] == gone
    ticks(ecu, cal, 1, 4)
    assert (ecu.sample_gap[0], ecu.clock_ticks, ecu.clock_error) == (0, 4, 0)
    assert ecu.sample_count[0] == 4


@pytest.mark.parametrize(
    ("elapsed", "step", "window"),
    [
        (1, 1, (11, 0)),
        # a break as long as the timeout counts, a longer one does not
        (TIMEOUT, 5, (15, 0)),
        (TIMEOUT + 1, 6, (0, 0)),
        (AGE_MAX, 1, (0, 0)),
        # a step that is off by the limit counts, by more does not
        (1, 5, (11, 40_000)),
        (1, 6, (0, 0)),
        (5, 1, (15, -40_000)),
        (5, 0, (0, 0)),
        (1, 15, (0, 0)),
    ],
)
def test_a_break_or_a_reset_starts_the_window_anew(elapsed, step, window):
    cal = watched()
    ecu = begun(cal)
    for sample in range(1, 11):
        ticks(ecu, cal, 1, sample)
    assert (ecu.clock_ticks, ecu.clock_error) == (10, 0)
    assert not ticks(ecu, cal, elapsed, 10 + step)
    assert (ecu.clock_ticks, ecu.clock_error) == window
    assert (ecu.sample_gap[0], ecu.sample_count[0]) == (0, (10 + step) % 16)


@pytest.mark.parametrize("gap", [1, 3])
def test_the_first_sample_has_any_number(gap):
    cal = watched()
    ecu = rig.started(cal)
    assert ecu.sample_gap[0] == AGE_MAX
    assert not ticks(ecu, cal, gap, 2)
    assert (ecu.clock_ticks, ecu.clock_error, ecu.sample_count[0]) == (0, 0, 2)


@pytest.mark.parametrize(("more", "sign"), [(0, 1), (1, 1), (0, -1), (1, -1)])
def test_more_than_the_limit_is_reported_and_the_window_starts_anew(more, sign):
    cal = watched(clock_limit=LIMIT - more)
    ecu = begun(cal)
    for k in range(1, 5):
        # two samples a tick, or one of two
        reports = ticks(ecu, cal, 1 if sign > 0 else 2, 2 * k if sign > 0 else k)
        assert reports == (more == 1 and k == 4)
    assert ecu.clock_off == more
    left = 0 if more else sign * LIMIT
    assert (ecu.clock_error, ecu.clock_ticks == 0) == (left, more == 1)


def test_the_report_ends_with_a_window_that_is_good():
    cal = watched()
    ecu = begun(cal)
    sample = 0
    while not ecu.clock_off:
        sample += 2
        ticks(ecu, cal, 1, sample)
    reports = []
    for _ in range(WINDOW + 1):
        sample += 1
        reports.append(ticks(ecu, cal, 1, sample))
    assert reports == [True] * (WINDOW - 1) + [False] * 2
    # with the next window one tick old
    assert (ecu.clock_ticks, ecu.clock_error) == (1, 0)


def test_a_report_lasts_through_a_break():
    cal = watched()
    ecu = begun(cal)
    for k in range(1, 7):
        ticks(ecu, cal, 1, 2 * k)
    assert ecu.clock_off
    assert ticks(ecu, cal, 100, None)
    assert ticks(ecu, cal, 1, 3)


def test_off_it_counts_nothing():
    cal = watched(clock_period=0)
    ecu = rig.started(cal)
    for k in range(50):
        assert not ticks(ecu, cal, 1, 2 * k)
    assert (ecu.clock_error, ecu.clock_off) == (0, 0)


def test_it_is_reported_once_and_changes_no_mode():
    bench = rig.Bench(watched(clock_limit=0)).active()
    bench.sender.sample["Imu"] += 1
    bench.step()
    assert bench.ecu.fault_active == 0
    bench = rig.Bench(watched(clock_period=9000)).active()
    assert bench.ecu.fault_active == BIT
    assert bench.ecu.fault_count[FAULT_SAMPLE_RATE_OFF] == 1
    assert bench.ecu.mode == ACTIVE
