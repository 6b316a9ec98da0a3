"""The firmware on this machine and on a Cortex-M4: a tick in CPython, in C, in a batch of C.

The generated C is held against the same loop with its hottest stage, the observer's prediction
and correction, written by hand: ratio of the ticks, same states. Targets: a batched tick takes at
most 0.3 us, the generated C at most 1.1 times the hand-written, a Cortex-M4 at most 2500
instructions for constant-gain state feedback and 9000 for covariance and identification.
"""

import argparse
import time
from types import SimpleNamespace

import numpy as np

from codegen import emit_c, layout, native, qemu_target, target
from codegen.backends import NativeEcu, PythonEcu
from codegen.footprint import footprint
from firmware.calibration import Calibration
from firmware.signals import RX_IDS
from hil.commands.timing import recorded

HAND = {
    "static void canroll_observer_advance": """
{
    const int32_t z0 = z[0], z1 = z[1], z2 = z[2], z3 = z[3], z4 = z[4];
    int32_t next[5];
    for (int i = 0; i < 2; i++) {
        const int32_t *f = cal->phi[i], *m = ecu->model[i];
        int64_t a = (int64_t)cal->gamma_steering[i] * steering + (int64_t)m[3] * moment
            + (int64_t)m[0] * z0 + (int64_t)m[1] * z1 + (int64_t)m[2] * z2
            + (int64_t)f[3] * z3 + (int64_t)f[4] * z4;
        next[i] = canroll_clamp(canroll_rsh_by(a, cal->phi_shift[i]), -(1 << 30), 1 << 30);
    }
    for (int i = 2; i < 5; i++) {
        const int32_t *f = cal->phi[i];
        int64_t a = (int64_t)cal->gamma_steering[i] * steering + (int64_t)cal->gamma[i] * moment
            + (int64_t)f[0] * z0 + (int64_t)f[1] * z1 + (int64_t)f[2] * z2
            + (int64_t)f[3] * z3 + (int64_t)f[4] * z4;
        next[i] = canroll_clamp(canroll_rsh_by(a, cal->phi_shift[i]), -(1 << 30), 1 << 30);
    }
    for (int i = 0; i < 5; i++) {
        ecu->work[i] = next[i];
        z[i] = next[i];
    }
}
""",
}


def by_hand(files):
    """The emitted files with the bodies of HAND in place of the generated ones."""
    text = files["canroll_observer.c"]
    for head, body in HAND.items():
        begin = text.index("{", text.index(head))
        end = text.index("\n}\n", begin) + 3
        text = text[:begin] + body.strip() + "\n" + text[end:]
    return {**files, "canroll_observer.c": text}


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
    cals = np.frombuffer(layout.image(record), layout.dtype(Calibration), 1).copy()
    generated = native.library()
    written = native.build(by_hand(emit_c.firmware()))
    states = [
        library.replay(library.start(cals), cals, [traffic], states=True).states.tobytes()
        for library in (generated, written)
    ]
    assert states[0] == states[1], "the hand-written stage does other work"

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


def cortex(name, record, traffic, limit):
    run = qemu_target.replay(record, traffic, "cortex-m4")
    size = footprint(target.gcc_image("cortex-m4"))
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
        controller, traffic = recorded(SimpleNamespace(**(plain | options)))
        return controller.record, traffic

    constant = case()
    host(*constant, arguments.repeats)
    if target.has_gcc_and_qemu():
        cortex("constant gain", *constant, 2500)
        cortex("covariance, RLS", *case(observer="propagated", identification=True), 9000)


if __name__ == "__main__":
    main()
