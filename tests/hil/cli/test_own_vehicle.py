"""A calibration finds the vehicle file that it was designed for."""

import json
from pathlib import Path

import pytest

import vehicles
from canroll.errors import CanrollError
from gain_gen.calibration import calibration_file
from hil.cli.main import main
from hil.runs.frozen import prepare


@pytest.fixture
def camper(tmp_path, monkeypatch):
    """Design for a vehicle file in the current folder; return the calibration."""
    monkeypatch.chdir(tmp_path)
    preset = Path(vehicles.__file__).with_name("van_real.toml").read_text()
    heavier = preset.replace("sprung_mass = 2280.0", "sprung_mass = 2500.0")
    Path("camper.toml").write_text(heavier)
    assert main(["design", "--law", "lqr", "--vehicle", "camper.toml", "--out", "own"]) == 0
    return Path("own/calibration.toml")


def test_the_calibration_is_driven_with_its_vehicle(camper, capsys):
    capsys.readouterr()
    run = ["run", "double_lane_change", "--calibration", str(camper), "--duration", "1", "--json"]
    assert main(run) == 0
    assert json.loads(capsys.readouterr().out)["vehicle"] == "camper"
    assert prepare({"calibration": camper}).vehicle.plant.sprung_mass == 2500


def test_a_file_that_is_gone_is_named(camper):
    Path("camper.toml").unlink()
    with pytest.raises(CanrollError, match=r"cannot read vehicle file camper\.toml"):
        prepare({"calibration": camper})


def test_a_preset_is_known_by_its_name(tmp_path):
    assert main(["design", "--law", "lqr", "--out", str(tmp_path)]) == 0
    assert calibration_file.load(tmp_path / "calibration.toml").vehicle == "van_real"
