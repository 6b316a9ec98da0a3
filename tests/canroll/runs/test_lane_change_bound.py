"""The steering-led feedforward on the 14-DOF car, in fixed point over the bus, at equal effort."""

from dataclasses import replace

import numpy as np
import pytest
from support.limit_cycles import detect

from canroll.gain_gen.laws import LAWS
from canroll.gain_gen.laws.state_feedback import FEEDFORWARD_SHARE
from canroll.gain_gen.laws.steering_lead import MOMENT_SHARE
from canroll.runs.experiment import drive, plan
from canroll.runs.metrics import judge
from canroll.studies.bound import bound_of
from canroll.studies.effort import scaled

CAR = {"plant": "nonlinear", "vehicle": "van_real", "actuator": "suspension"}


@pytest.fixture(autouse=True)
def plain_feedforward(monkeypatch):
    """The accelerometer as it is read, times −β m h: no model, no prediction."""

    def plain(task):
        known = LAWS["ay_feedforward"](task)
        gain = np.array([0.0, -FEEDFORWARD_SHARE * task.vehicle.design.roll_arm, 0.0])
        controller = replace(known.controller, output_gain=gain, predict_steps=0)
        return replace(known, controller=controller)

    monkeypatch.setitem(LAWS, "plain", plain)


def driven(law, bus, factor, **choices):
    """Figures of a lane change, or another manoeuvre, with the law's moment times ``factor``."""
    scenario = choices.pop("scenario", "double_lane_change")
    settings, controller = plan(scenario, law=law, bus=bus, **CAR, **choices)
    trace = drive(settings, scaled(controller, factor), enabled=True)
    return judge(trace), trace


def at_effort(law, bus, moment):
    """Figures at an RMS moment, N·m: the factor on a linear law is all but proportional to it."""
    factor = 1.0
    for _ in range(4):
        found, _ = driven(law, bus, factor)
        if abs(found.moment_rms_nm / moment - 1.0) < 2e-3:
            return found
        factor *= moment / found.moment_rms_nm
    raise AssertionError(f"{law} does not come to {moment} N·m")


def noncausal_bound(moment):
    """RMS roll, deg, of the best moment of that RMS, known to its end; judged in test_bound."""
    settings, controller = plan("double_lane_change", **CAR)
    signals = drive(settings, controller, enabled=False).signals
    return np.degrees(bound_of(settings, controller, signals["time"], signals["roll"]).at(moment))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bus", "beyond_bound", "of_plain"),
    [("500k", 1.02, 0.98), ("gateway_20ms", 1.03, 0.96), ("gateway_50ms", 1.06, 0.87)],
)
def test_roll_is_near_the_bound_and_below_the_plain_feedforward(bus, beyond_bound, of_plain):
    found, plain = (at_effort(law, bus, 3200.0) for law in ("steering_lead", "plain"))
    assert found.roll_rms_deg < beyond_bound * noncausal_bound(3200.0)
    assert found.roll_rms_deg < of_plain * plain.roll_rms_deg
    assert found.roll_max_deg < plain.roll_max_deg


def test_the_more_effort_the_more_the_lead_is_worth():
    found, plain = (at_effort(law, "gateway_50ms", 4200.0) for law in ("steering_lead", "plain"))
    assert found.roll_rms_deg < 0.60 * plain.roll_rms_deg


@pytest.mark.parametrize("bus", ["500k", "gateway_50ms"])
@pytest.mark.parametrize(
    "choices",
    [
        {"speed_kmh": 60.0},
        {"speed_kmh": 100.0},
        {"options": {"friction": 0.5}},
        {"options": {"friction": 0.7}},
        {"scenario": "fishhook"},
    ],
    ids=str,
)
def test_it_is_nowhere_worse_than_the_plain_feedforward(bus, choices):
    """Both at the scale that makes 3200 N·m of the lane change at 80 km/h on a dry road.

    The fishhook ends at walking pace, where the schedule takes margins, not moment: on a slow bus
    its RMS is a tenth more there, its maximum, which is what tips a car, is less. On ice (0.35)
    nothing is claimed: at the tyres' limit the driver takes another path with each law, and the
    lead rolls up to a quarter more.
    """
    fishhook = "scenario" in choices
    tolerance = 1.12 if fishhook else 1.01
    ratio = 0.79 / FEEDFORWARD_SHARE
    found, _ = driven("steering_lead", bus, 0.82 / MOMENT_SHARE, **choices)
    plain, _ = driven("plain", bus, ratio, **choices)
    assert found.roll_rms_deg < tolerance * plain.roll_rms_deg
    assert found.roll_max_deg < (1.0 if fishhook else 1.04) * plain.roll_max_deg


def changed(vehicle, rng):
    """Mass, height, stiffness, damping, cornering and tyre stiffness off by up to 20 % each."""
    mass, height, stiffness, damping, cornering, tyre = rng.uniform(0.8, 1.2, 6)
    plant, tyres = vehicle.plant, vehicle.tyre
    arm = height * plant.cg_height_above_roll_axis
    body = replace(
        plant,
        sprung_mass=mass * plant.sprung_mass,
        cg_height_above_roll_axis=arm,
        roll_inertia=mass * (plant.inertia_about_cg + plant.sprung_mass * arm**2),
        roll_stiffness=stiffness * plant.roll_stiffness,
        roll_damping=damping * plant.roll_damping,
    )
    grip = replace(
        tyres,
        cornering_stiffness_front=cornering * tyres.cornering_stiffness_front,
        cornering_stiffness_rear=cornering * tyres.cornering_stiffness_rear,
        vertical_stiffness=tyre * tyres.vertical_stiffness,
    )
    return replace(vehicle, plant=body, tyre=grip)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bus", "of_plain"),
    [pytest.param("500k", 0.97, marks=pytest.mark.long), ("gateway_50ms", 0.87)],
)
def test_thirty_vehicles_roll_less_than_with_the_plain_feedforward(bus, of_plain):
    laws = [
        plan("double_lane_change", law=law, bus=bus, **CAR) for law in ("steering_lead", "plain")
    ]
    factors = (0.82 / MOMENT_SHARE, 0.79 / FEEDFORWARD_SHARE)
    rng = np.random.default_rng(0)
    ratios, cycles = [], 0
    for _ in range(30):
        vehicle = changed(laws[0][0].vehicle, rng)
        passive = drive(replace(laws[0][0], vehicle=vehicle), laws[0][1], enabled=False)
        found = [
            drive(replace(settings, vehicle=vehicle), scaled(controller, factor), enabled=True)
            for (settings, controller), factor in zip(laws, factors, strict=True)
        ]
        ratios.append([judge(trace).roll_rms_deg / judge(passive).roll_rms_deg for trace in found])
        roll = passive.signals["time"], passive.signals["roll"]
        cycles += detect(found[0].ticks["t"], found[0].ticks["moment"], *roll) is not None
    ours, plain = np.array(ratios).T
    assert cycles == 0
    assert np.mean(ours) < of_plain * np.mean(plain)
    assert np.mean(ours) < 0.435
    assert np.max(ours) < 0.55
