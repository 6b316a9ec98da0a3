"""Margins over a fit: the worst of cars that are drawn and judged by other means."""

from dataclasses import replace

import numpy as np
import pytest

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.gain_gen.analysis import fitted_family
from canroll.gain_gen.analysis.family import family_of
from canroll.gain_gen.analysis.fitted_family import margins_of_draws, with_draws
from canroll.gain_gen.analysis.sampled_loop import spectral_radius
from canroll.gain_gen.design import design
from canroll.gain_gen.laws.roll_rate_feedback import static_controller
from canroll.gain_gen.models.controller import scaled_controller
from canroll.gain_gen.models.task import Delay, Task
from canroll.vehicles.draws.fitted_cars import DRAWS, SEED

pytestmark = pytest.mark.slow

STIFFNESS, DAMPING, RHO = 0.10, 0.15, -0.6
DELAY = Delay(0.02, 0.01, 0.03)


def fitted():
    van = vehicles.load("van_real")
    fit = {
        "log": "a.csv",
        "names": ["plant.roll_stiffness", "plant.roll_damping"],
        "deviations": [
            STIFFNESS * van.plant.roll_stiffness,
            DAMPING * van.plant.roll_damping,
        ],
        "correlation": [[1.0], [RHO, 1.0]],
    }
    return vehicles.from_table(van.document | {"fit": fit}, name="van_real")


def test_the_worst_of_the_draws_is_that_of_cars_drawn_by_hand():
    vehicle = fitted()
    task = Task(vehicle, DELAY)
    controller = static_controller(task, -15000.0)
    margins = with_draws(family_of(task), task).margins(controller)

    random = np.random.default_rng(SEED)
    edges = []
    for _ in range(DRAWS):
        first, second = random.standard_normal(2)
        stiffness = np.exp(STIFFNESS * first)
        damping = np.exp(DAMPING * (RHO * first + np.sqrt(1.0 - RHO**2) * second))
        plant = vehicle.plant
        car = vehicle.replace(
            {
                "plant.roll_stiffness": plant.roll_stiffness * stiffness,
                "plant.roll_damping": plant.roll_damping * damping,
            }
        )
        assert car.fit is None
        edges += [
            edge_of(member, controller, DELAY.most)
            for member in family_of(Task(car, DELAY)).members
        ]
    # at the longest delay a rate feedback has the least margin, upwards
    assert margins_of_draws(margins)["draws_gain_db"] == pytest.approx(
        20.0 * np.log10(min(edges)), abs=0.02
    )
    alone = family_of(task).margins(controller)
    assert margins_of_draws(alone) == {}
    assert margins_of_draws(margins)["fitted_gain_db"] == alone.worst_gain.margins.gain_db


def test_a_draw_without_a_linear_car_is_refused_with_the_remedy(monkeypatch):
    def family(task):
        of = family_of(replace(task, vehicle=vehicles.load("van_real")))
        return of if task.vehicle.fit else replace(of, note="it has no linear car")

    task = Task(fitted(), DELAY)
    monkeypatch.setattr(fitted_family, "family_of", family)
    with pytest.raises(CanrollError) as error:
        with_draws(family(task), task)
    assert str(error.value) == (
        "van_real: draw 1 of its [fit]: it has no linear car: fit again with more numbers held, or "
        "a log that tells more"
    )


def edge_of(member, controller, delay):
    """Return the factor on the gain at which the loop loses its stability, by bisection."""
    low, high = 1.0, 64.0
    for _ in range(20):
        middle = (low * high) ** 0.5
        radius = spectral_radius(member.loop(scaled_controller(controller, middle), delay))
        low, high = (middle, high) if radius < 1.0 else (low, middle)
    return low


def test_a_design_for_a_fit_holds_for_every_draw_and_costs_gain():
    unknown = design("hinf_nodelay", vehicle=fitted(), delay=DELAY)
    known = design("hinf_nodelay", vehicle="van_real", delay=DELAY)
    assert unknown.margins["draws"] == DRAWS
    assert unknown.margins["draws_gain_db"] > 8.0
    assert unknown.margins["draws_peak_sensitivity"] < 1.7
    assert unknown.verified["gain_margin_db"].value == pytest.approx(
        min(unknown.margins["draws_gain_db"], unknown.margins["fitted_gain_db"])
    )
    assert "draws" not in known.margins
