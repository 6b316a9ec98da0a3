"""Whether a mutant of the firmware can differ from it at all.

Two ways to show that it can't. Trivial compiler equivalence (Papadakis 2015): the emitted C gives
the same object code at -O2. And the intervals of the proof: over all states, frames and accepted
calibrations the two texts only differ for values that don't occur.
"""

import ast
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

from canroll.errors import CanrollError
from codegen import native
from codegen.emit_c import Emitter
from codegen.interval_conditions import NEGATED
from codegen.interval_state import narrow
from codegen.intervals import Value
from codegen.mutants import Mutant
from codegen.parse import load
from codegen.prove import prove

ORDER = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)


class Original:
    """The unchanged firmware, with which mutants are compared."""

    def __init__(self, texts: Mapping[str, str]) -> None:
        self.texts = texts
        compiler = native.compiler()
        if compiler is None:
            raise CanrollError("no C compiler found: install one (cc)")
        self.compiler = compiler
        with self._folder() as temporary:
            self.program = load(folder=Path(temporary))
            self.files = Emitter(self.program).files()
        self.proof = prove(self.program)

    def _folder(self, module: str = "", changed: str = "") -> tempfile.TemporaryDirectory[str]:
        folder = tempfile.TemporaryDirectory()
        for name, text in {**self.texts, **({module: changed} if module else {})}.items():
            (Path(folder.name) / f"{name}.py").write_text(text, encoding="utf-8")
        return folder

    def examine(self, mutant: Mutant, changed: str) -> tuple[str, str]:
        """What the translation and its proof have against a changed module, or ""; and otherwise
        why the firmware is the same with the change, or "".
        """
        with self._folder(mutant.module, changed) as temporary:
            try:
                program = load(folder=Path(temporary))
                files = Emitter(program).files()
                proof = prove(program)
            except OSError:
                raise
            # whatever else it is, the tests of the translation fail of it
            except Exception as error:
                return f"{type(error).__name__}: {error}".replace(f"{temporary}/", ""), ""
        if proof.findings:
            return str(proof.findings[0]).removeprefix(f"{temporary}/"), ""
        if self._objects(self.files, files) == self._objects(files, self.files):
            return "", "the same object code at -O2"
        if not mutant.function:
            return "", ""
        one, two = (
            each.modules[mutant.module].functions[mutant.function].node
            for each in (self.program, program)
        )
        return "", by_intervals(one, two, {**self.proof.seen, **proof.seen})

    def _objects(self, files: Mapping[str, str], others: Mapping[str, str]) -> list[bytes]:
        """The object code of those of ``files`` that differ from ``others``."""
        built = []
        with tempfile.TemporaryDirectory() as temporary:
            for name, text in files.items():
                (Path(temporary) / name).write_text(text, encoding="utf-8")
            headers = any(files[n] != others[n] for n in files if n.endswith(".h"))
            for name in sorted(files):
                if name.endswith(".c") and (headers or files[name] != others[name]):
                    command = [self.compiler, "-std=c99", "-O2", "-c", name, "-o", "object"]
                    subprocess.run(command, cwd=temporary, check=True, capture_output=True)
                    built.append((Path(temporary) / "object").read_bytes())
        return built


def by_intervals(a: ast.AST, b: ast.AST, seen: Mapping[int, Value]) -> str:
    """Why two functions that differ in one place do the same for all values ``seen``, or ""."""
    while type(a) is type(b):
        why = _same_clamp(a, b, seen) or _same_test(a, b, seen) or _same_value(a, b, seen)
        if why:
            return why
        inner = zip(ast.iter_child_nodes(a), ast.iter_child_nodes(b), strict=False)
        differing = [pair for pair in inner if ast.dump(pair[0]) != ast.dump(pair[1])]
        if len(differing) != 1:
            return ""
        a, b = differing[0]
    return ""


def _same_value(a: ast.AST, b: ast.AST, seen: Mapping[int, Value]) -> str:
    one, two = seen.get(id(a)), seen.get(id(b))
    if one is not None and one == two and one.lo == one.hi:
        return f"always {one.lo}"
    return ""


def _same_clamp(a: ast.AST, b: ast.AST, seen: Mapping[int, Value]) -> str:
    """A bound of ``clamp`` that no value reaches may be any."""
    if not (isinstance(a, ast.Call) and isinstance(b, ast.Call) and len(a.args) == 3):
        return ""
    if ast.unparse(a.func) != "clamp" or ast.dump(a.args[0]) != ast.dump(b.args[0]):
        return ""
    value, low, high = (seen[id(argument)] for argument in a.args)
    _, other_low, other_high = (seen[id(argument)] for argument in b.args)
    lows_differ, highs_differ = (ast.dump(a.args[k]) != ast.dump(b.args[k]) for k in (1, 2))
    if lows_differ and value.lo < max(low.hi, other_low.hi):
        return ""
    if highs_differ and value.hi > min(high.lo, other_high.lo):
        return ""
    return f"what is clamped is in {value}"


def _same_test(a: ast.AST, b: ast.AST, seen: Mapping[int, Value]) -> str:
    """Comparisons of the same value that select the same of its interval."""
    if not (isinstance(a, ast.Compare) and isinstance(b, ast.Compare)):
        return ""
    if ast.dump(a.left) != ast.dump(b.left) or id(a.left) not in seen:
        return ""
    value = seen[id(a.left)]
    selected = []
    for test in (a, b):
        limit = seen[id(test.comparators[0])]
        kept = narrow(type(test.ops[0]), value, limit)
        decided = kept is None or narrow(NEGATED[type(test.ops[0])], value, limit) is None
        exact = limit.lo == limit.hi and isinstance(test.ops[0], ORDER)
        if not (decided or exact):
            return ""
        selected.append(kept)
    return f"what is compared is in {value}" if selected[0] == selected[1] else ""
