"""Declarations, assignments and side effects of functions."""

import ast
from collections.abc import Mapping

from codegen.subset.program import Function, Program


def local_kinds(function: Function) -> dict[str, str]:
    """Declared kind of each scalar parameter and local of ``function``."""
    kinds = {name: its.kind for name, its in function.parameters.items() if not its.shape}
    for node in ast.walk(function.node):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            kinds[node.target.id] = ast.unparse(node.annotation)
    return kinds


def assigned(function: Function) -> frozenset[str]:
    """Names that ``function`` gives another value after their declaration."""
    names = set()
    for node in ast.walk(function.node):
        targets = node.targets if isinstance(node, ast.Assign) else []
        if isinstance(node, ast.AugAssign | ast.For):
            targets = [node.target]
        names |= {target.id for target in targets if isinstance(target, ast.Name)}
    return frozenset(names)


def writers(program: Program) -> dict[tuple[str, str], frozenset[str]]:
    """Functions that write what they were given, with the names of those parameters."""
    found: dict[tuple[str, str], set[str]] = {}
    changed = True
    while changed:
        changed = False
        for function in program.functions():
            mine = found.get(function.key, set()) | _written(program, function, found)
            if mine and mine != found.get(function.key):
                found[function.key] = mine
                changed = True
    return {key: frozenset(names) for key, names in found.items()}


def _written(
    program: Program, function: Function, found: Mapping[tuple[str, str], set[str]]
) -> set[str]:
    module = program.modules[function.module]
    names = set()
    for node in ast.walk(function.node):
        targets: list[ast.expr] = []
        if isinstance(node, ast.Assign):
            targets = list(node.targets)
        elif isinstance(node, ast.AugAssign):
            targets = [node.target]
        elif isinstance(node, ast.Call):
            called = program.function(module, node.func)
            if called is not None:
                below = found.get(called.key, set())
                pairs = zip(node.args, called.parameters, strict=False)
                targets = [argument for argument, name in pairs if name in below]
            elif program.intrinsic(module, node.func) == "clear":
                targets = [node.args[0]]
        for target in targets:
            base = target
            while isinstance(base, ast.Attribute | ast.Subscript):
                base = base.value
            given = function.parameters.get(base.id) if isinstance(base, ast.Name) else None
            if given is not None and (given.kind == "record" or given.shape):
                names.add(base.id)  # type: ignore[attr-defined]
    return names
