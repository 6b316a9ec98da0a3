"""Pass or fail by the standards: FMVSS 126, NHTSA's rollover tests, ISO 3888 cone tracks.

Every function reads recorded signals by name, one value per millisecond, SI units: those of
:meth:`canroll.plant_sim.world.world.World.signals` or of
:func:`canroll.plant_sim.world.open_loop.signals`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, inf, sin

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.bodies.ports import WHEELS
from canroll.plant_sim.driving import path, steer_maneuvers
from canroll.plant_sim.driving.path_maneuvers import APPROACH, OVERHANG
from canroll.typing import Vector
from canroll.vehicles import Vehicle

Signals = Mapping[str, NDArray[np.float64]]

SAMPLE = 1e-3
TWO_INCHES = 0.0508
CONE_SPACING = 3.0
"""Greatest distance between the cones along a lane (m)."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """One criterion: measured value, limit of the standard, and whether it is met."""

    criterion: str
    clause: str
    value: float
    limit: float
    unit: str
    passed: bool


def judge(maneuver: str, vehicle: Vehicle, signals: Signals) -> list[Verdict]:
    """All verdicts of that manoeuvre's standard; none if it has no criteria."""
    if maneuver == "sine_with_dwell":
        return sine_with_dwell(vehicle, signals)
    if maneuver in ("fishhook", "j_turn"):
        return two_wheel_lift(signals)
    lanes = track(maneuver, vehicle)
    if maneuver == "double_lane_change":
        return [cones(vehicle, signals, lanes, "ISO 3888-1, 4"), *two_wheel_lift(signals)]
    if maneuver == "moose":
        entry = 3.6 * float(np.interp(APPROACH, signals["x"], signals["vx"]))
        return [
            cones(vehicle, signals, lanes, "ISO 3888-2, 4"),
            Verdict("entry speed", "ISO 3888-2, 5", entry, inf, "km/h", True),
            *two_wheel_lift(signals),
        ]
    return []


def _at(values: Vector, time: float) -> float:
    return float(values[min(round(time / SAMPLE), values.size - 1)])


def sine_with_dwell(vehicle: Vehicle, signals: Signals) -> list[Verdict]:
    """Yaw-rate decay and lateral displacement after FMVSS 126, S5.2.1 to S5.2.3.

    Yaw rate 1.0 and 1.75 s after the end of steering at most 35 and 20 % of its second peak;
    lateral displacement 1.07 s after its beginning at least 1.83 m (1.52 m above 3500 kg), judged
    from five times the angle for 0.3 g upwards.
    """
    begin = steer_maneuvers.START
    end = begin + 1 / 0.7 + 0.5
    yaw_rate = signals["yaw_rate"]
    # The second peak follows the reversal: nothing before it may count.
    reversal = round((begin + 0.5 / 0.7) / SAMPLE)
    peak = float(np.abs(yaw_rate[reversal:]).max())
    verdicts = []
    for delay, share, clause in ((1.0, 0.35, "S5.2.1"), (1.75, 0.20, "S5.2.2")):
        rest = abs(_at(yaw_rate, end + delay)) / peak if peak > 0 else 0.0
        criterion = f"yaw rate {delay:g} s after the steering"
        verdicts.append(
            Verdict(criterion, f"FMVSS 126, {clause}", rest, share, "of the peak", rest <= share)
        )
    scale = float(np.abs(signals["steer"]).max()) / steer_maneuvers.reference_angle(vehicle)
    if scale > 5.0 - 1e-6:
        moved = abs(_at(signals["y"], begin + 1.07) - _at(signals["y"], begin))
        least = 1.83 if vehicle.total_mass <= 3500 else 1.52
        verdicts.append(
            Verdict("lateral displacement", "FMVSS 126, S5.2.3", moved, least, "m", moved >= least)
        )
    return verdicts


def two_wheel_lift(signals: Signals) -> list[Verdict]:
    """Both wheels of a side two inches off the road at once: NHTSA's criterion of tip-up.

    No verdict on a vehicle whose model does not say how high its wheels are.
    """
    heights = [signals[f"wheel_height_{wheel}"] for wheel in WHEELS]
    if any(np.isnan(height[:1]).any() for height in heights):
        return []
    left = np.minimum(heights[0], heights[2]).max()
    right = np.minimum(heights[1], heights[3]).max()
    lift = inf if signals["rollover"].max() > 0 else float(max(left, right))
    passed = lift < TWO_INCHES
    return [Verdict("two-wheel lift", "NHTSA, 2 inches", lift, TWO_INCHES, "m", passed)]


def track(maneuver: str, vehicle: Vehicle) -> tuple[path.Lane, ...]:
    """Lanes of a manoeuvre's cone track; none if it has no cones."""
    if maneuver == "double_lane_change":
        return path.double_lane_change(vehicle.geometry.width, vehicle.lane_offset)
    return path.obstacle_avoidance(vehicle.geometry.width) if maneuver == "moose" else ()


def cones_of(maneuver: str, vehicle: Vehicle) -> NDArray[np.float64]:
    """Positions of a manoeuvre's cones on the road, (n, 2) in m; n = 0 if it has none."""
    positions: NDArray[np.float64] = np.add(cone_positions(track(maneuver, vehicle)), (APPROACH, 0))
    return positions


def cone_positions(lanes: tuple[path.Lane, ...]) -> NDArray[np.float64]:
    """Positions of a track's cones at its lanes' edges, (n, 2) in m, x from the first lane."""
    points = []
    for lane in lanes:
        count = int(np.ceil(lane.length / CONE_SPACING)) + 1
        for x in np.linspace(lane.start, lane.start + lane.length, count):
            points += [(x, lane.centre - lane.width / 2), (x, lane.centre + lane.width / 2)]
    return np.array(points).reshape(-1, 2)


def cones(vehicle: Vehicle, signals: Signals, lanes: tuple[path.Lane, ...], clause: str) -> Verdict:
    """Number of cones hit by the bodywork's outline, a rectangle; none is a pass."""
    points = cone_positions(lanes) + np.array([APPROACH, 0.0])
    geometry = vehicle.geometry
    front, rear = geometry.cg_to_front_axle + OVERHANG, geometry.cg_to_rear_axle + OVERHANG
    hit = np.zeros(len(points), dtype=bool)
    for x, y, yaw in zip(signals["x"][::5], signals["y"][::5], signals["yaw"][::5], strict=True):
        away = points - (x, y)
        ahead = away[:, 0] * cos(yaw) + away[:, 1] * sin(yaw)
        aside = away[:, 1] * cos(yaw) - away[:, 0] * sin(yaw)
        hit |= (ahead < front) & (ahead > -rear) & (np.abs(aside) < geometry.width / 2)
    count = int(hit.sum())
    return Verdict("cones hit", clause, float(count), 0.0, "", count == 0)
