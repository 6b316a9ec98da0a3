"""Draws of a campaign: rate, share of the kernel, and what a second process is worth.

A draw is a double lane change of the 14-DOF car without and with control. Rates are draws per
second of CPU time in one process, by the compiled and by the interpreted loop in turn, and per
second of wall time in one process and in two, which says something on an idle machine only.
"""

import argparse
import time

from hil.campaign.engine import engine
from hil.runs import experiment, virtual_time
from hil.studies import variation
from hil.studies.figures import figures
from plant_sim.world import world

SCENARIO = "double_lane_change"
LOOPS = {"compiled": virtual_time.compiled_ticks, "interpreted": virtual_time.observed_ticks}


def rate(controller, draws):
    start = time.process_time()
    figures(controller, draws)
    return len(draws) / (time.process_time() - start)


def kernel_share(controller, draws):
    """Fraction of the CPU time of ``draws`` inside the kernel."""
    entry, inside = world.entry, []

    def timed_entry(kernel, arguments):
        compiled = entry(kernel, arguments)

        def run(*values):
            start = time.process_time()
            try:
                return compiled(*values)
            finally:
                inside.append(time.process_time() - start)

        return run

    world.entry = timed_entry
    start = time.process_time()
    figures(controller, draws)
    total = time.process_time() - start
    world.entry = entry
    return sum(inside) / total


def wall_rate(controller, draws, jobs, chunk):
    chunks = [draws[first : first + chunk] for first in range(0, len(draws), chunk)]
    with engine("local", jobs) as where:
        # the first chunk of each process loads the kernels
        for ready in [where.submit(figures, controller, chunks[0]) for _ in range(jobs)]:
            ready.result()
        start = time.perf_counter()
        for done in [where.submit(figures, controller, each) for each in chunks]:
            done.result()
        return len(draws) / (time.perf_counter() - start)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--bus", default="500k")
    options = parser.parse_args()
    nominal, controller = experiment.plan(SCENARIO, bus=options.bus)
    spread = variation.DEFAULT_SPREAD
    draws = [
        variation.draw(nominal, index, spread=spread, seed=0) for index in range(options.draws)
    ]
    figures(controller, draws[:1])
    best = dict.fromkeys(LOOPS, 0.0)
    for _ in range(options.rounds):
        for name, loop in LOOPS.items():
            virtual_time.compiled_ticks = loop
            best[name] = max(best[name], rate(controller, draws[:8]))
    virtual_time.compiled_ticks = LOOPS["compiled"]
    for name, found in best.items():
        print(f"{name:12} {found:6.1f} draws per second of CPU time")
    print(f"compiled over interpreted {best['compiled'] / best['interpreted']:.2f}")
    print(f"kernel share {kernel_share(controller, draws[:16]):.2f}")
    one, two = (wall_rate(controller, draws, jobs, 8) for jobs in (1, 2))
    print(f"one process {one:.1f}, two {two:.1f} draws per second: {two / one:.2f} times")


if __name__ == "__main__":
    main()
