"""What decides a row, whichever machine drives it: as plain data, and its fingerprint."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from canroll.codegen.run.memory_image import image
from canroll.dbc.reader import each
from canroll.plant_sim.can_bus import load_profile
from canroll.runs.result import Run
from canroll.setup.controller import Controller


def identity(
    settings: Run,
    controller: Controller,
    *,
    buses: Iterable[str] = (),
    others: Iterable[object] = (),
) -> dict[str, Any]:
    """Return everything that decides a run as plain data.

    Args:
        settings: settings of the run.
        controller: its controller.
        buses: profiles that may be driven instead of that of the settings.
        others: further values that may be set; files named by them are read.
    """
    return {
        "canroll": version("canroll"),
        "scenario": settings.scenario,
        **settings.choices(),
        "phase_ms": None if settings.phase is None else 1e3 * settings.phase,
        "vehicle_fingerprint": settings.vehicle.fingerprint,
        "calibration": hashlib.sha256(image(controller.record)).hexdigest(),
        "stage": None
        if settings.stage is None
        else hashlib.sha256(settings.stage.source.encode()).hexdigest(),
        "files": _files(settings, buses, others),
    }


def fingerprint(description: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a description."""
    text = json.dumps(description, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def _files(settings: Run, buses: Iterable[str], others: Iterable[object]) -> list[list[str]]:
    """Return name and hash of each file that a run may read, wherever it is on this machine."""
    buses = (settings.bus, *buses)
    texts = [settings.key, settings.plant, *buses, *dict(settings.options).values(), *others]
    paths = {Path(part) for text in texts if isinstance(text, str) for part in text.split("#")}
    paths |= {path.with_suffix(".toml") for path in paths if path.suffix == ".fmu"}
    for bus in buses:
        profile = load_profile(bus, settings.dbc, settings.map)
        traffic = (segment.traffic for segment in profile.network.segments)
        frames = () if profile.dbc is None else each(profile.dbc)
        paths |= {path for path in (*frames, profile.map_file, *traffic) if path is not None}
    return sorted(
        [path.name, hashlib.sha256(path.read_bytes()).hexdigest()]
        for path in paths
        if path.is_file()
    )
