"""Full-car LQR made implementable: a reduced compensator from the inertial sensors only."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_discrete_are

from canroll.errors import CanrollError, VerdictError
from canroll.gain_gen.analysis.held_plant import HeldPlant, opened, padded
from canroll.gain_gen.laws.compensator import scaled_states
from canroll.gain_gen.laws.declared import law
from canroll.gain_gen.laws.state_feedback import controller_of
from canroll.gain_gen.laws.state_gains import riccati_gain
from canroll.gain_gen.models.controller import Compensator, LinearController
from canroll.gain_gen.models.full_car import (
    CURRENTS,
    INPUT_WEIGHT,
    MILLI,
    SPEED,
    STEER,
    FullCarModel,
    car_of,
    full_car_model,
    weights,
)
from canroll.gain_gen.models.roll import Matrix, stationary_covariance, zero_order_hold
from canroll.gain_gen.models.state_space import StateSpace
from canroll.gain_gen.models.task import Check, Solution, Task, above, below

STEER_CORNER = 3.0
"""Corner of the driver's steering, rad/s."""
STEER_DEVIATION = 0.02
"""Standard deviation of the road-wheel angle, rad."""
ORDERS = (3, 4, 5, 6, 7, 8)
WORTH = 0.85
"""Share of the full-state benefit that the least order must keep."""


@dataclass(frozen=True, slots=True)
class SampledCar:
    """The car at the tick with its steering as coloured noise.

    Attributes:
        phi: (27, 27); the last state is the steering angle.
        gamma: both currents, (27, 2), A.
        noise: column of the steering's white noise, (27, 1).
        outputs: roll rate, accelerometer, roll, bar moment, (4, 27).
    """

    phi: Matrix
    gamma: Matrix
    noise: Matrix
    outputs: Matrix


def sampled_car(model: FullCarModel, tick: float) -> SampledCar:
    """Discretise exactly, the steering held over the tick."""
    n = len(model.a)
    phi, gamma = zero_order_hold(model.a, model.b[:, [STEER, *CURRENTS]], tick)
    decay = float(np.exp(-STEER_CORNER * tick))
    phi_steered = np.zeros((n + 1, n + 1))
    phi_steered[:n, :n], phi_steered[:n, n], phi_steered[n, n] = phi, gamma[:, 0], decay
    noise = np.zeros((n + 1, 1))
    noise[n] = STEER_DEVIATION * np.sqrt(1.0 - decay**2)
    inputs = np.vstack([gamma[:, 1:], np.zeros((1, 2))])
    return SampledCar(phi_steered, inputs, noise, np.hstack([model.outputs, model.steer[:, None]]))


def compensator_in_full(car: SampledCar, gain: Matrix, task: Task) -> Compensator:
    """Return the LQG compensator in observer form, from [roll rate, a_y] and its own output.

    ξ⁺ = (Φ − L C) ξ + L y + Γ u, u = −K ξ: stable as an open system, so that it can be reduced
    directly; the ECU feeds back the saturated u, which avoids wind-up.
    """
    outputs = car.outputs[:2]
    measurement = np.diag([task.noise.roll_rate**2, task.noise.lateral**2])
    n = len(car.phi)
    # unmodelled moments and road on every state, so that the filter leans on its sensors
    process = car.noise @ car.noise.T + 1e-10 * np.eye(n)
    covariance = solve_discrete_are(car.phi.T, outputs.T, process, measurement)
    innovation = outputs @ covariance @ outputs.T + measurement
    injection = np.linalg.solve(innovation, outputs @ covariance @ car.phi.T).T
    b = np.zeros((n, 4))
    b[:, 1:3] = injection
    return Compensator(
        a=car.phi - injection @ outputs, b=b, e=car.gamma, c=-gain, d=np.zeros((2, 4))
    )


def reduced(full: Compensator, order: int, tick: float) -> Compensator:
    """Return the compensator with ``order`` states, by balancing from (y, u) to u."""
    # inputs and outputs in sizes of equal importance: deg/s, 0.1 m/s², A
    size = np.array([1.0, 0.02, 0.1, 1.0])
    both = np.hstack([full.b * size, full.e])
    system = StateSpace(full.a, both, full.c, np.zeros((2, 6)), tick).balanced()[0].truncated(order)
    return Compensator(
        a=system.a, b=system.b[:, :4] / size, e=system.b[:, 4:], c=system.c, d=full.d
    )


def closed_loop(
    car: SampledCar, controller: LinearController, delay: float
) -> tuple[Matrix, Matrix]:
    """Return A and the noise column of car, delay line and ECU; currents in mA as commanded.

    The delay is rounded up to whole ticks, so it is never less than the real one.
    """
    steps = max(0, int(np.ceil(delay / controller.tick - 1e-9)))
    nothing = np.zeros_like(car.gamma)
    columns = (nothing, car.gamma) if steps else (car.gamma, nothing)
    plant = HeldPlant(car.phi, *columns, steps, controller.tick)
    a, b, c = opened(plant, controller, car.outputs, summed=False)
    return a + b @ c / MILLI, padded(car.noise.T, len(a)).T


def rolling(a: Matrix, noise: Matrix, row: Matrix) -> float:
    """Return the stationary standard deviation of ``row`` x; infinite where unstable."""
    if np.abs(np.linalg.eigvals(a)).max() >= 1.0:
        return float("inf")
    covariance = stationary_covariance(a, noise @ noise.T)
    n = len(row)
    return float(np.sqrt(row @ covariance[:n, :n] @ row))


@law(feedforward="none")
def design_lqr_full_car(task: Task) -> Solution:
    """Full-car LQR of Vu 2020 as a compensator from the inertial sensors, valve currents out.

    The 26-state gain is computed balanced, at the tick; an observer form of it from roll rate and
    lateral acceleration is reduced by balanced truncation, and every order is checked in the
    closed loop with the real delay before it is accepted.
    """
    if task.actuator != "valves":
        raise CanrollError(
            "lqr_full_car commands the currents of hydraulic bars: choose --actuator valves"
        )
    model = full_car_model(car_of(task.vehicle), SPEED, task.vehicle.sensors.imu_position)
    car = sampled_car(model, task.tick)
    n = len(model.a)
    plain = riccati_gain(
        car.phi[:n, :n], car.gamma[:n], np.diag(weights()), INPUT_WEIGHT * np.eye(2)
    )
    gain = np.hstack([plain, np.zeros((2, 1))])
    roll = car.outputs[2]
    passive = rolling(car.phi, car.noise, roll)
    ideal = rolling(car.phi - car.gamma @ gain, car.noise, roll)
    full = compensator_in_full(car, gain, task)
    tried: dict[str, float] = {}
    chosen: LinearController | None = None
    kept = 0.0
    for order in ORDERS:
        candidate = _in_milliampere(reduced(full, order, task.tick))
        controller = controller_of(task, compensator=scaled_states(candidate, task.tick))
        active = rolling(*closed_loop(car, controller, task.delay.most), roll)
        share = (passive - active) / (passive - ideal) if np.isfinite(active) else float("-inf")
        tried[f"benefit_order_{order}"] = share
        if chosen is None and share >= WORTH:
            chosen, kept = controller, share
    if chosen is None:
        raise VerdictError(
            f"lqr_full_car for {task.vehicle.name}: no compensator of order {ORDERS[0]} to "
            f"{ORDERS[-1]} keeps {100 * WORTH:.0f} % of the benefit at "
            f"{1e3 * task.delay.most:.0f} ms; reduce the delay"
        )
    return Solution(
        chosen,
        checks=_checks(task, car, chosen, kept),
        delay_aware=True,
        extra={"roll_rms_ratio_ideal": ideal / passive, **tried},
        verified_by_law=True,
    )


def _in_milliampere(compensator: Compensator) -> Compensator:
    """Return the compensator with its outputs and their feedback in mA."""
    return replace(
        compensator,
        c=MILLI * compensator.c,
        d=MILLI * compensator.d,
        e=compensator.e / MILLI,
    )


def _checks(
    task: Task, car: SampledCar, controller: LinearController, kept: float
) -> dict[str, Check]:
    """Stability at every delay in the bounds, other speeds, and the remaining benefit."""
    delays = np.linspace(task.delay.least, task.delay.most, 5)
    radius = max(
        float(np.abs(np.linalg.eigvals(closed_loop(car, controller, float(seconds))[0])).max())
        for seconds in (*delays, 2.0 * task.delay.most)
    )
    checks = {
        "full_car_spectral_radius_delays": below(radius, 1.0),
        "full_car_benefit_kept": above(kept, WORTH),
    }
    imu = task.vehicle.sensors.imu_position
    for speed in (0.6 * SPEED, SPEED, 1.6 * SPEED):
        other = sampled_car(full_car_model(car_of(task.vehicle), speed, imu), task.tick)
        a, noise = closed_loop(other, controller, task.delay.most)
        ratio = rolling(a, noise, other.outputs[2]) / rolling(
            other.phi, other.noise, other.outputs[2]
        )
        checks[f"full_car_roll_rms_ratio_{3.6 * speed:.0f}_kmh"] = below(ratio, 1.0)
    return checks
