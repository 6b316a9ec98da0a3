"""Removal of calls of empty functions from a program.

A hook, such as those of ``firmware.stage``, then costs nothing if unused: no instruction, no line
of C. A function is empty if it has no statement, or only returns one of its parameters.
"""

import ast
from collections.abc import Mapping

from codegen.subset.program import Function, Module, Program
from codegen.subset.walk import walk


def leave_out(program: Program) -> None:
    """Remove such calls where they are statements, and modules left empty but the entries."""
    idle = {f.key: f for f in program.functions() if _does_nothing(f)}
    for module in program.modules.values():
        for function in module.functions.values():
            _prune(program, module, function.node, idle)
        _forget(module)
    used = {name for module in program.modules.values() for name in module.uses()}
    used |= set(program.entries)
    for module in list(program.modules.values()):
        functions = module.functions.values()
        if functions and all(f.key in idle for f in functions) and module.name not in used:
            del program.modules[module.name]


def _statements(function: Function) -> list[ast.stmt]:
    body = function.node.body
    return body[1:] if ast.get_docstring(function.node) is not None else body


def _does_nothing(function: Function) -> bool:
    body = _statements(function)
    return not body or (len(body) == 1 and _passed(function) is not None)


def _passed(function: Function) -> str | None:
    """The parameter that a function only returns."""
    body = _statements(function)
    value = body[0].value if body and isinstance(body[0], ast.Return) else None
    return value.id if isinstance(value, ast.Name) and value.id in function.parameters else None


def _prune(
    program: Program, module: Module, node: ast.AST, idle: Mapping[tuple[str, str], Function]
) -> None:
    for name in ("body", "orelse"):
        block = getattr(node, name, None)
        if isinstance(block, list):
            kept = [s for s in block if not _is_idle(program, module, s, idle)]
            # a block must not become empty
            setattr(node, name, kept or block)
            for statement in kept:
                _prune(program, module, statement, idle)


def _is_idle(
    program: Program,
    module: Module,
    statement: ast.stmt,
    idle: Mapping[tuple[str, str], Function],
) -> bool:
    """Whether a statement is ``f(…)``, or ``name = f(…, name, …)`` where f returns that name."""
    if not isinstance(statement, ast.Expr | ast.Assign) or not isinstance(
        statement.value, ast.Call
    ):
        return False
    call = statement.value
    called = program.function(module, call.func)
    its = idle.get(called.key) if called is not None else None
    if its is None or not all(
        isinstance(argument, ast.Name | ast.Constant) for argument in call.args
    ):
        return False
    if isinstance(statement, ast.Expr):
        return its.result is None
    passed = _passed(its)
    if passed is None or len(call.args) != len(its.parameters):
        return False
    given = call.args[list(its.parameters).index(passed)]
    return ast.unparse(statement.targets[0]) == ast.unparse(given)


def _forget(module: Module) -> None:
    """Drop imports of whole modules that no function of a module uses any more."""
    named = {
        node.id
        for function in module.functions.values()
        for node in walk(function.node)
        if isinstance(node, ast.Name)
    }
    for name in set(module.modules) - named:
        del module.modules[name]
