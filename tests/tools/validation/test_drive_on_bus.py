"""The measured drive as frames: decoded again they are the measurement."""

import can
import cantools
import numpy as np
import pytest

from tools.validation import drive_on_bus
from tools.validation.measured_car import EXAMPLE


def decoded(folder):
    database = cantools.database.load_file(folder / "car.dbc")
    with can.BLFReader(str(folder / "drive.blf")) as log:
        rows = [database.decode_message(m.arbitration_id, m.data) for m in log]
    return {
        name: np.array([row[name] for row in rows if name in row])
        for name in ("RollRate", "LateralAcceleration", "Steering")
    }


def test_the_frames_hold_the_drive_without_its_offsets_and_delays(tmp_path):
    known = {"log.roll_rate_delay": 0.05, "log.steering_offset": 0.1}
    drive_on_bus.write(tmp_path / "plain", {})
    drive_on_bus.write(tmp_path / "moved", known)
    plain, moved = decoded(tmp_path / "plain"), decoded(tmp_path / "moved")
    rows = np.genfromtxt(EXAMPLE / "double_lane_change.csv", delimiter=",", names=True)
    for name, column in (("RollRate", "roll_rate_rad_s"), ("Steering", "steering_wheel_rad")):
        # of single samples, and a resolution, whatever lies between two of them
        most = np.degrees(np.abs(rows[column]).max())
        assert np.abs(plain[name]).max() == pytest.approx(most, rel=0.02)
    # a car that leans by φ reads g sin φ more than the levelled acceleration
    assert np.abs(plain["LateralAcceleration"]).max() > np.abs(rows["ay_m_s2"]).max()
    assert moved["RollRate"][:-5] == pytest.approx(plain["RollRate"][5:], abs=0.01)
    assert moved["Steering"] == pytest.approx(plain["Steering"] - np.degrees(0.1), abs=0.11)
