"""Sensor options, and the tables built from them for one vehicle and seed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.can_bus.network import own_frames
from canroll.plant_sim.kernels import schedule
from canroll.plant_sim.kernels.instants import NEVER
from canroll.plant_sim.kernels.schedule import ScheduledFault
from canroll.plant_sim.nodes import codec, codec_tables, sensor_kernel
from canroll.plant_sim.nodes.codec import Codec
from canroll.plant_sim.nodes.imu_motion import N_MOTION, mounting
from canroll.plant_sim.nodes.sensor_kernel import SensorTables
from canroll.vehicles.model import SensorChannel, Vehicle

SENDERS = {
    "Imu": "Imu",
    "VehicleMotion": "Chassis",
    "SuspensionRate": "Suspension",
    "SuspensionTravel": "Suspension",
    "RollReference": "Reference",
    "ActuatorState": "Actuator",
}
"""Node of the bus that sends each message."""
NODES = tuple(SENDERS)
"""Messages of the plant's nodes in the order of the node table."""

FAULTS = {
    name: number
    for number, name in enumerate((*sensor_kernel.SIGNAL_FAULTS, *sensor_kernel.MESSAGE_FAULTS))
} | {"spike": sensor_kernel.OFFSET}
SPIKE_EVERY = 0.1
"""Time (s) from spike to spike, unless given."""

_SIGNALS = (
    ("Imu", ("RollRate", "LateralAcceleration", "YawRate")),
    ("VehicleMotion", ("VehicleSpeed", "SteeringWheelAngle", "LongitudinalAcceleration")),
    ("SuspensionRate", ("RateFrontLeft", "RateFrontRight", "RateRearLeft", "RateRearRight")),
    (
        "SuspensionTravel",
        ("TravelFrontLeft", "TravelFrontRight", "TravelRearLeft", "TravelRearRight"),
    ),
    ("RollReference", ("RollAngle", "RollRate", "LateralAcceleration")),
    ("ActuatorState", ()),
)
SIGNALS = tuple(f"{message}.{signal}" for message, names in _SIGNALS for signal in names)
"""Signals of the sensors, in the order of their channels."""
PER_UNIT = {
    "deg/s": 180 / math.pi,
    "deg": 180 / math.pi,
    "m/s2": 1.0,
    "km/h": 3.6,
    "mm": 1e3,
    "mm/s": 1e3,
    "mA": 1e3,
    "N": 1.0,
    "Nm": 1.0,
}
"""Units of the bus per SI unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorOptions:
    """Operating conditions of the vehicle's sensors.

    ``noise`` and ``bias`` scale the vehicle's figures (0 switches them off); there is no noise from
    ``noise_end`` (s) on; the bias is drawn
    from the seed, uniform within the vehicle's bound. ``filtered`` and ``delayed`` enable
    low-passes and latencies. ``temperature`` is K above calibration; ``drift`` is the random walk
    of each bias per √s as a fraction of its bound. ``phases``: instant of a node's first sample (s)
    by message; others are drawn from the seed within their cycle time, 0 for all where
    ``synchronous``. ``lsb``: resolution of a sensor's converter (SI units) by signal, if coarser
    than the bus's.
    """

    noise: float = 1.0
    noise_end: float = math.inf
    bias: float = 1.0
    filtered: bool = True
    delayed: bool = True
    temperature: float = 0.0
    drift: float = 0.0
    phases: Mapping[str, float] = field(default_factory=dict)
    synchronous: bool = False
    lsb: Mapping[str, float] = field(default_factory=dict)
    faults: tuple[ScheduledFault, ...] = ()

    @classmethod
    def ideal(cls, **changes: object) -> "SensorOptions":
        """Ideal sensors: no error but the bus's resolution, and no latency."""
        plain = {"noise": 0.0, "bias": 0.0, "filtered": False, "delayed": False}
        return cls(**{**plain, **changes})  # type: ignore[arg-type]


def delay(channel: SensorChannel, *, options: SensorOptions) -> float:
    """Delay of a slow signal from motion to queued frame (s): low-pass and latency."""
    filtered = 1 / (2 * math.pi * channel.bandwidth) if options.filtered else 0.0
    return filtered + (channel.latency if options.delayed else 0.0)


def _channels(vehicle: Vehicle) -> list[SensorChannel | None]:
    data = vehicle.sensors
    imu = [data.roll_rate, data.lateral_acceleration, data.yaw_rate]
    motion = [data.speed, data.steering_wheel, data.longitudinal_acceleration]
    return [*imu, *motion, *[data.suspension_rate] * 4, *[data.suspension_travel] * 4, *[None] * 3]


def signal_channel(name: str) -> int:
    """Row of the channel table for a signal written "Imu.RollRate"."""
    if name not in SIGNALS:
        raise UnknownNameError("sensor signal", name, SIGNALS)
    return SIGNALS.index(name)


def _low_pass(bandwidth: float) -> tuple[float, float, float]:
    """Weights of the last output, the last and the new input, for input linear over a step."""
    rate = 2 * math.pi * bandwidth * sensor_kernel.STEP
    keep = math.exp(-rate)
    mean = (1 - keep) / rate
    return keep, mean - keep, 1 - mean


def _channel(
    data: SensorChannel | None,
    unit: str,
    period: float,
    options: SensorOptions,
    draws: np.random.Generator,
) -> Any:  # noqa: ANN401
    row = np.zeros(1, sensor_kernel.CHANNEL)[0]
    row["new"] = 1.0
    row["range"] = math.inf
    row["to_bus"] = PER_UNIT[unit]
    if data is None:
        return row
    if options.filtered:
        row["keep"], row["old"], row["new"] = _low_pass(data.bandwidth)
    warming = data.bias_per_kelvin * options.temperature
    row["bias"] = options.bias * (data.bias + abs(warming)) * draws.uniform(-1, 1)
    row["drift_step"] = options.drift * options.bias * data.bias * math.sqrt(period)
    row["noise"] = options.noise * data.noise_density * math.sqrt(math.pi / 2 * data.bandwidth)
    row["noise_memory"] = math.exp(-2 * math.pi * data.bandwidth * period)
    row["noise_end_ns"] = options.noise_end * 1e9
    row["range"] = data.range
    return row


def _fault(fault: ScheduledFault, node: NDArray[Any], tables: Codec) -> tuple[float, ...]:
    """Row of a fault among the tables of the sensors' nodes."""
    if fault.kind not in FAULTS:
        raise UnknownNameError("sensor fault", fault.kind, FAULTS)
    message = fault.where.partition(".")[0]
    if message not in NODES:
        raise UnknownNameError("sensor message", message, NODES)
    what = f"sensor fault of {fault.where}"
    number = NODES.index(message)
    value = fault.value
    if fault.kind in sensor_kernel.MESSAGE_FAULTS:
        place = sensor_kernel.N_CHANNELS + number
        value = value if fault.kind == "clock_drift" else 1.0
    else:
        place = signal_channel(fault.where)
    period = int(node[number]["period"]) * 1e-9
    if fault.kind == "spike":
        fault = replace(fault, every=fault.every or SPIKE_EVERY, lasting=period)
    elif fault.kind == "delay":
        value = round(value / period)
        if not 0 <= value < sensor_kernel.HISTORY:
            longest = period * (sensor_kernel.HISTORY - 1)
            raise CanrollError(f"{what}: a delay must be 0 to {longest:g} s")
    _refuse_unsayable(fault, tables)
    return schedule.row(1 << place, FAULTS[fault.kind], fault, what, value)


def _refuse_unsayable(fault: ScheduledFault, tables: Codec) -> None:
    message, _, signal = fault.where.partition(".")
    if not signal:
        return
    row = tables.field[codec_tables.signal_index(message, signal)]
    if not row["pieces"]:
        raise CanrollError(f"sensor fault of {fault.where}: the map has no such signal")
    unsaid = row["raw_error"] == codec.NO_ERROR_CODE and row["validity"] < 0
    if fault.kind == "invalid" and unsaid:
        raise CanrollError(
            f"sensor fault of {fault.where}: the signal has no code for invalid: add unavailable "
            "or valid in the map"
        )


def _add_further(
    node: NDArray[Any], tables: Codec, draws: np.random.Generator, options: SensorOptions
) -> None:
    """Rows for the frames of a message behind its first, with the cycle times they have."""
    free = len(NODES)
    for index in range(len(tables.message) - own_frames.FURTHER_FRAMES, len(tables.message)):
        if not tables.message[index]["length"]:
            continue
        contract = tables.message[index]["contract"]
        first = node[node["message"] == contract][0]
        node[free] = first
        period = int(tables.message[index]["cycle_ns"])
        drawn = 0 if options.synchronous else int(draws.integers(period))
        leads = tables.message[index]["leader"] == index
        node[free]["message"], node[free]["period"] = index, period
        node[free]["next"] = drawn if leads else NEVER
        free += 1


def build(
    vehicle: Vehicle, *, options: SensorOptions, seed: int, tables: Codec | None = None
) -> SensorTables:
    """Tables of all sensor nodes of ``vehicle``; the same seed gives the same sensors.

    ``tables`` are the bus's frames, by default those of the contract. A node whose message is not
    on the bus, or shares the frame of another node, has no separate sampling instants.
    """
    for message in options.phases:
        if message not in NODES:
            raise UnknownNameError("sensor message", message, NODES)
    tables = tables or codec_tables.load()
    contract = codec_tables.load()
    draws = np.random.default_rng([seed, 1])
    data = _channels(vehicle)
    channels: list[Any] = []
    rows = len(NODES) + own_frames.FURTHER_FRAMES
    node = np.zeros(rows, sensor_kernel.NODE)
    node["next"] = NEVER
    node["message"] = -1
    for number, (message, names) in enumerate(_SIGNALS):
        row = node[number]
        row["sensor"] = number
        index = codec_tables.message_index(message)
        own = int(contract.message[index]["cycle_ns"])
        period = int(tables.message[index]["cycle_ns"]) or own
        # the same share of the cycle on every bus
        drawn = 0 if options.synchronous else int(draws.integers(own)) * period // own
        members = data[len(channels) : len(channels) + len(names)]
        latency = max((c.latency for c in members if c), default=0.0) if options.delayed else 0.0
        row["message"] = index
        row["first_channel"] = len(channels)
        row["channels"] = len(names)
        row["period"] = period
        row["latency"] = round(latency * 1e9)
        row["next"] = round(options.phases[message] * 1e9) if message in options.phases else drawn
        if not tables.message[index]["length"] or tables.message[index]["leader"] != index:
            row["next"] = NEVER
        row["sample_signal"] = codec_tables.signal_index(message, "SampleCounter")
        for name, member in zip(names, members, strict=True):
            signal = codec_tables.signal_index(message, name)
            unit = codec_tables.unit(message, name)
            carrier = tables.message[tables.field[signal]["frame"]]
            sampled = int(carrier["cycle_ns"]) or period
            channels.append(_channel(member, unit, sampled * 1e-9, options, draws))
            channels[-1]["signal"] = signal
    _add_further(node, tables, draws, options)
    channel = np.array(channels)
    for name, step in options.lsb.items():
        channel[signal_channel(name)]["lsb"] = step
    faults = [_fault(fault, node, tables) for fault in options.faults]
    return SensorTables(
        channel,
        node,
        schedule.table(sensor_kernel.FAULTS, faults, "sensors: at most {} faults"),
        np.zeros((sensor_kernel.FAULTS, sensor_kernel.HISTORY)),
        mounting(vehicle.sensors.imu_misalignment).ravel(),
        np.array(vehicle.sensors.imu_position),
        np.zeros(N_MOTION),
        np.array([vehicle.steering.ratio]),
    )
