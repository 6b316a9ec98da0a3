"""Faults of nodes, of the bus and of its frames, and attackers, as the parts of a world."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.plant_sim import can_bus
from canroll.plant_sim.can_bus.kernel import layout
from canroll.plant_sim.can_bus.wire.frame import INTERFRAME_BITS
from canroll.plant_sim.faults import Fault, kinds
from canroll.plant_sim.faults.effects import power_losses
from canroll.plant_sim.kernels import schedule
from canroll.plant_sim.kernels.instants import NEVER
from canroll.plant_sim.nodes import codec_tables
from canroll.plant_sim.nodes.codec import Codec
from canroll.plant_sim.nodes.sensor_kernel import SensorTables
from canroll.plant_sim.nodes.sensors import PER_UNIT
from canroll.plant_sim.world import frame_kernel

FLOOD_IDENT, FLOOD_LENGTH = 0x000, 8
FLOOD_BITS = 44 + 8 * FLOOD_LENGTH + 13 + INTERFRAME_BITS
"""Length on the wire of a frame of a flood, stuff bits of its random payload not counted."""


def outages(faults: Iterable[Fault]) -> tuple[tuple[int, int], ...]:
    """Return when the ECU has no power, ns, in order of the beginnings."""
    return tuple(
        sorted(
            (_ns(fault.start), _ns(fault.end))
            for fault in power_losses(faults)
            if fault.where == kinds.NODE_PREFIX + kinds.ECU_NODE
        )
    )


def starts(faults: Iterable[Fault]) -> tuple[int, ...]:
    """Return when the actuator node restarts, ns."""
    return tuple(
        _ns(fault.end)
        for fault in power_losses(faults)
        if fault.where == kinds.NODE_PREFIX + kinds.ACTUATOR_NODE
    )


def add_to_network(network: can_bus.Network, faults: Iterable[Fault]) -> None:
    """Add the faults of nodes and of the bus itself to a network at time 0.

    Raises:
        CanrollError: a partition of a bus without gateways.
    """
    faults = tuple(faults)
    for fault in faults:
        at = kinds.PLACES[fault.where]
        if at == kinds.BUS and fault.kind == "partition":
            count = int(network.clock[layout.GATEWAY_COUNT])
            if not count:
                raise CanrollError(f"fault '{fault}': this bus has no gateway that could fail")
            for number in range(count):
                _add(network, "gateway_down", number, fault)
        elif at == kinds.BUS and fault.kind == "error_rate":
            _add(network, "bit_errors", None, fault, rate=fault.value)
        elif at == kinds.BUS and fault.kind == "flood":
            for segment in range(len(network.segments)):
                flooder = can_bus.add_node(network, can_bus.Node("Flood", segment))
                _flood(network, flooder, fault)
        elif at == kinds.NODE:
            _add_of_node(network, fault)
    for fault in power_losses(faults):
        _add(network, "node_down", _node(fault), fault)


def _node(fault: Fault) -> int:
    return can_bus.NODES.index(fault.where.removeprefix(kinds.NODE_PREFIX))


def _add_of_node(network: can_bus.Network, fault: Fault) -> None:
    if fault.kind == "silent":
        _add(network, "node_mute", _node(fault), fault)
    elif fault.kind == "bus_off":
        _add(network, "disturb", _node(fault), fault)
    elif fault.kind == "babbling":
        _flood(network, _node(fault), fault)


def _add(
    network: can_bus.Network, kind: str, target: int | None, fault: Fault, *, rate: float = 0.0
) -> None:
    can_bus.add_fault(
        network, can_bus.BusFault(kind, target, _ns(fault.start), _ns(fault.end), rate=rate)
    )


def _flood(network: can_bus.Network, node: int, fault: Fault) -> None:
    """Make ``node`` fill the share ``fault.value`` of its segment with the highest priority."""
    segment = network.segments[int(network.nodes["segment"][node])]
    period = FLOOD_BITS * 1e9 / int(segment["bitrate"]) / fault.value
    can_bus.add_source(
        network,
        can_bus.Source(
            node="",
            ident=FLOOD_IDENT,
            length=FLOOD_LENGTH,
            period_ns=period,
            offset_ns=_ns(fault.start),
            until_ns=_ns(fault.end),
        ),
        node,
    )


def _ns(time: float) -> int:
    return round(time * 1e9) if np.isfinite(time) else NEVER


def frames(
    faults: Iterable[Fault], tables: Codec, nodes: SensorTables, network: can_bus.Network
) -> Any:  # noqa: ANN401
    """Return the FRAME_STATE of our frames, with an attacker on the bus where one is needed.

    Raises:
        CanrollError: too many, or of a message or signal that this bus does not have.
    """
    chosen = [
        fault
        for fault in faults
        if fault.kind in frame_kernel.FRAME_FAULTS
        and kinds.PLACES[fault.where] in (kinds.MESSAGE, kinds.BUS, kinds.ATTACKER)
    ]
    rows: list[tuple[float, ...]] = []
    state = np.zeros(1, frame_kernel.FRAME_STATE)[0]
    state["signal"] = state["attacker_at_ecu"] = state["attacker_at_actuator"] = -1
    for fault in chosen:
        places, signals = _target(fault, tables, nodes)
        state["signal"][len(rows) : len(rows) + 1] = signals
        value = fault.value
        if kinds.PLACES[fault.where] == kinds.ATTACKER:
            message, _, signal = fault.where.removeprefix(kinds.ATTACKER_PREFIX).partition(".")
            if signal:
                value *= PER_UNIT[codec_tables.unit(message, signal)]
            add_attackers(state, network)
        kind = frame_kernel.FRAME_FAULTS.index(fault.kind)
        rows.append(schedule.row(places, kind, fault, f"fault '{fault}'", value))
    state["fault"] = schedule.table(frame_kernel.FAULTS, rows, "bus: at most {} faults of frames")
    return state


def _target(fault: Fault, tables: Codec, nodes: SensorTables) -> tuple[int, NDArray[np.int64]]:
    """Return the messages of a fault of frames, and the rows of its signal and sample counter."""
    places = np.full(2, -1, dtype=np.int64)
    if fault.where == kinds.BUS:
        return frame_kernel.EVERY_MESSAGE, places
    message, _, signal = fault.where.removeprefix(kinds.ATTACKER_PREFIX).partition(".")
    row = codec_tables.message_index(message)
    if not tables.message[row]["length"]:
        raise CanrollError(f"fault '{fault}': {message} is not on this bus")
    if signal:
        places[0] = codec_tables.signal_index(message, signal)
        if not tables.field[places[0]]["pieces"]:
            raise CanrollError(f"fault '{fault}': the map has no such signal")
        row = int(tables.field[places[0]]["frame"])
    sampled = nodes.node[nodes.node["message"] == row]
    if len(sampled):
        counter = int(sampled[0]["sample_signal"])
        here = tables.field[counter]["pieces"] and tables.field[counter]["frame"] == row
        places[1] = counter if here else -1
    if fault.kind == "wrong_length" and fault.value > tables.message[row]["length"]:
        length = int(tables.message[row]["length"])
        raise CanrollError(f"fault '{fault}': {message} has {length} bytes: give fewer")
    return 1 << row, places


def add_attackers(frames: Any, network: can_bus.Network) -> None:  # noqa: ANN401
    """Put an attacker on the ECU's segment and one on the actuators', once."""
    if frames["attacker_at_ecu"] >= 0:
        return
    segments: Sequence[int] = network.nodes["segment"].tolist()
    for name, node in (
        ("attacker_at_ecu", can_bus.ECU),
        ("attacker_at_actuator", can_bus.ACTUATOR),
    ):
        attacker = can_bus.Node("Attacker", segments[node], policy="fifo")
        frames[name] = can_bus.add_node(network, attacker)
