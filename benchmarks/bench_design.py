"""What a design costs: each solve, each law, all laws; in seconds and against a dense eigenproblem.

    OMP_NUM_THREADS=1 .venv/bin/python benchmarks/bench_design.py

Targets: a solve within 50 ms, a law within 3 s beyond imports, all laws within 20 s.
"""

import time
from collections.abc import Callable

import numpy as np

from canroll.errors import CanrollError
from canroll.gain_gen.calibration.freeze import calibrate
from canroll.gain_gen.design import design
from canroll.gain_gen.laws import LAWS
from canroll.gain_gen.models.task import Delay, Task
from canroll.vehicles import load

SOLVE_LIMIT_MS, LAW_LIMIT_S, ALL_LIMIT_S = 50.0, 3.0, 20.0


def seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def reference() -> float:
    """Median time of the eigenvalues of a 100 x 100 matrix: what this machine does in one go."""
    matrix = np.random.default_rng(0).normal(size=(100, 100))
    return float(np.median([seconds(lambda: np.linalg.eigvals(matrix)) for _ in range(15)]))


def main() -> int:
    import canroll.gain_gen.laws.lmi  # noqa: F401 - its import is not part of a design

    unit = reference()
    print(f"100 x 100 eigenvalues: {1e3 * unit:.1f} ms")
    print(f"{'law':<20}{'seconds':>9}{'eigen':>9}{'solves':>8}{'ms a solve':>12}")
    total, good = 0.0, True
    for law in LAWS:
        if law == "custom":
            continue
        full_car = law.startswith("lqr_full_car")
        task = Task(
            load("car_2020" if full_car else "van_real"),
            Delay(0.015, 0.006, 0.024),
            actuator="valves" if full_car else "suspension",
        )
        started = time.perf_counter()
        try:
            answer = design(law, task)
            calibrate(answer)
        except CanrollError as refused:
            print(f"{law:<20} refused: {refused}")
            good = False
            continue
        taken = time.perf_counter() - started
        total += taken
        solves = answer.solution.extra.get("solves", 0.0)
        each = 1e3 * answer.solution.solve_seconds / solves if solves else 0.0
        good = good and taken <= LAW_LIMIT_S and each <= SOLVE_LIMIT_MS
        print(f"{law:<20}{taken:>9.2f}{taken / unit:>9.0f}{solves:>8.0f}{each:>12.1f}")
    print(f"{'all laws':<20}{total:>9.2f}{total / unit:>9.0f}")
    print(f"ratio all_laws {1e3 * unit / total:.3f}")
    good = good and total <= ALL_LIMIT_S
    print("within the targets" if good else "beyond a target")
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
