"""A network of the bus simulation as an FMU: its kernels in C, its arrays as start values."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from canroll.errors import CanrollError
from canroll.extensions.exchange.fmu import archive
from canroll.extensions.exchange.fmu.variables import (
    FLOAT64,
    INT64,
    LOCAL,
    OUTPUT,
    PARAMETER,
    Interface,
    Terminal,
    Variable,
)
from canroll.extensions.exchange.kernels import image
from canroll.extensions.exchange.kernels.kinds import INT, ArrayKind, RecordKind
from canroll.extensions.exchange.kernels.translate import Translator
from canroll.plant_sim.can_bus import OUTCOMES, Network
from canroll.plant_sim.can_bus.kernel import layout, queues, scheduler

IDENTIFIER = "canroll_bus"
BUFFER = 16384
"""Room for the operations of one terminal in a step, bytes."""
LOG = 1024
"""Entries of the log, which is read after every event."""
MOST_PORTS = 64
_UNUSED = 1
_TOTALS = len(OUTCOMES) + 1
MODEL = """\
typedef struct {{
    int64_t cursor;
    bus_state bus;
}} model;

/* The node behind each terminal. */
static const int64_t bus_ports[FMU_PORTS] = {{ {nodes} }};

void model_image(void *record);
"""


def write(path: Path, network: Network, ports: Mapping[str, int], *, title: str) -> None:
    """Write a network to ``path``.

    Args:
        path: the FMU, replaced if it exists.
        network: at time 0, with nothing queued yet.
        ports: number of the node behind each terminal.
        title: description of the bus, a line.

    Raises:
        CanrollError: no compiler, an unwritable file, or more terminals than there may be.
    """
    if not 1 <= len(ports) <= MOST_PORTS:
        raise CanrollError(f"a bus has 1 to {MOST_PORTS} terminals, got {len(ports)}")
    dtype = _fitted(network)
    translator = Translator("bus_")
    translator.structs.name(dtype, "state")
    state = RecordKind(dtype)
    payload = ArrayKind(np.dtype(np.uint8), (layout.MAX_PAYLOAD,))
    prototypes = [
        translator.entry(
            queues.submit, (state, INT, INT, INT, INT, payload, INT, INT, INT), "bus_submit"
        ),
        translator.entry(scheduler.step, (state, INT), "bus_step"),
        translator.entry(scheduler.next_end_ns, (state,), "bus_next_end_ns"),
        translator.entry(scheduler.let_pass, (state, INT), "bus_let_pass"),
    ]
    start = image.copied(network.state[0], dtype)
    start["clock"][0, layout.LOG_SIZE] = LOG
    sources = {
        **archive.shell("ls_bus.h", "bus_model.c"),
        "kernels.h": translator.header(prototypes),
        "kernels.c": translator.text(),
        "image.c": image.source("model_image", start.tobytes()),
        "model.h": archive.model(
            "bus",
            "kernels.h",
            {"FMU_PORTS": len(ports), "FMU_BUFFER": BUFFER, "BUS_LOG": LOG},
            MODEL.format(nodes=", ".join(map(str, ports.values()))),
        ),
    }
    interface = Interface(
        identifier=IDENTIFIER,
        description=title,
        variables=[*_parameters(network), *_shown(network, ports)],
        terminals=[Terminal(name=name, description=f"node {name}") for name in ports],
        bus=True,
    )
    archive.write(path, interface, sources)


def _fitted(network: Network) -> np.dtype[np.void]:
    """The record of a network without room that it does not use, as C lays it out."""
    segments = len(network.segments)
    used = {
        "totals": segments,
        "segments": segments,
        "pending_keys": segments,
        "pending_ties": segments,
        "pending": segments,
        "sources": max(int(network.clock[layout.SOURCE_COUNT]), _UNUSED),
        "source_payloads": max(int(network.clock[layout.SOURCE_COUNT]), _UNUSED),
        "gateways": max(int(network.clock[layout.GATEWAY_COUNT]), _UNUSED),
        "routes": max(int(network.clock[layout.GATEWAY_COUNT]), _UNUSED),
        "faults": max(int(network.clock[layout.FAULT_COUNT]), _UNUSED),
        "samples": max(int(network.clock[layout.SAMPLES]), _UNUSED),
        "log": LOG,
    }
    dtype = network.state.dtype
    columns = []
    for name in dtype.names or ():
        column = dtype[name]
        shape = (used.get(name, column.shape[0]), *column.shape[1:])
        columns.append((name, image.aligned(column.base), shape))
    return np.dtype(columns, align=True)


def _parameters(network: Network) -> list[Variable]:
    def fixed(name: str, kind: str, member: str, start: float, meaning: str) -> Variable:
        return Variable(name, kind, PARAMETER, f"bus.{member}", meaning, start=(start,))

    parameters = []
    for number, segment in enumerate(network.segments):
        prefix = f"segment[{number + 1}]." if len(network.segments) > 1 else ""
        for name, unit, kind in (
            ("bitrate", ", bit/s", INT64),
            ("data_bitrate", ", bit/s", INT64),
            ("propagation_ns", ", ns", INT64),
            ("bit_error_rate", "", FLOAT64),
        ):
            member, start = f"segments[{number}].{name}", segment[name].item()
            meaning = f"of segment {number + 1}{unit}"
            parameters.append(fixed(f"{prefix}{name}", kind, member, start, meaning))
    member, start = f"clock[{layout.SEED}]", int(network.clock[layout.SEED])
    meaning = "of bit errors, latencies and random payloads"
    return [*parameters, fixed("seed", INT64, member, start, meaning)]


def _shown(network: Network, ports: Mapping[str, int]) -> list[Variable]:
    logged, busy = f"bus.clock[{layout.LOGGED}]", "bus.segments[0].busy_ns"
    while_busy = "time for which the first segment was not idle, ns"
    outputs = [
        Variable("logged", INT64, OUTPUT, logged, "outcomes of attempts and frames so far"),
        Variable("busy_ns", INT64, OUTPUT, busy, while_busy),
    ]
    meaning, shape = f"frames by outcome: {', '.join(OUTCOMES)}; all that were queued", (_TOTALS,)
    for number in range(len(network.segments)):
        name, member = f"segment[{number + 1}].totals", f"bus.totals[{number * _TOTALS}]"
        outputs.append(Variable(name, INT64, LOCAL, member, meaning, shape=shape))
    for port, node in ports.items():
        for name, meaning in (
            ("state", "0 error-active, 1 error-passive, 2 bus-off"),
            ("transmit_errors", "transmit error counter"),
            ("receive_errors", "receive error counter"),
        ):
            member = f"bus.nodes[{node}].{name}"
            outputs.append(Variable(f"{port}.{name}", INT64, LOCAL, member, meaning))
    return outputs
