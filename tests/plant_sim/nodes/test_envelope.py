"""The actuator node's envelope: what it hears, what it refuses, what it leaves alone."""

import numpy as np
import pytest

from canroll.plant_sim.nodes import codec, codec_tables, e2e, envelope
from canroll.plant_sim.nodes.actuators import ActuatorOptions, build
from canroll.plant_sim.nodes.envelope import NEVER
from canroll.vehicles import load

TABLES = codec_tables.load()
MOST = 2000.0
OUTWARD = envelope.OUTWARD_SHARE * MOST
ARMS = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
MS = 1_000_000
IMU = codec_tables.message_index("Imu")


def fresh(acceleration=None):
    its = envelope.build(ARMS, (MOST, MOST), TABLES, e2e.Supervision())
    if acceleration is not None:
        its["acceleration"], its["slow"], its["heard_ns"] = acceleration, acceleration, 0
    return its


def frame(count, acceleration, yaw_rate=0.0):
    payload = np.zeros(codec.MAX_PAYLOAD, np.uint8)
    values = dict.fromkeys(codec_tables.signal_names("Imu"), 0.0) | {
        "LateralAcceleration": acceleration,
        "YawRate": yaw_rate,
    }
    codec.encode(TABLES, IMU, np.array(list(values.values())), payload)
    e2e.protect(TABLES.protection[IMU], count, payload)
    return payload


def refusals(its, moment, milliseconds, axle=0):
    front, rear = (moment, 0.0) if axle == 0 else (0.0, moment)
    return [envelope.cuts(its, front, rear, k * MS) for k in range(milliseconds)]


def test_it_hears_the_imu_and_no_frame_that_is_damaged_or_repeated():
    its = fresh()
    hear = lambda payload, t: envelope.hear(its, TABLES, e2e.Supervision(), payload, t)  # noqa: E731
    assert its["heard_ns"] == NEVER
    hear(frame(0, 3.0), 10)
    assert its["acceleration"] == pytest.approx(3.0, abs=0.01)
    damaged = frame(1, -5.0)
    damaged[5] ^= 1
    for payload in (damaged, frame(0, -5.0)):
        hear(payload, 20)
        assert its["acceleration"] == pytest.approx(3.0, abs=0.01)
        assert its["heard_ns"] == 10
    hear(frame(1, float("nan")), 30)
    assert its["heard_ns"] == 10
    hear(frame(2, -5.0), 40)
    assert its["acceleration"] == pytest.approx(-5.0, abs=0.01)


@pytest.mark.parametrize("axle", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_push_outward_is_refused_after_its_time_and_until_it_ends(sign, axle):
    its = fresh(sign * 4.0)
    push = sign * (OUTWARD + 1)
    found = refusals(its, push, 400, axle)
    assert found == [False] * (envelope.PATIENCE_MS - 1) + [True] * 201
    assert refusals(its, -push, 100, axle) == [False] * 100
    assert refusals(its, push, 1, axle) == [True]
    assert refusals(its, -push, 200, axle) == [False] * 200
    assert refusals(its, push, 1, axle) == [False]


@pytest.mark.parametrize(
    ("moment", "acceleration"),
    [(OUTWARD, 8.0), (MOST, 2.0), (-MOST, 8.0), (0.0, 8.0)],
)
def test_what_is_not_outward_is_left_alone(moment, acceleration):
    assert not any(refusals(fresh(acceleration), moment, 400))


def test_a_moment_while_the_acceleration_falls_is_left_alone():
    its = fresh(9.0)
    for k in range(400):
        its["acceleration"] = 9.0 - 0.01 * k
        assert not envelope.cuts(its, MOST, MOST, k * MS)


def test_without_an_acceleration_nothing_is_followed_once_there_was_one():
    assert not any(refusals(fresh(), -MOST, 700))
    found = refusals(fresh(1.0), -100.0, 700)
    assert found == [False] * 501 + [True] * 199


def test_one_axle_does_not_make_good_for_the_other():
    its = fresh(4.0)
    found = [envelope.cuts(its, MOST, -MOST, k * MS) for k in range(300)]
    assert found == [False] * (envelope.PATIENCE_MS - 1) + [True] * 101


@pytest.mark.parametrize("yaw_rate", [-0.2, 0.0, 0.2, float("nan")])
@pytest.mark.parametrize("sign", [-1, 1])
def test_an_acceleration_against_the_yaw_rate_tells_no_side(sign, yaw_rate):
    its = fresh()
    envelope.hear(its, TABLES, e2e.Supervision(), frame(0, sign * 4.0, sign * yaw_rate), 0)
    its["slow"] = sign * 4.0
    told = not yaw_rate < 0.0
    assert any(refusals(its, sign * MOST, 400)) == told
    assert envelope.outward(its, sign * MOST, 0) == told
    assert not envelope.outward(its, -sign * MOST, 0)


@pytest.mark.parametrize("kind", ["suspension", "bars", "valves", "dampers"])
def test_commands_become_moments_by_the_arms_of_the_vehicle(kind):
    vehicle = load("van_real")
    node = build(vehicle, kind, options=ActuatorOptions(), enabled=True, timeout_ms=100)
    commands = np.array([100.0, -100.0, 50.0, -60.0])
    tracks = vehicle.geometry.half_track_front, vehicle.geometry.half_track_rear
    expected = {
        "suspension": (200.0 * tracks[0], 110.0 * tracks[1]),
        "bars": (100.0, -100.0),
        "valves": (100.0, -100.0),
        "dampers": (0.0, 0.0),
    }
    found = [envelope.moment_of(node["envelope"], axle, commands) for axle in range(2)]
    assert found == pytest.approx(expected[kind])
    assert node["envelope"]["acted"] == 0.0
