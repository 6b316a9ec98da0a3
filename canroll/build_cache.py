"""What is kept between runs: ``$XDG_CACHE_HOME/canroll``, ``~/.cache/canroll``.

Compiled code is kept as files, results that take seconds (designs, proofs, translations) as pickles
named by a hash of all they depend on. Code from here runs as this user, and a pickle may call
anything: what another user owns or may write to is not used, nor what is not as it was kept, by a
hash of its content. Whatever the cache lacks, or everything where there is none, is made into a
private folder that is removed when the process ends. A read-only cache is still read.
``CANROLL_NO_CACHE=1`` makes all results anew, for judges.
"""

import atexit
import hashlib
import io
import os
import pickle
import platform
import shutil
import stat
import sys
import tempfile
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar

Result = TypeVar("Result")

RECENT = 64
"""Results of this process that are kept in memory as well."""
OWN, FOREIGN_WRITE = 0o700, stat.S_IWGRP | stat.S_IWOTH
ROOT = Path(__file__).resolve().parent
_recent: OrderedDict[bytes, bytes] = OrderedDict()


def folder(name: str) -> Path:
    """Return the cache folder ``name``, created if missing; it may be read-only."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    kept = home / "canroll" / name
    try:
        home.mkdir(parents=True, exist_ok=True)
        for made in (kept.parent, kept):
            made.mkdir(OWN, exist_ok=True)
    except OSError:
        return private(name)
    return kept if all(_is_own(each.stat()) for each in (kept.parent, kept)) else private(name)


def _is_own(about: os.stat_result) -> bool:
    """Whether only this user, or root, controls a file or folder."""
    return about.st_uid in (0, os.geteuid()) and not about.st_mode & FOREIGN_WRITE


def built(name: str, file: str, make: Callable[[Path], Path]) -> Path:
    """Return the path of ``file`` in the cache folder ``name``, made unless it is there whole.

    Args:
        name: of the cache folder; a private one is used where it cannot be written.
        file: with compiled code.
        make: makes it in an empty folder, and returns its path there.
    """
    target = folder(name) / file
    if _is_whole(target):
        return target
    if not os.access(target.parent, os.W_OK):
        target = private(name) / file
        if _is_whole(target):
            return target
    with tempfile.TemporaryDirectory(dir=target.parent) as temporary:
        made = make(Path(temporary))
        made.chmod(OWN)
        digest = hashlib.sha256(made.read_bytes()).digest()
        with made.open("rb") as content:
            os.fsync(content)
        os.replace(made, target)
    write(_digest_of(target), digest)
    return target


def _digest_of(path: Path) -> Path:
    return path.with_name(f"{path.name}.sha256")


def _is_whole(path: Path) -> bool:
    """Whether a file of code is there, this user's alone, and as it was kept."""
    content, digest = _content(path), read(_digest_of(path))
    return content is not None and hashlib.sha256(content).digest() == digest


@cache
def private(name: str) -> Path:
    """Return a temporary folder that is removed when the process ends."""
    made = Path(tempfile.mkdtemp(prefix=f"canroll-{name}-"))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    return made


@cache
def sources(
    *places: str,
    packages: tuple[str, ...] = (),
    suffixes: tuple[str, ...] = (".py", ".h", ".toml", ".dbc"),
) -> bytes:
    """Return a hash of our source files in folders, of Python, machine and other packages."""
    digest = hashlib.sha256(f"{sys.version} {platform.machine()}".encode())
    for package in packages:
        digest.update(f"{package} {version(package)}\n".encode())
    for each in places:
        for path in sorted((ROOT / each).rglob("*")):
            if path.suffix in suffixes:
                digest.update(f"{path.relative_to(ROOT)}\n".encode() + path.read_bytes())
    return digest.digest()


def key(*parts: object) -> bytes:
    """Return bytes that are equal for equal parts only: plain data, numbers bit for bit."""
    text = io.BytesIO()
    pickler = pickle.Pickler(text, protocol=5)
    pickler.fast = True  # by value: which parts are one object makes no difference
    pickler.dump(parts)
    return text.getvalue()


def recalled(of: bytes, make: Callable[[], Result]) -> Result:
    """Return what ``make`` returns, or a copy of what it returned before in this process.

    Args:
        of: all that the result depends on, as for :func:`kept`.
        make: makes the result; its errors are raised each time.
    """
    payload = _recent.get(of)
    if payload is not None:
        known: Result = pickle.loads(payload)
        return known
    result = make()
    with suppress(pickle.PicklingError, AttributeError, TypeError):  # an object of the user's law
        _recent[of] = pickle.dumps(result, protocol=5)
        if len(_recent) > RECENT:
            _recent.popitem(last=False)
    return result


def kept(kind: str, of: bytes, make: Callable[[], Result]) -> Result:
    """Return what ``make`` returns, or a copy of what it returned before on this machine.

    Args:
        kind: name of the cache folder.
        of: all that the result depends on, such as :func:`key` and :func:`sources`.
        make: makes the result, of which a pickle is kept; its errors are raised each time.
    """
    path = folder(kind) / f"{hashlib.sha256(of).hexdigest()}.pickle"

    def stored() -> Result:
        payload = read(path)
        if payload is not None:
            with suppress(Exception):  # a pickle may raise any: the result is made anew
                known: Result = pickle.loads(payload)
                return known
        result = make()
        write(path, pickle.dumps(result, protocol=5))
        return result

    return recalled(bytes(path) + of, make if os.environ.get("CANROLL_NO_CACHE") else stored)


def read(path: Path) -> bytes | None:
    """Return what :func:`write` kept, or None where there is none, a foreign or a damaged one."""
    content = _content(path)
    if content is None:
        return None
    size = hashlib.sha256().digest_size
    digest, payload = content[:size], content[size:]
    return payload if hashlib.sha256(payload).digest() == digest else None


def _content(path: Path) -> bytes | None:
    """Return the content of a file that only this user controls, or None."""
    with suppress(OSError), open(path, "rb", opener=_not_linked) as file:
        about = os.fstat(file.fileno())
        if stat.S_ISREG(about.st_mode) and _is_own(about):
            return file.read()
    return None


def _not_linked(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))


def write(path: Path, payload: bytes) -> None:
    """Keep bytes, all of them or none; a cache that can't be written stays as it is."""
    with suppress(OSError):
        number, name = tempfile.mkstemp(dir=path.parent)
        try:
            with open(number, "wb") as file:
                file.write(hashlib.sha256(payload).digest() + payload)
                file.flush()
                os.fsync(number)
            os.replace(name, path)
        except OSError:
            Path(name).unlink(missing_ok=True)
