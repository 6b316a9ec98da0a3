"""Manoeuvres of a steering robot: step, sweep, fishhook, J-turn, sine with dwell, and curves.

The robots of FMVSS 126 and of NHTSA's rollover tests scale their steering by the angle at which
the car corners at 0.3 g at 80 km/h; here that is the linear car's.
"""

from math import inf, pi, radians
from typing import Any

import numpy as np

from canroll.errors import CanrollError
from canroll.plant_sim.driving.drive import ManeuverKind, ManeuverPlan, pedal, steady_steer
from canroll.plant_sim.driving.driver import FISHHOOK, STEER_TABLE
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.typing import Vector
from canroll.vehicles import GRAVITY, Vehicle

START = 0.5
"""Straight running before the steering begins (s)."""

ENTRY = 1.0
"""Time (s) in which a circle is steered into before braking in it."""
STEADY = 4.0
"""Time (s) on the circle before the brakes."""
BRAKED = 20.0 / 3.6
"""Speed (m/s) at which braking in a curve ends."""

TABLE_STEP = STEP_NS * 1e-9
REFERENCE_SPEED = 80 / 3.6
REFERENCE_ACCELERATION = 0.3 * GRAVITY


def reference_angle(vehicle: Vehicle) -> float:
    """Road-wheel angle (rad) for 0.3 g at 80 km/h, the A of FMVSS 126 and of the fishhook."""
    return steady_steer(vehicle, REFERENCE_SPEED, REFERENCE_ACCELERATION)


def _amplitude(vehicle: Vehicle, scale: float) -> float:
    return min(scale * reference_angle(vehicle), vehicle.steering.angle_limit)


def _held(vehicle: Vehicle, speed: float, lateral_acceleration: float) -> float:
    """Road-wheel angle (rad) of the linear car's steady lateral acceleration (m/s²), if it can."""
    angle = steady_steer(vehicle, speed, lateral_acceleration)
    return min(angle, vehicle.steering.angle_limit)


def _robot(
    duration: float,
    table: Vector,
    *,
    steer_rate: float = inf,
    **plan: Any,  # noqa: ANN401
) -> ManeuverPlan:
    """The plan of a robot that steers a table, by default as fast as it says."""
    return ManeuverPlan(duration, kind=STEER_TABLE, table=table, steer_rate=steer_rate, **plan)


def fishhook(vehicle: Vehicle, _speed: float, _seed: int, *, scale: float = 6.5) -> ManeuverPlan:
    """NHTSA's roll-rate feedback fishhook: 720 degrees/s at the steering wheel, 3 s held."""
    return ManeuverPlan(
        8.0,
        kind=FISHHOOK,
        release_time=START,
        steer_rate=radians(720.0) / vehicle.steering.ratio,
        fishhook=(START, _amplitude(vehicle, scale), 3.0, 2.0),
    )


def step_steer(
    vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    lateral_acceleration: float = 4.0,
    steer_rate: float = 300.0,
) -> ManeuverPlan:
    """ISO 7401 step input: a quick ramp to the angle of a steady lateral acceleration, then held.

    The angle is that of the linear car. The standard asks for 200 to 500 degrees/s at the steering
    wheel.
    """
    rate = radians(steer_rate) / vehicle.steering.ratio
    amplitude = _held(vehicle, speed, lateral_acceleration)
    time = np.arange(0.0, START + 4.5, TABLE_STEP)
    return _robot(float(time[-1]), np.clip(rate * (time - START), 0.0, amplitude))


def sine_sweep(
    vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    lateral_acceleration: float = 2.0,
    lowest: float = 0.2,
    highest: float = 3.0,
    duration: float = 40.0,
) -> ManeuverPlan:
    """ISO 7401 continuous sinusoidal input whose frequency (Hz) rises evenly with time.

    The amplitude is the angle of the linear car's steady lateral acceleration; the standard permits
    at most 4 m/s².

    Raises:
        CanrollError: the frequency does not rise.
    """
    if not lowest < highest:
        raise CanrollError(
            f"sine sweep from {lowest:g} to {highest:g} Hz: highest must be above lowest"
        )
    time = np.maximum(np.arange(0.0, START + duration, TABLE_STEP) - START, 0.0)
    phase = 2 * pi * (lowest * time + 0.5 * (highest - lowest) * time**2 / duration)
    return _robot(START + duration, _held(vehicle, speed, lateral_acceleration) * np.sin(phase))


def braking_in_curve(
    vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    radius: float = 100.0,
    deceleration: float = 4.0,
) -> ManeuverPlan:
    """ISO 7975: braking with the steering of a steady circle held.

    The angle is that of the linear car; the standard's radius of 100 m gives the lateral
    acceleration of 5 m/s² at 80 km/h. The car brakes evenly, as a speed that falls, down to
    :data:`BRAKED` or to a quarter of its speed.
    """
    amplitude = _held(vehicle, speed, speed**2 / radius)
    end = max(BRAKED, 0.25 * speed)
    begin = START + ENTRY + STEADY
    duration = begin + max(speed - end, 0.0) / deceleration
    time = np.arange(0.0, duration, TABLE_STEP)
    return _robot(
        duration,
        amplitude * np.clip((time - START) / ENTRY, 0.0, 1.0),
        speed=np.maximum(speed - deceleration * np.maximum(time - begin, 0.0), min(end, speed)),
    )


def power_off_in_curve(
    vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    radius: float = 100.0,
    acceleration: float = -0.7,
) -> ManeuverPlan:
    """ISO 9816: the accelerator is released with the steering of a steady circle held.

    The angle is that of the linear car. ``acceleration`` (m/s²) is what engine and pedals ask for
    from then on: the drag of an engine in gear if negative, power-on if positive.
    """
    amplitude = _held(vehicle, speed, speed**2 / radius)
    begin, after = START + ENTRY + STEADY, 4.0
    time = np.arange(0.0, begin + after, TABLE_STEP)
    return _robot(
        begin + after,
        amplitude * np.clip((time - START) / ENTRY, 0.0, 1.0),
        release_time=begin,
        pedal=pedal(acceleration),
    )


def j_turn(vehicle: Vehicle, _speed: float, _seed: int, *, scale: float = 8.0) -> ManeuverPlan:
    """NHTSA's J-turn: one ramp at 1000 degrees/s at the steering wheel, held 4 s, back in 2 s."""
    rate = radians(1000.0) / vehicle.steering.ratio
    amplitude = _amplitude(vehicle, scale)
    rise = amplitude / rate
    knots = np.array([0.0, START, START + rise, START + rise + 4.0, START + rise + 6.0])
    time = np.arange(0.0, knots[-1] + 1.0, TABLE_STEP)
    table = np.interp(time, knots, [0.0, 0.0, amplitude, amplitude, 0.0])
    return _robot(float(time[-1]), table, release_time=START, steer_rate=2 * rate)


def sine_with_dwell_table(amplitude: float) -> Vector:
    """0.7 Hz sine whose second peak is held for 500 ms (FMVSS 126, S7.9), at 1 ms steps."""
    frequency, dwell = 0.7, 0.5
    time = np.arange(0.0, START + 1 / frequency + dwell + 3.0, TABLE_STEP) - START
    peak = 0.75 / frequency
    phase = np.where(time < peak, time, np.maximum(time - dwell, peak))
    steer = np.sin(2 * pi * frequency * phase)
    return amplitude * np.where((time < 0) | (time > 1 / frequency + dwell), 0.0, steer)


def sine_with_dwell(
    vehicle: Vehicle, _speed: float, _seed: int, *, scale: float = 5.0
) -> ManeuverPlan:
    """FMVSS 126 sine with dwell at ``scale`` times the angle for 0.3 g, accelerator released."""
    table = sine_with_dwell_table(_amplitude(vehicle, scale))
    return _robot(table.size * TABLE_STEP, table, release_time=START)


STEP_STEER = ManeuverKind("step steer", 100.0, 160.0, "ISO 7401", step_steer)
"""Step steer, ISO 7401."""
SINE_SWEEP = ManeuverKind("sine sweep", 100.0, 160.0, "ISO 7401", sine_sweep)
"""Sine sweep, ISO 7401."""
BRAKING_IN_CURVE = ManeuverKind("braking in a curve", 80.0, 160.0, "ISO 7975", braking_in_curve)
"""Braking in a curve, ISO 7975."""
NHTSA_FISHHOOK = ManeuverKind(
    "fishhook", 80.0, 120.0, "NHTSA roll-rate feedback fishhook", fishhook
)
"""Fishhook with roll-rate feedback, NHTSA."""
POWER_OFF_IN_CURVE = ManeuverKind(
    "power-off in a curve", 80.0, 160.0, "ISO 9816", power_off_in_curve
)
"""Power-off in a curve, ISO 9816."""
J_TURN = ManeuverKind("J-turn", 80.0, 120.0, "NHTSA J-turn", j_turn)
"""J-turn, NHTSA."""
SINE_WITH_DWELL = ManeuverKind("sine with dwell", 80.0, 120.0, "FMVSS 126", sine_with_dwell)
"""Sine with dwell, FMVSS 126."""
