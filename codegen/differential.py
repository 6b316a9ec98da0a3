"""All backends on the same hostile traffic, byte for byte, for as long as one likes.

    python -m codegen.differential [--ticks N] [--cortex CPU]

Each calibration is random, each runs 500 ticks; the states after every tick and all frames of
CPython, the native library and, where asked, a Cortex-M in QEMU must be equal.
"""

import argparse
import sys
from dataclasses import dataclass

import numpy as np

from codegen import layout, native, qemu_target, target, vectors
from codegen.backends import PythonEcu
from codegen.native import Replay
from codegen.vectors import Traffic
from firmware.calibration import Calibration
from firmware.signals import RX_IDS
from firmware.state import Ecu

TICKS = 500


@dataclass(frozen=True, slots=True)
class Difference:
    """The first tick in which two backends differ, and the fields."""

    backend: str
    tick: int
    fields: tuple[str, ...]


def reference(calibration: Calibration, traffic: Traffic) -> Replay:
    """What the native library does."""
    cals = np.frombuffer(layout.image(calibration), layout.dtype(Calibration), 1).copy()
    library = native.library()
    return library.replay(library.start(cals), cals, [traffic], states=True)


def python_states(calibration: Calibration, traffic: Traffic) -> list[bytes]:
    """The state after each tick in CPython."""
    ecu = PythonEcu(calibration)
    bounds = np.searchsorted(traffic.frames["tick"], np.arange(traffic.ticks + 1))
    states = []
    for t in range(traffic.ticks):
        for event in traffic.frames[bounds[t] : bounds[t + 1]]:
            ident = RX_IDS[event["message"]]
            ecu.receive(ident, event["payload"].tobytes(), int(event["length"]))
        ecu.tick(int(traffic.elapsed[t]))
        states.append(ecu.image())
    return states


def compare(
    calibration: Calibration, traffic: Traffic, cpu: str | None = None
) -> Difference | None:
    """Run one calibration on all backends; None where no byte differs."""
    native_run = reference(calibration, traffic)
    assert native_run.states is not None
    runs = {"python": python_states(calibration, traffic)}
    if cpu is not None:
        cortex = qemu_target.replay(calibration, traffic, cpu)
        runs[cpu] = [state.tobytes() for state in cortex.states]
        if cortex.frames.tobytes() != native_run.frames.tobytes():
            return Difference(cpu, -1, ("frames",))
    for name, states in runs.items():
        for t, state in enumerate(states):
            other = native_run.states[0, t].tobytes()
            if state != other:
                return Difference(name, t, tuple(layout.differences(Ecu, state, other)))
    return None


def main() -> int:
    """Compare for a number of ticks; 1 at the first difference."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--ticks", type=int, default=10_000)
    parser.add_argument("--cortex", choices=tuple(target.CPUS), help="also in QEMU")
    parser.add_argument("--seed", type=int, default=1000)
    arguments = parser.parse_args()
    done = 0
    for seed in range(arguments.seed, arguments.seed + -(-arguments.ticks // TICKS)):
        calibration = vectors.random_calibration(seed)
        # mild traffic keeps the loop running, harsh traffic keeps it in SAFE most of the time
        traffic = vectors.random_traffic(seed, TICKS, hostile=0.15 if seed % 4 == 0 else 0.01)
        found = compare(calibration, traffic, arguments.cortex)
        if found is not None:
            print(f"seed {seed}: {found}")
            return 1
        done += TICKS
    backends = ["CPython", "native", *([arguments.cortex] if arguments.cortex else [])]
    print(f"{done} ticks: {' = '.join(backends)}, 0 differing bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
