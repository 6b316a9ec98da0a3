"""LQG on the driven car: two Riccati equations, the delay and the driver in the state."""

import numpy as np
from scipy.linalg import solve_discrete_are

from gain_gen.laws.state_gains import riccati_gain
from gain_gen.models.roll import Matrix
from gain_gen.output_feedback.driven_car import DrivenCar
from gain_gen.output_feedback.dynamic import Dynamic


def lqg(car: DrivenCar, weight: float) -> Dynamic:
    """Return the controller that minimises roll, roll rate and the command with ``weight``.

    Args:
        car: commands under way are states of it, so that the gain sees the whole delay.
        weight: degrees that a kN·m counts for.
    """
    gain = riccati_gain(car.a, car.command, car.rolled.T @ car.rolled, np.array([[weight**2]]))
    corrected = kalman_gain(car)
    left = np.eye(len(car.a)) - corrected @ car.measured
    following = car.a - car.command @ gain
    return Dynamic(following @ left, following @ corrected, -gain @ left, -gain @ corrected)


def kalman_gain(car: DrivenCar) -> Matrix:
    """Return M of x̂ = x̄ + M (y − C₂ x̄), the current estimator's, (n, 3)."""
    variance = np.diag(car.noise**2)
    # nothing disturbs the commands under way: a whiff of noise keeps the equation regular
    process = car.driven @ car.driven.T + 1e-12 * np.eye(len(car.a))
    covariance = solve_discrete_are(car.a.T, car.measured.T, process, variance)
    innovation = car.measured @ covariance @ car.measured.T + variance
    return np.asarray(np.linalg.solve(innovation, car.measured @ covariance).T)
