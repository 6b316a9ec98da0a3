"""The design model of the data sheet is the linearised 14-DOF plant to 10 Hz."""

import pytest

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.handling.linear_response import linear_response
from canroll.plant_sim import bodies
from canroll.vehicles.unladen import unladen

VAN = vehicles.load("van_real")


def distance(vehicle, speed_kmh, **trim):
    found = linear_response(vehicle, bodies.body("nonlinear"), speed=speed_kmh / 3.6, **trim)
    return found.distance


@pytest.mark.parametrize("vehicle", [VAN, unladen(VAN)], ids=["laden", "empty"])
@pytest.mark.parametrize("speed_kmh", [40.0, 80.0, 120.0])
def test_design_model_is_within_half_a_percent_of_the_plant(vehicle, speed_kmh):
    found = distance(vehicle, speed_kmh)
    for name in ("roll_rate", "roll", "lateral_acceleration", "imu_lateral", "yaw_rate"):
        assert found["steering"][name] < 0.005
        # the yaw rate by a moment is tiny
        assert found["moment"][name] < (0.015 if name == "yaw_rate" else 0.005)


@pytest.mark.parametrize("vehicle", [VAN, unladen(VAN)], ids=["laden", "empty"])
def test_design_model_follows_the_moment_into_a_curve(vehicle):
    """What feedback sees; steering differs at the lowest frequencies, where the plant slows.

    A rolled body couples into heave, which the design model lacks: with the square of the curve.
    """
    for lateral, friction in ((2.0, 1.0), (4.0, 1.0), (6.0, 1.0), (3.2, 0.5)):
        found = distance(vehicle, 80.0, lateral_acceleration=lateral, friction=friction)
        assert found["moment"]["roll_rate"] < 0.0016 * lateral**2
        assert found["moment"]["imu_lateral"] < 0.0037 * lateral**2
    assert distance(vehicle, 80.0, lateral_acceleration=4.0)["steering"]["roll"] < 0.06


def test_one_degree_of_freedom_is_far_from_the_design_model():
    found = linear_response(VAN, bodies.body("roll1"), speed=80 / 3.6).distance
    assert 0.4 < found["moment"]["roll_rate"] < 0.7
    # a moment moves that plant's body alone
    assert found["moment"]["yaw_rate"] is None


def test_friction_without_effect_is_refused():
    for body, lateral in (("nonlinear", 0.0), ("roll1", 3.0)):
        with pytest.raises(CanrollError, match="has no effect on"):
            linear_response(
                VAN, bodies.body(body), speed=20.0, lateral_acceleration=lateral, friction=0.5
            )


def test_without_a_design_model_the_plant_is_shown_all_the_same(monkeypatch):
    def none(*_, **__):
        raise CanrollError("no such curve")

    monkeypatch.setattr("canroll.handling.linear_response.linear_car", none)
    found = linear_response(VAN, bodies.body("roll1"), speed=20.0)
    assert found.distance is None
    assert found.why_not == "no such curve"
