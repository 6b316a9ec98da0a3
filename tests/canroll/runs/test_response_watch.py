"""Actuators that report what was commanded, in whole runs with the response monitor."""

from dataclasses import replace

import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.firmware.plausibility import FAULT_ACTUATOR_CONTRADICTED
from canroll.firmware.state import SAFE
from canroll.gain_gen.calibration.freeze import calibrate
from canroll.gain_gen.calibration.options import QuantiseOptions
from canroll.gain_gen.design import design
from canroll.gain_gen.models.task import Delay, Task
from canroll.runs import experiment
from canroll.studies.variation import DEFAULT_SPREAD, draw, varied
from canroll.vehicles import load
from canroll.vehicles.roll_stiffness import springs_within

pytestmark = pytest.mark.slow


def driven(scenario: str, *, number: int | None = None, **choices) -> tuple[int, bool]:
    """Fault codes and whether it ended in SAFE; ``number`` draws another vehicle to drive."""
    settings, controller = experiment.plan(scenario, **{"law": "lqr", **choices})
    if number is not None:
        settings = draw(settings, number, spread=DEFAULT_SPREAD, seed=14)
    ticks = experiment.drive(settings, controller, enabled=True).ticks
    codes = int(np.bitwise_or.reduce(ticks["fault_codes"], initial=0))
    return codes, bool(ticks["mode"][-1] == SAFE)


@pytest.mark.parametrize("watched", [True, False])
@pytest.mark.parametrize("lie", ["front=reversed", "actuators=reversed", "front=stuck"])
@pytest.mark.parametrize("actuator", ["bars", "suspension"])
def test_lies_are_found_by_it_alone(actuator, lie, watched):
    where = lie.partition("=")[0]
    codes, safe = driven(
        "double_lane_change",
        actuator=actuator,
        faults=[f"{lie}@1.6 + {where}=lying@1.6"],
        response_watch=watched,
    )
    assert safe == watched
    assert codes >> FAULT_ACTUATOR_CONTRADICTED & 1 == watched


@pytest.mark.parametrize(
    ("vehicle", "actuator", "faults"),
    [
        ("van_real", "bars", "actuators=stuck@1.6 + actuators=lying@1.6"),
        ("van_real", "bars", "actuators=runaway:0.8@1.6 + actuators=lying@1.6"),
        ("suv_2020", "bars", "front=runaway:0.8@1.6 + front=lying@1.6"),
        ("car_2020", "suspension", "front=reversed@1.6 + front=lying@1.6"),
        # both sides of an axle alike make no moment
        ("car_2020", "suspension", "rear=runaway:-0.8@1.6"),
        ("van_2022", "suspension", "actuators=runaway:-0.8@1.6"),
    ],
)
def test_what_does_harm_is_found_whatever_is_reported(vehicle, actuator, faults):
    codes, safe = driven(
        "double_lane_change",
        law="steering_lead",
        vehicle=vehicle,
        actuator=actuator,
        faults=[faults],
    )
    assert safe
    assert codes >> FAULT_ACTUATOR_CONTRADICTED & 1


@pytest.mark.parametrize("known", [{}, {"mass": 0.05, "height": 0.02, "stiffness": 0.05}])
def test_a_lie_that_hides_in_the_default_box_is_found_in_a_car_that_is_known_well(known):
    _, safe = driven(
        "double_lane_change",
        law="steering_lead",
        vehicle="car_2020",
        actuator="suspension",
        faults=["front=stuck@1.6 + front=lying@1.6"],
        uncertainty=known,
    )
    assert safe == bool(known)


@pytest.mark.parametrize("actuator", ["bars", "suspension"])
@pytest.mark.parametrize("vehicle", ["van_real", "car_2020"])
@pytest.mark.parametrize("scenario", ["double_lane_change", "fishhook"])
def test_a_car_with_every_number_off_is_taken_for_none(scenario, vehicle, actuator):
    settings, controller = experiment.plan(scenario, vehicle=vehicle, actuator=actuator)
    off = dict.fromkeys(DEFAULT_SPREAD, 1.0)
    off |= {"sprung_mass": 1.2, "cg_height_above_roll_axis": 1.2, "roll_stiffness": 0.8}
    settings = replace(settings, vehicle=springs_within(varied(settings.vehicle, off)))
    ticks = experiment.drive(settings, controller, enabled=True).ticks
    assert not ticks["fault_codes"].any()


@pytest.mark.parametrize("number", range(2))
@pytest.mark.parametrize(
    ("scenario", "options"),
    [
        ("bumps", {"height": 0.06}),
        ("random_road", {"road_class": "C"}),
        ("banked_curve", {"bank_deg": 10.0}),
        ("fishhook", {"friction": 0.6}),
    ],
)
def test_no_road_and_no_other_vehicle_is_taken_for_a_lie(scenario, options, number):
    codes, _ = driven(
        scenario,
        number=number,
        actuator="bars",
        options=options,
    )
    assert codes >> FAULT_ACTUATOR_CONTRADICTED & 1 == 0


def test_a_plant_without_tyres_is_driven_without_it():
    _, controller = experiment.plan("double_lane_change", plant="roll1")
    assert controller.record.response_min == 0
    with pytest.raises(CanrollError, match="plant roll1 has no tyres: omit it"):
        experiment.plan("double_lane_change", plant="roll1", response_watch=True)


def test_it_is_frozen_in_a_calibration_and_changes_no_command():
    frames = []
    for chosen in (None, False):
        settings, controller = experiment.plan(
            "double_lane_change", law="lqr", actuator="bars", response_watch=chosen
        )
        watched = chosen is None
        assert (controller.record.response_min > 0) == watched
        assert (controller.record.timeout_ticks[2] > 0) == watched
        trace = experiment.drive(replace(settings, seed=3), controller, enabled=True)
        frames.append(trace.frames[:].tobytes())
    assert frames[0] == frames[1]


def test_a_vehicle_beyond_the_fields_is_refused_with_the_option_that_helps():
    vehicle = load("van_real")
    lorry = replace(vehicle, mass=replace(vehicle.mass, yaw_inertia=1e6))
    made = design("lqr", Task(lorry, Delay.constant(0.02), actuator="bars"))
    calibrate(made)
    with pytest.raises(CanrollError, match=r"^axles_yaw: .* design with --no-watch-response$"):
        calibrate(made, QuantiseOptions(response_watch=True))
