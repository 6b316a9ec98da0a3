"""Declarations, assignments and side effects of functions."""

import ast
from collections.abc import Collection, Iterator, Mapping

from codegen.subset.program import WRITERS, Function, Program
from codegen.subset.walk import walk


def local_kinds(function: Function) -> dict[str, str]:
    """Declared kind of each scalar parameter and local of ``function``."""
    kinds = {name: its.kind for name, its in function.parameters.items() if not its.shape}
    for node in walk(function.node):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            kinds[node.target.id] = ast.unparse(node.annotation)
    return kinds


def assigned(function: Function) -> frozenset[str]:
    """Names that ``function`` assigns again after their declaration."""
    names = set()
    for node in walk(function.node):
        targets = node.targets if isinstance(node, ast.Assign) else []
        if isinstance(node, ast.AugAssign | ast.For):
            targets = [node.target]
        names |= {target.id for target in targets if isinstance(target, ast.Name)}
    return frozenset(names)


def writers(program: Program) -> dict[tuple[str, str], frozenset[str]]:
    """Functions that write to their parameters, with the names of those parameters."""
    found: dict[tuple[str, str], set[str]] = {}
    writing = [(function, _writing(function)) for function in program.functions()]
    changed = True
    while changed:
        changed = False
        for function, nodes in writing:
            mine = found.get(function.key, set()) | _written(program, function, nodes, found)
            if mine and mine != found.get(function.key):
                found[function.key] = mine
                changed = True
    return {key: frozenset(names) for key, names in found.items()}


def stored(
    program: Program, function: Function, written: Mapping[tuple[str, str], Collection[str]]
) -> Iterator[ast.expr]:
    """Return what a function writes: targets assigned, cleared or passed to a function that writes.

    Args:
        program: program of the function.
        function: function to examine.
        written: names of the parameters that each function writes, as far as known.
    """
    return _stored(program, function, _writing(function), written)


def _writing(function: Function) -> list[ast.AST]:
    """What may write in a function."""
    kinds = (ast.Assign, ast.AugAssign, ast.Call)
    return [node for node in walk(function.node) if isinstance(node, kinds)]


def _stored(
    program: Program,
    function: Function,
    nodes: Collection[ast.AST],
    written: Mapping[tuple[str, str], Collection[str]],
) -> Iterator[ast.expr]:
    module = program.modules[function.module]
    for node in nodes:
        if isinstance(node, ast.Assign):
            yield from node.targets
        elif isinstance(node, ast.AugAssign):
            yield node.target
        elif isinstance(node, ast.Call):
            called = program.function(module, node.func)
            if called is not None:
                below = written.get(called.key, ())
                pairs = zip(node.args, called.parameters, strict=False)
                yield from (argument for argument, name in pairs if name in below)
            elif program.intrinsic(module, node.func) in WRITERS:
                yield node.args[0]


def _written(
    program: Program,
    function: Function,
    nodes: Collection[ast.AST],
    found: Mapping[tuple[str, str], set[str]],
) -> set[str]:
    names = set()
    for target in _stored(program, function, nodes, found):
        base = target
        while isinstance(base, ast.Attribute | ast.Subscript):
            base = base.value
        given = function.parameters.get(base.id) if isinstance(base, ast.Name) else None
        if given is not None and (given.kind == "record" or given.shape):
            names.add(base.id)  # type: ignore[attr-defined]
    return names
