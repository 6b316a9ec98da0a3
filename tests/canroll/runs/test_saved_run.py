"""A run read back from its folder is the run that was driven."""

import json
import shutil

import numpy as np
import pytest

from canroll.cli.main import main
from canroll.errors import CanrollError
from canroll.gain_gen.calibration.calibration_file import dumps
from canroll.report.run_folder import write_files
from canroll.runs import saved_run


@pytest.fixture(scope="module")
def driven():
    """A run that drove a replay too, with everything that settings can hold."""
    from canroll.runs import experiment

    return experiment.run(
        "double_lane_change",
        vehicle="suv_2020",
        law="lqr",
        plant="nonlinear",
        bus="gateway_20ms",
        speed_kmh=70.0,
        trigger="every",
        seed=3,
        duration=2.5,
        options={"friction": "0.8"},
        faults=("Imu.RollRate=stuck@1:1.2",),
        conditions={"supply": "11"},
    )


@pytest.fixture
def folder(driven, tmp_path):
    write_files(driven, tmp_path)
    return tmp_path


def test_a_run_without_trace_says_what_cannot_be_done(driven, folder, capsys):
    kept = write_files(driven, folder, without=("trace",))
    assert "trace" not in kept.files
    assert not (folder / "trace.npz").exists()
    with pytest.raises(
        CanrollError, match=r"not a saved run: trace\.npz is missing or was left out by --no"
    ):
        saved_run.load(folder)
    words = ["run", "double_lane_change", "--duration", "0.5", "--law", "passive", "--no-trace"]
    main([*words, "--out", str(folder)])
    assert "no trace: 'canroll run' and 'canroll compare' cannot read" in capsys.readouterr().err
    assert sorted(json.loads((folder / "result.json").read_text())["sha256"]) == [
        "calibration.toml"
    ]


def test_everything_comes_back(driven, folder):
    found = saved_run.load(folder)
    data = json.loads((folder / "result.json").read_text())
    del data["schema"], data["sha256"], data["vehicle_sha256"], data["vehicle_document"]
    assert found.to_json() == data
    assert found.options == driven.options
    assert found.settings == driven.settings
    assert dumps(found.record, {}) == dumps(driven.record, {})
    for run in saved_run.RUNS:
        before, after = getattr(driven, run), getattr(found, run)
        assert list(after.signals) == list(before.signals)
        assert all(np.array_equal(after.signals[n], before.signals[n]) for n in before.signals)
        assert after.frames.tobytes() == before.frames.tobytes()
        assert after.ticks.tobytes() == before.ticks.tobytes()
        assert np.array_equal(after.ages, before.ages)
        assert (after.duration, after.complete) == (before.duration, before.complete)


def test_the_page_made_anew_is_the_same(folder, capsys):
    page = folder / "report.html"
    before = page.read_bytes()
    page.unlink()
    code = main(["run", str(folder)])
    assert code in (0, 1)
    assert page.read_bytes() == before
    assert f"{folder}: report.html" in capsys.readouterr().out
    other = folder / "other" / "report.html"
    assert main(["run", str(folder), "--out", str(other.parent), "--json"]) == code
    assert json.loads(capsys.readouterr().out)["files"]["report"] == str(other)
    assert other.exists()


def test_the_same_run_gives_the_same_bytes(driven, folder, tmp_path):
    again = saved_run.save_traces(tmp_path / "again.npz", saved_run.load(folder))
    assert again.read_bytes() == (folder / "trace.npz").read_bytes()


def test_a_run_without_control(tmp_path, capsys):
    options = ["--law", "passive", "--duration", "1", "--out", str(tmp_path)]
    assert main(["run", "double_lane_change", *options]) == 0
    found = saved_run.load(tmp_path)
    assert found.controlled is None and found.replay is None
    assert main(["run", str(tmp_path)]) == 0
    assert "Without control" in capsys.readouterr().out


def overwrite(path, place):
    content = bytearray(path.read_bytes())
    content[place : place + 200] = bytes(200)
    path.write_bytes(content)


def another_calibration(folder):
    """Put the calibration of another law where the run's own was."""
    options = ["--law", "smc", "--vehicle", "suv_2020", "--out", str(folder / "other")]
    assert main(["design", *options]) == 0
    shutil.copy(folder / "other" / "calibration.toml", folder)


def damaged(folder):
    overwrite(folder / "trace.npz", 5000)


def in_result(folder, **changes):
    """Change values of result.json."""
    data = json.loads((folder / "result.json").read_text())
    (folder / "result.json").write_text(json.dumps(data | changes))


def heavier(folder):
    document = json.loads((folder / "result.json").read_text())["vehicle_document"]
    document["plant"]["sprung_mass"] += 1.0
    in_result(folder, vehicle_document=document)


def sealed_again(folder, spoil):
    """Spoil a run and make its hashes fit, so that the reader meets the spoiled file."""
    spoil(folder)
    data = json.loads((folder / "result.json").read_text())
    hashes = {name: saved_run.digest(folder / name) for name in data["sha256"]}
    (folder / "result.json").write_text(json.dumps({**data, "sha256": hashes}))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda folder: (folder / "trace.npz").unlink(), "not a saved run"),
        (lambda folder: overwrite(folder / "trace.npz", 5000), "trace.npz changed since"),
        (lambda folder: (folder / "result.json").write_text("{}"), "schema 'none', but this"),
        (lambda folder: in_result(folder, schema=2), "schema 2, but this version reads 1: drive"),
        (lambda folder: (folder / "result.json").write_text("["), "cannot read"),
        (lambda folder: (folder / "result.json").write_text("[]"), "cannot read"),
        (lambda folder: (folder / "calibration.toml").unlink(), "cannot read"),
        (another_calibration, "calibration.toml changed since"),
        (lambda folder: sealed_again(folder, another_calibration), "come from different runs"),
        (lambda folder: sealed_again(folder, damaged), "cannot read"),
        (heavier, "result.json: vehicle_document: the fingerprint does not match"),
        (lambda folder: in_result(folder, vehicle_document=[1]), "must be a table"),
    ],
)
def test_what_is_no_saved_run(folder, spoil, message, capsys):
    spoil(folder)
    with pytest.raises(CanrollError, match=message):
        saved_run.load(folder)
    assert main(["run", str(folder)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
