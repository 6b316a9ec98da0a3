"""Real cars' networks (examples/cars): each drives the loop and becomes a bundle."""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from canroll.codegen.generated.bus_map import BusMap, load
from canroll.runs import experiment

MAPS = Path(__file__).parents[2] / "examples" / "cars"
ACTUATORS = MAPS / "actuators.dbc"


class Car(NamedTuple):
    """A car's network: its name, its DBC and the map."""

    name: str
    dbc: Path
    map_file: Path


def cars() -> Iterator[Car]:
    """Yield all of them; the DBCs have the messages in use alone."""
    for path in sorted(MAPS.glob("*.toml")):
        for name in (path.stem, f"{path.stem}_generated"):
            if (dbc := MAPS / f"{name}.dbc").exists():
                yield Car(path.stem, dbc, path)


def choices(car: Car, bus: BusMap) -> dict[str, Any]:
    """Return how the loop is closed on a car: lqr, with an observer of what is measured."""
    measured = {signal.place.text for box in bus.received for signal in box.signals}
    return {
        "law": "lqr",
        "actuator": "bars",
        "observer": "two_sensors" if "roll_rate" in measured else "acceleration",
        "bus": "fd_2m" if any(box.fd for box in bus.frames) else "500k",
        "dbc": (str(car.dbc), str(ACTUATORS)),
        "map": str(car.map_file),
    }


def bundle(car: Car, chosen: dict[str, Any]) -> str:
    """Return what the bundle of a car says of itself: "ok", or the first line that is not."""
    python = Path(sys.executable)
    with tempfile.TemporaryDirectory() as folder:
        command = [str(python.with_name("canroll")), "export-c", f"{folder}/bundle"]
        for name in ("law", "actuator", "observer", "bus", "map"):
            command += [f"--{name}", str(chosen[name])]
        for path in (car.dbc, ACTUATORS):
            command += ["--dbc", str(path)]
        codec = [str(python), "test/test_codec.py", "--frames", "2000"]
        place = Path(folder)
        for step in (command, ["make", "test", "build/codec"], codec):
            done = subprocess.run(step, cwd=place, capture_output=True, text=True, check=False)
            wrong = [line for line in done.stdout.splitlines() if "FAIL" in line]
            if done.returncode or wrong:
                return (wrong or (done.stderr or done.stdout).splitlines())[0]
            place = Path(folder, "bundle")
    return "ok"


def roll_angles(car: Car) -> tuple[float, float]:
    """Return the largest roll angle (degrees) without and with control on a car's network."""
    chosen = choices(car, load((car.dbc, ACTUATORS), car.map_file))
    result = experiment.run("double_lane_change", duration=4.0, **chosen)
    driven, alone = result.controlled_metrics, result.passive_metrics
    assert driven is not None and alone is not None
    return alone.roll_max_deg, driven.roll_max_deg
