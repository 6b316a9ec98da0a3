"""One measurement in several formats is one manoeuvre, and its speed is driven."""

import can
import cantools
import numpy as np
import pytest

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.world import open_loop

ROLL1, NONLINEAR = bodies.body("roll1"), bodies.body("nonlinear")
VAN = vehicles.load("van_real")

DBC = """VERSION ""

BU_: Car

BO_ 257 Motion: 8 Car
 SG_ WheelAngle : 0|16@1- (0.1,0) [-1000|1000] "deg" Car
 SG_ Speed : 16|16@1+ (0.01,0) [0|300] "km/h" Car
 SG_ Counter : 32|4@1+ (1,0) [0|15] "" Car
"""
TIMES = np.round(np.arange(0.0, 4.001, 0.02), 3)
ANGLE = np.round(40.0 * np.sin(2.0 * TIMES), 1)
SPEED = np.round(70.0 + 5.0 * TIMES, 2)
IN_FILE = {"column": "WheelAngle", "speed_column": "Speed"}


def run(name, vehicle=VAN, body=NONLINEAR, speed=None, **options):
    maneuver = maneuvers.build(name, vehicle, speed, **options)
    return open_loop.run_passive(vehicle, body, maneuver)


def write_csv(path, names=("time", "steering_wheel_deg", "speed_kmh"), rows=(TIMES, ANGLE, SPEED)):
    lines = [
        ",".join(names),
        *(",".join(f"{v:.6g}" for v in row) for row in zip(*rows, strict=True)),
    ]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def write_log(folder, suffix):
    (folder / "car.dbc").write_text(DBC)
    message = cantools.database.load_file(folder / "car.dbc").get_message_by_name("Motion")
    path = folder / f"drive.{suffix}"
    with can.Logger(path) as log:
        for t, angle, speed in zip(TIMES.tolist(), ANGLE, SPEED, strict=True):
            data = message.encode({"WheelAngle": angle, "Speed": speed, "Counter": 0})
            log(can.Message(1.6e9 + t, 257, is_extended_id=False, channel=0, data=data))
    return {"file": str(path), "dbc": str(folder / "car.dbc")}


def write_mf4(folder):
    asammdf = pytest.importorskip("asammdf")
    signals = [
        asammdf.Signal(ANGLE, TIMES, name="WheelAngle", unit="°"),
        asammdf.Signal(SPEED / 3.6, TIMES, name="Speed", unit="m/s"),
    ]
    with asammdf.MDF(version="4.10") as file:
        for signal in signals:
            file.append(signal)
        file.save(folder / "drive.mf4")
    return {"file": str(folder / "drive.mf4")}


@pytest.mark.parametrize("form", ["mf4", "blf", "asc", "own names"])
def test_the_same_numbers_in_another_format_are_the_same_drive(tmp_path, form):
    expected = maneuvers.build("from_file", VAN, file=write_csv(tmp_path / "drive.csv"))
    if form == "own names":
        names, rows = ("LWI", "time", "v"), (np.radians(ANGLE), TIMES, SPEED / 1.609344)
        own = {"column": "LWI", "unit": "rad", "speed_column": "v", "speed_unit": "mph"}
        given = {"file": write_csv(tmp_path / "own.csv", names, rows), **own}
    else:
        given = write_mf4(tmp_path) if form == "mf4" else write_log(tmp_path, form)
        given |= IN_FILE
    driven = maneuvers.build("from_file", VAN, **given)
    assert driven.speed == pytest.approx(70.0 / 3.6, rel=1e-5)
    assert driven.duration_ns == expected.duration_ns == 4_000_000_000
    assert driven.drive.table == pytest.approx(expected.drive.table, abs=1e-6)
    assert driven.drive.speed == pytest.approx(expected.drive.speed, rel=1e-5)
    outputs, _ = open_loop.run_passive(VAN, NONLINEAR, driven)
    others, _ = open_loop.run_passive(VAN, NONLINEAR, expected)
    for signal in (ports.ROLL, ports.YAW_RATE):
        most = np.abs(others[:, signal]).max()
        assert outputs[:, signal] == pytest.approx(others[:, signal], abs=1e-3 * most)


@pytest.mark.parametrize(
    "speed",
    [
        lambda t: 80.0 - 9.0 * t,
        lambda t: 40.0 + 10.0 * t,
        lambda t: np.clip(100.0 - 14.4 * (t - 2.0), 60.0, 100.0),
        lambda t: np.round(np.clip(50.0 + 8.0 * (t - 1.0), 50.0, 80.0)),
    ],
)
def test_the_speed_of_a_file_is_driven_to_within_1_3_km_h(tmp_path, speed):
    """At up to 4 m/s², round corners and in whole km/h, while the car also steers."""
    times = np.arange(0.0, 6.001, 0.05)
    rows = times, 20.0 * np.sin(2.0 * times), speed(times)
    file = write_csv(tmp_path / "drive.csv", rows=rows)
    outputs, _ = run("from_file", file=file)
    after = 1e-3 * np.arange(1, len(outputs) + 1)
    driven = 3.6 * outputs[:, ports.VX]
    assert driven == pytest.approx(np.interp(after, times, rows[2]), abs=1.3)


def test_the_entry_speed_is_the_first_of_the_file(tmp_path):
    file = write_csv(tmp_path / "drive.csv")
    assert maneuvers.build("from_file", VAN, file=file).speed == pytest.approx(70.0 / 3.6)
    # a saved run states it as its speed
    assert maneuvers.build("from_file", VAN, 70.0 / 3.6, file=file).speed == pytest.approx(70 / 3.6)
    with pytest.raises(
        CanrollError, match=r"^speed 60 km/h: .* 70 km/h at its start: omit --speed$"
    ):
        maneuvers.build("from_file", VAN, 60.0 / 3.6, file=file)
    constant = {"file": file, "speed_column": "none"}
    driven = maneuvers.build("from_file", VAN, 60.0 / 3.6, **constant)
    assert driven.drive.speed.tolist() == [driven.speed] == [60.0 / 3.6]
    assert maneuvers.build("from_file", VAN, **constant).speed == pytest.approx(80.0 / 3.6)


def test_signals_of_other_times_are_driven_while_both_are_there(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    file = tmp_path / "rates.mf4"
    slow = np.array([101.0, 102.5, 103.0])
    with asammdf.MDF(version="4.10") as measured:
        measured.append(asammdf.Signal(ANGLE, 100.0 + TIMES, name="WheelAngle", unit="deg"))
        measured.append(asammdf.Signal(np.array([60.0, 75.0, 80.0]), slow, "km/h", "Speed"))
        measured.save(file)
    driven = maneuvers.build("from_file", VAN, file=str(file), **IN_FILE)
    assert driven.duration_ns == 2_000_000_000
    at = 1.0 + 1e-3 * np.arange(2001)
    angle = np.radians(np.interp(at, TIMES, ANGLE)) / VAN.steering.ratio
    assert driven.drive.table == pytest.approx(angle, abs=1e-9)
    assert 3.6 * driven.drive.speed == pytest.approx(60.0 + 10.0 * (at - 1.0))


def test_a_replay_drives_the_speed_again_and_a_straightened_run_keeps_the_last(tmp_path):
    maneuver = maneuvers.build("from_file", VAN, file=write_csv(tmp_path / "drive.csv"))
    outputs, steer = open_loop.run_passive(VAN, NONLINEAR, maneuver)
    again, _ = open_loop.run_passive(VAN, NONLINEAR, maneuvers.replay(maneuver, steer))
    np.testing.assert_allclose(again[:, ports.VX], outputs[:, ports.VX], rtol=0, atol=1e-9)
    until = 2000
    straight, _ = open_loop.run_passive(
        VAN,
        NONLINEAR,
        maneuvers.straightened(maneuver, steer[:until], outputs[:until, ports.VX], 6.0),
    )
    both = straight[:until, ports.VX], outputs[:until, ports.VX]
    np.testing.assert_allclose(*both, rtol=0, atol=1e-9)
    # 80 km/h then, and a quarter of a second on
    assert 3.6 * straight[-1, ports.VX] == pytest.approx(81.25, abs=0.3)


@pytest.mark.parametrize("body", ["roll1", "linear_car", "linear_car_hydraulic"])
def test_a_plant_that_keeps_its_speed_refuses_one_over_time(tmp_path, body):
    file = write_csv(tmp_path / "drive.csv")
    with pytest.raises(CanrollError, match=f"{body}, which keeps its entry speed: choose --plant"):
        run("from_file", body=bodies.body(body), file=file)
    outputs, _ = run("from_file", body=bodies.body(body), file=file, speed_column="none")
    assert len(outputs) == 4000


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"file": "log.csv", "column": "v"},
            "v without a unit: it needs --set unit=deg, rad, m/s2",
        ),
        (
            {"file": "log.csv", "column": "v", "unit": "furlong"},
            "v in 'furlong': it needs --set un",
        ),
        ({"file": "log.csv", "column": "v", "unit": "km/h"}, "v in 'km/h': it needs --set unit="),
        ({"file": "log.csv", "unit": "deg"}, "--set unit=deg needs --set column=NAME"),
        ({"file": "log.csv", "speed_unit": "m/s"}, "speed_unit=m/s needs --set speed_column=NAME"),
        ({"file": "log.csv", "speed_column": "u"}, "time and u once"),
        (
            {"file": "log.csv", "speed_column": "v"},
            "v without a unit: it needs --set speed_unit=km",
        ),
        (
            {"file": "log.csv", "speed_column": "v", "speed_unit": "km/h"},
            "speed 4.988 km/h at 0.834 s: the speed of",
        ),
        (
            {"file": "log.csv", "speed_column": "v", "speed_unit": "deg"},
            "v in 'deg': it needs --set",
        ),
        ({"file": "log.csv", "dbc": "car.dbc"}, "--set column=NAME says which signal of it is"),
        ({"file": "log.txt", "dbc": "car.dbc", "column": "v"}, "is for a bus log"),
        ({"file": "drive.blf", "column": "WheelAngle"}, "a bus log needs its network description"),
        ({"file": "drive.blf", "column": "Counter", "dbc": "car.dbc"}, "Counter without a unit"),
        ({"file": "drive.blf", "column": "Speed", "dbc": "car.dbc"}, "Speed in 'km/h': it needs"),
        ({"file": "drive.blf", "column": "Spee", "dbc": "car.dbc"}, "did you mean 'Speed'"),
        ({"file": "long.csv"}, "1e+06 s, at most 36000: is its time in s?"),
    ],
)
def test_what_cannot_be_driven_is_refused_in_one_line(tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    write_log(tmp_path, "blf")
    for name in ("log.csv", "log.txt"):
        (tmp_path / name).write_text("time,steering_wheel_deg,v\n0,0,20\n1,2,2\n2,2,20\n")
    (tmp_path / "long.csv").write_text("time,steering_wheel_deg\n0,0\n1000000,2\n")
    with pytest.raises(CanrollError) as refused:
        maneuvers.build("from_file", VAN, **options)
    assert message in str(refused.value) and "\n" not in str(refused.value)


def test_what_is_left_out_of_a_log_is_a_remark(tmp_path):
    given = write_log(tmp_path, "blf")
    (tmp_path / "car.dbc").write_text(f'{DBC}\nVAL_ 257 Speed 7200 "Not available" ;\n')
    (remark,) = maneuvers.build("from_file", VAN, **given, **IN_FILE).remarks
    assert "signal Speed: 1 of 201 frames have no number of it: left out" in remark


def test_signal_files(tmp_path):
    file = tmp_path / "ay.csv"
    file.write_text("time,lateral_acceleration\n0,0\n1,2\n3,2\n")
    outputs, _ = run("from_file", body=ROLL1, file=str(file))
    assert outputs[-1, ports.AY] == pytest.approx(2.0) and len(outputs) == 3000
    with pytest.raises(CanrollError, match="an input of the plant roll1 only"):
        run("from_file", body=NONLINEAR, file=str(file))
    file.write_text("time,steering_wheel_deg\n0,0\n1,33\n4,33\n")
    _, steer = run("from_file", file=str(file))
    assert steer[-1] * VAN.steering.ratio == pytest.approx(np.radians(33.0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "header"),
        ("time,speed\n0,1\n", "header"),
        ("time,steering_wheel_deg\n0,5,0\n", "line 2: 3 values in 2 columns"),
        ("PK\x03\x04", "an Excel workbook, or another zip archive: export the signals as CSV"),
        ("time,speed\n0,1\n", r"unit=UNIT \(deg, rad, m/s2\); it has time, speed"),
        ("time,lateral_acceleration\n0,1\n", "two rows"),
        ("time,lateral_acceleration\n0,1\n0,2\n", "line 3: time must increase"),
        ("time,lateral_acceleration\n0,1\n1,x\n", "line 3: expected two numbers"),
        ("time,lateral_acceleration\n0,1\n1,nan\n", "line 3: not a finite number"),
    ],
)
def test_signal_files_that_are_wrong_say_where(tmp_path, text, message):
    file = tmp_path / "bad.csv"
    file.write_text(text)
    with pytest.raises(CanrollError, match=message):
        maneuvers.build("from_file", VAN, file=str(file))


def test_signal_file_is_needed_and_must_exist(tmp_path):
    with pytest.raises(CanrollError, match=r"needs --set file=FILE\.csv .* time and"):
        maneuvers.build("from_file", VAN)
    with pytest.raises(CanrollError, match="cannot read signal file"):
        maneuvers.build("from_file", VAN, file=str(tmp_path / "none.csv"))


@pytest.mark.parametrize(
    ("text", "options", "expected"),
    [
        ("time,steering_wheel_deg\n0,0\n1,180\n", {}, np.pi),
        ("time;steering_wheel_deg\n0;0\n1;180,0\n", {}, np.pi),
        ("time,v,LWI\n0,9,0\n1,9,2\n", {"column": "LWI", "unit": "rad"}, 2.0),
        ("LWI,time\n0,5\n90,6\n", {"column": "LWI", "unit": "deg"}, np.pi / 2),
    ],
)
def test_a_column_of_a_file_is_the_steering(tmp_path, text, options, expected):
    file = tmp_path / "log.csv"
    file.write_text(text)
    driven = maneuvers.build("from_file", VAN, file=str(file), **options)
    assert driven.drive.table[-1] * VAN.steering.ratio == pytest.approx(expected)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("time,LWI\n0,0\n1,2\n", {}, "--set column=NAME"),
        ("time,LWI\n0,0\n1,2\n", {"column": "LWI"}, "needs --set unit=deg, rad, m/s2"),
        ("time,LWI\n0,0\n1,2\n", {"column": "LWS", "unit": "deg"}, "time and LWS once"),
        ("time,LWI\n0,0\n1\n", {"column": "LWI", "unit": "deg"}, "line 3: expected two numbers"),
    ],
)
def test_a_file_without_its_column_is_refused(tmp_path, text, options, message):
    file = tmp_path / "log.csv"
    file.write_text(text)
    with pytest.raises(CanrollError) as refused:
        maneuvers.build("from_file", VAN, file=str(file), **options)
    assert message in str(refused.value)
