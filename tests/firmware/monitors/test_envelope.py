"""The safety envelope: each of its rules to the unit and to the tick."""

import pytest
import rig
from hypothesis import given as over
from hypothesis import strategies as st

from canroll.firmware import calibration as fw
from canroll.firmware import plausibility as sv
from canroll.firmware.monitors import envelope
from canroll.firmware.state import AGE_MAX, RX_IMU, RX_ROLL_REFERENCE

NM = 1 << fw.Q_MOMENT
ACCELERATION = 1 << fw.Q_ACCELERATION
MOST, SLEW, OUTWARD, LATERAL = 3000 * NM, 500 * NM, 600 * NM, 2 * ACCELERATION
TICKS = 10


def calibration(**overrides):
    limits = {
        "envelope_moment": MOST,
        "envelope_slew": SLEW,
        "envelope_age": 40,
        "envelope_outward": OUTWARD,
        "envelope_lateral": LATERAL,
        "envelope_ticks": TICKS,
        "envelope_pass": fw.ONE >> 4,
    }
    return rig.calibration(**{**limits, **overrides})


def pushed(ecu, cal, outputs, acceleration=0, elapsed=1):
    """One tick of the envelope on ``outputs`` of the law; what it gives."""
    ecu.outputs = list(outputs)
    # what was received and not believed counts for nothing
    ecu.acceleration_good, ecu.lateral_acceleration = acceleration, -acceleration
    envelope.guard(ecu, cal, elapsed)
    assert ecu.guarded == ecu.outputs
    assert ecu.moment == sum(ecu.outputs)
    return ecu.outputs


def bench(**overrides):
    cal = calibration(**overrides)
    return rig.started(cal), cal


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("output", [0, 1])
def test_the_moment_is_limited_to_the_unit(sign, output):
    ecu, cal = bench(envelope_slew=fw.STATE_MAX)
    for wanted, given in ((MOST, MOST), (MOST + 1, MOST), (fw.STATE_MAX, MOST)):
        outputs = [0, 0]
        outputs[output] = sign * wanted
        assert pushed(ecu, cal, outputs)[output] == sign * given
        assert ecu.envelope_acted == (wanted != given)


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("elapsed", [1, 3])
def test_it_changes_no_faster_than_the_slew(sign, elapsed):
    ecu, cal = bench()
    step = elapsed * SLEW
    ecu.guarded = [-sign * 100, 0]
    assert pushed(ecu, cal, [sign * (step - 100), 0], elapsed=elapsed)[0] == sign * (step - 100)
    assert ecu.envelope_acted == 0
    ecu.guarded = [-sign * 100, 0]
    assert pushed(ecu, cal, [sign * (step - 99), 0], elapsed=elapsed)[0] == sign * (step - 100)
    assert ecu.envelope_acted == 1
    assert pushed(ecu, cal, [-sign * MOST, 0], elapsed=elapsed)[0] == -sign * 100


@pytest.mark.parametrize("observer", [fw.BYPASS, fw.CONSTANT_GAIN])
def test_an_old_measurement_ends_the_moment(observer):
    message, other = RX_IMU, RX_ROLL_REFERENCE
    if observer == fw.BYPASS:
        message, other = other, message
    ecu, cal = bench(observer=observer, timeout_ticks=[5, 10, 0, 5, 5])
    ecu.guarded = [2 * SLEW, -SLEW]
    ecu.age[message], ecu.age[other] = cal.envelope_age, AGE_MAX
    assert pushed(ecu, cal, [2 * SLEW, -SLEW]) == [2 * SLEW, -SLEW]
    ecu.age[message] += 1
    assert pushed(ecu, cal, [2 * SLEW, -SLEW]) == [SLEW, 0]
    assert ecu.envelope_acted == 1
    assert pushed(ecu, cal, [2 * SLEW, -SLEW]) == [0, 0]


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("outputs", [(1, 0), (0, 1)])
def test_a_push_outward_is_cut_after_its_time_and_free_again_after_as_long(sign, outputs):
    ecu, cal = bench(envelope_slew=fw.STATE_MAX)
    push = [sign * (OUTWARD + 1) * k for k in outputs]
    turn = sign * (LATERAL + 1)
    for k in range(TICKS - 1):
        assert pushed(ecu, cal, push, turn) == push
        assert (ecu.outward_ticks, ecu.outward_cut, ecu.envelope_acted) == (k + 1, 0, 0)
    assert pushed(ecu, cal, push, turn) == [0, 0]
    assert (ecu.outward_ticks, ecu.outward_cut, ecu.envelope_acted) == (TICKS, 1, 1)
    # the other side stays open, and the cut lasts as long as the push did
    inward = [-its for its in push]
    for k in range(TICKS - 1):
        assert pushed(ecu, cal, inward, turn) == inward
        assert (ecu.outward_ticks, ecu.outward_cut, ecu.envelope_acted) == (TICKS - 1 - k, 1, 0)
    assert pushed(ecu, cal, push, -turn) == push
    assert (ecu.outward_ticks, ecu.outward_cut) == (0, 0)


@pytest.mark.parametrize(("acceleration", "open_side"), [(0, 1), (1, -1), (-1, 1)])
def test_a_cut_closes_the_side_that_the_acceleration_has_now(acceleration, open_side):
    ecu, cal = bench(envelope_slew=fw.STATE_MAX)
    for side in (-1, 1):
        ecu.outward_ticks, ecu.outward_cut = 5, 1
        given = pushed(ecu, cal, [side * MOST, 0], acceleration)[0]
        assert given == (side * MOST if side == open_side else 0)


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(("moment", "lateral"), [(OUTWARD, 2 * LATERAL), (MOST, LATERAL)])
def test_at_the_thresholds_themselves_nothing_is_outward(sign, moment, lateral):
    ecu, cal = bench(envelope_slew=fw.STATE_MAX)
    for _ in range(3):
        assert pushed(ecu, cal, [sign * moment, 0], sign * lateral) == [sign * moment, 0]
        assert ecu.outward_ticks == 0
    pushed(ecu, cal, [sign * (OUTWARD + 1), 0], sign * (LATERAL + 1))
    assert ecu.outward_ticks == 1


@pytest.mark.parametrize("sign", [-1, 1])
def test_what_pushes_outward_while_the_acceleration_falls_damps(sign):
    ecu, cal = bench(envelope_slew=fw.STATE_MAX, envelope_pass=0)
    ecu.lateral_slow = sign * 2 * LATERAL
    fallen = 2 * LATERAL - LATERAL // 8
    push = [sign * MOST, 0]
    pushed(ecu, cal, push, sign * fallen)
    assert ecu.outward_ticks == 0
    pushed(ecu, cal, push, sign * (fallen + 1))
    assert ecu.outward_ticks == 1
    pushed(ecu, cal, push, sign * fallen)
    assert ecu.outward_ticks == 0


def test_the_low_pass_follows_the_acceleration():
    ecu, cal = bench(envelope_pass=fw.ONE >> 2)
    for expected in (0.25, 0.4375):
        pushed(ecu, cal, [0, 0], ACCELERATION)
        assert ecu.lateral_slow == round(expected * ACCELERATION)


def test_missed_ticks_count_as_many():
    ecu, cal = bench(envelope_slew=fw.STATE_MAX)
    pushed(ecu, cal, [MOST, 0], 2 * LATERAL, elapsed=TICKS - 1)
    assert (ecu.outward_ticks, ecu.outward_cut) == (TICKS - 1, 0)
    pushed(ecu, cal, [0, 0], 2 * LATERAL, elapsed=2)
    assert ecu.outward_ticks == TICKS - 3


def test_without_an_acceleration_no_direction_is_judged():
    ecu, cal = bench(envelope_slew=fw.STATE_MAX)
    ecu.lateral_lost, ecu.outward_ticks, ecu.lateral_slow = 1, 4, 77
    assert pushed(ecu, cal, [MOST, 0], 2 * LATERAL) == [MOST, 0]
    assert (ecu.outward_ticks, ecu.lateral_slow) == (4, 77)


def test_the_reference_takes_the_place_of_the_sensor_where_the_law_bypasses_it():
    ecu, cal = bench(observer=fw.BYPASS, timeout_ticks=[5, 10, 0, 5, 5], envelope_slew=fw.STATE_MAX)
    ecu.reference_acceleration = 2 * LATERAL
    for _ in range(TICKS):
        given = pushed(ecu, cal, [MOST, 0], -2 * LATERAL)
    assert given == [0, 0]


def valve_bench():
    ecu, cal = bench(envelope_slew=fw.STATE_MAX)
    cal.actuator = fw.VALVES
    return ecu, cal


@pytest.mark.parametrize("axle", [0, 1])
def test_valves_are_judged_by_what_they_deliver(axle):
    ecu, cal = valve_bench()
    ecu.delivered[axle] = OUTWARD + 1
    for _ in range(TICKS - 1):
        assert pushed(ecu, cal, [-MOST, MOST], 2 * LATERAL) == [-MOST, MOST]
    assert pushed(ecu, cal, [-MOST, MOST], 2 * LATERAL) == [0, 0]
    assert pushed(ecu, cal, [-MOST, MOST], -2 * LATERAL) == [0, 0]


CHANNELS = [
    (fw.SUSPENSION, "force", 4, "force_max", True),
    (fw.BARS, "bar", 2, "bar_max", True),
    (fw.VALVES, "current", 4, "current_max", True),
    (fw.DAMPERS, "current", 4, "current_max", False),
]


@pytest.mark.parametrize(("actuator", "field", "count", "limit", "both"), CHANNELS)
def test_every_channel_stays_within_its_actuator(actuator, field, count, limit, both):
    ecu, cal = bench()
    cal.actuator = actuator
    if limit != "current_max":
        setattr(cal, limit, [(100 + k) * NM for k in range(count)])
    for channel in range(count):
        most = getattr(cal, limit) if limit == "current_max" else getattr(cal, limit)[channel]
        low = -most if both else 0
        for wanted, given in ((most, most), (most + 1, most), (low, low), (low - 1, low)):
            ecu.envelope_acted = 0
            getattr(ecu, field)[channel] = wanted
            envelope.bound(ecu, cal)
            assert getattr(ecu, field)[channel] == given
            assert ecu.envelope_acted == (wanted != given)


def test_it_says_so_with_a_fault_code():
    its = rig.Bench(calibration(envelope_moment=100 * NM, envelope_slew=fw.STATE_MAX))
    for _ in range(100):
        its.step(rig.lane_change)
    assert abs(its.ecu.moment) <= 100 * NM
    assert its.ecu.fault_latched >> sv.FAULT_ENVELOPE & 1
    assert its.ecu.fault_count[sv.FAULT_ENVELOPE] > 0


def test_a_law_of_the_wrong_sign_is_cut():
    free, kept = (
        rig.Bench(
            calibration(
                feedback=-rig.FEEDBACK,
                feedforward=-4 * rig.FEEDFORWARD,
                envelope_slew=fw.STATE_MAX,
                envelope_ticks=ticks,
            )
        )
        for ticks in (1 << 20, TICKS)
    )
    outward = [0, 0]
    for _ in range(300):
        for k, its in enumerate((free, kept)):
            its.step(lambda t: 4.0)
            outward[k] += its.ecu.moment > OUTWARD
    assert outward[0] > 200
    assert outward[1] <= TICKS
    assert kept.ecu.fault_active >> sv.FAULT_ENVELOPE & 1


words = st.integers(-(2**30), 2**30 - 1)


@over(words, words, st.integers(0, 2**30 - 1), st.integers(1, 2**30 - 1), st.integers(1, 1 << 20))
def test_whatever_comes_in_the_limits_hold(wanted, last, most, slew, elapsed):
    cal = fw.Calibration()
    cal.envelope_moment, cal.envelope_slew = most, slew
    before = max(-most, min(most, last))
    out = envelope.enveloped(cal, wanted, before, elapsed)
    assert abs(out) <= most
    assert abs(out - before) <= elapsed * slew
    if abs(wanted) <= most and abs(wanted - before) <= elapsed * slew:
        assert out == wanted
