"""Response monitor: reported moments against the roll of a body on measured suspension."""

import numpy as np
import pytest
import rig
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from canroll.firmware import calibration as fw
from canroll.firmware import plausibility as sv
from canroll.firmware.com.signals import RX_SIGNALS
from canroll.firmware.monitors.residual import BODY, DAMPERS, LATERAL, STEADY
from canroll.firmware.monitors.response import (
    BOTH,
    ONE_BALANCE,
    force_uncertainty,
    road_uncertainty,
    watch_model,
    watch_response,
)
from canroll.firmware.state import RX_ACTUATOR_STATE, RX_IMU, RX_SUSPENSION_RATE, SAFE, Ecu
from canroll.firmware.supervisor import supervise

VAN, TRACK, STEP = rig.VAN, 2.0 * rig.VAN.half_track, 0.01
LOW_PASS, WASHOUT, SLOW = 0.05, 5.0, 0.08
LEAST, STEADY_LEAST = 240.0, 360.0
SHARES = {"side force": 0.4, "springs": 0.2, "dampers": 0.2, "moments": 0.2, "inertia": 0.4}
"""Of a part of the balance that may be wrong."""
OF_FORCE = 0.9, 0.6
"""Of the lateral force that may be left over for long: to its own side, to the other."""
OF_MOMENTS = 0.3
OF_SHOWN = 0.5, 0.6, 0.0
"""Of what the body shows of the lateral acceleration: to its side, to the other; of moments."""
REBOUND = 0.5
"""Of a damper's force by which rebound differs from bump."""
LATE = 2.0
"""Of the mean change of the dampers' moment that lost samples may add up to."""
SECONDS = 4.0
SPEED = 20.0
TICKS = 11
SETTLED = 150
"""Samples after which the start is forgotten."""
AT_THE_LIMIT = (
    *({"motion_peak": 11 << fw.Q_ACCELERATION}, {"motion_lost": 1}),
    {"valid": [3, 3, 15, 3, 7]},
)
"""States in which the tyres are at their limit, or may be."""


def watched(**changes: object) -> fw.Calibration:
    """A calibration with the monitor on, the front axle with 60 % of springs and dampers."""
    cal = rig.calibration(actuator=fw.BARS, **changes)
    cal.timeout_ticks[RX_SUSPENSION_RATE] = 5
    cal.response_min = round(LEAST * 2**fw.Q_MOMENT)
    cal.response_limit = 10 << fw.Q_ACCELERATION
    cal.response_stroke = [round(share * VAN.damping / TRACK * 2**10) for share in (0.6, 0.4)]
    cal.response_stretch = round(STEP * VAN.roll_stiffness / VAN.damping * 2**30)
    cal.response_lateral = round(VAN.moment_per_acceleration * 2**10)
    cal.response_inertia = round(VAN.inertia / LOW_PASS * 2**10)
    cal.response_pass = round(STEP / LOW_PASS * 2**30)
    cal.response_wash = [round(STEP * corner * 2**30) for corner in (WASHOUT, SLOW, 0.0)]
    cal.response_ticks = TICKS
    cal.response_share = shares(*SHARES.values(), 0.0)
    cal.response_late = [round(LATE * 2**10), round(4.0 * LATE * 2**10)]
    cal.response_rough = [round(REBOUND * stroke) for stroke in cal.response_stroke]
    cal.limit_share = shares(0.75, 0.25)
    cal.steady_min = round(STEADY_LEAST * 2**fw.Q_MOMENT)
    cal.steady_share = shares(*OF_FORCE, OF_MOMENTS)
    cal.lateral_share = shares(*OF_SHOWN)
    return cal


def shares(*values: float) -> list[int]:
    return [round(value * 2**fw.Q_SHARE) for value in values]


def known(cal: fw.Calibration) -> Ecu:
    """An ECU of a moving car with every input, whose actuators follow commands."""
    ecu = rig.started(cal)
    ecu.gain_factor, ecu.motion_lost, ecu.moment_unknown = 1 << 28, 0, 0
    ecu.enabled = ecu.command_held = 1
    ecu.valid[RX_IMU], ecu.valid[RX_SUSPENSION_RATE], ecu.valid[RX_ACTUATOR_STATE] = 7, 15, 3
    return ecu


def drive(
    true,
    *,
    of_model: float = 1.0,
    road=lambda t: 0.0,
    offset: float = 0.0,
    unreported=lambda t: 0.0,
) -> np.ndarray:
    """Samples (gyro, rate across a suspension, a_y, reported moment) of a slalom of 4 m/s².

    ``true`` gives the moment that acts from the reported one, N·m. The plant's mass, stiffness and
    damping are ``of_model`` times the monitor's. ``road`` is the rate at which the road tilts the
    wheels, rad/s; ``offset`` that of the accelerometer, m/s²; ``unreported`` what acts besides.
    """
    arm = of_model * VAN.moment_per_acceleration

    def lateral(t):
        return 4.0 * np.sin(2.0 * np.pi * 0.5 * t)

    def reported(t):
        return -0.8 * VAN.moment_per_acceleration * lateral(t - 0.05)

    def rates(t, state):
        _, stretch, rate = state
        stroke = rate - road(t)
        springs = of_model * (VAN.roll_stiffness * stretch + VAN.damping * stroke)
        acting = true(reported(t)) + unreported(t) + arm * lateral(t) - springs
        return [rate, stroke, acting / (of_model * VAN.inertia)]

    times = np.arange(0.0, SECONDS, STEP)
    state = solve_ivp(rates, (0.0, SECONDS), [0.0] * 3, t_eval=times, max_step=STEP).y
    strokes = state[2] - [road(t) for t in times]
    measured = lateral(times) + offset
    return np.stack([state[2], strokes, measured, reported(times)], axis=1)


def replay(
    ecu: Ecu, cal: fw.Calibration, samples: np.ndarray, turning: np.ndarray | None = None
) -> None:
    """Let the monitor judge the samples; ``turning`` is yaw rate times speed, by default a_y."""
    turning = samples[:, 2] if turning is None else turning
    for (gyro, stroke, lateral, moment), by_yaw in zip(samples, turning, strict=True):
        ecu.speed = round(SPEED * 2**fw.Q_SPEED)
        ecu.yaw_rate = round(by_yaw / SPEED * 2**fw.Q_RATE)
        ecu.roll_rate = round(gyro * 2**fw.Q_RATE)
        left = round(0.5 * TRACK * stroke * 2**fw.Q_RATE)
        ecu.stroke_rate = [left, -left, left, -left]
        ecu.lateral_acceleration = round(lateral * 2**fw.Q_ACCELERATION)
        ecu.delivered = [round(0.5 * moment * 2**fw.Q_MOMENT)] * 2
        watch_response(ecu, cal, 1)


@pytest.mark.parametrize(
    ("true", "lie"),
    [
        (lambda moment: moment, 0),
        (lambda moment: 0.8 * moment, 0),
        (lambda moment: 1.2 * moment, 0),
        (lambda moment: 0.0, 1),
        (lambda moment: -moment, 1),
    ],
    ids=["true", "80 %", "120 %", "dead", "reversed"],
)
@pytest.mark.parametrize("of_model", [0.85, 1.0, 1.15])
def test_moments_that_the_body_does_not_answer_are_lies(true, lie, of_model):
    cal = watched()
    ecu = known(cal)
    replay(ecu, cal, drive(true, of_model=of_model))
    assert rig.accused_axles(ecu) == [lie, lie]


def test_a_moment_that_is_not_reported_is_found_on_a_straight_road():
    cal = watched()
    ecu = known(cal)
    samples = drive(lambda moment: moment + 2500.0)
    samples[:, 2:] = 0.0
    ecu_of_fair, rest = known(cal), samples.copy()
    rest[:, :] = 0.0
    replay(ecu_of_fair, cal, rest)
    assert rig.accused_axles(ecu_of_fair) == [0, 0]
    replay(ecu, cal, samples)
    assert rig.accused_axles(ecu) == [1, 1]


def test_a_road_acts_through_the_springs_alone_and_accuses_nobody():
    cal = watched()
    ecu = known(cal)
    # bumps under one side that would take half of the springs' travel of a slalom
    samples = drive(lambda moment: moment, road=lambda t: 0.6 * np.sin(2.0 * np.pi * 3.0 * t))
    assert np.abs(samples[:, 1]).max() > 0.5
    replay(ecu, cal, samples)
    assert rig.accused_axles(ecu) == [0, 0]


def test_frames_that_come_early_and_late_accuse_nobody():
    cal = watched()
    ecu = known(cal)
    samples = drive(lambda moment: moment)
    # the inertial unit's come two in a tick and none in the next
    samples[1::2, [0, 2]] = samples[0:-1:2, [0, 2]]
    for number, sample in enumerate(samples):
        ecu.fresh[RX_IMU] = (1 - number % 2) * RX_SIGNALS[RX_IMU]
        replay(ecu, cal, sample[None])
    assert rig.accused_axles(ecu) == [0, 0]


@pytest.mark.parametrize(
    ("strokes", "share"),
    [([0.4, -0.4, 0.3, -0.3], 0.0), ([0.2, 0.2, -0.1, -0.1], 0.0), ([0.5, 0.0, 0.0, 0.0], 0.3)],
    ids=["roll", "heave", "a wheel on a bump"],
)
def test_dampers_of_unequal_strokes_may_be_wrong_by_half(strokes, share):
    cal = watched()
    ecu = known(cal)
    ecu.stroke_rate = [round(stroke * 2**fw.Q_RATE) for stroke in strokes]
    expected = share * VAN.damping / TRACK * 0.5
    assert road_uncertainty(ecu, cal) / 2**fw.Q_MOMENT == pytest.approx(expected, rel=1e-3, abs=1.0)


def test_no_lasting_offset_counts():
    cal = watched()
    ecu = known(cal)
    replay(ecu, cal, drive(lambda moment: moment, offset=3.0))
    assert rig.accused_axles(ecu) == [0, 0]


@pytest.mark.parametrize(("size", "samples"), [(600.0, TICKS), (6000.0, TICKS // 2 + 1)])
def test_it_takes_so_many_samples_in_a_row_and_half_as_many_large_ones(size, samples):
    cal = watched()
    ecu = known(cal)
    jump = np.zeros((SETTLED + 40, 4))
    jump[SETTLED:, 3] = size
    bad = rig.bad_samples(ecu, BODY, TICKS, lambda sample: replay(ecu, cal, sample[None]), jump)
    assert bad == samples


@pytest.mark.parametrize(("rattled", "wrong"), [(0.0, 1), (0.2, 1), (2.0, 0)])
def test_what_a_rough_road_adds_up_may_stay(rattled, wrong):
    cal = watched()
    ecu = known(cal)
    replay(ecu, cal, np.zeros((SETTLED, 4)))
    ecu.bound[DAMPERS] = round(rattled * LEAST * 2**fw.Q_MOMENT)
    jump = np.zeros((40, 4))
    jump[:, 3] = 4.0 * LEAST
    replay(ecu, cal, jump)
    assert rig.accused_axles(ecu) == [wrong, wrong]


@pytest.mark.parametrize(("frequency", "wrong"), [(2.0, 1), (6.0, 0)])
def test_what_bounces_from_side_to_side_is_no_lie(frequency, wrong):
    cal = watched()
    ecu = known(cal)
    bouncing = np.zeros((200, 4))
    bouncing[:, 3] = 800.0 * np.sin(2.0 * np.pi * frequency * STEP * np.arange(200))
    replay(ecu, cal, bouncing)
    assert rig.accused_axles(ecu) == [wrong, wrong]


def test_a_moment_that_jumps_away_in_the_slalom_is_found_at_once():
    cal = watched()
    ecu = known(cal)
    since = 130
    away = drive(lambda moment: moment, unreported=lambda t: 2000.0 * (t > since * STEP))
    replay(ecu, cal, away[:since])
    assert rig.accused_axles(ecu) == [0, 0]
    replay(ecu, cal, away[since : since + 25])
    assert rig.accused_axles(ecu) == [1, 1]
    assert abs(ecu.evidence[BODY]) == TICKS


@pytest.mark.parametrize("state", AT_THE_LIMIT, ids=str)
@pytest.mark.parametrize("unexplained", [0.75, 2.2])
def test_at_the_tyres_limit_part_of_the_inertia_may_be_left_over(state, unexplained):
    cal = watched()
    swaying = np.zeros((SETTLED + 200, 4))
    phase = 2.0 * np.pi * 3.0 * STEP * np.arange(200)
    swaying[SETTLED:, 0] = 0.3 * (np.cos(phase) - 1.0)
    inertia = -VAN.inertia * 0.3 * 2.0 * np.pi * 3.0 * np.sin(phase)
    swaying[SETTLED:, 3] = (1.0 - unexplained) * inertia
    for changes, wrong in (({}, 1), (state, int(unexplained > 0.75))):
        ecu = known(cal)
        for name, value in changes.items():
            setattr(ecu, name, value)
        replay(ecu, cal, swaying)
        assert rig.accused_axles(ecu) == [wrong, wrong]


@pytest.mark.parametrize("state", AT_THE_LIMIT, ids=str)
@pytest.mark.parametrize(("times", "wrong"), [(1.35, 0), (2.0, 1)])
def test_stops_may_take_up_a_part_of_the_moments_at_the_tyres_limit(state, times, wrong):
    cal = watched()
    carried = np.zeros((400, 4))
    frequency = 2.0 * np.pi * 0.5
    # by washout and low-pass
    passed = abs(1j * frequency / ((1j * frequency + WASHOUT) * (1j * frequency * LOW_PASS + 1.0)))
    carried[:, 3] = times * LEAST / passed * np.sin(frequency * STEP * np.arange(400))
    for changes, expected in (({}, 1), (state, wrong)):
        ecu = known(cal)
        for name, value in changes.items():
            setattr(ecu, name, value)
        replay(ecu, cal, carried)
        assert rig.accused_axles(ecu) == [expected, expected]


def on_the_straight(offset: float, *, moment: float = 0.0) -> np.ndarray:
    """A second of straight running, then as long with an accelerometer that is off by ``offset``.

    ``moment`` is what actuators do then, N·m.
    """
    samples = np.zeros((200, 4))
    samples[100:, 2:] = offset, moment
    return samples


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("times", "wrong"), [(1.3, 1), (0.9, 0)])
def test_an_offset_that_roll_and_yaw_rate_deny_is_of_the_accelerometer(times, wrong, sign):
    cal = watched()
    ecu = known(cal)
    least = STEADY_LEAST / VAN.moment_per_acceleration
    replay(ecu, cal, on_the_straight(sign * times * least), np.zeros(200))
    assert ecu.contradicted >> 1 & 1 == wrong
    assert rig.accused_axles(ecu) == [0, 0]


@pytest.mark.parametrize(("lateral", "wrong"), [(0.0, 0), (-0.4, 1)])
def test_more_of_what_the_body_shows_may_be_wrong_at_the_tyres_limit(lateral, wrong):
    cal = watched()
    # of 1000 N·m against 360 and a half of it, and a quarter more at the limit
    samples = on_the_straight(lateral * 1000.0 / VAN.moment_per_acceleration, moment=-1000.0)
    for peak, expected in ((0, 1), (11, wrong)):
        ecu = known(cal)
        ecu.motion_peak = peak << fw.Q_ACCELERATION
        replay(ecu, cal, samples, np.full(200, 2.0))
        assert ecu.contradicted >> 1 & 1 == expected


@pytest.mark.parametrize(("of_moments", "wrong"), [(0.0, 1), (0.3, 0)])
def test_moments_may_be_wrong_where_the_acceleration_is_judged_by_the_body(of_moments, wrong):
    cal = watched()
    cal.lateral_share[2] = shares(of_moments)[0]
    ecu = known(cal)
    # of 1000 N·m against 360 and a half of it
    replay(ecu, cal, on_the_straight(0.0, moment=-1000.0), np.full(200, 2.0))
    assert ecu.contradicted >> 1 & 1 == wrong


def test_a_bank_differs_from_the_yaw_rate_alone():
    cal = watched()
    ecu = known(cal)
    # actuators that hold the body against it, so that it does not roll
    bank = on_the_straight(1.5, moment=-1.5 * VAN.moment_per_acceleration)
    replay(ecu, cal, bank, np.zeros(200))
    assert ecu.contradicted >> 1 & 1 == 0


@pytest.mark.parametrize("sign", [1, -1])
def test_what_the_yaw_rate_bears_out_is_no_fault_of_the_accelerometer(sign):
    cal = watched()
    ecu = known(cal)
    # a curve in which nothing rolls
    replay(ecu, cal, on_the_straight(sign * 1.0))
    assert ecu.contradicted >> 1 & 1 == 0


def slowly(moment: float) -> np.ndarray:
    """Actuators that report a moment, N·m, reached in 3 s, to which the body does not answer."""
    samples = np.zeros((400, 4))
    samples[50:, 3] = np.minimum(np.arange(350) * STEP / 3.0, 1.0) * moment
    return samples


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("times", "wrong"), [(1.3, 0), (2.2, 1)])
def test_a_moment_that_goes_wrong_slowly_is_found_beyond_its_share(times, wrong, sign):
    cal = watched()
    ecu = known(cal)
    replay(ecu, cal, slowly(sign * times * STEADY_LEAST))
    assert rig.accused_axles(ecu) == [wrong, wrong]
    assert abs(ecu.evidence[STEADY]) == wrong * TICKS
    assert ecu.evidence[BODY] == 0
    assert ecu.contradicted >> 1 & 1 == 0


def test_a_moment_that_goes_wrong_slowly_takes_so_many_samples_in_a_row():
    cal = watched()
    ecu = known(cal)
    bad = rig.bad_samples(
        ecu,
        STEADY,
        TICKS,
        lambda sample: replay(ecu, cal, sample[None]),
        slowly(2.2 * STEADY_LEAST),
    )
    assert bad == TICKS


@pytest.mark.parametrize(
    ("force", "left", "room"),
    [(1000, 1, 900), (-1000, -1, 900), (1000, -1, 600), (-1000, 1, 600), (1000, 0, 600), (0, 5, 0)],
)
def test_a_lateral_force_excuses_more_to_its_own_side(force, left, room):
    cal = watched()
    assert force_uncertainty(known(cal), cal, force, left) == pytest.approx(room, abs=1)


@pytest.mark.parametrize(
    ("force", "left", "samples", "seen"),
    [
        (3.1, 0.84, TICKS, 1),
        (-3.1, 0.84, TICKS, 1),
        (3.1, -0.84, TICKS, 1),
        (3.1, 0.84, TICKS - 1, 0),
        (3.1, 0.88, 100, 0),
        (1.6, 0.0, 100, 0),
    ],
)
def test_once_little_was_left_over_for_long_no_side_excuses_more(force, left, samples, seen):
    cal = watched()
    ecu = known(cal)
    lateral, over = (round(value * STEADY_LEAST * 2**fw.Q_MOMENT) for value in (force, left))
    for _ in range(samples):
        watch_model(ecu, cal, lateral, over)
    assert force_uncertainty(ecu, cal, 1000, 1) == pytest.approx(600 if seen else 900, abs=1)
    # for good, where it was for long, and anew where it was not
    watch_model(ecu, cal, lateral, lateral)
    watch_model(ecu, cal, lateral, over)
    assert force_uncertainty(ecu, cal, 1000, 1) == pytest.approx(600 if seen else 900, abs=1)


@pytest.mark.parametrize("state", AT_THE_LIMIT, ids=str)
def test_what_stays_is_not_judged_at_the_tyres_limit(state):
    cal = watched()
    ecu = known(cal)
    for name, value in state.items():
        setattr(ecu, name, value)
    replay(ecu, cal, slowly(2.2 * STEADY_LEAST))
    assert rig.accused_axles(ecu) == [0, 0]


@pytest.mark.parametrize(("turning", "wrong"), [(-1.0, 0), (1.0, 1)])
def test_what_the_yaw_rate_denies_to_the_same_side_may_be_of_the_accelerometer(turning, wrong):
    cal = watched()
    ecu = known(cal)
    replay(ecu, cal, slowly(2.2 * STEADY_LEAST), np.full(400, turning))
    assert rig.accused_axles(ecu) == [wrong, wrong]


def test_moments_that_are_lies_leave_the_accelerometer_alone():
    cal = watched()
    ecu = known(cal)
    lies = on_the_straight(0.0, moment=1.5 * VAN.moment_per_acceleration)
    replay(ecu, cal, lies, np.zeros(200))
    assert ecu.contradicted >> 1 & 1 == 0
    assert rig.accused_axles(ecu) == [1, 1]


@pytest.mark.parametrize(("late", "wrong"), [(30, 1), (5, 0)])
@pytest.mark.parametrize("of_model", [0.85, 1.0, 1.15])
def test_a_late_accelerometer_is_found_in_the_slalom(late, wrong, of_model):
    cal = watched()
    cal.response_min *= 2
    ecu = known(cal)
    samples = drive(lambda moment: moment, of_model=of_model)
    turning = samples[:, 2].copy()
    samples[:, 2] = np.concatenate([np.zeros(late), turning[:-late]])
    replay(ecu, cal, np.zeros((SETTLED, 4)))
    replay(ecu, cal, samples, turning)
    assert ecu.contradicted >> 1 & 1 == wrong


@pytest.mark.parametrize("state", [{"motion_lost": 1}, {"valid": [3, 3, 15, 3, 7]}], ids=str)
def test_without_yaw_rate_no_accelerometer_is_judged(state):
    cal = watched()
    ecu = known(cal)
    for name, value in state.items():
        setattr(ecu, name, value)
    replay(ecu, cal, on_the_straight(0.5), np.zeros(200))
    assert ecu.contradicted >> 1 & 1 == 0


def test_the_slow_balances_are_judged_once_little_may_be_wrong():
    cal = watched()
    ecu = known(cal)
    slalom = drive(lambda moment: moment)
    # begun amid it, with an accelerometer that is off, which is not judged yet
    slalom[:, 2] += 0.75
    replay(ecu, cal, slalom[57:])
    assert ecu.response_known == ONE_BALANCE
    assert ecu.contradicted >> 1 & 1 == 0
    ecu.evidence[STEADY] = 3
    straight = np.tile([0.0, 0.0, 0.75, 0.0], (200, 1))
    replay(ecu, cal, straight)
    assert ecu.response_known == BOTH
    assert ecu.evidence[LATERAL] == ecu.evidence[STEADY] == 0
    replay(ecu, cal, np.zeros((100, 4)), np.full(100, 0.75))
    assert ecu.contradicted >> 1 & 1 == 1
    assert rig.accused_axles(ecu) == [0, 0]


@pytest.mark.parametrize(("times", "judged"), [(0.97, BOTH), (1.05, ONE_BALANCE)])
def test_little_is_half_of_what_may_always_be_left_over(times, judged):
    cal = watched()
    ecu = known(cal)
    for _ in range(TICKS):
        assert ecu.response_known != BOTH
        replay(ecu, cal, np.zeros((1, 4)))
        ecu.bound[BODY] = round(0.5 * times * STEADY_LEAST * 2**fw.Q_MOMENT)
    replay(ecu, cal, np.zeros((1, 4)))
    assert ecu.response_known == judged


@pytest.mark.parametrize("sign", [1, -1])
def test_a_body_that_swings_when_they_start_accuses_nobody(sign):
    cal = watched()
    ecu = known(cal)
    # from a roll whose springs bear three times what may be left over, released
    release = sign * 3.0 * STEADY_LEAST / VAN.roll_stiffness
    dynamics = [[0.0, 1.0], [-VAN.roll_stiffness / VAN.inertia, -VAN.damping / VAN.inertia]]
    times = np.arange(0.0, SECONDS, STEP)
    rates = [(expm(np.array(dynamics) * t) @ [release, 0.0])[1] for t in times]
    samples = np.zeros((len(times), 4))
    samples[:, 0] = samples[:, 1] = rates
    replay(ecu, cal, samples)
    assert ecu.response_known == BOTH
    assert rig.accused_axles(ecu) == [0, 0]
    assert ecu.contradicted >> 1 & 1 == 0


@pytest.mark.parametrize(
    "state",
    [
        {"enabled": 0},
        {"command_held": 0},
        {"gain_factor": 0},
        {"lateral_lost": 1},
        {"moment_unknown": 1},
        {"valid": [5, 3, 15, 3, 7]},
        {"valid": [7, 3, 14, 3, 7]},
        {"valid": [7, 3, 15, 1, 7]},
        {"unchanged": [0, 0, 6, 0, 0]},
        {"unchanged": [6, 0, 0, 0, 0]},
    ],
    ids=str,
)
def test_nothing_is_judged_unless_all_that_acts_is_known(state):
    cal = watched()
    ecu = known(cal)
    for name, value in state.items():
        setattr(ecu, name, value)
    replay(ecu, cal, drive(lambda moment: -moment))
    assert rig.accused_axles(ecu) == [0, 0]
    # afterwards it starts anew, from what is now
    restored = known(cal)
    for name in state:
        setattr(ecu, name, getattr(restored, name))
    replay(ecu, cal, drive(lambda moment: moment)[57:])
    assert rig.accused_axles(ecu) == [0, 0]


def test_no_axle_is_accused_while_the_lateral_acceleration_is_bad():
    for bad, found in ((0, 1), (1, 0)):
        cal = watched()
        ecu = known(cal)
        ecu.bad_ticks[sv.BAD_ACCELERATION] = bad
        replay(ecu, cal, drive(lambda moment: -moment))
        assert rig.accused_axles(ecu) == [found, found]


@pytest.mark.parametrize("valid", [6, 7])
def test_without_a_measured_roll_rate_axles_and_heave_are_judged_alone(valid):
    cal = watched(measurements=2)
    ecu = known(cal)
    ecu.valid[RX_IMU] = valid
    replay(ecu, cal, drive(lambda moment: -moment))
    assert rig.accused_axles(ecu) == [0, 0]
    # by this the other two know that all they need is there
    assert ecu.response_known == ONE_BALANCE
    ecu.valid[RX_SUSPENSION_RATE] = 14
    watch_response(ecu, cal, 1)
    assert ecu.response_known == 0


@pytest.mark.parametrize("since", [51, 55, 60])
def test_a_body_that_is_being_pushed_at_the_start_accuses_nobody(since):
    def pushed(t):
        return 3000.0 * np.clip((t - 0.5) / 0.1, 0.0, 1.0)

    cal = watched()
    ecu = known(cal)
    samples = drive(lambda moment: moment, unreported=pushed)
    samples[:, 3] += [pushed(STEP * tick) for tick in range(len(samples))]
    replay(ecu, cal, samples[since:])
    assert rig.accused_axles(ecu) == [0, 0]


def test_a_missed_tick_breaks_the_integral():
    cal = watched()
    ecu = known(cal)
    replay(ecu, cal, drive(lambda moment: moment)[:100])
    assert ecu.response_known != 0
    watch_response(ecu, cal, 2)
    assert ecu.response_known == 0


def test_off_it_does_nothing():
    cal = watched()
    cal.response_min = 0
    ecu = known(cal)
    replay(ecu, cal, drive(lambda moment: -moment))
    assert rig.accused_axles(ecu) == [0, 0]
    assert ecu.response_known == 0


def test_no_axle_is_believed_afterwards():
    cal = watched()
    ecu = known(cal)
    replay(ecu, cal, drive(lambda moment: -moment))
    ecu.mode = 1
    supervise(ecu, cal, 1)
    assert ecu.mode == SAFE
    assert ecu.fault_active >> sv.FAULT_ACTUATOR_CONTRADICTED & 1
    assert ecu.failed == [1] * 4
