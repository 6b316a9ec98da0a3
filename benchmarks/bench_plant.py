"""Every plant body alone, 1 ms Runge-Kutta steps on one core, as multiples of real time.

Each body drives a double lane change with the driver in the loop and every output recorded; the
time to build it is left out. Best of several runs. A yardstick, one step of a compiled shift
register, measured in the same run lets numbers of different machines compare.

A ratio ``NAME`` is 1000 yardsticks over a step of that body, ``NAME_driven`` over a step with the
driver and the record; see ``scripts/ratios``.
"""

import argparse
import time

import numpy as np

from canroll import vehicles
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.world import open_loop


@njit
def yardstick(count):
    state = 88172645463325252
    for _ in range(count):
        state ^= state << 13
        state ^= state >> 7
        state ^= state << 17
    return state


def best(function, repeats):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


@njit
def steps(step, state, inputs, parameters, outputs, count):  # noqa: PLR0917
    for _ in range(count):
        step(state, inputs, parameters, outputs, 1e-3)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicle", default="van_real")
    parser.add_argument("--seconds", type=float, default=20.0, help="simulated time a run")
    parser.add_argument("--repeats", type=int, default=5)
    args = parser.parse_args()
    vehicle = vehicles.load(args.vehicle)
    count = round(args.seconds * 1000)
    yardstick(10)
    unit = best(lambda: yardstick(1_000_000), args.repeats) / 1e6
    print(f"{'body':20}{'alone':>12}{'µs a step':>12}{'yardsticks':>12}{'with driver':>14}")
    for name, body in bodies.BODIES.items():
        outputs = np.zeros(ports.N_OUTPUTS)

        def alone(body=body, outputs=outputs):
            state, parameters = body.build(vehicle, 20.0)
            inputs = ports.initial_inputs()
            inputs[ports.STEER] = 0.02
            steps(body.step, state, inputs, parameters, outputs, count)

        def driven(body=body):
            maneuver = maneuvers.build("double_lane_change", vehicle)
            return len(open_loop.run_passive(vehicle, body, maneuver)[0])

        alone()
        recorded = driven()
        seconds = best(alone, args.repeats)
        with_driver = recorded * STEP_NS * 1e-9 / best(driven, args.repeats)
        step = seconds / count
        print(
            f"{name:20}{args.seconds / seconds:11.0f}x{step * 1e6:12.2f}{step / unit:12.0f}"
            f"{with_driver:13.0f}x"
        )
        print(f"ratio {name} {1e3 * unit / step:.3f}")
        print(f"ratio {name}_driven {1e3 * unit * with_driver / (STEP_NS * 1e-9):.3f}")


if __name__ == "__main__":
    main()
