"""The kinds of roll actuators by name: numbers, commands and limits on a vehicle.

All else reads a kind from :data:`ACTUATORS`; only the kernel of a kind
(:mod:`canroll.plant_sim.nodes.actuator_models`) and the firmware's allocation branch on its number.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from math import inf
from typing import ClassVar, NamedTuple

from canroll.vehicles.axles import axles
from canroll.vehicles.model import Vehicle

MILLI = 1e3
LEAST_SHARE = 1e-3
"""Share of the moment below which an axle does not limit it."""
DAMPER_TIME = 0.01
"""Time in which dampers may go to their largest command (s)."""


class Command(NamedTuple):
    """A message that an actuator accepts: its name, first signal, channels from this on."""

    message: str
    first: str
    channels: int


class ActuatorChannel(NamedTuple):
    """One channel of an actuator: lag (s), limit, its rate (1/s) and power (W); inf: unlimited."""

    lag: float
    limit: float
    rate: float
    power: float = inf


Range = Callable[[str, str], float]
"""Range of a message's signal on the bus, in N, N·m or mA."""


class Actuator(ABC):
    """A kind of roll actuators.

    Attributes:
        number: in calibrations and kernels.
        commands: what it accepts, its usual command first.
        takes_moments: whether its commands are forces or moments, which it delivers after its lag.
        hydraulic: whether the temperature of oil matters.
        uses_travel: whether it acts by the travel of the suspension.
        needs_suspension_rate: whether a command to it takes the suspension's measured rates.
    """

    number: ClassVar[int]
    commands: ClassVar[tuple[Command, ...]]
    takes_moments: ClassVar[bool] = True
    hydraulic: ClassVar[bool] = True
    uses_travel: ClassVar[bool] = True
    needs_suspension_rate: ClassVar[bool] = False

    @abstractmethod
    def channel(self, vehicle: Vehicle) -> ActuatorChannel:
        """Limits of one channel, as the plant has them."""

    def lag(self, vehicle: Vehicle) -> float:
        """Time constant that a design takes for it, s."""
        return self.channel(vehicle).lag

    def current_limit(self, vehicle: Vehicle) -> float:
        """Largest current of its currents, A."""
        return vehicle.actuators.dampers.current_limit

    def arms(self, vehicle: Vehicle) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """What turns commands by channel into roll moments, of front and rear axle."""
        return (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)

    def most(self, vehicle: Vehicle) -> tuple[float, float]:
        """Largest moments by axle, N·m."""
        torque = vehicle.actuators.bars.torque_limit
        return torque, torque

    @abstractmethod
    def command_limit(self, vehicle: Vehicle, share: float, ranges: Range) -> float:
        """Largest command with this ``share`` of the front axle: N·m, or mA of an axle's valve."""

    @abstractmethod
    def command_rate(self, vehicle: Vehicle, share: float, ranges: Range, tick: float) -> float:
        """Largest rate of the command at this ``tick`` (s): N·m/s, or mA/s."""

    def moment_limit(self, vehicle: Vehicle, share: float, ranges: Range) -> float:
        """Largest moment with this ``share`` of the front axle, N·m."""
        return self.command_limit(vehicle, share, ranges)


def _shares(share: float) -> tuple[float, float]:
    return max(share, LEAST_SHARE), max(1.0 - share, LEAST_SHARE)


def _of_forces(vehicle: Vehicle, share: float, force: float) -> float:
    """Moment (N·m) that corner forces up to ``force`` (N) give at this split."""
    parts = zip(axles(vehicle), _shares(share), strict=True)
    return min(2.0 * axle.half_track * force / part for axle, part in parts)


class SuspensionActuator(Actuator):
    """Four-corner active suspension."""

    number = 0
    commands: ClassVar[tuple[Command, ...]] = (
        Command("SuspensionForceCommand", "ForceFrontLeft", 4),
    )

    def channel(self, vehicle: Vehicle) -> ActuatorChannel:
        """Of one corner, N."""
        data = vehicle.actuators.suspension
        return ActuatorChannel(data.lag, data.force_limit, data.force_rate_limit, data.power_limit)

    def arms(self, vehicle: Vehicle) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Half tracks."""
        front, rear = (axle.half_track for axle in axles(vehicle))
        return (front, -front, 0.0, 0.0), (0.0, 0.0, rear, -rear)

    def most(self, vehicle: Vehicle) -> tuple[float, float]:
        """By both forces of an axle."""
        force = vehicle.actuators.suspension.force_limit
        front, rear = (2.0 * axle.half_track * force for axle in axles(vehicle))
        return front, rear

    def command_limit(self, vehicle: Vehicle, share: float, ranges: Range) -> float:
        """By the force of a corner."""
        largest = ranges("SuspensionForceCommand", "ForceFrontLeft")
        return _of_forces(vehicle, share, min(vehicle.actuators.suspension.force_limit, largest))

    def command_rate(self, vehicle: Vehicle, share: float, ranges: Range, tick: float) -> float:
        """By the rate of a corner's force."""
        parts = zip(axles(vehicle), _shares(share), strict=True)
        arm = min(axle.half_track / part for axle, part in parts)
        return 2.0 * arm * vehicle.actuators.suspension.force_rate_limit


class Bars(Actuator):
    """Active anti-roll bars."""

    number = 1
    commands: ClassVar[tuple[Command, ...]] = (Command("AntiRollBarCommand", "TorqueFront", 2),)
    uses_travel = False

    def channel(self, vehicle: Vehicle) -> ActuatorChannel:
        """Of one bar, N·m."""
        data = vehicle.actuators.bars
        return ActuatorChannel(data.lag, data.torque_limit, data.torque_rate_limit)

    def command_limit(self, vehicle: Vehicle, share: float, ranges: Range) -> float:
        """By the bar that has the larger share."""
        largest = ranges("AntiRollBarCommand", "TorqueFront")
        return min(vehicle.actuators.bars.torque_limit, largest) / max(share, 1.0 - share)

    def command_rate(self, vehicle: Vehicle, share: float, ranges: Range, tick: float) -> float:
        """By the rate of that bar."""
        return vehicle.actuators.bars.torque_rate_limit / max(share, 1.0 - share)


class Dampers(SuspensionActuator):
    """Semi-active dampers: forces become settings by the rule of a semi-active device, at 1 ms."""

    number = 2
    commands = (Command("DamperCommand", "CurrentFrontLeft", 4), *SuspensionActuator.commands)
    takes_moments = False
    hydraulic = False
    needs_suspension_rate = True

    def channel(self, vehicle: Vehicle) -> ActuatorChannel:
        """Of one damper's setting, from 0 to 1."""
        return ActuatorChannel(vehicle.actuators.dampers.lag, 1.0, inf)

    def arms(self, vehicle: Vehicle) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """None: dampers push no body."""
        return (0.0,) * 4, (0.0,) * 4

    def most(self, vehicle: Vehicle) -> tuple[float, float]:
        """Unlimited."""
        return inf, inf

    def command_rate(self, vehicle: Vehicle, share: float, ranges: Range, tick: float) -> float:
        """To the largest command in :data:`DAMPER_TIME`."""
        return self.command_limit(vehicle, share, ranges) / DAMPER_TIME


class Valves(Bars):
    """Electro-hydraulic bars: a loop at 1 ms controls their moments, by which they are judged."""

    number = 3
    commands = (Command("ValveCommand", "CurrentFront", 2), *Bars.commands)
    takes_moments = False
    uses_travel = True

    def channel(self, vehicle: Vehicle) -> ActuatorChannel:
        """Without lag and limits but those of its hydraulics."""
        return ActuatorChannel(0.0, inf, inf)

    def lag(self, vehicle: Vehicle) -> float:
        """That of the active bars."""
        return vehicle.actuators.bars.lag

    def current_limit(self, vehicle: Vehicle) -> float:
        """Largest current of a valve, A."""
        return vehicle.actuators.valves.current_limit

    def command_limit(self, vehicle: Vehicle, share: float, ranges: Range) -> float:
        """Of an axle's current, mA."""
        return min(MILLI * self.current_limit(vehicle), ranges("ValveCommand", "CurrentFront"))

    def command_rate(self, vehicle: Vehicle, share: float, ranges: Range, tick: float) -> float:
        """From limit to limit in a tick, mA/s."""
        return 2.0 * self.command_limit(vehicle, share, ranges) / tick

    def moment_limit(self, vehicle: Vehicle, share: float, ranges: Range) -> float:
        """That of active bars, N·m."""
        return super().command_limit(vehicle, share, ranges)


ACTUATORS: dict[str, Actuator] = {
    "suspension": SuspensionActuator(),
    "bars": Bars(),
    "dampers": Dampers(),
    "valves": Valves(),
}
"""Kinds of roll actuators by name."""
