"""Partial evaluation of functions: one copy for each set of known arguments.

The calibration is known, and so are elements of the state that never change
(:func:`steady`). A copy is written with what follows from both: constants folded,
branches that cannot be taken gone, loops with known bounds unrolled while that stays small, and
functions that come down to one expression put in place of their calls. What a copy still needs of
the calibration by an index that is not known becomes a table.
"""

import ast
from collections.abc import Mapping
from dataclasses import dataclass, field
from textwrap import fill

from codegen.specialise import fold
from codegen.specialise.expressions import Copy, ExpressionFolder
from codegen.specialise.places import (
    CALIBRATION,
    RECORDS,
    STATE_RECORD,
    TABLE,
    Element,
    Scope,
    agreed,
    fixed,
)
from codegen.specialise.tidy import tidied
from codegen.subset.program import (
    CONST_RECORD,
    Function,
    Program,
    Type,
    assigned,
    names,
    statements,
)
from codegen.subset.walk import walk

Key = tuple[tuple[str, str], tuple[str, ...]]

TURNS = 8
"""Most turns of a loop that is unrolled."""
ROOM = 700
"""Most syntax nodes that an unrolled loop may have."""
LINE = 90
"""Length of a line of a comment."""
REFUSAL = "refused"
"""The state field of an ECU that refuses its calibration; not as after a start."""


@dataclass(slots=True)
class Evaluator(ExpressionFolder):
    """Writes the copies of one program's functions, callees before their callers."""

    copies: dict[Key, Copy] = field(default_factory=dict)

    def entry(self, function: Function) -> Copy:
        """The copy of an entry point: its parameters stay."""
        arguments: list[ast.expr] = [ast.Name(name) for name in function.parameters]
        return self.copy(function, arguments, entry=True)

    def copy(self, function: Function, arguments: list[ast.expr], *, entry: bool = False) -> Copy:
        """The copy of ``function`` for what is known of its arguments."""
        told = self._told(function, arguments)
        key = (function.key, tuple(ast.unparse(n) if n is not None else "" for n in told))
        if key in self.copies:
            return self.copies[key]
        scope = Scope({}, taken={*function.parameters, *RECORDS.values()})
        for name, given in zip(function.parameters, told, strict=True):
            scope.values[name] = given if given is not None else ast.Name(name)
        body, _ = self._block(statements(function.node), scope)
        body = tidied(body)
        used = names(body)
        records = tuple(name for name in RECORDS.values() if name in used)
        kept = tuple(
            i
            for i, name in enumerate(function.parameters)
            if told[i] is None and (entry or name in used)
        )
        name = function.name if entry else self._name(function)
        parameters = [(each, its) for each, its in function.parameters.items()]
        taken = [
            (RECORDS[its], Type("record", (), its)) for its in RECORDS if RECORDS[its] in records
        ]
        if entry:
            taken = [(RECORDS[t.record], t) for _, t in parameters if t.kind == "record"]
        taken += [parameters[i] for i in kept]
        expression = None
        if len(body) == 1 and isinstance(body[0], ast.Return):
            expression = body[0].value
        doc = ast.Expr(ast.Constant(_described(function, told)))
        node = _definition(name, [doc, *body], taken, function.result)
        self.copies[key] = Copy(name, node, records, kept, expression)
        return self.copies[key]

    def _told(self, function: Function, arguments: list[ast.expr]) -> list[ast.expr | None]:
        """What is known of each argument: its value, or the place of an array or record."""
        told: list[ast.expr | None] = []
        for (name, its), argument in zip(function.parameters.items(), arguments, strict=True):
            if its.kind == "record":
                told.append(ast.Name(RECORDS[its.record]))
            elif its.shape:
                told.append(argument if fixed(argument) else None)
            else:
                given = fold.known(argument) is not None and name not in function.assigned
                told.append(argument if given else None)
        return told

    def _name(self, function: Function) -> str:
        plain = f"{function.module}_{function.name}"
        name, n = plain, 2
        while name in self.used or name in self.reserved:
            name, n = f"{plain}_{n}", n + 1
        self.used.add(name)
        return name

    def _block(self, block: list[ast.stmt], scope: Scope) -> tuple[list[ast.stmt], bool]:
        """The statements as written; whether the end of them is reached."""
        written: list[ast.stmt] = []
        for statement in block:
            its, goes_on = self._statement(statement, scope)
            written += its
            if not goes_on:
                return written, False
        return written, True

    def _statement(self, node: ast.stmt, scope: Scope) -> tuple[list[ast.stmt], bool]:
        if isinstance(node, ast.AnnAssign):
            return self._declaration(node, scope), True
        if isinstance(node, ast.Assign):
            return self._assignment(node.targets[0], self.value(node.value, scope), scope), True
        if isinstance(node, ast.AugAssign):
            before = self.value(node.target, scope)
            value = fold.operation(node.op, before, self.value(node.value, scope))
            return self._assignment(node.target, value, scope), True
        if isinstance(node, ast.If):
            return self._condition(node, scope)
        if isinstance(node, ast.For):
            return self._loop(node, scope)
        if isinstance(node, ast.Return):
            result = None if node.value is None else self.value(node.value, scope)
            return [ast.Return(result)], False
        assert isinstance(node, ast.Expr)
        return self._called(node.value, scope), True

    def _declaration(self, node: ast.AnnAssign, scope: Scope) -> list[ast.stmt]:
        assert isinstance(node.target, ast.Name) and node.value is not None
        value = self.value(node.value, scope)
        name = scope.declare(node.target.id)
        number = fold.known(value)
        if number is not None:
            scope.constants[node.target.id] = number
        return [ast.AnnAssign(ast.Name(name), node.annotation, value, 1)]

    def _assignment(self, target: ast.expr, value: ast.expr, scope: Scope) -> list[ast.stmt]:
        number = fold.known(value)
        if isinstance(target, ast.Name):
            if fold.same(scope.values[target.id], value):
                return []
            if number is None:
                scope.constants.pop(target.id, None)
            else:
                scope.constants[target.id] = number
            return [ast.Assign([scope.values[target.id]], value, lineno=0)]
        place = self._place(target, scope)
        if self._keeps(place, value):
            return []
        self._store(place, number)
        return [ast.Assign([place], value, lineno=0)]

    def _condition(self, node: ast.If, scope: Scope) -> tuple[list[ast.stmt], bool]:
        test = self.value(node.test, scope)
        told = fold.truth(test)
        if told is not None:
            return self._block(node.body if told else node.orelse, scope)
        before, values = dict(scope.constants), dict(scope.values)
        yes, yes_on = self._block(node.body, scope)
        known_yes, scope.constants = scope.constants, dict(before)
        scope.values = dict(values)
        no, no_on = self._block(node.orelse, scope)
        known_no = scope.constants
        scope.values = values
        scope.constants = agreed(known_yes if yes_on else None, known_no if no_on else None)
        return [ast.If(test, yes, no)], yes_on or no_on

    def _loop(self, node: ast.For, scope: Scope) -> tuple[list[ast.stmt], bool]:
        assert isinstance(node.iter, ast.Call) and isinstance(node.target, ast.Name)
        bounds = [self.value(bound, scope) for bound in node.iter.args]
        numbers = [fold.known(bound) for bound in bounds]
        name = node.target.id
        if all(number is not None for number in numbers):
            turns = range(*numbers)  # type: ignore[arg-type]
            if len(turns) == 0:
                return [], True
            if len(turns) == 1:
                return self._unrolled(node.body, name, turns, scope)
            unrolled = self._on_trial(node, name, turns, scope) if len(turns) <= TURNS else None
            if unrolled is not None:
                return unrolled
        scope.forget(assigned(node))
        before, values = dict(scope.constants), dict(scope.values)
        counter = "_" if name == "_" else scope.declare(name)
        body, _ = self._block(node.body, scope)
        scope.constants, scope.values = before, values
        if not body:
            return [], True
        call = ast.Call(ast.Name("range"), bounds, [])
        return [ast.For(ast.Name(counter), call, body, [], lineno=0)], True

    def _on_trial(
        self, node: ast.For, name: str, turns: range, scope: Scope
    ) -> tuple[list[ast.stmt], bool] | None:
        """The loop unrolled, or None where that does not stay small."""
        trial = scope.trial()
        body, goes_on = self._unrolled(node.body, name, turns, trial)
        if sum(1 for statement in tidied(body) for _ in walk(statement)) > ROOM:
            return None
        scope.adopt(trial)
        return body, goes_on

    def _unrolled(
        self, body: list[ast.stmt], name: str, turns: range, scope: Scope
    ) -> tuple[list[ast.stmt], bool]:
        written: list[ast.stmt] = []
        for turn in turns:
            scope.values[name] = fold.literal(turn)
            its, goes_on = self._block(body, scope)
            written += its
            if not goes_on:
                return written, False
        return written, True

    def _called(self, node: ast.expr, scope: Scope) -> list[ast.stmt]:
        """A call for its effect."""
        assert isinstance(node, ast.Call)
        function = self.program.refs[node]
        if not isinstance(function, Function):
            return [ast.Expr(self.value(node, scope))]
        copy, arguments = self._call(function, node, scope)
        body = statements(copy.node)
        if all(isinstance(s, ast.Expr | ast.Return) and fold.pure(s) for s in body):
            return []
        return [ast.Expr(ast.Call(ast.Name(copy.name), arguments, []))]


def _described(function: Function, told: list[ast.expr | None]) -> str:
    """The docstring of a copy: that of its function, which one it is, and for what."""
    here = [
        f"{name} = {_named(given)}"
        for (name, its), given in zip(function.parameters.items(), told, strict=True)
        if given is not None and its.kind != "record"
    ]
    origin = f"{function.module}.{function.name}{' for ' if here else ''}{', '.join(here)}."
    doc = ast.get_docstring(function.node)
    return f"{doc}\n\n{fill(origin, LINE)}" if doc else fill(origin, LINE)


def _named(place: ast.expr) -> str:
    """A place in the words of the source."""
    text = ast.unparse(place)
    return text.replace(CALIBRATION, RECORDS[CONST_RECORD]).replace(TABLE, "")


def _definition(
    name: str, body: list[ast.stmt], parameters: list[tuple[str, Type]], result: str | None
) -> ast.FunctionDef:
    taken = [ast.arg(each, _annotation(its)) for each, its in parameters]
    returns = ast.Name(result) if result else ast.Constant(None)
    arguments = ast.arguments([], taken, None, [], [], None, [])
    return ast.FunctionDef(name, arguments, body, [], returns)


def _annotation(its: Type) -> ast.expr:
    if its.kind == "record":
        return ast.Name(its.record)
    if not its.shape:
        return ast.Name(its.kind)
    inner: ast.expr = ast.Name(its.kind)
    for _ in its.shape:
        inner = ast.Subscript(ast.Name("list"), inner)
    sizes = [ast.Constant(n) for n in its.shape]
    return ast.Subscript(ast.Name("Annotated"), ast.Tuple([inner, *sizes]))


def steady(
    program: Program,
    entries: Mapping[str, Function],
    calibration: Mapping[Element, int],
    started: Mapping[Element, int],
    results: Mapping[tuple[str, str], int],
) -> dict[Element, int]:
    """Return the elements of the state that stay as ``started`` has them.

    Options that are off leave much of the state as ``init`` made it. All of it is assumed to stay,
    the tick is specialised on that assumption, and every element in which it then stores another
    value is dropped, until there is none: what remains holds at the start and after every tick.

    Args:
        program: of the entry points.
        entries: ``tick``, which runs once a period, and ``receive``, which may run at any time.
        calibration: every element of it.
        started: every element of the state after ``init``.
        results: as of :class:`Evaluator`.
    """
    fields = program.record(STATE_RECORD).fields
    held = {
        (name, indices): value
        for (name, indices), value in started.items()
        if name != REFUSAL and not fields[name].volatile
    }
    interrupt = Evaluator(program, calibration, {}, results)
    interrupt.entry(entries["receive"])
    while True:
        evaluator = Evaluator(program, calibration, held, results)
        evaluator.entry(entries["tick"])
        changed = {
            element
            for store in (*interrupt.stores, *evaluator.stores)
            for element in store.elements
            if element in held and store.value != held[element]
        }
        if not changed:
            return held
        held = {element: value for element, value in held.items() if element not in changed}
