"""Error of the integer loop relative to float64: frequency response and a manoeuvre."""

from collections.abc import Callable

import numpy as np

from canroll.codegen.run.memory_image import sealed
from canroll.firmware.calibration import (
    PROPAGATED_COVARIANCE,
    Q_ACCELERATION,
    Q_MOMENT,
    Q_RATE,
    STATE_MAX,
    Calibration,
)
from canroll.firmware.com.signals import RX_SIGNALS
from canroll.firmware.control_law import control
from canroll.firmware.ecu import init
from canroll.firmware.observer import look_ahead, observe
from canroll.firmware.state import ACTIVE, RX_IMU, RX_ROLL_REFERENCE, Ecu
from canroll.gain_gen.analysis.margins import nyquist_grid
from canroll.gain_gen.analysis.sampled_loop import build
from canroll.gain_gen.analysis.verify import passive_controller
from canroll.gain_gen.calibration.dequantise import dequantise
from canroll.gain_gen.models.controller import LinearController, matrices, step
from canroll.gain_gen.models.roll import Matrix
from canroll.gain_gen.models.state_space import StateSpace
from canroll.gain_gen.models.task import Check, Design, below
from canroll.vehicles import GRAVITY

RESPONSE_LIMIT = 1e-3
"""Largest error of the frequency response, as share of its peak."""
MOMENT_LIMIT = 1.0
"""Largest error of the moment over the manoeuvre, N·m."""
UNIT_GAIN = 1 << 28
FULL_AUTHORITY = 1 << 30


def quantisation_checks(design: Design, record: Calibration) -> dict[str, Check]:
    """Return checks of the error of ``record`` relative to the design in float64."""
    checks = {
        "quantised_response": below(
            response_error(design.controller, dequantise(record)), RESPONSE_LIMIT
        )
    }
    if record.observer != PROPAGATED_COVARIANCE:
        # with run-time gains there is no constant float64 loop to hold it against
        checks["quantised_moment_nm"] = below(manoeuvre_error(design, record), MOMENT_LIMIT)
    return checks


def response_error(exact: LinearController, quantised: LinearController) -> float:
    """Return the largest difference of both responses from every input, over their peak."""
    worst = 0.0
    responses = [_response(controller) for controller in (exact, quantised)]
    for column in range(responses[0].shape[1]):
        peak = float(np.abs(responses[0][:, column]).max())
        if peak > 0.0:
            difference = np.abs(responses[0][:, column] - responses[1][:, column])
            worst = max(worst, float(difference.max()) / peak)
    return worst


def _response(controller: LinearController) -> np.ndarray:
    """Frequency response from the controller's inputs to the moment, (frequencies, inputs)."""
    frequencies = nyquist_grid(controller.tick, 200)
    return StateSpace(*matrices(controller), controller.tick).response(frequencies)[:, 0]


def lane_change(tick: float, *, seconds: float = 5.0, peak: float = 5.0) -> Matrix:
    """Return the lateral acceleration of a double lane change, m/s², one value per tick."""
    t = np.arange(0.0, seconds, tick)
    swing = np.sin(2.0 * np.pi * 0.4 * t) * np.exp(-(((t - 1.6) / 1.1) ** 2))
    return peak * np.asarray(swing / np.abs(swing).max(), dtype=float)


def measured(design: Design, limit: float) -> Matrix:
    """Return the sensor readings of the float64 closed loop over the lane change.

    Args:
        design: the law and its vehicle.
        limit: of the moment, N·m.

    Returns:
        (ticks, 4): roll rate, accelerometer, roll angle, delivered moment; rounded to the ECU's
        formats, so that both loops have the same inputs.
    """
    task, controller = design.task, design.controller
    lateral = lane_change(task.tick)
    if design.solution.verified_by_law:
        # a law for another plant: what it does to this one means nothing, so it only listens
        controller = passive_controller(controller)
    loop = build(
        task.vehicle.design, controller, delay=task.delay.nominal, lag=task.lag, lateral=None
    )
    x = np.zeros(len(loop.a))
    rows = []
    for value in lateral:
        # the lateral acceleration is imposed: the model's own state follows the manoeuvre
        x[3], x[4] = value, 0.0
        rows.append([x[1], GRAVITY * x[0] + value, x[0], x[2]])
        # limited, so that an unstable loop ends in a limit cycle as on the vehicle
        x = loop.a @ x + loop.b[:, 0] * np.clip(loop.c[0] @ x, -limit, limit)
    formats = np.array([2.0**Q_RATE, 2.0**Q_ACCELERATION, 2.0**30, 2.0**Q_MOMENT])
    return np.asarray(np.round(np.array(rows) * formats) / formats)


def manoeuvre_error(design: Design, record: Calibration) -> float:
    """Return the largest difference of the firmware's moment from float64's, N·m.

    Both run open loop on the same quantised inputs, so that errors are not fed back; the moment
    stays within its limits in both.
    """
    limit = record.moment_max / 2**Q_MOMENT
    inputs = measured(design, limit)
    controller = design.controller
    state: Matrix = np.zeros(controller.order)
    advance = integer_loop(record)
    worst = 0.0
    for y in inputs:
        state, u = step(controller, state, y, limit=limit)
        moment = float(np.sum(np.clip(u, -limit, limit)))
        if controller.predict_steps:
            state[4 + controller.predict_steps] = moment
        worst = max(worst, abs(advance(y) - moment))
    return worst


def integer_loop(record: Calibration) -> Callable[[Matrix], float]:
    """Return a function that runs observe, look ahead and control once on the inputs of a tick.

    It takes the four inputs in SI units and returns the moment, N·m: the firmware's code without
    mailboxes, schedule and trigger, at full authority.
    """
    ecu = Ecu()
    # the slew limit belongs to the actuators: here the law alone is looked at
    wide = Calibration()
    for name in record.__dict__:
        setattr(wide, name, getattr(record, name))
    wide.slew_max = STATE_MAX
    init(ecu, sealed(wide))
    ecu.mode = ACTIVE
    ecu.moment_unknown = 0
    ecu.lateral_lost = 0
    ecu.motion_lost = 0
    ecu.authority = FULL_AUTHORITY
    ecu.feedforward = FULL_AUTHORITY
    ecu.gain_factor = UNIT_GAIN
    ecu.fresh[RX_IMU] = RX_SIGNALS[RX_IMU]
    ecu.fresh[RX_ROLL_REFERENCE] = RX_SIGNALS[RX_ROLL_REFERENCE]

    def advance(y: Matrix) -> float:
        ecu.roll_rate = round(float(y[0]) * 2**Q_RATE)
        ecu.lateral_acceleration = round(float(y[1]) * 2**Q_ACCELERATION)
        ecu.rate_good = ecu.roll_rate
        ecu.acceleration_good = ecu.lateral_acceleration
        ecu.reference_roll = round(float(y[2]) * 2**30)
        ecu.reference_rate = ecu.roll_rate
        ecu.reference_acceleration = round(float(y[1] - GRAVITY * y[2]) * 2**Q_ACCELERATION)
        ecu.delivered[0] = round(float(y[3]) * 2**Q_MOMENT)
        observe(ecu, wide, 1)
        look_ahead(ecu, wide)
        control(ecu, wide, 1)
        ecu.ring_head = (ecu.ring_head + 1) & 31
        ecu.ring[ecu.ring_head] = ecu.moment
        return float(ecu.moment / 2**Q_MOMENT)

    return advance
