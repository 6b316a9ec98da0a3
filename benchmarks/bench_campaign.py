"""Draws of a campaign: rates, where the time goes, and what a second process is worth.

A draw is a double lane change of the 14-DOF car without and with control over a bus at 50 % load.
CPU times are of one process, the ways of driving a draw in turn, best of the rounds:

- whole runs, Python loop: two complete runs with their records, every tick called from Python
- Python loop: the figures alone, every tick called from Python
- compiled loop: the figures alone, as a campaign drives them

All have the native firmware, and compiled kernels of vehicle, bus and nodes.

The ratio ``draw`` is 100 million yardsticks of ``bench_plant`` over a draw; see ``scripts/ratios``.

Wall times are of one process, of two, and of two workers of a Dask cluster, each driving for
``--seconds`` after a round that loads the kernels. Beside other work on the machine they say
little: the load before is printed.
"""

import argparse
import os
import time
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from itertools import count

from bench_plant import yardstick

from canroll.cases.engine import LOCAL, engine, results
from canroll.extensions.campaign import campaign_file, figures
from canroll.extensions.campaign.plan import drive_chunk
from canroll.extensions.campaign.summary import count_of
from canroll.plant_sim.world import open_loop, world
from canroll.runs import experiment, virtual_time
from canroll.studies import variation

SCENARIO = "double_lane_change"
CHUNK = 16
"""Draws of a chunk: half a second."""
WARM_UP_S = 3.0
"""Time in which every process has loaded the kernels."""
BEST_OF = 5
"""CPU times of each way of driving a draw."""


def yardsticks(number):
    """CPU time of so many yardsticks (ms)."""
    start = time.process_time()
    yardstick(number)
    return 1e3 * (time.process_time() - start)


def whole_runs(controller, draws):
    for each in draws:
        experiment.simulate(each, controller)


WAYS = {
    "whole runs, Python loop": (whole_runs, virtual_time.observed_ticks),
    "Python loop": (figures.figures, virtual_time.observed_ticks),
    "compiled loop": (figures.figures, virtual_time.compiled_ticks),
}


def milliseconds(way, loop, controller, draws):
    """CPU time of a draw."""
    usual, virtual_time.compiled_ticks = virtual_time.compiled_ticks, loop
    start = time.process_time()
    way(controller, draws)
    virtual_time.compiled_ticks = usual
    return 1e3 * (time.process_time() - start) / len(draws)


@contextmanager
def timed(times, name, module, function):
    """Add the CPU time inside ``module.function`` to ``times``."""
    original = getattr(module, function)

    def run(*args, **options):
        start = time.process_time()
        try:
            return original(*args, **options)
        finally:
            times[name] = times.get(name, 0.0) + time.process_time() - start

    setattr(module, function, run)
    yield
    setattr(module, function, original)


@contextmanager
def timed_kernels(times):
    """Add the CPU time inside the kernels to ``times``."""
    entry = world.entry

    class Kernels:
        @staticmethod
        def of(kernel, arguments):
            compiled = entry(kernel, arguments)

            def run(*values):
                start = time.process_time()
                try:
                    return compiled(*values)
                finally:
                    times["kernel"] = times.get("kernel", 0.0) + time.process_time() - start

            return run

    world.entry = Kernels.of
    with timed(times, "kernel", open_loop, "_drive_through"):
        yield
    world.entry = entry


def shares(controller, draws):
    """Fractions of the CPU time of ``draws``: kernels, set-up, figures, and what is left."""
    times = {}
    start = time.process_time()
    with (
        timed_kernels(times),
        timed(times, "set-up", experiment, "build_world"),
        timed(times, "set-up", experiment, "open_backend"),
        timed(times, "set-up", open_loop, "start"),
        timed(times, "figures", figures.metrics, "judge"),
        timed(times, "figures", figures, "limit_cycle_of"),
    ):
        figures.figures(controller, draws)
    total = time.process_time() - start
    found = {name: part / total for name, part in times.items()}
    return found | {"rest": 1.0 - sum(found.values())}


def wall_rate(plan, where, seconds):
    """Draws per second of wall time of an engine that drives for ``seconds``."""
    start = time.perf_counter()

    def tasks():
        for number in count():
            if time.perf_counter() - start > seconds:
                return
            yield str(number), drive_chunk, (plan, number % plan.chunks)

    draws = sum(count_of(rows) for _, rows, _ in results(where, None, tasks()))
    return draws / (time.perf_counter() - start)


def cluster():
    """A Dask cluster of two workers, or None without distributed."""
    try:
        from distributed import LocalCluster
    except ModuleNotFoundError:
        return nullcontext()
    return LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--bus", default="500k")
    options = parser.parse_args()
    print(f"load of the machine before {os.getloadavg()[0]:.2f}, {os.cpu_count()} cores")
    plan = campaign_file.of_options(
        SCENARIO,
        {"bus": options.bus},
        runs=CHUNK * 256,
        seed=0,
        spread=variation.DEFAULT_SPREAD,
        buses=[],
        faults=[],
    ).plan()
    plan = replace(plan, sampling=replace(plan.sampling, chunk=CHUNK))
    _, draws = plan.draws(0)
    for way, loop in WAYS.values():
        milliseconds(way, loop, plan.controller, draws[:1])
    best = {
        name: min(milliseconds(*way, plan.controller, draws[:16]) for _ in range(BEST_OF))
        for name, way in WAYS.items()
    }
    for name, found in best.items():
        over = found / best["compiled loop"]
        print(f"{name:24} {found:6.1f} ms of CPU time a draw, {over:.2f} times the compiled loop's")
    unit = min(yardsticks(10_000_000) for _ in range(BEST_OF)) / 10_000_000
    print(f"ratio draw {1e8 * unit / best['compiled loop']:.3f}")
    print(f"ratio python_loop {best['Python loop'] / best['compiled loop']:.3f}")
    found = shares(plan.controller, draws[:16])
    print("shares: " + ", ".join(f"{name} {share:.2f}" for name, share in found.items()))
    with ExitStack() as opened:
        engines = {
            "one process": opened.enter_context(engine(LOCAL, 1)),
            "two processes": opened.enter_context(engine(LOCAL, 2)),
        }
        dask = opened.enter_context(cluster())
        if dask is not None:
            engines["two Dask workers"] = opened.enter_context(engine(dask.scheduler_address, 2))
        for where in engines.values():
            wall_rate(plan, where, WARM_UP_S)
        rates = {name: wall_rate(plan, each, options.seconds) for name, each in engines.items()}
    one, two, *others = rates.values()
    for name, rate in rates.items():
        print(f"{name:24} {rate:6.1f} draws per second over {options.seconds:g} s")
    print(f"ratio two_processes {two / one:.3f}")
    for rate in others:
        print(f"ratio dask_over_pool {rate / two:.3f}")
    print(f"a million draws on two cores: {1e6 / two / 3600:.1f} h")


if __name__ == "__main__":
    main()
