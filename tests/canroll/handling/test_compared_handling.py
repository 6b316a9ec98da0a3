"""The handling tests with the firmware on the bus, against the plant alone and the linear loop."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from canroll.gain_gen.analysis.family import family_of
from canroll.gain_gen.analysis.steering_response import steering_response
from canroll.gain_gen.calibration.record import identify
from canroll.gain_gen.design import design
from canroll.gain_gen.models.controller import S_STEERING
from canroll.gain_gen.models.state_space import StateSpace
from canroll.handling.controlled_handling import compared, limit_of
from canroll.plant_sim import bodies
from canroll.plant_sim.world import handling
from canroll.runs import experiment
from canroll.setup.controller import task_of

pytestmark = pytest.mark.slow

SPEED = 80 / 3.6
"""Of the nominal condition of the linear loop, m/s."""
FREQUENCIES = np.array([0.5, 1.0, 1.6, 2.5])


def response(lateral_acceleration, frequencies=FREQUENCIES, **choices):
    """Return vehicle and pair of responses on the nonlinear car."""
    settings, controller = experiment.plan("sine_sweep", **choices)
    test = partial(
        handling.frequency_response,
        settings.vehicle,
        speed=SPEED,
        lateral_acceleration=lateral_acceleration,
        frequencies=frequencies,
    )
    return settings, compared(settings, controller, test)


def linear_roll(choices):
    """Roll per road-wheel angle of the linear car, without and in the loop, mean delay."""
    task = task_of(choices)
    controller = design(choices["law"], task).controller
    family = family_of(task)
    member = family.members[0]
    assert member.condition.speed == pytest.approx(SPEED)
    car = steering_response(family, task.vehicle, family.delays[1], member)
    feedback = family.controller_response(controller)[: len(car.frequencies)]
    steering = np.zeros(len(car.frequencies), complex)
    if controller.compensator is not None:
        own = controller.compensator
        rows = StateSpace(own.a, own.b, own.c, own.d, task.tick).response(car.frequencies)
        steering = rows.sum(axis=1)[:, S_STEERING]
    factor = controller.factor_at(SPEED)
    rolled = car.rolled(car.moment(factor * feedback, factor * steering))
    omega = 2 * np.pi * FREQUENCIES
    return (np.interp(omega, car.frequencies, row) for row in (car.readings[:, 2], rolled))


@pytest.mark.parametrize(
    ("law", "actuator", "trigger", "bound"),
    [
        ("hinf_delay", "bars", "every", 0.012),
        ("lqr", "suspension", "every", 0.018),
        ("steering_lead", "bars", "every", 0.02),
        ("steering_lead", "bars", "event", 0.033),
    ],
)
def test_small_steering_rolls_the_car_as_the_linear_loop_says(law, actuator, trigger, bound):
    """Within ``bound`` of the passive peak.

    The linear loop has no trigger, and one constant delay, where the bus has another every tick.
    """
    choices = {"law": law, "actuator": actuator, "trigger": trigger}
    _, pair = response(1.0, **choices)
    passive, controlled = linear_roll(choices)
    peak = np.abs(passive).max()
    assert np.abs(pair.passive.roll - passive).max() < 0.008 * peak
    assert np.abs(pair.controlled.roll - controlled).max() < bound * peak
    # far more than the bound is told apart
    assert np.abs(controlled - passive).max() > 15 * bound * peak
    assert not any(each.at_limit or each.inactive for each in pair.control)


def test_without_control_the_car_is_the_plant_alone_to_the_last_digit():
    settings, pair = response(2.0, FREQUENCIES[:1], law="plain_feedforward")
    alone = handling.frequency_response(
        settings.vehicle,
        handling.passive(settings.vehicle, bodies.body("nonlinear")),
        speed=SPEED,
        frequencies=FREQUENCIES[:1],
    )
    for name in ("yaw_rate", "lateral_acceleration", "roll"):
        np.testing.assert_array_equal(getattr(pair.passive, name), getattr(alone, name))


def test_control_reduces_the_roll_gradient_until_its_moment_ends():
    """Beyond the limit the roll grows again like that of the passive car."""
    settings, controller = experiment.plan("constant_radius", law="steering_lead")
    test = partial(handling.constant_radius, settings.vehicle, radius=100.0)
    pair = compared(settings, controller, test)
    alone = handling.passive(settings.vehicle, bodies.body("nonlinear"))
    assert pair.passive == test(alone)
    assert pair.controlled.roll_gradient < 0.6 * pair.passive.roll_gradient
    states, control = pair.controlled.states, pair.control[: len(pair.controlled.states)]
    limited = [each.at_limit for each in control]
    assert limited == sorted(limited) and limited[0] == 0.0 and limited[-1] == 1.0
    full = [k for k, share in enumerate(limited) if share == 1.0]
    for k in full:
        assert sum(control[k].moment) == pytest.approx(limit_of(controller.record), rel=1e-3)
        assert control[k].front_share == pytest.approx(
            controller.front_share(states[k].speed), 0.01
        )
    first, last = full[0], full[len(full) // 2]
    rolls = [
        run.states[last].roll - run.states[first].roll for run in (pair.passive, pair.controlled)
    ]
    assert rolls[1] == pytest.approx(rolls[0], rel=0.03)


def test_a_moment_limit_is_named_where_it_is_reached():
    settings, controller = experiment.plan("sine_sweep", law="plain_feedforward")
    record = controller.record
    record.moment_max = 100 << 14
    small = replace(controller, record=identify(record))
    test = partial(
        handling.frequency_response, settings.vehicle, speed=SPEED, frequencies=FREQUENCIES[:1]
    )
    (control,) = compared(settings, small, test).control
    assert limit_of(small.record) == 100.0
    assert 0.5 < control.at_limit < 1.0
    assert sum(control.moment) <= 101.0
