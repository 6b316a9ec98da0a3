"""The disturbance observer [φ, φ', effective a_y, its rate, gyro bias]: model and Kalman gains."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from canroll.gain_gen.models.roll import Matrix, moment_input, state_matrix, zero_order_hold
from canroll.vehicles import GRAVITY, RollModel

STATES = ("roll", "roll_rate", "lateral_acceleration", "lateral_jerk", "gyro_bias")
ROLL, RATE, LATERAL, JERK, BIAS = range(5)


@dataclass(frozen=True, slots=True)
class LateralModel:
    """Model of the lateral acceleration.

    a'' = −2 ζ ω a' − ω² a + white noise of density :attr:`noise_density`, m²/s⁵.

    Attributes:
        frequency: ω, rad/s; zero makes a_y a random walk (the 2020 paper) and its rate zero.
        damping: ζ.
        acceleration: standard deviation of a_y for which the noise density is chosen, m/s².
        steered: a_y follows a_δ from speed and steering, a'' = ω² (a_δ − a) − 2 ζ ω a'.
    """

    frequency: float = 1.5
    damping: float = 0.8
    acceleration: float = 4.0
    steered: bool = False

    @property
    def noise_density(self) -> float:
        """Density of the white noise that keeps a_y at its standard deviation, m²/s⁵."""
        return 4.0 * self.damping * self.frequency**3 * self.acceleration**2


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Standard deviations of one sample.

    Attributes:
        roll_rate: rad/s.
        lateral: m/s².
        bias_walk: of the gyro bias over one second, rad/s.
        roll_acceleration: of unmodelled roll moments, as density, rad/s² per √Hz.
    """

    roll_rate: float = 0.1 * np.pi / 180.0
    lateral: float = 0.08
    bias_walk: float = 2e-4
    roll_acceleration: float = 0.05


@dataclass(frozen=True, slots=True)
class ObserverModel:
    """Discrete model of the observer.

    Attributes:
        phi: (5, 5).
        gamma: input column of the moment held over a tick, (5, 1).
        gamma_steering: input column of the lateral acceleration from steering, (5, 1).
        output: rows y = [roll rate, a_y] from the state, (2, 5).
        process_noise: covariance added a tick, (5, 5).
        measurement_noise: variances, (2,).
        tick: s.
    """

    phi: Matrix
    gamma: Matrix
    gamma_steering: Matrix
    output: Matrix
    process_noise: Matrix
    measurement_noise: Matrix
    tick: float


@dataclass(frozen=True, slots=True)
class Observer:
    """A constant-gain observer with sequential scalar corrections.

    Attributes:
        model: its model.
        measurements: indices of the measurements in use, in order of correction.
        correction: gain of each measurement, (2, 5); zero rows where it is not used.
        correction_single: gain of the roll rate when the lateral acceleration is lost, (5,);
            zero where the roll rate is not measured.
        warnings: limitations to report to the user.
        bypass: the true state is received instead.
    """

    model: ObserverModel
    measurements: tuple[int, ...]
    correction: Matrix
    correction_single: Matrix
    warnings: tuple[str, ...] = ()
    bypass: bool = False


def continuous_model(roll: RollModel, lateral: LateralModel) -> tuple[Matrix, Matrix]:
    """Return A (5, 5) and the moment's column B (5, 1) of the observer's state."""
    a = np.zeros((5, 5))
    a[:2, :2] = state_matrix(roll)
    a[RATE, LATERAL] = roll.roll_arm / roll.roll_inertia
    if lateral.frequency > 0.0:
        a[LATERAL, JERK] = 1.0
        a[JERK, LATERAL] = -(lateral.frequency**2)
        a[JERK, JERK] = -2.0 * lateral.damping * lateral.frequency
    b = np.zeros((5, 1))
    b[:2] = moment_input(roll)
    return a, b


def sampled_noise(a: Matrix, density: Matrix, step: float) -> Matrix:
    """Return the covariance added in one step by white noise of ``density`` (Van Loan 1978)."""
    n = len(a)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n] = -a
    block[:n, n:] = density
    block[n:, n:] = a.T
    exponential = expm(block * step)
    covariance: Matrix = exponential[n:, n:].T @ exponential[:n, n:]
    return 0.5 * (covariance + covariance.T)


def observer_model(
    roll: RollModel, tick: float, *, lateral: LateralModel, noise: SensorNoise
) -> ObserverModel:
    """Return the exact discrete model at ``tick`` with its noise covariances."""
    a, b = continuous_model(roll, lateral)
    steering_input = np.zeros((5, 1))
    steering_input[JERK] = lateral.frequency**2 if lateral.steered else 0.0
    phi, inputs = zero_order_hold(a, np.hstack([b, steering_input]), tick)
    if lateral.frequency <= 0.0:
        phi[JERK, JERK] = 0.0
    density = np.zeros((5, 5))
    density[RATE, RATE] = noise.roll_acceleration**2
    density[BIAS, BIAS] = noise.bias_walk**2
    if lateral.frequency > 0.0:
        density[JERK, JERK] = lateral.noise_density
    else:
        density[LATERAL, LATERAL] = 2.0 * lateral.acceleration**2
    return ObserverModel(
        phi=phi,
        gamma=inputs[:, :1],
        gamma_steering=inputs[:, 1:],
        output=np.array([[0.0, 1.0, 0.0, 0.0, 1.0], [GRAVITY, 0.0, 1.0, 0.0, 0.0]]),
        process_noise=sampled_noise(a, density, tick),
        measurement_noise=np.array([noise.roll_rate**2, noise.lateral**2]),
        tick=tick,
    )


def observable_rank(phi: Matrix, output: Matrix) -> int:
    """Return the rank of the observability matrix, from its balanced, stacked powers."""
    rows = [output]
    for _ in range(len(phi) - 1):
        rows.append(rows[-1] @ phi)
    return int(np.linalg.matrix_rank(np.vstack(rows), tol=1e-9))


def steady_covariance(model: ObserverModel, measurements: tuple[int, ...]) -> Matrix:
    """Return the a-priori covariance of the steady Kalman filter, (5, 5).

    States that nothing excites (a_y's rate of a random walk) are left out of the equation.
    """
    output = model.output[list(measurements)]
    noise = np.diag(model.measurement_noise[list(measurements)])
    active = np.flatnonzero(np.abs(model.phi).sum(axis=0) > 0.0)
    # each state in units of its noise keeps the pencil of the Riccati equation balanced
    scale = np.sqrt(np.maximum(np.diag(model.process_noise)[active], 1e-14))
    phi = model.phi[np.ix_(active, active)] * scale[None, :] / scale[:, None]
    process = model.process_noise[np.ix_(active, active)] / np.outer(scale, scale)
    covariance = np.zeros((5, 5))
    covariance[np.ix_(active, active)] = solve_discrete_are(
        phi.T, (output[:, active] * scale).T, process, noise
    ) * np.outer(scale, scale)
    return covariance


def sequential_gains(
    covariance: Matrix, model: ObserverModel, measurements: tuple[int, ...]
) -> Matrix:
    """Return the gains of scalar corrections one after the other, (2, 5), from one covariance."""
    gains = np.zeros((2, 5))
    for row in measurements:
        h = model.output[row]
        gains[row] = covariance @ h / (h @ covariance @ h + model.measurement_noise[row])
        covariance = covariance - np.outer(gains[row], h @ covariance)
    return gains


def kalman(model: ObserverModel, *, measurements: tuple[int, ...] = (0, 1)) -> Observer:
    """Return the steady Kalman filter as sequential scalar corrections.

    When the lateral acceleration is lost, the filter uses the roll rate alone and freezes the bias
    state, which could not be distinguished from a slow roll.

    The lateral acceleration alone, y = g φ + a_y, observes roll and a_y by the rank test of Hautus
    (1969). A mode of the roll, I s² + C s + T = 0 with T = K − m g h, has a_y = 0 and is seen as
    y = g φ. A mode of a_y drags the roll along, φ = m h a_y / (I s² + C s + T), and is seen as
    y = a_y (I s² + C s + K) / (I s² + C s + T); K > 0 keeps the roots of the numerator in the left
    half-plane, so that a mode hidden there would decay, and a random walk (s = 0) is seen as
    a_y K / T. Hence the pair is detectable for every model of a_y. A known input changes no such
    pair: the lateral acceleration by steering is not needed. The gyro bias is in no measurement
    and does not decay; it is left out of the Riccati equation, so that the equation has its
    stabilising solution (Anderson and Moore 1979, 4.4), and the state stays zero.

    Args:
        model: its model.
        measurements: rows of the model's output: roll rate (0), lateral acceleration (1).
    """
    if 0 not in measurements:
        model = without_bias(model)
        gains = sequential_gains(steady_covariance(model, measurements), model, measurements)
        return Observer(model, measurements, gains, np.zeros(5))
    gains = sequential_gains(steady_covariance(model, measurements), model, measurements)
    single = _single_gain(model)
    warnings: tuple[str, ...] = ()
    if 1 not in measurements:
        warnings = (one_sensor_warning(model, single),)
        gains[0] = single
        phi = model.phi.copy()
        phi[BIAS] = 0.0
        model = replace(model, phi=phi)
    return Observer(model, measurements, gains, single, warnings)


def without_bias(model: ObserverModel) -> ObserverModel:
    """Return the model with a gyro bias that is always zero."""
    phi, process = model.phi.copy(), model.process_noise.copy()
    phi[BIAS] = 0.0
    process[BIAS] = process[:, BIAS] = 0.0
    return replace(model, phi=phi, process_noise=process)


def _single_gain(model: ObserverModel) -> Matrix:
    """Gain on the roll rate alone, the bias frozen.

    With a_y as a random walk the pair is not detectable: the covariance grows without bound along
    the unobservable direction and only the gain converges, so it is iterated, not solved.
    """
    model = without_bias(model)
    phi, process = model.phi, model.process_noise
    h = np.array([0.0, 1.0, 0.0, 0.0, 0.0])
    if phi[JERK, JERK] > 0.0:
        frozen = replace(model, output=np.stack([h, h]))
        return np.asarray(
            sequential_gains(steady_covariance(frozen, (0,)), frozen, (0,))[0], dtype=float
        )
    covariance = process.copy()
    gain: Matrix = np.zeros(5)
    for _ in range(20000):
        previous = gain
        gain = np.asarray(covariance @ h / (h @ covariance @ h + model.measurement_noise[0]))
        covariance = covariance - np.outer(gain, h @ covariance)
        covariance = phi @ covariance @ phi.T + process
        covariance = 0.5 * (covariance + covariance.T)
        if np.abs(gain - previous).max() < 1e-13 * np.abs(gain).max():
            break
    return np.asarray(gain)


def bias_response(model: ObserverModel, gain: Matrix, *, bias: float, seconds: float) -> float:
    """Return the roll angle error from a constant gyro bias after ``seconds``, rad.

    Args:
        model: the observer's model; its own bias state is held at zero.
        gain: correction from the roll rate, (5,).
        bias: rad/s.
        seconds: time since the bias appeared, s.
    """
    h = np.array([0.0, 1.0, 0.0, 0.0, 0.0])
    phi = model.phi.copy()
    phi[BIAS] = 0.0
    step = (np.eye(5) - np.outer(gain, h)) @ phi
    # affine recursion e⁺ = S e + gain·bias as one matrix power
    affine = np.zeros((6, 6))
    affine[:5, :5] = step
    affine[:5, 5] = gain * bias
    affine[5, 5] = 1.0
    power = np.linalg.matrix_power(affine, max(1, round(seconds / model.tick)))
    return float(power[ROLL, 5])


def one_sensor_warning(model: ObserverModel, gain: Matrix) -> str:
    """Return the warning on a filter that uses the roll rate alone."""
    bias = 0.1 * np.pi / 180.0
    angle = np.degrees(bias_response(model, gain, bias=bias, seconds=600.0))
    reduced = [ROLL, RATE, LATERAL]
    rank = observable_rank(model.phi[np.ix_(reduced, reduced)], np.array([[0.0, 1.0, 0.0]]))
    cause = (
        "[roll, roll rate, a_y] is not observable"
        if rank < len(reduced)
        else "the roll angle is observed only through the a_y model"
    )
    return (
        f"the observer uses the roll rate alone: {cause}; a gyro bias of 0.1 deg/s makes the roll "
        f"angle wrong by {abs(angle):.1f} deg after 10 min; use --observer two_sensors"
    )
