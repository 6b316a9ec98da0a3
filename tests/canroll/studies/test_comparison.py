import json
from dataclasses import replace

import numpy as np
import pytest

import canroll
from canroll.cli.main import main
from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.driving.standards import Verdict
from canroll.runs.standard import Standard, StandardJudgement
from canroll.studies.comparison import Named, describe, parse_range, runs
from canroll.studies.comparison_page import best, sweep_page


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("60:160:20", [60, 80, 100, 120, 140, 160]),
        ("60:155:20", [60, 80, 100, 120, 140]),
        ("0.1:0.3:0.1", [0.1, 0.2, 0.3]),
        ("100:60:-20", [100, 80, 60]),
        ("80:100", [80, 90, 100]),
        ("50,70", [50, 70]),
        ("80", [80]),
    ],
)
def test_ranges(text, numbers):
    assert parse_range(text) == pytest.approx(numbers)


@pytest.mark.parametrize("text", ["a:b:c", "60:160:0", "", "1:2:3:4", "nan:1:1"])
def test_what_is_no_range(text):
    with pytest.raises(CanrollError, match=rf"invalid range '{text}' \(expected FROM:TO:STEP"):
        parse_range(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("160:60:20", "the step leads away from the end"),
        ("60:160:-20", "the step leads away from the end"),
        ("0:1e9:1", "at most 1000 numbers"),
    ],
)
def test_a_range_without_numbers_or_with_too_many_is_refused(text, message):
    with pytest.raises(CanrollError, match=f"invalid range '{text}': {message}"):
        parse_range(text)


def test_descriptions_of_runs():
    assert describe("lqr") == {"law": "lqr"}
    assert describe("mine/calibration.toml") == {"calibration": "mine/calibration.toml"}
    assert describe("law=lqr,tick=5,speed=90,seed=3") == {
        "law": "lqr", "tick_ms": 5.0, "speed_kmh": 90.0, "seed": 3,
    }  # fmt: skip


@pytest.mark.parametrize("text", ["lqq", "las=lqr", "law"])
def test_unknown_names_in_descriptions(text):
    with pytest.raises(UnknownNameError):
        describe(text)


def test_a_number_that_is_none():
    with pytest.raises(CanrollError, match="tick=fast: 'fast' is not a number"):
        describe("tick=fast")


def test_runs_that_differ_in_their_law_share_the_run_without_control():
    first, second, other = runs(
        "double_lane_change",
        [("a", {"law": "lqr"}), ("b", {"law": "smc"}), ("c", {"law": "lqr", "seed": 1})],
        {"vehicle": "van_2021"},
        duration=1.0,
    )
    assert first.result.passive is second.result.passive
    assert other.result.passive is not first.result.passive
    assert first.result.record.id != second.result.record.id


def test_compare_writes_a_page_and_the_numbers(tmp_path, capsys):
    arguments = ["compare", "lqr", "law=lqr,actuator=bars", "--duration", "1.5", "--json"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    data = json.loads(capsys.readouterr().out)
    assert [run["name"] for run in data["runs"]] == ["lqr", "law=lqr,actuator=bars"]
    assert data["runs"][1]["actuator"] == "bars"
    page = (tmp_path / "comparison.html").read_text()
    assert 'data-key="runs.1.controlled.roll_max_deg"' in page
    assert json.loads((tmp_path / "comparison.json").read_text())["runs"] == data["runs"]


def test_saved_runs_are_compared_as_driven_ones(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for law in ("steering_lead", "ay_feedforward"):
        options = ["--law", law, "--duration", "1.5", "--out", law + "_run", "--json"]
        assert main(["run", "double_lane_change", *options]) == 0
    capsys.readouterr()
    saved = ["steering_lead_run", "ay_feedforward_run"]
    assert main(["compare", "smc", *saved, "--duration", "1.5", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert [run["name"] for run in data["runs"]] == ["smc", *saved]
    for law, run in zip(("steering_lead", "ay_feedforward"), data["runs"][1:], strict=True):
        told = json.loads((tmp_path / f"{law}_run" / "result.json").read_text())
        del told["schema"], told["sha256"], told["vehicle_sha256"], told["vehicle_document"]
        assert {**run, "name": None} == {**told, "name": None}
    assert main(["compare", *saved]) == 0
    assert "warning" not in capsys.readouterr().out
    page = (tmp_path / "out" / "comparison.html").read_text()
    assert 'data-key="runs.1.controlled.roll_max_deg"' in page
    other = ["steering_lead", "--scenario", "roundabout", "--duration", "1"]
    assert main(["compare", "steering_lead_run", *other]) == 2
    assert "compare runs of one manoeuvre" in capsys.readouterr().err


@pytest.mark.slow
def test_one_run_alone_has_its_numbers_and_processes_change_nothing(capsys):
    """A run has its number among all words, saved or not; over speeds law by law."""
    for command in (
        ["compare", "lqr", "smc", "law=lqr,bus=125k_busy", "--duration", "1"],
        ["compare", "lqr", "smc", "--speed", "60:80:20"],
    ):
        told = []
        for options in (["--jobs", "2"], ["--jobs", "1"], ["--only", "2"]):
            assert main([*command, *options, "--json"]) == 0
            data = json.loads(capsys.readouterr().out)
            told.append(data.get("runs") or [run for law in data["laws"].values() for run in law])
        assert told[0] == told[1]
        assert told[2] == [told[0][2]]


def test_another_car_is_told(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = ["compare", "law=lqr,vehicle=van_2021", "law=lqr,vehicle=van_real"]
    assert main([*arguments, "--duration", "2"]) == 0
    assert "law=lqr,vehicle=van_real differs in vehicle" in capsys.readouterr().out


def test_laws_are_compared_over_speeds(tmp_path, capsys):
    arguments = ["compare", "lqr", "ay_feedforward", "--speed", "60:80:20"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    assert "lqr (deg)" in capsys.readouterr().out
    data = json.loads((tmp_path / "comparison.json").read_text())
    assert [run["speed_kmh"] for run in data["laws"]["lqr"]] == [60, 80]
    assert all(run["helps"] for runs in data["laws"].values() for run in runs)
    assert "60 to 80 km/h" in (tmp_path / "comparison.html").read_text()


@pytest.mark.parametrize(
    "arguments",
    [
        ["compare", "lqr", "lqr"],
        ["compare", "lqq"],
        ["compare", "--speed", "fast"],
        ["compare", "lqr", "smv", "--speed", "60:80:20"],
        ["compare"],
        ["compare", "lqr", "--scenario", "nosuch"],
    ],
)
def test_usage_errors(arguments, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("run", ["law=lqr,vehicle=suv_2020", "mine/calibration.toml"])
def test_a_changed_vehicle_is_not_overridden_in_silence(run, capsys):
    assert main(["compare", run, "smc", "--vehicle-set", "plant.sprung_mass=2000"]) == 2
    assert f"--vehicle-set: {run} has its vehicle already" in capsys.readouterr().err


@pytest.fixture(scope="module")
def short():
    wanted = [("lqr", {"law": "lqr"}), ("steering_lead", {"law": "steering_lead"})]
    return runs("double_lane_change", wanted, {}, duration=1.5)


def hitting(run, cones):
    hit = StandardJudgement((Verdict("cones hit", "ISO 3888-1, 4", cones, 0.0, "", cones == 0),))
    return Named(run.name, replace(run.result, standard=Standard("ISO 3888-1", hit, hit)))


def test_what_meets_the_standard_comes_before_less_roll(short):
    least = best(short)
    assert least.good is True
    other = next(run for run in short if not least.headline.endswith(run.name))
    judged = [hitting(run, 0.0 if run is other else 3.0) for run in short]
    assert (best(judged).good, best(judged).headline) == (True, f"Least roll: {other.name}")
    none = best([hitting(run, 3.0) for run in short])
    assert (none.good, none.headline) == (None, f"{least.headline}, ISO 3888-1 not met")


def test_a_sweep_counts_where_the_standard_is_not_met(short):
    page = sweep_page({"lqr": [hitting(short[0], 0.0), hitting(short[0], 3.0)]})
    assert "Control helps in 2 of 2 runs, ISO 3888-1 not met in 1" in page
    assert 'class="verdict none"' in page


def test_laws_are_compared_from_python():
    common = {"bus": "500k", "duration": 2.0, "seed": 3}
    found = canroll.compare(["lqr", "law=passive"], **common)
    alone = canroll.run("double_lane_change", law="lqr", **common)
    assert list(found.results) == ["lqr", "law=passive"]
    assert found.results["lqr"].to_json() == alone.to_json()
    assert found.table.column("controlled_roll_max_deg") == [
        alone.controlled_metrics.roll_max_deg,
        None,
    ]
    labelled = canroll.compare(["name=mine,law=lqr"], **common)
    assert labelled.results["mine"].to_json() == alone.to_json()
    named = canroll.compare({"mine": {"law": "lqr"}}, **common)
    assert named.results["mine"].to_json() == alone.to_json()


def test_laws_are_compared_over_speeds_from_python():
    found = canroll.compare(["lqr"], speeds_kmh=[60, 80], duration=1.0)
    assert found.table.column("speed_kmh") == [60.0, 80.0]
    assert found.table.column("name") == ["lqr at 60 km/h", "lqr at 80 km/h"]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: canroll.compare([]), "wanted=[]: must be"),
        (lambda: canroll.compare(["name=a,law=lqr", "name=a,law=smc"]), "two runs have one name"),
        (lambda: canroll.compare(["lqr"], speeds_kmh=80), "speeds_kmh=80: must be"),
        (lambda: canroll.compare([1]), "wanted=[1]: must be a list of texts, or a dictionary"),
        (lambda: canroll.compare(["lqr"], speeds_kmh=np.array([])), "at least one entry"),
        (
            lambda: canroll.compare(["law=lqr,speed=80"], speeds_kmh=[60]),
            "law=lqr,speed=80: it has its speed",
        ),
        (lambda: canroll.campaign(jobs="2"), "jobs='2': must be a whole number"),
        (lambda: canroll.campaign(seed=-1), "seed -1: must be 0 to"),
        (lambda: canroll.campaign(runs=0), "runs=0: must be at least 1"),
        (lambda: canroll.campaign(buses="500q"), "unknown bus '500q': did you mean '500k'?"),
        (lambda: canroll.severe(runs="4"), "runs='4': must be a whole number"),
        (lambda: canroll.severe(runs=1), "runs=1: must be at least 2"),
        (lambda: canroll.severe(speed_kmh=80), "speed_kmh: does not apply to several"),
        (lambda: canroll.margins(3), "calibration=3: must be a LoadedCalibration, a text, or"),
        (lambda: canroll.plot(3), "result=3: must be a Result"),
        (lambda: canroll.compare(["lqr"], speed=3), "speed"),
        (lambda: canroll.campaign(jobs=0), "jobs=0: must be at least 1"),
        (lambda: canroll.campaign(spread={"mass": 0.1}), "mass"),
        (lambda: canroll.campaign(spread={"sprung_mass": "much"}), "spread sprung_mass=much"),
        (lambda: canroll.campaign("c.toml", buses=["500k", "fd_2m"]), "buses: write what is drawn"),
    ],
)
def test_an_argument_of_a_study_is_named(call, message):
    with pytest.raises(CanrollError) as refused:
        call()
    assert message in str(refused.value)
