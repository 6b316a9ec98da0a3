"""The closed loop beside the plant alone: how much sensors, actuators, bus and ECU add to a step.

Prints, for every body, the rates of the plant alone, of the compiled closed loop and of the loop
that calls every tick from Python, as multiples of real time, and their ratios. The time to build a
world is left out. CPU time, best of several runs of each in turn.
"""

import argparse
import time
from dataclasses import replace

import vehicles
from codegen.run.backends import open_backend
from hil.runs import experiment, virtual_time
from plant_sim import bodies
from plant_sim.driving import maneuvers
from plant_sim.world import open_loop

SCENARIO = "double_lane_change"


def plant_alone(vehicle, body):
    maneuver = maneuvers.build(SCENARIO, vehicle)
    start = time.process_time()
    outputs, _ = open_loop.run_passive(vehicle, bodies.body(body), maneuver)
    return len(outputs) * 1e-3 / (time.process_time() - start)


def closed_loop(settings, controller, loop):
    """Rate of the loop; ``loop`` is that of ``virtual_time`` which yields its ticks."""
    world = experiment.build_world(settings, enabled=True)
    ecu = open_backend("native", controller.record, settings.firmware)
    end_ns = world.duration_ns
    start = time.process_time()
    for _ in loop(world, ecu, tick_ns=round(settings.tick * 1e9), end_ns=end_ns):
        pass
    return world.now_ns * 1e-9 / (time.process_time() - start)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicle", default="van_real")
    parser.add_argument("--bus", default="500k")
    parser.add_argument("--runs", type=int, default=15)
    options = parser.parse_args()
    vehicle = vehicles.load(options.vehicle)
    nominal, controller = experiment.plan(
        SCENARIO, vehicle=options.vehicle, bus=options.bus, law="lqr", actuator="suspension"
    )
    for body in bodies.BODIES:
        plant = "linear_car" if body == "linear_car_hydraulic" else body
        settings = replace(nominal, plant=plant)
        alone, compiled, interpreted = [], [], []
        for _ in range(options.runs):
            alone.append(plant_alone(vehicle, body))
            compiled.append(closed_loop(settings, controller, virtual_time.compiled_ticks))
            interpreted.append(closed_loop(settings, controller, virtual_time.observed_ticks))
        fast = max(compiled)
        print(
            f"{body:20} alone {max(alone):6.0f} x real time, closed loop {fast:6.0f} x "
            f"({fast / max(alone):.2f} of it, {fast / max(interpreted):.2f} times the "
            "interpreted loop)"
        )


if __name__ == "__main__":
    main()
