"""Kernels and all that they call as one C99 file."""

import ast
import inspect
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from canroll.extensions.exchange.kernels.expressions import KernelScope, KernelValue
from canroll.extensions.exchange.kernels.function import KernelWriter
from canroll.extensions.exchange.kernels.kinds import (
    ArrayKind,
    KernelError,
    Kind,
    NumberKind,
    Structs,
    initialiser,
)

PRELUDE = """\
#include "kernels.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

/* Why a kernel gave up, or NULL. */
const char *kernel_error;

static inline int64_t min_int(int64_t a, int64_t b) { return b < a ? b : a; }
static inline int64_t max_int(int64_t a, int64_t b) { return b > a ? b : a; }
static inline double min_float(double a, double b) { return b < a ? b : a; }
static inline double max_float(double a, double b) { return b > a ? b : a; }

/* Quotient and remainder as of Python: rounded down, with the sign of the divisor. */
static inline int64_t floor_quotient(int64_t a, int64_t b)
{
    int64_t q = a / b;
    return a % b != 0 && (a < 0) != (b < 0) ? q - 1 : q;
}

static inline int64_t floor_remainder(int64_t a, int64_t b)
{
    int64_t r = a % b;
    return r != 0 && (r < 0) != (b < 0) ? r + b : r;
}
"""


class Translator:
    """Kernels in C, each once for every set of argument kinds that it is called with.

    ``replaced`` says which kernels are others here, or C functions that give nothing back, by name.
    """

    def __init__(self, prefix: str, replaced: Mapping[Any, Any] | None = None) -> None:
        self.structs = Structs(prefix)
        self.replaced = {_python(its): other for its, other in (replaced or {}).items()}
        self._made: dict[tuple[Any, tuple[Kind, ...]], tuple[str, Kind | None]] = {}
        self._taken: set[str] = set()
        self._functions: list[str] = []
        self._prototypes: list[str] = []
        self._tables: dict[int, tuple[np.ndarray, str]] = {}

    def entry(self, kernel: Any, kinds: Sequence[Kind], name: str) -> str:  # noqa: ANN401
        """Translate an entry point under ``name``; return its prototype."""
        self._function(kernel, tuple(kinds), name)
        return self._prototypes[-1]

    def header(self, prototypes: Sequence[str]) -> str:
        """The C header: structs and entry points."""
        lines = [f"{prototype};" for prototype in prototypes]
        head = ["#ifndef KERNELS_H", "#define KERNELS_H", "", "#include <stdint.h>", ""]
        return "\n".join([*head, *self.structs.texts, *lines, "", "#endif", ""])

    def text(self) -> str:
        """The C file."""
        tables = []
        for values, name in self._tables.values():
            kind = self.structs.stored(values.dtype)
            tables.append(f"static const {kind} {name}[{values.size}] = {initialiser(values)};\n")
        return "\n".join([PRELUDE, *tables, *self._functions])

    def _function(self, kernel: Any, kinds: tuple[Kind, ...], name: str = "") -> KernelValue:  # noqa: ANN401
        function = _python(kernel)
        key = (function, kinds)
        if key not in self._made:
            public = bool(name)
            name = name or self._named(function)
            self._made[key] = (name, None)
            self._translate(function, kinds, name, key, public=public)
        found, result = self._made[key]
        return KernelValue(result or NumberKind("int"), found)

    def _named(self, function: Callable[..., Any]) -> str:
        module = function.__module__.rpartition(".")[2]
        name = f"{module}_{function.__name__.strip('_')}"
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        return name

    def _translate(
        self,
        function: Callable[..., Any],
        kinds: tuple[Kind, ...],
        name: str,
        key: tuple[Callable[..., Any], tuple[Kind, ...]],
        *,
        public: bool,
    ) -> None:
        lines, first = inspect.getsourcelines(function)
        file = inspect.getsourcefile(function)
        tree = ast.parse(textwrap.dedent("".join(lines))).body[0]
        assert isinstance(tree, ast.FunctionDef)
        parameters = [argument.arg for argument in tree.args.args]
        closure = inspect.getclosurevars(function)
        names = {**function.__globals__, **closure.nonlocals}
        scope = KernelScope(
            variables=dict(zip(parameters, kinds, strict=True)),
            names=names,
            where=lambda node: f"{file}:{first + getattr(node, 'lineno', 1) - 1}",
            call=self._call,
            table=self._table,
            make=_nothing,
        )
        body = KernelWriter(tree, scope, self.structs)
        try:
            text = body.translate()
        except KernelError as error:
            if ":" in str(error):
                raise
            raise KernelError(f"{file}:{first}: {function.__name__}: {error}") from error
        result = body.result
        self._made[key] = (name, result)
        kept = self.structs.c(result) if result is not None else "void"
        given = ", ".join(
            f"{self.structs.c(kind)} {parameter}_"
            for parameter, kind in zip(parameters, kinds, strict=True)
        )
        head = f"{'' if public else 'static '}{kept} {name}({given or 'void'})"
        doc = (inspect.getdoc(function) or "").partition("\n")[0]
        self._prototypes.append(head)
        comment = f"/* {function.__module__}.{function.__name__}: {doc} */\n"
        self._functions.append(comment + "\n".join([head, "{", *text, "}", ""]))

    def _call(
        self,
        kernel: Any,  # noqa: ANN401
        given: list[KernelValue],
        named: dict[str, KernelValue],
    ) -> KernelValue:
        other = self.replaced.get(_python(kernel))
        if isinstance(other, str):
            return KernelValue(
                NumberKind("int"), f"{other}({', '.join(value.c for value in given)})"
            )
        kernel = other or kernel
        function = _python(kernel)
        if not inspect.isfunction(function):
            raise KernelError(f"a call of {kernel!r}, which is no kernel")
        values = list(given)
        for parameter in list(inspect.signature(function).parameters.values())[len(given) :]:
            if parameter.name in named:
                values.append(named[parameter.name])
            else:
                default = parameter.default
                assert isinstance(default, int | float)
                kind = NumberKind("float" if isinstance(default, float) else "int")
                values.append(KernelValue(kind, f"({default})"))
        kinds = tuple(
            NumberKind("int") if value.kind == NumberKind("bool") else value.kind
            for value in values
        )
        found = self._function(kernel, kinds)
        return KernelValue(found.kind, f"{found.c}({', '.join(value.c for value in values)})")

    def _table(self, values: np.ndarray) -> KernelValue:
        key = id(values)
        if key not in self._tables:
            self._tables[key] = (values, f"table_{len(self._tables)}")
        return KernelValue(ArrayKind(values.dtype, values.shape), self._tables[key][1])


def _python(kernel: Any) -> Any:  # noqa: ANN401
    """The Python function of a kernel."""
    return getattr(kernel, "py_func", None) or getattr(kernel, "_pyfunc", None) or kernel


def _nothing(node: ast.Call) -> KernelValue:
    raise KernelError(f"an array is made outside of a function: {ast.unparse(node)}")
