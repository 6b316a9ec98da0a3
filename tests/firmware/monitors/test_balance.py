"""Balances: filters as scipy's, and room that grows at once and fades."""

import numpy as np
import pytest
import rig
from scipy.signal import lfilter

from canroll.firmware import calibration as fw
from canroll.firmware.monitors.residual import (
    AXLES,
    BODY,
    DAMPER_STEPS,
    DAMPERS,
    HEAVE,
    SPRINGS,
    balance,
    beyond,
    change,
    high_pass,
    judge_axles,
    mean_step,
    peak_hold,
    share,
    start_balance,
)

PASS, QUICK, SLOW, OF_AXLES = 0.2, 0.05, 0.0008, 0.0126
ONE = 2.0**fw.Q_MOMENT


def watched() -> fw.Calibration:
    """A calibration with all filters."""
    cal = rig.calibration()
    cal.response_pass = round(PASS * 2**30)
    cal.response_wash = [round(wash * 2**30) for wash in (QUICK, SLOW, OF_AXLES)]
    return cal


@pytest.mark.parametrize(("row", "wash"), [(BODY, QUICK), (HEAVE, SLOW), (AXLES, OF_AXLES)])
def test_what_is_left_is_washed_out_and_low_passed(row, wash):
    cal = watched()
    ecu = rig.started(cal)
    acting = 3000.0 * np.random.default_rng(5).standard_normal(400)
    acting[0] = 0.0
    start_balance(ecu, row, 0)
    weight = round(wash * 2**30)
    left = [balance(ecu, cal, row, round(value * ONE), weight) / ONE for value in acting]
    # a washed-out sample is of the sum of what was washed out before it
    washed = lfilter([1.0, -1.0], [1.0, -(1.0 - wash)], acting)
    slow = lfilter([PASS], [1.0, -(1.0 - PASS)], washed)
    np.testing.assert_allclose(left, slow, atol=0.5)


def test_momentum_enters_by_its_change():
    cal = watched()
    ecu = rig.started(cal)
    momentum = np.cumsum(np.random.default_rng(6).standard_normal(300)) * 500.0
    ecu.passed[BODY] = round(momentum[0] * ONE)
    left = [change(ecu, BODY, round(value * ONE), cal.response_pass) / ONE for value in momentum]
    slow = lfilter([1.0 - PASS, -(1.0 - PASS)], [1.0, -(1.0 - PASS)], momentum - momentum[0])
    np.testing.assert_allclose(left, slow, atol=0.5)


def test_what_is_new_is_washed_out_faster():
    ecu = rig.started(watched())
    values = np.cumsum(np.random.default_rng(7).standard_normal(300)) * 500.0
    start_balance(ecu, SPRINGS, 0)
    new = [high_pass(ecu, SPRINGS, round(value * ONE), round(PASS * 2**30)) for value in values]
    washed = lfilter([1.0, -1.0], [1.0, -(1.0 - PASS)], values)
    np.testing.assert_allclose(np.divide(new, ONE), washed, atol=0.5)


def test_a_balance_starts_with_nothing_left_over():
    cal = watched()
    ecu = rig.started(cal)
    ecu.bound[AXLES] = 1000
    start_balance(ecu, AXLES, 5000)
    assert ecu.bound[AXLES] == 0
    assert balance(ecu, cal, AXLES, 5000, 1 << 20) == 0


def test_room_grows_at_once_and_fades():
    held, rooms = 0, []
    for size in [0, 1 << 20, 0, 0, 1 << 10]:
        held = peak_hold(held, size, 1 << 28)
        rooms.append(held)
    assert rooms == [0, 1 << 20, 3 << 18, 9 << 16, 27 << 14]


def test_evidence_counts_to_one_side_without_a_break():
    cal = watched()
    ecu = rig.started(cal)
    counts = []
    for left in (6, 11, -6, -11, 5, 6, 6, 11, 6):
        judge_axles(ecu, BODY, left, 5, 4)
        counts.append((ecu.evidence[BODY], ecu.contradicted))
    assert counts == list(zip([1, 3, 1, 3, 0, 1, 2, 4, 4], [0] * 7 + [24, 24], strict=True))


def test_beyond_the_double_counts_twice():
    assert [beyond(value, 5) for value in (5, 6, 10, 11)] == [0, 1, 1, 2]
    assert beyond(fw.STATE_MAX, fw.STATE_MAX) == 0


def test_the_mean_change_follows_that_of_an_input():
    cal = watched()
    ecu = rig.started(cal)
    random = np.random.default_rng(8)
    values = 300.0 * random.standard_normal(6000)
    for value in values:
        mean = mean_step(ecu, cal, DAMPERS, DAMPER_STEPS, round(value * ONE))
    # forgotten in 1024 samples; of normal noise a change is 2/sqrt(pi) deviations on average
    assert mean / ONE == pytest.approx(300.0 * 2.0 / np.sqrt(np.pi), rel=0.05)


def test_a_share_is_of_a_magnitude():
    assert share(-3000, round(0.25 * 2**fw.Q_SHARE)) == share(3000, 1 << fw.Q_SHARE - 2) == 750
