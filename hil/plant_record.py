"""Record of a plant process for its parent: one NumPy archive."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll import documents
from canroll.errors import reading, writing
from hil.hardware.bus_record import ENTRY
from hil.plant_loop import PlantOutcome
from plant_sim.world import archive
from plant_sim.world.spool import Table
from plant_sim.world.world import World


@dataclass(frozen=True, slots=True)
class PlantRecord:
    """A plant's run: vehicle signals, bus log, applied commands, instants of its loop.

    ``about``: reason, start_ns, end_ns, sent, received, failed, cpu, notes, bus; ``bus``:
    everything on the real bus (:data:`hil.hardware.bus_record.ENTRY`).
    """

    signals: Mapping[str, NDArray[np.float64]]
    frames: Table
    ages: NDArray[np.int64]
    commands: NDArray[np.void]
    loop: NDArray[np.int64]
    about: Mapping[str, Any]
    bus: NDArray[np.void] = field(default_factory=lambda: np.zeros(0, ENTRY))


def save(
    path: Path,
    world: World,
    outcome: PlantOutcome,
    about: Mapping[str, Any],
    bus: NDArray[np.void],
) -> None:
    """Write the records of ``world`` and the frames of the real ``bus``.

    Raises:
        CanrollError: the file cannot be written.
    """
    signals = world.signals
    with writing(path):
        archive.write(
            path,
            {
                "names": np.array(list(signals)),
                "signals": signals,
                "frames": world.frames,
                "ages": world.ages,
                "commands": world.commands,
                "loop": outcome.loop,
                "bus": bus,
                "about": np.array(json.dumps(dict(about))),
            },
            compressed=False,
        )


def load(path: Path) -> PlantRecord:
    """Read a plant's archive.

    Raises:
        CanrollError: it cannot be read.
    """
    with reading(path), archive.Archive(path) as stored:
        names = [str(name) for name in stored.array("names")]
        return PlantRecord(
            signals=stored.signals("signals", names),
            frames=stored.rows("frames"),
            ages=stored.array("ages"),
            commands=stored.array("commands"),
            loop=stored.array("loop"),
            about=documents.parse_json(str(stored.array("about"))),
            bus=stored.array("bus"),
        )
