"""Run of the firmware's tests on mutants, each in a process forked from a warm one.

pytest collects once. Then a child process for every mutant replaces the code of the changed
function in place, for all its importers, and runs the tests that reach the changed line, cheapest
first. Proof and equivalence follow when the tests have taken as long. If a constant of a module is
changed, everything is reloaded.
"""

import ast
import contextlib
import io
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, settings

from canroll.errors import CanrollError
from codegen.subset.program import FIRMWARE, PACKAGE, file_of
from tools.mutation import forked
from tools.mutation.equivalence import Original
from tools.mutation.mutants import Mutant, write

TESTS = FIRMWARE.parent / "tests" / "firmware"
KILLED, SURVIVED, EQUIVALENT = "killed", "survived", "equivalent"
REFUSED = "translation: "
"""What ``by`` begins with where the translation or its proof kills."""
MARKS = "marks_of_lines"
ARGUMENTS = ("-m", "not slow", "-p", "no:cacheprovider")
PROOF_SECONDS = 2.0
"""When the tests have taken as long as the proof does, it is its turn."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a mutant; ``by`` is what killed it, or why it is equivalent."""

    mutant: Mutant
    verdict: str
    by: str


@dataclass(slots=True)
class Reached:
    """Cost of a test on the unchanged firmware: CPU seconds, statements by module and line."""

    seconds: float
    lines: set[tuple[str, int]]


def run(
    chosen: Sequence[Mutant],
    texts: Mapping[str, str],
    jobs: int = 1,
    done: Callable[[], object] = lambda: None,
    tests: Sequence[Path] = (TESTS,),
) -> list[Outcome]:
    """Return the outcome of each mutant of ``texts``, the imported sources.

    ``done`` is called after each. Raises CanrollError if the tests fail without a mutation.
    """
    hunt = Hunt(chosen, texts, jobs, done, tests)
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        code = pytest.main([*ARGUMENTS, "-s", *map(str, tests)], plugins=[hunt])
    if hunt.failure is not None:
        raise hunt.failure
    if len(hunt.outcomes) != len(chosen):
        raise CanrollError(f"pytest ended with {code}: {said.getvalue()[-2000:]}")
    return [hunt.outcomes[k] for k in range(len(chosen))]


class Hunt:
    """A plugin of pytest that replaces its loop over the tests."""

    def __init__(
        self,
        chosen: Sequence[Mutant],
        texts: Mapping[str, str],
        jobs: int,
        done: Callable[[], object],
        tests: Sequence[Path],
    ) -> None:
        self.chosen, self.texts, self.jobs = chosen, texts, jobs
        self.done, self.tests = done, tests
        self.original = Original(texts)
        self.items: list[pytest.Item] = []
        self.reached: dict[str, Reached] = {}
        self.outcomes: dict[int, Outcome] = {}
        self.failure: BaseException | None = None
        self.failed: list[str] = []
        self.killers: set[tuple[str, str]] = set()

    def pytest_collection(self) -> None:
        """Disable hypothesis's shrinking and deadlines."""
        phases = (Phase.explicit, Phase.generate)
        slow = (HealthCheck.too_slow,)
        settings.register_profile("mutation", phases=phases, suppress_health_check=slow)
        settings.load_profile("mutation")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Record a failed test."""
        if report.failed:
            self.failed.append(report.nodeid)

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run all mutants instead of the tests."""
        self.items = session.items
        try:
            self._measure()
            for k, said in forked.results(len(self.chosen), self._judged, self.jobs):
                self._note(k, said)
        except (CanrollError, RuntimeError, KeyboardInterrupt) as error:
            self.failure = error
        return True

    def _note(self, k: int, said: dict[str, Any]) -> None:
        mutant = self.chosen[k]
        if said == forked.TIME_LIMIT:
            said = {"verdict": KILLED, "by": "time limit"}
        self.outcomes[k] = Outcome(mutant, said["verdict"], said["by"])
        # a test that has noticed a change of a function comes first for its next
        self.killers.add((mutant.place, said["by"]))
        self.done()

    def _measure(self) -> None:
        """Run the tests on the unchanged firmware."""
        baseline = forked.results(
            self.jobs, lambda k: self._baseline(self.items[k :: self.jobs]), self.jobs
        )
        for _, said in baseline:
            if said["failed"]:
                raise CanrollError(f"without a mutation fails {said['failed'][0]}")
            for name, (seconds, lines) in said["reached"].items():
                self.reached[name] = Reached(seconds, {tuple(line) for line in lines})

    def _baseline(self, items: Sequence[pytest.Item]) -> dict[str, Any]:
        modules = sorted({mutant.module for mutant in self.chosen})
        marks = {module: mark_lines(module, self.texts[module]) for module in modules}
        reached = {}
        for item in items:
            for its in marks.values():
                its[:] = bytes(len(its))
            begin = time.process_time()
            self._test(item)
            seconds = time.process_time() - begin
            lines = [(name, k) for name, its in marks.items() for k in range(len(its)) if its[k]]
            reached[item.nodeid] = (seconds, lines)
        return {"failed": self.failed, "reached": reached}

    def _test(self, item: pytest.Item) -> None:
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=None)

    def _judged(self, k: int) -> dict[str, Any]:
        verdict, by = self._judge(self.chosen[k])
        return {"verdict": verdict, "by": by}

    def _judge(self, mutant: Mutant) -> tuple[str, str]:
        """Run whatever may kill ``mutant`` in this process; return verdict and reason."""
        changed = mutant.apply(self.texts[mutant.module])
        waiting = self._reaching(mutant)
        # a constant is met by all tests
        met = waiting if mutant.function else self.items
        limit = 30 + 4 * int(sum(self.reached[item.nodeid].seconds for item in met))
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 1))
        if mutant.function:
            replace_code(mutant.module, changed)
        reached = bool(waiting)
        while waiting and time.process_time() < PROOF_SECONDS:
            if self._fails(waiting.pop(0)):
                return KILLED, self.failed[0]
        refused, same = self.original.examine(mutant.module, changed)
        if refused:
            return KILLED, f"{REFUSED}{refused}"
        if same:
            return EQUIVALENT, same
        if not mutant.function:
            failed = fails_afresh({**self.texts, mutant.module: changed}, self.tests)
            return (KILLED, "tests begun afresh") if failed else (SURVIVED, "")
        for item in waiting:
            if self._fails(item):
                return KILLED, self.failed[0]
        return SURVIVED, "" if reached else "no test reaches it"

    def _reaching(self, mutant: Mutant) -> list[pytest.Item]:
        """The tests that run the changed statement, in the order to run them."""
        line = (mutant.module, mutant.first)
        found = [item for item in self.items if line in self.reached[item.nodeid].lines]

        def cost(item: pytest.Item) -> tuple[bool, float]:
            name = item.nodeid
            return (mutant.place, name) not in self.killers, self.reached[name].seconds

        return sorted(found, key=cost)

    def _fails(self, item: pytest.Item) -> bool:
        self._test(item)
        return bool(self.failed)


def fails_afresh(texts: Mapping[str, str], tests: Sequence[Path]) -> bool:
    """Whether the tests fail on the firmware of ``texts``, reloaded.

    Importers of a constant hold its value: it cannot be replaced in place.
    """
    with tempfile.TemporaryDirectory() as temporary:
        write(texts, Path(temporary) / PACKAGE)
        # the project's own folder in front of the path would hide the copy
        command = [sys.executable, "-P", "-m", "pytest", "-o", "pythonpath=tests", "-x"]
        command += [*ARGUMENTS, *map(str, tests)]
        environment = {**os.environ, "PYTHONPATH": f"{temporary}{os.pathsep}{FIRMWARE.parent}"}
        done = subprocess.run(
            command, cwd=FIRMWARE.parent, env=environment, capture_output=True, check=False
        )
    return done.returncode != 0


def loaded_module(name: str) -> ModuleType:
    """A module of the firmware that is imported already."""
    parts = file_of(name).relative_to(FIRMWARE).with_suffix("").parts
    return sys.modules[".".join([PACKAGE, *parts])]


def mark_lines(module: str, source: str) -> bytearray:
    """Instrument the functions of a loaded module to record the lines they reach."""
    tree = ast.parse(source)
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            _mark(node)
    replace_code(module, tree)
    marks = bytearray(source.count("\n") + 2)
    setattr(loaded_module(module), MARKS, marks)
    return marks


def _mark(node: ast.AST) -> None:
    for name in ("body", "orelse"):
        marked: list[ast.stmt] = []
        for statement in getattr(node, name, []):
            _mark(statement)
            marked += [*ast.parse(f"{MARKS}[{statement.lineno}] = 1").body, statement]
        setattr(node, name, marked)


def replace_code(module: str, source: str | ast.Module) -> None:
    """Replace the code of the functions of a loaded firmware module by that in ``source``."""
    loaded = loaded_module(module)
    compiled = compile(source, str(loaded.__file__), "exec")
    for code in compiled.co_consts:
        if isinstance(code, CodeType):
            getattr(loaded, code.co_name).__code__ = code
