"""A folder's files replaced together: whole or not at all.

They are written beside their place and moved there at the end. The file that makes the folder what
it is goes first of the old ones and comes last of the new ones, so that a process killed in between
leaves the older files, or a folder that is none.
"""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from canroll.errors import CanrollError

PART = ".canroll-part-"


@contextmanager
def replaced(folder: Path, key: str) -> Iterator[Path]:
    """Give an empty folder, whose files go to ``folder`` at the end; an error leaves it as it was.

    Args:
        folder: of the files.
        key: name of the file without which the others count for nothing.

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
        raise CanrollError(f"cannot write to {folder}: {error.strerror}") from error


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
