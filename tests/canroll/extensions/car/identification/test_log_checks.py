"""Slips of a log: each is named with its remedy, and a log without any passes."""

from functools import cache

import numpy as np
import pytest
from support import fit_truth

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.extensions.car.identification.drive_log import read
from canroll.extensions.car.identification.log_checks import check
from canroll.extensions.car.identification.output_error import Model
from canroll.extensions.car.identification.pieces import EVERYTHING, pieces
from canroll.extensions.car.identification.unknowns import unknowns

RATIO = 16.5


CARS = 3, 7, 9
"""Seeds of a gentle drive, a usual one, and a car 2.6 times as stiff in roll as the start."""


@cache
def case(seed=CARS[0]):
    return fit_truth.truth(seed, duration=5.0)


def checked(tmp_path, car=CARS[0], missing=(), **factors):
    """Check the log with its columns times ``factors``, without those ``missing``."""
    truth = case(car)
    columns = {
        name: column * factors.get(name, 1.0)
        for name, column in truth.columns.items()
        if name not in missing
    }
    path = tmp_path / "drive.csv"
    fit_truth.Truth(truth.start, {}, columns).write(path)
    log = read(str(path), {})
    parts, _ = pieces(log, EVERYTHING)
    sought = unknowns(truth.start, parts[0].names)
    check(log, Model(truth.start, parts, "body", EVERYTHING, sought))


@pytest.mark.parametrize("car", CARS)
def test_a_log_without_slips_passes(tmp_path, car):
    checked(tmp_path, car)


@pytest.mark.parametrize("car", CARS)
@pytest.mark.parametrize(
    ("column", "factor", "message"),
    [
        ("roll_rate", -1.0, "roll rate: its sign is reversed .* --signal roll_rate=-roll_rate"),
        ("roll_rate", 57.3, "roll rate: 57 times too large: give --signal roll_rate=roll_rate:deg"),
        ("roll", -1.0, "roll: its sign is reversed"),
        ("roll", 57.3, "roll: 57 times too large"),
        ("yaw_rate", -1.0, "yaw rate: its sign is reversed: give --signal yaw_rate=-yaw_rate"),
        ("yaw_rate", 57.3, "yaw rate: 57 times too large: give --signal yaw_rate=yaw_rate:deg/s"),
        ("lateral_acceleration", -1.0, "lateral acceleration: its sign is reversed"),
        ("lateral_acceleration", 1 / 9.81, "lateral acceleration: 9.8 times too small"),
        ("speed_m_s", 3.6, "speed: 3.6 times too large: give --signal speed=speed_m_s:km/h"),
        ("steering_wheel_rad", -1.0, "steering-wheel angle: its sign is reversed"),
        ("steering_wheel_rad", 57.3, "steering-wheel angle: 57 times too large"),
        ("steering_wheel_rad", 1 / RATIO, "the angle at the road wheels"),
    ],
)
def test_a_slip_is_named_with_its_remedy(tmp_path, car, column, factor, message):
    with pytest.raises(CanrollError, match=message):
        checked(tmp_path, car, **{column: factor})


MISSING = [
    ("roll_rate", "roll"),
    ("lateral_acceleration",),
    ("yaw_rate",),
    ("yaw_rate", "lateral_acceleration"),
    ("lateral_acceleration", "roll_rate", "roll"),
    ("yaw_rate", "roll_rate", "roll"),
]


@pytest.mark.parametrize("car", CARS)
@pytest.mark.parametrize("missing", MISSING)
def test_what_a_log_has_is_checked(tmp_path, car, missing):
    checked(tmp_path, car, missing)


@pytest.mark.parametrize("missing", [(), *MISSING])
def test_without_excitation_no_signals_are_enough(tmp_path, missing):
    still = dict.fromkeys(case().columns, 0.02) | {"time": 1.0, "speed_m_s": 1.0}
    with pytest.raises(CanrollError, match="no excitation: lateral acceleration of"):
        checked(tmp_path, missing=missing, **still)


@pytest.mark.parametrize(
    ("missing", "column", "factor", "messages"),
    [
        (MISSING[0], "yaw_rate", -1.0, ["yaw rate: its sign is reversed"]),
        (MISSING[0], "lateral_acceleration", 1 / 9.81, ["lateral acceleration: 9.8 times too"]),
        # one relation alone cannot say which of its two signals it is
        (MISSING[1], "yaw_rate", -1.0, ["signal yaw_rate=-yaw", "signal steering=-steering"]),
        (
            MISSING[1],
            "yaw_rate",
            57.3,
            ["yaw rate: 57 times too large", "steering-wheel angle: 57"],
        ),
        (MISSING[2], "lateral_acceleration", 1 / 9.81, ["lateral acceleration: 9.8 times too"]),
        (MISSING[3], "roll_rate", -1.0, ["roll rate: its sign is reversed"]),
        (MISSING[4], "steering_wheel_rad", -1.0, ["signal steering=-steering"]),
        (MISSING[5], "lateral_acceleration", -1.0, ["lateral_acceleration=-lateral"]),
    ],
)
def test_a_slip_of_what_a_log_has_is_named(tmp_path, missing, column, factor, messages):
    with pytest.raises(CanrollError) as caught:
        checked(tmp_path, CARS[1], missing, **{column: factor})
    assert all(text in str(caught.value) for text in messages), caught.value


def test_a_log_with_nothing_to_compare_is_refused(tmp_path):
    with pytest.raises(CanrollError, match="no yaw rate, no lateral acceleration, no roll rate"):
        checked(tmp_path, missing=("yaw_rate", "lateral_acceleration", "roll_rate", "roll"))


def test_signals_of_two_drives_are_refused(tmp_path):
    noise = np.random.default_rng(1).standard_normal(case().columns["time"].size)
    with pytest.raises(CanrollError, match="not of one drive"):
        checked(tmp_path, lateral_acceleration=noise)


def test_a_log_that_steers_beyond_the_table_of_the_steering(tmp_path):
    truth = case(CARS[1])
    angle = np.degrees(np.abs(truth.columns["steering_wheel_rad"]).max())
    path = tmp_path / "drive.csv"
    fit_truth.Truth(truth.start, {}, truth.columns).write(path)
    log = read(str(path), {})
    parts, _ = pieces(log, EVERYTHING)
    for reach, wide in ((0.5, False), (2.0, True)):
        wheel = [-reach * angle, reach * angle]
        table = {"steering_wheel [deg]": wheel, "road_wheel [deg]": [w / RATIO for w in wheel]}
        document = truth.start.document
        del document["steering"]["ratio"]
        document["steering"]["angle_limit"] = 0.1 * reach * angle / 57.3 / RATIO
        document["sources"]["axles"] = "a rig"
        start = vehicles.from_table(document | {"axles": {"front": {"steering": table}}}, name="c")
        model = Model(start, parts, "body", EVERYTHING, unknowns(start, parts[0].names))
        if wide:
            check(log, model)
        else:
            with pytest.raises(CanrollError, match=r"but axles.front.steering of c has") as caught:
                check(log, model)
            assert "\n" not in str(caught.value)
