"""Resolution: what each name, field, element and call of the functions refers to, and who writes.

It is done once, as a program is loaded; the passes read :attr:`Program.refs`. What refers to
nothing is left out, and refused by :mod:`canroll.codegen.subset.rules`.
"""

import ast
from collections.abc import Iterable, Iterator, Mapping

from canroll.codegen.operations.table import Access, Operation
from canroll.codegen.subset.program import (
    FieldReference,
    Function,
    Local,
    Parameter,
    Program,
    Ref,
    base,
    is_scalar,
)
from canroll.codegen.subset.walk import walk


def resolve(program: Program) -> None:
    """Set ``refs`` and ``writers`` of a program of which all modules are parsed."""
    stores: dict[tuple[str, str], list[ast.AST]] = {}
    for function in program.functions():
        names: dict[str, Ref] = {
            name: Parameter(name, its)
            for name, its in function.parameters.items()
            if not is_scalar(its)
        }
        names |= {name: Local(name, kind) for name, kind in function.kinds.items()}
        stores[function.key] = []
        for node in walk(function.node):
            if isinstance(node, ast.Name | ast.Attribute | ast.Subscript):
                ref = _ref(program, function, names, base(node))
                if ref is not None:
                    program.refs[node] = ref
            elif isinstance(node, ast.Call):
                ref = _ref(program, function, names, node.func)
                if isinstance(ref, Function | Operation | Access):
                    program.refs[node] = ref
            if isinstance(node, ast.Assign | ast.AugAssign | ast.Call):
                stores[function.key].append(node)
    changed = True
    while changed:
        changed = False
        for key, nodes in stores.items():
            owners = {_owner(program.refs.get(target)) for target in stored(program, nodes)} - {""}
            if not owners <= program.writers.get(key, frozenset()):
                program.writers[key] = frozenset(owners)
                changed = True


def _ref(
    program: Program, function: Function, names: Mapping[str, Ref], node: ast.expr
) -> Ref | None:
    if isinstance(node, ast.Name) and node.id in names:
        return names[node.id]
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        owner = names.get(node.value.id)
        if isinstance(owner, Parameter) and owner.type.kind == "record":
            field = program.record(owner.type.record).fields.get(node.attr)
            return None if field is None else FieldReference(owner.name, owner.type.record, field)
    return program.lookup(program.modules[function.module], node)


def stored(program: Program, nodes: Iterable[ast.AST]) -> Iterator[ast.expr]:
    """Yield what ``nodes`` write: targets assigned, or passed to a function that writes."""
    for node in nodes:
        if isinstance(node, ast.Assign):
            yield from node.targets
        elif isinstance(node, ast.AugAssign):
            yield node.target
        elif isinstance(node, ast.Call):
            match program.refs.get(node):
                case Function() as called:
                    names = program.writers.get(called.key, ())
                    pairs = zip(node.args, called.parameters, strict=False)
                    yield from (argument for argument, name in pairs if name in names)
                case Access(writes=True) if node.args:
                    yield node.args[0]


def _owner(ref: Ref | None) -> str:
    """The parameter in which a reference lies, or ""."""
    match ref:
        case FieldReference(owner=name) | Parameter(name=name):
            return name
    return ""
