"""Replacement of a folder's files as a whole: all or none.

They are written to a temporary folder beside it and moved at the end. The key file, without which
the folder is not valid, is removed first and moved last, so that a process killed in between leaves
either the older files or an invalid folder.
"""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from canroll.errors import CanrollError, reason

PART = ".canroll-part-"


@contextmanager
def replaced(folder: Path, key: str) -> Iterator[Path]:
    """Yield an empty folder whose files replace those of ``folder`` unless an error occurs.

    Args:
        folder: folder of the files.
        key: name of the key file, without which the others are not valid.

    Raises:
        CanrollError: another process writes to it, or it cannot be written.
    """
    try:
        with _locked(folder), tempfile.TemporaryDirectory(prefix=PART, dir=folder) as part:
            yield Path(part)
            (folder / key).unlink(missing_ok=True)
            names = {path.name for path in Path(part).iterdir()}
            for name in (*sorted(names - {key}), key):
                os.replace(Path(part) / name, folder / name)
    except OSError as error:
        raise CanrollError(f"cannot write to {folder}: {reason(error)}") from error


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    # the folder itself is locked: no file of a lock to leave; the system drops that of the dead
    held = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise CanrollError(
                f"another canroll writes to {folder}: choose another --out"
            ) from None
        for killed in folder.glob(f"{PART}*"):
            shutil.rmtree(killed)
        yield
    finally:
        os.close(held)
