"""Runs and campaigns killed at random moments: what remains is whole, or refused.

    python -m tools.hostile.kills [--runs N] [--campaigns N] [--seed S]

``canroll run --out`` is killed by SIGKILL while it drives and writes, into a new folder and into
that of another run. Afterwards ``canroll report`` must refuse the folder, or every file in it must
be of one and the same run. ``canroll campaign --out`` is killed likewise; a table that is there
must be that of an undisturbed campaign, and so must the one after ``--resume``. Exit code 1 if
anything torn is believed. Each command is a process forked from one that has imported and compiled
everything, so that the moments lie in its work and not in its start.
"""

import argparse
import contextlib
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from canroll.cli.main import main as canroll
from tools.progress import progress

RUN = "run double_lane_change --plant roll1 --law lqr --actuator suspension --duration 0.5"
CAMPAIGN = "campaign roundabout --plant roll1 --runs 12 --jobs 1"
SEEDS = (1, 2)
SLACK = 1.2
"""Latest moment of a kill, in durations of an undisturbed command."""


def start(arguments: Sequence[str]) -> int:
    """Start a command in a process and a group of its own; return its id."""
    child = os.fork()
    if child:
        return child
    os.setpgid(0, 0)
    code = 3
    try:
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        code = canroll(list(arguments))
    finally:
        os._exit(code)


def finished(arguments: Sequence[str]) -> int:
    """Run a command to its end; return its exit code."""
    return os.waitstatus_to_exitcode(os.waitpid(start(arguments), 0)[1])


def killed(arguments: Sequence[str], after: float) -> bool:
    """Start a command and kill it and its children ``after`` seconds; whether it still ran."""
    child = start(arguments)
    time.sleep(after)
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)
    with contextlib.suppress(ProcessLookupError):
        os.kill(child, signal.SIGKILL)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


def content(folder: Path) -> dict[str, bytes]:
    """The files of a folder, without the lines of a bus log that say when it was written."""
    return {
        path.name: re.sub(rb"(?m)^(date|Begin Triggerblock) .*$", b"", path.read_bytes())
        for path in folder.iterdir()
        if path.is_file()
    }


def kill_runs(count: int, source: random.Random, work: Path, outcomes: Counter[str]) -> list[str]:
    """Kill ``count`` runs; return what was torn and believed."""
    folder = work / "run"
    commands = [[*RUN.split(), "--seed", str(seed), "--out", str(folder)] for seed in SEEDS]
    whole, longest = [], 0.0
    for command in commands:
        began = time.monotonic()
        assert finished(command) in (0, 1)
        longest = max(longest, time.monotonic() - began)
        whole.append(content(folder))
        shutil.copytree(folder, work / f"whole{len(whole)}")
        shutil.rmtree(folder)
    assert whole[0]["result.json"] != whole[1]["result.json"]
    torn = []
    with progress("runs killed", count) as more:
        while outcomes["killed runs"] < count:
            into_other = source.random() < 0.5
            shutil.rmtree(folder, ignore_errors=True)
            if into_other:
                shutil.copytree(work / "whole1", folder)
            moment = source.uniform(0.0, SLACK * longest)
            if not killed(commands[1], moment):
                outcomes["runs that had ended before"] += 1
                continue
            outcomes["killed runs"] += 1
            more(1)
            report = ["report", str(folder), "--out", str(work / "report.html")]
            believed = finished(report) in (0, 1)
            found = content(folder) if folder.is_dir() else {}
            if not believed:
                outcomes["refused"] += 1
            elif found == whole[0]:
                outcomes["the older run, whole"] += 1
            elif found == whole[1]:
                outcomes["the new run, whole"] += 1
            else:
                differing = [k for k in found if found[k] not in (whole[0].get(k), whole[1].get(k))]
                torn.append(f"after {moment:.3f} s: a mixture; neither's: {differing}")
    return torn


def kill_campaigns(
    count: int, source: random.Random, work: Path, outcomes: Counter[str]
) -> list[str]:
    """Kill ``count`` campaigns and continue each; return what was torn and believed."""
    folder = work / "campaign"
    command = [*CAMPAIGN.split(), "--out", str(folder)]
    began = time.monotonic()
    if finished(command) not in (0, 1):
        return ["the undisturbed campaign fails"]
    longest = time.monotonic() - began
    table = next(folder.rglob("*.parquet"), None) or next(work.glob("campaign*.parquet"))
    place = table.relative_to(work)
    whole = table.read_bytes()
    torn = []
    with progress("campaigns killed", count) as more:
        while outcomes["killed campaigns"] < count:
            shutil.rmtree(folder, ignore_errors=True)
            (work / place).unlink(missing_ok=True)
            moment = source.uniform(0.0, SLACK * longest)
            if not killed(command, moment):
                outcomes["campaigns that had ended before"] += 1
                continue
            outcomes["killed campaigns"] += 1
            more(1)
            if (work / place).is_file():
                outcomes["with their whole table"] += 1
                if (work / place).read_bytes() != whole:
                    torn.append(f"after {moment:.3f} s: another table")
            code = finished([*command, "--resume"])
            if code not in (0, 1) or (work / place).read_bytes() != whole:
                torn.append(f"after {moment:.3f} s: --resume gives exit code {code} or other draws")
            else:
                outcomes["continued to the same table"] += 1
    return torn


def main() -> int:
    """Kill runs and campaigns."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--campaigns", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    source = random.Random(options.seed)
    outcomes: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as temporary:
        work = Path(temporary)
        # imports and compiles, so that the commands forked from here need not
        with contextlib.redirect_stdout(None):
            canroll([*RUN.split(), "--seed", "0", "--out", str(work / "first")])
        torn = kill_runs(options.runs, source, work, outcomes)
        if options.campaigns:
            torn += kill_campaigns(options.campaigns, source, work, outcomes)
    for name, number in outcomes.items():
        print(f"{number:5} {name}")
    print(f"{len(torn):5} torn results believed")
    for line in torn:
        print(f"      {line}")
    return int(bool(torn))


if __name__ == "__main__":
    sys.exit(main())
