"""The simulated drive beside a log: what an inertial unit reads of it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from canroll import vehicles
from canroll.extensions.car.identification import replay
from canroll.extensions.car.identification.pieces import SAMPLE, Piece

VAN = vehicles.load("van_real")
ASKEW = (0.02, 0.03, 0.01)


def record(misalignment):
    time = SAMPLE * np.arange(200)
    piece = Piece(0.0, np.sin(4.0 * time), np.full(200, 22.0), (), np.zeros((200, 0)))
    sensors = replace(VAN.sensors, imu_misalignment=misalignment)
    return replay.motion(replace(VAN, sensors=sensors), piece, 0.0)


def test_a_unit_reads_rates_and_force_along_its_own_axes():
    """One of 3 mrad makes 1 mrad/s of roll rate of a yaw rate of 20 °/s: as much as noise does."""
    seen = record(ASKEW)
    # turned by a quarter about an axis, a unit reads along it what it read along another one
    turns = {"x": (np.pi / 2, 0.0, 0.0), "y": (0.0, np.pi / 2, 0.0)}
    straight, about = record((0.0, 0.0, 0.0)), {axis: record(turns[axis]) for axis in turns}
    pitch = about["x"][:, replay.BODY_YAW]  # its z axis is the body's -y
    rates = np.column_stack([straight[:, replay.BODY_ROLL], -pitch, straight[:, replay.BODY_YAW]])
    own = rates @ Rotation.from_euler("xyz", ASKEW).as_matrix()
    assert np.ptp(straight[:, replay.BODY_YAW]) > 0.3
    assert seen[:, replay.BODY_ROLL] == pytest.approx(own[:, 0], abs=1e-12)
    assert seen[:, replay.BODY_YAW] == pytest.approx(own[:, 2], abs=1e-12)
    assert about["y"][:, replay.BODY_ROLL] == pytest.approx(-straight[:, replay.BODY_YAW])
    up = about["x"][:, replay.BODY_AY]
    assert up == pytest.approx(9.81, rel=0.1)
    # the levelled signals are those of a car, not of a unit
    assert np.array_equal(seen[:, replay.YAW :], straight[:, replay.YAW :])
