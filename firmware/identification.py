"""Recursive least squares of roll stiffness and damping, and the model that follows from them.

Yim 2020, section III.D, in integral form: over a window of ten steps
theta_1 T0 int(phi) + theta_2 C0 d(phi) = int(M + m h a_y) - I_x d(phi'), with theta relative to
nominal and T = K - m g h. No signal comes from the observer, which would
feed its own model back: all are from the sensors, each washed out twice. So the offsets of both
sensors drop out, and the roll angle is the leaky integral of the gyro, which replaces one washout.
A gate on the roll rate stops the forgetting while the motion is too small to identify from.
"""

from canroll.firmware.calibration import COEFFICIENT, STATE_MAX, Calibration
from canroll.firmware.fixed_point import product, quotient, shifted
from canroll.firmware.observer import acting_moment
from canroll.firmware.plausibility import BAD_ACCELERATION, BAD_ROLL_RATE
from canroll.firmware.state import RX_IMU, WINDOW_MAX, Ecu
from canroll.firmware.subset import byte, clamp, i32, i64, rsh, sat31

WINDOW = 10
SETTLED = 200
STIFFNESS = 0
BALANCE = 1
RATIO_ONE = 1 << 28
REGRESSOR_MAX = 1 << 24
Q20_ONE = 1 << 20
Q30_ONE = 1 << 30
# Q29
ONE = 1 << 29
HALF = 1 << 28
SIXTH = 89478485
GRAVITY_Q10 = 10042
# half a microsecond, from Q27 to Q30, in Q30
HALF_US = 4295
# signals of rls_washed
WASHED_RATE = 0
WASHED_IMPULSE = 1
TWICE_RATE = 2
TWICE_IMPULSE = 3
TWICE_ROLL = 4


def remember(ecu: Ecu, quantity: i32, value: i64) -> i32:
    """Put ``value`` in the window; return the change over the window."""
    kept: i32 = clamp(value, -WINDOW_MAX, WINDOW_MAX)
    change: i32 = kept - ecu.rls_history[quantity][ecu.rls_index]
    ecu.rls_history[quantity][ecu.rls_index] = kept
    return change


def adapt_model(ecu: Ecu, cal: Calibration) -> None:
    """Recompute the roll and roll-rate rows by the third-order Taylor series of [A B], in Q29."""
    a: i32 = product(ecu.theta[0], cal.model_stiffness, 29)
    b: i32 = product(ecu.theta[1], cal.model_damping, 29)
    ab: i32 = product(a, b, 29)
    square: i32 = sat31(product(b, b, 29) - a)
    cubic: i32 = sat31(ab - product(b, square, 29))
    ecu.work[0] = sat31(ONE - rsh(a, 1) + product(ab, SIXTH, 29))
    ecu.work[1] = sat31(ONE - rsh(b, 1) + product(square, SIXTH, 29))
    ecu.work[2] = sat31(HALF - product(b, SIXTH, 29))
    ecu.work[3] = ecu.work[2]
    ecu.work[4] = sat31(rsh(ab, 1) - a - product(product(a, square, 29), SIXTH, 29))
    ecu.work[5] = sat31(ONE - b + rsh(square, 1) + product(cubic, SIXTH, 29))
    ecu.work[6] = ecu.work[1]
    ecu.work[7] = ecu.work[1]
    for i in range(2):
        for j in range(4):
            entry: i32 = product(ecu.work[4 * i + j], cal.model_scale[i][j], 29)
            ecu.model[i][j] = clamp(entry, -COEFFICIENT, COEFFICIENT)


def learn(ecu: Ecu, cal: Calibration, f0: i32, f1: i32, y: i32) -> None:
    """One recursive least-squares step for the regressor [f0, f1] and the target y, all Q20."""
    g0: i32 = shifted(ecu.rls_covariance[0] * f0 + ecu.rls_covariance[1] * f1, 20)
    g1: i32 = shifted(ecu.rls_covariance[1] * f0 + ecu.rls_covariance[2] * f1, 20)
    variance: i32 = shifted(f0 * g0 + f1 * g1, 20)
    total: i32 = clamp(variance, 0, STATE_MAX) + rsh(cal.rls_forgetting, 10)
    k0: i32 = quotient(g0 * Q20_ONE, total)
    k1: i32 = quotient(g1 * Q20_ONE, total)
    predicted: i64 = rsh(ecu.theta[0] * f0 + ecu.theta[1] * f1, 28)
    error: i32 = clamp(y - predicted, -REGRESSOR_MAX, REGRESSOR_MAX)
    ecu.theta[0] = clamp(ecu.theta[0] + product(k0, error, 12), cal.rls_lo[0], cal.rls_hi[0])
    ecu.theta[1] = clamp(ecu.theta[1] + product(k1, error, 12), cal.rls_lo[1], cal.rls_hi[1])
    p0: i32 = clamp(ecu.rls_covariance[0] - product(k0, g0, 20), 1, STATE_MAX)
    p1: i32 = sat31(ecu.rls_covariance[1] - product(k0, g1, 20))
    p2: i32 = clamp(ecu.rls_covariance[2] - product(k1, g1, 20), 1, STATE_MAX)
    if p0 + p2 < cal.rls_trace_max:
        p0 = clamp(quotient(p0 * Q30_ONE, cal.rls_forgetting), 1, STATE_MAX)
        p1 = quotient(p1 * Q30_ONE, cal.rls_forgetting)
        p2 = clamp(quotient(p2 * Q30_ONE, cal.rls_forgetting), 1, STATE_MAX)
    ecu.rls_covariance[0] = p0
    ecu.rls_covariance[1] = p1
    ecu.rls_covariance[2] = p2


def wash(ecu: Ecu, cal: Calibration, signal: i32, change: i32) -> i32:
    """Return the change of a washed-out signal whose input has made a ``change``."""
    before: i32 = ecu.rls_washed[signal]
    ecu.rls_washed[signal] = sat31(product(before, cal.rls_washout, 30) + change)
    return ecu.rls_washed[signal] - before


def wash_signals(ecu: Ecu, cal: Calibration) -> None:
    """Take the sensors' newest values into the washout filters."""
    rate: i32 = ecu.rate_good
    impulse: i32 = product(acting_moment(ecu, cal), cal.rls_moment, 30)
    impulse = sat31(impulse + product(ecu.acceleration_good, cal.rls_lateral, 30))
    if ecu.rls_filled == 0:
        ecu.rls_last[0] = rate
        ecu.rls_last[1] = impulse
    change: i32 = wash(ecu, cal, WASHED_IMPULSE, impulse - ecu.rls_last[1])
    wash(ecu, cal, TWICE_IMPULSE, change)
    change = wash(ecu, cal, WASHED_RATE, rate - ecu.rls_last[0])
    wash(ecu, cal, TWICE_RATE, change)
    step_us: i32 = cal.rls_decimation * cal.tick_us
    both_ends: i64 = 2 * ecu.rls_washed[WASHED_RATE] - change
    wash(ecu, cal, TWICE_ROLL, shifted(both_ends * (step_us * HALF_US), 30))
    ecu.rls_last[0] = rate
    ecu.rls_last[1] = impulse


def net_impulse(ecu: Ecu, cal: Calibration) -> i32:
    """Return the washed-out impulse of a step, Q20, without the lean that its sensor also reads."""
    roll: i32 = product(ecu.rls_washed[TWICE_ROLL], GRAVITY_Q10, 16)
    return ecu.rls_washed[TWICE_IMPULSE] - product(roll, cal.rls_lateral, 30)


def momentum(ecu: Ecu, cal: Calibration) -> i32:
    """Return the washed-out angular momentum I_x d(phi), Q20."""
    return product(ecu.rls_washed[TWICE_RATE], cal.rls_inertia, 30)


def restart(ecu: Ecu) -> None:
    """Clear window and filters; the estimates are kept."""
    for signal in range(5):
        ecu.rls_washed[signal] = 0
    ecu.rls_filled = 0
    ecu.rls_index = 0
    ecu.rls_integrals[0] = 0
    ecu.rls_integrals[1] = 0
    for quantity in range(2):
        for k in range(WINDOW):
            ecu.rls_history[quantity][k] = 0


def identify(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Take one identification step where one is due, and adapt the observer's model."""
    if cal.identification == 0:
        return
    if elapsed > 1 or ecu.age[RX_IMU] > cal.rls_decimation or ecu.moment_unknown == 1:
        restart(ecu)
        return
    if (ecu.bad_ticks[BAD_ROLL_RATE] | ecu.bad_ticks[BAD_ACCELERATION]) != 0:
        restart(ecu)
        return
    ecu.rls_count = byte(clamp(ecu.rls_count + 1, 0, 20))
    if ecu.rls_count < cal.rls_decimation:
        return
    ecu.rls_count = 0
    impulses: i64 = net_impulse(ecu, cal)
    gained: i32 = -momentum(ecu, cal)
    wash_signals(ecu, cal)
    impulses += net_impulse(ecu, cal)
    gained += momentum(ecu, cal)
    roll: i32 = ecu.rls_washed[TWICE_ROLL]
    rate: i32 = ecu.rls_washed[TWICE_RATE]
    stiffness: i32 = remember(ecu, STIFFNESS, product(roll, cal.rls_stiffness, 30))
    balance: i32 = remember(ecu, BALANCE, rsh(impulses, 1) - gained)
    # the running sums change by what enters and what leaves the window
    ecu.rls_integrals[0] = sat31(ecu.rls_integrals[0] + stiffness)
    ecu.rls_integrals[1] = sat31(ecu.rls_integrals[1] + balance)
    index: i32 = ecu.rls_index + 1
    if index >= WINDOW:
        index = 0
    ecu.rls_index = byte(index)
    if ecu.rls_filled < SETTLED:
        ecu.rls_filled = byte(ecu.rls_filled + 1)
        return
    if rate < cal.rls_gate and rate > -cal.rls_gate:
        return
    damping: i32 = product(stiffness, cal.rls_damping, 20)
    # the trapezoidal rule, as for the impulse; whole steps would pass for damping
    learn(
        ecu,
        cal,
        clamp(ecu.rls_integrals[0] - rsh(stiffness, 1), -REGRESSOR_MAX, REGRESSOR_MAX),
        clamp(damping, -REGRESSOR_MAX, REGRESSOR_MAX),
        ecu.rls_integrals[1],
    )
    adapt_model(ecu, cal)


def init_identification(ecu: Ecu, cal: Calibration) -> None:
    """Start from the nominal parameters."""
    for k in range(2):
        ecu.theta[k] = clamp(RATIO_ONE, cal.rls_lo[k], cal.rls_hi[k])
    ecu.rls_covariance[0] = cal.rls_start
    ecu.rls_covariance[2] = cal.rls_start
