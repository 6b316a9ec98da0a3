"""What an input is worth, to the unit and to the tick, and what is needed of it."""

import pytest
import rig
from hypothesis import given
from hypothesis import strategies as st

from canroll.firmware import calibration as fw
from canroll.firmware import plausibility as sv
from canroll.firmware.state import (
    ACTIVE,
    AGE_MAX,
    DEGRADED,
    INIT,
    RX_ACTUATOR_STATE,
    RX_IMU,
    RX_ROLL_REFERENCE,
    RX_SUSPENSION_RATE,
    RX_VEHICLE_MOTION,
    SAFE,
)
from canroll.firmware.supervisor import supervise


def good(ecu, cal) -> None:
    """As if all needed messages had just come."""
    for message in (RX_IMU, RX_VEHICLE_MOTION, RX_ACTUATOR_STATE):
        ecu.last_sample[message], ecu.valid[message], ecu.fresh[message] = 1, 127, 127
        ecu.age[message] = ecu.unchanged[message] = 0


def test_an_echo_is_overdue_after_eight_times_its_time():
    cal = rig.calibration(acknowledge_ticks=3)
    ecu = rig.started(cal)
    for waiting, unacknowledged, expected in ((1, 24, 0), (1, 25, 1), (0, 25, 0)):
        ecu.waiting, ecu.unacknowledged = waiting, unacknowledged
        supervise(ecu, cal, 1)
        assert ecu.fault_active >> sv.FAULT_COMMAND & 1 == expected


def test_init_degraded_and_safe_end_to_the_tick():
    cal = rig.calibration(init_ticks=4, recovery_ticks=6)
    ecu = rig.started(cal)
    good(ecu, cal)
    modes = []
    for _ in range(5):
        supervise(ecu, cal, 1)
        modes.append(ecu.mode)
    assert modes == [INIT] * 3 + [ACTIVE] * 2
    for status, lost in ((2, DEGRADED), (0, None)):
        ecu.status[0] = status
        if lost is not None:
            supervise(ecu, cal, 1)
            assert ecu.mode == lost
    modes = []
    for _ in range(7):
        supervise(ecu, cal, 1)
        modes.append(ecu.mode)
    assert modes == [DEGRADED] * 5 + [ACTIVE] * 2
    ecu.status[:2] = [2, 2]
    supervise(ecu, cal, 1)
    assert ecu.mode == SAFE
    ecu.status[:2] = [0, 0]
    modes = []
    for _ in range(7):
        supervise(ecu, cal, 1)
        modes.append(ecu.mode)
    assert modes == [SAFE] * 5 + [ACTIVE] * 2


def test_the_lateral_acceleration_is_trusted_again_to_the_tick():
    cal = rig.calibration(recovery_ticks=6)
    ecu = rig.started(cal)
    good(ecu, cal)
    ecu.lateral_acceleration = cal.acceleration_max + 1
    for k in range(1, 9):
        supervise(ecu, cal, 1)
        assert ecu.bad_ticks[sv.BAD_ACCELERATION] == k
        assert ecu.lateral_lost == (k > cal.timeout_ticks[RX_IMU])
    ecu.lateral_acceleration = cal.acceleration_max
    for k in range(1, 9):
        supervise(ecu, cal, 1)
        assert (ecu.lateral_good, ecu.lateral_lost) == (k, int(k < cal.recovery_ticks))
        assert ecu.acceleration_good == cal.acceleration_max


CHANGE, NOISE = 1000, 300


def judged(samples, mode=ACTIVE):
    """Yield record and ECU after each of (ticks since the last one, sample or None)."""
    cal = rig.calibration(acceleration_change=CHANGE, acceleration_noise=NOISE)
    ecu = rig.started(cal)
    good(ecu, cal)
    ecu.mode, ecu.acceleration_ticks = mode, AGE_MAX
    for elapsed, sample in samples:
        ecu.fresh[RX_IMU] = 0
        if sample is not None:
            ecu.lateral_acceleration, ecu.fresh[RX_IMU] = sample, 71
        sv.watch_lateral(ecu, cal, elapsed)
        yield cal, ecu


@given(
    st.lists(
        st.tuples(st.integers(1, 9), st.none() | st.integers(-20_000, 20_000)),
        min_size=1,
        max_size=40,
    )
)
def test_no_believed_acceleration_changes_faster_whatever_comes(samples):
    known, since = None, 0
    for (elapsed, sample), (_, ecu) in zip(samples, judged(samples), strict=True):
        since += elapsed
        believed = sample is not None and ecu.bad_ticks[sv.BAD_ACCELERATION] == 0
        if believed:
            assert known is None or abs(sample - known) <= since * CHANGE + NOISE
            known, since = sample, 0
        elif sample is not None and not ecu.lateral_lost:
            assert abs(sample - known) > since * CHANGE + NOISE
        assert ecu.acceleration_good == (known or 0)


@given(
    st.lists(
        st.tuples(st.integers(1, 9), st.integers(-CHANGE, CHANGE), st.booleans()), max_size=40
    ),
    st.integers(-(NOISE // 2), NOISE // 2),
)
def test_a_motion_within_the_bound_is_never_refused_whatever_frames_are_lost(steps, noise):
    motion, samples = 0, []
    for elapsed, rate, arrives in steps:
        motion += elapsed * rate
        noise = -noise
        samples.append((elapsed, motion + noise if arrives else None))
    assert all(ecu.bad_ticks[sv.BAD_ACCELERATION] == 0 for _, ecu in judged(samples))


def test_what_jumped_is_lost_and_good_once_it_is_back_near_the_last_good_one():
    timeout = rig.calibration().timeout_ticks[RX_IMU]
    near = NOISE + (timeout + 1) * CHANGE
    steps = [(1, 5000), *[(1, 5001 - 2 * near)] * 500, (1, 4999 - near), (1, 5000 - near)]
    seen = [(ecu.lateral_lost, ecu.acceleration_good) for _, ecu in judged(steps)]
    assert seen[: timeout + 1] == [(0, 5000)] * (timeout + 1)
    assert set(seen[timeout + 1 : -1]) == {(1, 5000)}
    assert seen[-1] == (1, 5000 - near)


def test_in_init_any_sample_is_the_first():
    for _, ecu in judged([(1, 1 << 25), (1, -(1 << 25)), (1, 1 << 25)], INIT):
        assert ecu.acceleration_good == ecu.lateral_acceleration


@pytest.mark.parametrize("sign", [-1, 1])
def test_the_largest_plausible_value_is_plausible(sign):
    cal = rig.calibration()
    ecu = rig.started(cal)
    good(ecu, cal)
    for over, bad in ((0, 0), (1, 1)):
        ecu.roll_rate = sign * (cal.roll_rate_max + over)
        ecu.lateral_acceleration = sign * (cal.acceleration_max + over)
        supervise(ecu, cal, 1)
        assert ecu.bad_ticks[sv.BAD_ROLL_RATE] == ecu.bad_ticks[sv.BAD_ACCELERATION] == bad


def test_a_message_is_late_or_stuck_beyond_its_limit_not_at_it():
    cal = rig.calibration(stuck_ticks=9)
    for name, code in (("age", RX_IMU), ("unchanged", sv.FAULT_STUCK)):
        limit = cal.timeout_ticks[RX_IMU] if name == "age" else 9
        for ticks, expected in ((limit, 0), (limit + 1, 1)):
            ecu = rig.started(cal)
            good(ecu, cal)
            getattr(ecu, name)[RX_IMU] = ticks
            supervise(ecu, cal, 1)
            assert ecu.fault_active == expected << code
    # a limit below the timeout counts as the timeout: the message may be that slow
    ecu = rig.started(rig.calibration(stuck_ticks=1))
    good(ecu, cal)
    ecu.unchanged[RX_IMU] = cal.timeout_ticks[RX_IMU]
    supervise(ecu, cal, 1)
    assert ecu.fault_active == 0


def test_missed_ticks_count_as_many_everywhere():
    cal = rig.calibration(ramp_ticks=100)
    ecu = rig.started(cal)
    good(ecu, cal)
    ecu.mode, ecu.feedforward = ACTIVE, 0
    ecu.lateral_acceleration = cal.acceleration_max + 1
    supervise(ecu, cal, 3)
    assert ecu.bad_ticks[sv.BAD_ACCELERATION] == 3
    assert ecu.good_ticks == 3
    assert ecu.authority == ecu.feedforward == 3 * ((1 << 30) // 100)
    ecu.lateral_acceleration = 0
    supervise(ecu, cal, 2)
    assert (ecu.lateral_good, ecu.good_ticks) == (2, 5)
    supervise(ecu, cal, AGE_MAX)
    assert (ecu.lateral_good, ecu.good_ticks) == (AGE_MAX, AGE_MAX)
    assert ecu.authority == ecu.feedforward == 1 << 30


def needing(law: int, **gains):
    """Two sensors, a law of these gains and a lateral acceleration that has just been lost."""
    cal = rig.calibration(law=law, output_gain=[5, 0, 5], compensator_order=1)
    cal.compensator_shift, cal.compensator_output_shift = [1] * 8, [1] * 2
    for name, value in gains.items():
        setattr(cal, name, value)
    ecu = rig.started(cal)
    good(ecu, cal)
    ecu.mode = ACTIVE
    ecu.bad_ticks[sv.BAD_ACCELERATION] = cal.timeout_ticks[RX_IMU]
    ecu.lateral_acceleration = cal.acceleration_max + 1
    return ecu, cal


def rows(n: int, row: int, column: int) -> list[list[int]]:
    return [[int((i, j) == (row, column)) for j in range(4)] for i in range(n)]


@pytest.mark.parametrize(
    ("law", "gains", "mode"),
    [
        (fw.STATE_FEEDBACK, {"output_gain": [0, 1, 0]}, DEGRADED),
        (fw.OUTPUT_FEEDBACK, {}, DEGRADED),
        (fw.OUTPUT_FEEDBACK, {"output_gain": [0, 1, 0]}, SAFE),
        (fw.OUTPUT_FEEDBACK, {"output_gain": [0, -1, 0]}, SAFE),
        (fw.OUTPUT_FEEDBACK, {"compensator_b": rows(8, 0, 2)}, DEGRADED),
        (fw.COMPENSATOR, {"output_gain": [0, 1, 0]}, DEGRADED),
        *((fw.COMPENSATOR, {"compensator_b": rows(8, i, 2)}, SAFE) for i in range(8)),
        *((fw.COMPENSATOR, {"compensator_d": rows(2, i, 2)}, SAFE) for i in range(2)),
        *((fw.COMPENSATOR, {"compensator_b": rows(8, 0, j)}, DEGRADED) for j in (0, 1, 3)),
        *((fw.COMPENSATOR, {"compensator_d": rows(2, 0, j)}, DEGRADED) for j in (0, 1, 3)),
    ],
)
def test_only_what_reads_the_lateral_acceleration_can_not_do_without(law, gains, mode):
    ecu, cal = needing(law, **gains)
    supervise(ecu, cal, 1)
    assert ecu.mode == mode


@pytest.mark.parametrize(
    ("measurements", "identification", "mode"),
    [(1, 0, ACTIVE), (1, 1, DEGRADED), (2, 0, SAFE), (2, 1, SAFE), (3, 0, DEGRADED)],
)
def test_who_measures_the_lateral_acceleration_misses_it(measurements, identification, mode):
    ecu, cal = needing(fw.STATE_FEEDBACK, measurements=measurements, identification=identification)
    supervise(ecu, cal, 1)
    assert ecu.mode == mode


def lacking_rate(law: int, **gains):
    """The lateral acceleration alone, a law of these gains and a roll rate that was just lost."""
    ecu, cal = needing(law, **{"measurements": 2, "output_gain": [0, 0, 5], **gains})
    ecu.lateral_acceleration, ecu.bad_ticks = 0, [0] * len(ecu.bad_ticks)
    ecu.bad_ticks[sv.BAD_ROLL_RATE] = cal.timeout_ticks[RX_IMU]
    ecu.valid[RX_IMU] = 6
    return ecu, cal


@pytest.mark.parametrize(
    ("law", "gains", "mode"),
    [
        (fw.STATE_FEEDBACK, {}, ACTIVE),
        (fw.STATE_FEEDBACK, {"output_gain": [1, 0, 0]}, ACTIVE),
        (fw.STATE_FEEDBACK, {"measurements": 1}, SAFE),
        (fw.STATE_FEEDBACK, {"measurements": 3}, SAFE),
        (fw.STATE_FEEDBACK, {"identification": 1}, SAFE),
        (fw.OUTPUT_FEEDBACK, {}, ACTIVE),
        (fw.OUTPUT_FEEDBACK, {"output_gain": [0, 1, 0]}, ACTIVE),
        (fw.OUTPUT_FEEDBACK, {"output_gain": [-1, 0, 0]}, SAFE),
        *((fw.COMPENSATOR, {"compensator_b": rows(8, i, 1)}, SAFE) for i in range(8)),
        *((fw.COMPENSATOR, {"compensator_d": rows(2, i, 1)}, SAFE) for i in range(2)),
        *((fw.COMPENSATOR, {"compensator_b": rows(8, 0, j)}, ACTIVE) for j in (0, 2, 3)),
        *((fw.COMPENSATOR, {"compensator_d": rows(2, 0, j)}, ACTIVE) for j in (0, 2, 3)),
    ],
)
def test_only_what_reads_the_roll_rate_can_not_do_without(law, gains, mode):
    ecu, cal = lacking_rate(law, **gains)
    supervise(ecu, cal, 1)
    assert ecu.mode == mode
    assert ecu.fault_active == (1 << sv.FAULT_ROLL_RATE) * (mode == SAFE)
    assert (ecu.bad_ticks[sv.BAD_ROLL_RATE] > 0) == (mode == SAFE)


@pytest.mark.parametrize("corners", [(0,), (1,), (2,), (3,), (0, 1), (2, 3), (0, 2), (1, 3)])
@pytest.mark.parametrize("actuator", [fw.SUSPENSION, fw.BARS])
def test_each_failed_bar_or_corner_counts_once(actuator, corners):
    cal = rig.calibration(actuator=actuator)
    ecu = rig.started(cal)
    good(ecu, cal)
    ecu.mode = ACTIVE
    for k, corner in enumerate(corners):
        ecu.status[corner] = 2 + k
    supervise(ecu, cal, 1)
    failures = len({corner // 2 for corner in corners} if actuator == fw.BARS else corners)
    assert ecu.mode == (DEGRADED if failures == 1 else SAFE)
    assert ecu.failed == [int(corner in corners) for corner in range(4)]


def test_a_limited_corner_has_not_failed_and_each_kind_of_failure_has_its_fault_code():
    cal = rig.calibration()
    for status, codes in (
        ([1, 1, 1, 1], 0),
        ([2, 0, 0, 0], 1 << sv.FAULT_CORNER_STUCK),
        ([0, 0, 0, 3], 1 << sv.FAULT_CORNER_FLOATING),
        ([1, 3, 2, 0], 1 << sv.FAULT_CORNER_FLOATING | 1 << sv.FAULT_CORNER_STUCK),
    ):
        ecu = rig.started(cal)
        good(ecu, cal)
        ecu.status = status
        supervise(ecu, cal, 1)
        assert ecu.fault_active == codes
        assert ecu.fault_number == codes.bit_count()


NEEDED = [
    (RX_VEHICLE_MOTION, {}, (1, 2), sv.FAULT_SPEED, DEGRADED),
    (RX_ACTUATOR_STATE, {}, (1, 2), sv.FAULT_MOMENT, DEGRADED),
    (RX_ROLL_REFERENCE, {"observer": fw.BYPASS}, (1, 2, 4), sv.FAULT_REFERENCE, SAFE),
    (RX_SUSPENSION_RATE, {"actuator": fw.DAMPERS}, (1, 2, 4, 8), sv.FAULT_STROKE, SAFE),
    (RX_ACTUATOR_STATE, {"actuator": fw.DAMPERS}, (1, 2), sv.FAULT_MOMENT, SAFE),
    (
        RX_ACTUATOR_STATE,
        {"actuator": fw.VALVES, "law": fw.COMPENSATOR, "compensator_outputs": 2}
        | {"compensator_shift": [1] * 8, "compensator_output_shift": [1] * 2},
        (1, 2),
        sv.FAULT_MOMENT,
        SAFE,
    ),
]


@pytest.mark.parametrize("needed", NEEDED)
@pytest.mark.parametrize("timeout", [1, 3])
def test_every_signal_of_a_message_is_needed(needed, timeout):
    message, changes, bits, code, mode = needed
    cal = rig.calibration(timeout_ticks=[timeout] * 5, **changes)
    for missing in (0, *bits):
        ecu = rig.started(cal)
        ecu.mode = ACTIVE
        for k in range(timeout + 1):
            assert ecu.mode == ACTIVE
            ecu.last_sample, ecu.age, ecu.unchanged = [1] * 5, [0] * 5, [0] * 5
            ecu.valid = [127] * 5
            ecu.valid[message] -= missing
            supervise(ecu, cal, 1)
            assert ecu.fault_active == (1 << code if missing and k == timeout else 0)
        assert ecu.mode == (mode if missing else ACTIVE)


@pytest.mark.parametrize("message", range(5))
def test_a_message_that_is_not_needed_is_never_late(message):
    cal = rig.calibration()
    for timeout, late in ((0, 0), (1, 1)):
        cal.timeout_ticks = [9] * 5
        cal.timeout_ticks[message] = timeout
        ecu = rig.started(rig.calibration())
        ecu.last_sample, ecu.valid = [1] * 5, [127] * 5
        ecu.age[message], ecu.unchanged[message] = 2, 200
        supervise(ecu, cal, 1)
        assert ecu.fault_active == late << message


def test_what_began_degraded_takes_its_whole_recovery():
    cal = rig.calibration(init_ticks=4, recovery_ticks=6)
    ecu = rig.started(cal)
    good(ecu, cal)
    ecu.status[0] = 2
    for _ in range(4):
        supervise(ecu, cal, 1)
    assert ecu.mode == DEGRADED
    ecu.status[0] = 0
    modes = []
    for _ in range(7):
        supervise(ecu, cal, 1)
        modes.append(ecu.mode)
    assert modes == [DEGRADED] * 5 + [ACTIVE] * 2


@pytest.mark.parametrize(("elapsed", "missed"), [(1, 0), (2, 1), (3, 1), (1000, 1)])
def test_more_than_one_tick_is_a_missed_one(elapsed, missed):
    cal = rig.calibration()
    ecu = rig.started(cal)
    good(ecu, cal)
    supervise(ecu, cal, elapsed)
    assert ecu.fault_active == missed << sv.FAULT_TICK_MISSED


def test_ramps_end_at_nothing_and_at_all():
    cal = rig.calibration(ramp_ticks=3)
    ecu = rig.started(cal)
    good(ecu, cal)
    supervise(ecu, cal, 1)
    assert (ecu.mode, ecu.authority, ecu.feedforward) == (INIT, 0, 1 << 30)
    ecu.mode, ecu.lateral_lost = ACTIVE, 1
    for _ in range(4):
        supervise(ecu, cal, 1)
    assert (ecu.mode, ecu.authority, ecu.feedforward) == (ACTIVE, 1 << 30, 0)


def test_fault_codes_keep_the_numbers_that_diagnostics_know():
    """0 to 4 are the late messages."""
    codes = {name: code for name, code in vars(sv).items() if name.startswith("FAULT_")}
    assert codes == {
        "FAULT_DISAGREEMENT": 5,
        "FAULT_ROLL_RATE": 6,
        "FAULT_ACCELERATION": 7,
        "FAULT_STUCK": 8,
        "FAULT_REFERENCE": 9,
        "FAULT_SPEED": 10,
        "FAULT_STROKE": 11,
        "FAULT_MOMENT": 12,
        "FAULT_CORNER_STUCK": 13,
        "FAULT_CORNER_FLOATING": 14,
        "FAULT_COMMAND": 15,
        "FAULT_TICK_MISSED": 16,
        "FAULT_CALIBRATION": 17,
        "FAULT_CALIBRATION_CRC": 18,
        "FAULT_ROLL_RATE_CONTRADICTED": 19,
        "FAULT_LATERAL_CONTRADICTED": 20,
        "FAULT_MOTION_CONTRADICTED": 21,
        "FAULT_ACTUATOR_CONTRADICTED": 22,
        "FAULT_ENVELOPE": 23,
        "FAULT_OWN_IDENTIFIER_HEARD": 24,
        "FAULT_COMMAND_LATE": 25,
        "FAULT_SAMPLE_RATE_OFF": 26,
        "FAULT_SENSOR_ERRATIC": 27,
    }
