"""Equipment of a vehicle: roll actuators of four kinds, sensors, and what the wind meets."""

from dataclasses import dataclass
from math import pi, sqrt


@dataclass(frozen=True, slots=True)
class ActiveSuspension:
    """Four-corner active suspension: one force actuator per corner.

    First-order lag (s), force limit (N), rate limit (N/s) and power limit (W), each per corner.
    """

    lag: float
    force_limit: float
    force_rate_limit: float
    power_limit: float


@dataclass(frozen=True, slots=True)
class ActiveBars:
    """Active anti-roll bars: one torque actuator per axle. Lag (s), limits (N·m, N·m/s)."""

    lag: float
    torque_limit: float
    torque_rate_limit: float


@dataclass(frozen=True, slots=True)
class SemiActiveDampers:
    """Continuously variable dampers: force over stroke rate at the softest and firmest current.

    ``rate`` (m/s, increasing, from 0), ``soft_force`` and ``firm_force`` (N) at those rates for
    extension; compression mirrors them. ``current_limit`` (A) is the firmest setting.
    """

    lag: float
    current_limit: float
    rate: tuple[float, ...]
    soft_force: tuple[float, ...]
    firm_force: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ElectroHydraulicBars:
    """Servo-valve and hydromotor in each anti-roll bar (Vu 2020, eqs. 1 to 7 and Table 1).

    Spool: ``valve_frequency`` (rad/s), ``valve_damping``, ``valve_gain`` (m/A), flow gain (m²/s),
    pressure coefficient (m³/(s·Pa)). Motor: bulk modulus (Pa), volumes (m³, m³/rad), leakage
    (m³/(s·Pa)) and leakage by rotation (m³/rad), inertia (kg·m²), damping (N·m·s/rad).
    ``bar_stiffness`` (N·m/rad) is the bar's twist at the motor shaft, ``lever_ratio`` body roll
    to shaft angle; limits of current (A), pressure (Pa) and shaft angle (rad).
    """

    valve_frequency: float
    valve_damping: float
    valve_gain: float
    flow_gain: float
    pressure_coefficient: float
    bulk_modulus: float
    volume: float
    displacement: float
    leakage: float
    leakage_by_rotation: float
    motor_inertia: float
    motor_damping: float
    bar_stiffness: float
    lever_ratio: float
    current_limit: float
    supply_pressure: float
    angle_limit: float


@dataclass(frozen=True, slots=True)
class Actuators:
    """Data of every kind of roll actuator that the vehicle can be fitted with."""

    suspension: ActiveSuspension
    bars: ActiveBars
    dampers: SemiActiveDampers
    valves: ElectroHydraulicBars


@dataclass(frozen=True, slots=True)
class SensorChannel:
    """One sensor signal: SI units of the signal, per √Hz, per K; filter (Hz) and latency (s)."""

    noise_density: float
    bias: float
    bias_per_kelvin: float
    range: float
    bandwidth: float
    latency: float

    @property
    def deviation(self) -> float:
        """Standard deviation of one sample: white noise through a filter of first order."""
        return self.noise_density * sqrt(pi / 2.0 * self.bandwidth)


@dataclass(frozen=True, slots=True)
class Sensors:
    """Mounting of the IMU and its channels, and the chassis sensors.

    ``imu_position``: m from the sprung CG (x, y, z); ``imu_misalignment``: rad about x, y, z.
    """

    imu_position: tuple[float, float, float]
    imu_misalignment: tuple[float, float, float]
    roll_rate: SensorChannel
    yaw_rate: SensorChannel
    lateral_acceleration: SensorChannel
    longitudinal_acceleration: SensorChannel
    suspension_travel: SensorChannel
    suspension_rate: SensorChannel
    speed: SensorChannel
    steering_wheel: SensorChannel


AIR_DENSITY = 1.2
"""Of air at 20 °C and 1013 hPa (kg/m³)."""
GUESSED_AIR = (
    "guessed: frontal area 0.85 times width and height (±15 %), height 2.5 times that of the "
    "centre of gravity, side-force slope of passenger cars (±30 %), centre of pressure a fifth of "
    "the wheelbase ahead of the middle (±50 %) at half the height (±20 %)"
)
"""What :meth:`Aerodynamics.guessed` rests on."""


@dataclass(frozen=True, slots=True)
class Aerodynamics:
    """Side force of the wind: F = ½ ρ A c' V v at the centre of pressure.

    V is the speed of the air relative to the car and v its part across the car, so that c' sin τ
    is the side-force coefficient at the angle of flow τ, linear up to about 30°. ``frontal_area``
    A (m²), ``side_force_slope`` c' (1/rad). The centre of pressure lies
    ``centre_of_pressure_ahead`` of the middle of the wheelbase (m), as the moments of SAE J1594
    give it, and ``centre_of_pressure_height`` above the road (m).
    """

    frontal_area: float
    side_force_slope: float
    centre_of_pressure_ahead: float
    centre_of_pressure_height: float

    @property
    def force_factor(self) -> float:
        """½ ρ A c' (kg/m)."""
        return 0.5 * AIR_DENSITY * self.frontal_area * self.side_force_slope

    @classmethod
    def guessed(cls, *, width: float, cg_height: float, wheelbase: float) -> "Aerodynamics":
        """Return those of a usual car of such sizes (m).

        Height of the centre of gravity as in the averages of a class; area over width times height
        is 0.81 for cars (Hucho, Aerodynamics of Road Vehicles), more for vans; slopes of side force
        and yawing moment are 0.035 to 0.06 and 0.007 to 0.017 per degree (Gillespie, Fundamentals
        of Vehicle Dynamics, ch. 4).
        """
        height = cg_height / 0.4
        return cls(
            frontal_area=0.85 * width * height,
            side_force_slope=2.6,
            centre_of_pressure_ahead=0.2 * wheelbase,
            centre_of_pressure_height=0.5 * height,
        )
