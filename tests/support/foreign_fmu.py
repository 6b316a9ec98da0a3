"""An FMU 2.0 of another tool, compiled here from foreign_vehicle.c, and its map."""

import re
import subprocess
import zipfile
from pathlib import Path

import fmpy

from canroll.codegen.run.native import compiler

SOURCE = Path(__file__).with_name("foreign_vehicle.c")
HEADERS = Path(fmpy.__file__).with_name("c-code")
VARIABLES = (
    *(("delta", 0, "input", "deg"), ("Mf", 1, "input", "kN.m"), ("Mr", 2, "input", "kN.m")),
    *(("grip", 3, "input", ""), ("v0", 10, "parameter", "m/s"), ("crash", 11, "parameter", "s")),
    *(("fail", 12, "parameter", "s"), ("lose", 13, "parameter", "s")),
    *(("pos.x", 20, "output", "m"), ("pos.y", 21, "output", "m"), ("psi", 22, "output", "rad")),
    *(("v", 23, "output", "m/s"), ("ay", 24, "output", "m/s2"), ("r", 25, "output", "rad/s")),
    *(("phi", 26, "output", "deg"), ("p", 27, "output", "rad/s"), ("vy", 28, "output", "m/s")),
)
"""Name, value reference, causality and unit."""
STARTS = {"grip": 1.0, "v0": 10.0, "crash": 1e9, "fail": 1e9, "lose": 1e9}
MAP = """\
{step}ignored = ["drive_force"]

[inputs]
delta = {{ from = "steer", unit = "deg" }}
Mf = {{ from = "roll_moment_front", unit = "kN.m" }}
Mr = {{ from = "roll_moment_rear", unit = "kN.m" }}
grip = "friction"

[outputs]
x = "pos.x"
y = "pos.y"
yaw = "psi"
vx = "v"
vy = "vy"
ay = "ay"
yaw_rate = "r"
roll = {{ from = "phi", unit = "deg" }}
roll_rate = "p"

[start]
v0 = "speed"
{start}
"""


def write_map(path: Path, *, step: str = "", start: str = "", **changes: str) -> Path:
    """Write the map of the FMU with keys renamed, or left out where "" is new; return ``path``."""
    text = MAP.format(step=step, start=start)
    for old, new in changes.items():
        text, count = re.subn(rf"(?m)^{old}( = .*\n)", rf"{new}\1" if new else "", text)
        assert count == 1
    path.write_text(text)
    return path


def write_fmu(path: Path, *, able: str = 'canHandleVariableCommunicationStepSize="true"') -> Path:
    """Compile the FMU; ``able`` are attributes of its co-simulation. Return ``path``."""
    library = path.with_suffix(".so")
    command = [
        compiler() or "cc",
        "-O1",
        "-w",
        "-shared",
        "-fPIC",
        f"-I{HEADERS}",
        "-o",
        str(library),
    ]
    subprocess.run([*command, str(SOURCE), "-lm"], check=True)
    variables = "".join(
        f'<ScalarVariable name="{name}" valueReference="{number}" causality="{causality}"'
        + (' variability="fixed"' if causality == "parameter" else "")
        + "><Real"
        + (f' unit="{unit}"' if unit else "")
        + (f' start="{STARTS.get(name, 0.0)}"' if causality != "output" else "")
        + "/></ScalarVariable>"
        for name, number, causality, unit in VARIABLES
    )
    units = "".join(f'<Unit name="{unit}"/>' for unit in sorted({v[3] for v in VARIABLES} - {""}))
    outputs = [k for k, v in enumerate(VARIABLES, 1) if v[2] == "output"]
    unknowns = "".join(f'<Unknown index="{k}"/>' for k in outputs)
    description = (
        '<?xml version="1.0" encoding="UTF-8"?>'
        '<fmiModelDescription fmiVersion="2.0" modelName="van" guid="{van}">'
        f'<CoSimulation modelIdentifier="{path.stem}" {able}/>'
        f"<UnitDefinitions>{units}</UnitDefinitions>"
        '<DefaultExperiment stepSize="0.005"/>'
        f"<ModelVariables>{variables}</ModelVariables>"
        f"<ModelStructure><Outputs>{unknowns}</Outputs>"
        f"<InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure></fmiModelDescription>"
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        archive.write(library, f"binaries/linux64/{path.stem}.so")
    return path
