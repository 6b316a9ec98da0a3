"""When a car tips that loses its roll moment at once: said by the design, judged by a car."""

from dataclasses import replace

import numpy as np
import pytest

from canroll import vehicles
from canroll.gain_gen.analysis.loss_of_force import overshoot, tipping_acceleration, warnings
from canroll.runs.experiment import drive, plan


@pytest.mark.parametrize("damping", [0.1, 0.4, 0.9])
def test_a_step_overshoots_as_the_solution_of_the_oscillator_says(damping):
    t = np.linspace(0.0, 20.0, 200_001)
    damped = np.sqrt(1 - damping**2)
    response = 1 - np.exp(-damping * t) * (
        np.cos(damped * t) + damping / damped * np.sin(damped * t)
    )
    assert overshoot(damping) == pytest.approx(response.max() - 1, rel=1e-6)
    assert overshoot(1.0) == overshoot(1.5) == 0.0


@pytest.mark.parametrize(("scale", "lifts"), [(4.0, True), (8.0, False)])
def test_a_nonlinear_car_lifts_its_inner_wheels_beyond_it_and_not_before(scale, lifts):
    settings, controller = plan(
        "j_turn", law="lqr", actuator="suspension", options={"scale": scale}
    )
    trace = drive(replace(settings, faults=("actuators=dead@3",)), controller, enabled=True)
    signals = trace.signals
    lost = int(np.argmax(signals["time"] >= 3.0))
    moment = signals["moment_front"][lost - 1] + signals["moment_rear"][lost - 1]
    acceleration = signals["ay"][lost - 200 : lost].mean()
    assert abs(moment) > 9000
    limit = tipping_acceleration(settings.vehicle, moment)
    assert (acceleration > 1.01 * limit, acceleration < 0.995 * limit) == (lifts, not lifts)
    loads = sum(signals[f"wheel_load_{axle}_left"] for axle in ("front", "rear"))
    assert (loads[lost : lost + 1500].min() < 1.0) == lifts


def test_it_is_said_of_a_van_held_by_forces_and_not_of_a_car_that_its_tyres_let_slide():
    van, car = vehicles.load("van_real"), vehicles.load("car_2020")
    (text,) = warnings(van, 13_840.0)
    assert "lost at once lift both inner wheels from" in text
    assert warnings(car, 12_160.0) == ()
    assert warnings(van, 0.0) == ()
    assert tipping_acceleration(van, 4000.0) < tipping_acceleration(van, 0.0)
