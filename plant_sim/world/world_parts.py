"""Assembly of a world: bodies, nodes and bus for one run."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim import can_bus
from canroll.plant_sim.bodies.ports import PARAMETERS_MAX, STATES_MAX, Body
from canroll.plant_sim.can_bus.network import own_frames
from canroll.plant_sim.can_bus.wire.frame import FD
from canroll.plant_sim.driving.maneuvers import Maneuver
from canroll.plant_sim.faults import Fault
from canroll.plant_sim.kernels.records import to_record
from canroll.plant_sim.nodes import actuators as actuator_setup
from canroll.plant_sim.nodes import authentication, codec, codec_tables, sensor_kernel
from canroll.plant_sim.nodes import sensors as sensor_setup
from canroll.plant_sim.nodes.actuators import ActuatorOptions
from canroll.plant_sim.nodes.codec import Codec
from canroll.plant_sim.nodes.sensors import SensorOptions
from canroll.plant_sim.world import fault_parts, open_loop, recording
from canroll.plant_sim.world import world_kernel as kernel
from canroll.plant_sim.world.step_size import check_step
from canroll.plant_sim.world.world_kernel import LoopMemory, Parts
from canroll.typing import Vector
from canroll.vehicles.actuators import ACTUATORS
from canroll.vehicles.model import Vehicle

LOG_CAPACITY = 1 << 15
RECORD_CAPACITY = 1000
"""Steps of 1 ms that the kernel can record before what it has recorded is taken away."""
_OUTBOX_CAPACITY = 256
_INBOX_CAPACITY = 8192
_FLIGHT_CAPACITY = 64


def command_of(actuator: str, command: str | None) -> str:
    """Return the message that commands an actuator, by default its first.

    Raises:
        UnknownNameError: no such actuator, or it does not accept such a message.
    """
    if actuator not in actuator_setup.COMMANDS:
        raise UnknownNameError("actuator", actuator, actuator_setup.COMMANDS)
    known = [name for name, _, _ in actuator_setup.COMMANDS[actuator]]
    if command is not None and command not in known:
        raise UnknownNameError(f"command of actuator '{actuator}'", command, known)
    return command or known[0]


def check_body(plant: Body, actuator: str) -> None:
    """Refuse a body that does not have what ``actuator`` needs of it.

    Raises:
        CanrollError: it does not.
    """
    if "travel" in plant.lacks and ACTUATORS[actuator].uses_travel:
        raise CanrollError(
            f"{plant.name}: {actuator} need the suspension's travel: map travel_front_left and the "
            "others, or choose --actuator bars"
        )


def _roles(actuator: str, tables: Codec) -> NDArray[np.uint8]:
    """Receivers of each message of the tables; further frames are those of sensors."""
    roles = np.full(len(tables.message), kernel.NOBODY, dtype=np.uint8)
    roles[-own_frames.FURTHER_FRAMES :] = kernel.FOR_ECU
    roles[[codec_tables.message_index(name) for name in sensor_setup.NODES]] = kernel.FOR_ECU
    roles[codec_tables.message_index("Imu")] = kernel.FOR_ECU_IMU
    commands = [
        codec_tables.message_index(name) for name, _, _ in actuator_setup.COMMANDS[actuator]
    ]
    roles[commands] = kernel.FOR_ACTUATOR
    return roles


def _tables(profile: can_bus.BusProfile, command: str, actuator: str) -> Codec:
    """The frames of the bus; those of a map must include every channel of the command."""
    bus = own_frames.bus_map(profile)
    if bus is None:
        return codec_tables.load()
    tables = codec_tables.of_map(bus, own_frames.frame_signals(profile))
    for name, first, channels in actuator_setup.COMMANDS[actuator]:
        row = codec_tables.signal_index(name, first)
        if name == command and not tables.field[row : row + channels]["pieces"].all():
            missing = codec_tables.signal_names(name)
            places = tables.field[row : row + channels]["pieces"]
            absent = missing[missing.index(first) + int(np.argmin(places))]
            raise CanrollError(f"{profile.map_file}: no signal is mapped to {absent} of {name}")
    return tables


def fd_keys(messages: NDArray[Any]) -> frozenset[int]:
    """The CAN FD frames of a codec's ``message`` table, by key."""
    fd = messages[messages["flags"] & FD != 0]
    return frozenset(int(key) for key in fd["key"])


def _sensors(  # noqa: PLR0917
    vehicle: Vehicle,
    options: SensorOptions,
    seed: int,
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    tables: Codec,
) -> sensor_kernel.SensorTables:
    """Sensor nodes on their bus nodes, with low-passes settled at the initial state."""
    nodes = sensor_setup.build(vehicle, options=options, seed=seed, tables=tables)
    for row in nodes.node:
        message = sensor_setup.NODES[row["sensor"]]
        row["bus_node"] = can_bus.NODES.index(sensor_setup.SENDERS[message])
    sensor_kernel.observe(nodes, inputs, outputs)
    nodes.channel["filtered"] = nodes.channel["previous"] = nodes.channel["input"]
    return nodes


def _clock(nodes: sensor_kernel.SensorTables, network: can_bus.Network, seed: int) -> Any:  # noqa: ANN401
    clock = np.zeros(1, kernel.CLOCK)[0]
    clock["imu_sample"] = kernel.NOTHING
    clock["imu_latency"] = nodes.node[sensor_setup.NODES.index("Imu")]["latency"]
    clock["ecu_segment"] = network.nodes["segment"][can_bus.ECU]
    clock["actuator_segment"] = network.nodes["segment"][can_bus.ACTUATOR]
    clock["seed"] = seed
    clock["state_node"] = sensor_setup.NODES.index("ActuatorState")
    return clock


def _in_room(values: NDArray[np.float64], room: int) -> NDArray[np.float64]:
    return np.concatenate((values, np.zeros(room - len(values))))


def assemble(
    *,
    vehicle: Vehicle,
    plant: Body,
    actuator: str,
    maneuver: Maneuver,
    profile: can_bus.BusProfile,
    seed: int,
    enabled: bool,
    command: str | None,
    command_timeout_ms: float,
    sensors: SensorOptions,
    actuators: ActuatorOptions,
    faults: Sequence[Fault],
    key: bytes,
    starts: int,
    ecu_starts: int,
    bus: dict[str, Any],
) -> Parts:
    """All data of the kernel at time 0; the parameters are those of ``World``."""
    chosen = command_of(actuator, command)
    check_body(plant, actuator)
    tables = _tables(profile, chosen, actuator)
    node = actuator_setup.build(
        vehicle,
        actuator,
        options=actuators,
        enabled=enabled,
        timeout_ms=command_timeout_ms,
        integrated=actuator == "valves" and plant.name == "linear_car_hydraulic",
        tables=tables,
    )
    network = can_bus.make_network(
        profile,
        seed=seed,
        command=chosen,
        log_capacity=LOG_CAPACITY,
        **bus,
    )
    fault_parts.add_to_network(network, faults)
    state, inputs, parameters, outputs = open_loop.start(vehicle, plant, maneuver)
    if plant.outside is None:

        def rebuild(key: str, factor: float) -> Vector:
            section, name = key.split(".")
            part = getattr(vehicle, section)
            other = replace(part, **{name: factor * getattr(part, name)})
            return open_loop.start(replace(vehicle, **{section: other}), plant, maneuver)[2]

        check_step(plant, state, inputs, parameters, rebuild)
    nodes = _sensors(vehicle, sensors, seed, inputs, outputs, tables)
    clock = _clock(nodes, network, seed)
    clock["step"] = plant.step.address
    clock["states"], clock["parameters"] = len(state), len(parameters)
    roles = _roles(actuator, tables)
    memory = LoopMemory(
        clock=clock,
        state=_in_room(state, STATES_MAX),
        inputs=inputs,
        parameters=_in_room(parameters, PARAMETERS_MAX),
        outputs=outputs,
        received=np.zeros(_INBOX_CAPACITY, dtype=kernel.FRAME),
        payload=np.zeros(codec.MAX_PAYLOAD, dtype=np.uint8),
        outbox=np.zeros(_OUTBOX_CAPACITY, dtype=kernel.FRAME),
        flight=np.full(_FLIGHT_CAPACITY, kernel.NOTHING, kernel.FLIGHT),
        roles=roles,
        frames=fault_parts.frames(faults, tables, nodes, network),
        sensors=nodes,
        actuators=node,
        authentication=authentication.build(
            len(tables.message),
            key=key if own_frames.secured(profile) else None,
            start_ns=fault_parts.starts(faults),
            starts=starts,
            heard_starts=np.where(roles == kernel.FOR_ACTUATOR, ecu_starts, starts - 1).tolist(),
        ),
        tables=tables,
    )
    return Parts(
        memory=to_record(memory),
        rows=np.zeros((RECORD_CAPACITY, recording.N_COLUMNS)),
        commands=np.zeros(RECORD_CAPACITY + 1, recording.COMMAND),
        drive=maneuver.drive,
        network=network,
    )
