"""``canroll certify``: answers, the file, and a loop that is not stable."""

import copy
import json
import sys
import tomllib

import pytest

pytest.importorskip("flint")

from canroll.cli import main as cli
from gain_gen.calibration import calibration_file
from gain_gen.certificate import checker


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    out = tmp_path_factory.mktemp("certify")
    assert cli.main(["design", "--law", "hinf_delay", "--bus", "500k", "--out", str(out)]) == 0
    return out / "calibration.toml"


def louder(calibration, path, shift):
    """Write a calibration with 2**shift times the gain."""
    loaded = calibration_file.load(calibration)
    record = copy.deepcopy(loaded.record)
    record.output_gain_shift -= shift
    from codegen.run.memory_image import sealed

    calibration_file.save(path, sealed(record), loaded.tables)
    return path


def test_where_nothing_can_be_written_is_said_before_anything_is_proved(
    calibration, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr("gain_gen.certificate.certificate.certify", None)
    (tmp_path / "file").touch()
    for out in (tmp_path / "file" / "x.json", tmp_path / "file" / "x" / "y.json"):
        assert cli.main(["certify", str(calibration), "--out", str(out)]) == 2
        assert capsys.readouterr().err.startswith(f"canroll: cannot write {out}: ")


@pytest.mark.slow
def test_a_stable_loop_is_proved_and_its_file_checked(calibration, capsys):
    assert cli.main(["certify", str(calibration)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("proved: hinf_delay for van_real is stable for every sequence of delays")
    assert "in all 10 conditions" in out
    assert out.count("\nassumed: ") == 4
    path = calibration.with_name("certificate.json")
    assert out.endswith(f"written: {path}\n")
    integers = tomllib.loads(calibration.read_text())["calibration"]
    assert len(list(checker.check(json.loads(path.read_text()), integers))) > 40


@pytest.mark.slow
def test_a_loop_with_four_times_the_gain_is_refused_with_its_sequence(
    calibration, tmp_path, capsys
):
    path = louder(calibration, tmp_path / "calibration.toml", 2)
    assert cli.main(["certify", str(path), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert not found["proved"]
    assert found["file"] is None
    worst = max(found["unproved"], key=lambda short: short["growth_per_tick"])
    assert worst["unstable"]
    assert all(0.0 < delay < 0.03 for delay in worst["sequence_s"])
    assert not (tmp_path / "certificate.json").exists()
    assert cli.main(["certify", str(path)]) == 1
    out = capsys.readouterr().out
    assert out.startswith("NOT PROVED: hinf_delay for van_real")
    assert "again and again: a factor of 1.0" in out
    content = json.loads((tmp_path / "certificate.json").read_text())
    assert list(checker.check(content, tomllib.loads(path.read_text())["calibration"]))


def test_a_change_of_the_vehicle_needs_its_name(calibration, capsys):
    arguments = ["certify", str(calibration), "--vehicle-set", "plant.sprung_mass=2500"]
    assert cli.main(arguments) == 2
    assert "--vehicle-set changes the vehicle of --vehicle" in capsys.readouterr().err


def test_without_python_flint_it_names_the_extra(calibration, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "flint", None)
    assert cli.main(["certify", str(calibration)]) == 2
    assert "needs python-flint: pip install 'canroll[certify]'" in capsys.readouterr().err
