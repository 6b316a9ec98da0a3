"""Rule for a service beside the loop: it stores in its records and in a named list alone."""

import ast
from collections.abc import Collection, Iterator, Mapping, Set

from canroll.codegen.operations.table import Access
from canroll.codegen.subset.program import FieldReference, Function, Parameter, Program, SubsetError
from canroll.codegen.subset.resolve import stored
from canroll.codegen.subset.walk import walk

STATE = "Ecu"
CALIBRATION = "Calibration"


def check(
    program: Program,
    service: str,
    own: Collection[str],
    *,
    stores: Set[str],
    records: Mapping[str, str],
) -> None:
    """Raise SubsetError, with file and line, for a store where a service may not.

    Args:
        program: the firmware with the service in it.
        service: its name, that of the module with its entry points.
        own: modules that came with it.
        stores: fields of the loop's state in which it may store.
        records: class of each record that it may write, by its name; a calibration is written
            under that name alone.
    """
    for function in _called(program, service, own):
        path = program.modules[function.module].path
        for place in foreign_stores(program, function, allowed=stores, own={*own}):
            allowed = ", ".join(sorted(stores)) or "none"
            raise SubsetError(path, place, f"service {service} stores in the loop's {allowed} only")
        for name in program.writers.get(function.key, ()):
            kind = function.parameters[name].record
            mine = name in records if kind == CALIBRATION else kind in {STATE, *records.values()}
            if not mine:
                raise SubsetError(path, function.node, f"service {service} stores in {name}")


def _called(program: Program, service: str, own: Collection[str]) -> list[Function]:
    """Return the functions of a service's module, and those of ``own`` that they lead to."""
    found = list(program.modules[service].functions.values())
    for function in found:
        for _, called in program.references(function):
            if isinstance(called, Function) and called.module in own and called not in found:
                found.append(called)
    return found


def foreign_stores(
    program: Program, function: Function, *, allowed: Set[str], own: Set[str]
) -> Iterator[ast.AST]:
    """Return writes of a function to the loop's state outside of the fields that are allowed.

    Functions of the modules ``own`` are looked at by themselves.
    """
    for target in stored(program, walk(function.node)):
        match program.refs.get(target):
            case FieldReference(_, record, field) if record == STATE and field.name not in allowed:
                yield target
    for node, called in program.references(function):
        if not isinstance(node, ast.Call):
            continue
        for k, argument in enumerate(node.args):
            given = program.refs.get(argument)
            if isinstance(given, Parameter) and given.type.record == STATE:
                match called:
                    case Access(writes=True):
                        yield node
                    case Function() if called.module not in own:
                        if list(called.parameters)[k] in program.writers.get(called.key, ()):
                            yield node
