"""Numba decorators with one cache that is keyed by the source it was compiled from.

Numba's own cache only watches the file of the outermost function, so a changed callee would go
on running as it was. The cache folder is named by a hash of the whole package instead. And it
names entries by counting them, so that two processes that compile at the same time could give one
name to two functions: saving takes a lock.
"""

import fcntl
import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import cgutils
from numba.core.caching import IndexDataCacheFile
from numba.extending import intrinsic

Function = TypeVar("Function", bound=Callable[..., Any])


def _cache_folder() -> Path:
    digest = hashlib.sha256(f"{numba.__version__}".encode())
    for source in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(source.read_bytes())
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = home / "canroll" / f"numba-{digest.hexdigest()[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        folder = Path(tempfile.gettempdir()) / f"canroll-{os.getuid()}" / folder.name
        folder.mkdir(parents=True, exist_ok=True)
    return folder


FOLDER = _cache_folder()
numba.config.CACHE_DIR = str(FOLDER)
_save_unlocked = IndexDataCacheFile.save


def _save(entry: Any, key: Any, data: Any) -> None:  # noqa: ANN401
    with open(FOLDER / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        _save_unlocked(entry, key, data)


IndexDataCacheFile.save = _save


def njit(function: Function) -> Function:
    """Compile to machine code, cached between processes; exact IEEE arithmetic (no fastmath).

    Calls with literal arguments use the general version: Numba would compile one a literal, and
    with every caller's callees again the whole plant more than twice as long.
    """
    compiled: Any = numba.njit(cache=True)(function)
    resolve = compiled.get_call_template

    def resolve_general(args: Any, kws: Any) -> Any:  # noqa: ANN401
        general = tuple(numba.types.unliteral(a) for a in args)
        return resolve(general, {k: numba.types.unliteral(a) for k, a in kws.items()})

    compiled.get_call_template = resolve_general
    result: Function = compiled
    return result


def cfunc(signature: Any) -> Callable[[Function], Function]:  # noqa: ANN401
    """Compile as a first-class function: kernels that take one are compiled once for all."""
    decorated: Callable[[Function], Function] = numba.cfunc(signature, cache=True)
    return decorated


_VECTOR = numba.types.Array(numba.types.float64, 1, "C")
STEP_SIGNATURE = numba.types.void(_VECTOR, _VECTOR, _VECTOR, _VECTOR, numba.types.float64)
"""Of a body's step: ``step(state, inputs, parameters, outputs, dt)``."""


@intrinsic  # type: ignore[untyped-decorator]
def step_at(typing_context: Any, address: Any) -> Any:  # noqa: ANN401
    """In a kernel: the body's step at ``address``, that of a C function which the caller keeps.

    To take the function itself costs a call from Python more than the step does.
    """
    step = numba.types.FunctionType(STEP_SIGNATURE)

    def lower(context: Any, builder: Any, _: Any, arguments: Any) -> Any:  # noqa: ANN401
        value = cgutils.create_struct_proxy(step)(context, builder)
        value.c_addr = builder.inttoptr(arguments[0], cgutils.voidptr_t)
        return value._getvalue()

    return step(numba.types.int64), lower
