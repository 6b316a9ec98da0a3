"""Record what every command prints and writes, to compare a rewrite with the code before it.

    python -m tools.golden FOLDER [CASE ...]
    diff -r BEFORE AFTER

Each case writes one text file: exit code, standard output, standard error, and a hash of each file
it made. Durations and solver times are masked.
"""

import argparse
import hashlib
import io
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

RUN = ("run", "double_lane_change", "--duration", "4")
CASES: dict[str, tuple[str, ...]] = {
    "run-lead": (*RUN, "--out", "out", "--json"),
    "run-terminal": (*RUN, "--law", "lqg_delay", "--actuator", "suspension"),
    "run-fd": (*RUN, "--bus", "secured_fd", "--seed", "3", "--json"),
    "run-gateway": (*RUN, "--bus", "gateway_20ms", "--law", "hinf", "--json"),
    "run-full-car": (*RUN, "--law", "lqr_full_car", "--actuator", "valves", "--json"),
    "run-event": (*RUN, "--law", "hinf_event", "--trigger", "event", "--json"),
    "run-faults": (*RUN, "--fault", "Imu.RollRate=stuck@2", "--json"),
    "run-car": (
        *(*RUN, "--law", "lqr", "--observer", "acceleration", "--map", "examples/cars/vw_mqb.toml"),
        *("--dbc", "examples/cars/vw_mqb.dbc", "--dbc", "examples/cars/actuators.dbc", "--json"),
    ),
    "design": ("design", "--out", "out", "--json"),
    "design-lqr": ("design", "--law", "lqr", "--actuator", "suspension", "--out", "out"),
    "compare": ("compare", "lqr", "hinf", "--duration", "4", "--json"),
    "sweep": ("sweep", "double_lane_change", "--speed", "60:80:20", "--json"),
    "limit": ("limit", "fishhook", "--from", "60", "--to", "90", "--tolerance", "10", "--json"),
    "understeer": ("understeer", "--json"),
    "response": ("response", "--linear", "--json"),
    "bus": ("bus", "500k", "--simulate", "2", "--json"),
    "bus-terminal": ("bus", "gateway_20ms"),
    "timing": ("timing", "--duration", "0.5", "--json"),
    "timing-bound": ("timing", "--bound", "--json"),
    "prove": ("prove",),
    "export-c": ("export-c", "out"),
    "export-c-secured": ("export-c", "out", "--bus", "secured_fd"),
    "export-c-specialised": ("export-c", "out", "--specialise"),
    "export-ecu": ("export-fmu", "ecu", "out.fmu"),
    "export-plant": ("export-fmu", "plant", "out.fmu"),
    "export-bus": ("export-fmu", "bus", "out.fmu"),
    "campaign": ("campaign", "double_lane_change", "--runs", "4", "--out", "out", "--json"),
    "severe": ("severe", "--runs", "2", "--json"),
    "list": ("list", "laws"),
    "reproduce": ("reproduce", "viadero2022", "--json"),
}
VOLATILE = re.compile(
    rb'("?(?:solver_s|[a-z_]*seconds|duration_s|created|git|commit)"?\s*[:=]\s*)("[^"]*"|[-+.\de]+)'
)


def digest(path: Path) -> str:
    """Return a hash of a file's content; of arrays and archive members, not of their packing."""
    data = path.read_bytes()
    made = hashlib.sha256()
    if path.suffix == ".npz":
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            for name in sorted(arrays):
                made.update(name.encode() + arrays[name].tobytes())
    elif zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            for name in sorted(archive.namelist()):
                if not name.endswith(".so"):
                    made.update(name.encode() + archive.read(name))
    elif path.suffix == ".asc":  # begins with the day
        made.update(b"".join(data.splitlines(keepends=True)[1:]))
    else:
        made.update(VOLATILE.sub(rb"\1*", data))
    return made.hexdigest()[:16]


def record(name: str, folder: Path) -> None:
    """Run a case and write its record."""
    with tempfile.TemporaryDirectory() as work:
        root = Path(__file__).parents[1]
        arguments = [str(root / a) if a.startswith("examples/") else a for a in CASES[name]]
        ran = subprocess.run(
            [sys.executable, "-m", "canroll.cli.main", *arguments],
            cwd=work,
            env={**os.environ, "PYTHONPATH": str(root), "COLUMNS": "100"},
            capture_output=True,
            check=False,
        )
        printed = VOLATILE.sub(rb"\1*", ran.stdout + b"\n--\n" + ran.stderr).decode()
        printed = printed.replace(work, "WORK").replace(str(root), "ROOT")
        files = sorted(path for path in Path(work).rglob("*") if path.is_file())
        hashes = [f"{digest(path)} {path.relative_to(work)}" for path in files]
    text = "\n".join([f"exit {ran.returncode}", printed, *hashes, ""])
    (folder / f"{name}.txt").write_text(text)


def main() -> None:
    """Record the cases named, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("case", nargs="*", metavar="CASE", help="default: all of them")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda name: record(name, args.folder), args.case or CASES))


if __name__ == "__main__":
    main()
