"""C linkage: names, public, shared and static symbols, volatile arrays."""

import ast
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Literal

from canroll.codegen.proof.prove import entry_points
from canroll.codegen.subset.program import (
    RUNTIME,
    Constant,
    FieldReference,
    Function,
    Parameter,
    Program,
    Ref,
)

PUBLIC_NUMBERS = "frames"
"""Module whose constants the users of the entry points need."""
PUBLIC_TABLES = "signals"
"""The module whose tables callers see."""

Key = tuple[str, str]
Home = Literal["header", "source", "none"] | Key
"""Where a constant is declared: for the users of a module, in it, nowhere, in one function."""


@dataclass(frozen=True, slots=True)
class Linkage:
    """C linkage of a program: which symbols are public, shared or static.

    Attributes:
        public: entry points with the short C names that callers see.
        reachable: functions they call, directly or not.
        shared: functions and constants used outside their own module.
        volatile: array parameters that receive a field which an interrupt may write.
        open: array parameters passed in by callers of entry points, which may be shorter than
            declared.
        homes: where each constant is declared: a table in the only function that uses it; a table
            of the header is defined in the source.
        unit: modules that are one file in C, that of the first entry module.
    """

    public: dict[Key, str]
    reachable: frozenset[Key]
    shared: frozenset[Key]
    volatile: frozenset[tuple[Key, str]]
    open: frozenset[tuple[Key, str]]
    homes: Mapping[Key, Home]
    unit: frozenset[str]


@dataclass(frozen=True, slots=True)
class Names:
    """The C names of a program; ``public`` holds those of the entry points."""

    program: Program
    public: dict[Key, str]

    def function(self, function: Function) -> str:
        """The C name of a function."""
        return self.public.get(function.key, f"canroll_{function.module}_{function.name}")

    def constant(self, constant: Constant) -> str:
        """The C name of a constant, with its module's name where another module has the same."""
        if constant.module == RUNTIME:
            return constant.name.replace("I32", "INT32").replace("I64", "INT64")
        homes = [m for m in self.program.modules.values() if constant.name in m.constants]
        middle = f"{constant.module}_" if len(homes) > 1 or constant.type.shape else ""
        name = f"canroll_{middle}{constant.name}"
        return name.lower() if constant.type.shape else name.upper()


def linkage(program: Program, unit: frozenset[str] = frozenset()) -> Linkage:
    """Return the linkage of ``program``, in which the modules of ``unit`` are one file."""
    public = {f.key: public_name(program, f) for f in entry_points(program)}
    reached = reachable(program, public)
    users = _users(program, reached)
    shared = set(public) | {
        key
        for key, functions in users.items()
        if any(f[0] != key[0] and not unit.issuperset((f[0], key[0])) for f in functions)
    }
    for module in program.modules.values():
        if module.records or module.name == PUBLIC_NUMBERS:
            shared |= {(module.name, name) for name in module.constants}
    given = {
        (function.key, name)
        for function in program.functions()
        if function.key in public
        for name, its in function.parameters.items()
        if its.shape
    }
    homes = {
        (constant.module, constant.name): _home(constant, shared, users)
        for module in program.modules.values()
        for constant in module.constants.values()
    }
    volatile = _passed_on(program, set(), _is_volatile)
    opened = _passed_on(program, given, lambda ref: False)
    return Linkage(public, reached, frozenset(shared), volatile, opened, homes, unit)


def public_name(program: Program, function: Function) -> str:
    """``canroll_init`` of the first entry module, ``canroll_xcp_init`` of the service ``xcp``."""
    service = f"{function.module}_" if function.module in program.entries[1:] else ""
    return f"canroll_{service}{function.name}"


def _users(program: Program, reachable: frozenset[Key]) -> dict[Key, set[Key]]:
    """The reachable functions that use each function and constant."""
    users: dict[Key, set[Key]] = {}
    for function in program.functions():
        if function.key in reachable:
            for _, ref in program.references(function):
                if isinstance(ref, Function | Constant):
                    users.setdefault((ref.module, ref.name), set()).add(function.key)
    return users


def _home(constant: Constant, shared: Collection[Key], users: Mapping[Key, set[Key]]) -> Home:
    key = (constant.module, constant.name)
    table = bool(constant.type.shape)
    if key in shared or (table and constant.module == PUBLIC_TABLES):
        return "header"
    if not table:
        return "source"
    functions = users.get(key, set())
    if not functions:
        return "none"
    only = next(iter(functions))
    return only if len(functions) == 1 and only[0] == constant.module else "source"


def reachable(program: Program, public: Collection[Key]) -> frozenset[Key]:
    """The functions that those of ``public`` call, directly or not, and these themselves."""
    todo = [f for f in program.functions() if f.key in public]
    found = set()
    while todo:
        function = todo.pop()
        if function.key not in found:
            found.add(function.key)
            todo += program.calls(function)
    return frozenset(found)


def _passed_on(
    program: Program, found: set[tuple[Key, str]], begins: Callable[[Ref], bool]
) -> frozenset[tuple[Key, str]]:
    """``found`` with all array parameters that receive one of them or satisfy ``begins``."""
    passed = [
        ((called.key, name), function.key, program.refs[argument])
        for function in program.functions()
        for node, called in program.references(function)
        if isinstance(node, ast.Call) and isinstance(called, Function)
        for (name, its), argument in zip(called.parameters.items(), node.args, strict=True)
        if its.shape
    ]
    before = -1
    while before < len(found):
        before = len(found)
        for taken, function, given in passed:
            further = isinstance(given, Parameter) and (function, given.name) in found
            if further or begins(given):
                found.add(taken)
    return frozenset(found)


def _is_volatile(ref: Ref) -> bool:
    return isinstance(ref, FieldReference) and ref.field.volatile
