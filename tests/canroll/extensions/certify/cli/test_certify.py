"""``canroll certify``: answers, the file, and a loop that is not stable."""

import copy
import json
import sys
import tomllib
from dataclasses import replace

import pytest

pytest.importorskip("flint")

from canroll.cli import main as cli
from canroll.codegen.run.memory_image import sealed
from canroll.extensions.certify import checker
from canroll.gain_gen.calibration import calibration_file


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
    calibration_file.save(path, sealed(record), loaded.tables)
    return path


def test_where_nothing_can_be_written_is_said_before_anything_is_proved(
    calibration, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr("canroll.extensions.certify.certificate.certify", None)
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

    check = ["certify", "--check", str(path), str(calibration)]
    assert cli.main(check) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[-2].startswith("valid: every claim is proved of the data above; ")
    assert out[-1].startswith("compared: car, delays, resolutions and bounds of steering are those")
    assert cli.main([*check, "--bus", "gateway_20ms"]) == 1
    out = capsys.readouterr().out
    assert "\nnot that of van_real and its bus: delay is [0.0024" in out
    assert "compared" not in out


def test_what_is_no_certificate_is_not_valid(calibration, tmp_path, capsys):
    path = tmp_path / "certificate.json"
    assert cli.main(["certify", "--check", str(path), str(calibration)]) == 2
    assert f"cannot read certificate {path}: No such file" in capsys.readouterr().err
    path.write_text("{}")
    assert cli.main(["certify", "--check", str(path), str(calibration)]) == 1
    assert capsys.readouterr().out.startswith("not valid: ")
    assert cli.main(["certify", "--check", str(path), "--json", str(calibration)]) == 2
    assert "--json: --check prints what the checker prints" in capsys.readouterr().err


@pytest.mark.slow
def test_a_proof_of_a_loop_that_does_not_run_is_none(calibration, tmp_path, monkeypatch, capsys):
    """One and a half times the gain: proved with a command every tick, not with its trigger."""
    from canroll.extensions.certify import subject

    family_of = subject.family_of

    def one(task):
        family = family_of(task)
        return replace(family, members=family.members[3:4])

    monkeypatch.setattr(subject, "family_of", one)
    loaded = calibration_file.load(calibration)
    record = copy.deepcopy(loaded.record)
    record.output_gain = [3 * record.output_gain[0] // 4, 0, 0]
    record.output_gain_shift -= 1
    path = tmp_path / "calibration.toml"
    calibration_file.save(path, sealed(record), loaded.tables)
    assert cli.main(["certify", str(path)]) == 1
    first, second = capsys.readouterr().out.splitlines()[:2]
    assert first == (
        "NOT PROVED: hinf_delay for van_real with its event trigger, as it runs: no proof in 1 of "
        "1 conditions; design with --trigger every for the loop of the next line"
    )
    assert second.startswith("proved: hinf_delay for van_real is stable for every sequence of ")
    assert cli.main(["certify", str(path), "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert (answer["proved"], answer["every_tick_proved"]) == (False, True)
    assert answer["trigger_proved"] is False


@pytest.mark.long
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
