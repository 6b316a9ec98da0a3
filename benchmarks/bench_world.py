"""The closed loop beside the plant alone: how much sensors, actuators, bus and ECU add to a step.

Prints, for every body, rates as multiples of real time:

- plant alone: the body with its driver, without bus, nodes and ECU
- compiled loop: vehicle, bus, nodes and native firmware in one kernel, what ``canroll run`` uses
- Python loop, native tick: every tick called from Python; vehicle, bus and nodes are compiled and
  the firmware is C in this one, too, so that it differs from the compiled loop by the calls alone
- Python loop, CPython tick: the same with the firmware run by CPython, line by line, as with
  ``canroll run --backend python``; vehicle, bus and nodes are compiled

A ratio is that of the compiled loop to the plant alone; see ``scripts/ratios``. The time to build
a world is left out. CPU time, best of several runs of each in turn.
"""

import argparse
import os
import time
from dataclasses import replace

from canroll import vehicles
from canroll.codegen.run.backends import open_backend
from canroll.plant_sim import bodies
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.world import open_loop
from canroll.runs import experiment, virtual_time

SCENARIO = "double_lane_change"
LOOPS = {
    "compiled loop": (virtual_time.compiled_ticks, "native"),
    "Python loop, native tick": (virtual_time.observed_ticks, "native"),
    "Python loop, CPython tick": (virtual_time.observed_ticks, "python"),
}
COMPILED = next(iter(LOOPS))
SLOW_RUNS = 3
"""Runs with the firmware in CPython, each of which takes as long as dozens of others."""


def plant_alone(vehicle, body):
    maneuver = maneuvers.build(SCENARIO, vehicle)
    start = time.process_time()
    outputs, _ = open_loop.run_passive(vehicle, bodies.body(body), maneuver)
    return len(outputs) * 1e-3 / (time.process_time() - start)


def closed_loop(settings, controller, loop, backend):
    """Rate of the loop; ``loop`` is that of ``virtual_time`` which yields its ticks."""
    world = experiment.build_world(settings, enabled=True)
    ecu = open_backend(backend, controller.record, settings.firmware)
    end_ns = world.duration_ns
    start = time.process_time()
    for _ in loop(world, ecu, tick_ns=round(settings.tick * 1e9), end_ns=end_ns):
        pass
    return world.now_ns * 1e-9 / (time.process_time() - start)


def rates(settings, controller, vehicle, body, runs):
    """Best rate of the plant alone, and of each loop."""
    alone, best = 0.0, dict.fromkeys(LOOPS, 0.0)
    for number in range(runs):
        alone = max(alone, plant_alone(vehicle, body))
        for name, (loop, backend) in LOOPS.items():
            if backend == "native" or number < SLOW_RUNS:
                best[name] = max(best[name], closed_loop(settings, controller, loop, backend))
    return alone, best


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicle", default="van_real")
    parser.add_argument("--bus", default="500k")
    parser.add_argument("--runs", type=int, default=15)
    options = parser.parse_args()
    print(f"load of the machine before {os.getloadavg()[0]:.2f}, {os.cpu_count()} cores")
    vehicle = vehicles.load(options.vehicle)
    nominal, controller = experiment.plan(
        SCENARIO, vehicle=options.vehicle, bus=options.bus, law="lqr", actuator="suspension"
    )
    for body in bodies.BODIES:
        plant = "linear_car" if body == "linear_car_hydraulic" else body
        settings = replace(nominal, plant=plant)
        alone, best = rates(settings, controller, vehicle, body, options.runs)
        print(f"{body}\n  {'plant alone':<27}{alone:7.1f} x real time")
        for name, rate in best.items():
            of = f"compiled {best[COMPILED] / rate:.2f} times as fast"
            if name == COMPILED:
                of = f"{rate / alone:.2f} of the plant alone"
            print(f"  {name:<27}{rate:7.1f} x real time, {of}", flush=True)
        print(f"ratio {body} {best[COMPILED] / alone:.3f}")


if __name__ == "__main__":
    main()
