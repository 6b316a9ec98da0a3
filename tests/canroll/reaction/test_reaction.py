"""Detection of faults and harm, from traces of known content."""

import numpy as np
import pytest

from canroll.firmware.plausibility import FAULT_ROLL_RATE, FAULT_STUCK
from canroll.firmware.state import ACTIVE, DEGRADED, INIT, SAFE
from canroll.plant_sim.faults import parse
from canroll.reaction.reaction import observe
from canroll.runs.trace import TICK, Trace

DURATION = 4.0
STUCK = parse("Imu.RollRate=stuck@2")


def make(**signals):
    """A run of 4 s in a steady left curve with a moment of 1 kN·m to the right side."""
    time = np.arange(1, int(1e3 * DURATION) + 1) * 1e-3
    plain = {
        "time": time,
        "roll": np.full_like(time, 0.03),
        "path_error": np.full_like(time, 0.2),
        "ay": np.full_like(time, 3.0),
        "moment_front": np.full_like(time, -600.0),
        "moment_rear": np.full_like(time, -400.0),
        "command_held": np.ones_like(time),
        "rollover": np.zeros_like(time),
    }
    for name, (start, end, value) in signals.items():
        plain[name] = np.where((time >= start) & (time < end), value, plain[name])
    ticks = np.zeros(int(100 * DURATION), TICK)
    ticks["t"] = np.arange(1, len(ticks) + 1) * 0.01
    ticks["mode"] = np.where(ticks["t"] < 0.2, INIT, ACTIVE)
    empty = np.zeros(0, np.int64)
    return Trace(plain, np.zeros(0, np.dtype([("t", "i8")])), empty, ticks, DURATION)


def after(trace, t, **values):
    late = trace.ticks["t"] >= t
    for name, value in values.items():
        trace.ticks[name][late] = value
    return trace


def test_without_faults_modes_are_recorded_and_nothing_is_detected():
    found = observe(make(), make(), ())
    assert [(change.mode, round(change.t, 3)) for change in found.modes] == [
        ("INIT", 0.01),
        ("ACTIVE", 0.2),
    ]
    assert (found.codes, found.harm, found.detected_after, found.text) == ((), (), None, "")


def test_a_fault_code_is_the_detection_with_its_time_and_mode():
    trace = after(make(), 2.05, fault_codes=1 << FAULT_STUCK)
    found = observe(after(trace, 2.08, mode=SAFE), make(), STUCK)
    assert found.detected_after == pytest.approx(0.05)
    assert (found.detected_by, found.mode) == ("stuck", "SAFE")
    assert [(code.code, code.name) for code in found.codes] == [(FAULT_STUCK, "stuck")]
    assert found.codes[0].first == pytest.approx(2.05)
    assert found.text == "fault detected after 50 ms (stuck), no harm"


def test_a_code_that_was_there_before_is_no_detection():
    trace = after(make(), 1.5, fault_codes=1 << FAULT_STUCK)
    assert observe(trace, make(), STUCK).detected_after is None
    trace = after(trace, 2.5, fault_codes=1 << FAULT_STUCK | 1 << FAULT_ROLL_RATE)
    assert observe(trace, make(), STUCK).detected_by == "roll rate"


def test_leaving_active_or_releasing_the_command_is_a_detection():
    found = observe(after(make(), 2.3, mode=DEGRADED), make(), STUCK)
    assert (found.detected_by, round(found.detected_after, 3)) == ("DEGRADED", 0.3)
    found = observe(make(command_held=(2.16, 4.0, 0.0)), make(), STUCK)
    assert (found.detected_by, round(found.detected_after, 3)) == ("command released", 0.16)


@pytest.mark.parametrize(
    ("duration", "rear", "harmful"),
    [(0.09, 1700.0, False), (0.15, 1700.0, True), (0.5, 1050.0, False), (0.5, 1150.0, True)],
)
def test_a_moment_to_the_wrong_side_harms_if_large_and_long(duration, rear, harmful):
    found = observe(make(moment_rear=(2.5, 2.5 + duration, rear)), make(), STUCK)
    assert bool(found.harm) == harmful
    assert found.wrong_side_max_nm == pytest.approx(rear - 600.0)
    if harmful:
        assert found.harm_after == pytest.approx(0.6, abs=2e-3)
        assert found.wrong_side_s == pytest.approx(duration, abs=2e-3)
        assert found.undetected_harm


def test_roll_angle_and_path_error_are_compared_with_the_passive_vehicle():
    assert not observe(make(roll=(2.5, 3.0, -0.0329)), make(), STUCK).harm
    found = observe(make(roll=(2.5, 3.0, -0.0331), path_error=(2.7, 3.0, 0.3)), make(), STUCK)
    assert found.harm == (
        "roll angle 1.90° instead of 1.72°",
        "path error 0.30 m instead of 0.20 m",
    )
    assert found.harm_after == pytest.approx(0.5)


def test_below_a_degree_of_the_passive_vehicle_the_road_alone_rolls_it():
    flat = make(roll=(0.0, 4.1, 0.002))
    assert not observe(make(roll=(0.0, 4.1, np.radians(1.09))), flat, STUCK).harm
    found = observe(make(roll=(0.0, 4.1, np.radians(1.11))), flat, STUCK)
    assert found.harm == ("roll angle 1.11° instead of 0.11°",)


@pytest.mark.parametrize(("rear", "harmful"), [(2050.0, False), (2150.0, True)])
def test_harm_that_is_done_without_faults_is_not_theirs(rear, harmful):
    healthy = make(moment_rear=(2.5, 3.0, 1600.0), roll=(2.0, 3.0, 0.05), rollover=(3.0, 4.0, 1.0))
    trace = make(moment_rear=(2.5, 3.0, rear), roll=(2.0, 3.0, 0.05), rollover=(3.1, 4.0, 1.0))
    assert observe(healthy, make(), ()).harm == (
        "roll angle 2.86° instead of 1.72°",
        "up to 1000 N·m on the wrong side for 0.50 s",
        "the vehicle rolls over",
    )
    found = observe(trace, make(), STUCK, healthy).harm
    assert found == (("up to 1550 N·m on the wrong side for 0.50 s",) if harmful else ())
    earlier = make(moment_rear=(2.2, 2.4, 1600.0))
    assert observe(earlier, make(), STUCK, healthy).harm


def test_harm_before_the_fault_is_not_its_harm():
    assert not observe(make(roll=(1.0, 1.5, 0.1)), make(), STUCK).harm


def test_a_rollover_harms_unless_the_passive_vehicle_rolls_over_too():
    over = make(rollover=(3.0, 4.0, 1.0))
    assert observe(over, make(), STUCK).harm == ("the vehicle rolls over",)
    assert not observe(over, over, STUCK).harm


def test_a_fault_after_the_end_has_no_verdict():
    found = observe(make(), make(), parse("Imu.RollRate=stuck@9"))
    assert found.no_verdict == "it begins at 9 s, the run ends at 4 s"
    assert found.text.startswith("no verdict")
