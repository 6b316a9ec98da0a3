"""The firmware on this machine and on a Cortex-M4: a tick in CPython, in C, in a batch of C.

The generated C, general and specialised for the calibration, is held against the whole tick
written by hand (handwritten/), which drives suspension forces: same frames, same states, ratio of
the ticks by the same flags. Targets: a batched tick takes at most 0.3 us, the general C at most 1.1
times the hand-written and that for one calibration at most 1.0 times its cycles, a Cortex-M4
at most 2500 instructions for constant-gain state feedback and 9000 for covariance and
identification. All of them are designed with ``--no-watch-response``.
"""

import argparse
import time
from types import SimpleNamespace

import handwritten
import numpy as np

from canroll.cli.timing import recorded
from canroll.codegen.run import cortex as cortex_build
from canroll.codegen.run import memory_image, native, qemu
from canroll.codegen.run.backends import NativeEcu, PythonEcu
from canroll.codegen.run.bus_firmware import built_in
from canroll.codegen.run.specialised import specialised
from canroll.codegen.worst_case.cycles import Timing
from canroll.codegen.worst_case.firmware_bound import cycle_costs
from canroll.codegen.worst_case.footprint import footprint
from canroll.firmware.calibration import Calibration
from canroll.firmware.com.signals import RX_IDS


def best(run, repeats):
    """Seconds of the fastest of ``repeats`` runs."""
    return min(timed(run) for _ in range(repeats))


def timed(run):
    begin = time.perf_counter()
    run()
    return time.perf_counter() - begin


def drive(ecu, traffic):
    k, frames = 0, traffic.frames
    for t in range(traffic.ticks):
        while k < len(frames) and frames["tick"][k] <= t:
            ecu.receive(
                RX_IDS[frames["message"][k]], frames["payload"][k], int(frames["length"][k])
            )
            k += 1
        ecu.tick(int(traffic.elapsed[t]))


def host(record, traffic, repeats):
    cals = np.frombuffer(memory_image.image(record), memory_image.dtype(Calibration), 1).copy()
    generated, written = native.library(), native.build(handwritten.files())
    same(*(x.replay(x.start(cals), cals, [traffic], states=True) for x in (generated, written)))

    def replay(library):
        ecus = library.start(cals)
        return lambda: library.replay(ecus, cals, [traffic])

    ratios = []
    for _ in range(repeats):
        ratios.append(timed(replay(generated)) / timed(replay(written)))
    ticks = traffic.ticks
    batch = best(replay(generated), repeats) / ticks
    single = best(lambda: drive(NativeEcu(record), traffic), 3) / ticks
    python = best(lambda: drive(PythonEcu(record), traffic), 1) / ticks
    print(f"tick, batch of C          {1e6 * batch:8.3f} us  (target 0.3)")
    print(f"tick, single calls of C   {1e6 * single:8.3f} us  with its frames")
    print(f"tick, CPython             {1e6 * python:8.1f} us  {python / batch:.0f} times the batch")
    print(f"generated / hand-written  {np.median(ratios):8.3f}     (target 1.10)")
    print(f"ratio hand_written {1.0 / np.median(ratios):.3f}")


def same(generated, written):
    assert written.frames.tobytes() == generated.frames.tobytes(), "the frames differ"
    different = handwritten.differences(generated.states, written.states)
    assert not different, f"the states differ in {', '.join(different)}"


def beside_hand_written(name, record, traffic):
    timing, written = Timing("cortex-m4"), handwritten.files()
    for kind, firmware in (
        ("generated", built_in()),
        ("specialised", specialised(built_in(), record)),
    ):
        flags, runs, sizes = cortex_build.optimisation_of(firmware), [], []
        for files in (written, firmware.files):
            image = cortex_build.gcc_image("cortex-m4", files, optimisation=flags)
            costs = cycle_costs(image, timing)
            runs.append(
                qemu.replay(record, traffic, "cortex-m4", files, firmware=firmware, costs=costs)
            )
            sizes.append(footprint(image).text)
        same(*runs[::-1])
        least = runs[0]
        for title, run, size in zip((f"by hand {flags[0]}", kind), runs, sizes, strict=True):
            print(
                f"cortex-m4, {name:<15} {title:<13} {run.instructions.mean():.0f} instructions "
                f"({run.instructions.mean() / least.instructions.mean():.3f}), "
                f"{run.cycles.mean():.0f} cycles ({run.cycles.mean() / least.cycles.mean():.3f}), "
                f"code {size} B"
            )


def cortex(name, record, traffic, limit):
    run = qemu.replay(record, traffic, "cortex-m4")
    size = footprint(cortex_build.gcc_image("cortex-m4"))
    counts = run.instructions
    print(
        f"cortex-m4, {name:<24} {counts.min()} / {counts.mean():.0f} / {counts.max()} instructions "
        f"min/mean/max (target {limit}), stack {run.stack} B, code {size.text} B"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--duration", type=float, default=5.0)
    arguments = parser.parse_args()

    def case(**options):
        plain = {"scenario": "double_lane_change", "calibration": None, "law": "lqr"}
        plain |= {"observer": None, "identification": False, "duration": arguments.duration}
        plain |= {"actuator": "suspension", "response_watch": False}
        _, controller, traffic = recorded(SimpleNamespace(**(plain | options)))
        return controller.record, traffic

    constant, delayed = case(), case(law="ay_feedforward")
    host(*constant, arguments.repeats)
    if cortex_build.has_gcc_and_qemu():
        cortex("constant gain", *constant, 2500)
        cortex("covariance, RLS", *case(observer="propagated", identification=True), 9000)
        beside_hand_written("lqr", *constant)
        beside_hand_written("ay_feedforward", *delayed)


if __name__ == "__main__":
    main()
