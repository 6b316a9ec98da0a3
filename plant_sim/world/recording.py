"""Recording of a run: one row of signals per millisecond, and every applied command."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.bodies import ports
from canroll.plant_sim.bodies.ports import Port
from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.kernels.records import fields
from canroll.plant_sim.nodes import actuator_kernel
from canroll.plant_sim.nodes.actuator_kernel import ActuatorNode

INPUTS = ports.N_OUTPUTS
ACTUATOR = INPUTS + ports.N_INPUTS
N_COLUMNS = ACTUATOR + 16

RECORDED = (
    *("steer", "bank", "friction", "corner_force", "bar_moment", "valve_current"),
    *("wheel_friction", "wind_force"),
)
"""Inputs of the body that are recorded, in order."""
PORTS = (
    *(port for port in ports.OUTPUTS if port.recorded),
    *(
        port._replace(slot=INPUTS + port.slot)
        for port in sorted(
            (port for port in ports.INPUTS if port.recorded),
            key=lambda port: RECORDED.index(port.name),
        )
    ),
    Port("demand", ACTUATOR, number=4),
    Port("moment", ACTUATOR + 4, "N·m", 2),
    Port("moment_estimate", ACTUATOR + 6, "N·m", 2),
    Port("command_held", ACTUATOR + 8),
    Port("status", ACTUATOR + 9, number=4),
    Port("envelope", ACTUATOR + 13),
    Port("actuator_power", ACTUATOR + 14, "W", 2),
)
"""What is recorded; slots are columns."""
SIGNALS: dict[str, int] = {name: slot for port in PORTS for name, slot in port.slots.items()}
"""Column of each recorded signal, SI units. ``demand``: the accepted command by channel (N, N·m or
mA); ``moment``: delivered roll moment on the body by axle; ``status``: 0 OK, 1 limited, 2 stuck,
3 floating; ``envelope``: 1 where the actuators' envelope refuses the command; ``actuator_power``:
what the actuators of an axle give to body and wheels."""

NAMES = ("time", *SIGNALS)
"""The recorded signals in order; ``time`` in s."""

_UNITS = {name: port.unit for port in PORTS for name in port.slots}

COMMAND = np.dtype(fields("i8", "t_sample t_submitted t_received t_applied counter"))
"""One applied command, instants in ns; ``t_sample`` is -1 before the first sample."""


@njit
def _power(
    node: ActuatorNode,
    axle: int,
    outputs: NDArray[np.float64],
    inputs: NDArray[np.float64],
) -> float:
    """Power (W) of an axle's actuators: forces times travel rates, moments times their twist's."""
    left = 2 * axle
    left_rate = outputs[ports.TRAVEL_RATE + left]
    right_rate = outputs[ports.TRAVEL_RATE + left + 1]
    if node.kind in (actuator_kernel.SUSPENSION, actuator_kernel.DAMPERS):
        force = ports.CORNER_FORCE + left
        return float(inputs[force] * left_rate + inputs[force + 1] * right_rate)
    moment = node.delivered[axle]
    twist = (left_rate - right_rate) / (2.0 * node.half_track[axle])
    return float(moment * twist)


@njit
def record(
    rows: NDArray[np.float64],
    number: int,
    outputs: NDArray[np.float64],
    inputs: NDArray[np.float64],
    node: ActuatorNode,
) -> None:
    """Fill row ``number`` of ``rows`` at the end of a step."""
    row = rows[number]
    for i in range(INPUTS):
        row[i] = outputs[i]
    for i in range(ports.N_INPUTS):
        row[INPUTS + i] = inputs[i]
    for i in range(4):
        row[ACTUATOR + i] = node.demand[i]
        row[ACTUATOR + 4 + i] = node.delivered[i]
        row[ACTUATOR + 9 + i] = node.status[i]
    row[ACTUATOR + 8] = node.held
    row[ACTUATOR + 13] = node.envelope.acted
    for axle in range(2):
        row[ACTUATOR + 14 + axle] = _power(node, axle, outputs, inputs)


@dataclass(frozen=True, slots=True)
class Kept:
    """What is kept of a run: signals by name, and whether the bus log is."""

    signals: tuple[str, ...] = NAMES
    frames: bool = True


EVERYTHING = Kept()
NOTHING = Kept((), frames=False)


@njit
def _fill_block(
    rows: NDArray[np.float64], columns: NDArray[np.int64], block: NDArray[np.float64]
) -> None:
    # row by row: a column of all rows would be read from as many cache lines as there are rows
    for number in range(len(rows)):
        for signal in range(len(columns)):
            block[signal, number] = rows[number, columns[signal]]


def signal_block(
    rows: NDArray[np.float64], times: NDArray[np.float64], names: Sequence[str]
) -> NDArray[np.float64]:
    """Rows of the kernel as a block of :class:`Columns` named ``names``; ``times`` in s."""
    block = np.empty((len(names), len(rows)))
    columns = [0 if name == "time" else SIGNALS[name] for name in names]
    _fill_block(rows, np.array(columns, dtype=np.int64), block)
    if "time" in names:
        block[names.index("time")] = times
    return block


def unit(name: str) -> str:
    """Return the unit of a recorded signal, '' for flags and units that depend on the actuator."""
    return _UNITS.get(name, "")
