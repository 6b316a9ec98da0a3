"""Translations kept between runs: proving and translating the firmware takes seconds.

A translation is named by a hash of all that makes it: the firmware, the translator, the modules of
a bus or stage. Where there is no cache it is made anew in each process.
"""

import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

import firmware
from canroll import build_cache

FIRMWARE = Path(firmware.__file__).parent
TRANSLATOR = Path(__file__).resolve().parents[1]


@cache
def _stamp() -> bytes:
    """Return the hash of the firmware as checked in and of its translator."""
    digest = hashlib.sha256(sys.version.encode())
    for folder in (FIRMWARE, TRANSLATOR):
        for path in sorted((*folder.rglob("*.py"), *folder.rglob("*.h"))):
            digest.update(path.read_bytes())
    return digest.digest()


def translation(parts: object, make: Callable[[], dict[str, str]]) -> dict[str, str]:
    """Return what ``make`` returns, texts by file name, or what it returned before.

    Args:
        parts: all that it makes them from beside the firmware and the translator; its ``repr``
            tells any two apart.
        make: translates; its errors are raised each time.
    """
    key = hashlib.sha256(_stamp() + repr(parts).encode()).hexdigest()
    path = build_cache.place("c99", f"{key[:32]}.json")
    with suppress(OSError, ValueError):
        kept: dict[str, str] = json.loads(path.read_text(encoding="utf-8"))
        return kept
    made = make()
    with suppress(OSError), tempfile.TemporaryDirectory(dir=path.parent) as temporary:
        written = Path(temporary, path.name)
        written.write_text(json.dumps(made), encoding="utf-8")
        os.replace(written, path)
    return made
