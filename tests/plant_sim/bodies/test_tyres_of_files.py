"""The 14-DOF car on tyres of .tir files."""

from pathlib import Path

import numpy as np
import pytest

from canroll import vehicles
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import nonlinear_car, parameters, ports
from canroll.plant_sim.driving.tyre_limits import beyond
from canroll.plant_sim.world import open_loop
from canroll.vehicles.axles import axles

BODY = bodies.body("nonlinear")
TYRES = Path(__file__).parents[2] / "vehicles" / "tyres"
SPEED = 18.0


@pytest.fixture(scope="module", params=["passenger_52", "passenger_61", "passenger_62"])
def vehicle(request):
    return on(request.param)


def on(name):
    table = {"base": "sedan_320i", "tyre": {"file": str(TYRES / f"{name}.tir")}}
    return vehicles.load({**table, "title": name})


def drive(vehicle, steer, seconds=4.0, speed=SPEED):
    state, numbers = BODY.build(vehicle, speed)
    inputs, outputs = ports.initial_inputs(), np.zeros(ports.N_OUTPUTS)
    inputs[ports.STEER] = steer
    mass = numbers.view(parameters.CAR)[0]["mass"]
    for _ in range(round(seconds * 1e3)):
        inputs[ports.DRIVE_FORCE] = 5 * mass * (speed - state[nonlinear_car.VX])
        open_loop.advance(BODY.step, state, inputs, numbers, outputs, 1e-3)
    return outputs


def test_a_left_turn_needs_forces_to_the_left(vehicle):
    outputs = drive(vehicle, 0.02)
    left = outputs[ports.LATERAL_FORCE : ports.LATERAL_FORCE + 4]
    assert outputs[ports.YAW_RATE] > 0.05 and outputs[ports.AY] > 1.0
    assert (left > 100.0).all()
    assert left.sum() == pytest.approx(vehicle.total_mass * outputs[ports.AY], rel=1e-3)
    # the linear bicycle, which has no aligning moment, turns a little more
    turned = SPEED * 0.02 / (vehicle.geometry.wheelbase + vehicle.understeer * SPEED**2)
    assert 0.85 * turned < outputs[ports.YAW_RATE] < turned


def test_left_and_right_tyres_together_run_straight(vehicle):
    outputs = drive(vehicle, 0.0)
    assert abs(outputs[ports.Y]) < 1e-9 and abs(outputs[ports.YAW]) < 1e-9


def test_the_aligning_moment_turns_the_car_out_of_the_curve():
    car = on("passenger_61")
    without = {
        f"magic_formula.{axle}.{key}": 0.0
        for axle in ("front", "rear")
        for key in (
            *("QDZ1", "QDZ2", "QDZ6", "QDZ7", "QDZ8", "QDZ9", "QDZ10", "QDZ11"),
            *("SSZ1", "SSZ2", "SSZ3", "SSZ4"),
        )
    }
    turning, free = (drive(each, 0.02)[ports.YAW_RATE] for each in (car, car.replace(without)))
    trail = car.magic_formula.front["QDZ1"] * car.magic_formula.front["UNLOADED_RADIUS"]
    front, rear = axles(car)
    # both axles' forces act that much further back
    more = car.total_mass * trail / car.geometry.wheelbase
    more *= 1.0 / front.cornering + 1.0 / rear.cornering
    expected = SPEED * 0.02 / free + more * SPEED**2
    assert turning < 0.98 * free
    assert SPEED * 0.02 / turning == pytest.approx(expected, rel=0.02)


def test_a_run_beyond_the_file_is_named():
    car = on("passenger_61")
    narrow = car.replace({"magic_formula.front.ALPMAX": 0.02, "magic_formula.rear.FZMAX": 3500.0})
    wheels = [f"wheel_load_{a}_{s}" for a in ("front", "rear") for s in ("left", "right")]
    signals = {wheel: np.array([3000.0, 4000.0]) for wheel in wheels}
    signals |= {"vx": np.full(2, 20.0), "vy": np.zeros(2), "yaw_rate": np.zeros(2)}
    signals["steer"] = np.array([0.0, 0.05])
    assert list(beyond(car, signals)) == []
    front, rear = beyond(narrow, signals)
    assert "front: slip angle up to 2.9° > ALPMAX" in front
    assert "rear: load up to 4000 N > FZMAX" in rear


def test_camber_beyond_the_file_is_named():
    camber = {"compression [mm]": [-50, 50], "camber [deg]": [1, -3]}
    table = {"base": "sedan_320i", "title": "leaning", "axles": {"front": {"kinematics": camber}}}
    car = vehicles.load({**table, "tyre": {"file": str(TYRES / "passenger_61.tir")}})
    narrow = car.replace({"magic_formula.front.CAMMAX": 0.06, "magic_formula.front.CAMMIN": -0.06})
    zeros = np.zeros(2)
    names = [f"{a}_{s}" for a in ("front", "rear") for s in ("left", "right")]
    signals = {f"{what}_{name}": zeros for what in ("wheel_load", "travel") for name in names}
    signals |= {"vx": zeros + 20.0, "vy": zeros, "yaw_rate": zeros, "steer": zeros}
    # the body leans to the right by 5°, the tops of both wheels to the left of it by 1°
    signals |= {"roll": np.radians([0.0, 5.0]), "travel_front_left": np.array([0.0, 0.05])}
    assert list(beyond(car, signals)) == list(beyond(narrow, signals | {"roll": zeros})) == []
    (line,) = beyond(narrow, signals)
    assert "front: inclination up to 4.0° > CAMMAX" in line
