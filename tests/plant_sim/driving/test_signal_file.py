"""Files of asammdf, python-can and cantools must give the numbers put into them."""

import can
import cantools
import numpy as np
import pytest

from canroll.errors import CanrollError, MissingExtraError
from canroll.plant_sim.driving import signal_file

DBC = """VERSION ""

BU_: Car

BO_ 257 Wheel: 8 Car
 SG_ Angle : 0|16@1- (0.1,0) [-1000|1000] "deg" Car
 SG_ Speed : 16|16@1+ (0.01,0) [0|300] "km/h" Car

BO_ 258 Body: 8 Car
 SG_ Speed : 0|16@1+ (0.01,0) [0|300] "m/s" Car
 SG_ Gear : 16|4@1+ (1,0) [0|15] "" Car

VAL_ 257 Angle 32767 "Not available" ;
"""
TIMES = np.arange(0.0, 2.0, 0.02)
ANGLE = np.round(30.0 * np.sin(3.0 * TIMES), 1)
SPEED = np.round(60.0 + 5.0 * TIMES, 2)


@pytest.fixture
def dbc(tmp_path):
    path = tmp_path / "car.dbc"
    path.write_text(DBC)
    return path


def frames(dbc, *, channel=0, without=()):
    """Yield the frames of TIMES; those at ``without`` say that there is no angle."""
    database = cantools.database.load_file(dbc)
    message = database.get_message_by_name("Wheel")
    for i, (t, angle, speed) in enumerate(zip(TIMES, ANGLE, SPEED, strict=True)):
        state = "Not available" if i in without else angle
        yield can.Message(
            timestamp=1.6e9 + float(t),
            arbitration_id=message.frame_id,
            is_extended_id=False,
            channel=channel,
            data=message.encode({"Angle": state, "Speed": speed}),
        )


def write_log(path, messages):
    with can.Logger(path) as log:
        for message in messages:
            log(message)
    return str(path)


def refusal(*arguments):
    with pytest.raises(CanrollError) as refused:
        signal_file.read(*arguments)
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.mark.parametrize("suffix", ["blf", "asc", "log", "csv", "trc", "mf4", "db", "asc.gz"])
def test_a_signal_of_a_bus_log_has_the_values_put_into_it(tmp_path, dbc, suffix):
    if suffix == "mf4":
        pytest.importorskip("asammdf")
    file = write_log(tmp_path / f"drive.{suffix}", frames(dbc))
    angle, speed = signal_file.read(file, ["Angle", "Wheel.Speed"], str(dbc))
    assert (angle.name, angle.unit, speed.name, speed.unit) == (
        *("Angle", "deg"),
        *("Wheel.Speed", "km/h"),
    )
    assert angle.times - angle.times[0] == pytest.approx(TIMES, abs=1e-4)
    assert angle.values == pytest.approx(ANGLE, abs=1e-9)
    assert speed.values == pytest.approx(SPEED, abs=1e-9)
    assert angle.remarks == ()


def test_values_with_a_name_are_left_out_and_said(tmp_path, dbc):
    file = write_log(tmp_path / "drive.blf", frames(dbc, without=(3, 4)))
    angle, speed = signal_file.read(file, ["Angle", "Wheel.Speed"], str(dbc))
    assert angle.values == pytest.approx(np.delete(ANGLE, [3, 4]))
    assert angle.times - angle.times[0] == pytest.approx(np.delete(TIMES, [3, 4]), abs=1e-4)
    assert angle.remarks == (
        f"{file}: signal Angle: 2 of 100 frames have no number of it: left out",
    )
    assert len(speed.values) == 100 and speed.remarks == ()


def test_the_channel_of_a_bus_log_that_has_the_signals_is_read(tmp_path, dbc):
    def both(twice):
        first = list(frames(dbc, channel=1))
        second = list(frames(dbc, channel=2))
        for message in second if not twice else ():
            message.arbitration_id = 0x200
        return [m for pair in zip(first, second, strict=True) for m in pair]

    file = write_log(tmp_path / "one.blf", both(twice=False))
    assert len(signal_file.read(file, ["Angle"], str(dbc))[0].values) == 100
    file = write_log(tmp_path / "two.blf", both(twice=True))
    said = refusal(file, ["Angle"], str(dbc))
    assert "frames of Wheel (0x101) are on the channels" in said
    chosen = said.rpartition("file=")[2]
    assert len(signal_file.read(chosen, ["Angle"], str(dbc))[0].values) == 100
    assert "unknown channel" in refusal(f"{file}#7", ["Angle"], str(dbc))


def test_names_of_a_bus_log_that_cannot_be_are_refused(tmp_path, dbc):
    file = write_log(tmp_path / "drive.blf", frames(dbc))
    assert "Speed is in Wheel and Body: name it with its message, such as Wheel.Speed" in refusal(
        file, ["Speed"], str(dbc)
    )
    assert "did you mean 'Angle'" in refusal(file, ["Angel"], str(dbc))
    assert "no channel has frames of Body (0x102)" in refusal(file, ["Gear"], str(dbc))
    assert "needs its network description: --set dbc=FILE" in refusal(file, ["Angle"])
    assert "cannot read signal file" in refusal(file, ["Angle"], str(tmp_path / "none.dbc"))
    text = tmp_path / "drive.txt"
    text.write_text("time,Angle\n0,1\n1,2\n")
    assert "dbc=FILE is for a bus log, which ends in .asc" in refusal(
        str(text), ["Angle"], str(dbc)
    )
    silent = write_log(tmp_path / "silent.blf", frames(dbc, without=range(1, 100)))
    assert "it has 1 numbers, it needs two" in refusal(silent, ["Angle"], str(dbc))


def test_a_signal_of_a_damaged_line_of_the_description_names_the_line(tmp_path, dbc):
    file = write_log(tmp_path / "drive.blf", frames(dbc))
    dbc.write_text(DBC.replace("SG_ Angle : 0|16@1- (0.1,0)", "SG_ Angle : 0|16@1- (0.1;0)"))
    assert "Angle cannot be read: line 6" in refusal(file, ["Angle"], str(dbc))
    assert len(signal_file.read(file, ["Wheel.Speed"], str(dbc))[0].values) == 100


@pytest.fixture
def measured(tmp_path):
    """Return an MF4 whose speed is in two groups, and whose states have names."""
    asammdf = pytest.importorskip("asammdf")
    names = {"val_0": 2, "text_0": b"invalid", "default": b""}
    with asammdf.MDF(version="4.10") as file:
        signal = asammdf.Signal
        file.append(
            [
                signal(ANGLE, TIMES, name="Steering", unit="deg"),
                signal(SPEED, TIMES, name="Speed", unit="km/h"),
            ]
        )
        file.append(
            [
                signal(SPEED[::5] / 3.6, TIMES[::5], name="Speed", unit="m/s"),
                signal(np.where(np.arange(20) < 19, np.nan, 1.0), TIMES[::5], name="Seldom"),
                signal(np.where(np.arange(20) < 5, np.nan, 1.0), TIMES[::5], name="Often"),
                signal((np.arange(20) > 9) * 2, TIMES[::5], name="State", conversion=names),
            ]
        )
        file.save(tmp_path / "drive.mf4")
    return str(tmp_path / "drive.mf4")


def test_channels_of_a_measurement_have_the_values_and_units_put_into_it(measured):
    angle, speed, slow = signal_file.read(measured, ["Steering", "0.Speed", "1.Speed"])
    assert (angle.unit, speed.unit, slow.unit) == ("deg", "km/h", "m/s")
    for signal, times, values in (
        (angle, TIMES, ANGLE),
        (speed, TIMES, SPEED),
        (slow, TIMES[::5], SPEED[::5] / 3.6),
    ):
        assert np.array_equal(signal.times, times) and np.array_equal(signal.values, values)
    often = signal_file.read(measured, ["Often"])[0]
    assert len(often.values) == 15
    assert "signal Often: 5 of 20 samples are no number: left out" in often.remarks[0]


@pytest.mark.slow
def test_channels_of_a_measurement_that_cannot_be_are_refused(measured, tmp_path):
    assert "Speed is in the groups 0, 1: name it with its group, such as 0.Speed" in refusal(
        measured, ["Speed"]
    )
    assert "did you mean 'Steering'" in refusal(measured, ["Steerin"])
    assert "did you mean 'Speed'" in refusal(measured, ["7.Speed"])
    assert "it has 1 numbers" in refusal(measured, ["Seldom"])
    (tmp_path / "bad.mf4").write_bytes(b"MDF     4.10    ")
    assert "bad.mf4: not a readable measurement: damaged" in refusal(
        str(tmp_path / "bad.mf4"), ["Steering"]
    )
    assert "cannot read signal file" in refusal(str(tmp_path / "none.mf4"), ["Steering"])


def test_a_bus_log_that_is_taken_for_a_measurement_names_the_remedy(tmp_path, dbc):
    pytest.importorskip("asammdf")
    file = write_log(tmp_path / "drive.mf4", frames(dbc))
    assert "frames of a bus: with --set dbc=FILE they are read" in refusal(file, ["Angle"])


def test_a_measurement_needs_its_extra(measured, monkeypatch):
    monkeypatch.setattr(signal_file, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"needs asammdf: pip install 'canroll\[asammdf\]'"):
        signal_file.read(measured, ["Steering", "0.Speed"])


def test_columns_of_a_csv_have_their_units_by_name(tmp_path):
    file = tmp_path / "drive.csv"
    file.write_text("time, speed_kmh ,v\n5,72,20\n\n6,75,21\n")
    assert signal_file.columns(str(file)) == ("time", "speed_kmh", "v")
    named, other = signal_file.read(str(file), ["speed_kmh", "v"])
    assert (named.unit, other.unit) == ("km/h", "")
    assert named.times.tolist() == [5.0, 6.0] and other.values.tolist() == [20.0, 21.0]


def test_a_file_that_has_changed_is_read_anew(tmp_path):
    file = tmp_path / "drive.csv"
    for last in ("1", "12"):
        file.write_text(f"time,v\n0,0\n1,{last}\n")
        assert signal_file.read(str(file), ["v"])[0].values[-1] == float(last)
