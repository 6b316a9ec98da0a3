from dataclasses import replace

import numpy as np
import pytest
from support.car_bodies import CarBodies

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import nonlinear_car, parameters, ports
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.world import open_loop
from canroll.vehicles.roll_stiffness import steady_roll, suspension_roll_stiffness

BODY = bodies.body("nonlinear")


class Car:
    """One nonlinear car stepped by hand."""

    def __init__(self, vehicle, speed, **slots):
        self.state, self.parameters = BODY.build(vehicle, speed)
        self.inputs = ports.initial_inputs()
        for name, value in slots.items():
            self.inputs[getattr(ports, name)] = value
        self.outputs = np.zeros(ports.N_OUTPUTS)

    def run(self, seconds, dt=1e-3, hold_speed=None):
        mass = self.parameters.view(parameters.CAR)[0]["mass"]
        for _ in range(round(seconds / dt)):
            if hold_speed is not None:
                self.inputs[ports.DRIVE_FORCE] = (
                    5 * mass * (hold_speed - self.state[nonlinear_car.VX])
                )
            open_loop.advance(BODY.step, self.state, self.inputs, self.parameters, self.outputs, dt)
        return self.outputs


def smooth(vehicle):
    """The same vehicle with linear dampers: nothing in it has a kink."""
    suspension = replace(
        vehicle.suspension, rebound_bump_ratio=1.0, knee_speed=50.0, high_speed_ratio=1.0
    )
    return replace(
        vehicle, suspension=suspension, tyre=replace(vehicle.tyre, rolling_resistance=0.0)
    )


@pytest.mark.parametrize("name", vehicles.names())
def test_static_loads_carry_the_weight(name):
    vehicle = vehicles.load(name)
    loads = Car(vehicle, 20.0).run(1e-9, dt=1e-9)[ports.WHEEL_LOAD : ports.WHEEL_LOAD + 4]
    assert loads.sum() == pytest.approx(vehicle.total_mass * vehicles.GRAVITY, rel=1e-9)


def test_straight_run_stays_straight_and_level():
    car = Car(vehicles.load("van_real"), 30.0)
    outputs = car.run(5.0, hold_speed=30.0)
    assert abs(outputs[ports.Y]) < 1e-9 and abs(outputs[ports.ROLL]) < 1e-9
    assert abs(outputs[ports.YAW]) < 1e-9


@pytest.mark.parametrize("name", vehicles.names())
def test_steady_roll_and_understeer_equal_their_closed_forms(name):
    vehicle = vehicles.load(name)
    # The closed form knows no rolling resistance, which grows on the outer wheels.
    vehicle = replace(vehicle, tyre=replace(vehicle.tyre, rolling_resistance=0.0))
    speed, steer = 20.0, 0.001
    outputs = Car(vehicle, speed, STEER=steer).run(10.0, hold_speed=speed)
    lateral = outputs[ports.AY]
    stiffness = suspension_roll_stiffness(vehicle)
    assert outputs[ports.ROLL] / lateral == pytest.approx(
        steady_roll(vehicle, stiffness)[0], rel=0.01
    )
    curvature = outputs[ports.YAW_RATE] / outputs[ports.VX]
    expected = vehicle.geometry.wheelbase * curvature + vehicle.understeer * lateral
    assert steer == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("name", vehicles.names())
def test_all_plants_share_one_roll_gradient(name):
    vehicle = vehicles.load(name)
    gradient = vehicle.plant.roll_arm / vehicle.plant.effective_stiffness
    stiffness = suspension_roll_stiffness(vehicle)
    assert steady_roll(vehicle, stiffness)[0] == pytest.approx(gradient, rel=1e-9)


def test_mirrored_steering_gives_the_mirrored_run():
    vehicle = vehicles.load("suv_2020")
    left = Car(vehicle, 22.0, STEER=0.05).run(2.0)
    right = Car(vehicle, 22.0, STEER=-0.05).run(2.0)
    for slot in (ports.Y, ports.YAW, ports.ROLL, ports.ROLL_RATE, ports.AY, ports.VY):
        assert left[slot] == pytest.approx(-right[slot], rel=1e-12)
    for a, b in ((0, 1), (1, 0), (2, 3), (3, 2)):
        for slot in (ports.WHEEL_LOAD, ports.TRAVEL):
            assert left[slot + a] == pytest.approx(right[slot + b], rel=1e-12)


def test_fourth_order_convergence():
    """Errors against a fine run fall sixteenfold with each halving of the step."""
    vehicle = smooth(vehicles.load("van_real"))

    def final(dt):
        car = Car(vehicle, 25.0, STEER=0.01)
        car.run(0.4, dt=dt)
        return car.state[: nonlinear_car.LIFTED_TIME]

    exact = final(0.125e-3)
    errors = [np.abs(final(dt) - exact).max() for dt in (4e-3, 2e-3, 1e-3)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 3.7) and np.all(orders < 4.5)


def energy(car, vehicle):
    """Kinetic and potential energy of the whole car over a flat road (J), stops left out."""
    s, p = car.state, car.parameters.view(parameters.CAR)[0]
    bodies_now = CarBodies(vehicle, s, car.inputs)
    total = bodies_now.kinetic_energy(vehicle.tyre.wheel_inertia)
    total += bodies_now.height_energy(vehicles.GRAVITY)
    for axle in range(2):
        travel = s[nonlinear_car.TRAVEL + 2 * axle : nonlinear_car.TRAVEL + 2 * axle + 2]
        data = p["axle"][axle]
        total += 0.5 * data["spring"] * travel @ travel
        total -= data["preload"] * travel.sum()
        total += 0.5 * data["bar"] * (travel[0] - travel[1]) ** 2
        for wheel in range(2 * axle, 2 * axle + 2):
            hub = bodies_now.hubs[wheel]
            radius = hub.place[2] / np.sqrt(1 - hub.axis[2] ** 2)
            deflection = max(p["unloaded_radius"][wheel] - radius, 0.0)
            total += 0.5 * p["stiffness"][wheel] * deflection**2
    return total


@pytest.mark.parametrize("steer", [0.0, 0.03, 0.15])
def test_a_passive_car_never_creates_energy(steer):
    """Disturbed in heave, roll, pitch and sideslip, or cornering on locked steering."""
    vehicle = vehicles.load("van_real")
    vehicle = replace(vehicle, tyre=replace(vehicle.tyre, rolling_resistance=0.0))
    car = Car(vehicle, 20.0, STEER=steer)
    car.state[nonlinear_car.HEAVE] = 0.03
    car.state[nonlinear_car.ROLL] = 0.05
    car.state[nonlinear_car.PITCH] = 0.02
    car.state[nonlinear_car.VY] = 0.3
    energies = [energy(car, vehicle)]
    for _ in range(40):
        car.run(0.05)
        energies.append(energy(car, vehicle))
    assert np.diff(energies).max() <= 1e-9 * energies[0]
    assert energies[-1] < energies[0]


def test_wheels_lift_and_a_rollover_is_an_end_state():
    """On grippy tyres a tall van tips before it slides; the state then stays as it was."""
    vehicle = vehicles.load("van_real")
    vehicle = replace(vehicle, tyre=replace(vehicle.tyre, friction=1.6, friction_load_slope=0.05))
    car = Car(vehicle, 27.0, STEER=0.12)
    lifted = False
    for _ in range(100):
        car.run(0.05)
        lifted = lifted or car.outputs[ports.TWO_WHEEL_LIFT] == 1.0
    assert lifted and car.outputs[ports.ROLLOVER] == 1.0
    assert car.outputs[ports.WHEEL_LOAD] == 0.0 and car.outputs[ports.WHEEL_HEIGHT] > 0.05
    before = car.state.copy()
    car.run(0.1)
    assert np.array_equal(before, car.state)


def test_a_low_car_slides_instead():
    vehicle = vehicles.load("suv_2020")
    low = replace(
        vehicle,
        geometry=replace(
            vehicle.geometry, roll_centre_height_front=0.02, roll_centre_height_rear=0.05
        ),
    )
    outputs = Car(low, 27.0, STEER=0.12, FRICTION=0.6).run(3.0)
    assert outputs[ports.ROLLOVER] == 0.0
    assert abs(outputs[ports.AY]) < 0.62 * vehicles.GRAVITY


def test_a_car_that_slid_to_a_stop_comes_to_rest():
    car = Car(vehicles.load("van_real"), 8.0, STEER=-0.15)
    car.inputs[ports.BRAKE_FORCE : ports.BRAKE_FORCE + 4] = 4000.0
    outputs = car.run(4.0)
    assert abs(outputs[ports.VX]) < 0.1 and abs(outputs[ports.YAW_RATE]) < 0.02
    assert abs(outputs[ports.ROLL_RATE]) < 0.01


def test_data_that_cannot_be_built_says_why():
    van = vehicles.load("van_real")
    with pytest.raises(CanrollError, match="tyres alone softer in roll"):
        BODY.build(replace(van, tyre=replace(van.tyre, vertical_stiffness=30000.0)), 20.0)
    stiff = replace(van.suspension, spring_rate_front=200000.0)
    with pytest.raises(CanrollError, match="lower it by"):
        BODY.build(replace(van, suspension=stiff), 20.0)


@pytest.mark.parametrize("name", ["van_real", "van_2021"])
def test_gentle_manoeuvres_agree_with_the_linear_plant(name):
    vehicle = vehicles.load(name)
    runs = {
        plant: open_loop.run_passive(
            vehicle, bodies.body(plant), maneuvers.build("roundabout", vehicle)
        )[0]
        for plant in ("roll1", "nonlinear")
    }
    peaks = [np.abs(run[:, ports.ROLL]).max() for run in runs.values()]
    assert peaks[1] == pytest.approx(peaks[0], rel=0.05)
