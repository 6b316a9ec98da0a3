"""Laws and schedule against float64 and scipy.signal."""

import numpy as np
import pytest
import rig
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from firmware import calibration as fw
from firmware import control_law
from firmware.com.signals import RX_SIGNALS
from firmware.schedule import schedule
from firmware.state import ACTIVE, DEGRADED, RX_VEHICLE_MOTION, SAFE

KMH = 2**20 / 3.6


def running(cal):
    ecu = rig.started(cal)
    ecu.mode, ecu.authority, ecu.gain_factor, ecu.motion_lost = ACTIVE, 1 << 30, 1 << 28, 0
    return ecu


def fill_compensator(cal, system, e) -> None:
    """States in Q24, inputs roll, roll rate, a_y, a_y by steering; outputs Q14."""
    a, b, c, d = system
    inputs, order = [30, 27, 24, 24], len(a)
    cal.law, cal.compensator_order, cal.compensator_outputs = fw.COMPENSATOR, order, len(c)
    cal.compensator_shift, cal.compensator_output_shift = [1] * 8, [1] * 2
    for i in range(order):
        row, cal.compensator_shift[i] = rig.quantise_row(
            [*a[i], *b[i], *e[i]], 24, [24] * order + inputs + [14] * 2
        )
        cal.compensator_a[i][:order] = row[:order]
        cal.compensator_b[i] = row[order : order + 4]
        cal.compensator_e[i] = row[order + 4 :]
    for k in range(len(c)):
        row, cal.compensator_output_shift[k] = rig.quantise_row(
            [*c[k], *d[k]], 14, [24] * order + inputs
        )
        cal.compensator_c[k][:order] = row[:order]
        cal.compensator_d[k] = row[order:]


def random_system(rng, order: int, outputs: int):
    """A stable discrete system whose states stay of order one for inputs of a manoeuvre."""
    a = rng.normal(size=(order, order))
    a *= 0.95 / np.max(np.abs(np.linalg.eigvals(a)))
    b = rng.normal(size=(order, 4)) * [2.0, 0.5, 0.05, 0.05]
    c = rng.normal(size=(outputs, order)) * 200
    d = rng.normal(size=(outputs, 4)) * [2000, 500, 50, 50]
    return a, b, c, d


@pytest.mark.parametrize(("order", "outputs"), [(1, 1), (4, 1), (8, 2), (0, 2)])
def test_compensator_is_the_linear_system(order, outputs):
    rng = np.random.default_rng(order)
    a, b, c, d = random_system(rng, max(order, 1), outputs)
    a, b, c = a[:order, :order], b[:order], c[:, :order]
    cal = rig.calibration(actuator=fw.BARS)
    fill_compensator(cal, (a, b, c, d), np.zeros((order, 2)))
    cal.moment_max = cal.slew_max = cal.steering_limit = fw.STATE_MAX
    ecu = running(cal)
    inputs = np.cumsum(rng.normal(size=(400, 4)), axis=0) * [1e-3, 1e-2, 0.1, 0.1]
    scale = 2.0 ** np.array([30, 27, 24, 24])
    ours = []
    for row in np.round(inputs * scale).astype(int).tolist():
        ecu.x[0], ecu.rate_good, ecu.acceleration_good, ecu.steering_acceleration = row
        control_law.control(ecu, cal, 1)
        ours.append(np.array(ecu.outputs[:outputs]) / 2**14)
        assert ecu.moment == ecu.outputs[0] + ecu.outputs[1]
    exact = signal.dlsim((a, b, c, d, 0.01), inputs)[1] if order else inputs @ d.T
    assert np.max(np.abs(exact)) > 30
    np.testing.assert_allclose(ours, exact, atol=0.02)


def test_compensator_believes_the_steering_up_to_its_limit():
    cal = rig.calibration(steering_limit=5 << 24, moment_max=fw.STATE_MAX, slew_max=fw.STATE_MAX)
    d = np.array([[0, 0, 0, 100.0]])
    fill_compensator(
        cal, (np.zeros((0, 0)), np.zeros((0, 4)), np.zeros((1, 0)), d), np.zeros((0, 2))
    )
    ecu = running(cal)
    for steered, moment in ((4, 400), (5, 500), (9, 500), (-4, -400), (-9, -500)):
        ecu.steering_acceleration = steered << 24
        control_law.control(ecu, cal, 1)
        assert ecu.moment / 2**14 == pytest.approx(moment, abs=0.01)


def test_compensator_follows_its_saturated_output_and_does_not_wind_up():
    """Observer form: x⁺ = (A + L C) x + B y + L' u with u what was really given."""
    a, b, c, d = (
        np.array([[1.0]]),
        np.array([[0, 0.5, 0, 0]]),
        np.array([[100.0]]),
        np.zeros((1, 4)),
    )
    pull = 0.3
    e = np.array([[pull / 100.0, 0.0]])
    cal = rig.calibration(moment_max=500 << 14, slew_max=fw.STATE_MAX)
    fill_compensator(cal, (a - pull, b, c, d), e)
    ecu = running(cal)
    x, peak = 0.0, 0.0
    for k in range(600):
        y = 1.0 if k < 300 else -1.0
        ecu.rate_good = round(y * 2**27)
        control_law.control(ecu, cal, 1)
        u = np.clip(100.0 * x, -500.0, 500.0)
        assert ecu.moment / 2**14 == pytest.approx(u, abs=0.01)
        x = (1.0 - pull) * x + 0.5 * y + pull / 100.0 * u
        peak = max(peak, abs(x))
    # without the pull the integrator would have gone to 150
    assert peak < 7.0


def test_compensator_takes_one_step_however_many_ticks_were_missed():
    cal = rig.calibration()
    a, b = np.array([[0.9]]), np.array([[0, 0.1, 0, 0]])
    fill_compensator(cal, (a, b, np.array([[10.0]]), np.zeros((1, 4))), np.zeros((1, 2)))
    late, steady = running(cal), running(cal)
    late.rate_good = steady.rate_good = 1 << 26
    control_law.control(late, cal, 4)
    control_law.control(steady, cal, 1)
    assert late.compensator_x == steady.compensator_x


def test_a_compensator_reads_the_gyro_and_not_the_estimate_of_its_rate():
    cal = rig.calibration()
    fill_compensator(
        cal,
        (np.zeros((0, 0)), np.zeros((0, 4)), np.zeros((1, 0)), np.array([[0, -2000.0, 0, 0]])),
        np.zeros((0, 2)),
    )
    ecu = running(cal)
    ecu.x[1] = round(0.7 * 2**27)
    ecu.rate_good, ecu.offset_rate = round(0.3 * 2**27), round(0.05 * 2**27)
    control_law.control(ecu, cal, 1)
    assert ecu.moment / 2**14 == pytest.approx(-2000 * 0.25, abs=0.01)


def test_output_feedback_subtracts_what_was_learnt():
    cal = rig.calibration(law=fw.OUTPUT_FEEDBACK)
    cal.output_gain, cal.output_gain_shift = rig.quantise_row(
        [-2000.0, -100.0, 0.0], 14, rig.MEASURED_Q
    )
    ecu = running(cal)
    ecu.rate_good, ecu.offset_rate = round(0.3 * 2**27), round(0.05 * 2**27)
    ecu.acceleration_good, ecu.offset_acceleration = round(2.0 * 2**24), round(0.5 * 2**24)
    control_law.control(ecu, cal, 1)
    assert ecu.moment / 2**14 == pytest.approx(-2000 * 0.25 - 100 * 1.5, abs=0.01)


def test_feedforward_is_off_when_the_lateral_acceleration_is_lost():
    cal = rig.calibration()
    ecu = running(cal)
    x = np.array([0.02, 0.1, 3.0, 1.0, 0.0])
    ecu.ahead = [round(v * 2.0**q) for v, q in zip(x, rig.STATE_Q, strict=True)]
    control_law.control(ecu, cal, 1)
    assert ecu.moment / 2**14 == pytest.approx(-(rig.FEEDBACK + rig.FEEDFORWARD) @ x, abs=0.01)
    ecu.mode, ecu.feedforward = DEGRADED, 1 << 28
    control_law.control(ecu, cal, 1)
    quarter = -(rig.FEEDBACK + 0.25 * rig.FEEDFORWARD) @ x
    assert ecu.moment / 2**14 == pytest.approx(quarter, abs=0.01)
    ecu.feedforward = 0
    control_law.control(ecu, cal, 1)
    assert ecu.moment / 2**14 == pytest.approx(-rig.FEEDBACK @ x, abs=0.01)


def test_authority_and_gain_factor_scale_the_command():
    cal = rig.calibration()
    ecu = running(cal)
    ecu.ahead[1] = 1 << 26
    ecu.authority, ecu.gain_factor = 1 << 29, round(0.8 * 2**28)
    control_law.control(ecu, cal, 1)
    assert ecu.moment / 2**14 == pytest.approx(-2400 * 0.5 * 0.5 * 0.8, abs=0.01)


def test_slew_limit_counts_missed_ticks():
    cal = rig.calibration(slew_max=50 << 14)
    ecu = running(cal)
    ecu.ahead[1] = 1 << 27
    for steps, expected in ((1, -50), (3, -200), (1, -250)):
        control_law.control(ecu, cal, steps)
        assert ecu.moment / 2**14 == pytest.approx(expected, abs=0.01)


def test_safe_scales_what_is_held():
    cal = rig.calibration(actuator=fw.BARS)
    ecu = running(cal)
    ecu.mode, ecu.authority, ecu.released = SAFE, 0, 1 << 28
    ecu.held = [500 << 14, 300 << 14]
    ecu.compensator_x[0] = 77
    cal.compensator_order = 1
    control_law.control(ecu, cal, 1)
    assert ecu.moment == 200 << 14
    assert ecu.outputs == [125 << 14, 75 << 14]
    assert ecu.compensator_x[0] == 0


speeds = st.lists(st.integers(0, 60 * 2**20), min_size=8, max_size=8, unique=True).map(sorted)
factors = st.lists(st.integers(0, 1 << 28), min_size=8, max_size=8)
shares = st.lists(st.integers(0, 1 << 30), min_size=8, max_size=8)
steering = st.lists(st.integers(-(1 << 28), 1 << 28), min_size=8, max_size=8)


@given(speeds, st.tuples(factors, shares, steering), st.integers(1, 8), st.integers(0, 70 << 20))
def test_schedule_interpolates_and_holds_its_ends(grid, values, points, speed):
    gains, front, steer = values
    cal = rig.calibration(
        schedule_points=points,
        schedule_speed=grid,
        schedule_gain=gains,
        schedule_front_share=front,
        schedule_steering=steer,
    )
    ecu = running(cal)
    ecu.speed, ecu.steering = speed, round(0.25 * 2**24)
    ecu.fresh[RX_VEHICLE_MOTION] = RX_SIGNALS[RX_VEHICLE_MOTION]
    schedule(ecu, cal)
    at = lambda values: np.interp(speed, grid[:points], values[:points])  # noqa: E731
    fade = np.clip((speed / KMH - 5.0) / 5.0, 0.0, 1.0)
    assert ecu.gain_factor == pytest.approx(at(gains) * fade, abs=200)
    assert ecu.front_share == pytest.approx(at(front), abs=20)
    assert ecu.steering_acceleration == pytest.approx(at(steer) / 2**20 * 0.25 * 2**24, abs=50)


def test_below_walking_pace_nothing_is_commanded():
    moments = {}
    for speed in (0.0, 4.9, 7.5, 10.0, 30.0):
        bench = rig.Bench(rig.calibration(), speed_kmh=speed).active()
        bench.run(0.5, lambda t: 3.0)
        moments[speed] = bench.ecu.moment / 2**14
        assert bench.ecu.mode == ACTIVE
    assert moments[0.0] == moments[4.9] == 0.0
    assert moments[10.0] == pytest.approx(moments[30.0], abs=0.01)
    # half the authority at half the way; the loop's own feedback makes it a little more than half
    assert 0.45 < moments[7.5] / moments[30.0] < 0.6


def test_steering_tells_the_lateral_acceleration_before_it_is_felt():
    """a_y by steering drives the estimate's second derivative."""
    cal = rig.calibration(schedule_steering=[round(12.0 * 2**20)] * 8)
    bench = rig.Bench(cal, steering_deg=20.0)
    bench.run(0.05)
    assert bench.ecu.steering_acceleration / 2**24 == pytest.approx(12.0 * np.radians(20), rel=1e-3)
    without = rig.Bench(rig.calibration(), steering_deg=20.0).run(0.1)
    bench.run(0.05)
    assert bench.ecu.x[3] > without.ecu.x[3] + 0.1 * 2**24
