"""The controller represented by the integers, for margins and rounding error."""

import numpy as np

from canroll.firmware import calibration as fw
from canroll.firmware.calibration import Calibration
from canroll.gain_gen.calibration.rows import (
    Q_COMPENSATOR,
    Q_COMPENSATOR_INPUTS,
    Q_MEASURED,
    Q_STATE,
)
from canroll.gain_gen.models.controller import Compensator, LinearController
from canroll.gain_gen.models.observer import Observer, ObserverModel
from canroll.gain_gen.models.roll import Matrix

Q_COMPENSATOR_STATES = (Q_COMPENSATOR,) * fw.N_ORDER
Q_MOMENTS = (fw.Q_MOMENT, fw.Q_MOMENT)


def _row(stored: list[int], shift: int, factors: tuple[int, ...], result: int) -> Matrix:
    """Return a stored row in physical units."""
    scale = np.array([2.0 ** -(shift + result - factor) for factor in factors])
    physical: Matrix = np.array(stored, dtype=float) * scale
    return physical


def physical_rows(record: Calibration) -> dict[str, list[Matrix]]:
    """Return every row of coefficients of ``record`` in SI units, by field."""
    states = range(fw.N_STATES)
    orders = range(record.compensator_order)
    outputs = range(record.compensator_outputs) if record.compensator_order else range(0)
    single = record.correction_single_shift
    rows = {
        "phi": [_row(record.phi[i], record.phi_shift[i], Q_STATE, Q_STATE[i]) for i in states],
        "gamma": [
            _row([record.gamma[i]], record.phi_shift[i], (fw.Q_MOMENT,), Q_STATE[i]) for i in states
        ],
        "gamma_steering": [
            _row([record.gamma_steering[i]], record.phi_shift[i], (fw.Q_ACCELERATION,), Q_STATE[i])
            for i in states
        ],
        "output": [
            _row(record.output[m], record.output_shift[m], Q_STATE, Q_MEASURED[m])
            for m in range(fw.N_MEASUREMENTS)
        ],
        "correction": [
            np.array([_gain(record, m, i) for i in states]) for m in range(fw.N_MEASUREMENTS)
        ],
        "correction_single": [
            np.array(
                [
                    record.correction_single[i] * 2.0 ** -(single[i] + Q_STATE[i] - fw.Q_RATE)
                    for i in states
                ]
            )
        ],
        "feedback": [_row(record.feedback, record.feedback_shift, Q_STATE, fw.Q_MOMENT)],
        "feedforward": [_row(record.feedforward, record.feedforward_shift, Q_STATE, fw.Q_MOMENT)],
        "output_gain": [
            _row(record.output_gain, record.output_gain_shift, Q_MEASURED, fw.Q_MOMENT)
        ],
    }
    for name, factors in (
        ("compensator_a", Q_COMPENSATOR_STATES),
        ("compensator_b", Q_COMPENSATOR_INPUTS),
        ("compensator_e", Q_MOMENTS),
    ):
        stored = getattr(record, name)
        rows[name] = [
            _row(stored[i], record.compensator_shift[i], factors, Q_COMPENSATOR) for i in orders
        ]
    for name, factors in (
        ("compensator_c", Q_COMPENSATOR_STATES),
        ("compensator_d", Q_COMPENSATOR_INPUTS),
    ):
        stored = getattr(record, name)
        rows[name] = [
            _row(stored[k], record.compensator_output_shift[k], factors, fw.Q_MOMENT)
            for k in outputs
        ]
    return rows


def physical_notes(record: Calibration) -> dict[str, str]:
    """Return the coefficient rows in SI units, as comments by field."""
    return {
        name: "; ".join(" ".join(f"{value:.6g}" for value in row) for row in rows)
        for name, rows in physical_rows(record).items()
    }


def _gain(record: Calibration, m: int, i: int) -> float:
    exponent = record.correction_shift[m][i] + Q_STATE[i] - Q_MEASURED[m]
    return float(record.correction[m][i] * 2.0**-exponent)


def dequantise(record: Calibration) -> LinearController:
    """Return the controller of a record in SI units."""
    rows = physical_rows(record)
    tick = 1e-6 * record.tick_us
    model = ObserverModel(
        phi=np.array(rows["phi"]),
        gamma=np.array(rows["gamma"]),
        gamma_steering=np.array(rows["gamma_steering"]),
        output=np.array(rows["output"][:2]),
        process_noise=np.zeros((5, 5)),
        measurement_noise=np.zeros(2),
        tick=tick,
    )
    measurements = tuple(m for m in (0, 1) if record.measurements >> m & 1)
    observer = Observer(
        model=model,
        measurements=measurements,
        correction=np.array(rows["correction"][:2]),
        correction_single=rows["correction_single"][0],
        bypass=record.observer == fw.BYPASS,
    )
    compensator = None
    if record.law == fw.COMPENSATOR:
        n, outputs = record.compensator_order, record.compensator_outputs
        compensator = Compensator(
            a=np.array(rows["compensator_a"])[:, :n].reshape(n, n),
            b=np.array(rows["compensator_b"]).reshape(n, 4),
            e=np.array(rows["compensator_e"])[:, :outputs].reshape(n, outputs),
            c=np.array(rows["compensator_c"])[:, :n].reshape(outputs, n),
            d=np.array(rows["compensator_d"]).reshape(outputs, 4),
        )
    return LinearController(
        tick=tick,
        observer=observer,
        feedback=rows["feedback"][0],
        feedforward=rows["feedforward"][0],
        output_gain=rows["output_gain"][0] if record.law == fw.OUTPUT_FEEDBACK else None,
        compensator=compensator,
        predict_steps=record.predict_steps,
        actuator_rate=record.actuator_rate / fw.ONE,
        schedule=tuple(factor / 2**28 for factor in record.schedule_gain),
    )
