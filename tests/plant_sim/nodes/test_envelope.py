"""The actuator node's envelope: what it hears, what it refuses, what it leaves alone."""

import numpy as np
import pytest

from plant_sim.nodes import codec, e2e, envelope
from plant_sim.nodes.actuators import ActuatorOptions, build
from plant_sim.nodes.envelope import ACCELERATION, ACTED, HEARD_NS, NEVER, SLOW
from vehicles import load

TABLES = codec.load()
MOST = 4000.0
OUTWARD = envelope.OUTWARD_SHARE * MOST
MS = 1_000_000
IMU = codec.message_index("Imu")


def fresh(acceleration=None):
    its = envelope.build((1.0, 1.0, 0.0, 0.0), MOST, TABLES, e2e.Supervision())
    if acceleration is not None:
        its.memory[[ACCELERATION, SLOW, HEARD_NS]] = acceleration, acceleration, 0
    return its


def frame(count, acceleration):
    payload = np.zeros(codec.MAX_PAYLOAD, np.uint8)
    values = dict.fromkeys(codec.signal_names("Imu"), 0.0) | {"LateralAcceleration": acceleration}
    codec.encode(TABLES, IMU, np.array(list(values.values())), payload)
    e2e.protect(TABLES.protection[IMU], TABLES.identity[IMU], TABLES.crc[IMU], count, payload)
    return payload


def refusals(its, moment, milliseconds, start=0):
    return [envelope.cuts(its, moment, (start + k) * MS) for k in range(milliseconds)]


def test_it_hears_the_imu_and_no_frame_that_is_damaged_or_repeated():
    its = fresh()
    hear = lambda payload, t: envelope.hear(its, TABLES, e2e.Supervision(), payload, t)  # noqa: E731
    assert its.memory[HEARD_NS] == NEVER
    hear(frame(0, 3.0), 10)
    assert its.memory[ACCELERATION] == pytest.approx(3.0, abs=0.01)
    damaged = frame(1, -5.0)
    damaged[5] ^= 1
    for payload in (damaged, frame(0, -5.0)):
        hear(payload, 20)
        assert its.memory[ACCELERATION] == pytest.approx(3.0, abs=0.01)
        assert its.memory[HEARD_NS] == 10
    hear(frame(1, float("nan")), 30)
    assert its.memory[HEARD_NS] == 10
    hear(frame(2, -5.0), 40)
    assert its.memory[ACCELERATION] == pytest.approx(-5.0, abs=0.01)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_push_outward_is_refused_after_its_time_and_until_it_ends(sign):
    its = fresh(sign * 4.0)
    push = sign * (OUTWARD + 1)
    found = refusals(its, push, 400)
    assert found == [False] * (envelope.PATIENCE_MS - 1) + [True] * 201
    assert refusals(its, -push, 100) == [False] * 100
    assert refusals(its, push, 1) == [True]
    assert refusals(its, -push, 200) == [False] * 200
    assert refusals(its, push, 1) == [False]


@pytest.mark.parametrize(
    ("moment", "acceleration"),
    [(OUTWARD, 8.0), (MOST, 2.0), (-MOST, 8.0), (0.0, 8.0)],
)
def test_what_is_not_outward_is_left_alone(moment, acceleration):
    assert not any(refusals(fresh(acceleration), moment, 400))


def test_a_moment_while_the_acceleration_falls_is_left_alone():
    its = fresh(9.0)
    for k in range(400):
        its.memory[ACCELERATION] = 9.0 - 0.01 * k
        assert not envelope.cuts(its, MOST, k * MS)


def test_without_an_acceleration_nothing_is_followed_once_there_was_one():
    assert not any(refusals(fresh(), -MOST, 700))
    found = refusals(fresh(1.0), -100.0, 700)
    assert found == [False] * 501 + [True] * 199


@pytest.mark.parametrize("kind", ["suspension", "bars", "valves", "dampers"])
def test_commands_become_a_moment_by_the_arms_of_the_vehicle(kind):
    vehicle = load("van_real")
    node = build(vehicle, kind, options=ActuatorOptions(), enabled=True, timeout_ms=100)
    commands = np.array([100.0, -100.0, 50.0, -50.0])
    tracks = vehicle.geometry.half_track_front, vehicle.geometry.half_track_rear
    expected = {
        "suspension": 200.0 * tracks[0] + 100.0 * tracks[1],
        "bars": 0.0,
        "valves": 0.0,
        "dampers": 0.0,
    }
    assert envelope.moment_of(node.envelope, commands) == pytest.approx(expected[kind])
    if kind in ("bars", "valves"):
        assert envelope.moment_of(node.envelope, np.abs(commands)) == pytest.approx(200.0)
    assert node.envelope.memory[ACTED] == 0.0
