"""Removal of calls of empty functions from a program.

A hook, such as those of ``canroll.firmware.stage``, then costs nothing if unused: no instruction,
no line of C. A function is empty if it has no statement, or only returns one of its parameters.
"""

import ast
from collections.abc import Mapping

from canroll.codegen.subset.program import Function, Module, Program, names, statements


def leave_out(program: Program) -> None:
    """Remove such calls where they are statements, and modules left empty but the entries."""
    idle = {f.key: _passed(f) for f in program.functions() if _does_nothing(f)}
    for module in program.modules.values():
        for function in module.functions.values():
            _prune(program, function.node, idle)
        _forget(module)
    used = {name for module in program.modules.values() for name in module.uses()}
    used |= set(program.entries)
    for module in list(program.modules.values()):
        functions = module.functions.values()
        if functions and all(f.key in idle for f in functions) and module.name not in used:
            del program.modules[module.name]


def _does_nothing(function: Function) -> bool:
    body = statements(function.node)
    return not body or (len(body) == 1 and _passed(function) is not None)


def _passed(function: Function) -> int | None:
    """The number of the parameter that a function only returns."""
    body = statements(function.node)
    value = body[0].value if body and isinstance(body[0], ast.Return) else None
    names = list(function.parameters)
    return names.index(value.id) if isinstance(value, ast.Name) and value.id in names else None


def _prune(program: Program, node: ast.AST, idle: Mapping[tuple[str, str], int | None]) -> None:
    for name in ("body", "orelse"):
        block = getattr(node, name, None)
        if isinstance(block, list):
            kept = [s for s in block if not _is_idle(program, s, idle)]
            # a block must not become empty
            setattr(node, name, kept or block)
            for statement in kept:
                _prune(program, statement, idle)


def _is_idle(
    program: Program, statement: ast.stmt, idle: Mapping[tuple[str, str], int | None]
) -> bool:
    """Whether a statement is ``f(…)``, or ``name = f(…, name, …)`` where f returns that name."""
    if not isinstance(statement, ast.Expr | ast.Assign) or not isinstance(
        statement.value, ast.Call
    ):
        return False
    arguments = statement.value.args
    called = program.refs.get(statement.value)
    if not isinstance(called, Function) or called.key not in idle:
        return False
    if not all(isinstance(argument, ast.Name | ast.Constant) for argument in arguments):
        return False
    if isinstance(statement, ast.Expr):
        return called.result is None
    passed = idle[called.key]
    if passed is None or len(arguments) != len(called.parameters):
        return False
    return ast.unparse(statement.targets[0]) == ast.unparse(arguments[passed])


def _forget(module: Module) -> None:
    """Drop imports of whole modules that no function of a module uses any more."""
    named = names(function.node for function in module.functions.values())
    for name in set(module.modules) - named:
        del module.modules[name]
