"""The files of a run: report, bus log, header, calibration, numbers."""

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from canroll.codegen.export.header import gains_header
from canroll.errors import writing
from canroll.gain_gen.calibration import calibration_file
from canroll.gain_gen.calibration.dequantise import physical_notes
from canroll.gain_gen.models.task import UNVERIFIED
from canroll.report import staging
from canroll.report.run_page import run_page
from canroll.runs import saved_run
from canroll.runs.logs import write_log
from canroll.runs.result import Result


def write_text(path: Path, text: str) -> Path:
    """Write a text file and return its path.

    Raises:
        CanrollError: it cannot be written.
    """
    with writing(path):
        path.write_text(text, encoding="utf-8")
    return path


def write_files(result: Result, folder: Path, *, without: Collection[str] = ()) -> Result:
    """Write the files of a run to ``folder``, all or none; return the run with the paths.

    report.html, bus.asc, canroll_gains.h, calibration.toml, trace.npz, result.json.

    Args:
        result: the run.
        folder: folder of the files.
        without: "trace", if it is left out; an older one in the folder is removed.

    Raises:
        CanrollError: a file cannot be written.
    """
    names = {
        "report": "report.html",
        "log": "bus.asc",
        "header": "canroll_gains.h",
        "calibration": saved_run.CALIBRATION,
        "trace": saved_run.TRACE,
        "result": saved_run.RESULT,
    }
    names = {name: file for name, file in names.items() if name not in without}
    known = {**result.files, **{name: str(folder / file) for name, file in names.items()}}
    result = replace(result, files=known)
    with staging.replaced(folder, saved_run.RESULT) as part:
        _write_parts(result, {name: part / file for name, file in names.items()})
    if "trace" in without:
        (folder / saved_run.TRACE).unlink(missing_ok=True)
    return result


def _write_parts(result: Result, paths: Mapping[str, Path]) -> None:
    """Write each file of a run to its path."""
    seen = result.passive if result.controlled is None else result.controlled
    write_log(paths["log"], seen.frames)
    calibration_file.save(paths["calibration"], result.record, result.tables)
    if "trace" in paths:
        saved_run.save_traces(paths["trace"], result)
    designed = result.tables["design"]
    header = gains_header(
        result.record,
        title=(
            f"{designed['law']} for {Path(designed['vehicle']).stem}",
            *(text for text in designed["warnings"] if text.startswith(UNVERIFIED)),
        ),
        physical=physical_notes(result.record),
    )
    write_text(paths["header"], header)
    write_text(paths["report"], run_page(result))
    hashed = [path for path in paths.values() if path.name in saved_run.HASHED]
    hashes = {path.name: saved_run.digest(path) for path in hashed}
    data = {
        "schema": saved_run.SCHEMA,
        **result.to_json(),
        saved_run.HASHES: hashes,
        saved_run.VEHICLE: result.settings.vehicle.fingerprint,
        saved_run.DOCUMENT: result.settings.vehicle.document,
    }
    write_text(paths["result"], json.dumps(data, indent=2) + "\n")


def write_page(
    out: Path | None,
    stem: str,
    texts: Mapping[str, tuple[str, Callable[[], str]]],
    data: Mapping[str, Any],
) -> dict[str, Any]:
    """Write texts and numbers, and return the numbers with the names of the files.

    Args:
        out: folder, or None for no files.
        stem: stem of every file's name.
        texts: suffix and function that makes the text, by the file's key in the result.
        data: the numbers, written as JSON.

    Raises:
        CanrollError: a file cannot be written.
    """
    files = {}
    if out is not None:
        made = {**texts, "result": (".json", lambda: json.dumps(data, indent=2) + "\n")}
        files = {
            name: str(write_text((out / stem).with_suffix(suffix), text()))
            for name, (suffix, text) in made.items()
        }
    return {**data, **({"files": files} if files else {})}
