"""The vehicle alone as an FMU: forces, steering and road in, its motion out.

Its inputs and outputs are the quantities of a map, so that it can be a plant again.
"""

from pathlib import Path

import numpy as np
import tomli_w

from canroll.errors import writing
from canroll.extensions.exchange.fmi.quantities import INPUTS, OUTPUTS
from canroll.extensions.exchange.fmu import archive
from canroll.extensions.exchange.fmu.variables import FLOAT64, INPUT, OUTPUT, Interface, Variable
from canroll.extensions.exchange.kernels import image
from canroll.extensions.exchange.kernels.kinds import FLOAT, ArrayKind
from canroll.extensions.exchange.kernels.translate import Translator
from canroll.plant_sim.bodies.ports import Body
from canroll.plant_sim.driving.maneuvers import Maneuver
from canroll.plant_sim.world import open_loop
from canroll.vehicles import Vehicle

IDENTIFIER = "canroll_vehicle"
PARTS = ("state", "inputs", "parameters", "outputs")
MODEL = """\
typedef struct {
    body_vehicle vehicle;
    int64_t time_ns;
} model;

void body_image(void *record);
"""


def write(path: Path, vehicle: Vehicle, body: Body, maneuver: Maneuver, *, title: str) -> Path:
    """Write the vehicle to ``path``, and its map next to it; return the map's path.

    Args:
        path: the FMU, replaced if it exists.
        vehicle: its numbers.
        body: its equations.
        maneuver: its speed is the one at the start.
        title: description, a line.

    Raises:
        CanrollError: no compiler, an unwritable file, or a body that is not in the kernels' subset.
    """
    parts = dict(zip(PARTS, open_loop.start(vehicle, body, maneuver), strict=True))
    dtype = np.dtype([(name, "f8", (len(values),)) for name, values in parts.items()])
    start = np.zeros(1, dtype)
    for name, values in parts.items():
        start[name] = values
    translator = Translator("body_")
    translator.structs.name(dtype, "vehicle")
    vectors = [ArrayKind(np.dtype(np.float64), (len(values),)) for values in parts.values()]
    entry = translator.entry(body.step, (*vectors, FLOAT), "body_step")
    sources = {
        **archive.shell("body_model.c"),
        "kernels.h": translator.header([entry]),
        "kernels.c": translator.text(),
        "image.c": image.source("body_image", start.tobytes()),
        "model.h": archive.model("vehicle", "kernels.h", archive.WITHOUT_PORTS, MODEL),
    }
    variables = _variables(parts["inputs"])
    interface = Interface(identifier=IDENTIFIER, description=title, variables=variables, step=1e-3)
    archive.write(path, interface, sources)
    return _write_map(path)


def _variables(inputs: np.ndarray[tuple[int], np.dtype[np.float64]]) -> list[Variable]:
    variables = []
    for name, (place, unit) in INPUTS.items():
        member, start = f"vehicle.inputs[{place}]", (float(inputs[place]),)
        variables.append(Variable(name, FLOAT64, INPUT, member, unit=unit, start=start))
    for name, (place, unit) in OUTPUTS.items():
        variables.append(Variable(name, FLOAT64, OUTPUT, f"vehicle.outputs[{place}]", unit=unit))
    return variables


def _write_map(path: Path) -> Path:
    """Write the map that takes the FMU at ``path`` as the plant."""
    table = {
        "step_ms": 1,
        "inputs": {name: name for name in INPUTS},
        "outputs": {name: name for name in OUTPUTS},
    }
    map_path = path.with_suffix(".toml")
    with writing(map_path, "choose another name"):
        map_path.write_text(tomli_w.dumps(table), encoding="utf-8")
    return map_path
