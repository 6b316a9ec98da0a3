"""Chunks of a campaign by which an engine is tried: of numbers, of failure, of death.

Processes import them from here by name. The module of a test they may not find: pya2l puts its own
folder on the path, where a package "tests" hides ours.
"""

import os
import signal
from pathlib import Path

import numpy as np

from canroll.errors import CanrollError
from hil.campaign import store
from hil.campaign.engine import Engine, results
from hil.campaign.plan import Columns
from hil.campaign.store import Store

CHUNKS = 12
DIGEST = "0" * 64


def work(chunk: int, grave: str | None = None) -> Columns:
    """Return a chunk of some numbers; with ``grave`` the first to come to chunk 5 dies."""
    if grave is not None and chunk == 5 and not Path(grave).exists():
        Path(grave).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    random = np.random.default_rng(chunk)
    return {"draw": np.arange(4) + 4 * chunk, "figure": random.random(4)}


def fails(chunk: int) -> Columns:
    """Fail."""
    raise CanrollError(f"chunk {chunk} cannot be")


def opened(folder: Path, *, resume: bool = False) -> Store:
    """Return the store of a campaign in ``folder``."""
    return store.opened(folder / "campaign", DIGEST, {}, resume=resume)


def joined(kept: Store, where: Engine, *arguments: str) -> bytes:
    """Drive all chunks and return the bytes of the table."""
    tasks = [(store.chunk_name(n), work, (n, *arguments)) for n in range(CHUNKS)]
    names = [name for name, _, _ in results(where, kept, tasks)]
    assert names == [name for name, _, _ in tasks]
    path = store.table_of(kept.folder)
    kept.join(names, path)
    return path.read_bytes()
