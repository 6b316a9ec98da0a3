"""A calibration and a saved run contain their vehicle."""

import json
from pathlib import Path

import pytest

from canroll import vehicles
from canroll.cli import export_c
from canroll.cli.main import main
from canroll.gain_gen.calibration import calibration_file
from canroll.runs import saved_run
from canroll.setup.controller import prepare


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


def heavier(mass):
    """Change the file that the calibration was designed for."""
    text = Path("camper.toml").read_text()
    Path("camper.toml").write_text(text.replace("sprung_mass = 2500.0", f"sprung_mass = {mass}"))


def test_a_vehicle_that_has_changed_is_driven_as_it_was_with_a_note(camper, capsys):
    heavier(2600.0)
    controller = prepare({"calibration": camper})
    assert controller.vehicle.plant.sprung_mass == 2500
    note = "vehicle camper.toml has other numbers than the calibration: those of the calibration"
    assert [line for line in controller.warnings if note in line]
    capsys.readouterr()
    run = ["run", "double_lane_change", "--calibration", str(camper), "--duration", "1"]
    assert main([*run, "--plant-vehicle", "camper.toml", "--out", "run", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["plant_vehicle"] == "camper.toml"
    assert saved_run.load(Path("run")).settings.vehicle.plant.sprung_mass == 2600


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
    assert (answer["vehicle"], answer["plant_vehicle"]) == ("camper", "suv_2020")
    assert any("designed for camper and drives suv_2020" in line for line in answer["warnings"])
    again = saved_run.load(Path("run"))
    assert again.settings.vehicle == vehicles.load("suv_2020")
    assert again.settings.vehicle_name == "suv_2020 (designed for camper)"
    assert again.to_json()["vehicle"] == "camper"
    assert "suv_2020" not in Path("run/canroll_gains.h").read_text()


def test_a_run_is_judged_with_the_vehicle_that_was_driven(camper):
    run = ["run", "double_lane_change", "--calibration", str(camper), "--duration", "1"]
    assert main([*run, "--out", "run"]) == 0
    driven = saved_run.load(Path("run"))
    heavier(2600.0)
    again = saved_run.load(Path("run"))
    assert again.settings == driven.settings
    note = "vehicle camper.toml has other numbers than the run: those of the run are used"
    assert again.warnings == (*driven.warnings, note)
    assert again.passive_metrics == driven.passive_metrics


def test_neither_the_file_nor_its_folder_is_needed(camper, tmp_path, monkeypatch, capsys):
    run = ["run", "double_lane_change", "--calibration", str(camper.absolute()), "--duration", "1"]
    assert main([*run, "--out", "run"]) == 0
    folder = Path("run").absolute()
    driven = saved_run.load(folder)
    Path("camper.toml").unlink()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    found = saved_run.load(folder)
    assert found.settings == driven.settings and found.warnings == driven.warnings
    calibration = str(tmp_path / camper)
    assert main(["run", *run[1:3], calibration, "--duration", "1"]) == 0
    assert main(["margins", calibration]) in (0, 1)
    assert main(["run", str(folder)]) == 0
    assert main(["compare", str(folder), calibration, "--duration", "1"]) == 0
    told = capsys.readouterr()
    assert "other numbers" not in told.out + told.err


def test_the_programs_of_a_run_need_no_file(camper):
    Path("camper.toml").unlink()
    hil = ["hil", "double_lane_change", "--calibration", str(camper), "--duration", "1"]
    main([*hil, "--pace", "lockstep", "--out", "hil"])
    assert saved_run.load(Path("hil")).settings.vehicle.plant.sprung_mass == 2500


def test_a_preset_is_known_by_its_name(tmp_path):
    assert main(["design", "--law", "lqr", "--out", str(tmp_path)]) == 0
    assert calibration_file.load(tmp_path / "calibration.toml").vehicle.reference == "van_real"


def test_margins_say_where_the_vehicle_has_changed(camper, capsys):
    capsys.readouterr()
    main(["margins", str(camper), "--json"])
    before = capsys.readouterr()
    assert before.err == ""
    heavier(2510.0)
    main(["margins", str(camper), "--json"])
    told = capsys.readouterr()
    assert "camper.toml has other numbers than the calibration" in told.err
    assert told.out == before.out


def test_an_export_says_where_the_vehicle_has_changed(camper, capsys, monkeypatch):
    monkeypatch.setattr(export_c.bundle, "write", lambda folder, export: [])
    heavier(2510.0)
    capsys.readouterr()
    assert main(["export-c", "bundle", "--calibration", str(camper)]) == 0
    assert "camper.toml has other numbers than the calibration" in capsys.readouterr().out


def test_a_search_names_both_vehicles(capsys):
    words = ["handling", "limit", "fishhook", "--law", "passive", "--plant-vehicle", "suv_2020"]
    main([*words, "--from", "60", "--to", "62", "--tolerance", "2", "--json"])
    answer = json.loads(capsys.readouterr().out)
    assert (answer["vehicle"], answer["plant_vehicle"]) == ("van_real", "suv_2020")
