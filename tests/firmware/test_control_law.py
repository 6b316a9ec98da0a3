"""The law in closed loop: wind-up, slew, what is held, low speed, steering."""

import numpy as np
import pytest
import rig

from canroll.firmware import calibration as fw
from canroll.firmware import control_law
from canroll.firmware.state import ACTIVE, SAFE

KMH = 2**20 / 3.6


def running(cal):
    ecu = rig.started(cal)
    ecu.mode, ecu.authority, ecu.gain_factor, ecu.motion_lost = ACTIVE, 1 << 30, 1 << 28, 0
    return ecu


def test_compensator_follows_its_saturated_output_and_does_not_wind_up():
    """Observer form: x⁺ = (A + L C) x + B y + L' u with u what was really given."""
    pull = 0.3
    cal = rig.calibration(moment_max=500 << 14, slew_max=fw.STATE_MAX, law=fw.COMPENSATOR)
    cal.compensator_order, cal.compensator_outputs = 1, 1
    cal.compensator_shift, cal.compensator_output_shift = [1] * 8, [1] * 2
    # the state in Q24, the roll rate in Q27, the output in Q14
    row, cal.compensator_shift[0] = rig.quantise_row([1 - pull, 0.5, pull / 100], 24, [24, 27, 14])
    cal.compensator_a[0][0], cal.compensator_b[0][1], cal.compensator_e[0][0] = row
    (cal.compensator_c[0][0],), cal.compensator_output_shift[0] = rig.quantise_row(
        [100.0], 14, [24]
    )
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
