"""A steering angle to the left, followed through every part: docs/vehicle.md is what it checks."""

import numpy as np
import pytest

import canroll
from canroll import dbc, vehicles
from canroll.plant_sim.can_bus import load_profile
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.world.world import World

SETTLED_S = 3.0


def left_turn(body):
    """Return signals and decoded last sensor frames of a steering angle held to the left."""
    vehicle = vehicles.load("van_real")
    steps = maneuvers.build("constant_radius", vehicle, 15.0)
    steer = np.zeros(int(SETTLED_S * 1000) + 1)
    steer[500:] = 0.03
    world = World(
        vehicle=vehicle,
        body=body,
        actuator="suspension",
        maneuver=maneuvers.replay(steps, steer),
        profile=load_profile("500k"),
    )
    received = world.advance(round(SETTLED_S * 1e9))
    database = dbc.load()
    last = {}
    for frame in received:
        message = database.get_message_by_frame_id(int(frame["ident"]))
        last[message.name] = message.decode(bytes(frame["payload"]), decode_choices=False)
    return world.signals, last


@pytest.mark.parametrize("body", ["roll1", "nonlinear"])
def test_a_left_turn_of_the_passive_car(body):
    signals, frames = left_turn(body)
    now = {name: values[-1] for name, values in signals.items()}
    assert now["steer"] > 0
    assert now["yaw_rate"] > 0
    assert now["y"] > 0
    assert now["ay"] > 0
    assert now["roll"] > 0
    for axle in ("front", "rear"):
        assert now[f"wheel_load_{axle}_right"] > now[f"wheel_load_{axle}_left"]
        assert now[f"travel_{axle}_left"] > 0 > now[f"travel_{axle}_right"]
    assert frames["VehicleMotion"]["SteeringWheelAngle"] > 0
    assert frames["Imu"]["YawRate"] > 0
    assert frames["Imu"]["LateralAcceleration"] > now["ay"] > 0
    assert frames["RollReference"]["RollAngle"] > 0
    assert frames["SuspensionTravel"]["TravelFrontLeft"] > 0
    assert frames["SuspensionTravel"]["TravelFrontRight"] < 0


def test_the_controller_pushes_the_leaning_side_up():
    result = canroll.run(
        "roundabout", vehicle="van_real", law="lqg_delay", actuator="suspension", duration=4.0
    )
    signals, ticks = result.controlled.signals, result.controlled.ticks
    lean = np.sign(result.passive.signals["roll"][-1])
    assert abs(result.passive.signals["roll"][-1]) > np.radians(0.5)
    assert np.sign(result.passive.signals["steer"][-1]) == lean
    assert np.sign(ticks["moment"][-1]) == -lean
    assert np.sign(signals["moment_front"][-1]) == -lean
    assert np.sign(signals["corner_force_front_left"][-1]) == -lean
    assert np.sign(signals["corner_force_front_right"][-1]) == lean
    assert np.sign(ticks["roll"][-1]) == np.sign(signals["roll"][-1])
    assert abs(signals["roll"][-1]) < abs(result.passive.signals["roll"][-1])
