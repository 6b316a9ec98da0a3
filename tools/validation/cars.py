"""Real cars' networks: each is mapped, drives the loop and becomes a bundle that tests itself.

    python -m tools.validation.cars [FOLDER]

The maps are those of examples/cars, and so are the DBCs, which have the messages in use alone.
FOLDER has whole ones of opendbc (https://github.com/commaai/opendbc, MIT), those that its
generator makes among them. The table has a row for each car; exit code 1 where one fails.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from canroll.errors import CanrollError
from canroll.runs import experiment
from codegen.generated.bus_map import BusMap, load

MAPS = Path(__file__).parents[2] / "examples" / "cars"
ACTUATORS = MAPS / "actuators.dbc"
SIGNALS = ("speed", "steering", "yaw_rate", "lateral_acceleration", "roll_rate")
"""Fields of the sensors that a car's bus may have."""
HEAD = f"{'car':31} {'frames':>6} {'protected':>9}  {'signals':39} {'roll, deg':>12}  bundle"


class Car(NamedTuple):
    """A car's network: its name, its DBC and the map."""

    name: str
    dbc: Path
    map_file: Path


def cars(folder: Path) -> Iterator[Car]:
    """Yield the cars whose DBC is in a folder."""
    for path in sorted(MAPS.glob("*.toml")):
        for name in (path.stem, f"{path.stem}_generated"):
            dbc = folder / f"{name}.dbc"
            if dbc.exists():
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


def row(car: Car) -> tuple[str, bool]:
    """Return the row of a car, and whether all of it works."""
    try:
        bus = load((car.dbc, ACTUATORS), car.map_file)
        chosen = choices(car, bus)
        result = experiment.run("double_lane_change", duration=4.0, **chosen)
    except CanrollError as error:
        return f"{car.name:31} {error}", False
    theirs = [box for box in bus.received if box.name and box.slot != "actuator_state"]
    measured = {signal.place.text for box in theirs for signal in box.signals}
    short = [name.split("_")[0] for name in SIGNALS if name in measured]
    protected = sum(box.protection is not None for box in theirs)
    driven, alone = result.controlled_metrics, result.passive_metrics
    assert driven is not None and alone is not None
    with_control, without = driven.roll_max_deg, alone.roll_max_deg
    roll = f"{without:.2f} → {with_control:.2f}"
    said = bundle(car, chosen)
    text = f"{car.name:31} {len(theirs):6} {protected:9}  {', '.join(short):39} {roll:>12}  {said}"
    return text, said == "ok" and with_control < without


def main() -> int:
    """Print the table; return 1 where a car fails."""
    parser = argparse.ArgumentParser(description="Close the loop on the networks of real cars.")
    parser.add_argument("folder", nargs="?", type=Path, default=MAPS, help="with whole DBCs")
    args = parser.parse_args()
    print(HEAD)
    failed = done = 0
    for car in cars(args.folder):
        text, well = row(car)
        done, failed = done + 1, failed + (not well)
        print(text, flush=True)
    print(f"{done} cars, {failed} failed")
    return 1 if failed or not done else 0


if __name__ == "__main__":
    sys.exit(main())
