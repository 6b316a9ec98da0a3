"""Handling of a vehicle: understeer (ISO 4138), frequency response (ISO 7401), limits.

A test steers and evaluates; how its manoeuvres are driven, by the plant alone or in closed loop, is
its argument.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import atan, degrees, pi, radians, sqrt

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError, VerdictError
from canroll.plant_sim.bodies.ports import Body
from canroll.plant_sim.driving.drive import ManeuverPlan, make_drive, steady_steer
from canroll.plant_sim.driving.driver import STEER_TABLE
from canroll.plant_sim.driving.maneuvers import Maneuver, build
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.world import open_loop
from canroll.table import Table
from canroll.typing import Vector
from canroll.vehicles import GRAVITY, Vehicle
from canroll.vehicles.axles import road_wheels

SETTLED = 1000
"""How many of the last milliseconds of a steady run are averaged."""

LINEAR_ACCELERATION = 3.0
"""Lateral acceleration (m/s²) up to which the gradients are fitted."""

EVALUATED = ("vx", "vy", "ay", "yaw_rate", "roll", "path_error", "rollover", "steer")
"""Signals (:mod:`canroll.plant_sim.world.recording`) that the tests evaluate."""

Drive = Callable[[Maneuver, int], Mapping[str, NDArray[np.float64]]]
"""Drives a manoeuvre and returns the signals :data:`EVALUATED` of so many steps at its end."""


def passive(vehicle: Vehicle, body: Body) -> Drive:
    """Return how the plant alone drives, with all actuators off."""

    def drive(maneuver: Maneuver, last: int) -> Mapping[str, NDArray[np.float64]]:
        signals = open_loop.signals(*open_loop.run_passive(vehicle, body, maneuver))
        return {name: signals[name][-last:] for name in EVALUATED}

    return drive


@dataclass(frozen=True, slots=True)
class SteadyState:
    """One steady turn, SI units: what ISO 4138 plots over the lateral acceleration."""

    speed: float
    lateral_acceleration: float
    steer: float
    roll: float
    sideslip: float


@dataclass(frozen=True, slots=True, repr=False)
class Understeer:
    """Constant-radius test: its steady states, and gradients of their linear part.

    ``gradient`` and ``closed_form`` in degrees of road-wheel angle per g, ``roll_gradient`` in
    degrees per g, ``limit`` the largest steady lateral acceleration reached (m/s²).
    """

    radius: float
    states: tuple[SteadyState, ...]
    gradient: float
    closed_form: float
    roll_gradient: float
    limit: float

    @property
    def table(self) -> Table:
        """One row for each steady turn: km/h, m/s² and degrees at the road wheels."""
        return Table(
            [
                {
                    "speed_kmh": state.speed * 3.6,
                    "lateral_acceleration": state.lateral_acceleration,
                    "steer_deg": degrees(state.steer),
                    "roll_deg": degrees(state.roll),
                    "sideslip_deg": degrees(state.sideslip),
                }
                for state in self.states
            ]
        )

    def __repr__(self) -> str:
        return (
            f"<circle of {self.radius:g} m: understeer gradient {self.gradient:.3f} °/g, "
            f"roll gradient {self.roll_gradient:.2f} °/g, largest {self.limit:.2f} m/s²>"
        )


def constant_radius(vehicle: Vehicle, drive: Drive, *, radius: float = 100.0) -> Understeer:
    """Drive a circle of ``radius`` (m) at increasing speeds, each to its steady state.

    Raises:
        CanrollError: the radius is below 20 m, where the driver cannot hold a van's steady turn.
    """
    if not radius >= 20.0:
        raise CanrollError(f"--radius must be at least 20 m, got {radius:g}")
    states = []
    for lateral in np.arange(0.5, 12.0, 0.5):
        speed = sqrt(lateral * radius)
        if not 5 / 3.6 <= speed <= 160 / 3.6:
            continue
        maneuver = build("constant_radius", vehicle, speed, radius=radius)
        signals = drive(maneuver, SETTLED)
        rows = np.column_stack([signals[name] for name in EVALUATED])
        last = dict(zip(EVALUATED, map(float, rows.mean(axis=0)), strict=True))
        off = abs(last["path_error"]) > 0.05 * radius
        # a car that slides past the circle may be near it all the same
        off = off or abs(radius * last["ay"] / last["vx"] ** 2 - 1.0) > 0.05
        if signals["rollover"][-1] or off or last["vx"] < 0.95 * speed:
            break
        states.append(
            SteadyState(
                speed=last["vx"],
                lateral_acceleration=last["ay"],
                steer=float(signals["steer"].mean()),
                roll=last["roll"],
                sideslip=atan(last["vy"] / last["vx"]),
            )
        )
    linear = [state for state in states if state.lateral_acceleration <= LINEAR_ACCELERATION]
    if len(linear) < 2:
        raise VerdictError(
            f"{vehicle.name} does not reach a steady turn on a circle of {radius:g} m"
        )
    lateral = np.array([state.lateral_acceleration for state in linear])
    # What steering is left once the curvature really driven has had its share.
    beyond = [
        road_wheels(vehicle, state.steer)
        - vehicle.geometry.wheelbase * state.lateral_acceleration / state.speed**2
        for state in linear
    ]
    roll = [state.roll for state in linear]
    return Understeer(
        radius=radius,
        states=tuple(states),
        gradient=degrees(np.polyfit(lateral, beyond, 1)[0]) * GRAVITY,
        closed_form=degrees(vehicle.understeer) * GRAVITY,
        roll_gradient=degrees(np.polyfit(lateral, roll, 1)[0]) * GRAVITY,
        limit=max(state.lateral_acceleration for state in states),
    )


def characteristic_speed(vehicle: Vehicle, gradient: float) -> float | None:
    """Return the speed (m/s) at which a circle takes twice the steering of a slow turn.

    ``gradient``: understeer gradient in degrees of road-wheel angle per g. None: the car does not
    understeer.
    """
    wheelbase = vehicle.geometry.wheelbase
    return sqrt(wheelbase * GRAVITY / radians(gradient)) if gradient > 0.0 else None


@dataclass(frozen=True, slots=True, repr=False)
class FrequencyResponse:
    """Complex response per road-wheel angle (rad) over ``frequency`` (Hz), SI units."""

    speed: float
    frequency: Vector
    yaw_rate: NDArray[np.complex128]
    lateral_acceleration: NDArray[np.complex128]
    roll: NDArray[np.complex128]

    @property
    def table(self) -> Table:
        """One row for each frequency: gain per road-wheel angle, and phase in degrees."""
        columns: dict[str, Vector] = {"frequency_hz": self.frequency}
        for name in ("yaw_rate", "lateral_acceleration", "roll"):
            row = getattr(self, name)
            columns[name] = np.abs(row)
            columns[f"{name}_phase_deg"] = np.degrees(np.unwrap(np.angle(row)))
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        return Table([dict(zip(columns, row, strict=True)) for row in rows])

    def __repr__(self) -> str:
        peaks = (
            f"{words} {np.abs(row).max():.3g} at {self.frequency[np.abs(row).argmax()]:.2g} Hz"
            for words, row in (
                ("yaw rate 1/s", self.yaw_rate),
                ("lateral acceleration m/s² per rad", self.lateral_acceleration),
                ("roll", self.roll),
            )
        )
        return f"<{self.speed * 3.6:g} km/h, largest gains: {', '.join(peaks)}>"


def frequency_response(
    vehicle: Vehicle,
    drive: Drive,
    *,
    speed: float = 100 / 3.6,
    lateral_acceleration: float = 2.0,
    frequencies: Vector | None = None,
) -> FrequencyResponse:
    """Steer sines, one frequency after the other, and evaluate each response's first harmonic.

    ``lateral_acceleration`` (m/s²) is the steady-state value of the steering amplitude; ISO 7401
    permits at most 4. Frequencies in Hz, 0.2 to 4 by default.

    Raises:
        VerdictError: the car rolls over.
    """
    if frequencies is None:
        frequencies = np.geomspace(0.2, 4.0, 14)
    amplitude = steady_steer(vehicle, speed, lateral_acceleration)
    step = STEP_NS * 1e-9
    names = ("yaw_rate", "ay", "roll")
    responses = np.empty((len(names), frequencies.size), dtype=np.complex128)
    for i, frequency in enumerate(frequencies):
        period = round(1 / (frequency * step))
        settle = period * int(np.ceil(4.0 / (period * step)))
        measured = period * max(2, int(np.ceil(1.0 / (period * step))))
        # The sine's period is a whole number of steps, so that the harmonic leaks nowhere.
        phase = 2 * pi * np.arange(settle + measured) / period
        plan = ManeuverPlan(
            (settle + measured) * step,
            kind=STEER_TABLE,
            table=amplitude * np.sin(phase),
            table_step=step,
            steer_rate=np.inf,
        )
        duration = (settle + measured) * STEP_NS
        steering = make_drive(vehicle, speed, plan)
        signals = drive(Maneuver("sine", "sine", "ISO 7401", speed, duration, steering), measured)
        if signals["rollover"][-1]:
            raise VerdictError(f"{vehicle.name} rolls over at {frequency:.3g} Hz")
        # A row shows the car at the end of the step over which its steering was held: half a step
        # later than that steering's mean.
        window = np.exp(-1j * phase[settle:])
        driven = signals["steer"] @ window
        later = np.exp(-1j * pi / period)
        for row, name in enumerate(names):
            responses[row, i] = (signals[name] @ window) * later / driven
    return FrequencyResponse(speed, frequencies, responses[0], responses[1], responses[2])


@dataclass(frozen=True, slots=True)
class SpeedLimit:
    """Highest speed (m/s) that passed and lowest that failed; None if none did."""

    passed: float | None
    failed: float | None


def bisect_speed(
    fails: Callable[[float], bool], *, low: float, high: float, tolerance: float
) -> SpeedLimit:
    """Find by bisection where ``fails(speed)`` turns true between ``low`` and ``high`` (m/s).

    Assumes that a higher speed is never safer; ``tolerance`` (m/s) is the final bracket.
    """
    if fails(low):
        return SpeedLimit(None, low)
    if not fails(high):
        return SpeedLimit(high, None)
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        if fails(middle):
            high = middle
        else:
            low = middle
    return SpeedLimit(low, high)
