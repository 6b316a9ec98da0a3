"""Faults and conditions from the command line, and what they do to a run."""

import numpy as np
import pytest

from canroll import dbc
from canroll.cli.main import main
from canroll.errors import CanrollError
from canroll.runs import conditions, experiment

SHORT = 2.0


def test_conditions_reach_their_options():
    sensors, actuators = conditions.options(
        {
            "noise": "0",
            "filtered": "off",
            "synchronous": True,
            "temperature": "-40",
            "phases.Imu": "0.003",
            "lsb.Imu.RollRate": 0.01,
            "supply": 10,
            "oil_temperature": "-20",
        }
    )
    assert (sensors.noise, sensors.filtered, sensors.synchronous) == (0.0, False, True)
    assert (sensors.temperature, sensors.delayed) == (-40.0, True)
    assert (sensors.phases, sensors.lsb) == ({"Imu": 0.003}, {"Imu.RollRate": 0.01})
    assert (actuators.supply, actuators.oil_temperature) == (10.0, -20.0)


@pytest.mark.parametrize(
    ("option", "text", "expected"),
    [
        ("--fault", "Imu.RolRate=stuck@3", "did you mean 'Imu.RollRate'?"),
        ("--fault", "frontleft=stuck@3", "did you mean 'front_left'?"),
        ("--fault", "front_left=stock", "did you mean 'stuck'?"),
        ("--fault", "Imu.RollRate=weak", "unknown fault of Imu.RollRate 'weak'"),
        ("--fault", "Imu.RollRate", "write WHERE=KIND"),
        ("--fault", "Imu.RollRate=stuck@", "write WHERE=KIND"),
        ("--fault", "Imu.RollRate=stuck@x", "write WHERE=KIND"),
        ("--fault", "Imu.RollRate=stuck@1:2:3", "does not take a ramp"),
        ("--fault", "Imu.RollRate=offset:1@1:2:3:4", "write WHERE=KIND"),
        ("--fault", "Imu.RollRate=stuck@1,ever=1", "did you mean 'every'?"),
        ("--fault", "Imu.RollRate=stuck,every=1", "needs every and for"),
        ("--fault", "AntiRollBarCommand=dropout", "unknown fault of AntiRollBarCommand"),
        ("--fault", "Imu.RollRate=stuck@5:3", "before END"),
        ("--fault", "Imu.RollRate=stuck@nan", "before END"),
        ("--fault", "Imu.RollRate=stuck:1", "does not take a value"),
        ("--fault", "Imu.RollRate=offset@1", "needs a value"),
        ("--fault", "Imu.RollRate=offset:inf", "finite"),
        ("--fault", "front_left=weak:2", "must be 0 to 1"),
        ("--condition", "suply=10", "did you mean 'supply'?"),
        ("--condition", "supply", "expected key=value"),
        ("--condition", "supply=low", "'low' is not a number"),
        ("--condition", "supply=-1", "not below 0"),
        ("--condition", "noise=nan", "finite"),
        ("--condition", "delayed=maybe", "delayed must be on or off"),
        ("--condition", "phases.Imo=0.001", "did you mean 'Imu'?"),
        ("--condition", "lsb.Imu.RollRat=0.001", "did you mean 'Imu.RollRate'?"),
        ("--condition", "estimate_error=0.5", "from -0.2 to 0.2"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(option, text, expected, capsys):
    assert main(["run", "double_lane_change", "--json", option, text]) == 2
    error = capsys.readouterr().err
    assert error.startswith("canroll: ") and error.count("\n") == 1
    assert expected in error


def test_more_faults_than_a_run_has_room_for():
    with pytest.raises(CanrollError, match="at most 32"):
        experiment.run("roundabout", duration=SHORT, faults=["Imu.RollRate=stuck@1"] * 33)


def test_a_stuck_sensor_repeats_its_value_on_the_bus():
    faults = ["Imu.RollRate=stuck@1:1.5"]
    result = experiment.run("double_lane_change", duration=SHORT, law="lqr", faults=faults)
    frames = result.controlled.frames[result.controlled.frames["ident"] == 0xA0]
    decode = dbc.load().get_message_by_name("Imu").decode
    rates = np.array([decode(bytes(frame["payload"][:8]))["RollRate"] for frame in frames])
    time = frames["t_queued"] * 1e-9
    assert len(set(rates[(time > 1.03) & (time < 1.5)])) == 1
    assert len(set(rates[time < 1.0])) > 5 and len(set(rates[time > 1.53])) > 5


def test_a_floating_actuator_and_a_dead_battery_deliver_nothing():
    fault = experiment.run(
        "double_lane_change",
        duration=SHORT,
        law="lqr",
        actuator="suspension",
        faults=["front_left=floating"],
    )
    assert not np.any(fault.controlled.signals["corner_force_front_left"])
    assert np.any(fault.controlled.signals["corner_force_front_right"])
    dead = experiment.run(
        "double_lane_change", duration=SHORT, law="lqr", conditions={"supply": 8.0}
    )
    assert dead.controlled_metrics.moment_max_nm == 0
    assert dead.to_json()["conditions"] == {"supply": 8.0}


def test_what_makes_sensors_worse_is_part_of_the_help(capsys):
    with pytest.raises(SystemExit):
        main(["run", "--help"])
    text = capsys.readouterr().out
    assert all(name in text for name in ("--fault", "stuck@3:5", "--condition", "oil_temperature"))
    for name in (*conditions.SENSOR_CONDITIONS, *conditions.ACTUATOR_CONDITIONS):
        assert name in text
