"""Coverage-guided fuzzing (atheris, libFuzzer) of every reader that is Python.

    python -m tools.hostile.guided [--inputs N] [--seed S] [--only FORMAT] [--keep FOLDER]

Each format is fuzzed in a process of its own from its good file. Inputs that enter something new in
our code, or in what parses for us, are kept and changed further: by the mutations of libFuzzer, by
the damage of the unguided tool, and inside documents and archives, kept well-formed. Each input
is read, or refused in one line; anything else is printed with its place, its file kept in the
folder, and ends it with exit code 1. What is read in a process of its own, by compiled code, cannot
be guided from here and is left to ``tools.hostile.files``.
"""

import argparse
import faulthandler
import json
import mmap
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from tools.hostile.files import COSTLY, MEMORY, SECONDS, attempt, late
from tools.hostile.formats import FORMATS, Format, damaged, lacking, make, placed
from tools.hostile.inside import damaged_inside
from tools.progress import progress

OUTCOMES = ("read", "refused", "failed")
RESIDENT_MB = 4096
ROOM = 1024
"""Bytes that an input may have more than twice the good file."""
FAST = Path("/dev/shm")
"""Where inputs are written, in memory, where there is such a folder."""
SAID = re.compile(r"^#\d+\s+(\w+)\s+cov: (\d+) ft: (\d+)", re.M)
PLACE = re.compile(r'^ *File "([^"]+)", line (\d+)', re.M)


@dataclass(frozen=True, slots=True)
class Findings:
    """What became of the inputs of one format.

    Attributes:
        counts: inputs by outcome.
        edges: of the control flow, entered by the good file and by all inputs.
        features: edges with the magnitude of their counts, likewise.
        failures: place of each failure, with the file kept of it.
    """

    counts: Counter[str]
    edges: tuple[int, int]
    features: tuple[int, int]
    failures: dict[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """What is fuzzed.

    Attributes:
        form: the format.
        good: folder of the good files.
        inputs: their number.
        seed: of all that is drawn.
        keep: folder for files that failed, made for the first.
    """

    form: Format
    good: Path
    inputs: int
    seed: int
    keep: Path


def fuzz(task: Task, more: Callable[[int], None] = lambda _: None) -> Findings:
    """Fuzz the reader of one format in a process of its own; ``more`` is told of inputs read."""
    form = task.form
    shared = np.frombuffer(mmap.mmap(-1, 8 * len(OUTCOMES)), np.int64)
    near = str(FAST) if FAST.is_dir() else None
    with tempfile.TemporaryDirectory(prefix="canroll-guided-", dir=near) as temporary:
        folder = Path(temporary)
        process = os.fork()
        if not process:
            _child(task, folder, shared)
        done = 0
        while not (ended := os.waitpid(process, os.WNOHANG))[0]:
            time.sleep(0.02)
            total = int(shared.sum())
            more(total - done)
            done = total
        log = (folder / "log").read_text(encoding="utf-8", errors="replace")
        record = folder / "failures"
        failures: dict[str, str] = json.loads(record.read_text()) if record.exists() else {}
        counts = Counter(dict(zip(OUTCOMES, shared.tolist(), strict=True)))
        if code := os.waitstatus_to_exitcode(ended[1]):
            counts["failed"] += 1
            how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
            left = next((folder / "work").glob(f"*/{form.file}"), None)
            name = "no input" if left is None else _kept(form, left, task.keep)
            failures[f"{form.name}: {how} at {_last_place(log)}"] = name
    said = SAID.findall(log)
    first = next((row for row in said if row[0] == "INITED"), ("", 0, 0))
    last = said[-1] if said else first
    return Findings(counts, (int(first[1]), int(last[1])), (int(first[2]), int(last[2])), failures)


def _kept(form: Format, path: Path, keep: Path) -> str:
    """Copy a file that failed, with what belongs to it; return the copy's path."""
    keep.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(prefix=f"{form.folder}-", dir=keep))
    shutil.copytree(path.parent, folder, dirs_exist_ok=True)
    return str(folder / form.file)


def _last_place(log: str) -> str:
    """Return where the process was when it ended, or what it said last."""
    ours = [f"{file}:{line}" for file, line in PLACE.findall(log) if "site-packages" not in file]
    said = [line for line in log.splitlines() if line.strip()]
    return (ours or said[-1:] or ["?"])[0]


def _child(task: Task, folder: Path, shared: NDArray[np.int64]) -> NoReturn:
    """Fuzz in this process until its end."""
    try:
        _run(task, folder, shared)
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(1)


def _run(task: Task, folder: Path, shared: NDArray[np.int64]) -> None:
    form, good = task.form, task.good
    log = os.open(folder / "log", os.O_CREAT | os.O_WRONLY | os.O_APPEND)
    os.dup2(log, 1)
    os.dup2(log, 2)
    # only here: the process that forks is not to be instrumented, and atheris is no dependency
    import atheris  # noqa: PLC0415

    from tools.hostile.instrumented import instrument  # noqa: PLC0415

    warnings.simplefilter("ignore")
    signal.signal(signal.SIGALRM, late)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    content = (good / form.name).read_bytes()
    copies = [placed(form, good, folder / name, content) for name in ("first", "second")]
    instrument(form.read, *copies)
    corpus = folder / "corpus"
    corpus.mkdir()
    (corpus / "good").write_bytes(content)
    found: Counter[str] = Counter()
    failures: dict[str, str] = {}

    def one(content: bytes) -> None:
        # a name of its own: readers keep what they have read
        path = placed(form, good, folder / "work" / str(int(shared.sum())), content)
        # for compiled code, which the alarm does not interrupt; says where it is
        faulthandler.dump_traceback_later(2 * SECONDS, exit=True, file=log)
        found.clear()
        outcome = attempt(form, path, found)
        for line in found:
            place = ": ".join(line.split(": ")[:2])
            if place not in failures:
                failures[place] = _kept(form, path, task.keep)
                (folder / "failures").write_text(json.dumps(failures))
        shutil.rmtree(path.parent)
        shared[OUTCOMES.index(outcome)] += 1

    def change(content: bytes, most: int, drawn: int) -> bytes:
        source = random.Random(drawn)

        def plainly(some: bytes) -> bytes:
            return atheris.Mutate(some, most) if source.randrange(2) else damaged(some, source)

        if source.randrange(2):
            return plainly(content)[:most]
        return damaged_inside(Path(form.file).suffix, content, source, plainly)[:most]

    options = {
        "runs": task.inputs,
        "seed": task.seed,
        "max_len": 2 * len(content) + ROOM,
        "len_control": 0,
        "reload": 0,  # by the clock
        "rss_limit_mb": RESIDENT_MB,
        "timeout": 0,  # its timer is that of the alarm
    }
    arguments = ["guided", *(f"-{name}={value}" for name, value in options.items()), str(corpus)]
    atheris.Setup(arguments, one, custom_mutator=change)
    faulthandler.enable(file=log)
    atheris.Fuzz()


def row(name: str, each: Sequence[object]) -> str:
    """Return a line of the table."""
    widths = (7, 7, 9, 8, 14, 14)
    return f"{name:34}" + "".join(
        f"{cell:>{width}}" for cell, width in zip(each, widths, strict=False)
    )


def main() -> int:
    """Fuzz the formats one after the other."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--inputs", type=int, default=1000, help="inputs of each format")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="formats whose name contains this")
    parser.add_argument(
        "--keep", type=Path, default=Path("build/guided"), help="folder of files that failed"
    )
    options = parser.parse_args()
    if find_spec("atheris") is None:
        print("guided: needs atheris: pip install 'canroll[judges]'", file=sys.stderr)
        return 2
    formats = [form for form in FORMATS if options.only in form.name]
    totals: Counter[str] = Counter()
    failures: dict[str, str] = {}
    work = {form: max(1, options.inputs // (COSTLY if form.costly else 1)) for form in formats}
    with tempfile.TemporaryDirectory() as temporary, progress("inputs", sum(work.values())) as more:
        good = Path(temporary) / "good"
        make(good)
        print(row("format", ["inputs", *OUTCOMES, "edges", "features"]), flush=True)
        for form in formats:
            name = form.name + (", sums mended" if form.mend else "")
            remedy = "compiled, in a process of its own" if form.apart else lacking(form)
            if remedy:
                print(f"{name:34}  left out: {remedy}", flush=True)
                continue
            task = Task(
                form=form, good=good, inputs=work[form], seed=options.seed, keep=options.keep
            )
            found = fuzz(task, more)
            grown = [f"{a} → {b}" for a, b in (found.edges, found.features)]
            counts = [found.counts[key] for key in OUTCOMES]
            print(row(name, [sum(counts), *counts, *grown]), flush=True)
            totals += found.counts
            failures |= found.failures
    counts = [totals[key] for key in OUTCOMES]
    print(row("all", [sum(counts), *counts]))
    for place, file in failures.items():
        print(f"{place}: kept as {file}")
    return int(totals["failed"] > 0)


if __name__ == "__main__":
    sys.exit(main())
