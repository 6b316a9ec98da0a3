"""The vehicle with driver, actuators and sensors as an FMU: the kernels of the world in C."""

from pathlib import Path
from typing import Any

import numpy as np

from canroll.errors import CanrollError, UnknownNameError
from canroll.extensions.exchange import plant_kernel
from canroll.extensions.exchange.fmu import archive
from canroll.extensions.exchange.fmu.description import unit_name
from canroll.extensions.exchange.fmu.ecu import CAN, PORTS, SIGNALS
from canroll.extensions.exchange.fmu.variables import (
    FLOAT64,
    INPUT,
    OUTPUT,
    Interface,
    Terminal,
    Variable,
)
from canroll.extensions.exchange.kernels import image
from canroll.extensions.exchange.kernels.kinds import FLOAT, INT, ArrayKind, RecordKind, initialiser
from canroll.extensions.exchange.kernels.translate import Translator
from canroll.plant_sim import can_bus
from canroll.plant_sim.bodies.ports import Body
from canroll.plant_sim.driving.maneuvers import Maneuver
from canroll.plant_sim.kernels.records import to_record
from canroll.plant_sim.nodes import actuators, codec_tables, e2e, own_sums, sensors
from canroll.plant_sim.world import recording
from canroll.plant_sim.world.world_kernel import Parts

IDENTIFIER = "canroll_plant"
BUFFER = 8192
PARTS = (
    *("clock", "state", "inputs", "parameters", "outputs", "payload", "roles"),
    *("frames", "sensors", "actuators", "authentication", "tables"),
)
"""Parts of the world's memory that the plant has."""
SI = {"deg/s": "rad/s", "deg": "rad", "km/h": "m/s", "mm": "m", "mm/s": "m/s"}
"""Units of the sensors' messages and those of what they measured."""
REPORTED = {
    "DeliveredMomentFront": "moment_estimate_front",
    "DeliveredMomentRear": "moment_estimate_rear",
    "StatusFrontLeft": "status_front_left",
    "StatusFrontRight": "status_front_right",
    "StatusRearLeft": "status_rear_left",
    "StatusRearRight": "status_rear_right",
}
"""Signals of ActuatorState among the recorded ones."""
MODEL = """\
typedef struct {{
    plant_state plant;
    plant_row shown;
    double demands[4];
}} model;

extern const double plant_start[{columns}];
void model_image(void *record);
"""


def write(
    path: Path,
    parts: Parts,
    body: Body,
    maneuver: Maneuver,
    *,
    actuator: str,
    command: str,
    title: str,
    ports: str = CAN,
) -> None:
    """Write the plant to ``path``.

    Args:
        path: the FMU, replaced if it exists.
        parts: of a world at time 0; its network is left out.
        body: the body in it.
        maneuver: what it drives.
        actuator: its actuators.
        command: message whose values are inputs with plain signals.
        title: description, a line.
        ports: ``can`` or ``signals``.

    Raises:
        CanrollError: no compiler, an unwritable file, faults of frames, a checksum by a function,
            or a body that is not in the kernels' subset.
    """
    if ports not in PORTS:
        raise UnknownNameError("kind of ports", ports, PORTS)
    frames = parts.memory[0]["frames"]
    if frames["fault"]["places"].any() or frames["attacker_at_ecu"] >= 0:
        raise CanrollError("faults of frames act on the bus and are not part of the plant: omit it")
    if np.any(parts.memory[0]["tables"]["protection"]["method"] == e2e.OWN):
        raise CanrollError(
            "the plant's FMU has no checksum by a function of the map: describe it by method and "
            "over, or leave it out"
        )
    start = _start(parts, maneuver)
    row = np.dtype([("values", "f8", (1, recording.N_COLUMNS))])
    messages = [name for name, _, _ in actuators.COMMANDS[actuator]]
    which = messages.index(command)
    channels = actuators.COMMANDS[actuator][which][2]
    kernels = _kernels(start.dtype, row, body)
    shown = np.zeros(1, row)
    recording.record(
        shown["values"][0],
        0,
        parts.memory[0]["outputs"],
        parts.memory[0]["inputs"],
        parts.memory[0]["actuators"],
    )
    values = initialiser(shown["values"][0])
    count = recording.N_COLUMNS
    wired = {"FMU_PORTS": 2, "FMU_BUFFER": BUFFER} if ports == CAN else archive.WITHOUT_PORTS
    constants = {
        **wired,
        "PLANT_ACTUATOR": can_bus.ACTUATOR,
        "PLANT_COMMAND": which,
        "PLANT_CHANNELS": channels,
    }
    sources = {
        **archive.shell("plant_model.c", *(("ls_bus.h",) if ports == CAN else ())),
        **kernels,
        "image.c": image.source("model_image", start.tobytes()),
        "start.c": '#include <math.h>\n\n#include "model.h"\n\n'
        f"const double plant_start[{count}] = {values};\n",
        "model.h": archive.model("plant", "kernels.h", constants, MODEL.format(columns=count)),
    }
    variables = [_recorded(name, name) for name in recording.SIGNALS]
    if ports == SIGNALS:
        variables += [*_demands(command), *_measured()]
    terminals = (
        Terminal(name="Sensors", description="frames of the sensors"),
        Terminal(name="Actuator", description="commands, and the actuators' state"),
    )
    interface = Interface(
        identifier=IDENTIFIER,
        description=title,
        variables=variables,
        terminals=terminals if ports == CAN else (),
        step=1e-3,
    )
    archive.write(path, interface, sources)


def _start(parts: Parts, maneuver: Maneuver) -> np.ndarray[Any, np.dtype[np.void]]:
    """The record of the plant at time 0."""
    memory, drive = parts.memory, to_record(maneuver.drive)
    columns = [(name, memory.dtype[name]) for name in PARTS]
    columns += [("drive", drive.dtype), ("queue", plant_kernel.OUTGOING)]
    state = np.zeros(1, np.dtype(columns, align=True))
    for name in PARTS:
        state[name] = memory[name]
    # the exported plant calls its body by name: an address of this process changes from run to run
    state["clock"]["step"] = 0
    state["drive"] = drive
    return image.copied(state[0], image.aligned(state.dtype))


def _kernels(plant: np.dtype[Any], row: np.dtype[Any], body: Body) -> dict[str, str]:
    """The kernels in C, and their header."""
    translator = Translator(
        "plant_",
        {
            plant_kernel.body_step: "plant_body",
            can_bus.submit: plant_kernel.post,
            own_sums.called: own_sums.none,
        },
    )
    translator.structs.name(plant, "state")
    translator.structs.name(row, "row")
    state, queue = RecordKind(plant), RecordKind(plant["queue"])
    frame = ArrayKind(np.dtype(np.uint8), (64,))
    four = ArrayKind(np.dtype(np.float64), (4,))
    vectors = [ArrayKind(plant[name].base, plant[name].shape) for name in _BODY]
    entries = [
        translator.entry(body.step, (*vectors, FLOAT), "plant_body"),
        translator.entry(plant_kernel.take, (queue,), "plant_take"),
        translator.entry(plant_kernel.receive, (state, INT, INT, INT, frame, INT), "plant_receive"),
        translator.entry(plant_kernel.command, (state, INT, four, INT, INT), "plant_command"),
        translator.entry(plant_kernel.advance, (state,), "plant_advance"),
        translator.entry(plant_kernel.record, (state, RecordKind(row)), "plant_record"),
    ]
    return {"kernels.h": translator.header(entries), "kernels.c": translator.text()}


_BODY = ("state", "inputs", "parameters", "outputs")


def _recorded(name: str, signal: str) -> Variable:
    member, unit = f"shown.values[{recording.SIGNALS[signal]}]", recording.unit(signal)
    return Variable(name, FLOAT64, OUTPUT, member, unit=unit_name(unit))


def _demands(command: str) -> list[Variable]:
    variables = []
    for channel, name in enumerate(actuators.command_signals(command)):
        member, meaning = f"demands[{channel}]", f"demand of channel {channel}"
        named, unit = f"{command}.{name}", unit_name(codec_tables.unit(command, name))
        variables.append(Variable(named, FLOAT64, INPUT, member, meaning, unit, (0.0,)))
    return variables


def _measured() -> list[Variable]:
    """What the sensors measured last, in SI units, and what the actuators report."""
    variables = []
    for index, name in enumerate(sensors.SIGNALS):
        member, unit = f"plant.sensors.channel[{index}].last", codec_tables.unit(*name.split("."))
        si = unit_name(SI.get(unit, unit))
        variables.append(Variable(name, FLOAT64, OUTPUT, member, "as sampled last", si))
    reported = (_recorded(f"ActuatorState.{name}", signal) for name, signal in REPORTED.items())
    return [*variables, *reported]
