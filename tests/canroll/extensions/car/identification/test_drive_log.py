"""Logs: names, units and signs of their signals, in every format."""

import can
import cantools
import numpy as np
import pytest
from scipy.io import savemat

from canroll import dbc
from canroll.errors import CanrollError
from canroll.extensions.car.identification.drive_log import choice_of, read

HEADER = "time,steering_wheel_deg,speed_kmh,yaw_rate_deg_s,ay_g,roll_rate"
ROWS = ["0,10,72,5,0.1,0.01", "0.01,20,72,6,0.2,0.02", "0.02,30,72,,0.3,0.03"]


@pytest.fixture
def csv(tmp_path):
    path = tmp_path / "drive.csv"
    path.write_text("\n".join([HEADER, *ROWS]))
    return str(path)


def test_units_of_columns_are_those_of_their_names(csv):
    log = read(csv, {})
    first = {name: channel.values[0] for name, channel in log.channels.items()}
    assert first == pytest.approx(
        {
            "steering": np.radians(10),
            "speed": 20.0,
            "yaw_rate": np.radians(5),
            "lateral_acceleration": 0.980665,
            "roll_rate": 0.01,
        }
    )
    assert log.remarks == ("yaw_rate_deg_s: 1 rows without a number: left out",)


def test_moments_have_their_names_and_units(tmp_path):
    names = "commanded_front_knm,commanded_rear,delivered_moment_front_n_m,moment_rear"
    path = tmp_path / "drive.csv"
    path.write_text(f"{HEADER},{names}\n{ROWS[0]},1.5,2,3,4\n{ROWS[1]},1.5,2,3,4\n")
    log = read(str(path), dict([choice_of("commanded_force_front_left=roll_rate:kN")]))
    first = {n: c.values[0] for n, c in log.channels.items() if n.startswith(("comm", "deliv"))}
    assert first == pytest.approx(
        {
            "commanded_front": 1500.0,
            "commanded_rear": 2.0,
            "delivered_front": 3.0,
            "delivered_rear": 4.0,
            "commanded_force_front_left": 10.0,
        }
    )


def test_an_option_takes_another_column_reversed_and_in_its_unit(csv):
    log = read(csv, dict([choice_of("roll_rate=-roll_rate:deg/s")]))
    assert log.channels["roll_rate"].values[0] == pytest.approx(-np.radians(0.01))


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("yaw_rate", "expected QUANTITY=NAME"),
        ("yaw=a", "unknown quantity of a log 'yaw'"),
        ("yaw_rate=a:m", "its unit is as rad/s"),
    ],
)
def test_wrong_options_are_refused(option, message):
    with pytest.raises(CanrollError, match=message):
        choice_of(option)


def test_a_missing_signal_is_named_with_the_remedy(tmp_path):
    path = tmp_path / "short.csv"
    path.write_text("time,speed,steering\n0,1,2\n1,2,3\n")
    with pytest.raises(CanrollError, match="no yaw rate, no lateral acceleration, no roll rate"):
        read(str(path), {})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot read"),
        ("", "line 1: no column time or time_s"),
        (HEADER.replace("time,", "clock,") + "\n0,1,2,3,4,5", "line 1: no column time or time_s"),
        (HEADER.replace(",", ";") + "\n0;1;2;3;4;5", "column time has fewer than two numbers"),
        ("\n".join([HEADER, *ROWS, "0.03,fast,72,5,0.1,0.01"]), "line 5: .*'fast' is no number"),
        ("\n".join([HEADER, ROWS[0]]), "column time has fewer than two numbers"),
        ("\n".join([HEADER, *ROWS[:2]]).replace(",10,", ",,"), "steering_wheel_deg has fewer than"),
        # a decimal comma
        ("\n".join([HEADER, *ROWS, "0,03,30,72,6,0,4,0,01"]), "line 5: 9 values in 6 columns"),
        ("\n\n".join([HEADER, *ROWS, "0.03,fast,72,5,0.1,0.01"]), "line 9: .*'fast' is no number"),
        (
            "time;steering;speed\n0,1;1;2\n0,2;1.5;2\n",
            "line 2: time: '0,1' and line 3: steering: '1.5'",
        ),
        ("time,s;steering,a;speed\n1,1,1;2;3\n", "line 1: commas or semicolons: keep one"),
        (
            "\n".join([HEADER.replace("ay_g", "yaw_rate_deg_s"), *ROWS]),
            "2 columns are called yaw_rate",
        ),
        (
            b"PK\x03\x04" + bytes(30),
            "an Excel workbook, or another zip archive: export the signals",
        ),
        (b"\xd0\xcf\x11\xe0" + bytes(30), "an Excel workbook: export the signals as CSV"),
        (b"MATLAB 7.3 MAT-file, Platform", r"version 7\.3 \(HDF5\): save it in MATLAB with -v7"),
        ('"time,steering\n0,1\n', "no column time .* it has time,steering 0,1$"),
        (b"MATLAB 5.0 MAT-file, Platform", "not a .mat file that scipy can read"),
    ],
)
def test_a_file_that_is_no_log_is_refused_in_one_line(tmp_path, content, message):
    path = tmp_path / "drive.csv"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        path.write_text(content)
    with pytest.raises(CanrollError, match=message) as refused:
        read(str(path), {})
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


PLAIN = {
    "time": [10.0, 10.5, 11.0],
    "steering": [0.1, 0.2, 0.3],
    "speed": [20.0, 20.5, 21.0],
    "yaw_rate": [-0.125, 0.0, 0.25],
}
"""A drive in SI units."""


def written(names, mark=",", factors=(1.0, 1.0, 1.0, 1.0)):
    """Return the text of a CSV of the drive, its columns under other names and in other units."""
    rows = np.transpose([np.multiply(f, v) for f, v in zip(factors, PLAIN.values(), strict=True)])
    cells = [[f"{value:.10g}" for value in row] for row in rows]
    if mark != ",":
        cells = [[cell.replace(".", ",") for cell in row] for row in cells]
    return "\n".join(mark.join(row) for row in [names, *cells]) + "\n"


def assert_plain(log):
    assert {*log.channels} == {*PLAIN} - {"time"}
    for name, channel in log.channels.items():
        assert channel.times == pytest.approx(PLAIN["time"])
        assert channel.values == pytest.approx(PLAIN[name])


DEGREES = [1e3, *np.degrees([1.0]), 3.6, *np.degrees([1.0])]


@pytest.mark.parametrize(
    ("content", "options"),
    [
        (written([*PLAIN], ";"), []),
        (written([*PLAIN], "\t"), []),
        (written(["# time(s)", "steering(rad)", " vx (m/s) ", "yaw_rate[rad/s]"]), []),
        (
            written(["time_ms", "Steering [deg]", "Speed (KMPH)", "Yaw Rate (°/s)"], ",", DEGREES),
            [],
        ),
        (written(["Time [ms]", "steering_deg", "vx_kmh", "yaw_rate_degps"], ";", DEGREES), []),
        ("% a car\n\n%" + written([*PLAIN]), []),
        (written(["t (µs)", *[*PLAIN][1:]], ",", [1e6, 1, 1, 1]), []),
        ("# a car\n" + written([*PLAIN]).replace("\n10.5", "\n# lunch\n10.5"), []),
        (
            written(["# clock", "delta", "vx_mps", "r_degps"], ",", [1e9, 0.0625, 1, DEGREES[1]]),
            ["time=clock:ns", "steering=delta:16*rad", "yaw_rate=r_degps"],
        ),
        (
            written(["clock(s)", "delta_deg", "vx", "r"], ",", [1e3, DEGREES[1] / 16, 1, -1]),
            ["time=clock:ms", "steering=delta_deg:16*", "yaw_rate=-r:rad/s"],
        ),
    ],
)
def test_columns_of_other_loggers_are_those_of_the_drive(tmp_path, content, options):
    path = tmp_path / "drive.txt"
    path.write_bytes(content.encode("cp1252" if "°" in content else "utf-8"))
    assert_plain(read(str(path), dict(map(choice_of, options))))


def test_a_log_without_times_has_a_rate(tmp_path):
    path = tmp_path / "drive.csv"
    path.write_text(written([*PLAIN]))
    log = read(str(path), {}, rate=4.0)
    assert log.channels["speed"].times == pytest.approx([0.0, 0.25, 0.5])
    assert log.remarks == ("times are those of --rate 4, not of the column time",)
    for rate, choice, message in (
        (0.0, {}, "--rate 0: must be positive"),
        (np.nan, {}, "--rate nan: must be positive"),
        (4.0, dict([choice_of("time=time:ms")]), "--signal time has the times: omit one"),
    ):
        with pytest.raises(CanrollError, match=message):
            read(str(path), choice, rate=rate)
    path.write_text(written(["Clock", "steering", "speed", "yaw_rate"]))
    with pytest.raises(
        CanrollError, match=r"--signal time=NAME:UNIT, or .* --rate HZ; it has Clock"
    ):
        read(str(path), {})


def test_what_an_option_leaves_out_is_left_out(tmp_path):
    path = tmp_path / "drive.csv"
    path.write_text(written(["time", "steering", "speed", "roll"]))
    assert "roll" in read(str(path), {}).channels
    with pytest.raises(CanrollError, match="no yaw rate, no lateral acceleration, no roll rate"):
        read(str(path), dict([choice_of("roll=")]))


@pytest.mark.parametrize("form", ["4", "5"])
def test_vectors_of_a_mat_file_are_the_drive(tmp_path, form):
    path = tmp_path / "drive.csv"
    savemat(path, {**PLAIN, "note": "wet"}, format=form, appendmat=False)
    if form == "4":
        # its first bytes say nothing
        path = path.rename(tmp_path / "drive.mat")
    assert_plain(read(str(path), {}))


def test_vectors_in_structs_of_a_mat_file_are_named_as_in_matlab(tmp_path):
    path = tmp_path / "drive.mat"
    signals = np.empty(2, object)
    signals[:] = [{"values": PLAIN["steering"]}, {"values": PLAIN["speed"]}]
    savemat(path, {"can": {"t": PLAIN["time"], "signals": signals}, "imu": {"r": [1, 2]}})
    with pytest.raises(CanrollError, match=r"it has can\.t, can\.signals\{1\}\.values, .*imu\.r$"):
        read(str(path), {})
    options = ["time=can.t", "steering=can.signals{1}.values:rad", "speed=can.signals{2}.values"]
    with pytest.raises(CanrollError, match=r"imu\.r has 2 numbers, its times are 3"):
        read(str(path), dict(map(choice_of, [*options, "yaw_rate=imu.r"])))
    log = read(str(path), dict(map(choice_of, [*options, "yaw_rate=can.signals{2}.values"])))
    assert log.channels["steering"].values == pytest.approx(PLAIN["steering"])


def test_a_mat_file_without_vectors_says_what_it_has(tmp_path):
    path = tmp_path / "drive.mat"
    savemat(path, {"data": np.ones((5, 3)), "gain": 2.0})
    with pytest.raises(
        CanrollError, match=r"no vector of numbers, but data \(5, 3\), gain \(1, 1\)"
    ):
        read(str(path), {})


def test_an_empty_value_after_the_last_column_is_none(tmp_path):
    path = tmp_path / "drive.csv"
    path.write_text("\n".join(f"{line}," for line in [HEADER, *ROWS]))
    assert read(str(path), {}).channels["speed"].values == pytest.approx(20.0)


def test_channels_of_a_measurement_are_found_by_their_names(tmp_path):
    mdf = pytest.importorskip("asammdf")
    times = np.arange(5.0)
    units = {"steering": "deg", "vx": "m/s", "yaw_rate": "rad/s", "ay": "g", "roll_rate": "deg/s"}
    units |= {"moment_rear": "kNm", "other": "V"}
    path = tmp_path / "drive.mf4"
    with mdf.MDF() as file:
        for name, unit in units.items():
            file.append(mdf.Signal(np.ones(5), times, unit=unit, name=name))
        file.save(path)
    first = {name: channel.values[0] for name, channel in read(str(path), {}).channels.items()}
    assert first == pytest.approx(
        {
            "steering": np.radians(1.0),
            "speed": 1.0,
            "yaw_rate": 1.0,
            "lateral_acceleration": 9.80665,
            "roll_rate": np.radians(1.0),
            "delivered_rear": 1000.0,
        }
    )


def test_a_bus_log_is_read_by_the_map_of_the_ecu(tmp_path):
    """Frames encoded by cantools and written by python-can."""
    files = dbc.PATH, dbc.PATH.with_suffix(".toml")
    database = cantools.database.load_file(files[0])
    path = tmp_path / "drive.asc"
    values = {
        "Imu": {"RollRate": 0.1, "LateralAcceleration": 2.0, "YawRate": -0.2},
        "VehicleMotion": {"VehicleSpeed": 20.0, "SteeringWheelAngle": 0.5},
        "ActuatorState": {"DeliveredMomentFront": 700.0, "DeliveredMomentRear": -300.0},
        # the forces of a suspension are not in it: the log of a car need not have every frame
        "AntiRollBarCommand": {"TorqueFront": 800.0, "TorqueRear": -250.0},
    }
    with can.ASCWriter(str(path)) as writer:
        for i in range(5):
            for j, (name, signals) in enumerate(values.items()):
                message = database.get_message_by_name(name)
                everything = {signal.name: 0 for signal in message.signals} | signals
                data = message.encode(everything, strict=False)
                stamp = 1.0 + 0.01 * i + 0.001 * j
                frame = can.Message(
                    timestamp=stamp,
                    arbitration_id=message.frame_id,
                    data=data,
                    is_extended_id=False,
                    channel=0,
                )
                writer.on_message_received(frame)
    log = read(str(path), {}, dbc=str(files[0]), map_file=str(files[1]))
    found = {name: float(channel.values[0]) for name, channel in log.channels.items()}
    described = {
        signal.name: {"deg/s": np.radians(1), "deg": np.radians(1), "km/h": 1 / 3.6}.get(
            signal.unit, 1.0
        )
        for name in values
        for signal in database.get_message_by_name(name).signals
    }
    assert found == pytest.approx(
        {
            "roll_rate": 0.1 * described["RollRate"],
            "lateral_acceleration": 2.0 * described["LateralAcceleration"],
            "yaw_rate": -0.2 * described["YawRate"],
            "speed": 20.0 * described["VehicleSpeed"],
            "steering": 0.5 * described["SteeringWheelAngle"],
            "delivered_front": 700.0,
            "delivered_rear": -300.0,
            "commanded_front": 800.0,
            "commanded_rear": -250.0,
        },
        abs=2e-3,
    )
