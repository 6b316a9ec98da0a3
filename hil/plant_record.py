"""Record of a plant process for its parent: one NumPy archive."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.errors import reading
from canroll.hil.hardware.bus_record import ENTRY
from canroll.plant_sim.world import archive
from canroll.plant_sim.world.spool import Table
from canroll.runs.trace import Signals, restored


@dataclass(frozen=True, slots=True)
class PlantRecord:
    """A plant's run: vehicle signals, bus log, applied commands, instants of its loop.

    ``about``: reason, start_ns, end_ns, sent, received, failed, cpu, notes, bus; ``bus``:
    everything on the real bus (:data:`canroll.hil.hardware.bus_record.ENTRY`).
    """

    signals: Signals
    frames: Table
    ages: NDArray[np.int64]
    commands: NDArray[np.void]
    loop: NDArray[np.int64]
    about: Mapping[str, Any]
    bus: NDArray[np.void] = field(default_factory=lambda: np.zeros(0, ENTRY))


def load(path: Path) -> PlantRecord:
    """Read a plant's archive.

    Raises:
        CanrollError: it cannot be read.
    """
    with reading(path), archive.Archive(path) as stored:
        return restored(PlantRecord, stored)
