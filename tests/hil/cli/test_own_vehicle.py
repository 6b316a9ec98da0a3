"""A calibration finds the vehicle file that it was designed for."""

import json
from pathlib import Path

import pytest

import vehicles
from canroll.errors import CanrollError
from gain_gen.calibration import calibration_file
from hil.cli.main import main
from hil.runs import saved_run
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


def test_a_vehicle_that_has_changed_is_driven_only_on_purpose(camper, capsys):
    text = Path("camper.toml").read_text()
    Path("camper.toml").write_text(text.replace("sprung_mass = 2500.0", "sprung_mass = 2600.0"))
    with pytest.raises(CanrollError, match=r"camper\.toml has changed since.*--plant-vehicle"):
        prepare({"calibration": camper})
    capsys.readouterr()
    run = ["run", "double_lane_change", "--calibration", str(camper), "--duration", "1"]
    assert main([*run, "--plant-vehicle", "camper.toml", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["plant_vehicle"] == "camper.toml"


def test_what_only_people_read_may_change(camper):
    text = Path("camper.toml").read_text()
    renamed = text.replace('title = "', 'title = "My ')
    Path("camper.toml").write_text(f"# weighed again\n{renamed}")
    assert prepare({"calibration": camper}).vehicle.plant.sprung_mass == 2500


def test_another_vehicle_is_driven_on_purpose(camper, capsys):
    capsys.readouterr()
    run = ["run", "double_lane_change", "--calibration", str(camper), "--duration", "1", "--json"]
    assert main([*run, "--plant-vehicle", "suv_2020", "--out", "run"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["vehicle"] == "suv_2020"
    assert any("designed for camper and drives suv_2020" in line for line in answer["warnings"])
    again = saved_run.load(Path("run"))
    assert again.settings.vehicle == vehicles.load("suv_2020")
    assert "suv_2020" not in Path("run/canroll_gains.h").read_text()


def test_a_run_is_not_judged_with_a_vehicle_that_has_changed(camper):
    run = ["run", "double_lane_change", "--calibration", str(camper), "--duration", "1"]
    assert main([*run, "--out", "run"]) == 0
    text = Path("camper.toml").read_text()
    Path("camper.toml").write_text(text.replace("sprung_mass = 2500.0", "sprung_mass = 2600.0"))
    with pytest.raises(CanrollError, match="other numbers"):
        saved_run.load(Path("run"))


def test_a_file_that_is_gone_is_named(camper):
    Path("camper.toml").unlink()
    with pytest.raises(CanrollError, match=r"cannot read vehicle file camper\.toml"):
        prepare({"calibration": camper})


def test_a_preset_is_known_by_its_name(tmp_path):
    assert main(["design", "--law", "lqr", "--out", str(tmp_path)]) == 0
    assert calibration_file.load(tmp_path / "calibration.toml").vehicle == "van_real"


def test_margins_say_where_the_vehicle_has_changed(camper, capsys):
    capsys.readouterr()
    main(["margins", str(camper), "--json"])
    assert capsys.readouterr().err == ""
    text = Path("camper.toml").read_text()
    Path("camper.toml").write_text(text.replace("sprung_mass = 2500.0", "sprung_mass = 2510.0"))
    main(["margins", str(camper), "--json"])
    told = capsys.readouterr()
    assert "camper.toml has changed since the design" in told.err
    json.loads(told.out)
