"""Margins over the family: against python-control, a simulation, and figures found elsewhere."""

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.linalg import expm

from canroll import vehicles
from canroll.gain_gen.analysis.actuated_car import actuated
from canroll.gain_gen.analysis.family import CONDITIONS, NOMINAL, _built, car_in, family, family_of
from canroll.gain_gen.analysis.margins import margins
from canroll.gain_gen.analysis.sampled_loop import loop_gain, spectral_radius
from canroll.gain_gen.laws import LAWS
from canroll.gain_gen.laws.roll_rate_feedback import static_controller
from canroll.gain_gen.laws.state_feedback import actuator_rate, observer_of
from canroll.gain_gen.laws.state_gains import riccati_gain
from canroll.gain_gen.models.controller import LinearController
from canroll.gain_gen.models.state_space import StateSpace
from canroll.gain_gen.models.task import Delay, Task
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.world.linearise import IMU_LATERAL_ACCELERATION, find_trim, linearise

DELAYS = {"500k": (5.6, 23.1), "gateway_20ms": (16.1, 50.2), "gateway_50ms": (106.0, 130.0)}


def task_on(bus):
    least, most = (1e-3 * value for value in DELAYS[bus])
    return Task(vehicles.load("van_real"), Delay(0.5 * (least + most), least, most))


def predicting(task):
    """LQG on the 1-DOF roll model: the observed state predicted over the delay."""
    roll = task.vehicle.design
    observer = observer_of(task)
    weight = 10.0**-8.4 * (12601.07 / roll.effective_stiffness) ** 2
    gain = riccati_gain(
        observer.model.phi[:4, :4],
        observer.model.gamma[:4],
        np.diag([1.0, 0.05, 0.0, 0.0]),
        np.array([[weight]]),
    )[0]
    return LinearController(
        tick=task.tick,
        observer=observer,
        feedback=np.array([*gain[:2], 0.0, 0.0, 0.0]),
        feedforward=np.array([0.0, 0.0, *gain[2:], 0.0]),
        predict_steps=round(task.delay.nominal / task.tick),
        actuator_rate=actuator_rate(task),
    )


def part_of(task, conditions):
    return family(task.vehicle, task.delay, tick=task.tick, lag=task.lag, conditions=conditions)


def nominal_at_longest(found):
    return [row for row in found.rows if row.condition == NOMINAL][-1].margins


def of_plant(vehicle, speed, *, lateral_acceleration=0.0, friction=1.0):
    """The 14-DOF plant linearised numerically, with the design model's inputs and outputs."""
    trim = find_trim(
        vehicle,
        bodies.body("nonlinear"),
        speed=speed,
        lateral_acceleration=lateral_acceleration,
        friction=friction,
    )
    plant = linearise(trim)
    share = vehicle.geometry.static_front_share
    inputs = np.zeros((ports.N_INPUTS, 3))
    inputs[[ports.BAR_MOMENT_FRONT, ports.BAR_MOMENT_REAR]] = [
        [share, 0.0, share],
        [1.0 - share, 0.0, 1.0 - share],
    ]
    inputs[ports.STEER, 1] = 1.0
    rows = [ports.ROLL_RATE, IMU_LATERAL_ACCELERATION, ports.ROLL, ports.YAW_RATE, ports.AY]
    return StateSpace(plant.a, plant.b @ inputs, plant.c[rows], plant.d[rows] @ inputs)


@pytest.mark.parametrize(
    ("bus", "controller"),
    [
        ("500k", lambda task: static_controller(task, -85237.0)),
        ("500k", lambda task: static_controller(task, -31500.0)),
        ("gateway_20ms", lambda task: static_controller(task, -32405.0)),
        ("gateway_50ms", lambda task: static_controller(task, -10600.0)),
        ("500k", predicting),
        ("gateway_50ms", predicting),
        ("gateway_50ms", lambda task: LAWS["ay_feedforward"](task).controller),
    ],
)
def test_margins_are_those_of_the_linearised_plant(bus, controller, monkeypatch):
    task = task_on(bus)
    loop = controller(task)
    found = part_of(task, (NOMINAL,)).margins(loop).rows
    monkeypatch.setattr("canroll.gain_gen.analysis.family.linear_car", of_plant)
    monkeypatch.setattr(
        "canroll.gain_gen.analysis.family._built", _built.__wrapped__
    )  # not from the cache
    wanted = part_of(task, (NOMINAL,)).margins(loop).rows
    assert found != wanted
    for mine, other in zip(found, wanted, strict=True):
        assert mine.margins.gain_db == pytest.approx(other.margins.gain_db, abs=0.02)
        # as distances from the critical point
        nearest, expected = 1.0 / mine.margins.sensitivity, 1.0 / other.margins.sensitivity
        assert nearest == pytest.approx(expected, abs=2e-3)


def test_the_worst_member_is_worse_than_the_nominal_one_and_late():
    task = task_on("500k")
    found = family_of(task).margins(static_controller(task, -31500.0))
    assert found.worst_gain.margins.gain_db < nominal_at_longest(found).gain_db
    assert found.worst_gain.delay == task.delay.most
    late = family_of(task_on("gateway_50ms")).margins(predicting(task_on("gateway_50ms")))
    assert nominal_at_longest(late).gain_db > 1.0
    assert not late.stable
    assert late.worst_sensitivity.margins.sensitivity == np.inf


def test_a_measured_lateral_acceleration_is_feedback():
    task = task_on("gateway_50ms")
    found = family_of(task).margins(LAWS["ay_feedforward"](task).controller)
    assert 5.0 < found.worst_gain.margins.gain_db < 8.0
    assert found.stable


def test_margins_agree_with_python_control():
    task = task_on("gateway_20ms")
    every = part_of(task, CONDITIONS[:2])
    controller = predicting(task)
    found = {(row.condition, row.delay): row.margins for row in every.margins(controller).rows}
    for member in every.members:
        for delay in every.delays:
            loop = member.loop(controller, delay)
            system = control.ss(loop.a, loop.b, -loop.c, 0, loop.tick)
            here = found[member.condition, delay]
            curve = np.asarray(system(np.exp(1j * every.frequencies * loop.tick)))
            assert here.modulus == pytest.approx(np.abs(1.0 + curve).min(), rel=1e-6)
            # from the response: its polynomials lose too many digits at order thirty
            data = control.frd(curve, every.frequencies, dt=loop.tick)
            gains = control.stability_margins(data, returnall=True)[0]
            least = min(abs(20.0 * np.log10(gain)) for gain in gains)
            assert here.gain_db == pytest.approx(least, abs=0.05)
            assert margins(loop).gain_db == pytest.approx(least, abs=0.05)


def test_the_gain_margin_is_the_edge_of_stability():
    task = task_on("500k")
    controller = static_controller(task, -85237.0)
    every = family_of(task)
    for row in every.margins(controller).rows:
        if not np.isfinite(row.margins.gain_db):
            continue
        member = next(m for m in every.members if m.condition == row.condition)
        loop = member.loop(controller, row.delay)
        edge = 10.0 ** (row.margins.gain_db / 20.0)
        assert spectral_radius(replace(loop, c=0.99 * edge * loop.c)) < 1.0
        assert spectral_radius(replace(loop, c=1.01 * edge * loop.c)) > 1.0


def test_the_loop_is_the_car_stepped_finely():
    task = task_on("500k")
    controller = static_controller(task, -20000.0)
    every = part_of(task, [NOMINAL])
    member, delay = every.members[0], every.delays[-1]
    loop = member.loop(controller, delay)
    car = actuated(car_in(task.vehicle, NOMINAL), lag=task.lag, sensors=task.vehicle.sensors)
    n, step = len(car.a), 1e-4
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n:] = car.a, car.command
    transition = expm(whole * step)
    pure = round((delay - 1.0 / (2.0 * np.pi * 50.0)) / step)
    state, x = np.zeros(n + 1), np.zeros(len(loop.a))
    state[2] = x[2] = 0.05
    due = []
    for k in range(5000):
        if k % 100 == 0:
            assert state[2] == pytest.approx(x[2], abs=2e-4)
            x = loop.closed @ x
            due.append((k + pure, -20000.0 * float(car.measured[0] @ state[:n])))
        while due and due[0][0] <= k:
            state[n] = due.pop(0)[1]
        state = transition @ state


def test_frequency_responses_are_those_of_the_matrices():
    task = task_on("gateway_20ms")
    every = part_of(task, [NOMINAL])
    controller = predicting(task)
    member, delay = every.members[0], every.delays[-1]
    expected = loop_gain(member.loop(controller, delay), every.frequencies)
    found = -np.sum(every.controller_response(controller) * member.commanded(delay), axis=1)
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", vehicles.names())
def test_every_vehicle_has_a_family(name):
    vehicle = vehicles.load(name)
    every = family(vehicle, Delay.constant(0.03), tick=0.01, lag=0.01)
    assert len(every.members) == len(CONDITIONS)
    still = static_controller(Task(vehicle, Delay.constant(0.03)), 0.0)
    found = every.margins(still)
    assert found.stable
    assert found.worst_gain.margins.gain_db == np.inf
    assert "laden" in str(found.rows[0])
