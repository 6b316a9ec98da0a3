"""Fit of the 14-DOF car to the measured drive of the example, with priors and unknowns of its own.

The search is that of ``canroll fit``; what differs is
what is unknown: one delay of the steering instead of one of each signal, and for checks the share
of gravity in the lateral acceleration.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from canroll.extensions.car.identification import replay, unknowns
from canroll.extensions.car.identification.information import Information
from canroll.extensions.car.identification.output_error import (
    Model,
    Point,
    Simulator,
    search,
    weights,
)
from canroll.extensions.car.identification.pieces import Piece, Window
from canroll.extensions.car.identification.unknowns import STEERING_OFFSET, Unknown, offset_key
from canroll.typing import Vector
from canroll.vehicles import Vehicle
from canroll.vehicles.model import GRAVITY

PASSES = 4
CORRELATED = 10.0
"""Samples per independent one: residuals are correlated over about 0.1 s."""

NOISE = (0.003, 0.15, 0.01, 0.0015)
"""Residual of each signal that the first pass assumes (rad/s, m/s², rad/s, rad)."""
SETTLED = 1e-4
"""Fall of the cost at which a search ends."""

STEERING_DELAY = "log.steering_delay"
"""How much later the steering angle was stamped than the motion (s)."""
ROLL_OFFSET = offset_key("roll")
"""Measured roll (rad) of a car that does not roll: the unit's own, and the road's bank."""
GRAVITY_SHARE = "log.gravity_share"
"""Share of g sin(roll) in the lateral acceleration: 0 if it is horizontal, 1 along the body."""


def _unknown(key: str, prior: tuple[float, float, float, float], source: str = "") -> Unknown:
    """Return an unknown by mean, deviation and bounds of its prior, and where that is from."""
    return Unknown(key, key, "", *prior, source)


TYRE, BODY = "30 per rad of the static load", "car of this class"
UNKNOWNS = (
    _unknown("tyre.cornering_stiffness_front", (320e3, 60e3, 100e3, 600e3), TYRE),
    _unknown("tyre.cornering_stiffness_rear", (290e3, 60e3, 100e3, 600e3), TYRE),
    _unknown("tyre.cornering_load_slope", (0.15, 0.10, 0.0, 0.49), "passenger-car tyres"),
    _unknown("tyre.friction", (1.10, 0.10, 0.8, 1.4), "dry asphalt"),
    _unknown("tyre.relaxation_length", (0.50, 0.20, 0.05, 1.5), "passenger-car tyres"),
    _unknown("mass.yaw_inertia", (3800.0, 200.0, 2500.0, 6000.0), "0.92 m l_f l_r"),
    _unknown("plant.roll_inertia", (950.0, 80.0, 500.0, 2000.0), "0.55 m of gyration about the CG"),
    _unknown("plant.roll_damping", (9000.0, 5000.0, 1000.0, 40e3), "30 % of critical"),
    _unknown("plant.roll_stiffness", (165e3, 40e3, 80e3, 400e3), "3 degrees per g"),
    _unknown("plant.cg_height_above_roll_axis", (0.46, 0.04, 0.30, 0.60), BODY),
    _unknown("geometry.roll_centre_height_front", (0.06, 0.04, -0.10, 0.25), BODY),
    _unknown("geometry.roll_centre_height_rear", (0.10, 0.04, -0.10, 0.25), BODY),
    _unknown("suspension.roll_stiffness_front_share", (0.55, 0.07, 0.3, 0.8), BODY),
    _unknown("suspension.roll_damping_front_share", (0.50, 0.10, 0.2, 0.8), BODY),
    _unknown("sensors.imu_position.0", (0.0, 0.50, -2.0, 2.0), "inside the car"),
    _unknown("sensors.imu_position.2", (0.0, 0.30, -0.5, 1.0), "inside the car"),
    _unknown(STEERING_OFFSET, (0.0, 0.03, -0.2, 0.2)),
    _unknown(STEERING_DELAY, (0.0, 0.01, -0.05, 0.05), "one sample"),
    _unknown(ROLL_OFFSET, (0.0, 0.01, -0.03, 0.03)),
)
OF_GRAVITY = _unknown(GRAVITY_SHARE, (0.5, 10.0, -50.0, 50.0))
"""A further unknown, to find out what the unit gives."""


def observed(
    record: NDArray[np.float64], piece: Piece, mounting: Mapping[str, float]
) -> NDArray[np.float64]:
    """Return what the unit shows of a drive: yaw rate, lateral acceleration, roll rate and roll.

    Args:
        record: of the drive, as of :func:`canroll.extensions.car.identification.replay.motion`.
        piece: what was steered, and how fast.
        mounting: how it was measured, by the keys of this module; 0 without.

    Returns:
        shape (n, 4), SI units.
    """
    early = -mounting.get(STEERING_DELAY, 0.0)
    columns = replay.FRAMES["levelled"]
    yaw, lateral, roll_rate, roll = (
        replay.sampled(record, columns[name], piece, early) for name in piece.names
    )
    roll = roll + mounting.get(ROLL_OFFSET, 0.0)
    lateral = lateral + mounting.get(GRAVITY_SHARE, 0.0) * GRAVITY * np.sin(roll)
    return np.column_stack((yaw, lateral, roll_rate, roll))


def steered(vehicle: Vehicle, piece: Piece, mounting: Mapping[str, float]) -> NDArray[np.float64]:
    """Return what the unit shows of ``vehicle``, steered as the measured car, (n, 4)."""
    offset = mounting.get(STEERING_OFFSET, 0.0)
    return observed(replay.motion(vehicle, piece, offset), piece, mounting)


class DriveModel(Model):
    """The drive with what is unknown of its mounting."""

    def observed(self, x: Vector, records: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return what the unit shows of records, (n, 4)."""
        values = self.values(x)
        parts = zip(records, self.pieces, strict=True)
        return np.concatenate([observed(record, piece, values) for record, piece in parts])


@dataclass(frozen=True, slots=True)
class Fit:
    """The fitted values, their standard deviations, and the car and mounting that they make."""

    unknowns: tuple[Unknown, ...]
    values: Vector
    deviations: Vector
    vehicle: Vehicle
    mounting: Mapping[str, float]


def fit(
    vehicle: Vehicle, piece: Piece, window: Window, sought: tuple[Unknown, ...] = UNKNOWNS
) -> Fit:
    """Fit ``sought`` to the part of ``piece`` in ``window``.

    What ``vehicle`` has for them does not matter: the search starts from the priors.
    """
    model = DriveModel(vehicle, (piece,), "levelled", window, sought)
    simulator = Simulator(model)
    every = np.ones(len(sought), bool)
    scale, x = np.array(NOISE) * np.sqrt(CORRELATED), np.zeros(len(sought))
    for _ in range(PASSES):
        x = search(simulator, Point(x, inf, scale), every, SETTLED).x
        last, scale = scale, weights(simulator, x)[0] * np.sqrt(CORRELATED)
    slopes = (simulator.slopes(x) / last[:, None]).reshape(-1, x.size)
    fisher = slopes.T @ slopes
    least = Information(fisher, fisher).least(every)
    values = model.values(x)
    return Fit(
        sought,
        np.array(list(values.values())),
        least * np.array([unknown.deviation for unknown in sought]),
        unknowns.applied(vehicle, values),
        {key: value for key, value in values.items() if key.startswith(unknowns.LOG)},
    )
