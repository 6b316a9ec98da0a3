"""Settings of the ECU's run-time Riccati recursion, in units of powers of two."""

import numpy as np

from firmware import calibration as fw
from gain_gen.calibration.rows import Q_MEASURED, Q_STATE
from gain_gen.models.observer import Observer, steady_covariance
from gain_gen.models.roll import Matrix

Value = int | list[int] | list[list[int]]


def covariance_fields(observer: Observer) -> dict[str, Value]:
    """Return the fields, each state in units of a power of two of its own.

    Units are three standard deviations of the steady filter, so that variances stay near one.
    """
    model = observer.model
    steady = steady_covariance(model, (0, 1))
    # a state that nothing moves (the rate of a random walk) keeps a unit of its own
    unit = np.exp2(np.round(np.log2(3.0 * np.sqrt(np.maximum(np.diag(steady), 2.0**-40)))))
    innovation = np.einsum("mi,ij,mj->m", model.output, steady, model.output)
    measure = np.exp2(np.round(np.log2(np.sqrt(innovation + model.measurement_noise))))
    phi = model.phi * unit[None, :] / unit[:, None]
    output = model.output * unit[None, :] / measure[:, None]
    shift = [
        [
            round(24 - np.log2(unit[i] / measure[m]) - Q_STATE[i] + Q_MEASURED[m])
            for i in range(fw.N_STATES)
        ]
        for m in range(2)
    ]
    process = np.diag(model.process_noise) / unit**2
    start = np.minimum(16.0 * np.diag(steady) / unit**2 + 2.0**-20, 60.0)
    one = 2.0**24

    def integers(values: Matrix, least: int) -> list[int]:
        return [int(np.clip(round(float(v) * one), least, fw.STATE_MAX)) for v in values]

    return {
        "covariance_phi": [[round(float(v) * one) for v in row] for row in phi],
        "covariance_output": [[round(float(v) * one) for v in row] for row in output],
        "covariance_gain_shift": [[int(np.clip(n, 1, 62)) for n in row] for row in shift],
        "process_noise": integers(process, 0),
        "measurement_noise": integers(model.measurement_noise / measure**2, 1),
        "covariance_start": integers(start, 1),
        "covariance_max": integers(4.0 * start, 1),
    }
