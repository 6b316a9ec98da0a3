"""Recording of a run: one row of signals per millisecond, and every applied command."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plant_sim.bodies import ports
from plant_sim.bodies.ports import WHEELS
from plant_sim.kernels.jit import njit
from plant_sim.nodes import actuator_kernel, envelope
from plant_sim.nodes.actuator_kernel import Actuators

INPUTS = ports.N_OUTPUTS
ACTUATOR = INPUTS + ports.N_INPUTS
N_COLUMNS = ACTUATOR + 14

AXLES = ("front", "rear")


def _four(name: str, first: int) -> dict[str, int]:
    return {f"{name}_{wheel}": first + i for i, wheel in enumerate(WHEELS)}


def _two(name: str, first: int) -> dict[str, int]:
    return {f"{name}_{axle}": first + i for i, axle in enumerate(AXLES)}


SIGNALS: dict[str, int] = {
    "x": ports.X,
    "y": ports.Y,
    "yaw": ports.YAW,
    "vx": ports.VX,
    "vy": ports.VY,
    "ax": ports.AX,
    "ay": ports.AY,
    "yaw_rate": ports.YAW_RATE,
    "yaw_acc": ports.YAW_ACC,
    "roll": ports.ROLL,
    "roll_rate": ports.ROLL_RATE,
    "roll_acc": ports.ROLL_ACC,
    "pitch": ports.PITCH,
    "pitch_rate": ports.PITCH_RATE,
    "pitch_acc": ports.PITCH_ACC,
    "heave": ports.HEAVE,
    "heave_rate": ports.HEAVE_RATE,
    "heave_acc": ports.HEAVE_ACC,
    **_four("wheel_load", ports.WHEEL_LOAD),
    **_four("travel", ports.TRAVEL),
    **_four("travel_rate", ports.TRAVEL_RATE),
    **_four("wheel_speed", ports.WHEEL_SPEED),
    **_four("wheel_height", ports.WHEEL_HEIGHT),
    **_four("lateral_force", ports.LATERAL_FORCE),
    "path_error": ports.PATH_ERROR,
    "rollover": ports.ROLLOVER,
    "two_wheel_lift": ports.TWO_WHEEL_LIFT,
    **_two("bar_angle", ports.BAR_ANGLE),
    **_two("bar_pressure", ports.BAR_PRESSURE),
    "steer": INPUTS + ports.STEER,
    "bank": INPUTS + ports.BANK,
    "friction": INPUTS + ports.FRICTION,
    **_four("corner_force", INPUTS + ports.CORNER_FORCE),
    **_two("bar_moment", INPUTS + ports.BAR_MOMENT_FRONT),
    **_two("valve_current", INPUTS + ports.VALVE_CURRENT_FRONT),
    **_four("demand", ACTUATOR),
    **_two("moment", ACTUATOR + 4),
    **_two("moment_estimate", ACTUATOR + 6),
    "command_held": ACTUATOR + 8,
    **_four("status", ACTUATOR + 9),
    "envelope": ACTUATOR + 13,
}
"""Column of each recorded signal, SI units. ``demand``: the accepted command by channel (N, N·m or
mA); ``moment``: delivered roll moment on the body by axle; ``status``: 0 OK, 1 limited, 2 stuck,
3 floating; ``envelope``: 1 where the actuators' envelope refuses the command."""

NAMES = ("time", *SIGNALS)
"""The recorded signals in order; ``time`` in s."""

_UNITS = {
    "x": "m",
    "y": "m",
    "yaw": "rad",
    "vx": "m/s",
    "vy": "m/s",
    "ax": "m/s²",
    "ay": "m/s²",
    "roll": "rad",
    "pitch": "rad",
    "heave": "m",
    "path_error": "m",
    "steer": "rad",
    "bank": "rad",
}
_FAMILIES = {
    "wheel_load": "N",
    "travel_rate": "m/s",
    "travel": "m",
    "wheel_speed": "rad/s",
    "wheel_height": "m",
    "lateral_force": "N",
    "corner_force": "N",
    "bar_angle": "rad",
    "bar_pressure": "Pa",
    "bar_moment": "N·m",
    "moment": "N·m",
    "valve_current": "A",
}
_RATES = {"yaw": "rad", "roll": "rad", "pitch": "rad", "heave": "m"}

# Columns of a row of applied commands.
SAMPLED, SUBMITTED, RECEIVED, APPLIED, COUNTER, N_COMMAND = range(6)

COMMAND = np.dtype(
    [
        ("t_sample", "i8"),
        ("t_submitted", "i8"),
        ("t_received", "i8"),
        ("t_applied", "i8"),
        ("counter", "i8"),
    ]
)
"""One applied command, instants in ns; ``t_sample`` is -1 before the first sample."""


@njit
def record(
    rows: NDArray[np.float64],
    number: int,
    outputs: NDArray[np.float64],
    inputs: NDArray[np.float64],
    node: Actuators,
) -> None:
    """Fill row ``number`` of ``rows`` at the end of a step."""
    row = rows[number]
    for i in range(INPUTS):
        row[i] = outputs[i]
    for i in range(ports.N_INPUTS):
        row[INPUTS + i] = inputs[i]
    for i in range(4):
        row[ACTUATOR + i] = node.state[actuator_kernel.DEMAND + i]
        row[ACTUATOR + 4 + i] = node.state[actuator_kernel.DELIVERED + i]
        row[ACTUATOR + 9 + i] = node.flag[actuator_kernel.STATUS + i]
    row[ACTUATOR + 8] = node.flag[actuator_kernel.HELD]
    row[ACTUATOR + 13] = node.envelope.memory[envelope.ACTED]


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
    if name in _UNITS:
        return _UNITS[name]
    stem, _, derivative = name.rpartition("_")
    if stem in _RATES and derivative in ("rate", "acc"):
        return _RATES[stem] + ("/s" if derivative == "rate" else "/s²")
    return next((u for family, u in _FAMILIES.items() if name.startswith(family)), "")
