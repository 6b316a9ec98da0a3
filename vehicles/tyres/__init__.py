"""Tyre models by name: what one tyre does, for designs; the kernels of the plant have the same.

A model is a class in :data:`canroll.vehicles.axles.TYRES`. Its ``parameters`` are what its kernel
in :data:`canroll.plant_sim.bodies.tyre.KERNELS` reads; all else follows from that kernel by
differences, unless the model has it in closed form.

Slips are those of the wheel over the road at its lowest line: ``slip_ratio`` (ω R − v) / v along
the wheel, ``slip_angle`` the tangent of the slip angle, > 0 pushes left; ``camber`` the sine of the
wheel's inclination, > 0 as a roll angle. ``friction`` is the road's, 1 where the tyre was measured.
Forces are along the wheel and to its left, the moment is about the road's normal.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import atan, cos, sin
from pkgutil import resolve_name
from typing import Any, ClassVar, NamedTuple

STEP = 1e-5
"""Slip by which forces are differenced."""
MOST_SLIP = 1.0
"""Slip within which a tyre has its most lateral force."""
HALVINGS = 30
"""Of that interval in the search for the peak."""
LEAST = 0.25
"""Share of grip and of stiffness per load that remains at any overload."""


class Stiffness(NamedTuple):
    """Force of one tyre per slip ratio (N) and per slip angle (N/rad), without slip."""

    longitudinal: float
    cornering: float


class TyreModel(ABC):
    """One tyre of an axle; ``NUMBERS`` are the names of its parameters."""

    NUMBERS: ClassVar[tuple[str, ...]]

    @classmethod
    @abstractmethod
    def of_axle(cls, vehicle: Any, axle: int, wheel_load: float) -> "TyreModel":  # noqa: ANN401
        """The tyre of a vehicle's axle (0 front, 1 rear) that carries ``wheel_load`` (N)."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[float, ...]:
        """What the model's kernel reads."""

    @property
    def load_sensitive(self) -> bool:
        """Whether two tyres give less lateral force the more their loads differ."""
        return True

    def forces(  # noqa: PLR0917
        self,
        load: float,
        slip_ratio: float,
        slip_angle: float,
        camber: float = 0.0,
        friction: float = 1.0,
        hand: float = 1.0,
    ) -> tuple[float, float, float]:
        """Longitudinal and lateral force (N) and aligning moment (N·m) at ``load`` (N).

        ``hand`` is 1 for a tyre on the left and -1 for one on the right.
        """
        forces: tuple[float, float, float] = resolve_name(
            "canroll.plant_sim.bodies.tyre:forces_of"
        )(self, load, slip_ratio, slip_angle, camber, friction, hand)
        return forces

    def relaxation(self, load: float) -> float | None:
        """Lateral relaxation length (m) at ``load`` (N); None where the vehicle file says it."""
        return None

    def linear(self, load: float, friction: float = 1.0) -> Stiffness:
        """Stiffness at ``load`` (N)."""
        ahead = self.forces(load, STEP, 0.0, 0.0, friction)[0]
        behind = self.forces(load, -STEP, 0.0, 0.0, friction)[0]
        return Stiffness((ahead - behind) / (2.0 * STEP), self.lateral(load, 0.0, friction)[1])

    def lateral(self, load: float, slip_angle: float, friction: float) -> tuple[float, float]:
        """Lateral force (N) of a freely rolling tyre, and its slope over the slip angle (N/rad)."""
        more = self.forces(load, 0.0, slip_angle + STEP, 0.0, friction)[1]
        less = self.forces(load, 0.0, slip_angle - STEP, 0.0, friction)[1]
        force = self.forces(load, 0.0, slip_angle, 0.0, friction)[1]
        return force, (more - less) / (2.0 * STEP)

    def pneumatic_trail(self, load: float) -> float:
        """Way (m) of the lateral force of a small slip angle behind the middle of the contact."""
        more, less = (self.forces(load, 0.0, slip, 0.0) for slip in (STEP, -STEP))
        return (less[2] - more[2]) / (more[1] - less[1])

    def grip(self, load: float, friction: float) -> float:
        """Largest lateral force (N) of a freely rolling tyre: its curve has one peak."""
        low, high, force = 0.0, MOST_SLIP, 0.0
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            force, slope = self.lateral(load, middle, friction)
            low, high = (middle, high) if slope > 0.0 else (low, middle)
        return force


@dataclass(frozen=True, slots=True)
class Similarity(TyreModel):
    """Magic formula with similarity: grip and cornering stiffness depend on load.

    Both slips are scaled by their stiffness and by the grip, their resultant goes through one
    curve, and the force points along it (Pacejka, Tire and Vehicle Dynamics, section 4.2). Of one
    tyre: stiffnesses (N per slip, N/rad) at ``static_load`` (N); see
    :class:`canroll.vehicles.model.Tyre`.
    """

    NUMBERS: ClassVar = (
        *("per_load", "longitudinal", "cornering", "friction"),
        *("friction_load_slope", "cornering_load_slope", "shape", "curvature"),
    )
    static_load: float
    longitudinal: float
    cornering: float
    friction: float
    friction_load_slope: float
    cornering_load_slope: float
    shape: float
    curvature: float

    @classmethod
    def of_axle(cls, vehicle: Any, axle: int, wheel_load: float) -> "Similarity":  # noqa: ANN401
        """The tyre of an axle, from the vehicle's ``tyre`` section."""
        tyre = vehicle.tyre
        both = (tyre.cornering_stiffness_front, tyre.cornering_stiffness_rear)[axle]
        return cls(
            static_load=wheel_load,
            longitudinal=tyre.longitudinal_stiffness,
            cornering=both / 2,
            friction=tyre.friction,
            friction_load_slope=tyre.friction_load_slope,
            cornering_load_slope=tyre.cornering_load_slope,
            shape=tyre.shape,
            curvature=tyre.curvature,
        )

    @property
    def parameters(self) -> tuple[float, ...]:
        """Inverse of the static load, then the other fields."""
        return (1.0 / self.static_load, *(getattr(self, name) for name in self.NUMBERS[1:]))

    @property
    def load_sensitive(self) -> bool:
        """Whether grip or cornering stiffness falls with load."""
        return self.cornering_load_slope > 0.0 or self.friction_load_slope > 0.0

    def linear(self, load: float, friction: float = 1.0) -> Stiffness:
        """Stiffness at ``load`` (N), the same on every road with any friction."""
        ratio = load / self.static_load
        falling = max(1.0 - self.cornering_load_slope * (ratio - 1.0), LEAST)
        return Stiffness(self.longitudinal * ratio, self.cornering * ratio * falling)

    def grip(self, load: float, friction: float) -> float:
        """Largest lateral force (N)."""
        overload = load / self.static_load - 1.0
        falling = max(1.0 - self.friction_load_slope * overload, LEAST)
        return self.friction * friction * falling * load

    def lateral(self, load: float, slip_angle: float, friction: float) -> tuple[float, float]:
        """Lateral force (N) and its slope (N/rad): the magic formula's derivative."""
        slope, peak = self.linear(load).cornering, self.grip(load, friction)
        x = slope * slip_angle / (peak * self.shape)
        bent = x - self.curvature * (x - atan(x))
        rise = 1.0 - self.curvature * (1.0 - 1.0 / (1.0 + x * x))
        angle = self.shape * atan(bent)
        return peak * sin(angle), slope * cos(angle) * rise / (1.0 + bent * bent)
