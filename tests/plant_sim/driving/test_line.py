"""The driver's line clears the cones and has the least curvature that another solver finds."""

import cvxpy as cp
import numpy as np
import pytest

from canroll import vehicles
from canroll.plant_sim.driving import line, path, standards
from canroll.plant_sim.driving.path_maneuvers import APPROACH, OVERHANG

LANES = path.obstacle_avoidance(1.8)
CAR = {"front": 2.1, "rear": 2.4, "width": 1.8}


def clear(lanes, curvature, **car):
    return line.through_gates(
        lanes, approach=APPROACH, run_out=30.0, curvature=curvature, **(CAR | car)
    )


@pytest.mark.parametrize("maneuver", ["double_lane_change", "moose"])
@pytest.mark.parametrize("name", vehicles.names())
@pytest.mark.parametrize("curvature", [np.inf, 0.0])
def test_the_outline_on_the_line_hits_no_cone(maneuver, name, curvature):
    vehicle = vehicles.load(name)
    geometry, lanes = vehicle.geometry, standards.track(maneuver, vehicle)
    x, y = line.through_gates(
        lanes,
        approach=APPROACH,
        run_out=30.0,
        front=geometry.cg_to_front_axle + OVERHANG,
        rear=geometry.cg_to_rear_axle + OVERHANG,
        width=geometry.width,
        curvature=curvature,
    )
    s = np.arange(0.0, x[-1], 0.05)
    moved = {"x": s, "y": np.interp(s, x, y)}
    moved["yaw"] = np.arctan(np.gradient(moved["y"], s))
    assert standards.cones(vehicle, moved, lanes, "").passed


@pytest.mark.slow
def test_no_other_line_has_less_curvature():
    x, y = clear(LANES, np.inf)
    step = 0.25
    at = np.arange(0.0, x[-1], step)
    heights = cp.Variable(len(at))
    slopes = (heights[1:] - heights[:-1]) / step
    bends = (slopes[1:] - slopes[:-1]) / step
    end = APPROACH + LANES[-1].start + LANES[-1].length + CAR["rear"]
    rules = [heights[:2] == 0.0, slopes[round(end / step)] == 0.0]
    for lane in LANES:
        room = 0.5 * (1.0 - line.RESERVE) * (lane.width - CAR["width"])
        for ahead in np.linspace(CAR["front"], -CAR["rear"], line.SIDE_POINTS):
            for place in APPROACH + lane.start + np.linspace(0.0, lane.length, 50):
                i, part = divmod((place - ahead) / step, 1.0)
                i = int(i)
                there = (1.0 - part) * heights[i] + part * heights[i + 1] + ahead * slopes[i]
                rules.append(cp.abs(there - lane.centre) <= room)
    best = cp.Problem(cp.Minimize(cp.sum_squares(bends) * step), rules).solve(solver="CLARABEL")
    ours = float(np.sum(np.diff(np.interp(np.arange(0.0, x[-1]), x, y), 2) ** 2))
    # of the line only points are known, so its curvature is averaged over metres
    assert ours == pytest.approx(best, rel=0.05)


def test_a_fast_car_goes_closer_to_the_cones():
    relaxed, tight = clear(LANES, np.inf), clear(LANES, 1e-3)
    assert np.abs(np.diff(tight[1], 2)).max() < np.abs(np.diff(relaxed[1], 2)).max()


def test_a_car_that_fits_nowhere_goes_through_the_middle():
    x, y = clear(LANES, np.inf, front=15.0, rear=15.0)
    middle = path.through(LANES, approach=APPROACH, run_out=30.0)
    assert np.array_equal(x, middle[0]) and np.array_equal(y, middle[1])
