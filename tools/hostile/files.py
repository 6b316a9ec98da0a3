"""Damaged files of every format: each is read, or refused in one line.

    python -m tools.hostile.files [--each N] [--seed S]

Whatever else a reader does (another exception, a refusal of several lines, more memory than
``MEMORY``, more time than ``SECONDS``) is listed with its place and ends it with exit code 1.
"""

import argparse
import random
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from pathlib import Path

from tools.hostile.formats import FORMATS, Format, damage, lacking, make, refusal
from tools.progress import progress

MEMORY = 8 << 30
"""Bytes of address space of the process."""
SECONDS = 60
COSTLY = 10
"""A costly format has one file for every so many of the others."""


def late(*_: object) -> None:
    """End what takes too long; a handler of SIGALRM."""
    raise TimeoutError(f"more than {SECONDS} s")


def place_of(error: BaseException) -> str:
    """Return the exception with the line of ours that let it through."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if "site-packages" not in f[0]]
    last = frames[-1]
    return f"{type(error).__name__} at {last.filename}:{last.lineno}: {str(error)[:80]}"


def attempt(form: Format, path: Path, found: Counter[str]) -> str:
    """Read one file; return "read", "refused" or "failed", and count failures in ``found``."""
    signal.alarm(SECONDS)
    try:
        return "refused" if refusal(form, path) else "read"
    except Exception as error:
        found[f"{form.name}: {place_of(error)}"] += 1
        return "failed"
    finally:
        signal.alarm(0)


def main() -> int:
    """Damage and read files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--each", type=int, default=100, help="files of each format")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="formats whose name contains this")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGALRM, late)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    found: Counter[str] = Counter()
    totals: Counter[str] = Counter()
    formats = [form for form in FORMATS if options.only in form.name]
    with tempfile.TemporaryDirectory() as temporary, progress("files", options.each) as more:
        good, work = Path(temporary) / "good", Path(temporary) / "work"
        make(good)
        print(f"{'format':34}{'files':>7}{'read':>7}{'refused':>9}{'failed':>8}")
        for form in formats:
            if remedy := lacking(form):
                print(f"{form.name:34}  left out: {remedy}")
                continue
            source = random.Random(f"{options.seed} {form.name} {form.mend is not None}")
            outcomes: Counter[str] = Counter()
            for n in range(max(1, options.each // COSTLY) if form.costly else options.each):
                # a name of its own: readers keep what they have read
                path = damage(form, good, work / str(n), source)
                outcomes[attempt(form, path, found)] += 1
                shutil.rmtree(path.parent)
                more(n)
            totals += outcomes
            name = form.name + (", sums mended" if form.mend else "")
            row = [outcomes[key] for key in ("read", "refused", "failed")]
            print(f"{name:34}{sum(row):7}{row[0]:7}{row[1]:9}{row[2]:8}", flush=True)
    row = [totals[key] for key in ("read", "refused", "failed")]
    print(f"{'all':34}{sum(row):7}{row[0]:7}{row[1]:9}{row[2]:8}")
    for line, count in found.most_common():
        print(f"{count:5} × {line}")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
