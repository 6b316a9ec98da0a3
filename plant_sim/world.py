"""Everything outside the ECU in one object: vehicle, driver, sensors, actuators and bus.

The ECU sees frames only: it queues what it sends at an instant and gets what it receives up to
another. One compiled kernel advances everything in between; time is an argument, never a clock.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import int64, typeof
from numpy.typing import NDArray

from canroll.errors import CanrollError, UnknownNameError
from plant_sim import (
    actuator_setup,
    can_bus,
    codec,
    ports,
    recording,
    sensor_setup,
    sensors,
    simulate,
)
from plant_sim.actuator_setup import ActuatorOptions
from plant_sim.bodies import body as body_named
from plant_sim.bodies import initial_inputs
from plant_sim.maneuvers import Maneuver
from plant_sim.records import to_record
from plant_sim.sensor_setup import SensorOptions
from plant_sim.sensors import LATENCY
from plant_sim.world_kernel import (
    ACTUATOR_SEGMENT,
    APPLIED_COMMANDS,
    ECU_SEGMENT,
    FRAME,
    IMU_LATENCY,
    IMU_SAMPLE,
    N_CLOCK,
    N_FLIGHT,
    N_OUTBOX,
    NOTHING,
    OUTBOX,
    RECEIVED,
    ROWS,
    SEED,
    STATE_NODE,
    STEP_NS,
    Memory,
    Parts,
    advance,
)
from vehicles.model import Vehicle

__all__ = ["FRAME", "World"]

_SENDERS = {
    "Imu": can_bus.IMU,
    "VehicleMotion": can_bus.CHASSIS,
    "SuspensionRate": can_bus.SUSPENSION,
    "SuspensionTravel": can_bus.SUSPENSION,
    "RollReference": can_bus.REFERENCE,
    "ActuatorState": can_bus.ACTUATOR,
}
_OUTBOX_CAPACITY = 256
_LOG_CAPACITY = 1 << 15
# The most that the loop is asked for at a time: neither the log nor the inbox can overflow in it.
_CHUNK_NS = 200_000_000
_INBOX_CAPACITY = 8192


class World:
    """One run of one vehicle through one manoeuvre, seen from its bus.

    Parameters
    ----------
    vehicle, body, maneuver
        What drives where: ``vehicles.load``, a name of ``plant_sim.bodies``, ``maneuvers.build``.
    actuator
        ``suspension``, ``bars``, ``dampers`` or ``valves``.
    profile
        The bus: ``can_bus.load_profile``.
    seed
        Of all that is random: sensor noise and bias, sampling phases, background traffic.
    enabled
        False: the actuators take and acknowledge commands but deliver nothing.
    command
        Message that commands the actuator where it takes several.
    command_timeout_ms
        The actuators let go of a command that is older.
    sensors, actuators
        How sensors and actuators are run.
    bus
        Further options of ``can_bus.make_network``.

    Raises
    ------
    UnknownNameError
        For a body, actuator, command, signal or fault that does not exist.
    """

    def __init__(
        self,
        *,
        vehicle: Vehicle,
        body: str,
        actuator: str,
        maneuver: Maneuver,
        profile: can_bus.BusProfile,
        seed: int = 0,
        enabled: bool = True,
        command: str | None = None,
        command_timeout_ms: float = 160.0,
        sensors: SensorOptions | None = None,
        actuators: ActuatorOptions | None = None,
        **bus: Any,  # noqa: ANN401
    ) -> None:
        plant = body_named(body)
        self.duration_ns = maneuver.duration_ns
        self.now_ns = 0
        self._step = plant.step
        node = actuator_setup.build(
            vehicle,
            actuator,
            options=actuators or ActuatorOptions(),
            enabled=enabled,
            timeout_ms=command_timeout_ms,
            integrated=actuator == "valves" and body == "fullcar",
        )
        network = can_bus.make_network(
            profile,
            seed=seed,
            command=_command(actuator, command),
            log_capacity=_LOG_CAPACITY,
            **bus,
        )
        state, parameters = plant.build(vehicle, maneuver.speed)
        inputs = initial_inputs()
        outputs = np.zeros(ports.N_OUTPUTS)
        simulate.advance(plant.step, state, inputs, parameters, outputs, 0.0)
        sensing = sensor_setup.build(vehicle, options=sensors or SensorOptions(), seed=seed)
        _connect(sensing, inputs, outputs)
        clock = np.zeros(N_CLOCK, dtype=np.int64)
        clock[IMU_SAMPLE] = NOTHING
        clock[IMU_LATENCY] = sensing.node[0, LATENCY]
        clock[ECU_SEGMENT] = network.nodes["segment"][can_bus.ECU]
        clock[ACTUATOR_SEGMENT] = network.nodes["segment"][can_bus.ACTUATOR]
        clock[SEED] = seed
        clock[STATE_NODE] = sensor_setup.NODES.index("ActuatorState")
        steps = self.duration_ns // STEP_NS + 1
        memory = to_record(
            Memory(
                clock=clock,
                outbox=np.zeros((_OUTBOX_CAPACITY, N_OUTBOX), dtype=np.int64),
                flight=np.full((64, N_FLIGHT), NOTHING, dtype=np.int64),
                listens=np.array([_ident(name) for name in sensor_setup.NODES], dtype=np.int64),
                sensors=sensing,
                actuators=node,
                tables=codec.load(),
            )
        )
        self._clock: NDArray[np.int64] = memory["clock"][0]
        self._outbox: NDArray[np.int64] = memory["outbox"][0]
        self._parts = Parts(
            memory=memory,
            state=state,
            inputs=inputs,
            parameters=parameters,
            outputs=outputs,
            rows=np.zeros((steps, recording.N_COLUMNS)),
            commands=np.zeros((steps, recording.N_COMMAND), dtype=np.int64),
            received=np.zeros(_INBOX_CAPACITY, dtype=FRAME),
            payload=np.zeros(8, dtype=np.uint8),
            drive=maneuver.drive,
            network=network,
        )
        # Called by its entry point: to type the arguments anew costs more than a step of the plant.
        kernel: Any = advance
        self._advance = kernel.compile((typeof(self._step), typeof(self._parts), int64))
        self._drained = 0
        self._log: list[NDArray[Any]] = []

    def submit(self, t_ns: int, ident: int, payload: bytes) -> None:
        """Queue a frame at the ECU at ``t_ns`` (ns), not before the last ``advance``'s end.

        The sample that the frame can know of is the last that ``advance`` has returned.
        """
        if t_ns < self.now_ns:
            raise CanrollError(
                f"frame 0x{ident:X} submitted at {t_ns} ns, in the past of the world"
            )
        count = self._clock[OUTBOX]
        if count == _OUTBOX_CAPACITY:
            raise CanrollError(f"more than {_OUTBOX_CAPACITY} frames submitted in one tick")
        word = int.from_bytes(bytes(payload).ljust(8, b"\0"), "little", signed=True)
        self._outbox[count] = (t_ns, ident, len(payload), word)
        self._clock[OUTBOX] = count + 1

    def advance(self, until_ns: int) -> NDArray[Any]:
        """Let everything happen up to ``until_ns``; frames (``FRAME``) the ECU received since."""
        if until_ns < self.now_ns:
            raise CanrollError(f"the world is at {self.now_ns} ns and cannot go back to {until_ns}")
        self._reserve(until_ns)
        parts = self._parts
        chunks = []
        while True:
            target = min(until_ns, self.now_ns + _CHUNK_NS)
            self._advance(self._step, parts, target)
            self.now_ns = target
            self._drain()
            chunks.append(parts.received[: self._clock[RECEIVED]].copy())
            if target == until_ns:
                return chunks[0] if len(chunks) == 1 else np.concatenate(chunks)

    @property
    def finished(self) -> bool:
        """Whether the manoeuvre is over or the vehicle has rolled over."""
        return self.now_ns >= self.duration_ns or self.rolled_over

    @property
    def rolled_over(self) -> bool:
        """Whether the vehicle has rolled over, an end state."""
        return bool(self._parts.outputs[recording.SIGNALS["rollover"]])

    @property
    def signals(self) -> dict[str, NDArray[np.float64]]:
        """Signals by name (``recording.SIGNALS``), one value a millisecond, ``time`` in s."""
        count = int(self._clock[ROWS])
        times = np.arange(1, count + 1, dtype=np.float64) * (STEP_NS * 1e-9)
        return recording.signals(self._parts.rows[:count], times)

    @property
    def frames(self) -> NDArray[Any]:
        """The whole bus log so far (``can_bus.log_dtype``), in the order of reception."""
        self._drain(everything=True)
        if len(self._log) > 1:
            self._log = [np.concatenate(self._log)]
        return self._log[0]

    @property
    def commands(self) -> NDArray[Any]:
        """Applied commands (``recording.COMMAND``), repeated heartbeats included."""
        count = int(self._clock[APPLIED_COMMANDS])
        rows = np.ascontiguousarray(self._parts.commands[:count])
        return rows.view(recording.COMMAND)[:, 0]

    @property
    def ages(self) -> NDArray[np.int64]:
        """Age of the newest sample behind each applied command when it is applied (ns)."""
        commands = self.commands
        known = commands[commands["t_sample"] >= 0]
        return np.asarray(known["t_applied"] - known["t_sample"], dtype=np.int64)

    @property
    def network(self) -> can_bus.Network:
        """The bus, for its accounts (``can_bus.account``, ``can_bus.load``)."""
        return self._parts.network

    def _reserve(self, until_ns: int) -> None:
        need = until_ns // STEP_NS + 2
        if need <= len(self._parts.rows):
            return
        rows = np.zeros((2 * need, recording.N_COLUMNS))
        commands = np.zeros((2 * need, recording.N_COMMAND), dtype=np.int64)
        rows[: len(self._parts.rows)] = self._parts.rows
        commands[: len(self._parts.commands)] = self._parts.commands
        self._parts = self._parts._replace(rows=rows, commands=commands)

    def _drain(self, *, everything: bool = False) -> None:
        logged = int(self._parts.network.clock[can_bus.LOGGED])
        if everything or logged - self._drained > _LOG_CAPACITY // 2:
            entries, self._drained, missed = can_bus.drain(self._parts.network, self._drained)
            assert missed == 0
            self._log.append(entries)


def _ident(message: str) -> int:
    return int(codec.load().message[codec.message_index(message), codec.IDENT])


def _command(actuator: str, command: str | None) -> str:
    known: Sequence[str] = [name for name, _, _ in actuator_setup.COMMANDS[actuator]]
    if command is not None and command not in known:
        raise UnknownNameError(f"command of actuator '{actuator}'", command, known)
    return command or known[0]


def _connect(
    sensing: sensors.Sensors, inputs: NDArray[np.float64], outputs: NDArray[np.float64]
) -> None:
    """Put each sensor node on its bus node, its low-passes settled on the state at rest."""
    for row, message in zip(sensing.node, sensor_setup.NODES, strict=True):
        row[sensors.BUS_NODE] = _SENDERS[message]
    sensors.observe(sensing, inputs, outputs)
    for column in (sensors.FILTERED, sensors.PREVIOUS):
        sensing.channel[:, column] = sensing.channel[:, sensors.INPUT]
