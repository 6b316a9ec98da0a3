"""C linkage: names, public, shared and static symbols, volatile arrays."""

import ast
from dataclasses import dataclass

from codegen.proof.prove import entry_points
from codegen.subset.program import Constant, Function, Module, Program, calls

Key = tuple[str, str]


@dataclass(frozen=True, slots=True)
class Linkage:
    """``public``: entry points with the short C names that callers see; ``reachable``: what they
    call; ``shared``: functions and constants that more than their own module uses; ``volatile``:
    array parameters that are somewhere given a field an interrupt may write.
    """

    public: dict[Key, str]
    reachable: frozenset[Key]
    shared: frozenset[Key]
    volatile: frozenset[tuple[Key, str]]


@dataclass(frozen=True, slots=True)
class Names:
    """The C names of a program; ``public`` are those of the entry points."""

    program: Program
    public: dict[Key, str]

    def function(self, function: Function) -> str:
        """The C name of a function."""
        return self.public.get(function.key, f"canroll_{function.module}_{function.name}")

    def constant(self, constant: Constant) -> str:
        """The C name of a constant, with its module where another has the same."""
        homes = [m for m in self.program.modules.values() if constant.name in m.constants]
        middle = f"{constant.module}_" if len(homes) > 1 or constant.type.shape else ""
        name = f"canroll_{middle}{constant.name}"
        return name.lower() if constant.type.shape else name.upper()


def linkage(program: Program) -> Linkage:
    """Return the linkage of ``program``."""
    public = {f.key: f"canroll_{f.name}" for f in entry_points(program)}
    reachable = _reachable(program, public)
    return Linkage(public, reachable, _shared(program, public, reachable), _volatile(program))


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
        for node in ast.walk(ast.Module(bodies, [])):
            if isinstance(node, ast.Name | ast.Attribute):
                found |= _foreign(program, module, node)
        if module.records:
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


def _volatile(program: Program) -> frozenset[tuple[Key, str]]:
    found: set[tuple[Key, str]] = set()
    grown = True
    while grown:
        before = len(found)
        for function in program.functions():
            for node in ast.walk(function.node):
                if isinstance(node, ast.Call):
                    found |= _volatile_arguments(program, function, node, found)
        grown = len(found) > before
    return frozenset(found)


def _volatile_arguments(
    program: Program, function: Function, node: ast.Call, found: set[tuple[Key, str]]
) -> set[tuple[Key, str]]:
    called = program.function(program.modules[function.module], node.func)
    if called is None:
        return set()
    pairs = zip(called.parameters.items(), node.args, strict=True)
    return {
        (called.key, name)
        for (name, its), argument in pairs
        if its.shape and _is_volatile(program, function, argument, found)
    }


def _is_volatile(
    program: Program, function: Function, node: ast.expr, found: set[tuple[Key, str]]
) -> bool:
    while isinstance(node, ast.Subscript):
        node = node.value
    if isinstance(node, ast.Name):
        return (function.key, node.id) in found
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        owner = function.parameters.get(node.value.id)
        if owner is not None and owner.kind == "record":
            return program.record(owner.record).fields[node.attr].volatile
    return False
