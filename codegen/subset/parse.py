"""Parser of the integer subset's files into :class:`canroll.codegen.subset.program.Program`.

:func:`load` follows the imports from an entry module and orders the modules so that each comes
after those it uses. Anything outside the subset raises a SubsetError that names file, line and
rule; the rules for function bodies are in :mod:`canroll.codegen.subset.rules`.
"""

import ast
import io
import tokenize
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from canroll.codegen.operations.intervals import KINDS
from canroll.codegen.subset import idle
from canroll.codegen.subset.grammar import WORDS, parsed
from canroll.codegen.subset.program import (
    FIRMWARE,
    PACKAGE,
    RUNTIME,
    Const,
    Constant,
    Function,
    Module,
    Program,
    Record,
    RecordField,
    SubsetError,
    Type,
    elements,
    evaluate,
    file_of,
)
from canroll.codegen.subset.resolve import resolve
from canroll.errors import CanrollError


def load(
    entry: str = "ecu",
    folder: Path = FIRMWARE,
    shown: Mapping[str, Path] | None = None,
    services: Sequence[str] = (),
) -> Program:
    """Parse ``entry`` and all it imports from ``folder``; raise SubsetError if it is not subset.

    ``shown`` are paths that messages name instead of those in ``folder``, by module; ``services``
    are further modules with entry points.
    """
    program = Program({}, (entry, *services))
    for name in program.entries:
        _load(program, name, folder, shown or {}, ())
    resolve(program)
    _forbid_recursion(program)
    idle.leave_out(program)
    return program


def _load(
    program: Program,
    name: str,
    folder: Path,
    shown: Mapping[str, Path],
    within: tuple[str, ...],
) -> None:
    if name in program.modules:
        return
    home = file_of(name, folder)
    path = shown.get(name, home)
    try:
        source = home.read_text(encoding="utf-8")
    except OSError as error:
        raise CanrollError(f"{path}: {error}") from error
    tree = parsed(path, source)
    module = Module(name, path, ast.get_docstring(tree) or "", source)
    module.comments = _comments(source)
    for node in tree.body:
        if isinstance(node, ast.ImportFrom):
            _import(module, node, folder)
    for used in module.uses():
        if used in (*within, name):
            raise SubsetError(path, 1, f"modules import each other: {name} and {used}")
        if used != RUNTIME:
            _load(program, used, folder, shown, (*within, name))
    for node in tree.body:
        if isinstance(node, ast.ImportFrom):
            _refuse_unknown(program, module, node)
    program.modules[name] = module
    for node in tree.body:
        _top_level(program, module, node)


def _comments(source: str) -> dict[int, tuple[bool, str]]:
    """Comments by line; True where the comment stands alone on its line."""
    found = {}
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            text = token.string.lstrip("#").strip()
            directive = text.startswith(("fmt:", "noqa", "type:", "ruff:"))
            if text and not directive:
                found[token.start[0]] = (token.line.lstrip().startswith("#"), text)
    return found


def _import(module: Module, node: ast.ImportFrom, folder: Path) -> None:
    """Note what an import brings; modules are known by their own name, whatever their room."""
    source = node.module or ""
    room = folder.joinpath(*source.removeprefix(PACKAGE).split(".")) if _is_own(source) else folder
    for alias in node.names:
        if alias.asname is not None:
            raise SubsetError(module.path, node, "an import must not rename: remove 'as'")
        home = source.rpartition(".")[2]
        if source == PACKAGE or (room.is_dir() and room != folder):
            home = module.modules[alias.name] = alias.name
        elif _is_own(source):
            module.imported[alias.name] = (home, alias.name)
        elif (source, alias.name) != ("typing", "Annotated"):
            raise SubsetError(module.path, node, f"only {PACKAGE} is imported, not {source}")
        named = f"{PACKAGE}.{home}" if source == PACKAGE else source
        if _is_own(named) and home != RUNTIME and not file_of(home, folder).is_file():
            raise SubsetError(module.path, node, f"there is no module {named}")


def _is_own(source: str) -> bool:
    """Whether a module of the firmware is named."""
    return source.startswith(f"{PACKAGE}.")


def _refuse_unknown(program: Program, module: Module, node: ast.ImportFrom) -> None:
    """Refuse an import of what a module of the firmware does not have."""
    for alias in node.names:
        home, _ = module.imported.get(alias.name, ("", ""))
        if home == RUNTIME:
            known: Collection[str] = WORDS
        elif home:
            there = program.modules[home]
            known = {*there.constants, *there.functions, *there.records, *there.imported}
        if home and alias.name not in known:
            raise SubsetError(module.path, node, f"{node.module} has no {alias.name}")


def _top_level(program: Program, module: Module, node: ast.stmt) -> None:
    if isinstance(node, ast.ImportFrom):
        return
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return
    if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
        return
    if isinstance(node, ast.Assign) and len(node.targets) == 1:
        _constants(program, module, node, node.targets[0], node.value)
    elif isinstance(node, ast.AnnAssign) and node.value is not None:
        _constants(program, module, node, node.target, node.value)
    elif isinstance(node, ast.FunctionDef):
        module.functions[node.name] = _function(program, module, node)
    elif isinstance(node, ast.ClassDef):
        module.records[node.name] = _record(program, module, node)
    elif isinstance(node, ast.Import):
        names = ", ".join(alias.name for alias in node.names)
        raise SubsetError(module.path, node, f"only {PACKAGE} is imported, not {names}")
    else:
        rule = "a module holds imports, constants, records and functions"
        raise SubsetError(module.path, node, rule)


def _constants(
    program: Program,
    module: Module,
    statement: ast.Assign | ast.AnnAssign,
    target: ast.expr,
    value: ast.expr,
) -> None:
    """Note the constants that a statement sets, of which ``target`` are one or several."""
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        if len(target.elts) != len(value.elts):
            raise SubsetError(module.path, target, "as many constants as values")
        for one, its in zip(target.elts, value.elts, strict=True):
            _constants(program, module, statement, one, its)
        return
    if not isinstance(target, ast.Name):
        raise SubsetError(module.path, target, "a constant is a name")
    known = evaluate(program, module, value)
    kind = "i32"
    annotation = statement.annotation if isinstance(statement, ast.AnnAssign) else None
    if annotation is not None:
        kind = _element(program, module, annotation)
    elif isinstance(known, tuple):
        raise SubsetError(module.path, target, "a table states its type: tuple[i32, ...]")
    if annotation is None and isinstance(known, int) and not _fits(known, "i32"):
        kind = "i64"
    shape: list[int] = []
    level: Const = known
    while isinstance(level, tuple):
        shape.append(len(level))
        level = level[0]
    for _, element in elements(known):
        if not _fits(element, kind):
            raise SubsetError(module.path, target, f"{element} does not fit {kind}")
    module.constants[target.id] = Constant(
        module.name,
        target.id,
        known,
        Type(kind, tuple(shape)),
        target.lineno,
        max(target.lineno, statement.end_lineno or 0),
    )


def _fits(value: int, kind: str) -> bool:
    return KINDS[kind][0] <= value <= KINDS[kind][1]


def _element(program: Program, module: Module, node: ast.expr) -> str:
    """The kind inside ``i32``, ``tuple[i32, ...]``, ``list[list[u8]]``, ``Annotated[…]``."""
    while isinstance(node, ast.Subscript):
        node = node.slice.elts[0] if isinstance(node.slice, ast.Tuple) else node.slice
    if not isinstance(node, ast.Name) or node.id not in KINDS:
        raise SubsetError(module.path, node, "a type is i32, i64, u8, u16, u32, a record or array")
    return node.id


def parse_type(program: Program, module: Module, node: ast.expr) -> Type:
    """Read an annotation: a scalar kind, a record class, ``Annotated[list[kind], n, …]``."""
    if isinstance(node, ast.Name):
        if node.id in KINDS:
            return Type(node.id)
        home = module.imported.get(node.id, (module.name, node.id))[0]
        if home in program.modules and node.id in program.modules[home].records:
            return Type("record", (), node.id)
    if (
        isinstance(node, ast.Subscript)
        and ast.unparse(node.value) == "Annotated"
        and isinstance(node.slice, ast.Tuple)
        and node.slice.elts
    ):
        kind, *rest = node.slice.elts
        sizes = [evaluate(program, module, size) for size in rest if not _describes(size)]
        depth, level = 0, kind
        while isinstance(level, ast.Subscript):
            depth, level = depth + 1, level.slice
        if depth != len(sizes):
            raise SubsetError(module.path, node, f"{depth} sizes are needed after the array type")
        shape = tuple(size for size in sizes if isinstance(size, int))
        return Type(_element(program, module, kind), shape)
    rule = f"'{ast.unparse(node)}' is no type: i32, u8, …, a record, Annotated[list[i32], n]"
    raise SubsetError(module.path, node, rule)


def _describes(node: ast.expr) -> bool:
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "F"


def _function(program: Program, module: Module, node: ast.FunctionDef) -> Function:
    a = node.args
    if a.posonlyargs or a.kwonlyargs or a.vararg or a.kwarg or a.defaults:
        raise SubsetError(module.path, node, "parameters are positional, without defaults")
    if node.decorator_list:
        raise SubsetError(module.path, node, "a function has no decorators")
    parameters = {}
    for argument in a.args:
        if argument.annotation is None:
            raise SubsetError(module.path, argument, f"parameter {argument.arg} states its type")
        parameters[argument.arg] = parse_type(program, module, argument.annotation)
    if node.returns is None:
        raise SubsetError(module.path, node, "a function states what it returns")
    result = None
    if not (isinstance(node.returns, ast.Constant) and node.returns.value is None):
        found = parse_type(program, module, node.returns)
        if found.kind == "record" or found.shape:
            raise SubsetError(module.path, node, "a function returns a scalar or None")
        result = found.kind
    return Function(module.name, node.name, parameters, result, node)


def _record(program: Program, module: Module, node: ast.ClassDef) -> Record:
    if [ast.unparse(d) for d in node.decorator_list] != ["record"] or len(node.bases) > 1:
        raise SubsetError(module.path, node, "a class is a @record, derived from one at most")
    inherited = _inherited(program, module, node.bases)
    found = dict(inherited)
    for statement in node.body:
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
            continue
        if not isinstance(statement, ast.AnnAssign) or not isinstance(statement.target, ast.Name):
            raise SubsetError(module.path, statement, "a record holds annotated fields")
        annotation = statement.annotation
        parts = (
            annotation.slice.elts
            if isinstance(annotation, ast.Subscript) and isinstance(annotation.slice, ast.Tuple)
            else []
        )
        if not parts or not _describes(parts[-1]):
            raise SubsetError(module.path, statement, "a field is Annotated[type, sizes, F(…)]")
        description = parts[-1]
        assert isinstance(description, ast.Call)
        if description.keywords or len(description.args) not in (5, 6):
            rule = 'F takes: least, largest, fractional bits, "unit", "meaning"'
            raise SubsetError(module.path, statement, rule)
        lo, hi, q = (evaluate(program, module, part) for part in description.args[:3])
        if not all(isinstance(part, ast.Constant) for part in description.args[3:]):
            raise SubsetError(module.path, statement, "unit and meaning are texts")
        texts = [ast.literal_eval(part) for part in description.args[3:]]
        if not (isinstance(lo, int) and isinstance(hi, int) and isinstance(q, int)):
            raise SubsetError(module.path, statement, "a field's range is two numbers")
        kind = "u8" if lo >= 0 and hi <= 255 else "i32"
        if not _fits(lo, kind) or not _fits(hi, kind):
            raise SubsetError(module.path, statement, f"[{lo}, {hi}] does not fit i32")
        name = statement.target.id
        if name in found:
            owner = ast.unparse(node.bases[0]) if name in inherited else node.name
            raise SubsetError(module.path, statement, f"{owner} has a field {name} already")
        found[name] = RecordField(
            name,
            Type(kind, parse_type(program, module, annotation).shape),
            lo,
            hi,
            q,
            texts[0],
            texts[1],
            len(texts) > 2 and bool(texts[2]),
            statement.lineno,
        )
    return Record(module.name, node.name, ast.get_docstring(node) or "", node.lineno, found)


def _inherited(
    program: Program, module: Module, bases: Sequence[ast.expr]
) -> Mapping[str, RecordField]:
    """The fields of the record from which a record is derived."""
    for base in bases:
        its = parse_type(program, module, base)
        if its.kind != "record":
            raise SubsetError(module.path, base, f"{its.kind} is not a record")
        return program.record(its.record).fields
    return {}


def _forbid_recursion(program: Program) -> None:
    done: set[tuple[str, str]] = set()

    def visit(function: Function, above: tuple[tuple[str, str], ...]) -> None:
        if function.key in above:
            path = program.modules[function.module].path
            raise SubsetError(path, function.node, f"{function.name} calls itself: no recursion")
        if function.key in done:
            return
        for called in program.calls(function):
            visit(called, (*above, function.key))
        done.add(function.key)

    for function in program.functions():
        visit(function, ())
