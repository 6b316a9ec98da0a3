"""Observer of a calibration: model and gains, and the run-time Riccati recursion."""

import numpy as np

from canroll.firmware import calibration as fw
from canroll.gain_gen.calibration.rows import Q_MEASURED, Q_STATE, QuantisedRow, quantise_row
from canroll.gain_gen.models.observer import Observer, steady_covariance
from canroll.gain_gen.models.roll import Matrix
from canroll.gain_gen.models.task import Design

Value = int | list[int] | list[list[int]]


def observer_fields(
    design: Design, rows: dict[str, QuantisedRow], *, identification: bool
) -> dict[str, Value]:
    """Return model, outputs and constant gains, each row with its own shift.

    Args:
        design: the design to convert.
        rows: filled with the quantised rows, by name.
        identification: whether the model is scaled at run time.
    """
    observer = design.controller.observer
    model = observer.model
    roll = design.task.vehicle.design
    tick = design.task.tick
    units = _taylor_units(tick, roll.roll_arm / roll.roll_inertia, 1.0 / roll.roll_inertia)
    phi, gamma, steering, shifts = [], [], [], []
    scale = [[0] * 4, [0] * 4]
    for i in range(fw.N_STATES):
        values = np.concatenate([model.phi[i], model.gamma[i], model.gamma_steering[i]])
        factors = (*Q_STATE, fw.Q_MOMENT, fw.Q_ACCELERATION)
        if i < 2 and identification:
            # the run-time model must fit the same shift as the nominal row
            full = quantise_row(
                np.concatenate([values, units[i]]),
                (*factors, fw.Q_ANGLE, fw.Q_RATE, fw.Q_ACCELERATION, fw.Q_MOMENT),
                Q_STATE[i],
                name=f"phi[{i}]",
                bound=fw.STATE_MAX // 2,
            )
            scale[i] = list(full.stored[7:])
            row = QuantisedRow(full.stored[:7], full.shift, full.formats[:7], full.error)
        else:
            row = quantise_row(values, factors, Q_STATE[i], name=f"phi[{i}]")
        rows[f"phi[{i}]"] = row
        phi.append(list(row.stored[:5]))
        gamma.append(row.stored[5])
        steering.append(row.stored[6])
        shifts.append(row.shift)

    output_values = np.vstack([model.output, [[1.0, 0.0, 0.0, 0.0, 0.0]]])
    outputs = [
        quantise_row(
            np.append(output_values[m], 0.0),
            (*Q_STATE, fw.Q_MOMENT),
            Q_MEASURED[m],
            name=f"output[{m}]",
        )
        for m in range(fw.N_MEASUREMENTS)
    ]
    for m, row in enumerate(outputs):
        rows[f"output[{m}]"] = row
    correction = [
        _gains(observer.correction[m], Q_MEASURED[m], f"correction[{m}]", rows) for m in range(2)
    ]
    correction.append(([0] * fw.N_STATES, [1] * fw.N_STATES))
    single = _gains(observer.correction_single, fw.Q_RATE, "correction_single", rows)
    return {
        "phi": phi,
        "gamma": gamma,
        "gamma_steering": steering,
        "phi_shift": shifts,
        "model_scale": scale,
        "output": [list(row.stored[:5]) for row in outputs],
        "output_moment": [row.stored[5] for row in outputs],
        "output_shift": [row.shift for row in outputs],
        "correction": [stored for stored, _ in correction],
        "correction_shift": [shift for _, shift in correction],
        "correction_single": single[0],
        "correction_single_shift": single[1],
    }


def _taylor_units(tick: float, lateral: float, moment: float) -> Matrix:
    """Return the units of the run-time model's normalised entries, rows roll and roll rate."""
    return np.array(
        [
            [1.0, tick, tick**2 * lateral, tick**2 * moment],
            [1.0 / tick, 1.0, tick * lateral, tick * moment],
        ]
    )


def _gains(
    gain: Matrix, measured: int, name: str, rows: dict[str, QuantisedRow]
) -> tuple[list[int], list[int]]:
    """Quantise one correction; every gain has its own shift."""
    entries = [
        # the innovation takes all of 32 bits
        quantise_row(gain[i : i + 1], (measured,), Q_STATE[i], name=f"{name}[{i}]", bound=1 << 31)
        for i in range(fw.N_STATES)
    ]
    rows |= {f"{name}[{i}]": entry for i, entry in enumerate(entries)}
    return [entry.stored[0] for entry in entries], [entry.shift for entry in entries]


def covariance_fields(observer: Observer) -> dict[str, Value]:
    """Return the settings of the recursion, each state scaled by its own power of two.

    Units are three standard deviations of the steady filter, so that variances stay near one.
    """
    model = observer.model
    # with the roll rate alone the equation may have no solution
    measurements = (0, 1) if 0 in observer.measurements else observer.measurements
    steady = steady_covariance(model, measurements)
    # a state that nothing moves (the rate of a random walk) keeps its unit
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
