"""Conversion of a design in SI units to the integers of the ECU's calibration record."""

from dataclasses import dataclass
from math import ceil

import numpy as np

from canroll import dbc
from canroll.errors import CanrollError
from canroll.firmware import calibration as fw
from canroll.firmware.state import RX_ACTUATOR_STATE, RX_SUSPENSION_RATE
from canroll.gain_gen.calibration.monitor_part import clock_fields, erratic_fields
from canroll.gain_gen.calibration.observer_part import covariance_fields, observer_fields
from canroll.gain_gen.calibration.options import ACTUATOR_NUMBER, QuantiseOptions
from canroll.gain_gen.calibration.response_part import response_fields
from canroll.gain_gen.calibration.rows import (
    Q_COMPENSATOR,
    Q_COMPENSATOR_INPUTS,
    Q_MEASURED,
    Q_STATE,
    QuantisedRow,
    quantise_row,
)
from canroll.gain_gen.calibration.vehicle_part import timeouts, vehicle_fields
from canroll.gain_gen.models.controller import Compensator, matrices
from canroll.gain_gen.models.roll import stationary_covariance
from canroll.gain_gen.models.task import EPSILON_SQUARED, Design

Value = int | list[int] | list[list[int]]
Fields = dict[str, Value]

LAW_NUMBER = {"state": fw.STATE_FEEDBACK, "output": fw.OUTPUT_FEEDBACK, "dynamic": fw.COMPENSATOR}
OBSERVER_NUMBER = {
    "two_sensors": fw.CONSTANT_GAIN,
    "one_sensor": fw.CONSTANT_GAIN,
    "steering": fw.CONSTANT_GAIN,
    "propagated": fw.PROPAGATED_COVARIANCE,
    "acceleration": fw.CONSTANT_GAIN,
    "acceleration_propagated": fw.PROPAGATED_COVARIANCE,
    "reference": fw.BYPASS,
}
TRIGGER_SIGMAS = {"output": 5.0, "state": 3.0, "dynamic": 3.0}
"""Floor of the trigger over the command's noise: raw measurements need more than filtered ones."""
BIAS_MAX = 0.05
"""Largest plausible gyro bias, rad/s."""


@dataclass(frozen=True, slots=True)
class Quantised:
    """The integers of a calibration and their formats.

    Attributes:
        fields: value of every field that the design decides, by name.
        formats: fractional bits of each coefficient as a physical value, by field or field[row].
        errors: largest rounding error of a coefficient, by the same names.
    """

    fields: Fields
    formats: dict[str, tuple[int, ...]]
    errors: dict[str, float]


def quantise_design(design: Design, options: QuantiseOptions) -> Quantised:
    """Return the integers of ``design``.

    Raises:
        CanrollError: a coefficient or limit is outside its field's range; the message names it.
    """
    rows: dict[str, QuantisedRow] = {}
    task = design.task
    controller = design.controller
    fields: Fields = {
        "tick_us": round(1e6 * task.tick),
        "law": LAW_NUMBER[law_kind(design)],
        "actuator": ACTUATOR_NUMBER[task.actuator],
        "observer": OBSERVER_NUMBER[task.observer],
        "measurements": sum(1 << row for row in controller.observer.measurements),
        "identification": int(options.identification),
        "offset_learning": int(options.offset_learning),
        "event_trigger": int(options.event_trigger),
        "e2e": 1,
        "bias_max": round(BIAS_MAX * 2.0**fw.Q_RATE),
        "predict_steps": controller.predict_steps,
        "actuator_rate": round(controller.actuator_rate * fw.ONE),
    }
    fields |= observer_fields(design, rows, identification=options.identification)
    fields |= covariance_fields(controller.observer)
    fields |= _law(design, rows)
    fields |= _trigger(design, options)
    fields |= vehicle_fields(task, controller.schedule, options.uncertainty)
    fields |= clock_fields(task, options.sample_period) | erratic_fields(task)
    if options.response_watch:
        try:
            fields |= response_fields(task, options.uncertainty)
        except CanrollError as error:
            raise CanrollError(f"{error}: design with --no-watch-response") from error
    waits = timeouts(task, *((RX_SUSPENSION_RATE,) if options.response_watch else ()))
    if not options.moment_reported:
        waits[RX_ACTUATOR_STATE] = 0
    fields["timeout_ticks"] = waits
    return Quantised(
        fields,
        {name: row.formats for name, row in rows.items()},
        {name: row.error for name, row in rows.items()},
    )


def law_kind(design: Design) -> str:
    """Return which of the three forms the controller has: state, output or dynamic."""
    if design.controller.compensator is not None:
        return "dynamic"
    return "output" if design.controller.output_gain is not None else "state"


def _law(design: Design, rows: dict[str, QuantisedRow]) -> Fields:
    """The rows of the control law in use; the others stay zero."""
    controller = design.controller
    fields: Fields = {}
    for name in ("feedback", "feedforward"):
        values = getattr(controller, name)
        row = quantise_row(values, Q_STATE, fw.Q_MOMENT, name=name)
        rows[name] = row
        fields |= {name: list(row.stored), f"{name}_shift": row.shift}
    gain = np.zeros(3) if controller.output_gain is None else controller.output_gain
    row = quantise_row(gain, Q_MEASURED, fw.Q_MOMENT, name="output_gain")
    rows["output_gain"] = row
    fields |= {"output_gain": list(row.stored), "output_gain_shift": row.shift}
    if controller.compensator is not None:
        fields |= _compensator(controller.compensator, rows)
    else:
        fields |= {
            "compensator_outputs": 1,
            "compensator_shift": [1] * fw.N_ORDER,
            "compensator_output_shift": [1, 1],
        }
    return fields


def _compensator(compensator: Compensator, rows: dict[str, QuantisedRow]) -> Fields:
    """A compensator of n ≤ 8 states; its realisation is already scaled for Q24 states."""
    order, outputs = len(compensator.a), len(compensator.c)
    a = np.zeros((fw.N_ORDER, fw.N_ORDER))
    b = np.zeros((fw.N_ORDER, 4))
    e = np.zeros((fw.N_ORDER, 2))
    c = np.zeros((2, fw.N_ORDER))
    d = np.zeros((2, 4))
    a[:order, :order], b[:order], e[:order, :outputs] = compensator.a, compensator.b, compensator.e
    c[:outputs, :order], d[:outputs] = compensator.c, compensator.d
    state_rows = [
        quantise_row(
            np.concatenate([a[i], b[i], e[i]]),
            (*(Q_COMPENSATOR,) * fw.N_ORDER, *Q_COMPENSATOR_INPUTS, fw.Q_MOMENT, fw.Q_MOMENT),
            Q_COMPENSATOR,
            name=f"compensator_a[{i}]",
        )
        for i in range(fw.N_ORDER)
    ]
    output_rows = [
        quantise_row(
            np.concatenate([c[i], d[i]]),
            (*(Q_COMPENSATOR,) * fw.N_ORDER, *Q_COMPENSATOR_INPUTS),
            fw.Q_MOMENT,
            name=f"compensator_c[{i}]",
        )
        for i in range(2)
    ]
    rows |= {f"compensator_a[{i}]": row for i, row in enumerate(state_rows[:order])}
    rows |= {f"compensator_c[{i}]": row for i, row in enumerate(output_rows[:outputs])}
    return {
        "compensator_order": order,
        "compensator_outputs": outputs,
        "compensator_a": [list(row.stored[:8]) for row in state_rows],
        "compensator_b": [list(row.stored[8:12]) for row in state_rows],
        "compensator_e": [list(row.stored[12:]) for row in state_rows],
        "compensator_shift": [row.shift for row in state_rows],
        "compensator_c": [list(row.stored[:8]) for row in output_rows],
        "compensator_d": [list(row.stored[8:]) for row in output_rows],
        "compensator_output_shift": [row.shift for row in output_rows],
    }


def _trigger(design: Design, options: QuantiseOptions) -> Fields:
    """Event trigger: relative threshold of the 2022 paper, floor above what noise commands."""
    task = design.task
    floor = TRIGGER_SIGMAS[law_kind(design)] * command_noise(design)
    round_trip = 2.0 * task.delay.most + 2.0 * task.tick
    return {
        "trigger_epsilon_squared": round(EPSILON_SQUARED * 2.0**20),
        "trigger_floor": min(round(floor * 2.0**fw.Q_MOMENT), fw.STATE_MAX),
        "heartbeat_ticks": max(1, round(options.heartbeat / task.tick)),
        "acknowledge_ticks": max(3, ceil(round_trip / task.tick)),
        "status_ticks": max(1, round(dbc.period("RollControlStatus") / task.tick)),
    }


def command_noise(design: Design) -> float:
    """Return the standard deviation of the command that sensor noise alone causes, N·m.

    White noise of the sensors' standard deviations through the controller with the loop open; an
    upper bound where the closed loop does not amplify.
    """
    noise = design.task.noise
    a, b, c, d = matrices(design.controller)
    inputs = np.diag([noise.roll_rate**2, noise.lateral**2, 0.0, 0.0])
    direct = d @ inputs @ d.T
    if not len(a):
        return float(np.sqrt(direct[0, 0]))
    if np.abs(np.linalg.eigvals(a)).max() >= 1.0:
        # a marginal mode of a one-sensor filter carries no noise to the command in a few seconds
        covariance = np.zeros_like(a)
        for _ in range(500):
            covariance = a @ covariance @ a.T + b @ inputs @ b.T
    else:
        covariance = stationary_covariance(a, b @ inputs @ b.T)
    return float(np.sqrt(max((c @ covariance @ c.T + direct)[0, 0], 0.0)))
