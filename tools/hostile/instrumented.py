"""Guidance of the fuzzer: the functions whose control flow it sees."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FrameType, FunctionType, ModuleType

import atheris

TRACED = (
    *("canroll", "codegen", "dbc", "firmware", "gain_gen", "hil", "plant_sim", "vehicles"),
    *("can", "cantools", "elftools", "fmpy", "textparser"),
    *("ast", "csv", "json", "numpy.lib", "tomllib", "xml", "zipfile"),
)
"""Packages of ours, and those that parse for us."""


def entered(work: Callable[[], object]) -> set[str]:
    """Return the names of the modules of :data:`TRACED` whose functions ``work`` calls."""
    files: set[str] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            files.add(frame.f_code.co_filename)

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(before)
    prefixes = tuple(f"{package}." for package in TRACED)
    return {
        name
        for name, module in list(sys.modules.items())
        if f"{name}.".startswith(prefixes) and getattr(module, "__file__", None) in files
    }


def functions(module: ModuleType) -> Iterator[FunctionType]:
    """Yield the functions and methods of a module; not those that numba has compiled."""
    seen: set[int] = set()

    def inside(thing: object) -> Iterator[FunctionType]:
        if id(thing) in seen or isinstance(thing, ModuleType) or hasattr(thing, "py_func"):
            return
        seen.add(id(thing))
        if isinstance(thing, FunctionType) and thing.__module__ == module.__name__:
            yield thing
        elif isinstance(thing, staticmethod | classmethod):
            yield from inside(thing.__func__)
        elif isinstance(thing, property):
            for each in (thing.fget, thing.fset):
                yield from inside(each)
        elif isinstance(thing, type) and thing.__module__ == module.__name__:
            for each in list(vars(thing).values()):
                yield from inside(each)
        wrapped = getattr(thing, "__wrapped__", None)
        if wrapped is not None:
            yield from inside(wrapped)

    for thing in list(vars(module).values()):
        yield from inside(thing)


def instrument(read: Callable[[Path], object], first: Path, second: Path) -> int:
    """Instrument in this process what reading a good file enters; return how many functions.

    ``read`` itself is among them, wherever it comes from. ``first`` and ``second`` are copies:
    what is compiled or imported on first use is no part of reading, and readers keep what they have
    read.
    """
    read(first)
    names = sorted(entered(lambda: read(second)))
    chosen = [each for name in names for each in functions(sys.modules[name])]
    if isinstance(read, FunctionType) and read not in chosen:
        chosen.append(read)
    for each in chosen:
        code: CodeType = atheris.patch_code(each.__code__, trace_dataflow=True)
        each.__code__ = code
    return len(chosen)
