"""Our 14-DOF plant agrees with an independent multi-body car of equal parameters."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from canroll import vehicles

pytest.importorskip("vehiclemodels", reason="needs commonroad-vehicle-models")

from support import comparison_cases as ours
from support import multi_body
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2

from canroll.vehicles.suspensions.tables import section

LONG = pytest.mark.long
pytestmark = pytest.mark.slow
TYRE = Path(__file__).parents[2] / "vehicles" / "tyres" / "passenger_52.tir"


@cache
def common(name):
    return ours.in_common(vehicles.load(name))


def differ(name, case, *, as_published=False):
    """Difference in per cent; the multi-body car has the parameters of the vehicle."""
    p = multi_body.parameters(common(name))
    theirs = multi_body.simulate(p, case.speed, case.steer, case.moments, as_published=as_published)
    found = ours.difference(ours.drive_plant(common(name), case), theirs)
    return {of: 100 * getattr(found, of) for of in found.__slots__}


def check(found, **limits):
    assert {of: limit > found[of] for of, limit in limits.items()} == dict.fromkeys(limits, True), (
        found
    )


@pytest.mark.parametrize(
    "speed", [pytest.param(60.0, marks=LONG), 80.0, pytest.param(100.0, marks=LONG)]
)
def test_van_in_lane_changes(speed):
    found = differ("van_real", ours.lane_change(common("van_real"), speed))
    check(found, yaw_rate=0.5, roll=0.8, lateral_acceleration=0.4, loads=1.5)


@pytest.mark.parametrize(
    "speed", [pytest.param(60.0, marks=LONG), 80.0, pytest.param(100.0, marks=LONG)]
)
def test_sedan_in_lane_changes(speed):
    """Its loads differ by what the multi-body car's springs leave out (below)."""
    found = differ("sedan_320i", ours.lane_change(common("sedan_320i"), speed))
    check(found, yaw_rate=0.9, roll=1.2, lateral_acceleration=0.9, loads=8.0)


def test_step():
    found = differ("van_real", ours.step())
    check(found, yaw_rate=0.4, roll=0.6, lateral_acceleration=0.4, loads=1.2)


@pytest.mark.parametrize(
    ("hertz", "roll", "loads"),
    [
        pytest.param(0.5, 1.2, 2.0, marks=LONG),
        (1.0, 4.0, 4.0),
        pytest.param(2.0, 4.0, 8.0, marks=LONG),
        pytest.param(3.0, 4.0, 12.0, marks=LONG),
    ],
)
def test_sines(hertz, roll, loads):
    found = differ("van_real", ours.sine(hertz))
    check(found, yaw_rate=1.5, roll=roll, lateral_acceleration=3.0, loads=loads)


@pytest.mark.parametrize(
    ("hertz", "yaw_rate", "roll"),
    [
        pytest.param(0.5, 0.5, 0.5, marks=LONG),
        (1.0, 0.4, 0.8),
        (3.0, 5.0, 3.0),
        pytest.param(5.0, 5.0, 7.5, marks=LONG),
    ],
)
def test_moments(hertz, yaw_rate, roll):
    """The body's answer to an anti-roll moment, and the small yaw rate that comes with it."""
    found = differ("van_real", ours.moment_sine(common("van_real"), hertz))
    check(found, yaw_rate=yaw_rate, roll=roll, lateral_acceleration=8.0)


def test_published_slip_is_that_of_another_point():
    """The package takes it from the velocity of the sprung body's CG: no tyre is there."""
    found = differ("van_real", ours.sine(1.0), as_published=True)
    assert found["roll"] > 10.0
    assert found["yaw_rate"] < 3.0


def on_files(vehicle, p):
    """The vehicle on a Magic Formula 5.2 with all that its tyres and the published ones say."""
    other = vehicles.load({"base": "sedan_320i", "title": "tyres", "tyre": {"file": str(TYRE)}})
    tyre, soft = vehicle.tyre, 1e3
    numbers = {
        key: 0.0 if key[0] in "PQRS" else value for key, value in other.magic_formula.front.items()
    }
    numbers |= {"PCX1": tyre.shape, "PDX1": tyre.friction, "PEX1": tyre.curvature}
    numbers |= {"PCY1": tyre.shape, "PDY1": tyre.friction, "PEY1": tyre.curvature}
    # stiffness is linear in load far below the load where it has its maximum
    numbers |= {"PKX1": p.tire.p_kx1, "PKY1": 0.5 * soft * p.tire.p_ky1, "PKY2": soft}
    # their inclination counts the other way, as their axes do
    numbers |= {"PHY3": -p.tire.p_hy3, "RCX1": 1.0, "RCY1": 1.0}
    return replace(vehicle, magic_formula=replace(other.magic_formula, front=numbers, rear=numbers))


def test_camber_by_travel():
    """Of the published sedan, with its camber on travel, on tyres with more thrust by it."""
    vehicle, case = common("sedan_320i"), ours.step()
    p, published = multi_body.parameters(vehicle), parameters_vehicle2()
    p.D_f, p.D_r, p.tire.p_hy3 = published.D_f, published.D_r, -0.1
    theirs = multi_body.simulate(p, case.speed, case.steer)
    rigid = on_files(vehicle, p)
    tables = {
        axle: {
            "kinematics": {
                "compression [m]": [-0.1, 0.1],
                "camber [rad]": [-0.1 * slope, 0.1 * slope],
            }
        }
        for axle, slope in (("front", p.D_f), ("rear", p.D_r))
    }
    cambered = replace(rigid, axles=section(tables, "published"))
    found, without = (
        ours.difference(ours.drive_plant(car, case), theirs) for car in (cambered, rigid)
    )
    assert found.yaw_rate < 0.003 and found.lateral_acceleration < 0.003 and found.roll < 0.01
    assert without.yaw_rate > 0.05


def test_moments_balance_in_a_steady_curve():
    """Ours do. The published springs push the axles along the body without an arm for it."""
    for name, share in (("van_real", 0.005), ("sedan_320i", 0.05)):
        vehicle, case = common(name), ours.step(0.2)
        inertia = vehicle.tyre.wheel_inertia
        transferred, required, _ = ours.balance(
            vehicle, ours.drive_plant(vehicle, case), wheel_inertia=inertia
        )
        assert transferred == pytest.approx(required, rel=5e-4)
        theirs = multi_body.simulate(multi_body.parameters(vehicle), case.speed, case.steer)
        transferred, required, unbalanced = ours.balance(vehicle, theirs, wheel_inertia=0.0)
        assert required - transferred == pytest.approx(unbalanced, rel=0.1)
        assert required - transferred > share * required


def test_standing_car_stands():
    p = multi_body.parameters(common("van_real"))
    still = multi_body.simulate(p, 20.0, np.zeros(300))
    assert np.ptp(still.loads, axis=0) == pytest.approx(0.0, abs=1e-6)
    assert still.loads[-1].sum() == pytest.approx(9.81 * p.m)
