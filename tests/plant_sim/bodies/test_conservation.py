"""Momentum, moment of momentum and energy of the 14-DOF car change by what acts on it from outside.

The balances are those of :mod:`support.balance`, from the vehicle's data.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.balance import Balance

from canroll import vehicles
from canroll.plant_sim.bodies import nonlinear_car as car
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.world.open_loop import advance

RELATIVE = 1e-9
G = vehicles.GRAVITY


def close(found, wanted, scale):
    np.testing.assert_allclose(found, wanted, rtol=0, atol=RELATIVE * scale)


def some(low, high):
    return st.floats(low, high, allow_subnormal=False)


def four(low, high):
    return st.tuples(*[some(low, high)] * 4)


STATES = st.fixed_dictionaries(
    {
        car.YAW: some(-3, 3),
        car.VX: some(5, 40),
        car.VY: some(-4, 4),
        car.YAW_RATE: some(-1, 1),
        car.HEAVE: some(-0.05, 0.05),
        car.HEAVE_RATE: some(-0.5, 0.5),
        car.ROLL: some(-0.5, 0.5),
        car.ROLL_RATE: some(-1.5, 1.5),
        car.PITCH: some(-0.1, 0.1),
        car.PITCH_RATE: some(-0.5, 0.5),
        car.TRAVEL: four(-0.12, 0.12),
        car.TRAVEL_RATE: four(-1, 1),
        car.SPIN: four(5, 130),
        car.SLIP: four(-0.2, 0.2),
    }
)
FLAT = {
    ports.STEER: some(-0.4, 0.4),
    ports.DRIVE_FORCE: some(-2000, 4000),
    ports.BRAKE_FORCE: four(0, 5000),
    ports.CORNER_FORCE: four(-3000, 3000),
    ports.BAR_MOMENT_FRONT: some(-2000, 2000),
    ports.BAR_MOMENT_REAR: some(-2000, 2000),
    ports.FRICTION: some(0.2, 1.0),
    ports.WHEEL_FRICTION: four(-0.15, 0.15),
    ports.WIND_FORCE: some(-5000, 5000),
    ports.WIND_ROLL: some(-6000, 6000),
    ports.WIND_YAW: some(-5000, 5000),
}
BUMPY = FLAT | {ports.ROAD_HEIGHT: four(-0.03, 0.03)}
SLOPING = BUMPY | {ports.BANK: some(-0.5, 0.5), ports.GRADE: some(-0.2, 0.2)}
PRESETS = st.sampled_from(vehicles.names()).map(vehicles.load)
TOE = (0.01, 0.4), (-0.02, -0.3)
"""Toe of front and rear wheels at rest (rad), and per compression (rad/m)."""
LEFT = {"steering_wheel [rad]": [-12, -2, 0, 2, 12], "road_wheel [rad]": [-0.6, -0.11, 0, 0.12, 1]}
"""Angle of the left front wheel over that of the steering wheel."""
TURNING = st.just(
    vehicles.load(
        {
            "base": "van_real",
            "title": "toe by tables",
            "axles": {
                axle: more
                | {
                    "kinematics": {
                        "compression [m]": [-0.1, 0.1],
                        "toe [rad]": [rest - 0.1 * slope, rest + 0.1 * slope],
                    }
                }
                for axle, (rest, slope), more in zip(
                    ("front", "rear"), TOE, ({"steering": LEFT}, {}), strict=True
                )
            },
        }
    )
)
"""A car whose wheels turn as they travel, and not alike nor in proportion to the steering."""


def filled(size, values):
    vector = np.zeros(size) if size == car.N_STATES else ports.initial_inputs()
    for slot, value in values.items():
        vector[slot : slot + np.size(value)] = value
    return vector


def turned(vehicle, state, steer):
    """What the wheels turn to the left beside the steering: by its table, and by toe, inwards."""
    if vehicle.axles is None:
        return np.zeros(4)
    (front, front_slope), (rear, rear_slope) = TOE
    toe = np.array([front, front, rear, rear])
    toe -= np.array([front_slope, front_slope, rear_slope, rear_slope]) * state[12:16]
    wheel = vehicle.steering.ratio * np.array([steer, -steer])
    left, right = np.interp(wheel, *LEFT.values()) * [1, -1] - steer
    return toe * [-1, 1, -1, 1] + [left, right, 0, 0]


def balances(inputs, cars):
    """Hypothesis' cars in any state on such a road."""

    def balance(vehicle, state, given):
        state = filled(car.N_STATES, state)
        wheels = turned(vehicle, state, given[ports.STEER])
        return Balance(vehicle, state, filled(ports.N_INPUTS, given), wheels)

    return st.builds(
        balance,
        cars,
        STATES,
        st.fixed_dictionaries(inputs),
    )


def on_every_road(test):
    """Run a property on flat, bumpy and banked, graded roads."""
    cases = pytest.mark.parametrize(
        ("inputs", "cars"),
        [(FLAT, PRESETS), (BUMPY, PRESETS), (SLOPING, PRESETS), (SLOPING, TURNING)],
        ids=["flat", "bumpy", "banked and graded", "toe and steering by tables"],
    )

    @given(st.data())
    def driven(inputs, cars, data):
        test(data.draw(balances(inputs, cars)))

    driven.__name__, driven.__doc__ = test.__name__, test.__doc__
    return cases(driven)


@on_every_road
def test_momentum_changes_by_the_forces_from_outside(balance):
    scale = balance.vehicle.total_mass * G
    close(balance.inertial(lambda b: b.momentum()), balance.force(), scale)


@on_every_road
def test_moment_of_momentum_changes_by_the_moments_from_outside(balance):
    """In roll, pitch and yaw about the road, the spinning wheels included."""
    scale = balance.vehicle.total_mass * G * balance.vehicle.geometry.wheelbase
    close(balance.about_foot(0, 1, 2), balance.moment(), scale)


@on_every_road
def test_kinetic_energy_changes_by_the_power_of_all_forces(balance):
    inertia = balance.vehicle.tyre.wheel_inertia
    change = balance.change(lambda b: b.kinetic_energy(inertia))
    scale = balance.vehicle.total_mass * G * 40.0
    close(change, balance.power(), scale)


@on_every_road
def test_what_an_axle_exerts_on_the_body_is_the_suspension_force(balance):
    """Along the slide and about the roll centre, where the joint is free, nothing else acts."""
    for axle in range(2):
        wheels = (2 * axle, 2 * axle + 1)
        mass, place, *_ = balance.bodies.parts[1 + axle]
        centre, slide, hinge = balance.bodies.hinges[axle]
        needed = balance.inertial(lambda b, axle=axle: b.momentum([1 + axle]))
        needed_moment = balance.about_foot(1 + axle)
        road = [balance.road[wheel] for wheel in wheels]
        given = sum(r["force"] for r in road) + mass * balance.weight
        given_moment = sum(np.cross(r["at"], r["force"]) + r["couple"] for r in road)
        given_moment = given_moment + np.cross(place, mass * balance.weight)
        from_body = needed - given
        about_centre = needed_moment - given_moment - np.cross(centre, from_body)
        left, right = balance.results[[car.R_CORNER + wheel for wheel in wheels]]
        track = balance.parameters.view(car.CAR)[0]["axle"][axle]["half_track"]
        scale = balance.vehicle.total_mass * G
        close(from_body @ slide, -(left + right), scale)
        close(about_centre @ hinge, -track * (left - right), scale)


@on_every_road
def test_outputs_are_the_accelerations_of_the_bodies(balance):
    outputs = np.zeros(ports.N_OUTPUTS)
    # a step of no time
    state = balance.state.copy()
    advance(car.step, state, balance.inputs, balance.parameters, outputs, 0.0)
    sprung = balance.inertial(lambda b: b.parts[0].velocity)
    close(outputs[ports.BODY_ACC : ports.BODY_ACC + 3], sprung, G)
    whole = balance.inertial(lambda b: b.momentum()) / balance.vehicle.total_mass
    close(outputs[ports.AX : ports.AY + 1], whole[:2], G)
    height = balance.change(lambda b: b.parts[0].place[2])
    close(outputs[ports.HEAVE_RATE], height, 1.0)
    reference = balance.bodies.foot + np.cross(
        balance.bodies.turn, [-balance.vehicle.sprung_cg_offset, 0, 0]
    )
    close(outputs[ports.VX : ports.VY + 1], reference[:2], 1.0)
