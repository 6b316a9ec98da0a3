"""The closed loop on a car whose signals are in many frames, some of which are not there."""

import math

import cantools
import numpy as np
import pytest
from support.bus_frames import decoded

from canroll.errors import CanrollError
from canroll.runs import experiment
from canroll.setup.bus_frames import check_frames

DBC = """\
VERSION ""
BU_: Car
BO_ 36 YAW: 8 Car
 SG_ YAW_RATE : 1|10@0+ (0.25,-125) [0|0] "deg/s" Car
 SG_ YAW_OK : 7|1@0+ (1,0) [0|1] "" Car
BO_ 42 ACCEL: 8 Car
 SG_ ACCEL_Y : 11|12@0- (0.01,0) [0|0] "m/s2" Car
 SG_ ROLL_RATE : 31|16@0- (0.01,0) [0|0] "deg/s" Car
BO_ 44 WHEELS: 8 Car
 SG_ FL : 0|16@1+ (0.1,0) [0|0] "rpm" Car
 SG_ FR : 16|16@1+ (0.1,0) [0|0] "rpm" Car
BO_ 2147483685 STEER: 8 Car
 SG_ ANGLE : 0|16@1- (0.1,0) [0|0] "deg" Car
BO_ 80 MOMENTS: 8 Car
 SG_ FRONT : 0|16@1- (1,0) [0|0] "Nm" Car
BO_ 79 MOMENTS_REAR: 8 Car
 SG_ REAR : 0|16@1- (1,0) [0|0] "Nm" Car
 SG_ ENABLED : 16|1@1+ (1,0) [0|1] "" Car
BO_ 81 BARS: 8 Car
 SG_ FRONT : 0|16@1- (1,0) [0|0] "Nm" Car
 SG_ REAR : 16|16@1- (1,0) [0|0] "Nm" Car
"""
MAP = """\
schema = 1

[[receive.imu]]
message = "YAW"
period_ms = 20
signals.YAW_RATE = { field = "yaw_rate", valid = "YAW_OK" }

[[receive.imu]]
message = "ACCEL"
period_ms = 10
signals.ACCEL_Y = "lateral_acceleration"
signals.ROLL_RATE = "roll_rate"

[[receive.vehicle_motion]]
message = "WHEELS"
period_ms = 20
signals.FL = { field = "speed", radius = 0.3 }
signals.FR = { field = "speed", radius = 0.3 }

[[receive.vehicle_motion]]
message = "STEER"
period_ms = 14
signals.ANGLE = "steering"

[[receive.actuator_state]]
message = "MOMENTS"
period_ms = 10
signals.FRONT = "delivered[0]"

[[receive.actuator_state]]
message = "MOMENTS_REAR"
period_ms = 10
signals.REAR = "delivered[1]"
signals.ENABLED = "enabled"

[transmit.anti_roll_bar]
message = "BARS"
signals.FRONT = "bar[0]"
signals.REAR = "bar[1]"
"""
PERIODS = {"YAW": 20, "ACCEL": 10, "WHEELS": 20, "STEER": 14, "MOMENTS": 10, "MOMENTS_REAR": 10}
SHORT = {"actuator": "bars", "law": "lqr", "duration": 3.0}
MOMENTS = MAP[MAP.index("[[receive.actuator_state]]") : MAP.index("[transmit")]
STEERING = MAP[MAP.rindex("[[receive.vehicle_motion]]") : MAP.index(MOMENTS)]


def files(folder, table=MAP):
    (folder / "car.dbc").write_text(DBC, encoding="utf-8")
    (folder / "car.toml").write_text(table, encoding="utf-8")
    return {"dbc": str(folder / "car.dbc"), "map": str(folder / "car.toml")}


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    return experiment.run("double_lane_change", **SHORT, **files(tmp_path_factory.mktemp("car")))


def read(result, folder):
    """The log of a run as python-can and cantools read it."""
    database = cantools.database.load_string(DBC, "dbc")
    return decoded(folder / "own.blf", result.controlled.frames, database)


@pytest.mark.slow
def test_every_frame_has_its_own_cycle_time_and_the_true_values(driven, tmp_path):
    found = read(driven, tmp_path)
    assert found.keys() == {*PERIODS, "BARS"}
    signals = driven.controlled.signals
    for name, period in PERIODS.items():
        times = [t for t, _, _ in found[name]]
        assert np.mean(np.diff(times)) == pytest.approx(1e-3 * period, rel=1e-3), name
    times = np.array([t for t, _, _ in found["WHEELS"]])
    for wheel in ("FL", "FR"):
        speed = [2 * math.pi / 60 * 0.3 * values[wheel] for _, values, _ in found["WHEELS"]]
        true = np.interp(times, signals["time"], signals["vx"])
        np.testing.assert_allclose(speed, true, atol=0.3)
    assert {values["YAW_OK"] for _, values, _ in found["YAW"]} == {1}
    assert {values["ENABLED"] for _, values, _ in found["MOMENTS_REAR"]} == {1}
    for name, signal in (("MOMENTS", "FRONT"), ("MOMENTS_REAR", "REAR")):
        assert max(abs(values[signal]) for _, values, _ in found[name]) > 500, name


def test_the_figures_are_those_of_the_built_in_bus(driven):
    expected = experiment.run("double_lane_change", **SHORT)
    one, other = expected.controlled_metrics, driven.controlled_metrics
    assert other.roll_max_deg == pytest.approx(one.roll_max_deg, rel=0.05)
    assert other.moment_rms_nm == pytest.approx(one.moment_rms_nm, rel=0.05)
    assert np.isin(driven.controlled.ticks["mode"][60:], [1]).all()
    assert driven.controlled.ticks["fault_codes"][60:].max() == 0


def test_a_sensor_without_a_value_says_so_by_the_signal_of_its_validity(tmp_path):
    faults = ["Imu.YawRate=invalid@1"]
    result = experiment.run("double_lane_change", **SHORT, **files(tmp_path), faults=faults)
    said = {
        (t > 1.03, values["YAW_OK"]) for t, values, _ in read(result, tmp_path)["YAW"] if t > 0.1
    }
    assert (False, 1) in said and (True, 0) in said and (True, 1) not in said


def test_a_sensor_that_is_down_sends_none_of_its_frames(tmp_path):
    faults = ["VehicleMotion=dropout@1"]
    result = experiment.run("double_lane_change", **SHORT, **files(tmp_path), faults=faults)
    found = read(result, tmp_path)
    assert {name for name in PERIODS if found[name][-1][0] < 1.1} == {"WHEELS", "STEER"}


def test_without_speed_the_law_commands_nothing_and_says_so(tmp_path):
    first = MAP.index("[[receive.vehicle_motion]]")
    table = MAP[:first] + MAP[MAP.index(STEERING) :]
    with pytest.raises(CanrollError, match="speed: the law commands nothing without it"):
        experiment.run("double_lane_change", **SHORT, **files(tmp_path, table))


@pytest.mark.slow
def test_the_steering_angle_is_needed_by_what_reads_it_alone(tmp_path):
    places = files(tmp_path, MAP.replace(STEERING, ""))
    result = experiment.run("double_lane_change", **SHORT, **places)
    assert np.isin(result.controlled.ticks["mode"][60:], [1]).all()
    with pytest.raises(CanrollError, match="mapped to steering, which this law"):
        experiment.run("double_lane_change", **SHORT, **places, observer="steering")


@pytest.mark.slow
@pytest.mark.parametrize("gone", [MOMENTS, 'signals.FRONT = "delivered[0]"'])
def test_without_delivered_moments_the_commanded_ones_count(tmp_path, gone):
    assert gone in MAP
    new = "" if gone is MOMENTS else 'signals.FRONT = { field = "command_held", unit = "" }'
    places = files(tmp_path, MAP.replace(gone, new))
    result = experiment.run("double_lane_change", **SHORT, **places)
    assert np.isin(result.controlled.ticks["mode"][60:], [1]).all()
    assert result.controlled_metrics.roll_max_deg < 0.8 * result.passive_metrics.roll_max_deg
    said = check_frames(result.settings.profile, result.record)
    assert sum("what is commanded counts as delivered" in line for line in said) == 1
