"""Phase of the ECU's ticks: time from the reception of an Imu frame to the start of a tick.

An ECU with a free-running clock can have any phase; one locked to the sensor keeps the phase it is
set to. The phase decides the age of a sample when used, between zero and one cycle of the sensor.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from canroll import dbc
from canroll.errors import CanrollError
from canroll.plant_sim.can_bus import ECU
from canroll.plant_sim.world.received import received_blocks, received_on, segment_of_ecu
from canroll.plant_sim.world.spool import Table, blocks
from canroll.plant_sim.world.world import World

IMU = int(dbc.message("Imu").frame_id)
IMU_PERIOD_NS = round(1e9 * dbc.period("Imu"))
LISTEN_NS = 500_000_000
"""Time in which the earliest arrival of an Imu frame is looked for."""
REGULAR_NS = 3_000_000
"""Imu frames that come more irregularly than this have no phase that a tick could keep."""


@dataclass(frozen=True, slots=True)
class Phase:
    """Least, mean and longest time from an Imu frame's reception to the next tick, s."""

    least: float
    mean: float
    most: float


def cycle_ns(tick_ns: int) -> int:
    """Return the cycle within which ticks have a phase: the shorter of tick and sensor period.

    Raises:
        CanrollError: neither is a multiple of the other, so the phase drifts.
    """
    short, long = sorted((tick_ns, IMU_PERIOD_NS))
    if long % short:
        raise CanrollError(
            f"a tick of {tick_ns / 1e6:g} ms has no phase against Imu frames every "
            f"{IMU_PERIOD_NS / 1e6:g} ms: choose a tick of 1, 2, 5, 10 or 20 ms, or no phase"
        )
    return short


def checked_cycle_ns(tick_ns: int, phase_ns: int) -> int:
    """Return the cycle within which ticks have the phase ``phase_ns``.

    Raises:
        CanrollError: no phase is possible with this tick, or not this one.
    """
    cycle = cycle_ns(tick_ns)
    if not 0 <= phase_ns < cycle:
        raise CanrollError(
            f"the phase must be at least 0 and below {cycle / 1e6:g} ms, got {phase_ns / 1e6:g} ms"
        )
    return cycle


def offset_ns(world: World, tick_ns: int, phase_ns: int) -> int:
    """Return the instant of tick 0, in [0, tick), at which ticks have a phase.

    Args:
        world: world at time 0 with the run's vehicle, bus and seed; it is used up.
        tick_ns: period of the ticks.
        phase_ns: time from the earliest arrival of an Imu frame to a tick.

    Raises:
        CanrollError: no phase is possible with this tick, or not this one.
    """
    return (earliest_arrival_ns(world) + phase_ns) % checked_cycle_ns(tick_ns, phase_ns)


def phase_ns(world: World, tick_ns: int) -> int:
    """Return the phase of ticks at multiples of ``tick_ns``; the inverse of `offset_ns`."""
    return -earliest_arrival_ns(world) % cycle_ns(tick_ns)


def earliest_arrival_ns(world: World) -> int:
    """Return the earliest instant of the sensor's cycle at which an Imu frame reaches the ECU.

    Raises:
        CanrollError: none does, or arrivals are irregular.
    """
    segment = int(world.network.nodes["segment"][ECU])
    if world.imu_period_ns != IMU_PERIOD_NS:
        raise CanrollError(
            f"Imu frames come every {world.imu_period_ns / 1e6:g} ms on this bus: a phase is "
            f"chosen within the contract's {IMU_PERIOD_NS / 1e6:g} ms; omit --phase"
        )
    world.advance(LISTEN_NS)
    imu = received_on(world.frames, segment, world.imu_ident)
    if not len(imu):
        raise CanrollError("no Imu frame reaches the ECU: the phase of its ticks is undefined")
    responses = imu["t_received"] - imu["t_origin"]
    if np.ptp(responses) > REGULAR_NS:
        raise CanrollError(
            f"Imu frames take {1e-6 * np.min(responses):.1f} to {1e-6 * np.max(responses):.1f} ms "
            "on this bus: the phase of the ticks is undefined"
        )
    return (int(imu["t_origin"][0]) + int(np.min(responses))) % IMU_PERIOD_NS


def measured(ticks: NDArray[np.float64], frames: Table, imu: int = IMU) -> Phase | None:
    """Return the phase of a run's ticks; None if no tick had an Imu frame before it.

    Args:
        ticks: instants of the ticks, s.
        frames: the bus log.
        imu: identifier of the frames that carry the inertial measurement.
    """
    if not any(np.any(block["sender"] == ECU) for block in blocks(frames)):
        return None
    arrivals = [part["t_received"] for part in received_blocks(frames, segment_of_ecu(frames), imu)]
    received = np.sort(np.concatenate(arrivals)) * 1e-9
    newest = np.searchsorted(received, ticks + 1e-12, side="right") - 1
    heard = newest >= 0
    if not np.any(heard):
        return None
    since = ticks[heard] - received[newest[heard]]
    return Phase(float(since.min()), float(since.mean()), float(since.max()))
