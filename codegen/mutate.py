"""Mutation test of the firmware: change one operator or constant, and the tests must notice.

    python -m codegen.mutate [--sample N] [--seed S] [--jobs J]

Each mutant is a copy of the firmware with one change, run against tests/firmware in a process of
its own. Survivors are listed.
"""

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from codegen.program import FIRMWARE

ROOT = FIRMWARE.parent
TESTS = ROOT / "tests" / "firmware"
GENERATED = ("signals", "limits")
"""Modules that a drift test holds against their generator."""
SKIPPED = ("__init__", "subset", "calibration", "state", *GENERATED)
OPERATORS: dict[type[ast.AST], tuple[str, str]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "+"),
    ast.LShift: ("<<", ">>"),
    ast.RShift: (">>", "<<"),
    ast.BitAnd: ("&", "|"),
    ast.BitOr: ("|", "&"),
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.And: ("and", "or"),
    ast.Or: ("or", "and"),
}
TIMEOUT = 900


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change: ``before`` at ``start`` of a module's text becomes ``after``."""

    module: str
    line: int
    start: int
    before: str
    after: str

    def __str__(self) -> str:
        return f"{self.module}.py:{self.line}: {self.before} -> {self.after}"

    def apply(self, source: str) -> str:
        """The module's text with the change."""
        return source[: self.start] + self.after + source[self.start + len(self.before) :]


def mutants(module: str, source: str) -> Iterator[Mutant]:
    """Every mutant of a module's functions."""
    lines = source.splitlines(keepends=True)
    starts = [0]
    for text in lines:
        starts.append(starts[-1] + len(text))

    def offset(line: int, column: int) -> int:
        return starts[line - 1] + len(lines[line - 1].encode()[:column].decode())

    def between(left: ast.expr, right: ast.expr, operator: ast.AST) -> Iterator[Mutant]:
        if type(operator) not in OPERATORS:
            return
        before, after = OPERATORS[type(operator)]
        begin = offset(left.end_lineno or 0, left.end_col_offset or 0)
        end = offset(right.lineno, right.col_offset)
        place = source.find(before, begin, end)
        if place >= 0:
            yield Mutant(module, source.count("\n", 0, place) + 1, place, before, after)

    tree = ast.parse(source)
    for function in (node for node in tree.body if isinstance(node, ast.FunctionDef)):
        for node in (inner for statement in function.body for inner in ast.walk(statement)):
            if isinstance(node, ast.BinOp):
                yield from between(node.left, node.right, node.op)
            elif isinstance(node, ast.AugAssign) and type(node.op) in OPERATORS:
                before, after = (f"{text}=" for text in OPERATORS[type(node.op)])
                begin = offset(node.target.end_lineno or 0, node.target.end_col_offset or 0)
                place = source.index(before, begin)
                yield Mutant(module, node.lineno, place, before, after)
            elif isinstance(node, ast.Compare):
                yield from between(node.left, node.comparators[0], node.ops[0])
            elif isinstance(node, ast.BoolOp):
                for left, right in zip(node.values, node.values[1:], strict=False):
                    yield from between(left, right, node.op)
            elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
                place = offset(node.lineno, node.col_offset)
                yield Mutant(module, node.lineno, place, "-", "+")
            elif isinstance(node, ast.Constant) and type(node.value) is int:
                place = offset(node.lineno, node.col_offset)
                text = source[place : offset(node.end_lineno or 0, node.end_col_offset or 0)]
                yield Mutant(module, node.lineno, place, text, str(node.value + 1))


def all_mutants() -> list[Mutant]:
    """Every mutant of the hand-written firmware, in order of file and line."""
    found = []
    for path in sorted(FIRMWARE.glob("*.py")):
        if path.stem not in SKIPPED:
            found += list(mutants(path.stem, path.read_text(encoding="utf-8")))
    return found


def is_killed(mutant: Mutant, tests: Sequence[Path] = ()) -> bool:
    """Whether the tests fail on the mutant; its module's own tests run first."""
    own = TESTS / f"test_{mutant.module}.py"
    rest = sorted(path for path in TESTS.glob("test_*.py") if path != own)
    chosen = list(tests) or [*([own] if own.exists() else []), *rest]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        shutil.copytree(FIRMWARE, folder / "firmware", ignore=shutil.ignore_patterns("__pycache__"))
        path = folder / "firmware" / f"{mutant.module}.py"
        path.write_text(mutant.apply(path.read_text(encoding="utf-8")), encoding="utf-8")
        environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"}
        # -P: the folder in front of the path would hide the mutant
        command = [sys.executable, "-P", "-m", "pytest", "-x", "-q", "-m", "not slow"]
        command += ["-p", "no:cacheprovider", "--hypothesis-seed=0", *map(str, chosen)]
        try:
            result = subprocess.run(
                command,
                cwd=ROOT,
                env=environment,
                capture_output=True,
                timeout=TIMEOUT,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return True
    return result.returncode != 0


def survivors(chosen: Sequence[Mutant], jobs: int = 1) -> list[Mutant]:
    """Those of ``chosen`` that no test notices."""
    with ThreadPoolExecutor(jobs) as pool:
        killed = list(pool.map(is_killed, chosen))
    return [mutant for mutant, dead in zip(chosen, killed, strict=True) if not dead]


def main() -> int:
    """Run a sample or all mutants; 1 where fewer than 95 % are killed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--sample", type=int, help="how many mutants (default: all)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    chosen = all_mutants()
    total = len(chosen)
    if arguments.sample is not None:
        chosen = random.Random(arguments.seed).sample(chosen, min(arguments.sample, total))
    left = survivors(chosen, arguments.jobs)
    for mutant in left:
        print(mutant)
    share = 1 - len(left) / len(chosen)
    print(f"{len(chosen) - len(left)} of {len(chosen)} mutants killed ({share:.1%}); {total} exist")
    return 0 if share >= 0.95 else 1


if __name__ == "__main__":
    sys.exit(main())
