"""Faults of the language as those of the nodes and the bus that they are simulated by."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from canroll.plant_sim.faults import kinds
from canroll.plant_sim.faults.language import Fault
from canroll.plant_sim.nodes.actuators import ActuatorOptions
from canroll.plant_sim.nodes.sensors import FAULTS as SENSOR_KINDS
from canroll.plant_sim.nodes.sensors import SENDERS, SensorOptions


def power_losses(faults: Iterable[Fault]) -> Iterator[Fault]:
    """Yield the times at which a node has no power, as faults of kind "down"."""
    for fault in faults:
        if kinds.PLACES[fault.where] != kinds.NODE:
            continue
        if fault.kind == "down":
            yield fault
        elif fault.kind == "reset":
            yield replace(fault, kind="down", end=fault.start + fault.value, value=0.0)
        elif fault.kind == "late":
            yield replace(fault, kind="down", end=fault.value, value=0.0)


def _of_nodes(faults: Iterable[Fault]) -> Iterator[Fault]:
    """Yield the faults of nodes as those of each message that they send."""
    faults = tuple(faults)
    drifting = (f for f in faults if f.kind == "clock_drift")
    for fault in (*power_losses(faults), *drifting):
        node = fault.where.removeprefix(kinds.NODE_PREFIX)
        for message, sender in SENDERS.items():
            if sender == node:
                yield replace(fault, where=message)


def sensor_faults(faults: Iterable[Fault]) -> Iterator[Fault]:
    """Yield the faults of the sensors, of their messages and of their nodes."""
    faults = tuple(faults)
    for fault in (*faults, *_of_nodes(faults)):
        if fault.kind in SENSOR_KINDS and kinds.PLACES[fault.where] in (
            kinds.SIGNAL,
            kinds.MESSAGE,
        ):
            if fault.kind == "delay" and kinds.PLACES[fault.where] == kinds.MESSAGE:
                continue
            yield fault


def actuator_faults(faults: Iterable[Fault]) -> Iterator[Fault]:
    """Yield the faults of the actuators; without power they float."""
    faults = tuple(faults)
    without_power = (
        replace(fault, where="actuators", kind="floating")
        for fault in power_losses(faults)
        if fault.where == kinds.NODE_PREFIX + kinds.ACTUATOR_NODE
    )
    for fault in (*faults, *without_power):
        if kinds.PLACES[fault.where] == kinds.ACTUATOR:
            yield fault


def with_faults(
    sensors: SensorOptions, actuators: ActuatorOptions, faults: tuple[Fault, ...]
) -> tuple[SensorOptions, ActuatorOptions]:
    """Return the options of the nodes with ``faults`` added."""
    return (
        replace(sensors, faults=(*sensors.faults, *sensor_faults(faults))),
        replace(actuators, faults=(*actuators.faults, *actuator_faults(faults))),
    )
