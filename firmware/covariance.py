"""Run-time Riccati recursion of the observer, for gains that follow what is really measured.

Each state is in units of its own power of two, so that all variances are near one; they are kept
in Q24, symmetric, with a floor and a cap. The cap on the lateral acceleration's variance keeps
roll angle and lateral acceleration from winding each other up while they can't be told apart.
"""

from firmware.calibration import N_STATES, STATE_MAX, Calibration
from firmware.state import Ecu
from firmware.subset import clamp, i32, i64, narrow, rsh, sat31, scaled, tdiv

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
            share: i32 = clamp(tdiv(cal.covariance_max[i] * ONE, variance), 0, ONE)
            for j in range(N_STATES):
                shrunk: i64 = rsh(ecu.covariance[i][j] * share, Q_COVARIANCE)
                ecu.covariance[i][j] = narrow(shrunk)
                ecu.covariance[j][i] = ecu.covariance[i][j]
        ecu.covariance[i][i] = clamp(variance, 1, cal.covariance_max[i])


def propagate(ecu: Ecu, cal: Calibration) -> None:
    """P = Phi P Phi' + M over one tick, in place: columns first, then rows."""
    for k in range(N_STATES):
        for i in range(N_STATES):
            acc: i64 = 0
            for j in range(N_STATES):
                acc += cal.covariance_phi[i][j] * ecu.covariance[j][k]
            ecu.work[i] = scaled(acc, Q_COVARIANCE)
        for i in range(N_STATES):
            ecu.covariance[i][k] = ecu.work[i]
    for i in range(N_STATES):
        for k in range(i + 1):
            total: i64 = 0
            for j in range(N_STATES):
                total += ecu.covariance[i][j] * cal.covariance_phi[k][j]
            ecu.work[k] = scaled(total, Q_COVARIANCE)
        # the rows above are done: what this row mirrors into them is theirs
        for k in range(i + 1):
            ecu.covariance[i][k] = ecu.work[k]
            ecu.covariance[k][i] = ecu.work[k]
        ecu.covariance[i][i] = sat31(ecu.covariance[i][i] + cal.process_noise[i])
    bounded(ecu, cal)


def update(ecu: Ecu, cal: Calibration, measured: i32, innovation: i32) -> None:
    """Correct state and covariance by one scalar innovation."""
    variance: i64 = 0
    for i in range(N_STATES):
        acc: i64 = 0
        for j in range(N_STATES):
            acc += ecu.covariance[i][j] * cal.covariance_output[measured][j]
        ecu.work[i] = scaled(acc, Q_COVARIANCE)
        variance += cal.covariance_output[measured][i] * ecu.work[i]
    total: i64 = clamp(rsh(variance, Q_COVARIANCE), 0, STATE_MAX) + cal.measurement_noise[measured]
    for i in range(N_STATES):
        gain: i32 = sat31(tdiv(ecu.work[i] * (1 << Q_COVARIANCE), total))
        step: i64 = rsh(gain * innovation, cal.covariance_gain_shift[measured][i])
        ecu.x[i] = sat31(ecu.x[i] + step)
        for j in range(i + 1):
            left: i64 = ecu.covariance[i][j] - rsh(gain * ecu.work[j], Q_COVARIANCE)
            ecu.covariance[i][j] = sat31(left)
            ecu.covariance[j][i] = ecu.covariance[i][j]
    bounded(ecu, cal)


def init_covariance(ecu: Ecu, cal: Calibration) -> None:
    """Start from the calibrated variances."""
    for i in range(N_STATES):
        for j in range(N_STATES):
            ecu.covariance[i][j] = 0
        ecu.covariance[i][i] = cal.covariance_start[i]
