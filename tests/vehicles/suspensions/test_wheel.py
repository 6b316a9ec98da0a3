"""Tables at the wheel: against numpy's interpolation and quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from canroll.errors import CanrollError
from canroll.vehicles.suspensions.curve import Curve
from canroll.vehicles.suspensions.tables import AxleTables, Bar
from canroll.vehicles.suspensions.wheel import at_rest, installed

SPRING = Curve((0.0, 0.1, 0.16, 0.2, 0.24), (0.0, 2300.0, 3800.0, 5300.0, 8200.0))
RATIO = Curve((-0.08, -0.03, 0.02, 0.08), (0.60, 0.66, 0.72, 0.86))


def ratio(z):
    return np.interp(z, RATIO.x, RATIO.y)


def test_a_curve_interpolates_and_goes_on_as_its_last_lines():
    inside = np.linspace(0.0, 0.24, 97)
    assert [SPRING(x) for x in inside] == pytest.approx(np.interp(inside, SPRING.x, SPRING.y))
    assert SPRING(0.25) == pytest.approx(8200.0 + 0.01 * 2900.0 / 0.04)
    assert SPRING(-0.1) == pytest.approx(-2300.0)
    assert SPRING.slope(0.05) == pytest.approx(23e3) and SPRING.slope(0.1) == pytest.approx(24e3)
    assert SPRING.where(5000.0) == pytest.approx(np.interp(5000.0, SPRING.y, SPRING.x))


def test_the_car_stands_where_the_spring_carries_it():
    carried = 3000.0
    wheel = at_rest(AxleTables(spring=SPRING, spring_ratio=RATIO), carried)
    start = np.interp(carried / ratio(0.0), SPRING.y, SPRING.x)
    assert wheel.rest == pytest.approx(0.0, abs=1e-9)

    def force(z):
        way = quad(ratio, 0.0, z, points=[each for each in RATIO.x if min(0, z) < each < max(0, z)])
        return np.interp(start + way[0], SPRING.x, SPRING.y) * ratio(z)

    for z in (-0.07, -0.02, 0.0, 0.013, 0.05, 0.075):
        assert wheel.spring(z) == pytest.approx(force(z), abs=2e-5 * 8200.0)
    assert wheel.rate == pytest.approx((force(1e-3) - force(-1e-3)) / 2e-3, rel=1e-2)
    # a heavier load on the spring as installed: by hand
    tables = installed(AxleTables(spring=SPRING, spring_ratio=RATIO), carried, "front")
    lower = at_rest(tables, 3600.0)
    assert lower.rest == pytest.approx(brentq(lambda z: force(z) - 3600.0, 0.0, 0.08), abs=1e-5)
    assert lower.spring(0.0) == pytest.approx(3600.0)


def test_the_work_at_the_wheel_is_that_of_the_spring():
    wheel = at_rest(AxleTables(spring=SPRING, spring_ratio=RATIO), 3000.0)
    z = np.linspace(-0.06, 0.06, 4001)
    at_wheel = np.trapezoid([wheel.spring(each) for each in z], z)
    start = np.interp(3000.0 / ratio(0.0), SPRING.y, SPRING.x)
    s = start + np.array([quad(ratio, 0.0, end, points=RATIO.x[1:3])[0] for end in (-0.06, 0.06)])
    fine = np.linspace(*s, 4001)
    assert at_wheel == pytest.approx(
        np.trapezoid(np.interp(fine, SPRING.x, SPRING.y), fine), rel=5e-5
    )


def test_the_lever_of_a_bar():
    # the wheels 1 cm apart turn the levers of 0.2 m by 0.6 cm
    bar = Bar(torsional_stiffness=800.0, lever=0.2, ratio=0.6)
    torque = 800.0 * 0.006 / 0.2
    assert bar.stiffness * 0.01 == pytest.approx(0.6 * torque / 0.2)


def test_damping_and_stops():
    tables = AxleTables(
        damper=Curve((-1.0, -0.1, 0.0, 0.1, 1.0), (-2500.0, -700.0, 0.0, 300.0, 1200.0)),
        stops=Curve((-0.09, -0.07, 0.06, 0.09), (-6000.0, 0.0, 0.0, 9000.0)),
        spring=SPRING,
        damper_ratio=Curve((-0.1, 0.1), (0.8, 1.0)),
    )
    wheel = at_rest(tables, 3000.0)
    assert wheel.damping == pytest.approx((3000.0 * 0.81, 7000.0 * 0.81))
    assert wheel.clearances == pytest.approx((0.06, 0.07))


@pytest.mark.parametrize(
    ("tables", "carried", "message"),
    [
        (AxleTables(spring=SPRING), 9000.0, "carries 0 to 8200 N, but at rest 9000 N"),
        (AxleTables(spring=SPRING, installed=0.1), 9000.0, "0 to 8200 N at the wheel, but 9000"),
        (
            AxleTables(spring=SPRING, spring_ratio=Curve((-0.1, 0.1), (2.9, 0.1))),
            3000.0,
            "falls with compression",
        ),
        (
            AxleTables(spring=SPRING, stops=Curve((-0.1, 0.0, 0.1), (-9.0, 5.0, 9.0))),
            3000.0,
            "stands on a stop with 5 N",
        ),
    ],
)
def test_a_wheel_that_the_tables_do_not_hold_is_refused(tables, carried, message):
    with pytest.raises(CanrollError, match=message):
        at_rest(tables, carried, "axles.front")
