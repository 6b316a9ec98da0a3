"""The design of the residuals: balances of the linear car, and thresholds that hold over a box."""

from dataclasses import replace

import numpy as np
import pytest

from canroll.gain_gen.models.task import Delay, Task
from canroll.gain_gen.monitors import noise
from canroll.gain_gen.monitors.bank import (
    DERIVATIVE,
    DIRECT,
    INTEGRAL,
    STEP,
    ResidualPart,
    Term,
    ticks_of,
)
from canroll.gain_gen.monitors.linear_car import (
    car_of,
    deviation,
    effective_inertia,
    free_lean,
    lifting,
    off_stops,
)
from canroll.gain_gen.monitors.residuals import bank_of
from canroll.gain_gen.monitors.uncertainty import NOMINAL, Uncertainty, vertices
from canroll.vehicles import GRAVITY, load

VEHICLES = ("van_real", "suv_2020", "sedan_320i", "van_2021", "van_2022", "car_2020")
TICK = 0.01
BOX = Uncertainty()


def bank(name="van_real", actuator="bars", **changes):
    task = Task(load(name), Delay.constant(0.02), tick=TICK, actuator=actuator)
    chosen = {"suspension": True, "moments": True} | changes
    return bank_of(task, BOX, **chosen)


def test_corners_are_those_of_the_box():
    points = list(vertices(BOX, ("mass", "tyre")))
    assert {(point.mass, point.tyre) for point in points} == {
        (0.8, 0.9),
        (0.8, 1.1),
        (1.2, 0.9),
        (1.2, 1.1),
    }
    assert all(point.damping == 1.0 for point in points)


def test_the_largest_deviation_is_at_a_corner():
    # 1.2 * 1.2 - 1 against 1 - 0.8 * 0.8
    assert deviation(lambda f: 7.0 * f.mass * f.height, BOX, ("mass", "height")) == pytest.approx(
        0.44
    )


@pytest.mark.parametrize("name", VEHICLES)
def test_a_box_of_no_width_leaves_noise_and_road_alone(name):
    task = Task(load(name), Delay.constant(0.02), tick=TICK, actuator="bars")
    sure = replace(
        BOX,
        **dict.fromkeys(
            ("mass", "height", "inertia", "stiffness", "damping", "tyre", "moment", "speed"), 0.0
        ),
    )
    known = bank_of(task, sure, suspension=True, moments=True)
    slow = next(residual for residual in known.residuals if residual.name == "body, slow")
    assert [term.weight for term in slow.terms if term.sign] == [0.0] * 5


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("actuator", ["bars", "suspension"])
def test_every_vehicle_has_a_bank_without_a_number_of_its_own(name, actuator):
    found = bank(name, actuator)
    assert len(found.residuals) == (8 if actuator == "suspension" else 7)
    for residual in found.residuals:
        assert 0.0 < residual.floor < np.inf
        assert all(0.0 <= term.weight < 4.0 for term in residual.terms)
        assert {term.part for term in residual.terms} <= set(found.parts)


@pytest.mark.parametrize(
    ("changes", "absent"),
    [
        ({"suspension": False}, {"body, slow", "axles", "gyro, front"}),
        ({"moments": False}, {"body, fast", "axles"}),
    ],
)
def test_what_is_not_measured_is_in_no_residual(changes, absent):
    found = bank(**changes)
    assert not absent & {residual.name for residual in found.residuals}
    signals = {signal for part in found.parts.values() for signal in part.gains}
    if "suspension" in changes:
        assert not any(signal.startswith(("stroke", "heave")) for signal in signals)
    else:
        assert not any(signal.startswith("moment") for signal in signals)


@pytest.mark.parametrize("observer", ["acceleration", "acceleration_propagated"])
def test_a_roll_rate_that_is_not_used_is_not_judged(observer):
    task = Task(load("van_real"), Delay.constant(0.02), actuator="bars", observer=observer)
    found = bank_of(task, BOX, suspension=True, moments=True)
    signals = {signal for part in found.parts.values() for signal in part.gains}
    assert "roll_rate" not in signals
    assert "axles" in {residual.name for residual in found.residuals}


def test_the_reference_observer_reads_no_sensor_that_could_be_judged():
    task = Task(load("van_real"), Delay.constant(0.02), actuator="bars", observer="reference")
    found = bank_of(task, BOX, suspension=True, moments=True)
    assert found.parts == {} and found.residuals == ()


@pytest.mark.parametrize("name", VEHICLES)
def test_the_body_is_in_balance_where_the_unit_is(name):
    """J φ'' + K φ + C φ' = m h (a + g φ) of a body on a level road, a that of the unit's place."""
    car = car_of(load(name))
    roll, up = car.vehicle.design, car.vehicle.sensors.imu_position[2]
    h = roll.cg_height_above_roll_axis
    phi, rate, of_axis = 0.03, 0.2, 3.0
    springs, damping = car.stiffness * phi, roll.roll_damping * rate
    arm = roll.roll_arm
    # about the roll axis, whose own lateral acceleration is of_axis
    accelerated = (arm * of_axis + arm * GRAVITY * phi - springs - damping) / roll.roll_inertia
    measured = of_axis - (h + up) * accelerated + GRAVITY * phi
    inertia = effective_inertia(car, NOMINAL)
    assert inertia * accelerated + springs + damping == pytest.approx(arm * measured)


@pytest.mark.parametrize("name", VEHICLES)
def test_a_wheel_lifts_below_what_tips_the_rigid_car(name):
    car = car_of(load(name))
    front, rear = lifting(car)
    tips = car.vehicle.static_stability_factor * GRAVITY
    assert min(front, rear) < 1.02 * tips
    assert max(front, rear) > 0.7 * tips


@pytest.mark.parametrize("name", VEHICLES)
def test_a_body_is_on_its_stops_only_beyond_what_the_worst_car_takes(name):
    """The worst corner of the box leans as far as its clearance there, statically."""
    car = car_of(load(name))
    limit = off_stops(car, BOX)
    arm = car.arm * (1.0 + BOX.mass) * (1.0 + BOX.height)
    # gravity's moment on top tips a soft car further: the bound is of the linear, nominal lean
    lean = arm * limit / (car.stiffness * (1.0 - BOX.stiffness))
    assert lean <= free_lean(car) * 1.01
    suspension = car.vehicle.suspension
    assert free_lean(car) * max(car.tracks) / 2.0 <= suspension.rebound_clearance
    assert 0.0 < limit < 15.0


def simulated(part: ResidualPart, signal: np.ndarray) -> np.ndarray:
    """A part tick by tick, from its equations."""
    low, share = TICK / part.low_pass, 1.0 / part.memory(TICK)
    memory = slow = 0.0
    result = []
    for value in signal:
        if part.kind == INTEGRAL:
            slow += low * (memory - slow)
            memory += TICK * value - share * memory
            result.append(slow)
            continue
        washed = memory + value
        memory -= share * washed
        slow += low * (washed - slow)
        result.append(slow if part.kind == DIRECT else washed - slow)
    return np.array(result)


@pytest.mark.parametrize("kind", [DIRECT, INTEGRAL, DERIVATIVE])
@pytest.mark.parametrize("washout", [0.0, 0.5])
def test_responses_are_those_of_the_equations(kind, washout):
    part = ResidualPart("a part", kind, {"lateral": 1.0}, washout)
    signal = np.random.default_rng(3).standard_normal(300)
    ours = noise.response(part, signal, TICK)
    # an integral's washout and low-pass commute but for a share of a tick
    np.testing.assert_allclose(
        ours, simulated(part, signal), atol=0.02 if kind == INTEGRAL else 1e-12
    )


def test_a_level_is_crossed_as_seldom_as_wanted():
    """White noise between both filters, simulated for hours: crossings of the level, counted."""
    rng = np.random.default_rng(7)
    part = ResidualPart("a part", DIRECT, {"lateral": 1.0}, 0.8)
    hours = 20.0
    noisy = noise.response(part, rng.standard_normal(round(hours * 3600.0 / TICK)), TICK)
    wanted = 60.0
    level = noise.level(wanted, part.memory(TICK) * TICK, part.low_pass) * noisy.std()
    above = np.abs(noisy) > level
    # a level is left and crossed again several times by noise that has no derivative
    crossings = np.count_nonzero(above[1:] & ~above[:-1]) / hours
    assert 0.3 * wanted < crossings < 6.0 * wanted


def test_the_floor_holds_for_noise_alone():
    """No residual of white noise stays beyond the floor for its time in an hour."""
    found = bank()
    slow = next(residual for residual in found.residuals if residual.name == "body, fast")
    rng = np.random.default_rng(11)
    vehicle, count = load("van_real"), 360_000
    sigma = noise.deviations(vehicle, BOX)
    drawn = {name: value * rng.standard_normal(count) for name, value in sigma.items()}
    total = np.zeros(count)
    for term in slow.terms:
        part = found.parts[term.part]
        if term.sign == 0:
            continue
        of_part = sum(gain * drawn.get(name, 0.0) for name, gain in part.gains.items())
        if np.ndim(of_part):
            total += term.sign * noise.response(part, of_part, found.tick)
    beyond = np.abs(total) > slow.floor
    ticks = ticks_of(slow.time, found.tick)
    run = np.convolve(beyond, np.ones(ticks), "valid").max()
    assert run < ticks
    # and is no larger than that takes
    assert slow.floor < 8.0 * total.std()


def test_a_random_walk_stays_within_its_drift():
    """An integral of steps of which a tenth come wrong, against the mean step's factor."""
    part = ResidualPart("an integral", INTEGRAL, {"stroke_front": 1.0}, 0.2)
    rng = np.random.default_rng(2)
    samples = rng.standard_normal(100_000)
    steps = np.abs(np.diff(samples, prepend=0.0))
    wrong = np.where(rng.random(len(samples)) < BOX.late, np.diff(samples, prepend=0.0), 0.0)
    error = noise.response(part, wrong, TICK)
    factor = noise.walk(part, BOX, TICK, noise.OF_STEPS * BOX.late**0.5)
    assert np.abs(error).max() < factor * steps.mean()
    assert np.abs(error).max() > 0.2 * factor * steps.mean()


def test_offsets_count_only_where_nothing_washes_them_out():
    parts = {
        "washed": ResidualPart("washed", DIRECT, {"lateral": 1000.0}, 0.5),
        "kept": ResidualPart("kept", DIRECT, {"lateral": 1000.0}),
    }
    biased = replace(BOX, noise=1e-9)
    floors = {
        name: noise.floor(
            parts, [Term(name, 1, 0.0)], vehicle=load("van_real"), box=biased, tick=TICK, time=0.1
        )
        for name in parts
    }
    channel = load("van_real").sensors.lateral_acceleration
    largest = biased.bias * (channel.bias + biased.temperature * channel.bias_per_kelvin)
    assert floors["kept"] == pytest.approx(1000.0 * largest, rel=0.05)
    assert floors["washed"] < 0.05 * floors["kept"]


def test_means_of_steps_are_parts_of_their_kind():
    found = bank(actuator="suspension")
    assert {part.kind for part in found.parts.values()} == {DIRECT, INTEGRAL, DERIVATIVE, STEP}
