"""A run saved in its folder: ``trace.npz``, ``result.json`` and ``calibration.toml``.

From these three files a run can be evaluated and shown again with the same numbers.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from canroll import documents, vehicles
from canroll.errors import UNREADABLE, CanrollError, reason, writing
from canroll.gain_gen.calibration import calibration_file
from canroll.gain_gen.calibration.calibration_file import LoadedCalibration
from canroll.plant_sim.bodies import BODIES
from canroll.plant_sim.buses import BUSES
from canroll.plant_sim.driving import MANEUVERS
from canroll.plant_sim.world import archive
from canroll.runs.experiment import assess
from canroll.runs.limit_cycle import LimitCycle
from canroll.runs.result import SAVED, Result, Run
from canroll.runs.trace import Trace, entries, restored
from canroll.setup.controller import COMMANDS, Controller

RESULT = "result.json"
TRACE = "trace.npz"
CALIBRATION = "calibration.toml"
SCHEMA = 1
"""Format of the three files together; those of versions before 1.0 have none."""
HASHED = (TRACE, CALIBRATION)
HASHES = "sha256"
"""Key of result.json: the SHA-256 of the other two files."""
VEHICLE = "vehicle_sha256"
"""Key of result.json: the fingerprint of the vehicle that was driven."""
DOCUMENT = "vehicle_document"
"""Key of result.json: the document of that vehicle."""
RUNS = ("passive", "controlled", "replay")


def save_traces(path: Path, result: Result) -> Path:
    """Write every trace of a run as one NumPy archive and return its path.

    A run's arrays are named "passive/signals" and so on; "signals" has a row per signal, named by
    "signal_names". The same run gives the same bytes.

    Raises:
        CanrollError: it cannot be written.
    """
    made: dict[str, archive.Entry] = {}
    for run in RUNS:
        trace: Trace | None = getattr(result, run)
        if trace is not None:
            made |= entries(trace, f"{run}/")
    with writing(path):
        archive.write(path, made, compressed=True)
    return path


def is_run(folder: Path) -> bool:
    """Whether ``folder`` holds a saved run."""
    return (folder / RESULT).is_file() and (folder / TRACE).is_file()


def load(folder: Path) -> Result:
    """Return the run saved in ``folder``, with figures recomputed from its traces.

    Raises:
        CanrollError: files are missing, unreadable, changed, or not of one run.
    """
    if (folder / RESULT).is_file() and not (folder / TRACE).is_file():
        raise CanrollError(
            f"{folder}: not a saved run: {TRACE} is missing or was left out by --no-trace: drive "
            "it again"
        )
    if not is_run(folder):
        raise CanrollError(
            f"{folder}: not a saved run (expected {RESULT} and {TRACE}, as written by "
            "'canroll run --out')"
        )
    try:
        data = documents.parse_json(documents.text(folder / RESULT))
        if (schema := data.get("schema", "none")) != SCHEMA:
            raise CanrollError(
                f"{folder / RESULT}: schema {schema!r}, but this version reads {SCHEMA}: drive "
                "the run again"
            )
        hashes = data[HASHES]
        changed = [name for name in HASHED if digest(folder / name) != hashes[name]]
        if changed:
            raise CanrollError(f"{folder}: {', '.join(changed)} changed since the run was written")
        with archive.Archive(folder / TRACE) as stored:
            traces = {
                run: restored(Trace, stored, f"{run}/")
                for run in RUNS
                if f"{run}/signals" in stored
            }
        loaded = calibration_file.load(folder / CALIBRATION)
        settings = _settings(data, loaded)
        note = vehicles.note_of_change(settings.vehicle, "run")
        warnings = (*data["warnings"], *([note] if note else []))
        fields = {"warnings": warnings, "files": data["files"]}
        timing = data.get("timing", {})
        known = data["calibration_id"]
        oscillation = data["limit_cycle"]
        cycle = None if oscillation is None else LimitCycle(**oscillation)
    except UNREADABLE as error:
        raise CanrollError(f"{folder}: cannot read the saved run: {reason(error)}") from error
    passive, controlled, replayed = map(traces.get, RUNS)
    if passive is None or known != loaded.record.id:
        raise CanrollError(
            f"{folder}: {RESULT}, {TRACE} and {CALIBRATION} come from different runs"
        )
    controller = Controller(
        settings.vehicle, settings.law, settings.actuator, loaded.record, loaded.tables, ()
    )
    result = assess(settings, controller, passive, controlled, replayed, cycle=cycle)
    return replace(result, timing=timing, **fields)


def digest(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _settings(data: Mapping[str, Any], loaded: LoadedCalibration) -> Run:
    vehicle = vehicles.embedded(
        data[DOCUMENT],
        reference=data["plant_vehicle"] or loaded.vehicle.reference,
        fingerprint=data[VEHICLE],
        where=f"{loaded.path.parent / RESULT}: {DOCUMENT}",
    )
    for registry, name in ((MANEUVERS, "scenario"), (BODIES, "plant"), (BUSES, "bus")):
        registry.refuse_code(data[name], str(loaded.path.parent / RESULT))
    phase = data["phase_ms"]["chosen"]
    return Run.of(
        {name: data[name] for name in SAVED},
        scenario=data["scenario"],
        vehicle=vehicle,
        command=COMMANDS[loaded.record.actuator],
        phase=None if phase is None else 1e-3 * phase,
        stage=loaded.stage,
    )
