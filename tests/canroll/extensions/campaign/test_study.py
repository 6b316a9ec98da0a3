"""Campaigns from the command line and from a file: what is drawn, kept and reported."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from canroll.cli.main import main
from canroll.errors import CanrollError
from canroll.extensions.campaign import campaign_file, study
from canroll.extensions.campaign.plan import LIMIT_CYCLE, drive_chunk
from canroll.runs import experiment
from canroll.studies import variation

pq = pytest.importorskip("pyarrow.parquet", reason="needs pyarrow: the extra campaign")

LIGHT = ["roundabout", "--plant", "roll1", "--law", "lqr", "--jobs", "1"]


def planned(runs=6, spread=variation.DEFAULT_SPREAD, **others):
    settings = {"seed": 0, "buses": [], "faults": [], **others}
    choices = {"law": "lqr", "plant": "roll1"}
    return campaign_file.of_options(
        "roundabout", choices, runs=runs, spread=spread, **settings
    ).plan()


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """A finished campaign of one process."""
    out = tmp_path_factory.mktemp("alone")
    assert main(["campaign", *LIGHT, "--runs", "20", "--out", str(out)]) == 0
    return out


def test_a_draw_depends_on_seed_and_number_alone():
    few, many, other = planned(), planned(runs=60), planned(seed=7)
    assert few.draw(3) == many.draw(3) != few.draw(4)
    assert few.draw(3).vehicle != other.draw(3).vehicle


def test_draws_fill_the_spread_and_leave_the_design_alone():
    spread = variation.spread_from({"roll_damping": "0.5", "sprung_mass": "0", "speed": "0.1"})
    plan = planned(runs=256, spread=spread)
    columns, settings = plan.draws(0)
    names = dict(zip(plan.space.names, plan.space.distributions, strict=True))
    assert "vehicle.sprung_mass" not in names
    for name, distribution in names.items():
        values = np.concatenate([plan.draws(chunk)[0][name] for chunk in range(plan.chunks)])
        low, high = distribution.extremes()
        assert low <= values.min() <= low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) <= values.max() <= high
    nominal = plan.settings
    for row, drawn in enumerate(settings):
        assert drawn.vehicle.design == nominal.vehicle.design
        factor = columns["vehicle.roll_damping"][row]
        assert drawn.vehicle.plant.roll_damping == nominal.vehicle.plant.roll_damping * factor
        assert drawn.speed == nominal.speed * columns["speed"][row]


def test_buses_and_faults_are_drawn():
    faults = ("Imu.RollRate=stuck@1", "front_left=weak:0.3")
    plan = planned(runs=60, buses=("500k", "gateway_20ms"), faults=faults)
    draws = [plan.draw(number) for number in range(60)]
    assert {draw.bus for draw in draws} == {"500k", "gateway_20ms"}
    assert {draw.faults for draw in draws} == {(), (faults[0],), (faults[1],)}


def test_a_vehicle_that_cannot_be_is_not_driven():
    """Springs that hold the body up in hardly any draw."""
    written = {"uniform": [0.05, 0.0501]}
    request = campaign_file.of_options(
        "roundabout", {}, runs=1, seed=0, spread={}, buses=[], faults=[]
    )
    name = "vehicle.roll_stiffness"
    draw = {name: campaign_file.read(written, name)}
    plan = replace(request, draw=draw, places={name: name}).plan()
    with pytest.raises(
        CanrollError, match=r"draw 0: no valid vehicle.*factors: \{ uniform = \[0\.9"
    ):
        plan.draw(0)


def test_without_spread_every_draw_is_the_run_of_its_seed():
    rows = drive_chunk(planned(runs=2, spread={}), 1)
    run = experiment.run("roundabout", law="lqr", plant="roll1", seed=1)
    assert rows["controlled_roll_max_deg"][0] == run.controlled_metrics.roll_max_deg
    assert rows["passive_roll_max_deg"][0] == run.passive_metrics.roll_max_deg
    assert (rows["verdict"][0] == "helps") == run.helps


def test_the_table_holds_every_draw(alone):
    table = pq.read_table(alone / "campaign.parquet")
    assert table["draw"].to_pylist() == list(range(20))
    data = json.loads((alone / "campaign.json").read_text())
    assert data["runs"] == 20
    assert data["probabilities"]["fails"]["count"] == 0
    assert data["probabilities"]["fails"]["high"] == pytest.approx(0.1684, abs=1e-4)
    roll = np.array(table["controlled_roll_max_deg"])
    found = data["quantiles"]["roll_max_deg"]["controlled"]
    assert (found["min"], found["max"]) == (roll.min(), roll.max())
    assert found["p50"] == pytest.approx(np.percentile(roll, 50, method="lower"), rel=1e-3)


def test_processes_change_nothing(alone, tmp_path):
    assert main(["campaign", *LIGHT, "--jobs", "2", "--runs", "20", "--out", str(tmp_path)]) == 0
    name = "campaign.parquet"
    assert (tmp_path / name).read_bytes() == (alone / name).read_bytes()
    assert len(list((tmp_path / "campaign").glob("*.parquet"))) == 20


def first_chunks(alone, folder, count):
    """Copy what a process that was killed after ``count`` chunks leaves."""
    (folder / "campaign").mkdir()
    for chunk in sorted((alone / "campaign").glob("*.parquet"))[:count]:
        shutil.copy(chunk, folder / "campaign")
    shutil.copy(alone / "campaign" / "plan.json", folder / "campaign")


def test_an_unfinished_campaign_is_resumed_and_never_overwritten(alone, tmp_path, capsys):
    options = ["campaign", *LIGHT, "--runs", "20", "--out", str(tmp_path)]
    first_chunks(alone, tmp_path, 10)
    assert main(options) == 2
    assert "holds an unfinished campaign (10 chunks)" in capsys.readouterr().err
    assert main([*options, "--resume", "--runs", "21"]) == 2
    assert "this one differs in runs" in capsys.readouterr().err
    assert main([*options, "--resume"]) == 0
    name = "campaign.parquet"
    assert (tmp_path / name).read_bytes() == (alone / name).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("changed", ["own.dbc", "own.toml", "progressive.py"])
def test_another_file_of_the_same_name_is_another_campaign(tmp_path, changed):
    """What a draw reads besides its choices: resumed with it changed, the table would be mixed."""
    examples = Path(__file__).parents[4] / "examples"
    for name in ("own_bus/own.dbc", "own_bus/own.toml", "own_stage/progressive.py"):
        shutil.copy(examples / name, tmp_path)
    choices = {
        "law": "lqr",
        "dbc": str(tmp_path / "own.dbc"),
        "map": str(tmp_path / "own.toml"),
        "stage": str(tmp_path / "progressive.py"),
    }
    request = campaign_file.of_options(
        "roundabout", choices, runs=6, seed=0, spread={}, buses=[], faults=[]
    )
    digest = request.plan().digest
    assert request.plan().digest == digest
    path = tmp_path / changed
    path.write_text(path.read_text() + "\n")
    assert request.plan().digest != digest


def test_a_damaged_chunk_is_named(alone, tmp_path, capsys):
    options = ["campaign", *LIGHT, "--runs", "20", "--out", str(tmp_path)]
    first_chunks(alone, tmp_path, 1)
    chunk = tmp_path / "campaign" / "0000000.parquet"
    chunk.write_bytes(chunk.read_bytes()[:500])
    capsys.readouterr()
    assert main([*options, "--resume"]) == 2
    error = capsys.readouterr().err
    assert "0000000.parquet: not a chunk of a campaign" in error
    assert error.count("\n") == 1


@pytest.mark.slow
def test_it_stops_when_the_width_is_reached(tmp_path, capsys):
    options = ["campaign", *LIGHT, "--runs", "32", "--until", "0.4", "--out", str(tmp_path)]
    assert main([*options, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    found = data["probabilities"]["fails"]
    assert found["interval"] == "at any time"
    assert found["high"] - found["low"] <= 0.4
    assert data["runs"] < 32
    plan, until = planned(runs=32), study.Until("fails", 0.4)
    driven = study.run(plan, study.Means(), until=until)
    assert driven.summary.draws == data["runs"]


@pytest.mark.slow
def test_a_law_that_oscillates_fails_and_its_draw_can_be_seen_alone(tmp_path, capsys):
    options = ["campaign", "--law", "hinf_delay", "--gains", "theorem", "--unverified"]
    options += ["--jobs", "1", "--json"]
    options += ["--actuator", "suspension", "--runs", "2"]
    assert main([*options, "--out", str(tmp_path)]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["failed"]
    for draw in data["worst"]:
        assert (draw["verdict"] == LIMIT_CYCLE) == (draw["draw"] in data["failed"])
    page = (tmp_path / "campaign.html").read_text()
    assert f"Control is good in {2 - len(data['failed'])} of 2 runs" in page
    again = data["command"].split()[1:]
    assert main([*again, "--json", "--only", str(data["hardest"])]) == 1
    alone = json.loads(capsys.readouterr().out)
    worst = data["worst"][0]
    for name, value in alone["controlled"].items():
        assert worst[f"controlled_{name}"] == value
    assert alone["limit_cycle"] is not None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--spread", "roll_stifness=0.2"], "did you mean 'roll_stiffness'?"),
        (["--spread", "roll_stiffness=1.5"], "a fraction from 0 to 0.99"),
        (["--spread", "estimate_error=0.3"], "a fraction from 0 to 0.2"),
        (["--spread", "roll_stiffness"], "expected key=value"),
        (["--law", "passive"], "has no control to evaluate"),
        (["--runs", "0"], "--runs must be at least 1, got 0"),
        (["--jobs", "0"], "--jobs must be at least 1, got 0"),
        (["--bus", "500k,500"], "did you mean '500k'?"),
        (["--fault", "Imu.RollRate=stick"], "did you mean 'stuck'?"),
        (["--only", "-1"], "must be at least 0"),
        (["--only", "7", "--runs", "7"], "the campaign has the draws 0 to 6"),
        (["--resume", "--json"], "add --out"),
        (["--until", "2"], "must be above 0 and below 1"),
        (["--scheduler", "host:8786"], "must be local or an address"),
        (["fishhok"], "did you mean 'fishhook'?"),
        (["fishhook", "j_turn"], "j_turn"),
        (["nowhere.toml"], "nowhere.toml: not a campaign file"),
    ],
)
def test_what_cannot_be_is_one_line(tmp_path, monkeypatch, capsys, options, message):
    monkeypatch.chdir(tmp_path)
    assert main(["campaign", *options]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_without_pyarrow_the_extra_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow.parquet", None)
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    assert main(["campaign", *LIGHT, "--out", str(tmp_path)]) == 2
    assert "pip install 'canroll[campaign]'" in capsys.readouterr().err
    assert main(["campaign", *LIGHT, "--runs", "2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["runs"] == 2
    assert not list(Path(tmp_path).glob("*"))


def test_a_campaign_from_python_has_the_table_of_the_command(alone):
    found = study.campaign("roundabout", runs=20, law="lqr", plant="roll1")
    rows = pq.read_table(alone / "campaign.parquet").to_pylist()
    assert list(found.table) == rows
    assert (
        found.to_json()["quantiles"]
        == json.loads((alone / "campaign.json").read_text())["quantiles"]
    )


def test_a_campaign_from_python_continues_in_its_folder(tmp_path):
    choices = {"runs": 8, "law": "lqr", "plant": "roll1", "folder": tmp_path / "kept"}
    first = study.campaign("roundabout", **choices)
    again = []
    second = study.campaign("roundabout", **choices, watch=lambda _, kept: again.append(kept))
    assert again[-1] == 8
    assert list(first.table) == list(second.table)
    assert second.file is not None
    assert second.file.is_file()


def test_the_hardest_draw_is_that_of_the_metric(capsys):
    assert main(["campaign", *LIGHT, "--runs", "8", "--worst-by", "roll_max_deg"]) == 0
    assert "hardest (failures first, then by largest roll_max_deg): draw" in capsys.readouterr().out
    table = study.campaign("roundabout", runs=8, law="lqr", plant="roll1").table
    rolls = table.column("controlled_roll_max_deg")
    assert main(["campaign", *LIGHT, "--runs", "8", "--worst-by", "roll_max_deg", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["hardest"], data["worst_by"]) == (rolls.index(max(rolls)), "roll_max_deg")
    assert main(["campaign", *LIGHT, "--worst-by", "roll_max_degr"]) == 2
    assert "did you mean 'roll_max_deg'?" in capsys.readouterr().err
