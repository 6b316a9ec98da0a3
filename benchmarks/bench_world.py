"""The closed world beside the plant alone: how much sensors, actuators and bus add to a step.

Prints, for every body, the rate of the plant alone and of the whole world with a command frame
every 10 ms, both as multiples of real time, and their ratio. CPU time, best of several runs.
"""

import argparse
import time

import numpy as np

import vehicles
from plant_sim import bodies, can_bus
from plant_sim.driving import maneuvers
from plant_sim.nodes import codec, e2e
from plant_sim.world import open_loop
from plant_sim.world.world import World

TICK_NS = 10_000_000
COMMAND = "SuspensionForceCommand"


def commands():
    """One period of protected command frames, their counters in order."""
    index = codec.message_index(COMMAND)
    tables = codec.load()
    rows = (tables.protection[index], tables.identity[index], tables.crc[index])
    frames = []
    for k in range(int(rows[0][e2e.VALUES])):
        payload = np.zeros(codec.MAX_PAYLOAD, np.uint8)
        e2e.protect(*rows, k, payload)
        frames.append(payload[:8].tobytes())
    return int(tables.message[index, codec.IDENT]), frames


def plant_alone(vehicle, body):
    maneuver = maneuvers.build("double_lane_change", vehicle)
    start = time.process_time()
    open_loop.run_passive(vehicle, bodies.body(body), maneuver)
    return maneuver.duration_ns * 1e-9 / (time.process_time() - start)


def whole_world(vehicle, body, bus):
    ident, frames = commands()
    world = World(
        vehicle=vehicle,
        body=body,
        actuator="suspension",
        maneuver=maneuvers.build("double_lane_change", vehicle),
        profile=can_bus.load_profile(bus),
    )
    start = time.process_time()
    for k, t_ns in enumerate(range(TICK_NS, world.duration_ns, TICK_NS)):
        world.advance(t_ns)
        world.submit(t_ns + 100_000, ident, frames[k % len(frames)])
    return world.duration_ns * 1e-9 / (time.process_time() - start)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicle", default="van_real")
    parser.add_argument("--bus", default="500k")
    parser.add_argument("--runs", type=int, default=15)
    options = parser.parse_args()
    vehicle = vehicles.load(options.vehicle)
    codec.load()
    for body in bodies.BODIES:
        alone, world = 0.0, 0.0
        for _ in range(options.runs):
            alone = max(alone, plant_alone(vehicle, body))
            world = max(world, whole_world(vehicle, body, options.bus))
        print(
            f"{body:10} alone {alone:7.0f} x real time, world {world:7.0f} x, "
            f"ratio {world / alone:.2f}"
        )


if __name__ == "__main__":
    main()
