"""Everything outside the ECU in one object: vehicle, driver, sensors, actuators and bus.

The ECU sees only frames: it queues frames at an instant and gets the frames received up to another.
One compiled kernel advances everything in between; time is an argument, never a clock.
"""

import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.dbc.keys import DEVELOPMENT_KEY
from canroll.errors import CanrollError
from canroll.plant_sim import can_bus
from canroll.plant_sim.bodies import body as body_named
from canroll.plant_sim.driving.maneuvers import Maneuver
from canroll.plant_sim.faults import Fault
from canroll.plant_sim.faults.effects import with_faults
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.kernels.jit import compiling, is_cached
from canroll.plant_sim.kernels.records import entry, type_of
from canroll.plant_sim.nodes.actuators import ActuatorOptions
from canroll.plant_sim.nodes.codec import MAX_PAYLOAD
from canroll.plant_sim.nodes.codec_tables import message_index
from canroll.plant_sim.nodes.sensors import SensorOptions
from canroll.plant_sim.world import fault_parts, recording, world_parts
from canroll.plant_sim.world.ecu_kernel import Connection, TickSpan, run
from canroll.plant_sim.world.recording import EVERYTHING, Kept
from canroll.plant_sim.world.spool import Columns, Rows
from canroll.plant_sim.world.world_kernel import (
    EXTENDED_KEY,
    FOR_ACTUATOR,
    FRAME,
    Parts,
    advance,
    second_half,
)
from canroll.vehicles.model import Vehicle

__all__ = ["FRAME", "World"]

# The most that the loop is asked for at a time: neither the log nor the inbox overflows in it.
CHUNK_NS = 200_000_000
STANDARD_IDENT = 0x7FF
CLASSIC_PAYLOAD = 8


def _compiled(parts: Parts) -> Any:  # noqa: ANN401
    """The entry of the kernel; on an empty cache two processes compile it."""
    if is_cached(advance):
        return entry(advance, (parts, 0))
    with compiling(second_half, (type_of(parts), type_of(0))):
        return entry(advance, (parts, 0))


class World:
    """One run of one vehicle through one manoeuvre, seen from its bus.

    Args:
        vehicle: the vehicle, from ``canroll.vehicles.load``.
        body: a name of ``canroll.plant_sim.bodies``; the linear full car includes the hydraulics of
            ``valves``.
        maneuver: the manoeuvre, from ``maneuvers.build``.
        actuator: ``suspension``, ``bars``, ``dampers`` or ``valves``.
        profile: the bus, from ``can_bus.load_profile``.
        seed: seed of everything random: sensor noise and bias, sampling phases, background traffic.
        enabled: False: the actuators accept and acknowledge commands but deliver nothing.
        command: message that commands the actuator if it accepts several.
        command_timeout_ms: age at which the actuators release a command.
        sensors: operating conditions of the sensors.
        actuators: operating conditions of the actuators.
        faults: what fails (:mod:`canroll.plant_sim.faults`), on top of those in the conditions.
        kept: what is kept of the run.
        key: of the authentication, on a bus whose frames are authenticated.
        starts: number of this start of the vehicle's nodes there.
        ecu_starts: last start of the ECU that they know of there.
        bus: further options of ``can_bus.make_network``.

    Attributes:
        outages: when the ECU has no power (ns): it restarts at the end of each.

    Raises:
        UnknownNameError: no such body, actuator, command, signal or fault.
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
        faults: Sequence[Fault] = (),
        kept: Kept = EVERYTHING,
        key: bytes = DEVELOPMENT_KEY,
        starts: int = 1,
        ecu_starts: int = 0,
        **bus: Any,  # noqa: ANN401
    ) -> None:
        hydraulic = body == "linear_car" and actuator == "valves"
        plant = body_named("linear_car_hydraulic" if hydraulic else body)
        faults = tuple(faults)
        sensors, actuators = with_faults(
            sensors or SensorOptions(), actuators or ActuatorOptions(), faults
        )
        self.outages = fault_parts.outages(faults)
        self.duration_ns = maneuver.duration_ns
        self._parts = world_parts.assemble(
            vehicle=vehicle,
            plant=plant,
            actuator=actuator,
            maneuver=maneuver,
            profile=profile,
            seed=seed,
            enabled=enabled,
            command=command,
            command_timeout_ms=command_timeout_ms,
            sensors=sensors,
            actuators=actuators,
            faults=faults,
            key=key,
            starts=starts,
            ecu_starts=ecu_starts,
            bus=bus,
        )
        self._recorded = can_bus.recorded_traffic(
            self._parts.network,
            profile,
            command=world_parts.command_of(actuator, command),
            seed=seed,
        )
        memory = self._parts.memory[0]
        self._clock = memory["clock"]
        # Single integers are read and written faster through buffers than through arrays.
        self._bus_clock = self._parts.network.clock.data
        self._outbox: NDArray[Any] = memory["outbox"]
        self._imu = memory["tables"]["message"][message_index("Imu")]
        self._fd = world_parts.fd_keys(memory["tables"]["message"])
        self._received: NDArray[Any] = memory["received"]
        self._outputs: NDArray[np.float64] = memory["outputs"]
        self._kernel = _compiled(self._parts)
        self._run: Any = None
        self._outside = plant.outside
        self._parameters: NDArray[np.float64] = memory["parameters"]
        if plant.outside is not None:
            weakref.finalize(self, plant.outside.close, self._parameters.copy())
        self._drained = 0
        self._kept = kept
        self._log = Rows(can_bus.log_dtype())
        self._signals = Columns(kept.signals)
        self._commands = Rows(recording.COMMAND)
        self._steps = 0

    @property
    def parts(self) -> Parts:
        """All data of the kernel."""
        return self._parts

    @property
    def room(self) -> int:
        """Number of frames that can still be submitted before the next ``advance``."""
        return len(self._outbox) - int(self._clock["outbox"])

    def submit(self, t_ns: int, ident: int, payload: bytes) -> None:
        """Queue a frame at the ECU at ``t_ns`` (ns), not before the last ``advance``'s end.

        The newest sample available to the frame is the last returned by ``advance``.
        """
        if t_ns < self.now_ns:
            raise CanrollError(
                f"frame 0x{ident:X} submitted at {t_ns} ns, in the past of the world"
            )
        self.check_frame(ident, len(payload))
        count = int(self._clock["outbox"])
        if not self.room:
            raise CanrollError(f"more than {len(self._outbox)} frames submitted in one tick")
        out = self._outbox[count]
        out["t_ns"], out["ident"], out["length"] = t_ns, ident, len(payload)
        out["payload"][: len(payload)] = np.frombuffer(payload, np.uint8)
        self._clock["outbox"] = count + 1

    def check_frame(self, ident: int, length: int) -> None:
        """Refuse a frame that the ECU cannot send on this bus."""
        if length > MAX_PAYLOAD:
            raise CanrollError(f"frame 0x{ident:X} of {length} bytes: at most {MAX_PAYLOAD}")
        if not (0 <= ident <= STANDARD_IDENT or ident & EXTENDED_KEY) or (
            length > CLASSIC_PAYLOAD and ident not in self._fd
        ):
            raise CanrollError(
                f"frame 0x{ident:X} of {length} bytes: the ECU sends classic frames with "
                "identifiers of 11 bits and at most 8 bytes, and those of its map"
            )

    def run_ticks(
        self,
        ecu: Connection,
        images: NDArray[np.uint8],
        *,
        before_ns: int,
        period_ns: int,
        run_time_ns: int,
    ) -> None:
        """Run a native ECU for at most as many ticks as ``images`` has rows, in compiled code.

        The time determines the number: at least one, unless the vehicle has rolled over.

        Args:
            ecu: initialised; every frame that it sends has passed :meth:`check_frame`.
            images: filled with its state record after each tick.
            before_ns: the ticks are at ``before_ns + k period_ns``, k from 1.
            period_ns: at most 200 ms.
            run_time_ns: time from a tick to its frames.
        """
        if self._recorded is not None:
            # fed again before every tick, as recorded frames are queued in order with all others
            images = images[:1]
            self._recorded.feed(before_ns + period_ns)
        stop = self._drained + world_parts.LOG_CAPACITY // 2
        ticks = TickSpan(before_ns, period_ns, run_time_ns, stop)
        arguments = (self._parts, ecu, ticks, images)
        if self._run is None:
            self._run = entry(run, arguments)
        self._run(*arguments)
        self._check()
        self._keep()

    def advance(self, until_ns: int) -> NDArray[Any]:
        """Advance to ``until_ns``; return the frames (``FRAME``) the ECU received since."""
        if until_ns < self.now_ns:
            raise CanrollError(f"the world is at {self.now_ns} ns and cannot go back to {until_ns}")
        chunks = []
        while until_ns - self.now_ns > CHUNK_NS:
            chunks.append(self._advance_to(self.now_ns + CHUNK_NS))
        last = self._advance_to(until_ns)
        return np.concatenate([*chunks, last]) if chunks else last

    @property
    def now_ns(self) -> int:
        """The instant that the world has been advanced to."""
        return int(self._bus_clock[can_bus.NOW])

    @property
    def finished(self) -> bool:
        """Whether the manoeuvre is over or the vehicle has rolled over."""
        return self.now_ns >= self.duration_ns or self.rolled_over

    @property
    def rolled_over(self) -> bool:
        """Whether the vehicle has rolled over, an end state."""
        return bool(self._outputs[recording.SIGNALS["rollover"]])

    @property
    def signals(self) -> Columns:
        """The signals that are kept, one value per millisecond."""
        self._take_record()
        return self._signals

    @property
    def frames(self) -> Rows:
        """The whole bus log so far (``can_bus.log_dtype``), in the order of reception, if kept."""
        self._drain()
        return self._log

    @property
    def commands(self) -> Rows:
        """Applied commands (``recording.COMMAND``), repeated heartbeats included."""
        self._take_record()
        return self._commands

    @property
    def ages(self) -> NDArray[np.int64]:
        """Age of the newest sample used for each applied command, when applied (ns)."""
        sampled, applied = self.commands["t_sample"], self.commands["t_applied"]
        return np.asarray((applied - sampled)[sampled >= 0], dtype=np.int64)

    @property
    def imu_ident(self) -> int:
        """Identifier of the frames that carry the inertial measurement."""
        return int(self._imu["ident"])

    @property
    def imu_period_ns(self) -> int:
        """Cycle time of these frames (ns)."""
        return int(self._imu["cycle_ns"])

    @property
    def refused(self) -> int:
        """Frames that the actuator node's authentication has refused."""
        return int(self._parts.memory[0]["authentication"]["flag"]["refused"])

    @property
    def starts(self) -> int:
        """Starts of the vehicle's nodes so far, by their authenticated frames."""
        return int(self._parts.memory[0]["authentication"]["sent"]["starts"].max())

    @property
    def ecu_starts(self) -> int:
        """Last start of the ECU that the actuator node knows of, by its authenticated frames."""
        memory = self._parts.memory[0]
        heard = memory["authentication"]["heard"]["starts"]
        return int(heard[memory["roles"] == FOR_ACTUATOR].max(initial=0))

    @property
    def forged(self) -> int:
        """Frames of attackers that the actuator node has accepted."""
        return int(self._clock["forged"])

    @property
    def network(self) -> can_bus.Network:
        """The bus, for its statistics (``can_bus.account``, ``can_bus.load``)."""
        return self._parts.network

    def _advance_to(self, until_ns: int) -> NDArray[Any]:
        if self._recorded is not None:
            self._recorded.feed(until_ns)
        count = self._kernel(self._parts, until_ns)
        self._check()
        self._keep()
        return self._received[:count].copy()

    def _check(self) -> None:
        """Raise what went wrong in a body that runs in another process."""
        if self._outside is not None:
            self._outside.check(self._parameters)

    def _keep(self) -> None:
        """Take log and record out of the kernel's memory before they are full."""
        if self._bus_clock[can_bus.LOGGED] - self._drained > world_parts.LOG_CAPACITY // 2:
            self._drain()
        if self._clock["rows"] >= world_parts.RECORD_CAPACITY - CHUNK_NS // STEP_NS:
            self._take_record()

    def _take_record(self) -> None:
        """Move what the kernel has recorded to the tables of the run."""
        steps, applied = self._clock["rows"], self._clock["applied_commands"]
        times = np.arange(self._steps + 1, self._steps + steps + 1) * (STEP_NS * 1e-9)
        self._signals.append(
            recording.signal_block(self._parts.rows[:steps], times, self._kept.signals)
        )
        commands = self._parts.commands
        self._commands.append(commands[:applied])
        # the next one may be accepted already, and waits for the step that applies it
        commands[0] = commands[applied]
        self._steps += steps
        self._clock["rows"] = self._clock["applied_commands"] = 0

    def _drain(self) -> None:
        if not self._kept.frames:
            self._drained = self._bus_clock[can_bus.LOGGED]
            return
        entries, self._drained, missed = can_bus.drain(self._parts.network, self._drained)
        assert missed == 0
        self._log.append(entries)
