"""Heave monitor: what the springs carry where corners push both sides of an axle alike."""

import numpy as np
import pytest
import rig

from canroll.firmware import calibration as fw
from canroll.firmware import plausibility as sv
from canroll.firmware.monitors.axles import watch_heave
from canroll.firmware.monitors.residual import HEAVE
from canroll.firmware.state import SAFE, Ecu
from canroll.firmware.supervisor import supervise

STEP = 0.01
MASS = rig.VAN.mass
LEAST = 1.2 * MASS
RATES = np.array([38_000.0, 42_000.0])
"""Of one spring of the front and of the rear axle, N/m."""
TICKS = 200
OF_MEAN = 32.0
"""Of the mean change of the springs' force that may be left over."""


def watched() -> fw.Calibration:
    """A calibration with the monitor on."""
    cal = rig.calibration(actuator=fw.SUSPENSION)
    cal.response_pass = round(STEP / 0.05 * 2**30)
    cal.response_wash = [0, round(STEP * 0.08 * 2**30), 0]
    cal.heave_late = round(OF_MEAN * 2**10)
    cal.heave_min = round(LEAST * 2**fw.Q_MOMENT)
    cal.heave_ticks = TICKS
    cal.heave_stretch = [round(STEP * rate * 2**10) for rate in RATES]
    return cal


def known(cal: fw.Calibration) -> Ecu:
    """An ECU whose response monitor knows all that acts."""
    ecu = rig.started(cal)
    ecu.response_known = 1
    return ecu


def replay(ecu: Ecu, cal: fw.Calibration, travel: np.ndarray) -> None:
    """Let the monitor judge rates of ``travel``: front left, front right, rear left, rear right."""
    for rates in np.diff(travel, axis=0, prepend=travel[:1]) / STEP:
        ecu.stroke_rate = [round(rate * 2**fw.Q_RATE) for rate in rates]
        watch_heave(ecu, cal)


def travels(carried: np.ndarray) -> np.ndarray:
    """Travels of the corners that carry so much more, N; zero first."""
    return np.concatenate([np.zeros((1, 4)), carried]) / np.repeat(RATES, 2)


def pushed(front: float, rear: float, seconds: float = 4.0) -> np.ndarray:
    """Corners that carry so much more for ``seconds``, N by axle."""
    half = np.repeat([0.5 * front, 0.5 * rear], 2)
    return travels(np.tile(half, (round(seconds / STEP), 1)))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("front", "rear"), [(1.0, 1.0), (2.0, 0.0), (0.0, 2.0)])
def test_springs_that_carry_more_than_the_body_for_long_tell_of_a_push(front, rear, sign):
    cal = watched()
    ecu = known(cal)
    push = 0.75 * sign * LEAST
    replay(ecu, cal, pushed(front * push, rear * push))
    assert rig.accused_axles(ecu) == [1, 1]


def test_it_takes_so_many_samples_in_a_row():
    cal = watched()
    ecu = known(cal)
    push = pushed(LEAST, LEAST)
    rates = np.diff(push, axis=0, prepend=push[:1]) / STEP

    def judge(sample: np.ndarray) -> None:
        ecu.stroke_rate = [round(rate * 2**fw.Q_RATE) for rate in sample]
        watch_heave(ecu, cal)

    assert rig.bad_samples(ecu, HEAVE, TICKS, judge, rates) == TICKS


def test_load_that_only_moves_accuses_nobody():
    cal = watched()
    # braking, to the front, and a curve, to one side, each of twice what would count upright
    ahead, side = 2.0 * LEAST, 0.5 * LEAST
    for carried in (
        [0.5 * ahead, 0.5 * ahead, -0.5 * ahead, -0.5 * ahead],
        [side, -side, side, -side],
    ):
        ecu = known(cal)
        replay(ecu, cal, travels(np.tile(carried, (500, 1))))
        assert rig.accused_axles(ecu) == [0, 0]


@pytest.mark.parametrize(("radius", "wrong"), [(2400.0, 0), (100.0, 1)])
def test_hills_accuse_nobody(radius, wrong):
    cal = watched()
    ecu = known(cal)
    # 15 m/s over crests and through dips, 3 s each
    period = np.concatenate([np.full(300, 1.0), np.full(300, -1.0)])
    weight = MASS * 15.0**2 / radius * np.tile(period, 4)
    replay(ecu, cal, travels(np.outer(weight, [0.25] * 4)))
    assert rig.accused_axles(ecu) == [wrong, wrong]


def test_samples_late_by_a_tick_on_a_rough_road_accuse_nobody():
    cal = watched()
    ecu = known(cal)
    random = np.random.default_rng(14)
    times = np.arange(0.0, 40.0, STEP)
    # wheels that hop, by 2 mm: at 10 Hz, of which the phase wanders
    phase = 2.0 * np.pi * 10.0 * times + np.cumsum(random.normal(0.0, 0.3, len(times)))
    travel = np.outer(0.002 * np.sin(phase), np.ones(4))
    rates = np.diff(travel, axis=0, prepend=travel[:1]) / STEP
    late = np.maximum(np.arange(len(times)) - random.integers(0, 2, len(times)), 0)
    drifted = STEP * np.cumsum(rates[late], axis=0) @ np.repeat(RATES, 2)
    assert np.abs(drifted).max() > 3.0 * LEAST
    replay(ecu, cal, STEP * np.cumsum(rates[late], axis=0))
    assert rig.accused_axles(ecu) == [0, 0]


def test_offsets_of_the_rates_accuse_nobody():
    cal = watched()
    ecu = known(cal)
    replay(ecu, cal, np.outer(np.arange(0.0, 60.0, STEP), [5e-4] * 4))
    assert rig.accused_axles(ecu) == [0, 0]


def test_it_starts_anew_where_all_that_acts_was_not_known():
    cal = watched()
    ecu = known(cal)
    ecu.response_known = 0
    replay(ecu, cal, pushed(2.0 * LEAST, 0.0))
    assert rig.accused_axles(ecu) == [0, 0]
    ecu.response_known = 1
    replay(ecu, cal, np.zeros((400, 4)))
    assert rig.accused_axles(ecu) == [0, 0]


def test_off_it_does_nothing():
    cal = watched()
    cal.heave_min = 0
    ecu = known(cal)
    replay(ecu, cal, pushed(5.0 * LEAST, 5.0 * LEAST))
    assert rig.accused_axles(ecu) == [0, 0]
    assert ecu.past[HEAVE] == 0


def test_no_axle_is_believed_afterwards():
    cal = watched()
    ecu = known(cal)
    replay(ecu, cal, pushed(2.0 * LEAST, 0.0))
    ecu.mode = 1
    supervise(ecu, cal, 1)
    assert ecu.mode == SAFE
    assert ecu.fault_active >> sv.FAULT_ACTUATOR_CONTRADICTED & 1
