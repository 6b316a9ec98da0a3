"""Whole runs of a car whose bus carries no roll rate."""

import re
from pathlib import Path

import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.firmware.plausibility import FAULT_ACTUATOR_CONTRADICTED
from canroll.firmware.state import ACTIVE, SAFE
from canroll.plant_sim.can_bus import ECU
from canroll.runs import experiment
from canroll.setup.bus_frames import check_frames

OWN_BUS = Path(__file__).parents[3] / "examples" / "own_bus"
LAW = {"law": "lqr", "observer": "acceleration"}
NO_ROLL_RATE = ["Imu.RollRate=invalid"]
WELL_KNOWN = {"mass": 0.05, "height": 0.02, "stiffness": 0.05}
"""A car with a load sensor and measured springs."""


@pytest.mark.parametrize("plant", ["nonlinear", "linear_car"])
def test_roll_is_reduced_as_with_the_gyro(plant):
    alone, both = (
        experiment.run("double_lane_change", law="lqr", observer=observer, plant=plant, faults=gone)
        for observer, gone in (("acceleration", NO_ROLL_RATE), ("two_sensors", []))
    )
    assert alone.controlled.ticks["mode"][-1] == ACTIVE
    assert not alone.controlled.ticks["fault_codes"].any()
    found, known = (result.controlled_metrics.roll_rms_deg for result in (alone, both))
    assert found < 0.6 * alone.passive_metrics.roll_rms_deg
    assert found < 1.05 * known


@pytest.mark.parametrize("observer", ["acceleration", "acceleration_propagated"])
def test_the_ecu_sends_the_same_with_any_roll_rate(observer):
    sent = []
    for faults in ([], NO_ROLL_RATE, ["Imu.RollRate=offset:0.8@1"]):
        result = experiment.run(
            "double_lane_change", law="lqr", observer=observer, faults=faults, duration=3.0
        )
        frames = result.controlled.frames
        sent.append(frames[frames["sender"] == ECU]["payload"])
    assert len(sent[0]) > 100
    for other in sent[1:]:
        np.testing.assert_array_equal(sent[0], other)


def test_a_bank_is_no_roll_of_the_body_but_a_lateral_acceleration():
    """In a steady curve: what g × bank adds rolls the body on its springs, as a_y does."""
    errors = {}
    for bank in (-5.0, 0.0, 5.0):
        trace = experiment.run("banked_curve", **LAW, options={"bank_deg": bank}).controlled
        ticks, signals = trace.ticks[-100:], trace.signals
        true = {
            name: np.interp(ticks["t"], signals["time"], signals[name]) for name in ("roll", "ay")
        }
        errors[bank] = np.degrees(np.mean(ticks["roll"] - true["roll"]))
        felt = np.mean(ticks["lateral_acceleration"] - true["ay"])
        assert felt == pytest.approx(9.81 * np.sin(np.radians(bank)), abs=0.15)
    assert max(errors.values()) - min(errors.values()) < 0.05


@pytest.mark.parametrize("watched", [True, False])
def test_an_axle_of_a_well_known_car_that_lies_is_still_found_by_the_other(watched):
    settings, controller = experiment.plan(
        "double_lane_change",
        **LAW,
        actuator="bars",
        faults=[*NO_ROLL_RATE, "front=reversed@1.6 + front=lying@1.6"],
        response_watch=watched,
        uncertainty=WELL_KNOWN,
    )
    ticks = experiment.drive(settings, controller, enabled=True).ticks
    codes = np.bitwise_or.reduce(ticks["fault_codes"])
    assert ticks["mode"][-1] == (SAFE if watched else ACTIVE)
    assert codes == watched << FAULT_ACTUATOR_CONTRADICTED


def test_identification_needs_the_roll_rate():
    with pytest.raises(CanrollError, match="--identification needs the measured roll rate"):
        experiment.plan("double_lane_change", **LAW, identification=True)


@pytest.mark.slow
def test_a_map_without_the_roll_rate_takes_this_observer_alone(tmp_path):
    text = (OWN_BUS / "own.toml").read_text(encoding="utf-8")
    path = tmp_path / "map.toml"
    path.write_text(re.sub("signals.GY_RollRate = .*\n", "", text, count=1))
    files = {"dbc": str(OWN_BUS / "own.dbc"), "map": str(path), "actuator": "suspension"}
    settings, controller = experiment.plan("double_lane_change", **LAW, **files)
    assert check_frames(settings.profile, controller.record) == ()
    result = experiment.run("double_lane_change", **LAW, **files)
    assert result.controlled.ticks["mode"][-1] == ACTIVE
    assert result.helps
    remedy = r"roll_rate, .* design with --law lqr --observer acceleration"
    with pytest.raises(CanrollError, match=remedy):
        experiment.plan("double_lane_change", law="lqr", **files)
    path.write_text(re.sub("signals.GY_LateralAcceleration = .*\n", "", text, count=1))
    with pytest.raises(CanrollError, match="no signal is mapped to lateral_acceleration"):
        experiment.plan("double_lane_change", **LAW, **files)
