"""Parameters of the 14-DOF car: a record that its kernels read by name."""

from typing import Any, TypeAlias

import numpy as np

from canroll.errors import CanrollError
from canroll.plant_sim.bodies import curves, tyre
from canroll.plant_sim.kernels.jit import record_of
from canroll.plant_sim.kernels.records import fields
from canroll.typing import Vector
from canroll.vehicles import GRAVITY, Vehicle
from canroll.vehicles.axles import Axle, axles
from canroll.vehicles.roll_stiffness import suspension_roll_stiffness

Car: TypeAlias = Any
AxleRecord: TypeAlias = Any
"""Records of :data:`CAR` and :data:`AXLE` in a kernel."""


AXLE = np.dtype(
    [
        *fields("f8", "half_track per_track roll_centre unsprung preload spring bar"),
        *fields("f8", "bump rebound knee_speed high_speed_ratio"),
        *fields("f8", "bump_clearance rebound_clearance stop_rate"),
        *fields("f8", "first rows", curves.N_CURVES),
        *fields("f8", "tyre_model"),
        *fields("f8", "tyre", tyre.ROOM),
    ]
)
"""An axle: ``per_track`` is 1/2t, ``unsprung`` mass of both wheels; then of one wheel.

``bar`` is the force on a wheel per difference of the travels.
``preload`` is the suspension's force at rest, ``bump`` and ``rebound`` the slopes of the damper.
``first`` and ``rows`` are the places of its curves among the car's points; without rows there is
none, and the numbers hold.
"""
WHEEL = (
    "distance side hub_mass hub_up load radius unloaded_radius stiffness damping spin_inertia "
    "rolling_resistance per_relaxation"
)
"""Numbers of the four wheels, side by side.

Place ahead of the sprung CG and left of the middle; mass on the hub, its height above the roll
centre; load at rest; of the tyre the radius, radially stiffness and damping, the inverse relaxation
length.
"""
CAR = np.dtype(
    [
        *fields("f8", "mass sprung_mass offset arm axis_height roll_inertia pitch_inertia"),
        *fields("f8", "yaw_inertia attitudes steering_compliance caster_trail"),
        ("axle", AXLE, (2,)),
        *fields("f8", WHEEL, 4),
        *fields("f8", "points", 2 * curves.POINTS),
    ]
)
"""The car: inertias of the sprung body about its own CG, ``offset`` of this ahead of the car's.

``attitudes`` is how often an evaluation determines toe and camber of the wheels: 0 without tables.
``steering_compliance`` is the turn of both front wheels per moment about their kingpins.
"""

car_of = record_of(CAR)
"""In a kernel: the record that a parameter vector is."""


def build_parameters(vehicle: Vehicle) -> Vector:
    """The parameter vector of the 14-DOF car, a :data:`CAR`.

    Raises:
        CanrollError: springs stiffer than the car in roll.
    """
    plant, record = vehicle.plant, np.zeros(1, CAR)
    car = record[0]
    car["mass"] = vehicle.total_mass
    car["sprung_mass"] = plant.sprung_mass
    car["offset"] = vehicle.sprung_cg_offset
    car["arm"] = plant.cg_height_above_roll_axis
    car["axis_height"] = vehicle.roll_axis_height
    car["roll_inertia"] = plant.inertia_about_cg
    car["pitch_inertia"] = vehicle.mass.pitch_inertia
    car["yaw_inertia"] = vehicle.sprung_yaw_inertia
    stiffness = suspension_roll_stiffness(vehicle)
    both = axles(vehicle)
    for k, axle in enumerate(both):
        _fill_axle(car["axle"][k], axle, axle.bar(stiffness), vehicle)
        for name, value in _wheel(axle, vehicle).items():
            car[name][2 * k : 2 * k + 2] = value
        car["side"][2 * k + 1] = -axle.half_track
    curves.fill(car, both, vehicle)
    return record.view(np.float64)


def _fill_axle(record: Any, axle: Axle, bar: float, vehicle: Vehicle) -> None:  # noqa: ANN401
    suspension = vehicle.suspension
    record["half_track"] = axle.half_track
    record["roll_centre"] = axle.roll_centre
    record["unsprung"] = axle.unsprung
    record["preload"] = axle.wheel_load - 0.5 * axle.unsprung * GRAVITY
    record["spring"] = axle.spring
    record["per_track"] = 1.0 / (2 * axle.half_track)
    if bar < 0:
        raise CanrollError(
            f"{vehicle.name}: suspension.spring_rate_{axle.name} {axle.spring:g} N/m gives "
            f"more roll stiffness than the axle's share of plant.roll_stiffness; lower it by "
            f"{-bar / (2 * axle.half_track**2):.0f} N/m"
        )
    record["bar"] = bar * record["per_track"] ** 2
    record["bump"] = 2 * axle.damping / (1 + suspension.rebound_bump_ratio)
    record["rebound"] = 2 * axle.damping - record["bump"]
    for name in ("knee_speed", "high_speed_ratio", "bump_clearance", "rebound_clearance"):
        record[name] = getattr(suspension, name)
    record["stop_rate"] = suspension.bump_stop_rate
    tyre.fill(record, axle.tyre)


def _wheel(axle: Axle, vehicle: Vehicle) -> dict[str, float]:
    """The numbers of an axle's left wheel."""
    data = vehicle.tyre
    return {
        "distance": axle.ahead - vehicle.sprung_cg_offset,
        "side": axle.half_track,
        "hub_mass": 0.5 * axle.unsprung,
        "hub_up": data.radius - axle.roll_centre,
        "load": axle.wheel_load,
        "radius": data.radius,
        "unloaded_radius": data.radius + axle.wheel_load / data.vertical_stiffness,
        "stiffness": data.vertical_stiffness,
        "damping": data.vertical_damping,
        "spin_inertia": data.wheel_inertia,
        "rolling_resistance": data.rolling_resistance,
        "per_relaxation": 1.0 / axle.relaxation_length,
    }
