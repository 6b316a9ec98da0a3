"""Tyres linearised at a trim: lateral force of an axle per slip angle and per load transfer."""

from collections.abc import Iterator
from dataclasses import dataclass

from scipy.optimize import brentq

from canroll.errors import CanrollError
from canroll.vehicles import GRAVITY, Vehicle
from canroll.vehicles.axles import axles
from canroll.vehicles.roll_stiffness import steady_roll, suspension_roll_stiffness
from canroll.vehicles.tyres import TyreModel

LEAST_LOAD = 0.05
"""Share of its static load that the inner wheel must keep for a trim to be linear about."""
MOST_GRIP = 0.97
"""Share of an axle's grip that a trim may use."""


@dataclass(frozen=True, slots=True)
class AxleTyres:
    """Both tyres of an axle, linear about a trim.

    Attributes:
        cornering: force per slip angle, N/rad.
        transfer: force per load transferred from the left to the right wheel, N/N; zero in
            straight running.
    """

    cornering: float
    transfer: float


def steady_curve(
    vehicle: Vehicle, lateral_acceleration: float, friction: float
) -> tuple[AxleTyres, AxleTyres]:
    """Return front and rear tyres in a steady curve.

    Args:
        vehicle: its plant part.
        lateral_acceleration: of the curve, m/s², not negative; 0 is straight running.
        friction: of the road, relative to that of the tyre's friction coefficient.

    Raises:
        CanrollError: an inner wheel lifts, or the grip does not suffice for this curve.
    """
    front, rear = (axle.linear(lateral_acceleration, friction) for axle in _axles(vehicle))
    return front, rear


def most_lateral_acceleration(vehicle: Vehicle, friction: float) -> float:
    """Return the largest lateral acceleration with a linear trim, m/s²: grip or wheel lift."""
    lift = min(axle.lift for axle in _axles(vehicle))
    grip = [
        float(brentq(lambda a, axle=axle: axle.reserve(a, friction), 0.0, lift))
        if axle.reserve(lift, friction) < 0.0
        else lift
        for axle in _axles(vehicle)
    ]
    return min(grip)


def slip_angles(
    vehicle: Vehicle,
    lateral_acceleration: float,
    friction: float,
    carried: tuple[float, float] = (0.0, 0.0),
) -> tuple[float, float]:
    """Return the slip angles of front and rear axle in a steady curve, rad.

    Args:
        vehicle: its plant part.
        lateral_acceleration: of the curve, m/s², not negative.
        friction: of the road.
        carried: actuator moment of each axle; see
        :func:`canroll.vehicles.roll_stiffness.steady_roll`.

    Raises:
        CanrollError: an inner wheel lifts, or the grip does not suffice for this curve.
    """
    front, rear = (axle.slip(lateral_acceleration, friction) for axle in _axles(vehicle, carried))
    return front, rear


@dataclass(frozen=True, slots=True)
class _Axle:
    """An axle: one tyre, load per wheel (N), load transfer and force (N) per lateral acceleration.

    ``static`` is the load at rest; ``carried`` that of rolling straight on, where the resistance of
    the tyres, a couple of the road about their axles, moves load to the rear.
    """

    tyre: TyreModel
    static: float
    carried: float
    transferred: float
    force: float

    def loads(self, lateral_acceleration: float) -> tuple[float, float]:
        moved = self.transferred * lateral_acceleration
        return self.carried - moved, self.carried + moved

    @property
    def lift(self) -> float:
        """Lateral acceleration at which the inner wheel has its least load."""
        return (self.carried - LEAST_LOAD * self.static) / self.transferred

    def reserve(self, lateral_acceleration: float, friction: float) -> float:
        """Return the remaining grip, N."""
        loads = self.loads(lateral_acceleration)
        available = MOST_GRIP * sum(self.tyre.grip(load, friction) for load in loads)
        return available - self.force * lateral_acceleration

    def both(
        self, slip: float, lateral_acceleration: float, friction: float, shift: float = 0.0
    ) -> float:
        """Return the lateral force of both wheels, N, with a further load transfer ``shift``, N."""
        inner, outer = self.loads(lateral_acceleration)
        force = self.tyre.lateral(inner - shift, slip, friction)[0]
        return force + self.tyre.lateral(outer + shift, slip, friction)[0]

    def slip(self, lateral_acceleration: float, friction: float) -> float:
        """Return the slip angle at which the axle carries its share, rad."""
        left = self.loads(lateral_acceleration)[0]
        needed = self.force * lateral_acceleration
        if left < LEAST_LOAD * self.static or self.reserve(lateral_acceleration, friction) < 0.0:
            raise CanrollError(
                f"no steady curve of {lateral_acceleration:g} m/s² at friction {friction:g}: "
                "the inner wheels lift or the grip is too low"
            )

        def lack(slip: float) -> float:
            return needed - self.both(slip, lateral_acceleration, friction)

        most = 0.01
        while lack(most) > 0.0:
            most *= 1.1
        return float(brentq(lack, 0.0, most, xtol=1e-12))

    def linear(self, lateral_acceleration: float, friction: float) -> AxleTyres:
        """Return both wheels about the trim in which the axle carries its share."""
        slip = self.slip(lateral_acceleration, friction)
        step = 1e-4 * self.static
        more, less = (
            self.both(slip, lateral_acceleration, friction, shift) for shift in (step, -step)
        )
        slopes = (
            self.tyre.lateral(load, slip, friction)[1] for load in self.loads(lateral_acceleration)
        )
        return AxleTyres(sum(slopes), (more - less) / (2.0 * step))


def _axles(vehicle: Vehicle, carried: tuple[float, float] = (0.0, 0.0)) -> Iterator[_Axle]:
    """Yield front and rear axle."""
    data = vehicle.tyre
    _, *tilts = steady_roll(vehicle, suspension_roll_stiffness(vehicle), carried)
    resistance = data.rolling_resistance * vehicle.total_mass * GRAVITY
    to_rear = 0.5 * resistance * data.radius / vehicle.geometry.wheelbase
    for axle, tilt, moved in zip(axles(vehicle), tilts, (-to_rear, to_rear), strict=True):
        transferred = data.vertical_stiffness * axle.half_track * tilt
        force = axle.share * vehicle.total_mass
        yield _Axle(axle.tyre, axle.wheel_load, axle.wheel_load + moved, transferred, force)
