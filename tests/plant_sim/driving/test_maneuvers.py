from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import csd, welch

from canroll import vehicles
from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.driving import drive, driver, maneuvers, path, steer_maneuvers
from canroll.plant_sim.world import handling, open_loop

ROLL1, NONLINEAR = bodies.body("roll1"), bodies.body("nonlinear")
VAN = vehicles.load("van_real")
ON_TYRES = {
    "crosswind": "wind has no effect",
    "split_friction": "friction over distance has no effect",
    "friction_jump": "friction over distance has no effect",
    "power_off_in_curve": "pedals have no effect",
}
"""Manoeuvres with what linear bodies do not have."""
DRIVEN = [name for name in maneuvers.names() if name != "from_file"]


def run(name, vehicle=VAN, body=NONLINEAR, speed=None, **options):
    maneuver = maneuvers.build(name, vehicle, speed, **options)
    return open_loop.run_passive(vehicle, body, maneuver)


def test_unknown_names_speeds_and_options_are_refused():
    with pytest.raises(UnknownNameError, match="did you mean 'roundabout'"):
        maneuvers.build("roundabuot", VAN)
    for speed in (-5 / 3.6, 0.0, 400 / 3.6, float("nan")):
        with pytest.raises(CanrollError, match="km/h"):
            maneuvers.build("double_lane_change", VAN, speed)
    with pytest.raises(CanrollError, match="preview"):
        maneuvers.build("double_lane_change", VAN, preview_time=0.1)
    with pytest.raises(CanrollError, match="friction"):
        maneuvers.build("moose", VAN, friction=0.0)
    with pytest.raises(UnknownNameError, match="did you mean 'radius'"):
        maneuvers.build("constant_radius", VAN, radus=50)
    for key in ("name", "vehicle", "speed", "seed"):
        with pytest.raises(UnknownNameError, match=f"option of moose '{key}'"):
            maneuvers.build("moose", VAN, **{key: 3})
    with pytest.raises(CanrollError, match="is not a number"):
        maneuvers.build("constant_radius", VAN, radius="wide")
    with pytest.raises(CanrollError, match="must be"):
        maneuvers.build("constant_radius", VAN, radius=-50)
    with pytest.raises(CanrollError, match="must be on or off"):
        maneuvers.build("moose", VAN, chassis_control="maybe")
    with pytest.raises(UnknownNameError, match="road class"):
        maneuvers.build("random_road", VAN, road_class="Z")


def test_options_of_a_command_line_come_as_text():
    with_text = maneuvers.build("moose", VAN, friction="0.5", chassis_control="off")
    assert with_text.drive.parameters["friction"] == 0.5
    assert with_text.drive.parameters["chassis_control"] == 0.0
    assert maneuvers.options("constant_radius")["radius"] == 100.0


def test_lanes_follow_the_standards():
    first, side, last = path.double_lane_change(2.0, 3.5)
    assert (first.width, side.width, last.width) == pytest.approx((2.45, 2.65, 2.85))
    assert (side.centre - side.width / 2) - (first.centre - first.width / 2) == pytest.approx(3.5)
    assert last.start + last.length == 125.0
    first, side, last = path.obstacle_avoidance(2.0)
    gap = (side.centre - side.width / 2) - (first.centre + first.width / 2)
    assert gap == pytest.approx(1.0) and side.width == 3.0 and last.width == 3.0
    assert last.start + last.length == 61.0


def test_aim_line_runs_along_the_lanes():
    lanes = path.double_lane_change(2.0, 3.5)
    x, y = path.through(lanes, approach=10.0, run_out=20.0)
    for lane in lanes:
        inside = (x > 10.0 + lane.start) & (x < 10.0 + lane.start + lane.length)
        assert np.allclose(y[inside], lane.centre, atol=2e-3)
    assert np.hypot(np.diff(x), np.diff(y)) == pytest.approx(path.STEP, rel=1e-3)


def test_path_from_curvature_closes_a_circle():
    radius = 22.0
    x, y = path.from_curvature([(1e-3, 1 / radius), (2 * np.pi * radius, 1 / radius)])
    assert np.hypot(x - x[0], y - radius).min() == pytest.approx(radius, rel=1e-3)
    assert np.hypot(x[-1], y[-1]) < path.STEP


@pytest.mark.parametrize("name", vehicles.names())
def test_driver_keeps_the_track_below_the_friction_limit(name):
    vehicle = vehicles.load(name)
    for maneuver, off in (("double_lane_change", 1.0), ("roundabout", 0.5)):
        outputs, steer = run(maneuver, vehicle, ROLL1)
        assert np.abs(outputs[:, ports.PATH_ERROR]).max() < off
        assert np.abs(outputs[:, ports.AY]).max() < vehicle.tyre.friction * vehicles.GRAVITY
        assert np.abs(outputs[-1, ports.ROLL]) < np.abs(outputs[:, ports.ROLL]).max()
        assert np.abs(np.diff(steer)).max() <= vehicle.steering.rate_limit * 1e-3 + 1e-12


@pytest.mark.parametrize("name", DRIVEN)
def test_every_manoeuvre_runs_to_its_end_on_every_plant(name):
    for body in bodies.BODIES.values():
        if body.name.startswith("linear_car") and name in ("fishhook", "j_turn", "sine_with_dwell"):
            continue  # far beyond what a linear tyre means
        if name == "braking_in_curve" and body.constant_speed:
            with pytest.raises(CanrollError, match="which keeps its entry speed"):
                run(name, body=body)
            continue
        if name in ON_TYRES and not body.friction:
            with pytest.raises(CanrollError, match=ON_TYRES[name]):
                run(name, body=body)
            continue
        outputs, _ = run(name, body=body)
        assert np.isfinite(outputs).all()
        assert outputs[-1, ports.X] != 0.0


@pytest.mark.parametrize("speed_kmh", [60, 80, 100, 120, 140, 160])
@pytest.mark.parametrize("preview", [0.75, 1.0])
def test_double_lane_change_stays_on_the_road_at_all_its_speeds(speed_kmh, preview):
    outputs, _ = run("double_lane_change", speed=speed_kmh / 3.6, preview_time=preview)
    assert outputs[:, ports.ROLLOVER].max() == 0.0
    assert np.abs(outputs[:, ports.PATH_ERROR]).max() < 6.0


def test_double_lane_change_beyond_80_is_marked():
    assert maneuvers.build("double_lane_change", VAN, 80 / 3.6).standard == "ISO 3888-1"
    assert "non-standard" in maneuvers.build("double_lane_change", VAN, 100 / 3.6).standard


def test_replayed_steering_repeats_the_run():
    maneuver = maneuvers.build("double_lane_change", VAN)
    outputs, steer = open_loop.run_passive(VAN, NONLINEAR, maneuver)
    again, replayed = open_loop.run_passive(VAN, NONLINEAR, maneuvers.replay(maneuver, steer))
    assert replayed == pytest.approx(steer, abs=1e-12)
    assert again[:, ports.ROLL] == pytest.approx(outputs[:, ports.ROLL], abs=1e-9)
    stiffer = replace(VAN, plant=replace(VAN.plant, roll_damping=1.2 * VAN.plant.roll_damping))
    other, same = open_loop.run_passive(stiffer, NONLINEAR, maneuvers.replay(maneuver, steer))
    assert same == pytest.approx(steer, abs=1e-12)
    assert not np.allclose(other[:, ports.ROLL], outputs[:, ports.ROLL])


def test_fishhook_reverses_when_the_roll_rate_has_died_down():
    outputs, steer = run("fishhook", speed=60 / 3.6)
    amplitude = steer.max()
    assert amplitude == pytest.approx(6.5 * steer_maneuvers.reference_angle(VAN))
    assert steer.min() == pytest.approx(-amplitude)
    reversal = np.flatnonzero(np.isclose(steer, amplitude, atol=1e-9))[-1]
    assert abs(outputs[reversal, ports.ROLL_RATE]) < np.radians(2.0)
    assert np.abs(np.diff(steer)).max() * 1000 * VAN.steering.ratio <= np.radians(721.0)
    held = np.isclose(steer, -amplitude, atol=1e-9).sum() / 1000
    assert held == pytest.approx(3.0, abs=0.05)
    assert steer[-1] == pytest.approx(0.0, abs=1e-6)


def test_fishhook_lifts_two_wheels_of_the_laden_van_and_more_speed_rolls_it_over():
    gentle, _ = run("fishhook", speed=50 / 3.6)
    lifting, _ = run("fishhook", speed=80 / 3.6)
    rolling, _ = run("fishhook", speed=100 / 3.6)
    assert gentle[:, ports.TWO_WHEEL_LIFT].max() == 0.0
    assert lifting[:, ports.TWO_WHEEL_LIFT].max() == 1.0
    assert rolling[-1, ports.ROLLOVER] == 1.0


def test_sine_with_dwell_has_the_frequency_and_dwell_of_the_standard():
    table = steer_maneuvers.sine_with_dwell_table(1.0)
    time = np.arange(table.size) * steer_maneuvers.TABLE_STEP - steer_maneuvers.START
    assert time[np.argmax(table)] == pytest.approx(0.25 / 0.7, abs=2e-3)
    dwell = time[np.isclose(table, -1.0, atol=1e-12)]
    assert dwell.max() - dwell.min() == pytest.approx(0.5, abs=3e-3)
    assert dwell.min() == pytest.approx(0.75 / 0.7, abs=3e-3)
    assert np.all(table[time > 1 / 0.7 + 0.501] == 0.0)


def test_banked_curve_needs_less_suspension_roll_when_it_leans_in():
    leaning, _ = run("banked_curve", bank_deg=-6.0)
    level, _ = run("banked_curve", bank_deg=0.0)
    adverse, _ = run("banked_curve", bank_deg=6.0)
    rolls = [outputs[-1, ports.ROLL] for outputs in (leaning, level, adverse)]
    assert rolls[0] < rolls[1] < rolls[2]


def test_chassis_control_brakes_and_steers_towards_the_linear_car():
    """A car that would spin on a slippery road keeps its yaw rate near the reference."""
    loose = replace(VAN, tyre=replace(VAN.tyre, cornering_stiffness_rear=0.8 * 165000.0))
    yaw = {}
    for on in (True, False):
        options = {"friction": 0.4, "scale": 3.0, "chassis_control": on}
        outputs, _ = run("sine_with_dwell", loose, **options)
        yaw[on] = outputs[:, ports.YAW_RATE]
    late = slice(-1500, None)
    assert np.abs(yaw[True][late]).max() < np.abs(yaw[False][late]).max()


def test_same_manoeuvre_gives_the_same_bytes():
    for name, seed in (("double_lane_change", 0), ("random_road", 3)):
        runs = [
            open_loop.run_passive(VAN, NONLINEAR, maneuvers.build(name, VAN, None, seed))[0]
            for _ in range(2)
        ]
        assert runs[0].tobytes() == runs[1].tobytes()
    roads = [maneuvers.build("random_road", VAN, None, seed).drive.road_left for seed in (1, 2)]
    assert not np.array_equal(*roads)


def test_sample_interpolates_and_holds_its_ends():
    table = np.array([1.0, 3.0, 2.0])
    assert [driver.sample(table, at) for at in (-1.0, 0.5, 1.5, 9.0)] == [1.0, 2.0, 2.5, 2.0]


@pytest.mark.parametrize("name", ["double_lane_change", "bumps", "fishhook"])
def test_a_straightened_run_is_the_earlier_one_and_then_steers_no_more(name):
    outputs, steer = run(name)
    until = 2500
    maneuver = maneuvers.straightened(
        maneuvers.build(name, VAN), steer[:until], outputs[:until, ports.VX], 5.0
    )
    straight, angle = open_loop.run_passive(VAN, NONLINEAR, maneuver)
    assert len(straight) == 5000
    before = slice(0, until - 200)  # the road ends under the wheels in front
    roll = straight[before, ports.ROLL], outputs[before, ports.ROLL]
    np.testing.assert_allclose(*roll, rtol=0, atol=1e-9)
    np.testing.assert_allclose(angle[:until], steer[:until], rtol=0, atol=1e-12)
    np.testing.assert_allclose(angle[until + 1000 :], 0.0, atol=1e-12)
    assert np.max(np.abs(straight[-100:, ports.ROLL_RATE])) < 1e-2


def test_a_step_steer_settles_at_its_lateral_acceleration():
    outputs, road_wheel = run("step_steer", body=bodies.body("linear_car"), speed=20.0)
    steer = road_wheel * VAN.steering.ratio
    rate = np.degrees(np.diff(steer)) / 1e-3
    assert rate.max() == pytest.approx(300.0, rel=0.01)
    assert np.all(steer[:500] == 0.0)
    assert np.mean(outputs[-500:, ports.AY]) == pytest.approx(4.0, rel=0.05)


def test_a_sine_sweep_rises_evenly_from_its_lowest_to_its_highest_frequency():
    """Zeros where the phase, 2π (f₀ t + (f₁ − f₀) t²/2T), is a multiple of π."""
    _, road_wheel = run("sine_sweep", speed=20.0, lowest=0.5, highest=2.5, duration=20.0)
    time = 1e-3 * np.arange(len(road_wheel)) - 0.5
    signs = np.sign(road_wheel[time > 0.0])
    crossed = time[time > 0.0][1:][np.diff(signs) != 0.0]
    turns = 0.5 * crossed + 0.5 * 2.0 * crossed**2 / 20.0
    np.testing.assert_allclose(2 * turns, np.arange(1, len(crossed) + 1), atol=0.02)
    assert len(crossed) in (59, 60)  # 30 periods of 1.5 Hz in the mean
    wanted = drive.steady_steer(VAN, 20.0, 2.0)
    assert np.abs(road_wheel).max() == pytest.approx(wanted, rel=1e-3)
    with pytest.raises(CanrollError, match="highest must be above lowest"):
        maneuvers.build("sine_sweep", VAN, 20.0, lowest=3.0, highest=1.0)


def test_a_sine_sweep_has_the_response_of_single_frequencies():
    """Cross spectrum over power at 1 Hz, against sines that were driven one by one."""
    outputs, steer = run("sine_sweep", speed=20.0, lateral_acceleration=1.0, duration=60.0)
    single = handling.frequency_response(
        VAN,
        handling.passive(VAN, NONLINEAR),
        speed=20.0,
        lateral_acceleration=1.0,
        frequencies=np.array([1.0]),
    )
    frequency, power = welch(steer, fs=1000.0, nperseg=8000)
    _, cross = csd(steer, outputs[:, ports.YAW_RATE], fs=1000.0, nperseg=8000)
    response = (cross / power)[np.argmin(np.abs(frequency - 1.0))]
    assert abs(response) == pytest.approx(abs(single.yaw_rate[0]), rel=0.02)
    assert np.angle(response) == pytest.approx(np.angle(single.yaw_rate[0]), abs=0.02)


def test_braking_in_a_curve_holds_the_circle_and_then_loses_the_energy_of_its_deceleration():
    outputs, steer = run("braking_in_curve", speed=16.0, deceleration=3.0)
    circle, braked = slice(4500, 5400), slice(6500, 8000)
    speed, yaw_rate = outputs[:, ports.VX], outputs[:, ports.YAW_RATE]
    # before the brakes it is a step steer to the same angle
    expected = drive.steady_steer(VAN, 16.0, 16.0**2 / 100.0)
    assert np.ptp(steer[1600:]) == 0.0
    assert steer[-1] == pytest.approx(expected)
    assert np.ptp(yaw_rate[circle]) < 0.01 * yaw_rate[circle].mean()
    assert speed[circle].mean() == pytest.approx(16.0, rel=0.01)
    assert speed[circle].mean() / yaw_rate[circle].mean() == pytest.approx(100.0, rel=0.1)
    # in steady braking v² falls by 2 a s, the work of the brakes and of the slopes of the tyres
    travelled = np.sum(speed[braked]) * 1e-3
    lost = speed[braked][0] ** 2 - speed[braked][-1] ** 2
    assert lost == pytest.approx(2 * 3.0 * travelled, rel=0.03)
    assert speed[-1] == pytest.approx(20.0 / 3.6, abs=0.5)
    # the lateral acceleration goes with the square of the speed while the balance stays
    assert outputs[-1, ports.AY] < 0.35 * outputs[circle, ports.AY].mean()


def test_braking_shifts_the_load_that_its_deceleration_asks_for():
    """m a h/l from the rear to the front axle, h of the whole car above the road."""
    outputs, _ = run("braking_in_curve", speed=16.0, deceleration=3.0, radius=2000.0)
    loads = outputs[:, ports.WHEEL_LOAD : ports.WHEEL_LOAD + 4]
    front = loads[:, :2].sum(axis=1)
    shifted = front[7000:7800].mean() - front[4500:5400].mean()
    deceleration = -outputs[7000:7800, ports.AX].mean()
    assert deceleration == pytest.approx(3.0, rel=0.03)
    height = VAN.cg_height
    expected = VAN.total_mass * deceleration * height / VAN.geometry.wheelbase
    assert shifted == pytest.approx(expected, rel=0.05)


def test_a_slalom_passes_each_cone_on_its_side():
    outputs, _ = run("slalom", speed=30 / 3.6, count=5)
    cones = 15.0 + 18.0 * np.arange(1, 6)
    y = np.interp(cones, outputs[:, ports.X], outputs[:, ports.Y])
    beside = np.array([1, -1, 1, -1, 1]) * y - VAN.geometry.width / 2
    assert np.all(beside > 0.0)
    assert abs(outputs[-1, ports.Y]) < 0.1


def test_bumps_are_counted():
    one, four = (maneuvers.build("bumps", VAN, count=count) for count in (1, 4))
    rises = [np.sum(np.diff(np.sign(m.drive.road_left)) > 0) for m in (one, four)]
    assert rises == [1, 4]
    with pytest.raises(CanrollError, match="whole number"):
        maneuvers.build("bumps", VAN, count=1.5)


def test_every_number_of_a_manoeuvre_has_its_limits():
    for name in maneuvers.names():
        for key, default in maneuvers.options(name).items():
            if isinstance(default, float):
                limits = maneuvers.OPTIONS[key]
                assert key == "preview_time" or limits.low <= default <= limits.high
                assert f"{limits.low:g} to {limits.high:g}" in maneuvers.describe(key, default)
