"""Copies that came out alike, made one; those that nothing calls, left out."""

import ast
from collections.abc import Iterable, Sequence

from codegen.specialise.expressions import Copy


def merged(copies: Iterable[Copy], entries: Sequence[str]) -> list[ast.FunctionDef]:
    """The functions of ``copies``, callees before callers, each once, as far as entries need it."""
    names: dict[str, str] = {}
    known: dict[str, str] = {}
    functions: dict[str, ast.FunctionDef] = {}
    for copy in copies:
        node = copy.node
        for inner in ast.walk(node):
            if isinstance(inner, ast.Name):
                inner.id = names.get(inner.id, inner.id)
        head = ast.unparse(ast.fix_missing_locations(node.args))
        text = head + "".join(ast.unparse(statement) for statement in node.body[1:])
        names[copy.name] = known.setdefault(text, copy.name)
        functions.setdefault(names[copy.name], node)
    needed: set[str] = set()
    todo = list(entries)
    while todo:
        name = todo.pop()
        if name in functions and name not in needed:
            needed.add(name)
            todo += [n.id for n in ast.walk(functions[name]) if isinstance(n, ast.Name)]
    return [node for name, node in functions.items() if name in needed]
