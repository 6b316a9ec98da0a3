"""Output files: checked before the work, replaced all or none.

The files of a folder are replaced all or none: they are written to a temporary folder next to it
and moved at the end. The key file, without which the folder is not valid, is removed first and
moved last, so that a process killed in between leaves either the older files or an invalid folder.
"""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from canroll.errors import CanrollError, writing

PART = ".canroll-part-"


def usable_folder(folder: Path) -> Path:
    """Return ``folder``, created if missing; called before a run, so that it is refused early.

    Raises:
        CanrollError: it cannot be made or written to.
    """
    probe = folder / ".canroll"
    with writing(f"to {folder}", "choose another --out"):
        folder.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    return folder


def page_folder(folder: Path | None) -> Path | None:
    """Return the folder of a page, created if missing; None if no files are written."""
    return None if folder is None else usable_folder(folder)


def check_parent(path: Path, *, out: Path | None = None) -> Path:
    """Return ``path`` if it can be written, or its folder is ``out``, which is created.

    Raises:
        CanrollError: there is no such folder, ``path`` is a folder, or it cannot be written.
    """
    if path.parent != out and not path.parent.is_dir():
        raise CanrollError(f"cannot write {path}: no such folder {path.parent}")
    if path.is_dir():
        raise CanrollError(f"cannot write {path}: it is a folder")
    if path.parent.is_dir():
        known = path.exists()
        with writing(path):
            path.open("ab").close()
            if not known:
                path.unlink()
    return path


@contextmanager
def replaced(folder: Path, key: str) -> Iterator[Path]:
    """Yield an empty folder whose files replace those of ``folder`` unless an error occurs.

    Args:
        folder: folder of the files.
        key: name of the key file, without which the others are not valid.

    Raises:
        CanrollError: another process writes to it, or it cannot be written.
    """
    with (
        writing(f"to {folder}"),
        _locked(folder),
        tempfile.TemporaryDirectory(prefix=PART, dir=folder) as part,
    ):
        yield Path(part)
        (folder / key).unlink(missing_ok=True)
        names = {path.name for path in Path(part).iterdir()}
        for name in (*sorted(names - {key}), key):
            os.replace(Path(part) / name, folder / name)


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
