"""All backends on the same traffic, byte for byte, for any duration.

    python -m tools.differential [--ticks N] [--cortex CPU] [--specialise] [--jobs J]

One of four runs is a random calibration in random traffic, three are recorded manoeuvres of the
generator's designs with hostile episodes, in which the loop is active for most of the time. The
states after every tick and all frames of CPython, the native library and, if requested, a Cortex-M
in QEMU and the firmware specialised for the calibration must be equal.
"""

import argparse
import signal
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from codegen.run import cortex as cortex_build
from codegen.run import ecu_traffic, memory_image, native, qemu
from codegen.run.backends import PythonEcu
from codegen.run.bus_firmware import BusFirmware, built_in
from codegen.run.ecu_traffic import EcuTraffic
from codegen.run.native import Replay
from codegen.specialise.firmware import specialised
from firmware.calibration import Calibration
from firmware.com.signals import RX_IDS
from firmware.state import Ecu
from tools.differential.recorded_traffic import Recording, recordings
from tools.progress import progress

TICKS = 500
MODES = ("INIT", "ACTIVE", "DEGRADED", "SAFE")


@dataclass(frozen=True, slots=True)
class Task:
    """One run; ``name`` identifies it, so that it can be repeated."""

    name: str
    calibration: Calibration
    traffic: EcuTraffic
    cpu: str | None
    specialise: bool = False


@dataclass(frozen=True, slots=True)
class Outcome:
    """``difference``: "" or the first tick in which two backends differ, and the fields.

    ``modes`` counts the ticks that ended in each mode.
    """

    difference: str
    modes: NDArray[np.int64]


def reference(
    calibration: Calibration, traffic: EcuTraffic, firmware: BusFirmware | None = None
) -> Replay:
    """Results of the native library, of another firmware than the general one where given."""
    cals = np.frombuffer(memory_image.image(calibration), memory_image.dtype(Calibration), 1).copy()
    library = native.library_of(firmware or built_in())
    return library.replay(library.start(cals), cals, [traffic], states=True)


def python_states(calibration: Calibration, traffic: EcuTraffic) -> list[bytes]:
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


def compare(task: Task) -> Outcome:
    """Run one calibration on all backends."""
    calibration, traffic = task.calibration, task.traffic
    expected = reference(calibration, traffic)
    assert expected.states is not None
    wanted = expected.states[0]
    modes = np.bincount(wanted["mode"], minlength=len(MODES))
    runs = {"python": python_states(calibration, traffic)}
    if task.cpu is not None:
        cortex = qemu.replay(calibration, traffic, task.cpu)
        runs[task.cpu] = [state.tobytes() for state in cortex.states]
        if cortex.frames.tobytes() != expected.frames.tobytes():
            return Outcome(f"{task.name}: {task.cpu} sends other frames", modes)
    if task.specialise:
        own = reference(calibration, traffic, specialised(built_in(), calibration))
        assert own.states is not None
        runs["specialised"] = [state.tobytes() for state in own.states[0]]
        if own.frames.tobytes() != expected.frames.tobytes():
            return Outcome(f"{task.name}: the specialised firmware sends other frames", modes)
    for name, states in runs.items():
        for t, state in enumerate(states):
            other = wanted[t].tobytes()
            if state != other:
                found = ", ".join(memory_image.differences(Ecu, state, other))
                return Outcome(f"{task.name}: {name} differs in tick {t}: {found}", modes)
    return Outcome("", modes)


def tasks(ticks: int, seed: int, recorded: Sequence[Recording], cpu: str | None) -> Iterator[Task]:
    """Runs of at least ``ticks`` together."""
    done = 0
    for k in count(seed):
        if done >= ticks:
            return
        if k % 4 == 0 or not recorded:
            traffic = ecu_traffic.random_traffic(k, TICKS, hostile=0.15 if k % 8 == 0 else 0.01)
            task = Task(f"seed {k}", ecu_traffic.random_calibration(k), traffic, cpu)
        else:
            which = recorded[k % len(recorded)]
            traffic = ecu_traffic.disturbed(which.traffic, k)
            task = Task(f"seed {k}, {which.case}", which.calibration, traffic, cpu)
        done += task.traffic.ticks
        yield task


def _leave_to_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run(arguments: argparse.Namespace) -> int:
    """Compare for a number of ticks; 1 at the first difference."""
    recorded = recordings()
    modes = np.zeros(len(MODES), np.int64)
    # built once, before several processes would
    native.library()
    chosen = (
        replace(task, specialise=arguments.specialise)
        for task in tasks(arguments.ticks, arguments.seed, recorded, arguments.cortex)
    )
    with (
        ProcessPoolExecutor(arguments.jobs, initializer=_leave_to_parent) as pool,
        progress("ticks", arguments.ticks) as more,
    ):
        try:
            for outcome in pool.map(compare, chosen):
                modes += outcome.modes
                more(int(outcome.modes.sum()))
                if outcome.difference:
                    print(outcome.difference)
                    return 1
        finally:
            pool.shutdown(cancel_futures=True)
    backends = ["CPython", "native", *([arguments.cortex] if arguments.cortex else [])]
    backends += ["specialised"] if arguments.specialise else []
    print(f"{modes.sum()} ticks: {' = '.join(backends)}, 0 differing bytes")
    shares = (f"{name} {100 * n / modes.sum():.1f} %" for name, n in zip(MODES, modes, strict=True))
    print(f"{len(recorded)} designs recorded and disturbed; {', '.join(shares)}")
    return 0


def main() -> int:
    """Run the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--ticks", type=int, default=10_000)
    parser.add_argument("--cortex", choices=tuple(cortex_build.CPUS), help="also in QEMU")
    parser.add_argument(
        "--specialise", action="store_true", help="also specialised for each calibration"
    )
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=1)
    try:
        return run(parser.parse_args())
    except CanrollError as error:
        print(f"differential: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("differential: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
