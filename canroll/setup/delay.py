"""The delay from sample to force on a bus."""

from canroll.gain_gen.models.task import Delay
from canroll.plant_sim.can_bus import BusProfile
from canroll.plant_sim.can_bus.bounds.delay_bounds import delay_bounds
from canroll.plant_sim.nodes.sensors import SensorOptions, delay
from canroll.vehicles import Vehicle

RUN_TIME = 200e-6
"""From the start of a tick to its frames in the controller's queue, s: the loop takes 10 k to 20 k
instructions on a Cortex-M0, which is less at 100 MHz."""


def sample_to_force(
    vehicle: Vehicle, command: str, profile: BusProfile, *, tick: float = 0.010
) -> Delay:
    """Return the bounds of the delay on this bus, and their middle.

    It includes the low-pass of the roll-rate sensor and its latency, but not the hold of the
    command over the next tick, which is part of the sampled design model.

    Args:
        vehicle: vehicle with the sensors.
        command: message that commands the actuators.
        profile: the bus.
        tick: period of the loop, s.

    Raises:
        VerdictError: the bus is overloaded and has no bound.
    """
    bounds = delay_bounds(profile, tick_ms=1e3 * tick, command=command, run_time_s=RUN_TIME)
    sensor = delay(vehicle.sensors.roll_rate, options=SensorOptions())
    least, most = sensor + bounds.age_min, sensor + bounds.age_max
    return Delay((least + most) / 2, least, most)
