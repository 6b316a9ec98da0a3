"""Loading of extensions: third-party code, by name or from a file, with one-line errors.

An extension is referred to by an entry point of an installed package, as "module:name", or as
"file.py:name" for a file outside any package.
"""

import ast
import hashlib
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import wraps
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from inspect import getdoc, signature
from pathlib import Path
from traceback import extract_tb
from types import ModuleType
from typing import Any, TypeVar

from canroll.errors import CanrollError

Function = TypeVar("Function", bound=Callable[..., Any])
RENAMED = ("codegen", "dbc", "firmware", "gain_gen", "hil", "plant_sim", "vehicles")
"""Packages that were beside canroll before version 1.0."""


def is_reference(text: object) -> bool:
    """Whether ``text`` is written as "file.py:name" or "module:name"."""
    return isinstance(text, str) and ":" in text


def load(what: str, reference: str) -> Any:  # noqa: ANN401
    """Return what "file.py:name" or "module:name" refers to.

    Args:
        what: kind of object, such as "law", for error messages.
        reference: a file is relative to the current folder and can import modules of its folder.

    Raises:
        CanrollError: no such file, module or name, or its import fails.
    """
    where, _, name = reference.rpartition(":")
    if not where or not name.isidentifier() or not reference.isprintable():
        raise CanrollError(f"{what} '{reference}': write it as file.py:name or module:name")
    with refusing(f"{what} '{reference}'"):
        module = _from_file(Path(where)) if where.endswith(".py") else import_module(where)
    if not hasattr(module, name):
        file = module.__file__ or where
        raise CanrollError(f"{what} '{reference}': {file} defines no '{name}'")
    return getattr(module, name)


def _from_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise CanrollError(f"{path}: no such file")
    path = path.resolve()
    key = f"canroll_file_{hashlib.sha256(str(path).encode()).hexdigest()[:16]}"
    if key in sys.modules:
        return sys.modules[key]
    spec = spec_from_file_location(key, path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    if str(path.parent) not in sys.path:
        # last, so that no file of its folder hides an installed package
        sys.path.append(str(path.parent))
    sys.modules[key] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[key]
        raise
    return module


@contextmanager
def refusing(what: str) -> Iterator[None]:
    """Convert any exception raised inside to a one-line :class:`CanrollError` about ``what``.

    The message names the file and line of the error; a :class:`VerdictError` passes unchanged.
    """
    try:
        yield
    except CanrollError as error:
        if error.exit_code != CanrollError.exit_code or str(error).startswith(what):
            raise
        raise CanrollError(f"{what}: {error}") from error
    except (Exception, SystemExit) as error:
        raise CanrollError(f"{what}: {_explained(error)}") from error


def _explained(error: BaseException) -> str:
    """Return type, first line and location of an error."""
    reason = " ".join(str(error).split())
    name = type(error).__name__
    text = f"{name}: {reason}" if reason else name
    if isinstance(error, ModuleNotFoundError) and error.name in RENAMED:
        text += f": it is canroll.{error.name}"
    if isinstance(error, SyntaxError | ModuleNotFoundError):
        return text  # the first says its place itself, the second has none
    frames = [frame for frame in extract_tb(error.__traceback__) if _is_foreign(frame.filename)]
    return f"{frames[-1].filename}, line {frames[-1].lineno}: {text}" if frames else text


_OURS = Path(__file__).parent


def _is_foreign(filename: str) -> bool:
    """Whether a stack frame belongs to an extension, not to canroll or its dependencies."""
    path = Path(filename)
    if filename.startswith("<") or not path.is_absolute():
        return False
    return path.is_file() and not path.is_relative_to(_OURS)


def guarded(what: str, function: Function, arguments: int, returns: type) -> Function:
    """Wrap an extension's ``function`` so that each call checks its errors and result type.

    Args:
        what: kind of object, for error messages.
        function: the extension's function.
        arguments: number of positional arguments it is called with.
        returns: expected type of its result.

    Raises:
        CanrollError: it is not callable, or not with that many arguments.
    """
    if not callable(function):
        raise CanrollError(f"{what}: a {type(function).__name__}, it must be a function")
    try:
        signature(function).bind(*range(arguments))
    except TypeError as error:
        raise CanrollError(
            f"{what}: {place_of(function)}takes {signature(function)}, it is called with "
            f"{arguments} argument{'s' if arguments > 1 else ''}"
        ) from error

    @wraps(function)
    def call(*args: Any, **options: Any) -> Any:  # noqa: ANN401
        with refusing(what):
            result = function(*args, **options)
        if not isinstance(result, returns):
            raise CanrollError(
                f"{what}: {place_of(function)}returns a {type(result).__name__}, it must be a "
                f"{returns.__name__}"
            )
        return result

    return call  # type: ignore[return-value]


def place_of(function: Any) -> str:  # noqa: ANN401
    """Return "FILE, line N: " for a function, or "" if it has no source file."""
    code = getattr(function, "__code__", None)
    return f"{code.co_filename}, line {code.co_firstlineno}: " if code is not None else ""


def described(module: str, name: str) -> str:
    """Return the first documentation line of ``name`` in ``module`` without importing it.

    For a function this is its docstring, for a constant the string below it; empty if there is none
    or no such module.
    """
    source = _source_of(module)
    if source is None:
        return ""
    try:
        body = ast.parse(source.read_text(encoding="utf-8")).body
    except (OSError, SyntaxError, ValueError):
        return ""
    for node, below in zip(body, [*body[1:], ast.Pass()], strict=True):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == name:
            return first_line(ast.get_docstring(node))
        if isinstance(node, ast.Assign | ast.AnnAssign) and name in _targets(node):
            is_text = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
            return first_line(below.value.value) if is_text else ""  # type: ignore[attr-defined]
    return ""


def first_line(text: Any) -> str:  # noqa: ANN401
    """Return the first line of a text, or "" for anything else."""
    return text.strip().partition("\n")[0] if isinstance(text, str) else ""


def documented(thing: object) -> str:
    """Return the first docstring line of a function, or "" for a constant."""
    return first_line(getdoc(thing)) if callable(thing) else ""


def _targets(node: ast.Assign | ast.AnnAssign) -> list[str]:
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    return [target.id for target in targets if isinstance(target, ast.Name)]


def is_installed(module: str) -> bool:
    """Whether a module can be found; none of its parent packages is imported."""
    return module.partition(".")[0] in sys.builtin_module_names or _source_of(module) is not None


def _source_of(module: str) -> Path | None:
    """Return the source file of a module without importing it or its parent packages."""
    within: Sequence[str] | None = None
    spec = None
    parts = module.split(".")
    for depth in range(1, len(parts) + 1):
        name = ".".join(parts[:depth])
        spec = None
        for finder in sys.meta_path:
            with suppress(ImportError):
                spec = finder.find_spec(name, within)
            if spec is not None:
                break
        if spec is None:
            return None
        within = spec.submodule_search_locations
    return Path(spec.origin) if spec is not None and spec.origin else None
