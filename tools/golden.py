"""Record what every command prints and writes, to compare a rewrite with the code before it.

    python -m tools.golden FOLDER [--kept KEPT] [CASE ...]
    diff -r BEFORE AFTER

Each case writes one text file: exit code, standard output, standard error, and a hash of each file
it made. Durations and solver times are masked. KEPT has a saved run and its calibration, made where
there is none: recorded by an earlier version, they must still load. Left out, as they take minutes:
``certify``, ``compare --runs``; as they need another program on a bus: ``plant``,
``watch``.
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
from itertools import groupby
from pathlib import Path

import numpy as np

from canroll.cli.commands import COMMANDS

ROOT = Path(__file__).parents[1]
KINDS = ("laws", "vehicles", "scenarios", "options", "buses", "bodies")
RUN = ("run", "double_lane_change", "--duration", "4")
DRIVE = ("examples/bmw_m8/double_lane_change.csv", "--vehicle", "bmw_m8", "--imu", "levelled")
THEN = ";"
"""Between commands of one case, which run in one folder."""
DESIGN = ("design", "--law", "lqr", "--actuator", "suspension", "--out", "cal", THEN)
CAL = "cal/calibration.toml"
KEPT = "KEPT"
CASES: dict[str, tuple[str, ...]] = {
    "help": (*(w for name in COMMANDS for w in (name, "--help-all", THEN)), "--help"),
    **{
        f"frames-{seed}": (*RUN, "--seed", str(seed), "--no-trace", "--log", "bus.asc", "--json")
        for seed in (1, 2, 3)
    },
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
    "sweep": ("compare", "steering_lead", "--speed", "60:80:20", "--json"),
    "limit": (
        *("handling", "limit", "fishhook", "--from", "60", "--to", "90", "--tolerance", "10"),
        "--json",
    ),
    "understeer": ("handling", "circle", "--json"),
    "response": ("handling", "response", "--linear", "--json"),
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
    "severe": ("compare", "--scenario", "severe", "--runs", "2", "--json"),
    "list": ("list", "laws"),
    "list-all": tuple(w for kind in KINDS for w in (THEN, "list", kind, "--json"))[1:],
    "completion": ("list", "completion", "--shell", "bash"),
    "compare-page": ("compare", "lqr", "hinf", "--duration", "4", "--out", "out"),
    "margins": (*DESIGN, "margins", CAL, "--json"),
    "faults": ("faults", "--only", "0", "--law", "lqr", "--json"),
    "attacks": (
        *("faults", "--catalogue", "attacks", "--attack", "replay", "--bus", "secured_fd"),
        *("--law", "lqr", "--json"),
    ),
    "response-law": ("handling", "response", "--law", "lqr", "--json"),
    "vehicle": (
        *("vehicle", "new", "van.toml", "--class", "van", "--mass", "2720", "--wheelbase", "3.66"),
        *("--track", "1.735", "--height", "2.5", THEN, "vehicle", "check", "van.toml", "--json"),
    ),
    "validate": (
        *("validate", *DRIVE, "--from", "9.3", "--to", "15.6", "--zero", "8.5:9.3"),
        *("--out", "out", "--json"),
    ),
    "fit": (
        *("fit", *DRIVE, "--from", "9.3", "--to", "11", "--starts", "1", "--jobs", "1", "--json"),
    ),
    "hil": ("hil", *RUN[1:2], "--pace", "lockstep", "--duration", "1", "--law", "lqr", "--json"),
    "ecu-replay": (
        *(*DESIGN, "run", "double_lane_change", "--calibration", CAL, "--duration", "2"),
        *("--log", "drive.asc", "--json", THEN),
        *("ecu", "--replay", "drive.asc", "--calibration", CAL, "--json"),
    ),
    "kept-report": ("run", KEPT, "--out", "out", "--json"),
    "kept-margins": ("margins", f"{KEPT}/calibration.toml", "--json"),
    "kept-run": (*RUN, "--calibration", f"{KEPT}/calibration.toml", "--json"),
    "reproduce": ("reproduce", "viadero2022", "--json"),
}
VOLATILE = re.compile(
    rb'("?(?:solver_s|[a-z_]*seconds|duration_s|created|git|commit)"?\s*[:=]\s*)("[^"]*"|[-+.\de]+)'
    rb'|("timing": )(\{.*\})'
)
MASK = rb"\1\3*"


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
        made.update(VOLATILE.sub(MASK, data))
    return made.hexdigest()[:16]


def run(arguments: list[str], work: str) -> "subprocess.CompletedProcess[bytes]":
    """Run a command in a folder."""
    return subprocess.run(
        [sys.executable, "-m", "canroll.cli.main", *arguments],
        cwd=work,
        env={**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100"},
        capture_output=True,
        check=False,
    )


def record(name: str, folder: Path, kept: Path) -> None:
    """Run a case and write its record."""
    parts = []
    with tempfile.TemporaryDirectory() as work:
        words = [str(ROOT / w) if w.startswith("examples/") else w for w in CASES[name]]
        words = [w.replace(KEPT, str(kept)) if w.startswith(KEPT) else w for w in words]
        for ends, command in groupby(words, key=THEN.__eq__):
            if not ends:
                ran = run(list(command), work)
                printed = VOLATILE.sub(MASK, ran.stdout + b"\n--\n" + ran.stderr).decode()
                for path, text in ((work, "WORK"), (str(kept), KEPT), (str(ROOT), "ROOT")):
                    printed = printed.replace(path, text)
                parts += [f"exit {ran.returncode}", printed]
        files = sorted(path for path in Path(work).rglob("*") if path.is_file())
        parts += [f"{digest(path)} {path.relative_to(work)}" for path in files]
    (folder / f"{name}.txt").write_text("\n".join([*parts, ""]))


def main() -> None:
    """Record the cases named, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("case", nargs="*", metavar="CASE", help="default: all of them")
    parser.add_argument("--kept", type=Path, help="an earlier recording (default: FOLDER/kept)")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    kept = (args.kept or args.folder / "kept").resolve()
    if not kept.exists():
        run([*RUN, "--law", "lqr", "--out", str(kept)], str(args.folder))
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda name: record(name, args.folder, kept), args.case or CASES))


if __name__ == "__main__":
    main()
