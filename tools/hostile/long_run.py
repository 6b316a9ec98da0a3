"""The memory of a long run: peak of a process that drives a number of simulated seconds.

    python -m tools.hostile.long_run [--seconds S ...] [--plant PLANT] [--files]

Each run is a process of its own. The first has an empty cache, so that it compiles the kernels;
the others use what it has left. The peak is the resident set that the system counts (ru_maxrss);
shared libraries are part of it. With ``--files`` each run also writes its folder.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]


def peak(seconds: float, plant: str, cache: Path, out: Path | None) -> tuple[float, float, int]:
    """Peak memory (MB) and processor time (s) of a run, and its exit code."""
    command = [sys.executable, "-m", "canroll.cli.main", "run", "random_road", "--plant", plant]
    command += ["--set", f"duration={seconds:g}"]
    command += [] if out is None else ["--out", str(out)]
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache), "NUMBA_CACHE_DIR": str(cache)}
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=ROOT, env=environment)
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    return usage.ru_maxrss / 1024, usage.ru_utime + usage.ru_stime, child.returncode


def main() -> int:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seconds", type=float, nargs="+", default=[10.0, 300.0, 3600.0])
    parser.add_argument("--plant", default="nonlinear")
    parser.add_argument("--files", action="store_true")
    options = parser.parse_args()
    print(f"{'simulated s':>12}{'cache':>8}{'peak MB':>10}{'CPU s':>8}")
    failed = False
    with tempfile.TemporaryDirectory() as temporary:
        cache = Path(temporary) / "cache"
        out = Path(temporary) / "out" if options.files else None
        for seconds in (options.seconds[0], *options.seconds):
            kernels = "filled" if cache.exists() else "empty"
            memory, spent, code = peak(seconds, options.plant, cache, out)
            failed |= code not in (0, 1)
            print(f"{seconds:12g}{kernels:>8}{memory:10.0f}{spent:8.0f}", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
