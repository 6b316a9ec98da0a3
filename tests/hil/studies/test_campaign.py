"""Monte Carlo: what is drawn, that it can be drawn again, and the verdict."""

import json
from dataclasses import replace

import pytest

from canroll.errors import CanrollError, UnknownNameError
from hil.cli.main import main
from hil.runs import experiment
from hil.studies import campaign, variation
from vehicles.check import problems


@pytest.fixture(scope="module")
def nominal():
    return experiment.plan("double_lane_change", law="lqr")[0]


def test_a_draw_depends_on_seed_and_index_alone(nominal):
    def factors(index, seed):
        spread = variation.DEFAULT_SPREAD
        return variation.draw(nominal, index, spread=spread, seed=seed).factors

    assert factors(3, 7) == factors(3, 7)
    assert factors(3, 7) != factors(3, 8)
    assert factors(3, 7) != factors(4, 7)


def test_draws_fill_the_spread_and_leave_the_design_alone(nominal):
    spread = variation.spread_from({"roll_damping": "0.5", "sprung_mass": "0", "speed": "0.1"})
    draws = [variation.draw(nominal, i, spread=spread, seed=0) for i in range(200)]
    for name, share in spread.items():
        values = [draw.factors.get(name, 1.0) for draw in draws]
        assert 1 - share <= min(values) <= 1 - 0.9 * share
        assert 1 + 0.9 * share <= max(values) <= 1 + share
    for draw in draws:
        vehicle, settings = draw.settings.vehicle, draw.settings
        assert vehicle.design == nominal.vehicle.design
        assert vehicle.plant.sprung_mass == nominal.vehicle.plant.sprung_mass
        damping = nominal.vehicle.plant.roll_damping * draw.factors["roll_damping"]
        assert vehicle.plant.roll_damping == damping
        assert settings.speed == nominal.speed * draw.factors["speed"]
        assert not any(problems(vehicle))


def test_buses_and_faults_are_drawn(nominal):
    faults = ("Imu.RollRate=stuck@1", "front_left=weak:0.3")
    draws = [
        variation.draw(
            nominal,
            i,
            spread=variation.DEFAULT_SPREAD,
            seed=0,
            buses=("500k", "gateway_20ms"),
            faults=faults,
        )
        for i in range(60)
    ]
    assert {draw.settings.bus for draw in draws} == {"500k", "gateway_20ms"}
    assert {draw.settings.faults for draw in draws} == {(), (faults[0],), (faults[1],)}


def test_a_vehicle_that_cannot_be_is_not_driven(nominal):
    """Springs that do not hold the body up in any draw."""
    plant = nominal.vehicle.plant
    soft = replace(plant, roll_stiffness=0.5 * plant.roll_arm * 9.81)
    fallen = replace(nominal, vehicle=replace(nominal.vehicle, plant=soft))
    with pytest.raises(CanrollError, match="--spread"):
        variation.draw(fallen, 0, spread=variation.DEFAULT_SPREAD, seed=0)


def test_without_spread_every_draw_is_the_run_of_its_seed():
    still = dict.fromkeys(variation.DEFAULT_SPREAD, 0.0)
    found = campaign.run("double_lane_change", runs=2, spread=still, law="lqr")
    for index, outcome in enumerate(found.outcomes):
        run = experiment.run("double_lane_change", law="lqr", seed=index)
        assert outcome.controlled["roll_max_deg"] == run.controlled_metrics.roll_max_deg
        assert outcome.passive["roll_max_deg"] == run.passive_metrics.roll_max_deg
        assert outcome.verdict == campaign.HELPS


def test_processes_change_nothing():
    alone, shared = (
        campaign.run("double_lane_change", runs=3, jobs=jobs, law="lqr").to_json()
        for jobs in (1, 2)
    )
    assert alone == shared
    roll = [outcome["controlled"]["roll_max_deg"] for outcome in alone["outcomes"]]
    found = alone["quantiles"]["roll_max_deg"]["controlled"]
    assert (found["min"], found["p50"], found["max"]) == tuple(sorted(roll))


def test_a_law_that_swings_fails_and_its_draw_can_be_seen_alone(tmp_path, capsys):
    options = ["campaign", "--law", "hinf_delay", "--gains", "theorem", "--jobs", "1", "--json"]
    options += ["--actuator", "suspension"]
    assert main([*options, "--runs", "2", "--out", str(tmp_path)]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["failed"]
    for outcome in data["outcomes"]:
        failed = outcome["index"] in data["failed"]
        assert (outcome["verdict"] == campaign.LIMIT_CYCLE) == failed
    assert json.loads((tmp_path / "campaign.json").read_text())["failed"] == data["failed"]
    page = (tmp_path / "campaign.html").read_text()
    assert f"Control is good in {2 - len(data['failed'])} of 2 runs" in page
    assert main([*options, "--only", str(data["hardest"])]) == 1
    alone = json.loads(capsys.readouterr().out)
    worst = next(o for o in data["outcomes"] if o["index"] == data["hardest"])
    assert alone["controlled"] == worst["controlled"]
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
    ],
)
def test_what_cannot_be_is_one_line(capsys, options, message):
    assert main(["campaign", *options]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_an_unknown_quantity_is_named():
    with pytest.raises(UnknownNameError, match="friction"):
        variation.spread_from({"frictoin": "0.1"})
