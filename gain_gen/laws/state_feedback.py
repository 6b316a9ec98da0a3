"""Laws on the observed state: LQR, sliding mode, feedforward alone."""

from dataclasses import replace
from math import exp
from typing import Any

import numpy as np

from canroll.gain_gen.laws import WITHOUT_ROLL_RATE
from canroll.gain_gen.laws.declared import law
from canroll.gain_gen.laws.state_gains import (
    disturbance_feedforward,
    lqr,
    sliding_mode,
    yim_weights,
)
from canroll.gain_gen.models.controller import LinearController
from canroll.gain_gen.models.observer import (
    LateralModel,
    Observer,
    SensorNoise,
    kalman,
    observer_model,
)
from canroll.gain_gen.models.roll import Matrix
from canroll.gain_gen.models.task import Solution, Task
from canroll.vehicles import Vehicle
from canroll.vehicles.actuators import ACTUATORS

PRINTED = {
    "lqr": (38315.0, 4232.0),
    "hinf": (113700.0, 18860.0),
    "smc": (90670.0, 9981.0),
}
"""Gains of Yim 2020, (40), rows as untangled from the scan; u = −K x."""

SMC_SURFACE = np.array([[10.0, 1.0]])
SMC_ALPHA = 0.5

STEERED = LateralModel(frequency=6.0, damping=0.9, acceleration=1.5, steered=True)
"""Yaw and lateral dynamics between steering and a_y, and how far the tyres depart from it."""

FEEDFORWARD_SHARE = 0.3
"""Default β of u = −β m h a_y."""


def sensor_noise(vehicle: Vehicle) -> SensorNoise:
    """Return the noise of one sample of the vehicle's sensors, from density and bandwidth."""
    sensors = vehicle.sensors
    return SensorNoise(
        roll_rate=sensors.roll_rate.deviation, lateral=sensors.lateral_acceleration.deviation
    )


def observer_of(task: Task) -> Observer:
    """Return the constant-gain observer named by the task."""
    lateral = STEERED if task.observer == "steering" else task.lateral
    model = observer_model(task.vehicle.design, task.tick, lateral=lateral, noise=task.noise)
    measurements: tuple[int, ...] = (0, 1)
    if task.observer == "one_sensor":
        measurements = (0,)
    elif task.observer in WITHOUT_ROLL_RATE:
        measurements = (1,)
    observer = kalman(model, measurements=measurements)
    return replace(observer, bypass=task.observer == "reference")


def actuator_rate(task: Task) -> float:
    """Return the fraction of a step command that the actuator covers in a tick.

    Commands to dampers and valves are not moments: their moment is taken as delivered.
    """
    if not ACTUATORS[task.actuator].takes_moments:
        return 0.0
    return 1.0 - exp(-task.tick / task.lag)


def feedforward_row(task: Task, gain: float) -> Matrix:
    """Return u = −gain a_y as a row on the observer's state, zero if the feedforward is off."""
    return np.array([0.0, 0.0, gain if task.feedforward else 0.0, 0.0, 0.0])


def controller_of(task: Task, **gains: Any) -> LinearController:  # noqa: ANN401
    """Return a controller of a task, by default of its actuator; rows not given are zero."""
    usual = {
        "feedback": np.zeros(5),
        "feedforward": np.zeros(5),
        "actuator_rate": actuator_rate(task),
    }
    return LinearController(tick=task.tick, observer=observer_of(task), **{**usual, **gains})


def state_feedback(task: Task, gain: Matrix) -> LinearController:
    """Return u = −K [φ, φ'] − K_FF a_y on the observed state, ignoring the delay."""
    return controller_of(
        task,
        feedback=np.concatenate([np.ravel(gain), np.zeros(3)]),
        feedforward=feedforward_row(task, disturbance_feedforward(task.vehicle.design, task.tick)),
    )


def printed_note(law: str) -> str:
    """Return the note on printed gains of the 2020 paper."""
    return (
        f"{law}: gains as printed for the small SUV; they do not follow from the printed tables "
        f"(use --gains computed)"
    )


@law(gains=("computed", "as_printed"))
def design_lqr(task: Task) -> Solution:
    """Discrete LQR with Bryson weights (Yim 2020, (7)–(10)) and disturbance feedforward (21)."""
    if task.gains == "as_printed":
        return Solution(
            state_feedback(task, np.array(PRINTED["lqr"])), notes=(printed_note("lqr"),)
        )
    model = task.vehicle.design
    return Solution(state_feedback(task, lqr(model, task.tick, yim_weights(model))))


@law(gains=("computed", "as_printed"))
def design_smc(task: Task) -> Solution:
    """Discrete sliding mode on s = 10 φ + φ' with α = 0.5 (Yim 2020, (14)–(18))."""
    if task.gains == "as_printed":
        return Solution(
            state_feedback(task, np.array(PRINTED["smc"])), notes=(printed_note("smc"),)
        )
    gain = sliding_mode(task.vehicle.design, task.tick, surface=SMC_SURFACE, alpha=SMC_ALPHA)
    return Solution(state_feedback(task, gain), extra={"alpha": SMC_ALPHA})


@law(feedforward="alone")
def design_ay_feedforward(task: Task) -> Solution:
    """u = −β m h â_y, predicted over the delay by the observer's model: no feedback."""
    return _share_of_lateral(task, predict_steps=min(32, round(task.delay.nominal / task.tick)))


@law(feedforward="alone")
def design_plain_feedforward(task: Task) -> Solution:
    """u = −β m h â_y on the observer's filtered lateral acceleration, without prediction.

    A controller without a model: the baseline of every comparison.
    """
    return _share_of_lateral(task, predict_steps=0)


def _share_of_lateral(task: Task, *, predict_steps: int) -> Solution:
    gain = FEEDFORWARD_SHARE * task.vehicle.design.roll_arm
    row = np.array([0.0, 0.0, gain, 0.0, 0.0])
    controller = controller_of(task, feedforward=row, predict_steps=predict_steps)
    return Solution(controller, delay_aware=True)
