"""Actuator options, and the node built from them for one vehicle."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.kernels import schedule
from canroll.plant_sim.kernels.schedule import ScheduledFault
from canroll.plant_sim.nodes import actuator_kernel, codec, codec_tables, e2e, envelope, hydraulics
from canroll.plant_sim.nodes.actuator_kernel import ActuatorNode
from canroll.vehicles.actuators import ACTUATORS, Actuator
from canroll.vehicles.axles import axles
from canroll.vehicles.model import SemiActiveDampers, Vehicle

COMMANDS = {name: actuator.commands for name, actuator in ACTUATORS.items()}
"""Messages that each node takes: name, first signal, channels."""


def command_signals(message: str) -> tuple[str, ...]:
    """Names of the values in a command, in the order of its channels."""
    first, channels = next(
        (signal, count)
        for taken in COMMANDS.values()
        for name, signal, count in taken
        if name == message
    )
    names = list(codec_tables.signal_names(message))
    start = names.index(first)
    return tuple(names[start : start + channels])


CORNERS = ("front_left", "front_right", "rear_left", "rear_right")
PLACES = {
    **{corner: 1 << number for number, corner in enumerate(CORNERS)},
    "front": 0b0011,
    "rear": 0b1100,
    "actuators": 0b1111,
}
"""Places of faults, and the corners there, bit by bit."""
FAULTS = {name: number for number, name in enumerate(actuator_kernel.FAULT_NAMES)}
VALUED = ("weak", "slow", "runaway", "derating")
"""Kinds of faults that have a value."""

NOMINAL_TEMPERATURE = 40.0
NOMINAL_SUPPLY = 13.5
LOWEST_SUPPLY = 9.0
# Hydraulic oil's viscosity falls by about 2.3 % a kelvin around its working temperature.
THICKENING_PER_KELVIN = 0.023
THICKEST, THINNEST = 10.0, 0.5

_REPORT = (
    "DeliveredMomentFront",
    "DeliveredMomentRear",
    "StatusFrontLeft",
    "StatusFrontRight",
    "StatusRearLeft",
    "StatusRearRight",
    "Enabled",
    "CommandHeld",
    "AcceptedCounter",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorOptions:
    """Operating conditions of the vehicle's actuators.

    ``estimate_error``: gain error of the delivered-moment estimate, within ± 0.2;
    ``estimate_lag`` (s) its first-order lag. ``oil_temperature`` (°C): cold oil slows hydraulic
    actuators. ``supply`` (V): below nominal, limits shrink in proportion; below 9 V nothing is
    delivered.
    """

    estimate_error: float = 0.0
    estimate_lag: float = 0.005
    oil_temperature: float = NOMINAL_TEMPERATURE
    supply: float = NOMINAL_SUPPLY
    supervision: e2e.Supervision = field(default_factory=e2e.Supervision)
    faults: tuple[ScheduledFault, ...] = ()


def thickening(temperature: float) -> float:
    """Viscosity of the hydraulic oil at ``temperature`` (°C) over that at 40 °C."""
    exponent = THICKENING_PER_KELVIN * (NOMINAL_TEMPERATURE - temperature)
    return min(max(math.exp(exponent), THINNEST), THICKEST)


def _approach(lag: float) -> float:
    return 1 - math.exp(-1e-3 / lag) if lag > 0 else 1.0


def _scaled(limit: float, power: float) -> float:
    """A limit at reduced ``power``; none stays none."""
    return limit * power if math.isfinite(limit) else limit


def _settings(
    vehicle: Vehicle, actuator: Actuator, options: ActuatorOptions
) -> Mapping[str, object]:
    """Lag, limit, rate and power of one channel, for oil and supply; inf where unlimited."""
    channel = actuator.channel(vehicle)
    cold = thickening(options.oil_temperature) if actuator.hydraulic else 1.0
    power = min(options.supply / NOMINAL_SUPPLY, 1.0)
    limit, rate = _scaled(channel.limit, power), _scaled(channel.rate, power)
    return {
        "lag": _approach(channel.lag * cold),
        "limit": limit,
        "rate": rate * 1e-3,
        "fade": 1e-3 / vehicle.plant.roll_period,
        "power": _scaled(channel.power, power),
        "half_track": [axle.half_track for axle in axles(vehicle)],
        "estimate_gain": 1 + options.estimate_error,
        "estimate_lag": _approach(options.estimate_lag),
        "current_limit": actuator.current_limit(vehicle) * (power if actuator.hydraulic else 1.0),
        "hydraulics": hydraulics.parameters(
            vehicle.actuators.valves, thickening=thickening(options.oil_temperature)
        ),
    }


def _check(kind: str, options: ActuatorOptions, timeout_ms: float) -> None:
    if kind not in ACTUATORS:
        raise UnknownNameError("actuator", kind, ACTUATORS)
    if not ACTUATORS[kind].hydraulic and options.oil_temperature != NOMINAL_TEMPERATURE:
        raise CanrollError(f"actuators: oil_temperature does not act on {kind}: omit it")
    if abs(options.estimate_error) > 0.2:
        raise CanrollError("actuators: estimate_error must be from -0.2 to 0.2")
    if not timeout_ms > 0:
        raise CanrollError("actuators: the command timeout must be positive")
    for fault in options.faults:
        if fault.where not in PLACES:
            raise UnknownNameError("corner", fault.where, PLACES)
        if fault.kind not in FAULTS:
            raise UnknownNameError("actuator fault", fault.kind, FAULTS)


def _curve(data: SemiActiveDampers) -> NDArray[np.float64]:
    """Rates, soft and firm forces (3, n), extrapolated by the last slope to fill the table."""
    curve = np.array([data.rate, data.soft_force, data.firm_force])
    if curve.shape[1] > actuator_kernel.CURVE_POINTS:
        raise CanrollError(f"dampers: at most {actuator_kernel.CURVE_POINTS} points in their map")
    slope = curve[:, -1] - curve[:, -2]
    missing = np.arange(1, actuator_kernel.CURVE_POINTS - curve.shape[1] + 1)
    return np.hstack([curve, curve[:, -1:] + slope[:, None] * missing])


def _fault(fault: ScheduledFault) -> tuple[float, ...]:
    what = f"actuator fault at {fault.where}"
    value = fault.value if fault.kind in VALUED else 1.0
    return schedule.row(PLACES[fault.where], FAULTS[fault.kind], fault, what, value)


def build(
    vehicle: Vehicle,
    kind: str,
    *,
    options: ActuatorOptions,
    enabled: bool,
    timeout_ms: float,
    integrated: bool = False,
    tables: codec.Codec | None = None,
) -> ActuatorNode:
    """Actuator node of ``vehicle`` on the bus of ``tables``, by default that of the contract.

    ``integrated``: the body includes the electro-hydraulics.
    """
    _check(kind, options, timeout_ms)
    actuator = ACTUATORS[kind]
    faults = list(map(_fault, options.faults))
    node = np.zeros(1, actuator_kernel.ACTUATOR_NODE)[0]
    for name, setting in _settings(vehicle, actuator, options).items():
        node[name] = setting
    node["integrated"] = integrated
    node["curve"] = _curve(vehicle.actuators.dampers)
    node["kind"], node["enabled"] = actuator.number, enabled
    node["powered"] = options.supply >= LOWEST_SUPPLY
    node["counter"], node["timeout"] = actuator_kernel.NO_COUNTER, round(timeout_ms * 1e6)
    node["message"]["row"] = -1
    for number, (name, first, channels) in enumerate(actuator.commands):
        signal = codec_tables.signal_index(name, first)
        node["message"][number] = codec_tables.message_index(name), signal, channels
    node["report"] = [codec_tables.signal_index("ActuatorState", name) for name in _REPORT]
    node["fault"] = schedule.table(actuator_kernel.FAULTS, faults, "actuators: at most {} faults")
    node["supervision"] = options.supervision
    node["receiver"] = e2e.receiver_state(options.supervision)
    node["envelope"] = envelope.build(
        actuator.arms(vehicle),
        actuator.most(vehicle),
        tables or codec_tables.load(),
        options.supervision,
    )
    return node
