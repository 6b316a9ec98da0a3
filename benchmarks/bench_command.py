"""Where the processor's time of a command goes: the phases of one run, and whole commands.

    python benchmarks/bench_command.py [--repeat N]

The phases are shares of one ``canroll run double_lane_change`` in a process of its own: imports,
wherever they happen, the design, the drives (with the loading of their machine code), what judges
them, page, and archive with all other files. Commands are measured with all that they start,
warm, the least of N. Seconds are the processor's, user and system.
"""

import argparse
import builtins
import importlib
import json
import os
import subprocess
import sys
import tempfile
from functools import wraps
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RUN = ("run", "double_lane_change")
COMMANDS = (
    ("--help",),
    ("list", "laws"),
    ("bus", "500k"),
    ("prove",),
    ("design", "--law", "lqr"),
    RUN,
)
PHASES = (
    ("design", "canroll.runs.experiment", "plan"),
    ("drive", "canroll.runs.experiment", "drive"),
    ("judge", "canroll.runs.experiment", "assess"),
    ("page", "canroll.report.run_folder", "run_page"),
    ("archive", "canroll.report.run_folder", "write_files"),
)
"""Phase, module and function; what a function calls of another phase is that phase's."""


def processor():
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


class Phases:
    """Time by phase: that of the innermost one that is under way."""

    def __init__(self):
        self.seconds = {}
        self._under_way = ["other"]
        self._since = 0.0

    def _switch(self):
        now = processor()
        name = self._under_way[-1]
        self.seconds[name] = self.seconds.get(name, 0.0) + now - self._since
        self._since = now

    def of(self, name, function):
        @wraps(function)
        def timed(*args, **kwargs):
            self._switch()
            self._under_way.append(name)
            try:
                return function(*args, **kwargs)
            finally:
                self._switch()
                self._under_way.pop()

        return timed

    def importing(self, function):
        timed = self.of("imports", function)

        @wraps(function)
        def outermost(*args, **kwargs):
            nested = self._under_way[-1] == "imports"
            return (function if nested else timed)(*args, **kwargs)

        return outermost


def child(folder):
    """Run the command with its phases timed; print them as JSON."""
    phases = Phases()
    phases.seconds["start of Python"] = phases._since = processor()
    builtins.__import__ = phases.importing(builtins.__import__)
    importlib.import_module = phases.importing(importlib.import_module)
    main = importlib.import_module("canroll.cli.main").main
    importlib.import_module("canroll.runs.mdf").put_off()
    for name, module, function in PHASES:
        home = importlib.import_module(module)
        setattr(home, function, phases.of(name, getattr(home, function)))
    sys.stdout = open(os.devnull, "w")  # noqa: SIM115
    main([*RUN, "--out", folder])
    phases._switch()
    sys.stdout = sys.__stdout__
    loaded = sum(name.split(".")[0] == "canroll" for name in sys.modules)
    print(json.dumps({"modules": loaded, "seconds": phases.seconds}))


def started(*words):
    """Return what a process printed, and the processor's time that it took."""
    before = processor()
    done = subprocess.run(
        [sys.executable, *words], cwd=Path.cwd(), capture_output=True, text=True, check=False
    )
    if done.returncode > 1:
        raise SystemExit(done.stderr)
    return done.stdout, processor() - before


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=3, metavar="N")
    parser.add_argument("--child", metavar="FOLDER", help=argparse.SUPPRESS)
    args = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if args.child:
        child(args.child)
        return
    with tempfile.TemporaryDirectory() as folder:
        kept = [json.loads(started(__file__, "--child", folder)[0]) for _ in range(args.repeat + 1)]
        # the first one fills the caches
        best = min(kept[1:], key=lambda one: sum(one["seconds"].values()))
        total = sum(best["seconds"].values())
        print(f"canroll {' '.join(RUN)}: {total:.2f} s, {best['modules']} modules of ours")
        for name, seconds in sorted(best["seconds"].items(), key=lambda row: -row[1]):
            print(f"  {name:<16}{seconds:6.2f} s {100 * seconds / total:5.0f} %")
        print("whole commands, least of", args.repeat)
        for words in COMMANDS:
            out = () if words[0] not in ("run", "design") else ("--out", folder)
            cli = ("-m", "canroll.cli.main", *words, *out)
            print(
                f"  {'canroll ' + ' '.join(words):<32}"
                f"{min(started(*cli)[1] for _ in range(args.repeat)):6.2f} s"
            )


if __name__ == "__main__":
    sys.path.insert(0, str(Path.cwd()))
    main()
