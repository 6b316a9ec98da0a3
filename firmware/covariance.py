"""Run-time Riccati recursion of the observer, for gains that adapt to the valid measurements.

Each state is in units of its own power of two, so that all variances are near one; they are kept
in Q24, symmetric, with a floor and a cap. The cap on the lateral acceleration's variance keeps
roll angle and lateral acceleration from winding each other up while they cannot be distinguished.
"""

from canroll.firmware.calibration import N_STATES, STATE_MAX, Calibration
from canroll.firmware.fixed_point import product, quotient, shifted, weighted
from canroll.firmware.state import Ecu
from canroll.firmware.subset import clamp, i32, i64, sat31

Q_COVARIANCE = 24
ONE = 1 << Q_COVARIANCE


def bounded(ecu: Ecu, cal: Calibration) -> None:
    """Keep the variances between their floor and their cap.

    A capped variance takes its covariances down with it, by the same factor: the matrix stays
    positive semidefinite, which capping the diagonal alone would not leave it.
    """
    for i in range(N_STATES):
        variance: i32 = ecu.covariance[i][i]
        if variance > cal.covariance_max[i]:
            share: i32 = clamp(quotient(cal.covariance_max[i] * ONE, variance), 0, ONE)
            for j in range(N_STATES):
                ecu.covariance[i][j] = product(ecu.covariance[i][j], share, Q_COVARIANCE)
                ecu.covariance[j][i] = ecu.covariance[i][j]
        ecu.covariance[i][i] = clamp(variance, 1, cal.covariance_max[i])


def propagate(ecu: Ecu, cal: Calibration, steps: i32) -> None:
    """P = Phi P Phi' + M, in place: rows of (Phi P)' first, then columns.

    Over ``steps`` ticks the noise is that of all of them, the rest that of one.
    """
    for k in range(N_STATES):
        for i in range(N_STATES):
            row: i64 = weighted(cal.covariance_phi[i], ecu.covariance[k])
            ecu.work[i] = shifted(row, Q_COVARIANCE)
        for i in range(N_STATES):
            ecu.covariance[k][i] = ecu.work[i]
    for i in range(N_STATES):
        for j in range(N_STATES):
            ecu.work[j] = ecu.covariance[j][i]
        # the columns before are done: what this one mirrors into them is theirs
        for k in range(i + 1):
            column: i64 = weighted(cal.covariance_phi[k], ecu.work)
            ecu.covariance[k][i] = shifted(column, Q_COVARIANCE)
            ecu.covariance[i][k] = ecu.covariance[k][i]
        ecu.covariance[i][i] = sat31(ecu.covariance[i][i] + steps * cal.process_noise[i])
    bounded(ecu, cal)


def update(ecu: Ecu, cal: Calibration, measured: i32, innovation: i32) -> None:
    """Correct state and covariance by one scalar innovation."""
    for i in range(N_STATES):
        row: i64 = weighted(cal.covariance_output[measured], ecu.covariance[i])
        ecu.work[i] = shifted(row, Q_COVARIANCE)
    variance: i32 = shifted(weighted(cal.covariance_output[measured], ecu.work), Q_COVARIANCE)
    total: i32 = clamp(variance, 0, STATE_MAX) + cal.measurement_noise[measured]
    for i in range(N_STATES):
        gain: i32 = quotient(ecu.work[i] * ONE, total)
        step: i32 = product(gain, innovation, cal.covariance_gain_shift[measured][i])
        ecu.x[i] = sat31(ecu.x[i] + step)
        for j in range(i + 1):
            drop: i32 = product(gain, ecu.work[j], Q_COVARIANCE)
            ecu.covariance[i][j] = sat31(ecu.covariance[i][j] - drop)
            ecu.covariance[j][i] = ecu.covariance[i][j]
        # a measurement takes variance away, it never adds any: only the floor can be passed
        ecu.covariance[i][i] = clamp(ecu.covariance[i][i], 1, cal.covariance_max[i])


def init_covariance(ecu: Ecu, cal: Calibration) -> None:
    """Start from the calibrated variances."""
    for i in range(N_STATES):
        ecu.covariance[i][i] = cal.covariance_start[i]
