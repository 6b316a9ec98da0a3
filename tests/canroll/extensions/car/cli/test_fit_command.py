"""``canroll fit``: what it answers, writes and refuses."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import tomli_w
from support import fit_truth

from canroll import vehicles
from canroll.cli.main import main
from canroll.extensions.car.identification import input_noise
from canroll.extensions.car.identification.unknowns import NUMBERS
from canroll.vehicles import plausible

FREE = ("tyre.cornering_stiffness_front", "tyre.cornering_stiffness_rear")
HELD = tuple(key for key in NUMBERS if key not in FREE)


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A log of a van whose cornering stiffness is not that of its file, and this file."""
    folder = tmp_path_factory.mktemp("drive")
    case = fit_truth.truth(7, vehicles.load("van_real"), duration=4.0, held=HELD)
    case.write(folder / "drive.csv")
    return folder, case


def options(folder, *more):
    held = [word for key in HELD for word in ("--hold", key)]
    log = str(folder / "drive.csv")
    return ["fit", log, "--vehicle", "van_real", "--starts", "1", "--jobs", "1", *held, *more]


def test_it_writes_a_vehicle_its_covariance_and_a_page(drive, tmp_path, capsys):
    folder, case = drive
    out = tmp_path / "out"
    assert main(options(folder, "--out", str(out))) == 0
    printed = capsys.readouterr().out
    assert printed.startswith(
        "van_real fitted to 3.0 s of drive.csv: 2 of 2 parameters identified\n"
    )
    assert len(printed.splitlines()) <= 25
    car = vehicles.load(out / "van_real.toml")
    true = case.numbers["tyre.cornering_stiffness_front"]
    assert car.tyre.cornering_stiffness_front == pytest.approx(true, rel=0.05)
    assert car.source("tyre.cornering_stiffness_front").startswith("fitted ±")
    result = json.loads((out / "fit.json").read_text())
    assert len(result["covariance"]) == len(result["numbers"])
    of_car = [i for i, n in enumerate(result["numbers"]) if n["key"] in FREE]
    covariance = np.array(result["covariance"])[np.ix_(of_car, of_car)]
    deviations = np.array(car.fit.deviations)
    assert car.fit.names == FREE
    assert car.fit.matrix * np.outer(deviations, deviations) == pytest.approx(covariance)
    page = (out / "report.html").read_text()
    assert "Variance" in page or "variance explained" in page


def test_what_a_log_without_roll_cannot_tell_is_of_the_vehicle_file(drive, tmp_path, capsys):
    """The signals of a production car: steering, speed, yaw rate, lateral acceleration."""
    _, case = drive
    own = {k: v for k, v in case.columns.items() if k not in ("roll_rate", "roll")}
    fit_truth.Truth(case.start, {}, own).write(tmp_path / "drive.csv")
    words = options(tmp_path, "--out", str(tmp_path / "out"))
    at = words.index("suspension.roll_damping_front_share")
    assert main([*words[: at - 1], *words[at + 1 :]]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("van_real fitted to 3.0 s of drive.csv: 2 of 3 parameters")
    assert "warning: no roll rate in the log" in printed
    assert "\nfrom the vehicle file, not from the log: front share of roll damping\n" in printed
    car, start = vehicles.load(tmp_path / "out" / "van_real.toml"), vehicles.load("van_real")
    share = "suspension.roll_damping_front_share"
    assert car.suspension.roll_damping_front_share == start.suspension.roll_damping_front_share
    assert car.source(share) == start.source(share)
    true = case.numbers["tyre.cornering_stiffness_front"]
    assert car.tyre.cornering_stiffness_front == pytest.approx(true, rel=0.05)


def test_residuals_that_are_no_noise_are_not_to_be_trusted(drive, tmp_path, capsys):
    """A van with another tyre: 30 % less friction than the file whose friction is held."""
    _, case = drive
    own = case.start.replace({"tyre.friction": 0.5})
    columns = fit_truth.truth(7, own, duration=4.0, held=HELD).columns
    fit_truth.Truth(case.start, {}, columns).write(tmp_path / "drive.csv")
    assert main(options(tmp_path, "--json")) == 0
    assert json.loads(capsys.readouterr().out)["trusted"] is False
    assert main(options(tmp_path)) == 0
    head = capsys.readouterr().out.splitlines()[0]
    assert "parameters not to be trusted (residuals no noise: yaw rate" in head


def test_an_unusual_car_is_named_and_its_file_can_be_read(drive, tmp_path, capsys, monkeypatch):
    folder, _ = drive
    document = vehicles.load("van_real").document
    # as if a cornering coefficient above 5 1/rad were unusual
    narrow = [replace(band, high=5.0) if band.key == FREE[0] else band for band in plausible.BANDS]
    monkeypatch.setattr(plausible, "BANDS", tuple(narrow))
    start = tmp_path / "start.toml"
    text = tomli_w.dumps(document | {"unusual": [FREE[0]]})
    start.write_text(text)
    arguments = [str(start) if word == "van_real" else word for word in options(folder)]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 0
    assert "warning: tyre.cornering_stiffness_front = " in capsys.readouterr().out
    car = vehicles.load(tmp_path / "out" / "start.toml")
    assert set(plausible.outside(car)) == {FREE[0]}


def test_noise_of_the_inputs_that_no_drive_shows_is_missed_aloud(drive, capsys, monkeypatch):
    folder, _ = drive
    monkeypatch.setattr(input_noise, "effects", lambda simulator, x, simulated: iter(()))
    assert main(options(folder)) == 0
    assert "warning: the noise of the measured steering and speed" in capsys.readouterr().out


def test_a_reversed_roll_rate_is_named(drive, capsys):
    folder, _ = drive
    assert main(options(folder, "--json", "--signal", "roll_rate=-roll_rate")) == 2
    error = capsys.readouterr().err
    assert "roll rate: its sign is reversed" in error
    assert error.endswith("give --signal roll_rate=roll_rate\n")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--check", "5"], "--check 5: expected FROM:TO in s"),
        (["--from", "3", "--to", "2"], "--from 3 --to 2: nothing is between them"),
        (["--map", "car.toml"], "it belongs to --dbc"),
        (["--hold", "tyre.grip"], "unknown number that a log may tell 'tyre.grip'"),
        (["--signal", "yaw_rate=gyro"], "unknown column of .* 'gyro'"),
        (["--free", "tyre.friction"], "it is to be fitted and to be held"),
    ],
)
def test_wrong_input_is_refused_in_one_line(drive, capsys, words, message):
    folder, _ = drive
    assert main(options(folder, "--json", *words)) == 2
    error = capsys.readouterr().err
    assert error.startswith("canroll: ")
    assert error.count("\n") == 1
    assert re.search(message, error), error


def test_a_vehicle_is_needed(drive, capsys):
    folder, _ = drive
    assert main(["fit", str(folder / "drive.csv"), "--json"]) == 2
    assert "--vehicle is missing" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["fit", "--help"])
    assert "default: van_real" not in capsys.readouterr().out
