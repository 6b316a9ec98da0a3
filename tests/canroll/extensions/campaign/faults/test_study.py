"""The catalogue of faults, and runs of a few of them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from canroll.cases.execution import Execution
from canroll.cli.main import main
from canroll.errors import CanrollError
from canroll.extensions.campaign.faults import catalogue as fault_catalogue
from canroll.extensions.campaign.faults import study as fault_study
from canroll.extensions.campaign.faults.catalogue import DOUBLE
from canroll.plant_sim.faults import parse
from canroll.reaction.visibility import Visibility
from canroll.runs import experiment

CATALOGUE = """
[[single]]
name = "inertial unit drops out"
faults = "Imu=dropout@1.6:2.6"
expect = "detected"
mode = "SAFE"

[[single]]
name = "front axle runs away"
faults = "front=runaway:-1@1.6 + rear=runaway:-1@1.6 + actuators=lying@1.6"
expect = "detected"

[[single]]
name = "command sent twice"
faults = "{command}=duplicate:1@1"
expect = "tolerated"

[[single]]
name = "gateway fails"
faults = "bus=partition@1"
expect = "detected"

[[single]]
name = "after the end"
faults = "Imu=dropout@100"
expect = "detected"

[[double]]
name = "command spoofed, inertial unit drops out"
faults = "attacker.{command}.{first}=spoof:{push}@1.2 + Imu=dropout@1.2"
expect = "detected"
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    found = tmp_path_factory.mktemp("catalogue") / "faults.toml"
    found.write_text(CATALOGUE, encoding="utf-8")
    return found


@pytest.fixture(scope="module")
def study(path):
    return fault_study.study(catalogue=path)


@pytest.fixture(scope="module")
def settings():
    return experiment.plan("double_lane_change")[0]


def by_name(study, name):
    return next(fault for fault in study.faults if fault.entry.name == name)


@pytest.mark.parametrize("actuator", ["bars", "suspension", "dampers", "valves"])
def test_the_shipped_catalogue_is_large_and_right_for_every_actuator(settings, actuator):
    command = {
        "bars": "AntiRollBarCommand",
        "suspension": "SuspensionForceCommand",
        "dampers": "DamperCommand",
        "valves": "ValveCommand",
    }[actuator]
    found = fault_catalogue.entries(replace(settings, actuator=actuator, command=command))
    singles = [entry for entry in found if entry.group != DOUBLE]
    doubles = [entry for entry in found if entry.group == DOUBLE]
    assert len(singles) >= 100 and len(doubles) >= 40
    assert len({entry.name for entry in found}) == len({entry.faults for entry in found})
    assert all(len(parse(entry.faults)) == 1 for entry in singles)
    assert all(len(parse(entry.faults)) > 1 for entry in doubles)
    assert {entry.group for entry in singles} == set(fault_catalogue.GROUPS.values())


def test_a_dropout_is_detected_in_time_and_harmless(study):
    fault = by_name(study, "inertial unit drops out")
    assert fault.detected and fault.in_time and not fault.harmful
    assert fault.as_expected
    assert 0.0 < fault.reaction.detected_after < 0.5
    assert "Imu late" in fault.reaction.detected_by


def test_actuators_that_run_away_do_harm(study):
    fault = by_name(study, "front axle runs away")
    assert fault.harmful and fault.reaction.harm_after < 2.0
    assert not fault.as_expected
    assert fault.reaction.wrong_side_max_nm > 500
    assert fault.undetected_harm != fault.detected


def test_what_can_not_be_judged_says_why(study):
    assert "no gateway" in by_name(study, "gateway fails").no_verdict
    assert "the run ends" in by_name(study, "after the end").no_verdict
    assert by_name(study, "after the end").as_expected is None


def test_coverage_counts_what_was_judged(study):
    every = study.coverage[-1]
    assert (every.faults, every.judged) == (6, 4)
    assert every.detected == sum(fault.detected for fault in study.faults)
    assert every.undetected_harm == len(study.undetected)
    assert study.exit_code == any(fault.failed for fault in study.undetected)


@pytest.mark.parametrize(
    ("visible", "code"),
    [
        (None, 1),
        (Visibility(), 1),
        (Visibility(1.5, "turn", "lateral"), 1),
        (Visibility(0.9, "turn", "lateral"), 0),
        (Visibility(0.0, "", "lateral"), 0),
    ],
    ids=["not computed", "all right", "sure", "too small", "none holds"],
)
def test_only_an_error_too_small_to_be_found_excuses_a_miss(study, visible, code):
    harm = replace(by_name(study, "front axle runs away").reaction, detected_after=None)
    fault = replace(by_name(study, "front axle runs away"), reaction=harm, visibility=visible)
    alone = replace(study, faults=(fault,))
    assert alone.exit_code == code
    assert f"({1 - code} of them too small" in alone.verdict


def test_the_run_without_faults_finds_none(study):
    assert not study.false_alarm and not study.reference.harm


def test_the_result_does_not_depend_on_the_number_of_processes(study, path):
    with Execution(jobs=2).cases() as cases:
        again = fault_study.study(catalogue=path, cases=cases)
    assert json.dumps(again.to_json()) == json.dumps(study.to_json())


def test_the_command_prints_what_the_study_found(path, study, capsys):
    assert main(["faults", "--catalogue", str(path), "--jobs", "1", "--json"]) == study.exit_code
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(study.to_json()))
    assert main(["faults", "--catalogue", str(path), "--jobs", "1"]) == study.exit_code
    text = capsys.readouterr().out
    assert study.verdict in text
    assert "gateway fails: " in text


def test_one_fault_alone_is_its_row_of_the_study(path, study, tmp_path, capsys):
    options = ["--catalogue", str(path), "--only", "1", "--out", str(tmp_path)]
    main(["faults", *options, "--json"])
    expected = json.loads(json.dumps(study.faults[1].to_json()))
    assert json.loads(capsys.readouterr().out)["faults"] == [expected]
    assert json.loads((tmp_path / "faults.json").read_text())["faults"] == [expected]
    main(["faults", *options])
    assert study.faults[1].entry.name in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "no entry"),
        ("[[singles]]", "did you mean 'single'?"),
        ('[[single]]\nname = "a"\nfaults = "Imu=dropout"', "expect is missing"),
        ('[[single]]\nname = "a"\nfaults = "Imu=dropuot"\nexpect = "detected"', "'dropout'"),
        ('[[single]]\nname = "a"\nfaults = "Imu=dropout"\nexpect = "detect"', "'detected'"),
        (
            '[[single]]\nname = "a"\nfaults = "Imu=dropout"\nexpect = "detected"\nmode = "SAVE"',
            "'SAFE'",
        ),
        ("single = 3", r"write each entry as a table"),
        ("[[", "faults.toml"),
    ],
)
def test_what_is_wrong_in_a_catalogue_is_named(text, expected, settings, tmp_path):
    path = tmp_path / "faults.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CanrollError, match=expected) as raised:
        fault_catalogue.entries(settings, path)
    assert "faults.toml" in str(raised.value)


def test_a_run_with_faults_says_what_was_detected_and_the_harm(capsys):
    command = ["run", "double_lane_change", "--json", "--fault"]
    assert main([*command, "Imu=dropout@3.0:4.0"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert "fault detected after" in data["verdict"] and "no harm" in data["verdict"]
    assert [change["mode"] for change in data["reaction"]["modes"]][:3] == [
        *("INIT", "ACTIVE", "SAFE"),
    ]
    runaway = "actuators=runaway:-1@1.6 + actuators=lying@1.6"
    assert main([*command, runaway]) == 1
    assert json.loads(capsys.readouterr().out)["verdict"].startswith("Harmful: ")


def test_the_passive_vehicle_of_a_faulted_run_has_no_faults():
    plain = experiment.run("double_lane_change", duration=2.0)
    faulted = experiment.run("double_lane_change", duration=2.0, faults=["front=runaway:1@1"])
    np.testing.assert_array_equal(plain.passive.signals["roll"], faulted.passive.signals["roll"])


@pytest.mark.parametrize(
    ("options", "expected"),
    [(["--law", "passive"], "choose another law"), (["--jobs", "0"], "--jobs must be at least 1")],
)
def test_impossible_options_are_refused(options, expected, capsys):
    assert main(["faults", *options]) == 2
    assert expected in capsys.readouterr().err
