"""Allocation: what is asked is given, limits always hold, faults and clipping move the rest."""

import numpy as np
import pytest
import rig
from hypothesis import given
from hypothesis import strategies as st

from canroll.firmware import calibration as fw
from canroll.firmware.allocation import allocate

Q14 = 2**14
SIDES = np.array([1, -1, 1, -1])
moments = st.floats(-12000.0, 12000.0)
shares = st.floats(0.0, 1.0)
limits = st.lists(st.floats(0.0, 4000.0), min_size=4, max_size=4)


def suspension(share, force_max, slack=0.1, tracks=(1.638, 1.638)):
    front, rear = tracks
    return rig.calibration(
        force_max=[round(limit * Q14) for limit in force_max],
        share_slack=round(slack * 2**30),
        arm_front=round(2**28 / front),
        arm_rear=round(2**28 / rear),
        track_front=round(front * 2**28),
        track_rear=round(rear * 2**28),
        schedule_front_share=[round(share * 2**30)] * 8,
    )


def forces(cal, moment: float, failed=()) -> np.ndarray:
    ecu = rig.started(cal)
    ecu.front_share = cal.schedule_front_share[0]
    ecu.moment = round(moment * Q14)
    ecu.outputs[0] = ecu.moment
    for corner in failed:
        ecu.failed[corner], ecu.trust[corner] = 1, 0
    allocate(ecu, cal)
    given = np.array(ecu.force) / Q14
    arms = np.array([cal.track_front, cal.track_front, cal.track_rear, cal.track_rear]) / 2**29
    assert ecu.given / Q14 == pytest.approx(given @ (SIDES * arms), abs=0.01)
    return given


def axle_moments(force: np.ndarray, tracks=(1.638, 1.638)) -> np.ndarray:
    half = np.repeat(np.array(tracks) / 2, 2)
    return (force * SIDES * half).reshape(2, 2).sum(axis=1)


@given(moments, shares, limits, st.sets(st.integers(0, 3)), st.floats(0.0, 1.0))
def test_limits_hold_and_nothing_is_given_beyond_the_wish(moment, share, limit, failed, slack):
    cal = suspension(share, limit, slack)
    force = forces(cal, moment, failed)
    assert np.all(np.abs(force) <= np.array(limit) + 1e-4)
    assert all(force[corner] == 0 for corner in failed)
    given = axle_moments(force)
    # never against the wish, never more in total
    assert np.all(given * np.sign(moment) >= -0.02)
    assert abs(given.sum()) <= abs(moment) + 0.02
    # no axle takes more than its part and the slack
    assert np.all(np.abs(given) <= (np.array([share, 1 - share]) + slack) * abs(moment) + 0.02)


@given(moments, st.floats(0.2, 0.8), limits)
def test_with_free_slack_all_that_can_be_given_is(moment, share, limit):
    force = forces(suspension(share, limit, slack=1.0), moment)
    most = np.array(limit) @ np.full(4, 0.819)
    assert abs(axle_moments(force).sum()) == pytest.approx(min(abs(moment), most), abs=0.03)


def test_the_other_corner_of_the_axle_takes_over_first():
    force = forces(suspension(0.5, [4000.0] * 4, slack=0.0), 2000.0, failed=[0])
    np.testing.assert_allclose(axle_moments(force), [1000.0, 1000.0], atol=0.02)
    assert force[0] == 0
    assert force[1] == pytest.approx(-1000.0 / 0.819, abs=0.01)


def bars(cal, moment, outputs=None, failed=()):
    ecu = rig.started(cal)
    ecu.front_share = cal.schedule_front_share[0]
    ecu.outputs = [round(u * Q14) for u in (outputs or (moment, 0.0))]
    ecu.moment = round(moment * Q14)
    for corner in failed:
        ecu.failed[corner], ecu.trust[corner] = 1, 0
    allocate(ecu, cal)
    assert ecu.given == sum(ecu.bar)
    return np.array(ecu.bar) / Q14


@given(moments, shares, st.floats(0.0, 8000.0), st.floats(0.0, 8000.0))
def test_bars_share_a_moment_within_their_limits(moment, share, front_max, rear_max):
    cal = rig.calibration(
        actuator=fw.BARS,
        bar_max=[round(front_max * Q14), round(rear_max * Q14)],
        share_slack=1 << 30,
        schedule_front_share=[round(share * 2**30)] * 8,
    )
    bar = bars(cal, moment)
    assert np.all(np.abs(bar) <= np.array([front_max, rear_max]) + 1e-3)
    wanted = np.array([share, 1 - share]) * moment
    if np.all(np.abs(wanted) < [front_max, rear_max]):
        np.testing.assert_allclose(bar, wanted, atol=0.01)
    assert abs(bar.sum()) == pytest.approx(min(abs(moment), front_max + rear_max), abs=0.02)


def test_a_law_with_two_outputs_drives_each_bar_itself():
    cal = rig.calibration(actuator=fw.BARS, law=fw.COMPENSATOR, compensator_outputs=2)
    cal.compensator_shift, cal.compensator_output_shift = [1] * 8, [1] * 2
    np.testing.assert_allclose(bars(cal, 200.0, (700.0, -500.0)), [700.0, -500.0])
    # one bar clips: the other takes a tenth of the sum at most
    cal.bar_max[0] = 600 << 14
    np.testing.assert_allclose(bars(cal, 200.0, (700.0, -500.0)), [600.0, -480.0], atol=0.01)


@pytest.mark.parametrize("failed", [[0], [1], [0, 1], [2], [3], [2, 3]])
def test_a_failed_bar_gives_nothing_and_the_other_a_little_more(failed):
    cal = rig.calibration(actuator=fw.BARS, schedule_front_share=[1 << 29] * 8)
    given = [600.0, 0.0] if failed[0] // 2 else [0.0, 600.0]
    np.testing.assert_allclose(bars(cal, 1000.0, failed=failed), given, atol=0.01)


# soft and firm curves: knee speed, force there, slope beyond
SOFT, FIRM = (0.3, 1200.0, 800.0), (0.15, 3300.0, 2700.0)


def curve(parameters, speed):
    knee, force, slope = parameters
    return np.where(speed < knee, force * speed / knee, force + slope * (speed - knee))


def currents(moment, rates, share=0.5, failed=()):
    cal = rig.calibration(actuator=fw.DAMPERS, schedule_front_share=[round(share * 2**30)] * 8)
    cal.timeout_ticks[2] = 5
    ecu = rig.started(cal)
    ecu.front_share = cal.schedule_front_share[0]
    ecu.moment = round(moment * Q14)
    ecu.stroke_rate = [round(rate * 2**27) for rate in rates]
    for corner in failed:
        ecu.failed[corner] = 1
    allocate(ecu, cal)
    return np.array(ecu.current) / Q14


stroke_rates = st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4)


@given(moments, stroke_rates, shares)
def test_dampers_give_what_their_direction_lets_them(moment, rates, share):
    """The four conditions of Yim 2020: between soft and firm where the wish brakes, else soft."""
    rates = np.array(rates)
    current = currents(moment, rates, share)
    wanted = SIDES * np.repeat([share, 1 - share], 2) * moment / 1.638
    speed = np.abs(rates)
    soft, firm = curve(SOFT, speed), curve(FIRM, speed)
    # what the damper does to the body is against its stroke: extension pulls down
    brake = -np.sign(rates) * wanted
    expected = np.clip((brake - soft) / np.maximum(firm - soft, 1e-9), 0.0, 1.0) * 1600.0
    clear = (speed > 0.01) & (np.abs(wanted) > 1.0)
    np.testing.assert_allclose(current[clear], expected[clear], atol=2.0)
    assert np.all((current >= 0) & (current <= 1600.0))
    delivered = -np.sign(rates) * (soft + (firm - soft) * current / 1600.0)
    assert np.all(delivered * rates <= 1e-9)


@pytest.mark.parametrize("corner", range(4))
def test_valves_take_the_laws_currents_and_a_failed_corner_closes_that_of_its_axle(corner):
    cal = rig.calibration(actuator=fw.VALVES, law=fw.COMPENSATOR, compensator_outputs=2)
    cal.compensator_shift, cal.compensator_output_shift = [1] * 8, [1] * 2
    cal.current_max = 8000 << 14
    ecu = rig.started(cal)
    ecu.outputs = [5000 << 14, -9000 << 14]
    allocate(ecu, cal)
    expected = [5000 << 14, -8000 << 14]
    assert ecu.current[:2] == expected
    ecu.failed[corner] = 1
    allocate(ecu, cal)
    expected[corner // 2] = 0
    assert ecu.current[:2] == expected
