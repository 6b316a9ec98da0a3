"""Where compiled code is kept between runs: ``$XDG_CACHE_HOME/canroll``, ``~/.cache/canroll``.

A read-only cache is still read. Whatever it lacks, or everything where there is no cache, is
compiled into a private folder that is removed when the process ends.
The same holds where another user owns the cache or anyone may write to it: code from there would
run as this user.
"""

import atexit
import os
import shutil
import stat
import tempfile
from functools import cache
from pathlib import Path


def folder(name: str) -> Path:
    """Return the cache folder ``name``, created if missing; it may be read-only."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    kept = home / "canroll" / name
    try:
        kept.mkdir(parents=True, exist_ok=True)
    except OSError:
        return private(name)
    return kept if _is_safe(kept.parent) and _is_safe(kept) else private(name)


def _is_safe(kept: Path) -> bool:
    """Whether only this user, or root, controls the contents of a folder."""
    about = kept.stat()
    return about.st_uid in (0, os.geteuid()) and not about.st_mode & stat.S_IWOTH


def place(name: str, file: str) -> Path:
    """Return the path of ``file`` in the cache folder ``name``, else in a private folder."""
    kept = folder(name)
    shared = kept / file
    return shared if shared.exists() or os.access(kept, os.W_OK) else private(name) / file


@cache
def private(name: str) -> Path:
    """Return a temporary folder that is removed when the process ends."""
    made = Path(tempfile.mkdtemp(prefix=f"canroll-{name}-"))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    return made
