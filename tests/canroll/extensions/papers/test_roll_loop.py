import numpy as np
import pytest
from scipy import signal

from canroll import vehicles
from canroll.extensions.papers.conditions import fitted_scale
from canroll.extensions.papers.roll_loop import STEP, Kalman, RollLoop, motion
from canroll.gain_gen.laws.hinf_event import PRINTED_EVENT_GAIN
from canroll.gain_gen.models.roll import ROLL_RATE

TIME = np.arange(3000) * STEP
SWAY = 3 * np.sin(2 * TIME)


@pytest.fixture(scope="module")
def van():
    return vehicles.load("van_2022").design


@pytest.fixture(scope="module")
def suv():
    return vehicles.load("suv_2020")


def test_rolling_is_a_second_order_system(van):
    """Without control the exact steps are scipy's; a dead sensor changes nothing."""
    free = motion(RollLoop(van), SWAY)
    system = signal.TransferFunction(
        [van.roll_arm], [van.roll_inertia, van.roll_damping, van.effective_stiffness]
    )
    _, expected, _ = signal.lsim(system, SWAY, TIME, interp=False)
    assert free.roll == pytest.approx(expected, abs=1e-9)
    assert np.array_equal(motion(RollLoop(van, np.zeros((1, 2))), SWAY).roll, free.roll)


def test_steady_turn_under_angle_feedback(suv):
    """φ = m h a_y/(K − m g h + k), and the moment is k φ."""
    model, stiffness = suv.design, 38315.0
    loop = RollLoop(model, np.array([[-stiffness, 0.0]]), sampling=0.01, lag=0.01)
    found = motion(loop, np.full(4000, 4.0))
    expected = model.roll_arm * 4.0 / (model.effective_stiffness + stiffness)
    assert found.roll[-1] == pytest.approx(expected, rel=1e-6)
    assert found.moment[-1] == pytest.approx(-stiffness * expected, rel=1e-6)


def test_feedforward_cancels_the_disturbance(suv):
    model = suv.design
    found = motion(RollLoop(model, np.zeros((1, 2)), model.roll_arm), SWAY)
    assert np.abs(found.roll).max() < 1e-12


def test_the_filter_finds_angle_and_acceleration_without_noise(suv):
    model = suv.design
    kalman = Kalman(model, (1e-4, 1.0, 1e3), 1e-2)
    found = motion(RollLoop(model, np.zeros((1, 2)), sampling=0.01, observer=kalman), SWAY)
    assert found.figure("roll_error_max") < 0.03 * found.figure("roll_max")
    assert found.figure("lateral_error_max") < 0.2 * 3
    noisy = motion(
        RollLoop(model, np.zeros((1, 2)), sampling=0.01, observer=kalman, noise=np.radians(0.5)),
        SWAY,
    )
    assert noisy.figure("roll_error_max") > 3 * found.figure("roll_error_max")


def test_delay_makes_a_stable_gain_unstable(van):
    gain = PRINTED_EVENT_GAIN * ROLL_RATE
    assert motion(RollLoop(van, gain, delay=0.06), SWAY).stable
    late = motion(RollLoop(van, gain, delay=0.12), np.tile(SWAY, 3))
    assert not late.stable
    assert np.isnan(late.figure("roll_max"))


def test_the_trigger_sends_less_and_holds(van):
    loop = RollLoop(van, PRINTED_EVENT_GAIN * ROLL_RATE, sampling=0.02)
    every = motion(loop, SWAY)
    assert every.figure("transmission_rate") == 1
    triggered = RollLoop(van, PRINTED_EVENT_GAIN * ROLL_RATE, sampling=0.02, epsilon_squared=0.1)
    found = motion(triggered, SWAY)
    assert found.samples == every.samples == 150
    assert 0 < found.figure("transmission_rate") < 0.5
    changes = np.count_nonzero(np.diff(found.moment))
    assert changes <= found.sent


def test_dampers_cannot_hold_an_angle(suv):
    """In a steady turn they leave the roll of no control, whatever is commanded."""
    dampers = suv.actuators.dampers
    curve = np.array([dampers.rate, dampers.soft_force, dampers.firm_force])
    with_dampers = RollLoop(
        suv.design,
        np.array([[-1e5, 0.0]]),
        sampling=0.01,
        lag=0.1,
        curve=curve,
        half_track=suv.geometry.half_track_front,
    )
    lateral = np.full(20000, 3.0)
    free = motion(RollLoop(suv.design), lateral)
    found = motion(with_dampers, lateral)
    assert found.roll[-1] == pytest.approx(free.roll[-1], rel=1e-2)
    assert abs(found.roll[200]) < 0.9 * abs(free.roll[200])


def test_the_fitted_scale_gives_the_printed_angle(van):
    scale = fitted_scale(van, SWAY, 3.31)
    assert motion(RollLoop(van), scale * SWAY).figure("roll_max") == pytest.approx(3.31)
