"""Balances: filters as scipy's, and room that grows at once and fades."""

import numpy as np
import pytest
import rig
from scipy.signal import lfilter

from firmware import calibration as fw
from firmware.monitors.balance import (
    AXLES,
    BODY,
    BOTH,
    DAMPERS,
    HEAVE,
    LATERAL,
    ONE_BALANCE,
    SPRINGS,
    high_pass,
    mean_change,
    raise_threshold,
    residual,
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


@pytest.mark.parametrize(
    ("which", "judged", "wash"),
    [
        (BODY, BOTH, QUICK),
        (LATERAL, ONE_BALANCE, QUICK),
        (LATERAL, BOTH, SLOW),
        (HEAVE, ONE_BALANCE, SLOW),
        (AXLES, BOTH, OF_AXLES),
    ],
    ids=str,
)
def test_what_is_left_is_washed_out_and_low_passed(which, judged, wash):
    cal = watched()
    ecu = rig.started(cal)
    ecu.response_known = judged
    acting = 3000.0 * np.random.default_rng(5).standard_normal(400)
    acting[0] = 0.0
    start_balance(ecu, which, 0, 0)
    left = [residual(ecu, cal, which, round(value * ONE), 0) / ONE for value in acting]
    # a washed-out sample is of the sum of what was washed out before it
    washed = lfilter([1.0, -1.0], [1.0, -(1.0 - wash)], acting)
    slow = lfilter([PASS], [1.0, -(1.0 - PASS)], washed)
    np.testing.assert_allclose(left, slow, atol=0.5)


def test_momentum_enters_by_its_change():
    cal = watched()
    ecu = rig.started(cal)
    momentum = np.cumsum(np.random.default_rng(6).standard_normal(300)) * 500.0
    start_balance(ecu, BODY, 0, round(momentum[0] * ONE))
    left = [residual(ecu, cal, BODY, 0, round(value * ONE)) / ONE for value in momentum]
    slow = lfilter([1.0 - PASS, -(1.0 - PASS)], [1.0, -(1.0 - PASS)], momentum - momentum[0])
    np.testing.assert_allclose(left, slow, atol=0.5)


def test_what_is_new_is_washed_out_faster():
    ecu = rig.started(watched())
    values = np.cumsum(np.random.default_rng(7).standard_normal(300)) * 500.0
    start_balance(ecu, SPRINGS, 0, 0)
    new = [high_pass(ecu, SPRINGS, round(value * ONE), round(PASS * 2**30)) for value in values]
    washed = lfilter([1.0, -1.0], [1.0, -(1.0 - PASS)], values)
    np.testing.assert_allclose(np.divide(new, ONE), washed, atol=0.5)


def test_a_balance_starts_with_nothing_left_over():
    cal = watched()
    ecu = rig.started(cal)
    raise_threshold(ecu, AXLES, 1000, 0)
    start_balance(ecu, AXLES, 5000, -7000)
    assert ecu.balance_uncertainty[AXLES] == 0
    assert residual(ecu, cal, AXLES, 5000, -7000) == 0


def test_room_grows_at_once_and_fades():
    ecu = rig.started(watched())
    rooms = []
    for size in [0, 1 << 20, 0, 0, 1 << 10]:
        raise_threshold(ecu, BODY, size, 1 << 28)
        rooms.append(ecu.balance_uncertainty[BODY])
    assert rooms == [0, 1 << 20, 3 << 18, 9 << 16, 27 << 14]


def test_the_mean_change_follows_that_of_an_input():
    cal = watched()
    ecu = rig.started(cal)
    random = np.random.default_rng(8)
    values = 300.0 * random.standard_normal(6000)
    for value in values:
        mean = mean_change(ecu, cal, DAMPERS, round(value * ONE))
    # forgotten in 1024 samples; of normal noise a change is 2/sqrt(pi) deviations on average
    assert mean / ONE == pytest.approx(300.0 * 2.0 / np.sqrt(np.pi), rel=0.05)


def test_a_share_is_of_a_magnitude():
    assert share(-3000, round(0.25 * 2**fw.Q_SHARE)) == share(3000, 1 << fw.Q_SHARE - 2) == 750
