"""Numba decorators with one cache keyed by a hash of the sources.

Numba's own cache only watches the file of the outermost function, so that a changed callee would
stay outdated. The cache folder is named by a hash of the whole package instead, and of what kernels
take numbers from, independent of places and file times, which change with copies and file systems.
As Numba numbers its entries, two processes that compile at the same time could use one name for two
functions: saving takes a lock. A read-only cache is still read. Entries are kept as
:mod:`canroll.build_cache` keeps its own: what is damaged or foreign is compiled again.
"""

import ctypes
import fcntl
import hashlib
import os
import pickle
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import numba
from llvmlite import binding as llvm
from numba.core import cgutils
from numba.core.caching import CacheImpl, IndexDataCacheFile, UserProvidedCacheLocator
from numba.extending import intrinsic

from canroll import build_cache

Function = TypeVar("Function", bound=Callable[..., Any])


SOURCES = Path(__file__).resolve().parents[1]
# of the kernels, and of what constants are compiled into them from
_DIGEST = build_cache.sources("plant_sim", "vehicles", "codegen/frame", suffixes=(".py",))
FOLDER = build_cache.folder(
    f"numba-{hashlib.sha256(_DIGEST + numba.__version__.encode()).hexdigest()[:16]}"
)
numba.config.CACHE_DIR = str(FOLDER)


class _Locator(UserProvidedCacheLocator):  # type: ignore[misc]
    """Location of a function in the cache, writable or not."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Name the folder of a file: where the package stands does not change its code."""
        file = Path(py_file).resolve()
        if file.is_relative_to(SOURCES):
            return str(file.relative_to(SOURCES).parent)
        own: str = super().get_suitable_cache_subpath(py_file)
        return own

    def ensure_cache_path(self) -> None:
        with suppress(OSError):
            Path(self.get_cache_path()).mkdir(build_cache.OWN, parents=True, exist_ok=True)

    def get_source_stamp(self) -> str:
        file = Path(self._py_file).resolve()
        if file.is_relative_to(SOURCES):
            return FOLDER.name
        # of an extension: what it calls may stand in the files of its folder
        digest = hashlib.sha256(FOLDER.name.encode())
        for source in sorted(file.parent.glob("*.py")):
            digest.update(source.read_bytes())
        return digest.hexdigest()


CacheImpl._locator_classes = [_Locator, *CacheImpl._locator_classes]
_save_unlocked = IndexDataCacheFile.save


def _save(entry: Any, key: Any, data: Any) -> None:  # noqa: ANN401
    with suppress(OSError), open(FOLDER / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        _save_unlocked(entry, key, data)


def _load_index(entry: Any) -> dict[Any, str]:  # noqa: ANN401
    kept = build_cache.read(Path(entry._index_path))
    stamp, overloads = (None, {}) if kept is None else pickle.loads(kept)
    return overloads if stamp == entry._source_stamp else {}


def _save_index(entry: Any, overloads: dict[Any, str]) -> None:  # noqa: ANN401
    kept = entry._dump((entry._source_stamp, overloads))
    build_cache.write(Path(entry._index_path), kept)


def _load_data(entry: Any, name: str) -> Any:  # noqa: ANN401
    kept = build_cache.read(Path(entry._data_path(name)))
    if kept is None:
        raise OSError  # Numba compiles it again
    return pickle.loads(kept)


def _save_data(entry: Any, name: str, data: Any) -> None:  # noqa: ANN401
    build_cache.write(Path(entry._data_path(name)), entry._dump(data))


IndexDataCacheFile.save = _save
for _replaced in (_load_index, _save_index, _load_data, _save_data):
    setattr(IndexDataCacheFile, _replaced.__name__, _replaced)


def njit(function: Function, *, inline: bool = False) -> Function:
    """Compile to machine code, cached between processes; exact IEEE arithmetic (no fastmath).

    A division by zero gives inf or nan, as in C: a check before each would cost a kernel a tenth.
    Calls with literal arguments use the general version: Numba would compile one per literal, each
    with all its callees, and take more than twice as long for the whole plant.
    """
    compiled: Any = numba.njit(cache=True, error_model="numpy", forceinline=inline)(function)
    resolve = compiled.get_call_template

    def resolve_general(args: Any, kws: Any) -> Any:  # noqa: ANN401
        general = tuple(numba.types.unliteral(a) for a in args)
        return resolve(general, {k: numba.types.unliteral(a) for k, a in kws.items()})

    compiled.get_call_template = resolve_general
    result: Function = compiled
    return result


def interpreted(kernel: Function) -> Function:
    """Return the Python function of a kernel: the first compiled one of a process takes 0.5 s."""
    function: Function = kernel.py_func  # type: ignore[attr-defined]
    return function


def inlined(function: Function) -> Function:
    """As :func:`njit`, compiled into its callers: a call costs seven words for every array.

    A loop becomes vector code only where the vectors that it fills are known not to overlap with
    others. Functions are also optimised alone, where a short loop is unrolled: the function that
    makes the vector should have the loop.
    """
    return njit(function, inline=True)


def cfunc(signature: Any) -> Callable[[Function], Function]:  # noqa: ANN401
    """Compile as a first-class function: kernels that take one are compiled only once."""
    decorated: Callable[[Function], Function] = numba.cfunc(signature, cache=True)
    return decorated


def is_cached(kernel: Any) -> bool:  # noqa: ANN401
    """Whether the cache has a kernel compiled for some types."""
    file = kernel._cache._cache_file
    # the index names it before it is there
    return Path(file._data_path(file._data_name(1))).exists()


@contextmanager
def compiling(kernel: Any, types: tuple[Any, ...]) -> Iterator[None]:  # noqa: ANN401
    """Meanwhile compile a kernel for the cache in a second process, where there are two cores."""
    if (os.cpu_count() or 1) < 2:
        yield
        return
    child = os.fork()
    if not child:
        try:
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            kernel.compile(types)
        finally:
            os._exit(0)
    try:
        yield
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


_VECTOR = numba.types.Array(numba.types.float64, 1, "C")
STEP_SIGNATURE = numba.types.void(_VECTOR, _VECTOR, _VECTOR, _VECTOR, numba.types.float64)
"""Of a body's step: ``step(state, inputs, parameters, outputs, dt)``."""


def function_at(signature: Any) -> Any:  # noqa: ANN401
    """In a kernel: the C function of ``signature`` at an address, which the caller keeps alive.

    Passing the function itself would cost a call from Python more than a step of the plant does.
    """

    @intrinsic  # type: ignore[untyped-decorator]
    def at(typing_context: Any, address: Any) -> Any:  # noqa: ANN401
        function = numba.types.FunctionType(signature)

        def lower(context: Any, builder: Any, _: Any, arguments: Any) -> Any:  # noqa: ANN401
            value = cgutils.create_struct_proxy(function)(context, builder)
            value.c_addr = builder.inttoptr(arguments[0], cgutils.voidptr_t)
            return value._getvalue()

        return function(numba.types.int64), lower

    return at


step_at = function_at(STEP_SIGNATURE)
"""A body's step at an address."""


@intrinsic  # type: ignore[untyped-decorator]
def borrowed(typing_context: Any, array: Any) -> Any:  # noqa: ANN401
    """In a kernel: a view of an array that the caller keeps alive, without counted references.

    Counting takes an atomic operation for every use, up to a third of a kernel's time.
    """

    def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
        view = context.make_array(signature.args[0])(context, builder, arguments[0])
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        view.parent = cgutils.get_null_value(view.parent.type)
        return view._getvalue()

    return array(array), lower


borrowed.same = True  # for the translation to C


def record_of(dtype: Any) -> Any:  # noqa: ANN401
    """In a kernel: the record of ``dtype`` that begins a vector, whose numbers it reads by name.

    Every field is a float64 or consists of such; the caller keeps the vector alive.
    """
    record = numba.from_dtype(dtype)

    @intrinsic  # type: ignore[untyped-decorator]
    def at(typing_context: Any, vector: Any) -> Any:  # noqa: ANN401
        def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
            array = context.make_array(signature.args[0])(context, builder, arguments[0])
            return builder.bitcast(array.data, context.get_value_type(record))

        return record(vector), lower

    at.record = dtype  # for the translation to C
    return at


def stack_vector(size: int) -> Any:  # noqa: ANN401
    """In a kernel: an uninitialised vector of ``size`` that is gone when the function returns."""

    @intrinsic  # type: ignore[untyped-decorator]
    def make(typing_context: Any) -> Any:  # noqa: ANN401
        def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
            word = context.get_constant(numba.types.intp, 8)
            count = context.get_constant(numba.types.intp, size)
            number = context.get_value_type(numba.types.float64)
            vector = context.make_array(_VECTOR)(context, builder)
            context.populate_array(
                vector,
                data=cgutils.alloca_once(builder, number, size=count),
                shape=[count],
                strides=[word],
                itemsize=word,
                meminfo=None,
            )
            return vector._getvalue()

        return _VECTOR(), lower

    make.elements = size  # for the translation to C
    return make


class Linked:
    """A kernel that other kernels call by its address, to be compiled only where it is needed.

    Numba compiles a callee again into each of its callers, and the plant has many. The address is
    in a word of this process that machine code finds by the ``name``.
    """

    def __init__(self, name: str) -> None:
        self.word = ctypes.c_int64(0)
        llvm.add_symbol(name, ctypes.addressof(self.word))
        word = numba.types.int64

        @intrinsic  # type: ignore[untyped-decorator]
        def address(typing_context: Any) -> Any:  # noqa: ANN401
            def lower(context: Any, builder: Any, _: Any, arguments: Any) -> Any:  # noqa: ANN401
                kind = context.get_value_type(word)
                existing = builder.module.globals.get(name)
                place = existing or cgutils.add_global_variable(builder.module, kind, name)
                return builder.load(place)

            return word(), lower

        self.address = address


@intrinsic  # type: ignore[untyped-decorator]
def address_of(typing_context: Any, array: Any) -> Any:  # noqa: ANN401
    """In a kernel: where the numbers of an array are."""

    def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
        view = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.ptrtoint(view.data, context.get_value_type(numba.types.int64))

    return numba.types.int64(array), lower


def record_at(dtype: Any) -> Any:  # noqa: ANN401
    """In a kernel: the record of ``dtype`` at an address; see :func:`record_of`."""
    record = numba.from_dtype(dtype)

    @intrinsic  # type: ignore[untyped-decorator]
    def at(typing_context: Any, address: Any) -> Any:  # noqa: ANN401
        def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
            return builder.inttoptr(arguments[0], context.get_value_type(record))

        return record(numba.types.int64), lower

    return at
