"""The two axles of a vehicle: what its file says by the suffixes ``_front`` and ``_rear``."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import prod

from canroll.vehicles.model import GRAVITY, Vehicle
from canroll.vehicles.suspensions.curve import Curve
from canroll.vehicles.suspensions.tables import SECTION, AxleTables
from canroll.vehicles.suspensions.wheel import WheelCurves, at_rest
from canroll.vehicles.tyres import Similarity, TyreModel
from canroll.vehicles.tyres.magic_formula import MagicFormula

TYRES: dict[str, type[TyreModel]] = {"similarity": Similarity, "magic_formula": MagicFormula}
"""Tyre models by name, in the order of their kernels."""


@dataclass(frozen=True, slots=True)
class Axle:
    """One axle with its two wheels; SI units.

    Attributes:
        name: "front" or "rear".
        ahead: distance ahead of the car's CG; negative of the rear axle.
        opposite: distance of the other axle from the CG, positive.
        half_track: m.
        roll_centre: height above the road, m.
        unsprung: mass of both wheels and what moves with them, kg.
        share: of the car's weight at rest.
        wheel_load: load of one wheel at rest, N.
        spring: rate of one spring at the wheel, N/m.
        roll_share: of the suspension's roll stiffness.
        roll_damping: its part of the body's, N·m·s/rad.
        relaxation_length: of one tyre, m.
        tyre_model: name in :data:`TYRES`.
        tyre: one tyre.
        tables: of the axle.
    """

    name: str
    ahead: float
    opposite: float
    half_track: float
    roll_centre: float
    unsprung: float
    share: float
    wheel_load: float
    spring: float
    roll_share: float
    roll_damping: float
    relaxation_length: float
    tyre_model: str
    tyre: TyreModel
    tables: AxleTables

    @property
    def curves(self) -> WheelCurves:
        """Its tables at the wheel, from where this stands at rest.

        Raises:
            CanrollError: they hold no wheel of that load.
        """
        carried = self.wheel_load - 0.5 * self.unsprung * GRAVITY
        return at_rest(self.tables, carried, f"{SECTION}.{self.name}")

    @property
    def damping(self) -> float:
        """Mean damping of one wheel's travel (N·s/m)."""
        return self.roll_damping / (2 * self.half_track**2)

    @property
    def cornering(self) -> float:
        """Cornering stiffness of both tyres at rest (N/rad)."""
        return 2.0 * self.tyre.linear(self.wheel_load).cornering

    def bar(self, suspension_stiffness: float) -> float:
        """Roll stiffness (N·m/rad) of its bar, if springs and bars of both axles have that much.

        Negative where the springs alone have more.
        """
        return self.roll_share * suspension_stiffness - 2 * self.spring * self.half_track**2


@lru_cache(maxsize=256)
def axles(vehicle: Vehicle) -> tuple[Axle, Axle]:
    """Front and rear axle of a vehicle."""
    geometry, mass, suspension = vehicle.geometry, vehicle.mass, vehicle.suspension
    places = geometry.cg_to_front_axle, geometry.cg_to_rear_axle
    wheel_loads = vehicle.wheel_loads
    damping_share, share = suspension.roll_damping_front_share, geometry.static_front_share
    roll_share = suspension.roll_stiffness_front_share
    tracks = geometry.half_track_front, geometry.half_track_rear
    roll_centres = geometry.roll_centre_height_front, geometry.roll_centre_height_rear
    unsprung = mass.unsprung_front, mass.unsprung_rear
    model = "similarity" if vehicle.magic_formula is None else "magic_formula"
    springs = suspension.spring_rate_front, suspension.spring_rate_rear

    def axle(i: int) -> Axle:
        wheel_load = wheel_loads[i]
        tyre = TYRES[model].of_axle(vehicle, i, wheel_load)
        return Axle(
            name=("front", "rear")[i],
            ahead=(places[0], -places[1])[i],
            opposite=places[1 - i],
            half_track=tracks[i],
            roll_centre=roll_centres[i],
            unsprung=unsprung[i],
            share=(share, 1.0 - share)[i],
            wheel_load=wheel_load,
            spring=springs[i],
            roll_share=(roll_share, 1.0 - roll_share)[i],
            roll_damping=(damping_share, 1.0 - damping_share)[i] * vehicle.plant.roll_damping,
            relaxation_length=tyre.relaxation(wheel_load) or vehicle.tyre.relaxation_length,
            tyre_model=model,
            tyre=tyre,
            tables=AxleTables() if vehicle.axles is None else vehicle.axles.both[i],
        )

    return axle(0), axle(1)


def road_wheel_curve(vehicle: Vehicle) -> Curve | None:
    """Angle of the left front wheel over the plants' steer, both rad; None without a table.

    The steer is the angle of the steering wheel over the ratio on centre. The right wheel is the
    mirror image of the left one.
    """
    table = None if vehicle.axles is None else vehicle.axles.front.steering
    if table is None:
        return None
    return Curve(tuple(angle / vehicle.steering.ratio for angle in table.x), table.y)


def road_wheels(vehicle: Vehicle, steer: float) -> float:
    """Mean angle of the front wheels (rad) by the steering alone, at a ``steer`` of the plants."""
    curve = road_wheel_curve(vehicle)
    return steer if curve is None else 0.5 * (curve(steer) - curve(-steer))


def rebound_ratio(both: Sequence[Axle]) -> float:
    """Geometric mean over the axles of a damper's slope at rest in rebound over compression.

    1 without tables of dampers.
    """
    slopes = [axle.curves.damping for axle in both if axle.tables.damper is not None]
    ratios = [rebound / compression for compression, rebound in slopes]
    return prod(ratios) ** (1.0 / len(ratios)) if ratios else 1.0
