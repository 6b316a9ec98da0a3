"""Axles monitor: one axle's suspension against the other's, of a body that rolls on its tyres."""

import numpy as np
import pytest
import rig
from scipy.integrate import solve_ivp

from canroll.firmware import calibration as fw
from canroll.firmware import plausibility as sv
from canroll.firmware.monitors.axles import watch_axles
from canroll.firmware.monitors.residual import AXLES
from canroll.firmware.state import RX_IMU, SAFE, Ecu
from canroll.firmware.supervisor import supervise

VAN, TRACK, STEP = rig.VAN, 2.0 * rig.VAN.half_track, 0.01
LOW_PASS, WASHOUT = 0.05, 1.26
LEAST, REST = 400.0, 2000.0
SECONDS = 4.0
SPRINGS = np.array([0.6, 0.4]) * VAN.roll_stiffness
DAMPERS = np.array([0.6, 0.4]) * VAN.damping
TYRES = np.array([8.0, 7.0]) * VAN.roll_stiffness
AT_CENTRES = np.array([200.0, 350.0])
"""Moment at the axles by lateral acceleration, kg·m."""
BY_YAW = 300.0
"""Moment at the front axle by yaw acceleration, and that of the other sign at the rear, kg·m²."""
SHARE = TYRES[0] / TYRES[1]
OF_MOMENTS = 0.125
"""Of the moments that may be reported wrongly."""


def watched() -> fw.Calibration:
    """A calibration with the monitor on."""
    cal = rig.calibration(actuator=fw.BARS)
    cal.axles_ticks = 20
    cal.response_pass = round(STEP / LOW_PASS * 2**30)
    cal.response_wash = [0, 0, round(STEP * WASHOUT * 2**30)]
    cal.response_share[5] = round(OF_MOMENTS * 2**fw.Q_SHARE)
    scale = np.array([1.0, SHARE])
    stretch = scale * (SPRINGS + TYRES)
    cal.axles_min = round(LEAST * 2**fw.Q_MOMENT)
    cal.axles_rest = round(REST * 2**fw.Q_MOMENT)
    cal.axles_limit = round(10.0 * 2**fw.Q_ACCELERATION)
    cal.axles_stretch = [round(STEP * value / TRACK * 2**10) for value in stretch]
    cal.axles_damping = [round(ratio * 2**10) for ratio in scale * DAMPERS / stretch / STEP]
    cal.axles_rough = round(0.02 / STEP * 2**10)
    cal.axles_rear = round(SHARE * 2**28)
    cal.axles_lateral = round((AT_CENTRES[0] - SHARE * AT_CENTRES[1]) * 2**10)
    cal.axles_yaw = round(BY_YAW * (1.0 + SHARE) / LOW_PASS * 2**10)
    return cal


def known(cal: fw.Calibration) -> Ecu:
    """An ECU whose response monitor knows all that acts."""
    ecu = rig.started(cal)
    ecu.motion_lost = 0
    ecu.response_known = 1
    ecu.valid[RX_IMU] = 7
    return ecu


def drive(true, *, of_springs: float = 1.0, of_body: float = 1.0, road=lambda t: np.zeros(2)):
    """Samples (stroke rates of the axles, reported moments, a_y, yaw rate) of a slalom of 4 m/s².

    ``true`` gives the moments of the axles from the reported ones, N·m. Springs and dampers are
    ``of_springs`` times the monitor's, mass and height ``of_body`` times. ``road`` is the roll
    angle of the road under the axles, rad.
    """

    def lateral(t):
        return 4.0 * np.sin(2.0 * np.pi * 0.5 * t)

    def yaw(t):
        return lateral(t - 0.1) / 22.0

    def reported(t):
        share = np.array([0.6, 0.4])
        return -0.8 * VAN.moment_per_acceleration * share * lateral(t - 0.05)

    def strokes(t, state):
        # tyres that carry what springs, dampers and actuators of their axle pass on
        body, tilt = state[0], state[2:]
        moment = true(reported(t))
        yawing = (yaw(t + 1e-3) - yaw(t - 1e-3)) / 2e-3
        outside = AT_CENTRES * lateral(t) + BY_YAW * np.array([1.0, -1.0]) * yawing
        passed = TYRES * (tilt - road(t)) - outside
        return (passed + moment - of_springs * SPRINGS * (body - tilt)) / (of_springs * DAMPERS)

    def rates(t, state):
        stroke = strokes(t, state)
        moment = true(reported(t))
        springs = of_springs * (SPRINGS * (state[0] - state[2:]) + DAMPERS * stroke)
        acting = of_body * VAN.moment_per_acceleration * lateral(t) + (moment - springs).sum()
        return [state[1], acting / (of_body * VAN.inertia), *(state[1] - stroke)]

    times = np.arange(0.0, SECONDS, STEP)
    states = solve_ivp(
        rates, (0.0, SECONDS), [0.0] * 4, t_eval=times, max_step=STEP, method="LSODA"
    ).y
    of_axles = np.array([strokes(t, state) for t, state in zip(times, states.T, strict=True)])
    moments = np.array([reported(t) for t in times])
    return np.column_stack([of_axles, moments, lateral(times), yaw(times)])


def replay(ecu: Ecu, cal: fw.Calibration, samples: np.ndarray) -> None:
    """Let the monitor judge the samples."""
    for front, rear, *moments, lateral, yaw in samples:
        left = [round(0.5 * TRACK * stroke * 2**fw.Q_RATE) for stroke in (front, rear)]
        ecu.stroke_rate = [left[0], -left[0], left[1], -left[1]]
        ecu.delivered = [round(moment * 2**fw.Q_MOMENT) for moment in moments]
        ecu.lateral_acceleration = round(lateral * 2**fw.Q_ACCELERATION)
        ecu.yaw_rate = round(yaw * 2**fw.Q_RATE)
        watch_axles(ecu, cal)


@pytest.mark.parametrize(
    ("true", "lie"),
    [
        ([1.0, 1.0], 0),
        ([0.8, 0.8], 0),
        ([1.2, 1.2], 0),
        ([0.0, 1.0], 1),
        ([-1.0, 1.0], 1),
        ([1.0, 0.0], 1),
        ([1.0, -1.0], 1),
    ],
    ids=["true", "80 %", "120 %", "front dead", "front reversed", "rear dead", "rear reversed"],
)
@pytest.mark.parametrize("of_springs", [0.8, 1.0, 1.2])
def test_an_axle_that_its_tyres_do_not_bear_out_lies(true, lie, of_springs):
    cal = watched()
    ecu = known(cal)
    replay(ecu, cal, drive(lambda moment: np.array(true) * moment, of_springs=of_springs))
    assert rig.accused_axles(ecu) == [lie, lie]


@pytest.mark.parametrize("of_body", [0.6, 1.6])
def test_neither_mass_nor_height_of_the_body_accuses(of_body):
    cal = watched()
    ecu = known(cal)
    replay(ecu, cal, drive(lambda moment: moment, of_body=of_body))
    assert rig.accused_axles(ecu) == [0, 0]
    assert ecu.evidence[AXLES] == 0


def test_a_road_that_tilts_both_axles_accuses_nobody():
    cal = watched()
    ecu = known(cal)
    replay(ecu, cal, drive(lambda moment: moment, road=lambda t: np.full(2, 0.1 * np.sin(3 * t))))
    assert rig.accused_axles(ecu) == [0, 0]


def test_a_bump_is_too_short_to_accuse():
    def bump(t):
        # 3 cm under one side for 0.1 s, which the rear axle meets 0.15 s later
        late = t - 1.0 - np.array([0.0, 0.15])
        return np.where(abs(late) < 0.05, 0.02 * np.cos(np.pi * late / 0.1) ** 2, 0.0)

    cal = watched()
    ecu = known(cal)
    replay(ecu, cal, drive(lambda moment: moment, road=bump))
    assert rig.accused_axles(ecu) == [0, 0]


def test_on_a_road_that_is_too_rough_nothing_is_judged():
    cal = watched()
    ecu = known(cal)
    lies = drive(lambda moment: np.array([-1.0, 1.0]) * moment)
    lies[::50, 0] += 2.0 * REST / (0.02 * TYRES[0])
    replay(ecu, cal, lies)
    assert rig.accused_axles(ecu) == [0, 0]


@pytest.mark.parametrize(("size", "samples"), [(1000.0, 20), (4000.0, 11)])
def test_it_takes_so_many_samples_in_a_row_and_half_as_many_large_ones(size, samples):
    cal = watched()
    ecu = known(cal)
    jump = np.zeros((cal.axles_ticks + 40, 6))
    jump[20:, 2] = size
    bad = rig.bad_samples(
        ecu, AXLES, cal.axles_ticks, lambda sample: replay(ecu, cal, sample[None]), jump
    )
    assert bad == samples


@pytest.mark.parametrize(("at_centres", "wrong"), [(0.0, 1), (300.0, 0)])
def test_roll_centres_may_lie_elsewhere(at_centres, wrong):
    cal = watched()
    cal.axles_side = round(at_centres * 2**10)
    ecu = known(cal)
    curve = np.zeros((cal.axles_ticks + 60, 6))
    curve[20:, 4] = 4.0
    # a moment of the front axle that balances it but for 250 kg·m
    curve[20:, 2] = 4.0 * (250.0 + AT_CENTRES[0] - SHARE * AT_CENTRES[1])
    replay(ecu, cal, curve)
    assert rig.accused_axles(ecu) == [wrong, wrong]


@pytest.mark.parametrize("compared", [0, 1])
def test_what_comes_back_from_the_limit_is_not_compared_at_once(compared):
    cal = watched()
    ecu = known(cal)
    ecu.motion_peak = 8 << fw.Q_ACCELERATION
    ecu.axles_known = compared
    replay(ecu, cal, np.zeros((10, 6)))
    assert ecu.axles_known == compared


@pytest.mark.parametrize(
    "state",
    [
        {"response_known": 0},
        {"motion_peak": 11 << fw.Q_ACCELERATION},
        {"motion_lost": 1},
        {"valid": [3, 3, 15, 3, 7]},
    ],
    ids=str,
)
def test_nothing_is_compared_unless_the_tyres_answer_and_all_that_acts_is_known(state):
    cal = watched()
    ecu = known(cal)
    for name, value in state.items():
        setattr(ecu, name, value)
    replay(ecu, cal, drive(lambda moment: np.array([-1.0, 1.0]) * moment))
    assert rig.accused_axles(ecu) == [0, 0]
    # afterwards it starts anew, from what is now
    restored = known(cal)
    for name in state:
        setattr(ecu, name, getattr(restored, name))
    replay(ecu, cal, drive(lambda moment: moment)[57:])
    assert rig.accused_axles(ecu) == [0, 0]


def test_off_it_does_nothing():
    cal = watched()
    cal.response_min = 0
    ecu = known(cal)
    ecu.response_known = 0
    replay(ecu, cal, drive(lambda moment: np.array([-1.0, 1.0]) * moment))
    assert rig.accused_axles(ecu) == [0, 0]
    assert ecu.axles_known == 0


def test_no_axle_is_believed_afterwards():
    cal = watched()
    ecu = known(cal)
    replay(ecu, cal, drive(lambda moment: np.array([-1.0, 1.0]) * moment))
    ecu.mode = 1
    supervise(ecu, cal, 1)
    assert ecu.mode == SAFE
    assert ecu.fault_active >> sv.FAULT_ACTUATOR_CONTRADICTED & 1
    assert ecu.failed == [1] * 4
