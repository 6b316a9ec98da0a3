"""The steering-led feedforward: lead against simulation, loop and effort on every car."""

import control
import numpy as np
import pytest

from canroll import vehicles
from canroll.gain_gen.analysis.family import NOMINAL, car_in, family_of
from canroll.gain_gen.analysis.steering_response import steering_response
from canroll.gain_gen.design import design
from canroll.gain_gen.laws import LAWS
from canroll.gain_gen.laws.steering_lead import CORNERS, Tuning, compensator, steering_model
from canroll.gain_gen.models.controller import S_LATERAL, S_RATE, S_STEERING
from canroll.gain_gen.models.linear_car import INPUTS, OUTPUTS
from canroll.gain_gen.models.task import Delay, Task

TICK = 0.01
DELAYS = {
    "500k": Delay(0.0144, 0.0056, 0.0231),
    "gateway_20ms": Delay(0.0331, 0.0161, 0.0502),
    "gateway_50ms": Delay(0.118, 0.106, 0.130),
}


def task_on(bus, vehicle="van_real", **options):
    return Task(vehicles.load(vehicle), DELAYS[bus], **options)


def ramp_and_hold(time):
    """A steering angle at the road wheels that is held from 0.5 s on, rad."""
    return 0.02 * np.clip(time / 0.5, 0.0, 1.0)


def test_the_steering_leads_the_ten_state_car_by_the_horizon():
    """In a turn already held the lead is what the car's lateral acceleration still gains."""
    vehicle, horizon = vehicles.load("van_real"), 0.15
    car = car_in(vehicle, NOMINAL)
    steering, lateral = INPUTS.index("steering"), OUTPUTS.index("lateral_acceleration")
    whole = control.ss(
        car.a, car.b[:, [steering]], car.c[[lateral]], car.d[[lateral]][:, [steering]]
    )
    time = np.arange(0.0, 2.0, 1e-3)
    acceleration = control.forced_response(whole, time, ramp_and_hold(time)).outputs
    found = compensator(steering_model(vehicle), Tuning(1.0, 0.0, horizon, 8.0), TICK)
    ticks = np.arange(0.0, 1.8, TICK)
    inputs = np.zeros((4, len(ticks)))
    # the tick holds the angle for half a period on the average
    inputs[S_STEERING] = vehicle.lateral_gain(NOMINAL.speed) * ramp_and_hold(ticks + 0.5 * TICK)
    law = control.ss(found.a, found.b, found.c, found.d, TICK)
    lead = -np.ravel(control.forced_response(law, ticks, inputs).outputs)
    held = ticks >= 0.5
    gained = np.interp(ticks + horizon, time, acceleration) - np.interp(ticks, time, acceleration)
    assert np.abs(gained).max() > 0.5
    np.testing.assert_allclose(lead[held], gained[held], atol=0.03 * np.abs(gained).max())


def test_what_is_slow_comes_from_the_accelerometer_alone():
    for corner in CORNERS:
        tuning = Tuning(1300.0, -5000.0, 0.2, corner)
        found = compensator(steering_model(vehicles.load("van_real")), tuning, TICK)
        steady = found.d + found.c @ np.linalg.solve(np.eye(len(found.a)) - found.a, found.b)
        assert steady[0, S_LATERAL] == pytest.approx(-1300.0, rel=1e-9)
        assert steady[0, S_RATE] == pytest.approx(-5000.0)
        assert steady[0, S_STEERING] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("vehicle", [*vehicles.names()])
@pytest.mark.parametrize("actuator", ["suspension", "bars"])
@pytest.mark.parametrize("bus", DELAYS)
def test_it_has_its_margins_on_every_car_and_bus(vehicle, actuator, bus):
    task = task_on(bus, vehicle, actuator=actuator)
    found = family_of(task).margins(LAWS["steering_lead"](task).controller)
    assert len(found.rows) == 30
    assert found.stable
    assert found.worst_gain.margins.gain_db > 8.0
    assert found.worst_sensitivity.margins.sensitivity < 1.7


def test_the_rate_gain_fades_with_the_delay_and_the_horizon_grows():
    found = [LAWS["steering_lead"](task_on(bus)).extra for bus in DELAYS]
    rates = [extra["rate_gain"] for extra in found]
    horizons = [extra["horizon_s"] for extra in found]
    assert -20000 < rates[0] < 0
    assert np.all(np.diff(rates) > 2000)
    assert rates[2] <= 0
    assert np.all(np.diff(horizons) > 0.015)
    assert all(delay.nominal < tau for delay, tau in zip(DELAYS.values(), horizons, strict=True))


@pytest.mark.parametrize("share", [0.3, 0.8, 1.0])
def test_the_share_is_met_on_the_nominal_car(share):
    task = task_on("gateway_20ms", moment_share=share)
    solution = LAWS["steering_lead"](task)
    family = family_of(task)
    response = steering_response(family, task.vehicle, family.delays[1])
    z = np.exp(1j * response.frequencies * task.tick)
    c = solution.controller.compensator
    shifted = z[:, None, None] * np.eye(len(c.a)) - c.a
    whole = (c.c @ np.linalg.solve(shifted, np.broadcast_to(c.b, (len(z), *c.b.shape))) + c.d)[:, 0]
    feedback = np.zeros((len(z), 4), dtype=complex)
    feedback[:, 0], feedback[:, 1] = whole[:, S_RATE], whole[:, S_LATERAL]
    moment = response.moment(feedback, whole[:, S_STEERING])
    assert response.rms(moment) / task.vehicle.design.roll_arm == pytest.approx(share, rel=2e-3)


def test_it_is_designed_verified_and_refuses_what_it_cannot_honour():
    answer = design("steering_lead", task_on("gateway_50ms"))
    assert answer.is_verified
    assert answer.controller.compensator.a.shape == (5, 5)
    assert np.abs(np.linalg.eigvals(answer.controller.compensator.a)).max() < 1.0
    with pytest.raises(Exception, match="--moment-share applies to"):
        design("lqr", task_on("500k", moment_share=0.5))
