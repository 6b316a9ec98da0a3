"""Which side a threshold belongs to, and what happens at zero: to the unit, to the tick."""

import pytest
import rig

from canroll.firmware import calibration as fw
from canroll.firmware import ecu as loop
from canroll.firmware import plausibility as sv
from canroll.firmware.com.mailbox import read_inputs
from canroll.firmware.com.signals import RX_SIGNALS
from canroll.firmware.control_law import control
from canroll.firmware.covariance import bounded, propagate, update
from canroll.firmware.event_trigger import NOTHING, moved, trigger
from canroll.firmware.identification import identify
from canroll.firmware.observer import lateral_by_steering, learn_offsets, look_ahead, observe
from canroll.firmware.schedule import schedule
from canroll.firmware.state import (
    ACTIVE,
    RX_ACTUATOR_STATE,
    RX_IMU,
    RX_ROLL_REFERENCE,
    RX_VEHICLE_MOTION,
)

STEP = 1 << 12
"""Quarter newton metres, in which the trigger compares."""


@pytest.mark.parametrize(
    ("floor", "relative", "sent", "threshold"),
    [
        (0, 0, 0, 0),
        (0, 1, 0, 0),
        (40, 0, 0, 40),
        (0, 1, 30, 30),
        (40, 1, 30, 50),
        (40, 0.25, 60, 50),
    ],
)
def test_a_command_that_moves_by_the_threshold_itself_is_not_sent(floor, relative, sent, threshold):
    cal = rig.calibration(
        trigger_floor=floor * STEP, trigger_epsilon_squared=round(relative * 2**20)
    )
    ecu = rig.started(cal)
    ecu.sent[0] = sent * STEP
    for error, expected in ((threshold, 0), (threshold + 1, 1)):
        for sign in (-1, 1):
            ecu.outputs[0] = (sent + sign * error) * STEP
            assert moved(ecu, cal) == expected


def waiting_for_an_echo():
    """Counter 5 has been sent, the echo of 2 has come; nothing is due for long."""
    cal = rig.calibration(event_trigger=1, heartbeat_ticks=1000, acknowledge_ticks=100)
    ecu = rig.started(cal)
    ecu.waiting, ecu.unacknowledged, ecu.since_sent, ecu.echo = 1, 7, 3, 2
    ecu.tx_counter[0] = 5
    ecu.fresh[RX_ACTUATOR_STATE] = RX_SIGNALS[RX_ACTUATOR_STATE]
    ecu.command_held, ecu.accepted_counter = 1, 2
    return ecu, cal


def test_an_echo_of_an_older_command_restarts_the_wait_and_that_of_the_last_ends_it():
    ecu, cal = waiting_for_an_echo()
    trigger(ecu, cal, 1)
    assert (ecu.waiting, ecu.unacknowledged, ecu.since_sent) == (1, 8, 4)
    ecu.accepted_counter = 4
    trigger(ecu, cal, 1)
    assert (ecu.waiting, ecu.unacknowledged, ecu.since_sent) == (1, 1, 5)
    ecu.accepted_counter = 5
    trigger(ecu, cal, 1)
    assert (ecu.waiting, ecu.unacknowledged, ecu.since_sent) == (0, 0, 6)
    assert ecu.triggered == NOTHING


@pytest.mark.parametrize("change", [{"fresh": [0] * fw.N_RX}, {"command_held": 0}, {"waiting": 0}])
def test_what_is_no_new_echo_is_not_taken_for_one(change):
    ecu, cal = waiting_for_an_echo()
    ecu.accepted_counter = 4
    for name, value in change.items():
        setattr(ecu, name, value)
    trigger(ecu, cal, 1)
    assert ecu.echo == 2


def test_commands_are_counted_one_by_one():
    bench = rig.Bench(rig.calibration(event_trigger=1, trigger_floor=60 << 14))
    sent = beats = 0
    for _ in range(150):
        bench.step(rig.lane_change)
        sent += bench.ecu.triggered > 0
        beats += bench.ecu.triggered == 2
        assert bench.ecu.commands_sent == sent
    assert 0 < beats < sent
    ecu, cal = bench.ecu, bench.cal
    ecu.commands_sent = 2**31 - 1
    for _ in range(10):
        bench.step()
    assert ecu.commands_sent == 2**31 - 1
    assert cal.heartbeat_ticks == 5


def test_status_and_diagnostics_come_in_their_period_from_the_start():
    bench = rig.Bench(rig.calibration(status_ticks=7))
    due = []
    for k in range(1, 40):
        bench.step()
        if 4 in bench.frames:
            due.append((k, bench.frames[5]["Page"]))
    assert due == [(7, 0), (14, 1), (21, 2), (28, 3), (35, 4)]
    late = rig.Bench(rig.calibration(status_ticks=7))
    late.step(elapsed=6)
    assert 4 not in late.frames
    late.step()
    assert 4 in late.frames


def straight(**changes):
    """Straight ahead at full speed with sensors that are off by 256 units."""
    cal = rig.calibration(offset_learning=1, **changes)
    ecu = rig.started(cal)
    ecu.fresh[RX_IMU], ecu.motion_lost = RX_SIGNALS[RX_IMU], 0
    ecu.speed = cal.fade_high
    ecu.roll_rate = ecu.lateral_acceleration = 256
    return ecu, cal


@pytest.mark.parametrize(
    ("change", "learnt"),
    [
        (lambda ecu, cal: None, (1, 1)),
        (lambda ecu, cal: setattr(ecu, "speed", cal.fade_high - 1), (0, 0)),
        (lambda ecu, cal: setattr(ecu, "speed", 1), (0, 0)),
        (lambda ecu, cal: setattr(ecu, "speed", 0), (1, 0)),
        (lambda ecu, cal: setattr(ecu, "steering", cal.straight_steering), (1, 1)),
        (lambda ecu, cal: setattr(ecu, "steering", cal.straight_steering + 1), (0, 0)),
        (lambda ecu, cal: setattr(ecu, "steering", -cal.straight_steering), (1, 1)),
        (lambda ecu, cal: setattr(ecu, "steering", -cal.straight_steering - 1), (0, 0)),
        (lambda ecu, cal: setattr(ecu, "yaw_rate", -cal.straight_yaw_rate), (1, 1)),
        (lambda ecu, cal: setattr(ecu, "yaw_rate", cal.straight_yaw_rate + 1), (0, 0)),
        (lambda ecu, cal: setattr(ecu, "motion_lost", 1), (0, 0)),
        (lambda ecu, cal: ecu.fresh.__setitem__(RX_IMU, 0), (0, 0)),
        (lambda ecu, cal: ecu.bad_ticks.__setitem__(sv.BAD_ROLL_RATE, 1), (0, 0)),
        (lambda ecu, cal: ecu.bad_ticks.__setitem__(sv.BAD_ACCELERATION, 1), (0, 0)),
        (lambda ecu, cal: setattr(ecu, "offset_rate", 512), (511, 1)),
        (lambda ecu, cal: setattr(ecu, "offset_acceleration", 512), (1, 511)),
    ],
)
def test_offsets_are_learnt_up_to_the_edge_of_straight_ahead(change, learnt):
    ecu, cal = straight()
    change(ecu, cal)
    learn_offsets(ecu, cal)
    assert (ecu.offset_rate, ecu.offset_acceleration) == learnt


def test_a_law_without_gains_asks_for_nothing():
    for law in (fw.STATE_FEEDBACK, fw.OUTPUT_FEEDBACK, fw.COMPENSATOR):
        cal = rig.calibration(law=law, feedback=[0] * 5, feedforward=[0] * 5, output_gain=[0] * 3)
        cal.feedback_shift = cal.feedforward_shift = cal.output_gain_shift = 1
        cal.compensator_shift, cal.compensator_output_shift = [1] * 8, [1] * 2
        ecu = rig.started(cal)
        ecu.mode, ecu.authority, ecu.gain_factor = ACTIVE, 1 << 30, 1 << 28
        ecu.ahead = [1 << 20] * 5
        control(ecu, cal, 1)
        assert (ecu.moment, ecu.outputs) == (0, [0, 0])


def test_bounds_of_a_ratio_may_be_the_same():
    cal = rig.calibration(rls_lo=[1 << 28, 1 << 27], rls_hi=[1 << 28, 1 << 27])
    ecu = rig.started(cal)
    assert ecu.theta == [1 << 28, 1 << 27]


def test_the_shortest_timeout_is_a_timeout():
    cal = rig.calibration(timeout_ticks=[1, 1, 1, 1, 1])
    for changes in ({}, {"actuator": fw.DAMPERS}, {"observer": fw.BYPASS}):
        for name, value in changes.items():
            setattr(cal, name, value)
        assert rig.started(cal).refused == 0


def identifying(**changes):
    """Settled, with a roll rate of ``rls_gate`` that the filters keep as it is."""
    cal = rig.calibration(identification=1, rls_decimation=1, rls_washout=1 << 30, **changes)
    ecu = rig.started(cal)
    ecu.moment_unknown = 0
    ecu.rls_filled = 200
    ecu.rls_washed[2] = cal.rls_gate
    ecu.rls_integrals = [1 << 20, 1 << 20]
    return ecu, cal


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_roll_rate_at_the_gate_teaches(sign):
    for below, teaches in ((0, True), (1, False)):
        ecu, cal = identifying()
        ecu.rls_washed[2] = sign * (cal.rls_gate - below)
        before = list(ecu.rls_covariance)
        identify(ecu, cal, 1)
        assert (ecu.rls_covariance != before) == teaches


@pytest.mark.parametrize(
    ("change", "elapsed", "restarts"),
    [
        (lambda ecu: None, 1, False),
        (lambda ecu: None, 2, True),
        (lambda ecu: ecu.age.__setitem__(RX_IMU, 1), 1, False),
        (lambda ecu: ecu.age.__setitem__(RX_IMU, 2), 1, True),
        (lambda ecu: setattr(ecu, "moment_unknown", 1), 1, True),
        (lambda ecu: ecu.bad_ticks.__setitem__(sv.BAD_ROLL_RATE, 1), 1, True),
        (lambda ecu: ecu.bad_ticks.__setitem__(sv.BAD_ACCELERATION, 2), 1, True),
    ],
)
def test_a_gap_empties_the_window_and_keeps_what_was_learnt(change, elapsed, restarts):
    ecu, cal = identifying()
    ecu.theta = [300 << 20, 200 << 20]
    ecu.rls_history = [[5] * 10, [6] * 10]
    ecu.rls_index = 4
    change(ecu)
    identify(ecu, cal, elapsed)
    if restarts:
        assert (ecu.rls_filled, ecu.rls_index, ecu.rls_integrals) == (0, 0, [0, 0])
        assert ecu.rls_history == [[0] * 10, [0] * 10]
        assert ecu.rls_washed == [0] * 5
        assert ecu.theta == [300 << 20, 200 << 20]
    else:
        assert (ecu.rls_filled, ecu.rls_index) == (200, 5)


def test_filters_start_where_the_signals_are_and_settle_before_anything_is_learnt():
    ecu, cal = identifying(rls_gate=0)
    ecu.rls_washed, ecu.rls_filled, ecu.rls_integrals = [0] * 5, 0, [0, 0]
    ecu.rate_good, ecu.acceleration_good = 1 << 24, 1 << 22
    before = list(ecu.rls_covariance)
    for k in range(200):
        identify(ecu, cal, 1)
        assert ecu.rls_filled == k + 1
        # a constant signal is no change
        assert ecu.rls_washed == [0] * 5
        assert ecu.rls_covariance == before
    identify(ecu, cal, 1)
    assert ecu.rls_filled == 200
    assert ecu.rls_covariance != before


def test_a_step_of_the_identification_takes_its_ticks():
    for decimation in (1, 2, 20):
        ecu, cal = identifying()
        cal.rls_decimation, ecu.rls_filled = decimation, 0
        for k in range(1, 61):
            identify(ecu, cal, 1)
            assert ecu.rls_filled == k // decimation


def covariances(rows) -> list[list[int]]:
    """Five by five, zero but for what ``rows`` says by row and column."""
    return [[rows.get((i, j), 0) for j in range(5)] for i in range(5)]


ONE, UNDER_HALF = 1 << 24, (1 << 23) - 1


@pytest.mark.parametrize(("first", "second"), [(ONE, UNDER_HALF), (UNDER_HALF, ONE)])
def test_a_propagated_covariance_under_half_a_unit_is_none(first, second):
    cal = rig.calibration(observer=fw.PROPAGATED_COVARIANCE, process_noise=[7] * 5)
    cal.covariance_phi = covariances({(0, 0): first, (1, 0): second})
    ecu = rig.started(cal)
    ecu.covariance = covariances({(0, 0): 1})
    propagate(ecu, cal, 1)
    assert ecu.covariance[0][1] == ecu.covariance[1][0] == 0


def test_an_updated_covariance_under_half_a_unit_is_none():
    cal = rig.calibration(observer=fw.PROPAGATED_COVARIANCE, measurement_noise=[1, 1])
    cal.covariance_output[0] = [UNDER_HALF, 0, 0, 0, 0]
    cal.covariance_gain_shift[0] = [24] * 5
    for variance, gain in ((1, 0), (3, 1)):
        ecu = rig.started(cal)
        ecu.covariance = covariances({(0, 0): variance})
        update(ecu, cal, 0, 100)
        assert ecu.x == [100 * gain, 0, 0, 0, 0]


def watching(**changes):
    """A model that stays where it is; each measurement corrects a state of its own by its value."""
    cal = rig.calibration(gamma=[0] * 5, gamma_steering=[0] * 5, **changes)
    cal.phi, cal.phi_shift = [[2 * int(i == j) for j in range(5)] for i in range(5)], [1] * 5
    cal.output, cal.output_moment, cal.output_shift = [[0] * 5] * 3, [0] * 3, [1] * 3
    cal.correction = [[2, 0, 0, 0, 0], [0, 2, 0, 0, 0], [0] * 5]
    cal.correction_single = [0, 0, 2, 0, 0]
    cal.correction_shift, cal.correction_single_shift = [[1] * 5] * 3, [1] * 5
    ecu = rig.started(cal)
    ecu.fresh[RX_IMU] = RX_SIGNALS[RX_IMU]
    ecu.roll_rate, ecu.lateral_acceleration = 1000, 2000
    return ecu, cal


@pytest.mark.parametrize(
    ("measurements", "bad", "lost", "expected"),
    [
        (3, (0, 0), 0, [1000, 2000, 0]),
        (1, (0, 0), 0, [1000, 0, 0]),
        (2, (0, 0), 0, [0, 2000, 0]),
        (3, (1, 0), 0, [0, 2000, 0]),
        (3, (0, 1), 0, [1000, 0, 0]),
        (3, (0, 1), 1, [0, 0, 1000]),
        (3, (0, 9), 1, [0, 0, 1000]),
        # good again, though not yet trusted by the feedforward
        (3, (0, 0), 1, [1000, 2000, 0]),
        (3, (1, 1), 1, [0, 0, 0]),
    ],
)
def test_what_is_measured_and_good_corrects(measurements, bad, lost, expected):
    ecu, cal = watching(measurements=measurements)
    ecu.bad_ticks[sv.BAD_ROLL_RATE], ecu.bad_ticks[sv.BAD_ACCELERATION] = bad
    ecu.lateral_lost = lost
    observe(ecu, cal, 1)
    assert ecu.x == [*expected, 0, 0]
    ecu.fresh[RX_IMU] = 0
    observe(ecu, cal, 3)
    assert ecu.x == [*expected, 0, 0]


def test_bypass_takes_the_reference_when_it_is_new():
    cal = rig.calibration(observer=fw.BYPASS, timeout_ticks=[5] * 5)
    ecu = rig.started(cal)
    ecu.x = [1, 2, 3, 4, 5]
    ecu.reference_roll, ecu.reference_rate, ecu.reference_acceleration = 60, 70, 80
    observe(ecu, cal, 1)
    assert ecu.x == [1, 2, 3, 4, 5]
    ecu.fresh[RX_ROLL_REFERENCE] = RX_SIGNALS[RX_ROLL_REFERENCE]
    observe(ecu, cal, 1)
    assert ecu.x == [60, 70, 80, 4, 5]


@pytest.mark.parametrize(
    ("actuator", "unknown", "after"),
    [
        (fw.SUSPENSION, 0, 1 << 28),
        (fw.BARS, 0, 1 << 28),
        (fw.BARS, 1, 1 << 28),
        (fw.DAMPERS, 0, -(1 << 28)),
        (fw.DAMPERS, 1, 0),
        (fw.VALVES, 0, -(1 << 28)),
        (fw.VALVES, 1, 0),
    ],
)
def test_what_is_commanded_is_a_moment_but_for_dampers_and_valves(actuator, unknown, after):
    """The actuator gets all the way to its command in a tick; the roll angle adds up its moment."""
    ecu, cal = watching(predict_steps=2, actuator_rate=1 << 30)
    cal.actuator = actuator
    ecu.model[0][3] = 2
    ecu.moment_unknown = unknown
    ecu.delivered = [-(1 << 27)] * 2
    ecu.ring = [1 << 28] * 32
    look_ahead(ecu, cal)
    first = 0 if after > 0 and not unknown else after
    assert ecu.ahead == [first + after, 0, 0, 0, 0]


def test_more_than_fifteen_fault_codes_are_shown_as_fifteen():
    ecu = rig.started(rig.calibration())
    for number in (1, 14, 15, 16, 28):
        ecu.detected = (1 << number) - 1
        sv.latch_faults(ecu)
        assert ecu.fault_number == min(number, 15)
        assert ecu.fault_active == ecu.fault_latched == ecu.detected
    assert ecu.fault_count == [1] * 28
    ecu.detected = 1
    sv.latch_faults(ecu)
    assert (ecu.fault_number, ecu.fault_active) == (1, 1)
    assert ecu.fault_latched == (1 << 28) - 1
    ecu.detected = 3
    for _ in range(3):
        sv.latch_faults(ecu)
    assert ecu.fault_count == [1, 2, *[1] * 26]


def test_a_variance_is_one_unit_at_least_and_a_tiny_cap_takes_all_covariance_with_it():
    cal = rig.calibration(observer=fw.PROPAGATED_COVARIANCE, covariance_max=[1] + [1 << 29] * 4)
    ecu = rig.started(cal)
    ecu.covariance = covariances({(0, 0): fw.STATE_MAX, (0, 1): 1 << 29, (1, 0): 1 << 29})
    bounded(ecu, cal)
    expected = {(0, 0): 1, **{(i, i): 1 for i in range(1, 5)}}
    assert ecu.covariance == covariances(expected)


def test_a_frame_is_read_once_even_without_protection():
    cal = rig.calibration(e2e=0, timeout_ticks=[1] * 5)
    ecu = rig.started(cal)
    for message in range(5):
        loop.receive(ecu, message, [0] * 7 + [16 + 4], 8)
    for k in range(5):
        read_inputs(ecu, cal, 1)
        assert ecu.fresh == ([*RX_SIGNALS] if k == 0 else [0] * 5)
        assert ecu.age == ecu.unchanged == [k] * 5


def test_without_motion_the_steering_is_held_and_draws_the_estimate_nowhere():
    cal = rig.calibration(schedule_steering=[1 << 24] * 8)
    ecu = rig.started(cal)
    ecu.steering = 1 << 20
    held = 1 << 24
    for age, lost, estimate in ((0, 0, 5), (3, 1, 7000), (4, 1, 7001), (0, 0, 6)):
        ecu.fresh[RX_VEHICLE_MOTION] = RX_SIGNALS[RX_VEHICLE_MOTION] if age == 0 else 0
        ecu.motion_lost, ecu.x[2] = lost, estimate
        schedule(ecu, cal)
        assert ecu.steering_acceleration == held
        assert lateral_by_steering(ecu) == (estimate if lost else held)


@pytest.mark.parametrize("share", [0, fw.STATE_MAX])
def test_all_of_the_moment_may_go_to_one_axle(share):
    cal = rig.calibration(schedule_front_share=[share] * 8)
    ecu = rig.started(cal)
    ecu.fresh[RX_VEHICLE_MOTION] = RX_SIGNALS[RX_VEHICLE_MOTION]
    schedule(ecu, cal)
    assert ecu.front_share == share


def test_the_fade_may_be_a_step():
    cal = rig.calibration(fade_low=5 << 20, fade_high=(5 << 20) + 1)
    ecu = rig.started(cal)
    for speed, gain in ((5 << 20, 0), ((5 << 20) + 1, 1 << 28)):
        ecu.speed = speed
        ecu.fresh[RX_VEHICLE_MOTION] = RX_SIGNALS[RX_VEHICLE_MOTION]
        schedule(ecu, cal)
        assert ecu.gain_factor == gain


@pytest.mark.parametrize(
    ("elapsed", "steps"), [(0, 1), (1, 1), (3, 3), (16, 16), (17, 16), (99, 16)]
)
def test_the_estimate_makes_up_for_sixteen_missed_ticks(elapsed, steps):
    ecu, cal = watching()
    ecu.model[0][3] = 2
    ecu.delivered, ecu.ring = [1 << 20] * 2, [1 << 21] * 32
    ecu.fresh[RX_IMU] = 0
    loop.tick(ecu, cal, elapsed)
    assert ecu.x[0] == steps << 21
