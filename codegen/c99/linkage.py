"""C linkage: names, public, shared and static symbols, volatile arrays."""

import ast
from collections.abc import Callable
from dataclasses import dataclass

from codegen.proof.prove import entry_points
from codegen.subset.program import Constant, Function, Module, Program, calls
from codegen.subset.walk import walk

PUBLIC_NUMBERS = "frames"
"""Module whose constants the users of the entry points need."""
PUBLIC_TABLES = "signals"
"""The module whose tables callers see."""

Key = tuple[str, str]
Begin = Callable[[Program, Function, ast.expr], bool]


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
        homes: the only function that uses a table, in which the table is then declared.
        idle: tables that no function uses, which are left out.
    """

    public: dict[Key, str]
    reachable: frozenset[Key]
    shared: frozenset[Key]
    volatile: frozenset[tuple[Key, str]]
    open: frozenset[tuple[Key, str]]
    homes: dict[Key, Key]
    idle: frozenset[Key]


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
        homes = [m for m in self.program.modules.values() if constant.name in m.constants]
        middle = f"{constant.module}_" if len(homes) > 1 or constant.type.shape else ""
        name = f"canroll_{middle}{constant.name}"
        return name.lower() if constant.type.shape else name.upper()


def linkage(program: Program) -> Linkage:
    """Return the linkage of ``program``."""
    public = {f.key: _public_name(program, f) for f in entry_points(program)}
    reachable = _reachable(program, public)
    shared = _shared(program, public, reachable)
    given = {
        (function.key, name)
        for function in program.functions()
        if function.key in public
        for name, its in function.parameters.items()
        if its.shape
    }
    volatile = _passed_on(program, set(), _is_volatile)
    used = _users(program, reachable)
    hidden = {
        (module.name, name)
        for module in program.modules.values()
        for name, constant in module.constants.items()
        if constant.type.shape and module.name != PUBLIC_TABLES
    } - shared
    homes = {
        table: next(iter(functions))
        for table, functions in used.items()
        if len(functions) == 1 and table in hidden
    }
    idle = frozenset(hidden - used.keys())
    opened = _passed_on(program, given, _never)
    return Linkage(public, reachable, shared, volatile, opened, homes, idle)


def _public_name(program: Program, function: Function) -> str:
    """``canroll_init`` of the first entry module, ``canroll_xcp_init`` of the service ``xcp``."""
    service = f"{function.module}_" if function.module in program.entries[1:] else ""
    return f"canroll_{service}{function.name}"


def _users(program: Program, reachable: frozenset[Key]) -> dict[Key, set[Key]]:
    """The functions that use each table, by table."""
    users: dict[Key, set[Key]] = {}
    for function in program.functions():
        if function.key not in reachable:
            continue
        module = program.modules[function.module]
        for node in walk(function.node):
            if isinstance(node, ast.Name | ast.Attribute):
                constant = program.constant(module, node)
                if constant is not None and constant.type.shape:
                    users.setdefault((constant.module, constant.name), set()).add(function.key)
    return users


def _reachable(program: Program, public: dict[Key, str]) -> frozenset[Key]:
    todo = [f for f in program.functions() if f.key in public]
    found = set()
    while todo:
        function = todo.pop()
        if function.key not in found:
            found.add(function.key)
            todo += calls(program, function)
    return frozenset(found)


def _shared(program: Program, public: dict[Key, str], reachable: frozenset[Key]) -> frozenset[Key]:
    found = set(public)
    for module in program.modules.values():
        bodies: list[ast.stmt] = [f.node for f in module.functions.values() if f.key in reachable]
        for node in walk(ast.Module(bodies, [])):
            if isinstance(node, ast.Name | ast.Attribute):
                found |= _foreign(program, module, node)
        if module.records or module.name == PUBLIC_NUMBERS:
            found |= {(module.name, name) for name in module.constants}
    return frozenset(found)


def _foreign(program: Program, module: Module, node: ast.expr) -> set[Key]:
    """The function or constant of another module that ``node`` names."""
    function = program.function(module, node)
    if function is not None and function.module != module.name:
        return {function.key}
    constant = program.constant(module, node)
    if constant is not None and constant.module != module.name:
        return {(constant.module, constant.name)}
    return set()


def _passed_on(
    program: Program, found: set[tuple[Key, str]], begins: Begin
) -> frozenset[tuple[Key, str]]:
    """``found`` with all array parameters that receive one of them or satisfy ``begins``."""
    grown = True
    while grown:
        before = len(found)
        for function in program.functions():
            for node in walk(function.node):
                if isinstance(node, ast.Call):
                    found |= _arguments(program, function, node, found, begins)
        grown = len(found) > before
    return frozenset(found)


def _arguments(
    program: Program,
    function: Function,
    node: ast.Call,
    found: set[tuple[Key, str]],
    begins: Begin,
) -> set[tuple[Key, str]]:
    called = program.function(program.modules[function.module], node.func)
    if called is None:
        return set()
    arguments = zip(called.parameters.items(), node.args, strict=True)
    return {
        (called.key, name)
        for (name, its), argument in arguments
        if its.shape
        and (_base(function, argument) in found or begins(program, function, _array(argument)))
    }


def _array(node: ast.expr) -> ast.expr:
    """The array of which ``node`` is an element or a row."""
    while isinstance(node, ast.Subscript):
        node = node.value
    return node


def _base(function: Function, node: ast.expr) -> tuple[Key, str] | None:
    array = _array(node)
    return (function.key, array.id) if isinstance(array, ast.Name) else None


def _is_volatile(program: Program, function: Function, node: ast.expr) -> bool:
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        owner = function.parameters.get(node.value.id)
        if owner is not None and owner.kind == "record":
            return program.record(owner.record).fields[node.attr].volatile
    return False


def _never(program: Program, function: Function, node: ast.expr) -> bool:
    return False
