"""Function bodies as C: statements, expressions, and the comments between them."""

import ast
from collections.abc import Iterable, Iterator, Mapping

from codegen.c99.intrinsics import intrinsic
from codegen.c99.linkage import Names
from codegen.c99.text import (
    BOTH,
    C_TYPES,
    EITHER,
    PRIMARY,
    UNARY,
    Expression,
    binary,
    broken,
    comment,
    converted,
    fits,
    literal,
    plain,
    signed,
    widened,
)
from codegen.proof.expressions import ARITHMETIC
from codegen.proof.intervals import Value
from codegen.subset.effects import local_kinds
from codegen.subset.program import MEMORY, Function, Module, Program, SubsetError, evaluate

COMPARISONS = {
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
}


class Body:
    """The statements of one function; ``seen`` are the intervals of its expressions."""

    def __init__(
        self,
        program: Program,
        names: Names,
        seen: Mapping[int, Value],
        module: Module,
        function: Function,
    ) -> None:
        self.program = program
        self.names = names
        self.module = module
        self.function = function
        self.kinds = local_kinds(function)
        self.counters: dict[str, str] = {}
        first = function.node.body[0]
        self.line = first.lineno - 1
        self.seen = seen

    def lines(self) -> list[str]:
        """All lines between the braces."""
        statements = self.function.node.body
        if ast.get_docstring(self.function.node) is not None:
            self.line = statements[0].end_lineno or self.line
            statements = statements[1:]
        return [part for line in self.block(statements, "    ") for part in broken(line)]

    def block(self, statements: Iterable[ast.stmt], indent: str) -> Iterator[str]:
        """Statements in order, each with the comments above and beside it."""
        for node in statements:
            for line in range(self.line + 1, node.lineno):
                own, text = self.module.comments.get(line, (False, ""))
                if own:
                    yield from comment(text, indent)
            self.line = node.lineno
            texts = list(self.statement(node, indent))
            own, text = self.module.comments.get(node.lineno, (True, ""))
            if not own:
                texts[0] += f" /* {plain(text)} */"
            yield from texts
            self.line = max(self.line, node.end_lineno or node.lineno)

    def statement(self, node: ast.stmt, indent: str) -> Iterator[str]:
        """One statement."""
        if isinstance(node, ast.AnnAssign):
            assert isinstance(node.target, ast.Name) and node.value is not None
            kind = ast.unparse(node.annotation)
            text = self.stored(node, self.value(node.value), kind)
            yield f"{indent}{C_TYPES[kind]} {node.target.id} = {text};"
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
        if not isinstance(node, ast.Call):
            return False
        if self.program.intrinsic(self.module, node.func) == "clear":
            return False
        called = self.program.function(self.module, node.func)
        return called is None or called.result is not None

    def condition(self, node: ast.If, indent: str, keyword: str) -> Iterator[str]:
        """An if with its else-ifs and else."""
        yield f"{indent}{keyword} ({self.truth(node.test).text}) {{"
        yield from self.block(node.body, indent + "    ")
        if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If):
            for line in range(self.line + 1, node.orelse[0].lineno):
                own, text = self.module.comments.get(line, (False, ""))
                if own:
                    yield from comment(text, indent + "    ")
            self.line = node.orelse[0].lineno
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
        counter = name if name != "_" else f"turn{len(self.counters) or ''}"
        bounds = [converted(self.value(bound), "i32") for bound in node.iter.args]
        start, stop = (literal(0), bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
        step = 1
        if len(node.iter.args) == 3:
            given = evaluate(self.program, self.module, node.iter.args[2])
            assert isinstance(given, int)
            step = given
        advance = {1: f"{counter}++", -1: f"{counter}--"}.get(step, f"{counter} += {step}")
        compare = "<" if step > 0 else ">"
        yield (
            f"{indent}for (int32_t {counter} = {start.text}; "
            f"{counter} {compare} {signed(stop).inside(UNARY)}; {advance}) {{"
        )
        self.counters[counter] = counter
        yield from self.block(node.body, indent + "    ")
        del self.counters[counter]
        yield f"{indent}}}"

    def augmented(self, node: ast.AugAssign) -> str:
        """An assignment like +=, written out where C would narrow its result."""
        target, kind = self.target(node.target)
        before, operand = self.value(node.target), self.value(node.value)
        operator = ARITHMETIC[type(node.op)]
        value = self.seen[id(node)]
        result = self.operation(operator, before, operand, value)
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
        if not fits(e.value, kind):
            rule = f"{e.value} may not fit {kind}: use clamp, sat32 or narrow"
            raise SubsetError(self.module.path, node, rule)
        return converted(e, kind).text

    def target(self, node: ast.expr) -> tuple[str, str]:
        """C text and kind of an assignment target."""
        if isinstance(node, ast.Name):
            return node.id, self.kinds[node.id]
        return self.place(node)

    def place(self, node: ast.expr) -> tuple[str, str]:
        """C text and element kind of a field, an element, an array or a row of one."""
        if isinstance(node, ast.Subscript):
            base, kind = self.place(node.value)
            index = self.value(node.slice)
            index = converted(index, "i32") if index.wide else index
            return f"{base}[{index.text}]", kind
        constant = self.program.constant(self.module, node)
        if constant is not None:
            return self.names.constant(constant), constant.type.kind
        if isinstance(node, ast.Attribute):
            assert isinstance(node.value, ast.Name)
            record = self.program.record(self.function.parameters[node.value.id].record)
            return f"{node.value.id}->{node.attr}", record.fields[node.attr].type.kind
        assert isinstance(node, ast.Name)
        return node.id, self.function.parameters[node.id].kind

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
        operator = COMPARISONS[type(node.ops[0])]
        return binary(operator, left, right, either)

    def value(self, node: ast.expr) -> Expression:
        """An integer expression."""
        seen = self.seen.get(id(node), Value(0, 0))
        if isinstance(node, ast.Constant):
            return literal(int(node.value))  # type: ignore[arg-type]
        if isinstance(node, ast.Name) and (node.id in self.kinds or node.id in self.counters):
            return Expression(node.id, PRIMARY, self.kinds.get(node.id, "i32"), seen)
        if isinstance(node, ast.Name | ast.Attribute):
            limit = self.program.limit(self.module, node)
            constant = self.program.constant(self.module, node)
            if limit is not None:
                name = ast.unparse(node).split(".")[-1]
                wide = name.startswith("I64")
                text = name.replace("I32", "INT32").replace("I64", "INT64")
                return Expression(text, PRIMARY, "i64" if wide else "literal", seen)
            if constant is not None and isinstance(constant.value, int):
                exact = Value(constant.value, constant.value)
                kind = "literal" if fits(exact, "i32") else "i64"
                return Expression(self.names.constant(constant), PRIMARY, kind, exact)
        if isinstance(node, ast.Attribute | ast.Subscript):
            text, kind = self.place(node)
            return Expression(text, PRIMARY, kind, seen)
        if isinstance(node, ast.UnaryOp):
            return self.negated(node, seen)
        if isinstance(node, ast.BinOp):
            operator = ARITHMETIC[type(node.op)]
            return self.operation(operator, self.value(node.left), self.value(node.right), seen)
        assert isinstance(node, ast.Call)
        return self.call(node, seen)

    def negated(self, node: ast.UnaryOp, seen: Value) -> Expression:
        """A minus sign, computed in 64 bits where the result needs them."""
        if isinstance(node.operand, ast.Constant):
            return literal(-int(node.operand.value))  # type: ignore[arg-type]
        operand = self.value(node.operand)
        if not fits(seen, "i32"):
            operand = widened(operand)
        kind = "i64" if operand.wide else "i32"
        inner = operand.inside(UNARY)
        inner = f"({inner})" if inner.startswith("-") else inner
        return Expression(f"-{inner}", UNARY, kind, seen)

    def operation(self, operator: str, a: Expression, b: Expression, value: Value) -> Expression:
        """A binary operation; a left shift of a possibly negative value becomes a product."""
        unsigned_shift = a.kind == "u32" and fits(value, "u32")
        # C leaves open what a shift by the width of its operand does
        far = operator in ("<<", ">>") and b.value.hi >= 32 and not a.wide
        if operator == ">>" and far:
            return binary(operator, widened(a), b, value)
        narrow = a.value.lo >= 0 and fits(value, "i32") and not far
        if operator == "<<" and not narrow and (far or not unsigned_shift):
            count = f"((int64_t)1 << {b.inside(PRIMARY)})"
            if a.kind == "literal" and a.value == Value(1, 1):
                return Expression(count, PRIMARY, "i64", value)
            factor = Expression(count, PRIMARY, "i64", Value(1 << b.value.lo, 1 << b.value.hi))
            return binary("*", a, factor, value)
        return binary(operator, a, b, value)

    def call(self, node: ast.Call, seen: Value) -> Expression:
        """A call of a function of the firmware or of an intrinsic."""
        name = self.program.intrinsic(self.module, node.func)
        if name == "clear":
            record = ast.unparse(node.args[0])
            text = f"canroll_clear({record}, (uint32_t)sizeof(*{record}))"
            return Expression(text, PRIMARY, "i32", seen)
        if name == "bytes_of":
            return literal(seen.lo)
        if name in ("set_octet", "set_word"):
            record = ast.unparse(node.args[0])
            index = self.stored(node, self.value(node.args[1]), "i32")
            kind = "u8" if name == "set_octet" else "i32"
            value = self.stored(node, self.value(node.args[2]), kind)
            return Expression(f"canroll_{name}({record}, {index}, {value})", PRIMARY, "i32", seen)
        if name in MEMORY:
            index = self.stored(node, self.value(node.args[1]), "i32")
            given = self.function.parameters[ast.unparse(node.args[0])]
            fields = self.program.record(given.record).fields.values()
            shared = "shared_" if any(each.volatile for each in fields) else ""
            text = f"canroll_{shared}{name}({ast.unparse(node.args[0])}, {index})"
            return Expression(text, PRIMARY, MEMORY[name], seen)
        if name is not None:
            a = [self.value(argument) for argument in node.args]
            bounds = [] if name == "tdiv" else [self.stored(node, e, "i32") for e in a[1:]]
            return intrinsic(name, a, bounds, seen)
        called = self.program.function(self.module, node.func)
        assert called is not None
        texts = []
        for argument, its in zip(node.args, called.parameters.values(), strict=True):
            if its.kind == "record":
                texts.append(ast.unparse(argument))
            elif its.shape:
                texts.append(self.place(argument)[0])
            else:
                texts.append(self.stored(argument, self.value(argument), its.kind))
        text = f"{self.names.function(called)}({', '.join(texts)})"
        return Expression(text, PRIMARY, called.result or "i32", seen)
