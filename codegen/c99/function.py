"""Function bodies as C: statements, expressions, and the comments between them."""

import ast
from collections.abc import Iterable, Iterator, Mapping
from itertools import count

from canroll.codegen.c99.linkage import Names
from canroll.codegen.c99.notes import Notes
from canroll.codegen.c99.text import broken, comment, comments_of, plain
from canroll.codegen.operations.c_expression import (
    BOTH,
    C_TYPES,
    EITHER,
    PRIMARY,
    UNARY,
    Expression,
    binary,
    converted,
    fits,
    literal,
    signed,
    widened,
)
from canroll.codegen.operations.intervals import Value
from canroll.codegen.operations.relations import RELATIONS
from canroll.codegen.operations.table import OPERATORS, Access, Operation
from canroll.codegen.subset.program import (
    Constant,
    FieldReference,
    Function,
    Local,
    Parameter,
    Program,
    SubsetError,
    Type,
    is_scalar,
    statements,
)


class FunctionWriter:
    """The statements of one function; ``seen`` are the intervals of its expressions."""

    def __init__(
        self,
        program: Program,
        names: Names,
        seen: Mapping[ast.AST, Value],
        function: Function,
        notes: Notes,
    ) -> None:
        self.program = program
        self.notes = notes
        self.names = names
        self.module = program.modules[function.module]
        self.function = function
        self.refs = program.refs
        self.counters: list[str] = []
        first = function.node.body[0]
        self.line = first.lineno - 1
        self.seen = seen

    def lines(self) -> list[str]:
        """All lines between the braces."""
        node = self.function.node
        if ast.get_docstring(node) is not None:
            self.line = node.body[0].end_lineno or self.line
        return [part for line in self.block(statements(node), "    ") for part in broken(line)]

    def block(self, statements: Iterable[ast.stmt], indent: str) -> Iterator[str]:
        """Statements in order, each with the comments above and beside it."""
        for node in statements:
            yield from self.comments_above(node, indent)
            texts = list(self.statement(node, indent))
            own, text = self.module.comments.get(node.lineno, (True, ""))
            if not own:
                texts[0] += f" /* {plain(text)} */"
            if note := self.notes.of_statement(self.function, node):
                yield from comment(note, indent)
            yield from texts
            self.line = max(self.line, node.end_lineno or node.lineno)

    def comments_above(self, node: ast.stmt, indent: str) -> Iterator[str]:
        """The comments between the last statement and ``node``."""
        yield from comments_of(self.module.comments, range(self.line + 1, node.lineno), indent)
        self.line = node.lineno

    def statement(self, node: ast.stmt, indent: str) -> Iterator[str]:
        """One statement."""
        if isinstance(node, ast.AnnAssign):
            assert node.value is not None
            name, kind = self.target(node.target)
            text = self.stored(node, self.value(node.value), kind)
            yield f"{indent}{C_TYPES[kind]} {name} = {text};"
        elif isinstance(node, ast.Assign):
            target, kind = self.target(node.targets[0])
            yield f"{indent}{target} = {self.stored(node, self.value(node.value), kind)};"
        elif isinstance(node, ast.AugAssign):
            yield indent + self.augmented(node)
        elif isinstance(node, ast.If):
            yield from self.condition(node, indent, "if")
        elif isinstance(node, ast.For):
            yield from self.loop(node, indent)
        elif isinstance(node, ast.Return):
            if node.value is None:
                yield f"{indent}return;"
            else:
                assert self.function.result is not None
                text = self.stored(node, self.value(node.value), self.function.result)
                yield f"{indent}return {text};"
        else:
            assert isinstance(node, ast.Expr)
            result = self.value(node.value)
            void = "(void)" if self.returns(node.value) else ""
            yield f"{indent}{void}{result.text};"

    def returns(self, node: ast.expr) -> bool:
        """Whether the call in an expression statement returns a value, which C must discard."""
        match self.refs.get(node):
            case Function(result=None) | Access(effect="clear"):
                return False
        return isinstance(node, ast.Call)

    def condition(self, node: ast.If, indent: str, keyword: str) -> Iterator[str]:
        """An if with its else-ifs and else."""
        yield f"{indent}{keyword} ({self.truth(node.test).text}) {{"
        yield from self.block(node.body, indent + "    ")
        if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If):
            yield from self.comments_above(node.orelse[0], indent + "    ")
            yield from self.condition(node.orelse[0], indent, "} else if")
            return
        if node.orelse:
            yield f"{indent}}} else {{"
            yield from self.block(node.orelse, indent + "    ")
        elif "else" in keyword:
            yield f"{indent}}} else {{"
            yield f"{indent}    /* nothing to do */"
        yield f"{indent}}}"

    def loop(self, node: ast.For, indent: str) -> Iterator[str]:
        """A counted loop."""
        assert isinstance(node.iter, ast.Call) and isinstance(node.target, ast.Name)
        name = node.target.id
        if name == "_":
            taken = {*self.function.parameters, *self.function.kinds}
            names = (f"turn{k or ''}" for k in count(len(self.counters)))
            name = next(each for each in names if each not in taken)
        bounds = [self.fitted(bound, self.value(bound), "i32") for bound in node.iter.args]
        start, stop = (literal(0), bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
        step = bounds[2].value.lo if len(bounds) == 3 else 1
        advance = {1: f"{name}++", -1: f"{name}--"}.get(step, f"{name} += {step}")
        compare = "<" if step > 0 else ">"
        yield (
            f"{indent}for (int32_t {name} = {start.text}; "
            f"{name} {compare} {signed(stop).inside(UNARY)}; {advance}) {{"
        )
        self.counters.append(name)
        yield from self.block(node.body, indent + "    ")
        self.counters.pop()
        yield f"{indent}}}"

    def augmented(self, node: ast.AugAssign) -> str:
        """An assignment like +=, written out where C would narrow its result."""
        target, kind = self.target(node.target)
        before, operand = self.value(node.target), self.value(node.value)
        operation = OPERATORS[type(node.op)]
        operator = operation.name
        result = operation.c(self.seen.get(node, Value(0, 0)), before, operand)
        stored = self.stored(node, result, kind)
        whole = kind == "i64" or (kind == "i32" and not result.wide)
        simple = operator in "+-*&|^" and whole
        if simple and operand.level <= PRIMARY + 5:
            if kind == "i64" and (operator == "*" or operand.level > UNARY):
                operand = widened(operand)
            return f"{target} {operator}= {operand.text};"
        return f"{target} = {stored};"

    def stored(self, node: ast.AST, e: Expression, kind: str) -> str:
        """``e`` converted for storage as ``kind``; refused where it may not fit."""
        return self.fitted(node, e, kind).text

    def fitted(self, node: ast.AST, e: Expression, kind: str) -> Expression:
        """``e`` as ``kind``; refused where it may not fit."""
        if not fits(e.value, kind):
            rule = f"{e.value} may not fit {kind}: use clamp, sat32 or narrow"
            raise SubsetError(self.module.path, node, rule)
        return converted(e, kind)

    def target(self, node: ast.expr) -> tuple[str, str]:
        """C text and kind of a local, a field, an element, an array or a row of one."""
        if isinstance(node, ast.Subscript):
            base, kind = self.target(node.value)
            index = self.value(node.slice)
            index = converted(index, "i32") if index.wide else index
            return f"{base}[{index.text}]", kind
        match self.refs[node]:
            case Constant() as constant:
                return self.names.constant(constant), constant.type.kind
            case FieldReference(owner=owner, field=field):
                return f"{owner}->{field.name}", field.type.kind
            case Local(name=name, kind=kind) | Parameter(name=name, type=Type(kind=kind)):
                return name, kind
        raise AssertionError(ast.unparse(node))

    # expressions

    def truth(self, node: ast.expr) -> Expression:
        """A condition."""
        either = Value(0, 1)
        if isinstance(node, ast.BoolOp):
            operator, level = ("&&", BOTH) if isinstance(node.op, ast.And) else ("||", EITHER)
            parts = [f"({self.truth(part).text})" for part in node.values]
            return Expression(f" {operator} ".join(parts), level, "i32", either)
        if isinstance(node, ast.UnaryOp):
            return Expression(f"!({self.truth(node.operand).text})", UNARY, "i32", either)
        assert isinstance(node, ast.Compare)
        left, right = self.value(node.left), self.value(node.comparators[0])
        return binary(RELATIONS[type(node.ops[0])].sign, left, right, either)

    def value(self, node: ast.expr) -> Expression:
        """An integer expression."""
        seen = self.seen.get(node, Value(0, 0))
        if isinstance(node, ast.Constant):
            return literal(int(node.value))  # type: ignore[arg-type]
        if isinstance(node, ast.Name | ast.Attribute | ast.Subscript):
            text, kind = self.target(node)
            match self.refs[node]:
                case Constant(value=int(number)):
                    seen = Value(number, number)
                    kind = "literal" if fits(seen, "i32") else "i64"
            return Expression(text, PRIMARY, kind, seen)
        if isinstance(node, ast.UnaryOp):
            return self.negated(node, seen)
        if isinstance(node, ast.BinOp):
            sides = self.value(node.left), self.value(node.right)
            return OPERATORS[type(node.op)].c(seen, *sides)
        assert isinstance(node, ast.Call)
        return self.call(node, seen)

    def negated(self, node: ast.UnaryOp, seen: Value) -> Expression:
        """A minus sign, computed in 64 bits where the result needs them."""
        if isinstance(node.operand, ast.Constant):
            return literal(-int(node.operand.value))  # type: ignore[arg-type]
        operand = self.value(node.operand)
        if operand.kind == "u32" or not fits(seen, "i32"):
            operand = widened(operand)
        kind = "i64" if operand.wide else "i32"
        inner = operand.inside(UNARY)
        inner = f"({inner})" if inner.startswith("-") else inner
        return Expression(f"-{inner}", UNARY, kind, seen)

    def call(self, node: ast.Call, seen: Value) -> Expression:
        """A call of a function of the firmware or of an intrinsic."""
        match self.refs[node]:
            case Access() as access:
                return self.access(node, access, seen)
            case Operation() as operation:
                first, *rest = (self.value(argument) for argument in node.args)
                kinds = operation.operands[1:]
                rest = [
                    e if kind == "i64" else self.fitted(node, e, kind)
                    for e, kind in zip(rest, kinds, strict=True)
                ]
                return operation.c(seen, first, *rest)
            case Function() as called:
                pairs = zip(node.args, called.parameters.values(), strict=True)
                texts = [
                    self.stored(argument, self.value(argument), its.kind)
                    if is_scalar(its)
                    else self.target(argument)[0]
                    for argument, its in pairs
                ]
                text = f"{self.names.function(called)}({', '.join(texts)})"
                return Expression(text, PRIMARY, called.result or "i32", seen)
        raise AssertionError(ast.unparse(node))

    def access(self, node: ast.Call, access: Access, seen: Value) -> Expression:
        """A record read or written as memory."""
        given = self.refs[node.args[0]]
        assert isinstance(given, Parameter)
        name = given.name
        if access.effect == "size":
            return literal(seen.lo)
        if access.effect == "clear":
            texts, shared = [f"(uint32_t)sizeof(*{name})"], False
        else:
            pairs = zip(node.args[1:], access.operands, strict=True)
            texts = [self.stored(node, self.value(argument), kind) for argument, kind in pairs]
            fields = self.program.record(given.type.record).fields.values()
            shared = access.effect == "read" and any(each.volatile for each in fields)
        text = f"canroll_{'shared_' if shared else ''}{access.name}({', '.join([name, *texts])})"
        return Expression(text, PRIMARY, access.element, seen)
