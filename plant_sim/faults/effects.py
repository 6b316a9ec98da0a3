"""Faults of the language as those of the nodes and the bus that they are simulated by."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from plant_sim.faults import kinds
from plant_sim.faults.language import Fault
from plant_sim.nodes.actuators import ActuatorFault, ActuatorOptions
from plant_sim.nodes.sensors import SensorFault, SensorOptions


def sensor_faults(faults: Iterable[Fault]) -> Iterator[SensorFault]:
    """Yield the faults of the sensors and of their messages."""
    for fault in faults:
        at = kinds.PLACES[fault.where]
        if at == kinds.SIGNAL or (at == kinds.MESSAGE and fault.where in kinds.SENSOR_MESSAGES):
            yield SensorFault(
                signal=fault.where,
                kind=fault.kind,
                value=fault.value,
                start=fault.start,
                end=fault.end,
                ramp=fault.ramp,
                every=fault.every,
                lasting=fault.lasting,
            )


def actuator_faults(faults: Iterable[Fault]) -> Iterator[ActuatorFault]:
    """Yield the faults of the actuators."""
    for fault in faults:
        if kinds.PLACES[fault.where] == kinds.ACTUATOR:
            yield ActuatorFault(
                corner=fault.where,
                kind=fault.kind,
                value=fault.value,
                start=fault.start,
                end=fault.end,
                ramp=fault.ramp,
                every=fault.every,
                lasting=fault.lasting,
            )


def with_faults(
    sensors: SensorOptions, actuators: ActuatorOptions, faults: tuple[Fault, ...]
) -> tuple[SensorOptions, ActuatorOptions]:
    """Return the options of the nodes with ``faults`` on top of their own."""
    return (
        replace(sensors, faults=(*sensors.faults, *sensor_faults(faults))),
        replace(actuators, faults=(*actuators.faults, *actuator_faults(faults))),
    )
