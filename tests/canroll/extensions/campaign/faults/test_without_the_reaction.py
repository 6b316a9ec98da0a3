"""A fault without the reaction to it, and a reaction that is worse than the fault."""

from dataclasses import replace

import numpy as np
import pytest

from canroll.extensions.campaign.faults.catalogue import CatalogueEntry
from canroll.extensions.campaign.faults.study import StudiedLoop, judge
from canroll.firmware.state import ACTIVE, INIT
from canroll.gain_gen.calibration.record import copied, identify
from canroll.reaction import switched_off
from canroll.runs.experiment import drive, plan
from canroll.runs.metrics import peak

FAULT = "Imu=dropout@1.33:1.63"


@pytest.fixture(scope="module")
def turn():
    """A J-turn in which forces hold the car, without faults: settings, controller, runs."""
    settings, controller = plan("j_turn", law="lqr", actuator="suspension")
    passive = drive(settings, controller, enabled=False)
    return settings, controller, passive, drive(settings, controller, enabled=True)


@pytest.mark.parametrize(
    "fault", ["Imu=dropout@1", "front=floating@1", "VehicleMotion.VehicleSpeed=scale:0@1"]
)
def test_no_finding_changes_the_mode(turn, fault):
    settings, controller, *_ = turn
    settings = replace(settings, faults=(switched_off.unreported(fault),))
    record = switched_off.unsupervised(controller.record)
    trace = drive(settings, replace(controller, record=record), enabled=True, duration=2.0)
    assert set(trace.ticks["mode"].tolist()) == {INIT, ACTIVE}


def test_actuators_report_no_failure_as_long_as_it_lasts():
    assert switched_off.unreported("Imu=dropout@1") == "Imu=dropout@1"
    failing = switched_off.unreported("front=weak:0.3@1:2:0.5 + Imu=dropout@1")
    assert failing == "front=weak:0.3@1:2:0.5 + Imu=dropout@1 + front=lying@1.0:2.0"


def falls_at_once(record):
    """The calibration of an ECU that lets go within two ticks."""
    changed = type(record)()
    for name in vars(record):
        setattr(changed, name, copied(getattr(record, name)))
    changed.release_ticks = 2
    return identify(changed)


@pytest.mark.parametrize("at_once", [False, True])
def test_force_that_is_dropped_at_once_rolls_the_car_and_the_study_says_who_did_it(turn, at_once):
    settings, controller, passive, healthy = turn
    if at_once:
        controller = replace(controller, record=falls_at_once(controller.record))
    loop = StudiedLoop(settings, controller, passive, healthy, None)
    judged = judge(loop, CatalogueEntry("unit drops out", "message", FAULT, "tolerated"))
    assert judged.detected
    assert judged.harmful == judged.by_reaction == judged.failed == at_once
    rolls = any("rolls over" in text for text in judged.reaction.harm)
    assert rolls == at_once


def test_a_force_that_is_really_lost_is_not_the_reactions(turn):
    loop = StudiedLoop(*turn, None)
    fault = "actuators=floating@1.33"
    judged = judge(loop, CatalogueEntry("forces lost", "actuator", fault, "tolerated"))
    assert judged.detected and judged.harmful
    assert not judged.by_reaction


def test_after_a_restart_in_the_curve_the_law_is_back_and_the_car_rolls_no_more_than_without(turn):
    settings, controller, passive, _ = turn
    settings = replace(settings, faults=("node.RollControl=reset@1.33",))
    trace = drive(settings, controller, enabled=True)
    assert not trace.ticks["fault_codes"].any()
    assert (trace.ticks["mode"][trace.ticks["t"] > 1.8] == ACTIVE).all()
    assert peak(trace.signals["roll"]) < peak(passive.signals["roll"])
    held = np.abs(trace.signals["moment_front"] + trace.signals["moment_rear"])
    assert held[1330:4000].min() > 0.5 * held[1330]
