"""The 14-DOF car on tables of springs, dampers, stops and bars."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from canroll import vehicles
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import curves, nonlinear_car, parameters, ports
from canroll.plant_sim.world import handling, open_loop
from canroll.vehicles.axles import axles
from canroll.vehicles.roll_stiffness import suspension_roll_stiffness
from canroll.vehicles.unladen import unladen

BODY = bodies.body("nonlinear")
BASE = vehicles.load("sedan_320i")
EVEN = {"rebound_bump_ratio": 1.0, "knee_speed": 0.4, "high_speed_ratio": 1.0}


def with_tables(front, rear, base="sedan_320i", **sections):
    table = {"base": base, "title": "tables", "axles": {"front": front, "rear": rear}}
    return vehicles.load({**table, **sections})


def line(x, y, slope, reach):
    return {x: [-reach, 0.0, reach], y: [-slope * reach, 0.0, slope * reach]}


def linear_tables(vehicle):
    """Straight tables with the numbers of a vehicle."""
    stiffness, result = suspension_roll_stiffness(vehicle), []
    for axle in axles(vehicle):
        bar = axle.bar(stiffness) / (2 * axle.half_track) ** 2
        result.append(
            {
                "spring": line("compression [m]", "force [N]", axle.spring, 0.9),
                "damper": line("compression_speed [m/s]", "force [N]", axle.damping, 2.0),
                "bar": {"torsional_stiffness": bar, "lever": 1.0, "ratio": 1.0},
            }
        )
    return result


def drive(vehicle, steer=0.03, road=0.0, seconds=2.0):
    state, numbers = BODY.build(vehicle, 20.0)
    inputs, outputs = ports.initial_inputs(), np.zeros(ports.N_OUTPUTS)
    rows = []
    for k in range(round(seconds * 1e3)):
        inputs[ports.STEER] = steer * np.sin(2 * np.pi * k * 1e-3)
        inputs[ports.ROAD_HEIGHT] = road if 200 < k < 300 else 0.0
        open_loop.advance(BODY.step, state, inputs, numbers, outputs, 1e-3)
        rows.append(outputs.copy())
    return np.array(rows)


def test_straight_tables_are_the_car_of_numbers():
    numbers = replace(BASE, suspension=replace(BASE.suspension, **EVEN))
    tables = with_tables(*linear_tables(BASE))
    assert tables.plant.roll_stiffness == pytest.approx(BASE.plant.roll_stiffness, rel=1e-9)
    assert tables.plant.roll_damping == pytest.approx(BASE.plant.roll_damping, rel=1e-12)
    assert tables.design == tables.plant
    for key in ("spring_rate_front", "spring_rate_rear", "roll_stiffness_front_share"):
        expected = getattr(BASE.suspension, key)
        assert getattr(tables.suspension, key) == pytest.approx(expected, rel=1e-9)
    for vehicle in (lambda car: car, unladen):
        one, other = drive(vehicle(numbers), road=0.02), drive(vehicle(tables), road=0.02)
        assert np.abs(one - other).max() < 1e-6 * np.abs(one).max()
        for slot in (ports.ROLL, ports.HEAVE, ports.TRAVEL):
            assert np.abs(one - other)[:, slot].max() < 1e-8


@pytest.fixture(scope="module")
def curved():
    """Progressive springs, digressive dampers, stops and bars."""
    front = {
        "spring": {
            "compression [mm]": [0, 100, 160, 200, 240],
            "force [N]": [0, 2300, 3800, 5300, 8200],
        },
        "kinematics": {
            "compression [mm]": [-80, 0, 80],
            "spring_ratio": [0.80, 0.85, 0.95],
            "damper_ratio": [0.9, 0.95, 1.0],
        },
        "damper": {
            "compression_speed [m/s]": [-1, -0.2, -0.05, 0, 0.05, 0.2, 1],
            "force [N]": [-2000, -800, -300, 0, 200, 500, 1200],
        },
        "stops": {"compression [mm]": [-90, -70, 30, 60], "force [N]": [-6000, 0, 0, 9000]},
        "bar": {"torsional_stiffness": 800.0, "lever": 0.2, "ratio": 0.6},
    }
    rear = {key: value for key, value in front.items() if key != "kinematics"}
    return with_tables(front, rear | {"bar": front["bar"] | {"torsional_stiffness": 300.0}})


def car_of(vehicle):
    """The record of a vehicle, its numbers by name as kernels have them."""
    car = parameters.build_parameters(vehicle).view(parameters.CAR)[0]
    numbers = [
        SimpleNamespace(**{name: axle[name] for name in axle.dtype.names}) for axle in car["axle"]
    ]
    return SimpleNamespace(axle=numbers, points=car["points"])


def test_the_car_at_rest_stands_still(curved):
    rows = drive(curved, steer=0.0, seconds=0.5)
    assert np.abs(rows[0, ports.TRAVEL : ports.TRAVEL + 4]).max() < 1e-9
    assert abs(rows[0, ports.HEAVE_ACC]) < 1e-4
    assert rows[0, ports.WHEEL_LOAD] == pytest.approx(curved.wheel_loads[0], rel=1e-4)


def test_forces_of_the_kernel_are_those_of_the_tables(curved):
    for axle, record in zip(axles(curved), car_of(curved).axle, strict=True):
        points, table = car_of(curved).points, axle.tables.damper
        ratio = axle.curves.damper_ratio
        for travel in (-0.05, -0.01, 0.0, 0.03):
            spring = curves.spring.py_func(record, points, travel)
            assert spring == pytest.approx(axle.curves.spring(-travel), rel=1e-12)
            for rate in (-1.5, -0.3, -0.02, 0.0, 0.1, 0.7):
                there = ratio(-travel)
                expected = np.interp(-rate * there, table.x, table.y) * there
                if abs(rate * there) <= 1.0:
                    force = curves.damper.py_func(record, points, travel, rate)
                    assert -force == pytest.approx(expected, abs=1e-9)
                assert rate * curves.damper.py_func(record, points, travel, rate) >= 0.0
            stop = np.interp(-travel, axle.tables.stops.x, axle.tables.stops.y)
            assert curves.stop.py_func(record, points, travel) == pytest.approx(stop)


def test_nothing_but_the_dampers_takes_energy_from_a_bounce(curved):
    # the same springs without dampers: the work of a closed way is none
    record, points = car_of(curved).axle[0], car_of(curved).points
    phase = np.linspace(0.0, 2 * np.pi, 20001)
    z, rate = 0.05 * np.sin(phase), 0.05 * np.cos(phase)
    work = [curves.spring.py_func(record, points, -each) for each in z]
    stops = [curves.stop.py_func(record, points, -each) for each in z]
    lost = [-curves.damper.py_func(record, points, -a, -b) for a, b in zip(z, rate, strict=True)]
    assert abs(np.trapezoid(np.add(work, stops), z)) < 1e-6
    assert np.trapezoid(lost, z) > 1.0


def test_the_driven_roll_gradient_is_that_of_the_tables(curved):
    tested = handling.constant_radius(curved, handling.passive(curved, BODY))
    # progressive springs and stops make it stiffer as it leans
    small = [state for state in tested.states if state.lateral_acceleration < 1.2]
    roll = np.degrees(small[0].roll) / small[0].lateral_acceleration * vehicles.GRAVITY
    assert roll == pytest.approx(curved.plant.roll_gradient_deg_per_g, rel=0.02)


def test_a_population_scales_the_tables(curved):
    plant = replace(curved.plant, roll_damping=1.2 * curved.plant.roll_damping)
    suspension = replace(
        curved.suspension, spring_rate_front=0.9 * curved.suspension.spring_rate_front
    )
    record = car_of(replace(curved, plant=plant, suspension=suspension))
    was = car_of(curved)
    for rate in (-0.4, 0.4):
        force, before = (
            curves.damper.py_func(each.axle[0], each.points, 0.0, rate) for each in (record, was)
        )
        assert force == pytest.approx(1.2 * before)
    force, before = (
        curves.spring.py_func(each.axle[0], each.points, 0.02) - each.axle[0].preload
        for each in (record, was)
    )
    assert force == pytest.approx(0.9 * before)
    assert record.axle[1].rows[curves.DAMPER] == 7
    even = replace(curved, suspension=replace(curved.suspension, rebound_bump_ratio=1.0))
    slopes = [
        abs(curves.damper.py_func(car_of(even).axle[0], car_of(even).points, 0.0, rate))
        for rate in (-0.01, 0.01)
    ]
    assert slopes[0] == pytest.approx(slopes[1])


def test_states_are_finite_beyond_the_tables(curved):
    rows = drive(curved, steer=0.0, road=0.15, seconds=0.6)
    assert np.isfinite(rows[:, [ports.ROLL, *range(ports.TRAVEL, ports.TRAVEL + 4)]]).all()
    assert rows[:, ports.TRAVEL].min() < -0.05
    assert nonlinear_car.N_STATES == 30
