"""The shortest tick this machine sustains: ECU and plant as two programs at ever faster ticks.

First how many times faster than real time lock step is, the fastest of three runs. Then, for
every tick and backend, deadline misses, start jitter and tick duration, the latter as
a share of the period; then, per backend, the shortest tick without a miss. A tick is sustained
where no deadline was missed in the whole run, so the machine should have nothing else to do.
"""

import argparse
import tempfile
from pathlib import Path

from canroll.hil import session
from canroll.runs import experiment

TICKS_MS = (20.0, 10.0, 5.0, 2.0, 1.0)


def measure(tick_ms, backend, duration, pace="realtime"):
    settings, controller = experiment.plan(
        "double_lane_change", tick_ms=tick_ms, backend=backend, duration=duration
    )
    with tempfile.TemporaryDirectory() as scratch:
        setup = session.Setup(
            bus_options=(),
            folder=Path(scratch),
            cores=session.choose_cores() if pace == "realtime" else None,
            pace=pace,
            duration=duration,
            announce=lambda text: None,
        )
        return session.drive(settings, controller, setup, enabled=True)[1]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=10.0, help="s of each run")
    parser.add_argument("--backends", nargs="+", default=["native", "python"])
    args = parser.parse_args()
    speed = max(measure(10.0, "native", None, "lockstep")["speed"] for _ in range(3))
    print(f"lock step: {speed:.1f} times as fast as real time\n")
    print(f"{'backend':<8} {'tick':>6} {'missed':>12} {'jitter p99':>11} {'tick p50':>9} "
          f"{'p99':>6} {'max':>6}  share p99")  # fmt: skip
    for backend in args.backends:
        sustained = None
        for tick_ms in TICKS_MS:
            timing = measure(tick_ms, backend, args.duration)
            took, missed = timing["tick_us"], timing["deadline_misses"]
            print(
                f"{backend:<8} {tick_ms:>3g} ms {missed:>5}/{timing['ticks'] + missed:<6} "
                f"{timing['start_jitter_us']['p99']:>8.0f} µs {took['p50']:>6.0f} µs "
                f"{took['p99']:>6.0f} {took['max']:>6.0f}  {took['p99'] / tick_ms / 10:.1f} %"
            )
            if missed == 0:
                sustained = tick_ms
        found = "none" if sustained is None else f"{sustained:g} ms"
        print(f"{backend}: shortest tick without a miss: {found}")


if __name__ == "__main__":
    main()
